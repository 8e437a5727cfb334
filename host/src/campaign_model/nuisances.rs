//! What is not the instrument's own: each session beside the first has a bias, an alignment and a gain, and the table a
//! level of its own for a given command. They are unknowns of the base with priors, integrated out and reported, never
//! called a gap.

use shared::tumble::ARCSEC_RAD;

use crate::campaign::{Campaign, Run, VibrationKind};
use crate::forward::conditions::Conditions;
use crate::forward::contribution::{Contribution, Layout, Observable};
use crate::forward::nominal;

/// Standard uncertainties from session to session, where none is stated: of a power cycle's bias (g), of a fixture's
/// alignment (rad), and of the gain when another logger is used.
const BIAS_G: f64 = 1e-3;
const ALIGNMENT_RAD: f64 = 1e-3;
const GAIN: f64 = 0.01;
/// Standard uncertainty of the peak detector's gain, where none is stated.
const DETECTOR_GAIN: f64 = 0.005;

/// What a nuisance is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Bias of a session less that of the first, g.
    Bias,
    /// Turn of a session about PA or OA, rad.
    Alignment,
    /// Gain of a session over that of the first, less 1.
    Gain,
    /// Level of the table over its command, less 1.
    TableLevel,
    /// Gain of the peak detector, less 1.
    DetectorGain,
}

/// An unknown of the base beside the coefficients.
#[derive(Clone, Debug)]
pub struct Nuisance {
    /// What it is.
    pub kind: Kind,
    /// Session that it belongs to.
    pub session: String,
    /// Prior standard deviation about zero.
    pub sigma: f64,
}

/// The session of each reading and run, as numbers, with their names; the first is that of the first reading (or run).
#[derive(Clone, Debug)]
pub struct Sessions {
    names: Vec<String>,
    readings: Vec<usize>,
    /// `None` of a run that is to be predicted.
    runs: Vec<Option<usize>>,
    /// Standard uncertainties of what differs from session to session, and of the peak detector's gain.
    bias_sigma_g: f64,
    alignment_sigma_rad: f64,
    gain_sigma: f64,
    detector_gain_sigma: f64,
}

impl Sessions {
    /// Of a campaign, runs in the order of time. Without a word of their own all readings are one session, all runs another.
    pub fn of(campaign: &Campaign, runs: &[&Run]) -> Self {
        let mut names: Vec<String> = Vec::new();
        let mut number = |name: &str| {
            names
                .iter()
                .position(|known| known == name)
                .unwrap_or_else(|| {
                    names.push(name.into());
                    names.len() - 1
                })
        };
        let readings = campaign.readings.iter();
        let readings = readings
            .map(|reading| number(reading.session.as_deref().unwrap_or("static")))
            .collect();
        let runs = runs.iter().map(|run| {
            let session = run.session.as_deref().unwrap_or("shaker");
            run.measured.is_some().then(|| number(session))
        });
        let runs = runs.collect();
        let bench = &campaign.config.bench;
        Self {
            names,
            readings,
            runs,
            bias_sigma_g: bench.session_bias_sigma_g.unwrap_or(BIAS_G),
            alignment_sigma_rad: bench
                .session_alignment_sigma_arcsec
                .map_or(ALIGNMENT_RAD, |arcsec| arcsec * ARCSEC_RAD),
            gain_sigma: bench.session_gain_rel_sigma.unwrap_or(GAIN),
            detector_gain_sigma: campaign
                .config
                .shaker
                .as_ref()
                .and_then(|shaker| shaker.peak_gain_rel_sigma)
                .unwrap_or(DETECTOR_GAIN),
        }
    }
}

/// All nuisances of a campaign with what one unit of each does to the observables, not whitened.
pub fn nuisances(
    sessions: &Sessions,
    conditions: &Conditions,
    layout: &Layout,
    table_sigma: f64,
) -> Vec<(Nuisance, Contribution)> {
    let mut all = Vec::new();
    for (number, name) in sessions.names.iter().enumerate().skip(1) {
        let session = Session {
            number,
            sessions,
            conditions,
            layout,
        };
        let mut add = |kind, sigma: f64, contribution| {
            if sigma > 0.0 {
                let session = name.clone();
                all.push((
                    Nuisance {
                        kind,
                        session,
                        sigma,
                    },
                    contribution,
                ));
            }
        };
        add(
            Kind::Bias,
            sessions.bias_sigma_g,
            session.everywhere(|_| 1.0),
        );
        add(
            Kind::Alignment,
            sessions.alignment_sigma_rad,
            session.everywhere(|a| a[2]),
        );
        add(
            Kind::Alignment,
            sessions.alignment_sigma_rad,
            session.everywhere(|a| -a[1]),
        );
        add(Kind::Gain, sessions.gain_sigma, session.gain());
    }
    if table_sigma > 0.0 {
        let nuisance = Nuisance {
            kind: Kind::TableLevel,
            session: String::new(),
            sigma: table_sigma,
        };
        all.push((nuisance, table_level(conditions, layout)));
    }
    if sessions.detector_gain_sigma > 0.0 {
        let nuisance = Nuisance {
            kind: Kind::DetectorGain,
            session: String::new(),
            sigma: sessions.detector_gain_sigma,
        };
        all.push((nuisance, detector_gain(conditions, layout)));
    }
    all
}

/// One session's rows.
struct Session<'s> {
    number: usize,
    sessions: &'s Sessions,
    conditions: &'s Conditions,
    layout: &'s Layout,
}

impl Session<'_> {
    fn runs(&self) -> impl Iterator<Item = usize> + '_ {
        let runs = self.sessions.runs.iter().enumerate();
        runs.filter(|(_, session)| **session == Some(self.number))
            .map(|(row, _)| row)
    }

    fn readings(&self) -> impl Iterator<Item = usize> + '_ {
        let readings = self.sessions.readings.iter().enumerate();
        readings
            .filter(|(_, session)| **session == self.number)
            .map(|(row, _)| row)
    }

    /// The same shift, by the specific force at rest, of every output.
    fn everywhere(&self, shift: impl Fn([f64; 3]) -> f64) -> Contribution {
        let mut sum = self.layout.nothing();
        for row in self.readings() {
            let a = self.conditions.readings[row].specific_force_g;
            sum.add(Observable::Static, row, shift([a.i, a.p, a.o]));
        }
        for row in self.runs() {
            let run = &self.conditions.runs[row];
            let a = run.specific_force_g;
            let value = shift([a.i, a.p, a.o]);
            for plateau in [Observable::Before, Observable::During, Observable::After] {
                sum.add(plateau, row, value);
            }
            if run.kind == VibrationKind::Sine {
                sum.add(Observable::Maximum, row, value);
                sum.add(Observable::Minimum, row, value);
            }
        }
        sum
    }

    /// Every output, at the coefficients that are believed.
    fn gain(&self) -> Contribution {
        let c = &self.conditions.coefficients;
        let mut sum = self.layout.nothing();
        for row in self.readings() {
            let output = c.output_g(self.conditions.readings[row].specific_force_g);
            sum.add(Observable::Static, row, output);
        }
        let moving = nominal::moving(&self.conditions.runs, &self.conditions.motions);
        for row in self.runs() {
            let run = &self.conditions.runs[row];
            let rest = c.output_g(run.specific_force_g);
            let [vre, most, least] = moving[row].map(|terms| nominal::value(c, &terms));
            sum.add(Observable::Before, row, rest);
            sum.add(Observable::After, row, rest);
            sum.add(Observable::During, row, rest + vre);
            if run.kind == VibrationKind::Sine {
                sum.add(Observable::Maximum, row, most);
                sum.add(Observable::Minimum, row, least);
            }
        }
        sum
    }
}

/// The extremes of sines, at the coefficients that are believed.
fn detector_gain(conditions: &Conditions, layout: &Layout) -> Contribution {
    let mut sum = layout.nothing();
    let moving = nominal::moving(&conditions.runs, &conditions.motions);
    for (row, run) in conditions.runs.iter().enumerate() {
        if run.made && run.kind == VibrationKind::Sine {
            let [_, most, least] =
                moving[row].map(|terms| nominal::value(&conditions.coefficients, &terms));
            sum.add(Observable::Maximum, row, most);
            sum.add(Observable::Minimum, row, least);
        }
    }
    sum
}

/// Derivative of all observables by the logarithm of the table's level.
fn table_level(conditions: &Conditions, layout: &Layout) -> Contribution {
    const STEP: f64 = 1e-3;
    let mut sum = layout.nothing();
    let scaled = |factor: f64| {
        let mut motions = conditions.motions.clone();
        motions.iter_mut().for_each(|motion| motion.scale(factor));
        nominal::moving(&conditions.runs, &motions)
    };
    let (up, down) = (scaled(1.0 + STEP), scaled(1.0 - STEP));
    let c = &conditions.coefficients;
    for (row, run) in conditions
        .runs
        .iter()
        .enumerate()
        .filter(|(_, run)| run.made)
    {
        let slope = |part: usize| {
            let change = nominal::value(c, &up[row][part]) - nominal::value(c, &down[row][part]);
            change / (2.0 * STEP)
        };
        sum.add(Observable::During, row, slope(0));
        if run.kind == VibrationKind::Sine {
            sum.add(Observable::Maximum, row, slope(1));
            sum.add(Observable::Minimum, row, slope(2));
        }
        for axis in 0..3 {
            sum.add(Observable::Reference, 3 * row + axis, run.direction[axis]);
        }
    }
    sum
}
