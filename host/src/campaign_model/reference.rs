//! The reference accelerometer as an instrument with errors of its own: noise, a scatter from run to run, a gain for each
//! axis, cross-sensitivity. How large they are is stated, or estimated from all runs together.

use crate::campaign::{Campaign, Run};
use crate::forward::conditions::{RunConditions, seen_ratios};

/// Standard uncertainty of a reference's cross-sensitivity, where none is stated.
const CROSS_SENSITIVITY: f64 = 0.01;
/// Largest gain error that is the reference's own, or the table's: beyond it something else is wrong.
const MOST_GAIN: f64 = 0.02;
/// Component of the direction from which on an axis tells its gain, and up to which it is at rest.
const TELLING: f64 = 0.3;
const AT_REST: f64 = 1e-6;
/// Standard deviation of a robust scale by the median of moduli: 1 / 0.6745 of it.
const MEDIAN_TO_SIGMA: f64 = 1.482_6;
/// Relative uncertainty of a standard deviation that small samples leave: the gain's is taken as so much larger.
const FEW: f64 = 1.5;

/// How good a reference is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reference {
    /// Noise of each axis, rms, g.
    pub noise_g: f64,
    /// Relative scatter of an rms from run to run.
    pub scatter: f64,
    /// Relative standard uncertainty of each axis's gain, and of the table's level for a given command.
    pub gain_sigma: f64,
    /// Standard uncertainty of the sensitivity of an axis to motion along another one.
    pub cross_sigma: f64,
}

impl Reference {
    /// Of a campaign's reference; `None` without one.
    pub fn of(campaign: &Campaign, runs: &[&Run]) -> Option<Self> {
        let stated = campaign.config.shaker.as_ref()?.reference_rms_rel_sigma;
        let made: Vec<&Run> = runs
            .iter()
            .copied()
            .filter(|run| run.reference.is_some())
            .collect();
        if made.is_empty() {
            return None;
        }
        let noise_g = noise_g(&made);
        let seen: Vec<(RunConditions, [f64; 3])> = made
            .iter()
            .filter_map(|run| {
                let conditions = RunConditions::from(*run);
                Some((
                    conditions,
                    seen_ratios(&conditions, run.reference.as_ref())?,
                ))
            })
            .collect();
        let (gains, scatter) = gains(&seen);
        let cross = cross_sensitivities(&seen);
        let root_mean_square = |values: &[f64]| {
            (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
        };
        Some(Self {
            noise_g,
            scatter: scatter.max(stated),
            gain_sigma: (FEW * root_mean_square(&gains)).min(MOST_GAIN),
            cross_sigma: root_mean_square(&cross).min(CROSS_SENSITIVITY),
        })
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n if n % 2 == 1 => values[n / 2],
        n => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
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
    median(incoherent)
}

/// The relative gain error of each axis that moves in some run, and the scatter about it.
fn gains(seen: &[(RunConditions, [f64; 3])]) -> (Vec<f64>, f64) {
    let (mut gains, mut off) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        let telling = seen
            .iter()
            .filter(|(run, _)| run.direction[axis].abs() > TELLING);
        let errors: Vec<f64> = telling
            .map(|(run, ratios)| ratios[axis] / run.direction[axis] - 1.0)
            .collect();
        if errors.is_empty() {
            continue;
        }
        let gain = median(errors.clone());
        off.extend(errors.iter().map(|error| (error - gain).abs()));
        gains.push(gain);
    }
    (gains, MEDIAN_TO_SIGMA * median(off))
}

/// What axes at rest show of the motion along another one.
fn cross_sensitivities(seen: &[(RunConditions, [f64; 3])]) -> Vec<f64> {
    let mut found = Vec::new();
    for axis in 0..3 {
        for other in (0..3).filter(|&other| other != axis) {
            let alone = seen
                .iter()
                .filter(|(run, _)| run.direction[other].abs() > 1.0 - AT_REST);
            let parts: Vec<f64> = alone
                .map(|(run, ratios)| ratios[axis] / run.direction[other])
                .collect();
            if !parts.is_empty() {
                found.push(median(parts));
            }
        }
    }
    found
}
