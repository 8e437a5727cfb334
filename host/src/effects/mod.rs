//! Effects that the nominal model leaves out, each a forward model of its own.
//!
//! An [`Effect`] says what it adds to the observations of a campaign, or how it changes the instrument's motion. It
//! is one entry in the file of its stage; everything else (fit, evidence, classes, predictions, report) follows.

mod acquisition;
mod environment;
pub mod identity;
mod instrument_dynamics;
mod instrument_statics;
mod mounting;
mod shaker;
mod static_bench;

use inference::model::{Component, Fidelity, Kind};
use inference::prior::{Parameter, even, linear, logarithmic, stepped};

use crate::forward::conditions::{Conditions, Witnesses};
use crate::forward::contribution::{Contribution, Observable, add_each};
use crate::forward::motion::Motion;
use crate::forward::rows::{ReadingConditions, RunConditions};
use identity::Stage;

/// An effect of the catalogue. Parameters in proportion come first.
#[derive(Debug)]
pub struct Effect {
    /// Its identifier on the command line, in JSON and in reports.
    pub id: &'static str,
    /// Where it acts.
    pub stage: Stage,
    /// What it is, for a person.
    pub says: &'static str,
    /// Its parameters.
    pub parameters: &'static [Parameter],
    /// How it acts.
    pub action: Action,
    /// Parameters by other names: names, and the function from fitted to reported values.
    pub report: Option<Renamed>,
}

/// Names of reported parameters, and the function from fitted to reported values.
pub type Renamed = (&'static [&'static str], fn(&[f64]) -> Vec<f64>);

/// What an effect adds at the values of its parameters, so exactly.
pub type Add = fn(&[f64], &Conditions, &Witnesses, Fidelity, &mut [Contribution]);

/// How an effect transforms the motions of the runs.
pub type Transform = fn(&[f64], &Conditions, &Witnesses, &mut [Motion]);

/// How an effect acts.
#[derive(Clone, Copy, Debug)]
pub enum Action {
    /// Adds to the observations: per unit of each parameter in proportion, in their order, at the others' values; with no
    /// parameter in proportion one change, all that it adds.
    Adds(Add),
    /// Changes the instrument's motion in each run; whether the reference sees it.
    TransformsMotion(Transform, Seen),
    /// Adds variance to a run's `during`, in g^2 when the effect's one parameter, a size, is 1.
    AddsVariance(fn(&RunConditions, &Conditions) -> f64),
}

/// Whether the reference accelerometer sees a changed motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// It does.
    ByReference,
    /// It does not.
    ByInstrumentAlone,
}

impl Effect {
    /// What the search needs to know of it. Without a reference nothing but the instrument's cross-couplings tells the sign
    /// of a motion across the drive.
    pub fn component(&self, reference: bool) -> Component {
        Component {
            parameters: self.parameters,
            kind: match self.action {
                Action::Adds(_) => Kind::Adds,
                Action::TransformsMotion(..) => Kind::TransformsBase,
                Action::AddsVariance(_) => Kind::AddsVariance,
            },
            signs_alike: !reference
                && self.parameters.len() > 1
                && matches!(self.action, Action::TransformsMotion(_, Seen::ByReference)),
        }
    }

    /// Number of parameters in proportion.
    pub fn linear(&self) -> usize {
        self.component(true).linear()
    }
}

/// The whole catalogue.
pub fn catalogue() -> impl Iterator<Item = &'static Effect> {
    [
        instrument_statics::EFFECTS,
        instrument_dynamics::EFFECTS,
        mounting::EFFECTS,
        static_bench::EFFECTS,
        shaker::EFFECTS,
        environment::EFFECTS,
        acquisition::EFFECTS,
    ]
    .into_iter()
    .flatten()
}

/// The effect of that identifier.
pub fn find(id: &str) -> Option<&'static Effect> {
    catalogue().find(|effect| effect.id == id)
}

/// Adds to the dial readings values in units of gravity.
fn on_dial<const N: usize>(
    s: &Conditions,
    changes: &mut [Contribution],
    values: impl Fn(&ReadingConditions) -> [f64; N],
) {
    for (row, reading) in s.readings.iter().enumerate() {
        let values = values(reading).map(|value| s.gravity_g * value);
        add_each(changes, Observable::Static, row, values);
    }
}
