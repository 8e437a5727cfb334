//! Conditions of a campaign, and what other instruments than the one under test saw.

use std::sync::Arc;

use shared::model::{Coefficients, SpecificForce};

use super::band::Bands;
use super::motion::{Motion, main_axis};
use super::rows::{ReadingConditions, RunConditions};
use super::time_mean::Averages;
use crate::campaign::{Campaign, Reading, ReferenceMoments, Run, VibrationKind};

/// What other instruments than the one under test saw of each run: the table's reference, and the peak detector at the
/// output. They are handed to an effect explicitly, since no effect may look at what it is to explain.
#[derive(Clone, Debug)]
pub struct Witnesses {
    /// Least and greatest output, g.
    pub extremes_g: Vec<Option<[f64; 2]>>,
    /// The reference's moments.
    pub reference: Vec<Option<ReferenceMoments>>,
    /// Relative standard uncertainty of the reference's rms.
    pub reference_rel_sigma: f64,
    /// Relative excess of a sine's mean square that the reference saw over the command's.
    pub power_excess: f64,
    /// Of each run the table's level over its command, less 1, and its variance.
    pub level_excess: Vec<(f64, f64)>,
}

impl Witnesses {
    /// Of runs in the order of time, outputs divided by a scale factor.
    pub fn new(campaign: &Campaign, runs: &[&Run], scale_v_per_g: f64) -> Self {
        let extremes_g = |run: &&Run| Some(run.measured?.extremes?.over(scale_v_per_g));
        let shaker = campaign.config.shaker.as_ref();
        let reference_rel_sigma = shaker.map_or(0.0, |s| s.reference_rms_rel_sigma);
        Self {
            extremes_g: runs.iter().map(extremes_g).collect(),
            reference: runs.iter().map(|run| run.reference).collect(),
            reference_rel_sigma,
            power_excess: power_excess(runs, reference_rel_sigma),
            level_excess: vec![(0.0, 0.0); runs.len()],
        }
    }
}

/// What effects may look at.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// Dial readings.
    pub readings: Arc<[ReadingConditions]>,
    /// Runs, those to be predicted included, in the order of time.
    pub runs: Arc<[RunConditions]>,
    /// Their motion: as commanded, or as another effect of the hypothesis has changed it.
    pub motions: Vec<Motion>,
    /// Tables for time means.
    pub averages: Arc<Averages>,
    /// Their bands.
    pub bands: Arc<Bands>,
    /// Coefficients that the nominal model is believed to have; the scale factor over that by which outputs are divided.
    pub coefficients: Coefficients<f64>,
    /// Largest magnitude of each run's vibration along IA, g.
    pub peaks_g: Arc<[f64]>,
    /// Local gravity, g.
    pub gravity_g: f64,
    /// Reference temperature, degrees Celsius.
    pub reference_temp_c: f64,
    /// The logger's rate, Hz.
    pub logger_rate_hz: f64,
    /// Relative difference up to which two extremes of the peak detector may be alike.
    pub peak_rel_error: f64,
}

impl Conditions {
    /// Of a campaign's readings and of runs in the order of time, moving as command and reference together say.
    pub fn new(
        campaign: &Campaign,
        runs: &[&Run],
        witnesses: &Witnesses,
        coefficients: Coefficients<f64>,
    ) -> Self {
        let start_s = campaign.start_s();
        let reading = |reading: &Reading| ReadingConditions {
            time_s: reading.time_s - start_s,
            ..reading.into()
        };
        let readings: Arc<[_]> = campaign.readings.iter().map(reading).collect();
        let motion = |(run, (excess, variance)): (&&Run, &(f64, f64))| {
            let mut motion = Motion::commanded(&(*run).into(), run.reference.as_ref());
            if *excess != 0.0 {
                motion.scale(1.0 + excess);
            }
            // The mean square follows the level twice.
            motion.power_variance = 4.0 * variance;
            motion
        };
        let run = |run: &&Run| RunConditions {
            time_s: run.time_s - start_s,
            ..(*run).into()
        };
        let conditions: Arc<[RunConditions]> = runs.iter().map(run).collect();
        let bench = &campaign.config.bench;
        Self {
            motions: runs
                .iter()
                .zip(&witnesses.level_excess)
                .map(motion)
                .collect(),
            averages: Arc::new(Averages::new(&conditions)),
            bands: Arc::new(Bands::new(&conditions)),
            readings,
            runs: conditions,
            coefficients,
            peaks_g: Arc::new([]),
            gravity_g: bench.local_gravity_g,
            reference_temp_c: bench.reference_temp_c,
            logger_rate_hz: campaign.config.acquisition.sample_rate_hz,
            peak_rel_error: campaign.config.peak_rel_error(),
        }
    }

    /// Believes these coefficients, and the peaks that follow from them.
    pub fn linearise_about(&mut self, coefficients: Coefficients<f64>, witnesses: &Witnesses) {
        self.coefficients = coefficients;
        let runs = self.runs.iter().zip(&witnesses.extremes_g);
        self.peaks_g = runs
            .map(|(run, ends)| peak_g(run, *ends, &coefficients))
            .collect();
    }
}

/// The reference's rms over the commanded level on each axis, with the sign of the motion: across the main axis the part
/// that moves with it, so that noise of the reference's own has no share in it.
pub fn seen_ratios(run: &RunConditions, seen: Option<&ReferenceMoments>) -> Option<[f64; 3]> {
    let seen = seen?;
    let level = match run.kind {
        VibrationKind::Sine => run.level_g * std::f64::consts::FRAC_1_SQRT_2,
        VibrationKind::Random => run.level_g,
    };
    if level <= 0.0 {
        return None;
    }
    let main = main_axis(&run.direction);
    // Which correlation ties an axis to the main one.
    let pair = [[3, 0, 1], [0, 3, 2], [1, 2, 3]][main];
    let sign = run.direction[main].signum();
    let mut ratios = [0.0; 3];
    for axis in 0..3 {
        let with_main = match (axis == main, &seen.correlation) {
            (true, _) => 1.0,
            (false, Some(correlation)) => correlation[pair[axis]],
            (false, None) => (run.direction[axis] * run.direction[main]).signum(),
        };
        ratios[axis] = sign * with_main * seen.rms_g[axis] / level;
    }
    Some(ratios)
}

/// Mean square that the reference saw along the main axis over the command's, less 1; zero within four of its sigmas.
fn power_excess(runs: &[&Run], relative: f64) -> f64 {
    let of_kind = runs.iter().filter(|run| run.kind == VibrationKind::Sine);
    let excess: Vec<f64> = of_kind
        .filter_map(|run| {
            let main = main_axis(&run.direction);
            let ratios = seen_ratios(&(*run).into(), run.reference.as_ref())?;
            Some((ratios[main] / run.direction[main]).powi(2) - 1.0)
        })
        .collect();
    let mean = excess.iter().sum::<f64>() / excess.len().max(1) as f64;
    let sigma = 2.0 * relative / (excess.len().max(1) as f64).sqrt();
    if mean.abs() > 4.0 * sigma { mean } else { 0.0 }
}

/// Cosine of the angle between motion and IA below which the output's extremes do not tell the motion.
const LEAST_COSINE: f64 = 0.05;
/// Peak over rms of a random record without a peak detector: the expected maximum of some 1e4 independent values.
const CREST: f64 = 4.0;

/// Largest magnitude of a run's vibration along IA, g: the excursion that gives the output's extremes.
fn peak_g(
    run: &RunConditions,
    extremes_g: Option<[f64; 2]>,
    coefficients: &Coefficients<f64>,
) -> f64 {
    let Some([least, most]) = extremes_g.filter(|_| run.direction[0].abs() >= LEAST_COSINE) else {
        let commanded = (run.direction[0] * run.level_g).abs();
        return match run.kind {
            VibrationKind::Sine => commanded,
            VibrationKind::Random => CREST * commanded,
        };
    };
    let rest = run.specific_force_g;
    let [i, p, o] = run.direction.map(|cosine| cosine / run.direction[0]);
    let excursion = |extreme_g: f64| {
        (0..4).fold(0.0, |w: f64, _| {
            let force = SpecificForce::new(rest.i + i * w, rest.p + p * w, rest.o + o * w);
            w + extreme_g - coefficients.output_g(force)
        })
    };
    excursion(most).abs().max(excursion(least).abs())
}
