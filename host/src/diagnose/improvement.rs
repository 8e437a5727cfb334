//! How much of the gap an effect is expected to close on runs that nobody has made.
//!
//! Held-out runs of a campaign are few and carry their plateaus' noise, which at a small gap is as large as what is to
//! be told. The posterior knows better. With r the vibration errors that the refitted nominal model predicts, w those
//! with the effects, and t true ones, drawn from the hypotheses that stand (and that nothing acts) by their probability, each
//! with its parameters about their estimates, on a list of runs drawn from likely ones,
//!
//! ```text
//! closed = 1 - |t - w| / |t - r|
//! ```
//!
//! has a distribution: its median and its central 90 % are what is stated. t holds what the effect makes of a record that
//! nobody knows (clipping, a resonance within the band), too. Noise of the plateaus and what a finite record hides of the
//! nominal model are in none of these: it is the fraction of what the refit leaves above the floor. The runs lie between
//! those of the campaign: frequency, level and direction each between two of its runs, so that the instrument's input axis
//! is shaken.
//!
//! An effect that bends the static readings alone, or leaves the vibration error hardly changed, may be certain and make
//! predictions no better: both are then off by their noise. Effects that would make them worse by more than [`WORSE`] with
//! a probability of more than [`RISK`] are not used in predictions, and close nothing; nor are those of a gap that stays
//! unexplained: they fit some of what was measured, for a reason that nobody knows.

use inference::dense::{Cholesky, inner_product};
use inference::fit::Fit;
use inference::search::{Hypothesis, Search};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::verdict::credible_set;
use crate::campaign::{Campaign, ReferenceMoments, Run, VibrationKind};
use crate::campaign_model::CampaignModel;
use crate::campaign_model::assumptions::Assumptions;
use crate::refit::Forecast;

/// Draws of what may be true.
const DRAWS: usize = 400;
/// Runs on the list that a draw is about: short, since those of a test are mostly alike.
const LIST: usize = 12;
/// Relative growth of the error on new runs that predictions must not suffer, and the greatest chance of it.
const WORSE: f64 = 0.05;
const RISK: f64 = 0.02;

/// Fraction of what the refit leaves on new runs that effects close.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ExpectedImprovement {
    /// Median, 0 to 1; 0 if the effects are not used in predictions.
    pub(super) fraction: f64,
    /// Central 90 %, cut at 0.
    pub(super) interval: [f64; 2],
}

/// What `shown` closes of what the refit leaves, on runs like the campaign's.
pub(super) fn expected_improvement(
    campaign: &Campaign,
    model: &CampaignModel,
    search: &Search,
    shown: &Fit,
) -> ExpectedImprovement {
    if shown.members.is_empty() || search.unexplained {
        return ExpectedImprovement::default();
    }
    let further = between(&campaign.runs);
    let runs_alone = Campaign {
        readings: Vec::new(),
        ..campaign.clone()
    };
    let scale_v_per_g = model.scale_v_per_g();
    let mut predictor = CampaignModel::with_scale(
        &runs_alone,
        &further,
        model.effects(),
        &Assumptions::default(),
        scale_v_per_g,
    );
    predictor.believe(model.conditions().coefficients);
    let predictor = predictor.in_g(model.nuisances().len());
    let new_runs = campaign.runs.len()..campaign.runs.len() + further.len();
    let rows: Vec<usize> = new_runs.map(|place| predictor.row_of_run(place)).collect();
    let mut closed = draws(&predictor, &rows, search, shown);
    closed.sort_by(f64::total_cmp);
    let at_risk = closed.partition_point(|closed| *closed < -WORSE) as f64;
    if closed.is_empty() || at_risk > RISK * closed.len() as f64 {
        return ExpectedImprovement::default();
    }
    let quantile = |q: f64| closed[(q * (closed.len() - 1) as f64).round() as usize];
    let fraction = quantile(0.5);
    if fraction <= 0.0 {
        return ExpectedImprovement::default();
    }
    ExpectedImprovement {
        fraction,
        interval: [quantile(0.05).max(0.0), quantile(0.95)],
    }
}

/// What `shown` closes, drawn from what may be true.
fn draws(predictor: &CampaignModel, rows: &[usize], search: &Search, shown: &Fit) -> Vec<f64> {
    let refit = Forecast::new(predictor, &search.null);
    let with = Forecast::new(predictor, shown);
    let mut credible: Vec<&Hypothesis> = credible_set(search);
    // That nothing acts may still hold.
    credible.extend(search.hypotheses.iter().find(|h| h.fit.members.is_empty()));
    let total: f64 = credible.iter().map(|h| h.probability).sum();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut closed = Vec::with_capacity(DRAWS);
    for hypothesis in credible {
        let fit = &hypothesis.fit;
        let says = Forecast::new(predictor, fit);
        let unknowns = fit.columns.len();
        let Some(spread) = Cholesky::new(fit.covariance.clone(), unknowns) else {
            continue;
        };
        let draws = (hypothesis.probability / total * DRAWS as f64).round() as usize;
        for _ in 0..draws {
            let mut off: Vec<f64> = (0..unknowns)
                .map(|_| random.sample(StandardNormal))
                .collect();
            spread.times(&mut off);
            let (mut left, mut before) = (0.0, 0.0);
            for _ in 0..LIST {
                let row = rows[random.random_range(0..rows.len())];
                let of_record: f64 = random.sample(StandardNormal);
                let truth_g = says.vre_g[row]
                    + inner_product(&off, &says.slopes[row])
                    + says.record_g2[row].sqrt() * of_record;
                left += (truth_g - with.vre_g[row]).powi(2);
                before += (truth_g - refit.vre_g[row]).powi(2);
            }
            if before > 0.0 {
                closed.push(1.0 - (left / before).sqrt());
            }
        }
    }
    closed
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
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let drawn = made.iter().zip(1..).map(|(run, n)| {
        let mut alike = made.clone();
        alike.retain(|other| other.kind == run.kind);
        let mut pair = |first: &[&'_ Run], second: &[&'_ Run]| {
            let one = random.random_range(0..first.len());
            let other = random.random_range(0..second.len());
            (one, other, random.random::<f64>())
        };
        let (one, other, part) = pair(&alike, &alike);
        let level_g = part * alike[one].level_g + (1.0 - part) * alike[other].level_g;
        // Between two frequencies, so at none that an effect picks out, such as a multiple of the logger's rate.
        let mut elsewhere = alike.clone();
        elsewhere.retain(|other| other.band_hz != run.band_hz);
        let band_hz = match run.kind {
            VibrationKind::Sine if !elsewhere.is_empty() => {
                let (_, other, part) = pair(&alike, &elsewhere);
                [run.band_hz[0].powf(part) * elsewhere[other].band_hz[0].powf(1.0 - part); 2]
            }
            VibrationKind::Sine | VibrationKind::Random => run.band_hz,
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
