//! How much of the gap an effect is expected to close on runs that nobody has made.
//!
//! Held-out runs of a campaign are few and carry their plateaus' noise, which at a small gap is as large as what is to
//! be told. The posterior knows better. With r the vibration errors that the refitted nominal model predicts, w those
//! with the effects, and t the true ones, of which hypothesis h (probability p, prediction w_h, covariance C_h) says
//! t ~ N(w_h, C_h),
//!
//! ```text
//! E|t - w|^2 = sum p (|w_h - w|^2 + tr C_h),    E|t - r|^2 = sum p (|w_h - r|^2 + tr C_h)
//! closed = 1 - sqrt(E|t - w|^2 / E|t - r|^2)
//! ```
//!
//! C_h holds what the effect makes of a record that nobody knows (clipping, a resonance within the band), too. Noise of
//! the plateaus and what a finite record hides of the nominal model are in none of these: it is the fraction of what the
//! refit leaves above the floor. The runs lie between those of the campaign: frequency, level and direction each between two
//! of its runs, so that the instrument's input axis is shaken. Where nothing in the catalogue explains the gap, the error
//! that cross-validation finds beyond what the hypothesis admits is added to its covariance.

use super::diagnosis::standing;
use super::fit::Fit;
use super::forecast::Forecast;
use super::locate::SplitMix;
use super::problem::Problem;
use super::search::Search;
use crate::campaign::{Campaign, ReferenceMoments, Run, VibrationKind};

impl Problem<'_> {
    /// Fraction, 0 to 1, of what the refit leaves that `shown` is expected to close on runs like the campaign's;
    /// `misfit_g2` is the mean square error by which `shown` fails beyond its own uncertainty.
    pub(super) fn expected_closing(
        &self,
        campaign: &Campaign,
        search: &Search,
        shown: &Fit,
        misfit_g2: f64,
    ) -> f64 {
        if shown.members.is_empty() {
            return 0.0;
        }
        let further = between(&campaign.runs);
        let runs_alone = Campaign {
            readings: Vec::new(),
            ..campaign.clone()
        };
        let mut predictor = Problem::with_scale(&runs_alone, &further, self.scale_v_per_g);
        predictor.situation.coefficients = self.situation.coefficients;
        let predictor = predictor.unweighted();
        let new = self.run_count()..predictor.run_count();
        let says = |fit: &Fit| predictor.forecast(fit);
        let (refit, with) = (says(&search.null), says(shown));
        let (mut left, mut before, mut total) = (0.0, 0.0, 0.0);
        for hypothesis in standing(search) {
            let says = says(&hypothesis.fit);
            let of = |prediction: &Forecast| -> f64 {
                let error = |row: usize| prediction.vre_g[row] - says.vre_g[row];
                let spread = |row: usize| says.variance[row] + says.record[row] + misfit_g2;
                let rows = new.clone();
                rows.map(|row| error(row).powi(2) + spread(row)).sum()
            };
            left += hypothesis.probability * of(&with);
            before += hypothesis.probability * of(&refit);
            total += hypothesis.probability;
        }
        if total == 0.0 || before == 0.0 {
            return 0.0;
        }
        (1.0 - (left / before).sqrt()).clamp(0.0, 1.0)
    }
}

/// As many runs as were made, each between two of them.
fn between(runs: &[Run]) -> Vec<Run> {
    let made: Vec<&Run> = runs.iter().filter(|run| run.measured.is_some()).collect();
    let mut along: Vec<&Run> = made.clone();
    along.retain(|run| run.direction[0] != 0.0);
    if along.is_empty() {
        along.clone_from(&made);
    }
    let (Some(first), Some(last)) = (made.first(), made.last()) else {
        return Vec::new();
    };
    let interval_s = (last.time_s - first.time_s) / made.len() as f64;
    let number = runs.iter().map(|run| run.run).max().unwrap_or(0);
    let mut random = SplitMix(1);
    let drawn = made.iter().zip(1..).map(|(run, n)| {
        let mut alike = made.clone();
        alike.retain(|other| other.kind == run.kind);
        let mut pair = |first: &[&'_ Run], second: &[&'_ Run]| {
            let one = random.index(first.len());
            let other = random.index(second.len());
            (one, other, random.uniform())
        };
        let (one, other, part) = pair(&alike, &alike);
        let level_g = part * alike[one].level_g + (1.0 - part) * alike[other].level_g;
        let (_, other, part) = pair(&alike, &alike);
        let band_hz = match run.kind {
            VibrationKind::Sine => {
                [run.band_hz[0].powf(part) * alike[other].band_hz[0].powf(1.0 - part); 2]
            }
            VibrationKind::Random => run.band_hz,
        };
        // Nearer to the first, whose attitude the instrument has.
        let (one, other, part) = pair(&along, &made);
        let part = 0.5 + 0.5 * part;
        let (near, far) = (along[one], made[other]);
        let mixed: [f64; 3] = std::array::from_fn(|axis| {
            part * near.direction[axis] + (1.0 - part) * far.direction[axis]
        });
        let length = mixed.iter().map(|n| n * n).sum::<f64>().sqrt();
        let direction = if length > 0.1 {
            mixed.map(|n| n / length)
        } else {
            near.direction
        };
        Run {
            run: number + n,
            time_s: last.time_s + n as f64 * interval_s.max(1.0),
            direction,
            specific_force_g: near.specific_force_g,
            level_g,
            band_hz,
            measured: None,
            // The moments of a random record will have been seen: a Gaussian's, for all that is known before.
            reference: run
                .reference
                .filter(|_| run.kind == VibrationKind::Random)
                .map(|_| gaussian(direction.map(|n| n * level_g))),
            ..(*run).clone()
        }
    });
    drawn.collect()
}

/// What the reference sees of Gaussian noise along one line with these rms values, g.
fn gaussian(rms_g: [f64; 3]) -> ReferenceMoments {
    let [i, p, o] = rms_g;
    let line = |x: f64, y: f64| if x * y == 0.0 { 0.0 } else { (x * y).signum() };
    ReferenceMoments {
        rms_g: rms_g.map(f64::abs),
        skewness: [0.0; 3],
        kurtosis: rms_g.map(|rms_g| if rms_g == 0.0 { 0.0 } else { 3.0 }),
        correlation: Some([line(i, p), line(i, o), line(p, o)]),
    }
}
