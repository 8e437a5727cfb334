//! A parameter over its range, where the likelihood's curvature at the fit says little.

use crate::fit::{ALONG, Fit, best_at_step, fit_some, nonlinear};
use crate::linear::Weighing;
use crate::model::SeparableModel;
use crate::prior::Prior;

/// Standard deviation, as a part of its range, from which on a parameter is followed over all of that.
const WIDE: f64 = 0.03;
/// Parts of that range.
const FOLLOWED: usize = 16;
/// Rise of -2 log likelihood at which a value is out of the question.
const BEYOND: f64 = 25.0;

/// A part of a parameter's range.
struct Part {
    value: f64,
    /// Width over which nothing is known, and prior weight.
    width: f64,
    weight: f64,
    /// -2 log likelihood.
    score: f64,
}

/// Whether parameter `k` of member `m` is known over a part of its range only roughly, or by steps.
pub fn is_wide(model: &dyn SeparableModel, fit: &Fit, m: usize, k: usize) -> bool {
    let prior = model.components()[fit.members[m].component].parameters[k].prior;
    match (prior, prior.range(), fit.unknown(m, k)) {
        (Prior::Nonlinear { .. }, Some((from, to)), Some(i)) => {
            fit.covariance(i, i).sqrt() > WIDE * (to - from)
        }
        (Prior::Threshold { .. }, ..) => true,
        _ => false,
    }
}

/// Mean and standard deviation of a parameter over its range, by the likelihood at parts of it: as far from the fit as it
/// may be without a gap, the other parameters fitted to each part. A threshold is followed over all of its range, made up
/// for by the component's first nonlinear parameter alone.
pub fn over_its_range(model: &dyn SeparableModel, fit: &Fit, m: usize, k: usize) -> (f64, f64) {
    let member = &fit.members[m];
    let prior = model.components()[member.component].parameters[k].prior;
    match prior {
        Prior::Linear { .. } => (member.values[k], 0.0),
        Prior::Nonlinear { .. } => moments(&parts(model, fit, m, k)),
        Prior::Threshold { from, to, .. } => moments(&steps(model, fit, (m, k), (from, to))),
    }
}

/// From the fit to both ends, as far as the parameter may be.
fn parts(model: &dyn SeparableModel, fit: &Fit, m: usize, k: usize) -> Vec<Part> {
    let prior = model.components()[fit.members[m].component].parameters[k].prior;
    let mut others = nonlinear(model, &fit.members);
    others.retain(|other| *other != (m, k));
    let (mut below, above): (Vec<f64>, Vec<f64>) = prior
        .settings(FOLLOWED)
        .into_iter()
        .partition(|value| *value < fit.members[m].values[k]);
    below.reverse();
    let mut parts = Vec::new();
    for values in [below, above] {
        let mut members = fit.members.clone();
        for value in values {
            members[m].values[k] = value;
            let Some(best) = fit_some(model, members, &others, &fit.precision_factor, 1) else {
                break;
            };
            parts.push(Part {
                value,
                width: 0.0,
                weight: 1.0,
                score: best.objective,
            });
            if best.objective > fit.objective + BEYOND {
                break;
            }
            members = best.members;
        }
    }
    parts
}

fn steps(
    model: &dyn SeparableModel,
    fit: &Fit,
    (m, k): (usize, usize),
    (from, to): (f64, f64),
) -> Vec<Part> {
    let weighing = Weighing::new(model, fit.precision_factor.clone());
    let component = &model.components()[fit.members[m].component];
    let first = component.linear();
    let mut along = component.parameters[first].prior.settings(ALONG);
    along.push(fit.members[m].values[first]);
    let part = |step: (f64, f64)| {
        let best = best_at_step(model, &fit.members, (m, k), step, &along, &weighing);
        let (low, high) = step;
        Some(Part {
            value: 0.5 * (low + high),
            width: high - low,
            weight: high - low,
            score: best?.0,
        })
    };
    let steps = model.threshold_steps(from, to).into_iter();
    steps.filter_map(part).collect()
}

/// Mean and standard deviation under exp(-score/2).
fn moments(parts: &[Part]) -> (f64, f64) {
    let least = parts.iter().map(|p| p.score).fold(f64::INFINITY, f64::min);
    let (mut total, mut mean, mut square) = (0.0, 0.0, 0.0);
    for part in parts {
        let weight = part.weight * (-0.5 * (part.score - least)).exp();
        total += weight;
        mean += weight * part.value;
        square += weight * (part.value.powi(2) + part.width.powi(2) / 12.0);
    }
    let mean = mean / total;
    (mean, (square / total - mean * mean).max(0.0).sqrt())
}
