//! Effects that the nominal model leaves out, each a forward model of its own.
//!
//! An [`Effect`] says what it adds to the observations of a campaign, or how it changes the instrument's motion. It
//! is one entry in the file of its stage; everything else (fit, evidence, classes, predictions, report) follows.

mod acquisition;
mod bench;
mod dynamics;
mod environment;
mod mounting;
mod shaker;
mod statics;

use serde::{Deserialize, Serialize};

use super::motion::Motion;
use super::problem::{Block, Change, Situation};
use crate::campaign::Run;

/// Link of the chain at which an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// The instrument's characteristic at rest.
    InstrumentStatics,
    /// Its inner motion and its servo loop.
    InstrumentDynamics,
    /// Between table and instrument.
    Mounting,
    /// Dividing head and base.
    StaticBench,
    /// Table, drive and reference.
    Shaker,
    /// Temperature, time, history.
    Environment,
    /// Converter and logger.
    Acquisition,
}

impl Stage {
    /// All stages in the order of the chain.
    pub const ALL: [Self; 7] = [
        Self::StaticBench,
        Self::Shaker,
        Self::Mounting,
        Self::InstrumentStatics,
        Self::InstrumentDynamics,
        Self::Environment,
        Self::Acquisition,
    ];
}

/// How a parameter enters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role {
    /// In proportion; the width of its (Cauchy) prior.
    Linear {
        /// Typical size.
        width: f64,
    },
    /// Smoothly: started from a grid and refined, evenly probable over the range.
    Curved {
        /// Least value.
        from: f64,
        /// Greatest value.
        to: f64,
        /// Points of the grid.
        points: usize,
        /// Whether the range is one of the logarithm.
        logarithmic: bool,
    },
    /// By steps: a threshold of the runs' peaks, g. Started from a grid, and then put between two peaks.
    Stepped {
        /// Least value.
        from: f64,
        /// Greatest value.
        to: f64,
        /// Points of the grid.
        points: usize,
    },
}

/// A parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name with its unit at the end; one that starts with an underscore is not reported.
    pub name: &'static str,
    /// How it enters.
    pub role: Role,
}

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

/// What an effect adds at the values of its parameters.
pub type Add = fn(&[f64], &Situation<'_>, &mut [Change]);

/// How an effect acts.
#[derive(Clone, Copy, Debug)]
pub enum Action {
    /// Adds to the observations: per unit of each parameter in proportion, in their order, at the others' values; with no
    /// parameter in proportion one change, all that it adds.
    Adds(Add),
    /// Changes the instrument's motion in each run; whether the reference sees it.
    Moves(fn(&[f64], &Situation<'_>, &mut [Motion]), Seen),
    /// Scatters a run's `during`: the variance in g^2 when the effect's one parameter, a size, is 1.
    Scatters(fn(&Run, &Situation<'_>) -> f64),
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
    /// Number of parameters in proportion.
    pub fn linear(&self) -> usize {
        self.parameters
            .iter()
            .take_while(|p| matches!(p.role, Role::Linear { .. }))
            .count()
    }
}

/// The whole catalogue.
pub fn catalogue() -> impl Iterator<Item = &'static Effect> {
    [
        statics::EFFECTS,
        dynamics::EFFECTS,
        mounting::EFFECTS,
        bench::EFFECTS,
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

/// Adds a value to each of several changes.
fn add_each(
    changes: &mut [Change],
    block: Block,
    row: usize,
    values: impl IntoIterator<Item = f64>,
) {
    for (change, value) in changes.iter_mut().zip(values) {
        change.add(block, row, value);
    }
}

const fn linear(name: &'static str, width: f64) -> Parameter {
    Parameter {
        name,
        role: Role::Linear { width },
    }
}

const fn logarithmic(name: &'static str, from: f64, to: f64, points: usize) -> Parameter {
    Parameter {
        name,
        role: Role::Curved {
            from,
            to,
            points,
            logarithmic: true,
        },
    }
}

const fn even(name: &'static str, from: f64, to: f64, points: usize) -> Parameter {
    Parameter {
        name,
        role: Role::Curved {
            from,
            to,
            points,
            logarithmic: false,
        },
    }
}

const fn stepped(name: &'static str, from: f64, to: f64, points: usize) -> Parameter {
    Parameter {
        name,
        role: Role::Stepped { from, to, points },
    }
}
