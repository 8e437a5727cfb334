//! The reference accelerometer as an instrument with errors of its own: noise, a scatter from run to run, a gain for each
//! axis, cross-sensitivity. How large they are is stated, or estimated from all runs together.

use super::response::{Response, Seen};
use crate::campaign::{Campaign, Run};
use crate::forward::conditions::seen_ratios;
use crate::forward::rows::RunConditions;
use crate::median::{MEDIAN_TO_SIGMA, median};

/// Standard uncertainty of a reference's cross-sensitivity, where none is stated.
const CROSS_SENSITIVITY: f64 = 0.01;
/// Largest gain error that is the reference's own, or the table's: beyond it something else is wrong.
const MOST_GAIN: f64 = 0.02;
/// Component of the direction from which on an axis tells its gain, and up to which it is at rest.
const TELLING: f64 = 0.3;
const AT_REST: f64 = 1e-6;
/// Uncertainty of a ratio of the reference's axes beside its scatter and noise.
const RATIO_SIGMA: f64 = 1e-5;
/// Correlation of noise with a motion over some 1e3 to 1e4 independent values of a record.
const COHERENT_NOISE: f64 = 0.03;
/// Fewest runs of one direction that tell a scatter.
const FEWEST_ALIKE: usize = 3;
/// Fewest pairs of axes that tell the reference's own scatter.
const FEWEST_PAIRS: usize = 6;
/// Total scatter over the stated one up to which nothing else need be looked for.
const CLEARLY: f64 = 2.0;
/// Relative uncertainty of a standard deviation that small samples leave: the gain's is taken as so much larger.
const FEW: f64 = 1.5;

/// How good a reference is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reference {
    /// Noise of each axis, rms, g.
    pub noise_g: f64,
    /// Relative scatter of an rms from run to run that is the reference's own.
    pub scatter: f64,
    /// Relative scatter of the table's level about its command.
    pub table_scatter: f64,
    /// What its axes read of a motion.
    pub response: Response,
    /// Relative standard uncertainty of each axis's gain, and of the table's level for a given command.
    pub gain_sigma: f64,
    /// Standard uncertainty of the sensitivity of an axis to motion along another one.
    pub cross_sigma: f64,
}

impl Reference {
    /// Of a campaign's reference; `None` without one.
    pub fn of(campaign: &Campaign, runs: &[&Run]) -> Option<Self> {
        let shaker = campaign.config.shaker.as_ref()?;
        let stated = shaker.reference_rms_rel_sigma;
        let made: Vec<&Run> = runs
            .iter()
            .copied()
            .filter(|run| run.reference.is_some())
            .collect();
        if made.is_empty() {
            return None;
        }
        let noise_g = shaker.reference_noise_g.unwrap_or_else(|| noise_g(&made));
        let ratios: Vec<(RunConditions, [f64; 3])> = made
            .iter()
            .filter_map(|run| {
                let conditions = RunConditions::from(*run);
                Some((
                    conditions,
                    seen_ratios(&conditions, run.reference.as_ref())?,
                ))
            })
            .collect();
        let total = total_scatter(&ratios);
        let (scatter, table_scatter) = split(total, own_scatter(&ratios), stated);
        let noisy = Self {
            noise_g,
            scatter,
            table_scatter,
            ..Self::default()
        };
        let seen = ratios.iter().map(|(run, ratios)| noisy.seen(run, *ratios));
        let seen: Vec<Seen> = seen.collect();
        let response = Response::of(&seen, table_scatter);
        let cross = response.crosses();
        let root_mean_square = |values: &[f64]| {
            (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
        };
        Some(Self {
            gain_sigma: shaker
                .reference_gain_rel_sigma
                .unwrap_or_else(|| (FEW * root_mean_square(&response.gains())).min(MOST_GAIN)),
            response,
            cross_sigma: root_mean_square(&cross).min(
                shaker
                    .reference_cross_sensitivity
                    .unwrap_or(CROSS_SENSITIVITY),
            ),
            ..noisy
        })
    }
}

/// The middle value, 0 of none.
fn middle(values: Vec<f64>) -> f64 {
    median(values).unwrap_or(0.0)
}

/// What an axis at rest reads that the moving one has no part in, g.
fn noise_g(runs: &[&Run]) -> f64 {
    let mut incoherent = Vec::new();
    for run in runs {
        let Some(seen) = &run.reference else { continue };
        let correlation = seen.correlation.unwrap_or([0.0; 3]);
        // Pairs of axes in the order of the correlations.
        for axis in (0..3).filter(|&axis| run.direction[axis].abs() < AT_REST) {
            let pairs: [usize; 2] = [[0, 1], [0, 2], [1, 2]][axis];
            let with_others = pairs.map(|pair| correlation[pair].powi(2));
            let coherent = with_others[0].max(with_others[1]).min(1.0);
            incoherent.push(seen.rms_g[axis] * (1.0 - coherent).sqrt());
        }
    }
    middle(incoherent)
}

/// The scatter of the ratio of reference to command about its middle value in each direction and axis.
fn total_scatter(seen: &[(RunConditions, [f64; 3])]) -> f64 {
    let mut known: Vec<([f64; 3], usize)> = Vec::new();
    let mut off = Vec::new();
    for (run, _) in seen {
        for axis in (0..3).filter(|&axis| run.direction[axis].abs() > TELLING) {
            if known.contains(&(run.direction, axis)) {
                continue;
            }
            known.push((run.direction, axis));
            let alike = seen
                .iter()
                .filter(|(other, _)| other.direction == run.direction);
            let errors: Vec<f64> = alike
                .map(|(_, ratios)| ratios[axis] / run.direction[axis] - 1.0)
                .collect();
            let middle = middle(errors.clone());
            if errors.len() >= FEWEST_ALIKE {
                off.extend(errors.iter().map(|error| (error - middle).abs()));
            }
        }
    }
    MEDIAN_TO_SIGMA * middle(off)
}

/// The scatter that is the reference's own: by which two moving axes of one run differ beyond their gains. `None` with too
/// few runs along two axes.
fn own_scatter(seen: &[(RunConditions, [f64; 3])]) -> Option<f64> {
    let mut differences: Vec<([f64; 3], [usize; 2], f64)> = Vec::new();
    for (run, ratios) in seen {
        for pair in [[0, 1], [0, 2], [1, 2]] {
            if pair.iter().all(|&axis| run.direction[axis].abs() > TELLING) {
                let [a, b] = pair.map(|axis| ratios[axis] / run.direction[axis]);
                differences.push((run.direction, pair, a - b));
            }
        }
    }
    if differences.len() < FEWEST_PAIRS {
        return None;
    }
    let off = differences.iter().map(|(direction, pair, difference)| {
        let alike = differences
            .iter()
            .filter(|(d, p, _)| (d, p) == (direction, pair));
        (difference - middle(alike.map(|(.., d)| *d).collect())).abs()
    });
    Some(MEDIAN_TO_SIGMA * middle(off.collect()) * std::f64::consts::FRAC_1_SQRT_2)
}

/// The reference's own scatter, and the table's. Where the two cannot be told apart each gets half of what is beyond the
/// stated.
fn split(total: f64, own: Option<f64>, stated: f64) -> (f64, f64) {
    if total < CLEARLY * stated {
        return (stated, 0.0);
    }
    let beyond = |part: f64| (total * total - part * part).max(0.0).sqrt();
    match own {
        Some(own) => {
            let own = own.max(stated);
            let table = beyond(own);
            (own, if table > 0.5 * total { table } else { 0.0 })
        }
        None => {
            let half = beyond(stated) * std::f64::consts::FRAC_1_SQRT_2;
            (stated.hypot(half), half)
        }
    }
}

impl Reference {
    /// The same reference where the table's level scatters, or all scatter is the reference's own.
    pub fn under(self, table_scatters: bool) -> Self {
        if table_scatters {
            return self;
        }
        Self {
            scatter: self.scatter.hypot(self.table_scatter),
            table_scatter: 0.0,
            ..self
        }
    }

    /// Standard deviation of what an axis reads over the level of a run, its gain and cross-sensitivity left out.
    pub fn ratio_sigma(&self, run: &RunConditions, ratio: f64) -> f64 {
        // What of its noise happens to go with the motion: a part of 1/sqrt of the record's independent values.
        let noise = COHERENT_NOISE * self.noise_g / run.level_g;
        (self.scatter * ratio).hypot(RATIO_SIGMA).hypot(noise)
    }

    fn seen(&self, run: &RunConditions, ratios: [f64; 3]) -> Seen {
        Seen {
            direction: run.direction,
            ratios,
            sigma: ratios.map(|ratio| self.ratio_sigma(run, ratio)),
        }
    }

    /// The table's level over its command, less 1, as reference and command together have it, and its variance.
    pub fn level_excess(&self, run: &RunConditions, ratios: Option<[f64; 3]>) -> (f64, f64) {
        if self.table_scatter == 0.0 {
            return (0.0, 0.0);
        }
        let Some(ratios) = ratios else {
            return (0.0, self.table_scatter.powi(2));
        };
        let seen = self.seen(run, ratios);
        let (error, _) = self.response.level(&seen, self.table_scatter);
        (error, Response::level_variance(&seen, self.table_scatter))
    }
}
