//! Components that add variance to the uncertain rows: their size, from what a fit leaves.

use crate::fit::{Fit, fit};
use crate::model::{Kind, Member, SeparableModel};
use crate::prior::Prior;

/// Steps of the logarithm over a size's range.
const STEPS: i32 = 200;
/// Rounds of size and fit in turn.
const ROUNDS: usize = 3;

/// Fits members from their values; the size of one that adds variance is found anew after each fit.
pub fn fit_with_size(
    model: &dyn SeparableModel,
    members: Vec<Member>,
    precision_factor: &[f64],
) -> Option<Fit> {
    let adds = |m: &Member| model.components()[m.component].kind == Kind::AddsVariance;
    let adding = members.iter().position(adds);
    let mut found = fit(model, members, precision_factor, 2)?;
    if let Some(index) = adding {
        for _ in 0..ROUNDS {
            let mut members = found.members.clone();
            members[index].values[0] = best_size(model, &found, index);
            found = fit(model, members, &found.precision_factor, 2)?;
        }
    }
    Some(found)
}

/// What a component of size 1 would add to the variance of each row that it touches, in units of what a fit has there: row
/// and variance.
pub(crate) fn unit(model: &dyn SeparableModel, base: &Fit, component: usize) -> Vec<(usize, f64)> {
    let rows = model.observations().uncertain();
    let variances = model.unit_variance(component).into_iter();
    let units = rows.zip(variances).zip(&base.precision_factor);
    units
        .map(|((row, variance), factor)| (row, variance * factor))
        .filter(|(_, unit)| *unit > 0.0)
        .collect()
}

/// Drop of -2 log likelihood by added variance of that size, at a fit's residuals; `unit` is that of size 1.
pub(crate) fn gain(base: &Fit, unit: &[(usize, f64)], size: f64) -> f64 {
    let gain = unit.iter().map(|&(row, unit)| {
        let added = size * size * unit;
        base.residuals[row].powi(2) * added / (1.0 + added) - added.ln_1p()
    });
    gain.sum()
}

/// The most likely size of a member that adds variance, at a fit's residuals without it.
fn best_size(model: &dyn SeparableModel, found: &Fit, index: usize) -> f64 {
    let mut bare = found.clone();
    let member = bare.members.remove(index);
    let first = model.observations().uncertain().start;
    for (row, added) in unit(model, found, member.component) {
        // In units of the variance with the addition: what is left without it, the stated one at least.
        let factor = &mut bare.precision_factor[row - first];
        let left = (1.0 - member.values[0].powi(2) * added).max(*factor);
        bare.residuals[row] /= left.sqrt();
        *factor /= left;
    }
    let unit = unit(model, &bare, member.component);
    let parameter = &model.components()[member.component].parameters[0];
    let Prior::Nonlinear { from, to, .. } = parameter.prior else {
        return member.values[0];
    };
    let at = |step: i32| from * (to / from).powf(f64::from(step) / f64::from(STEPS));
    (0..=STEPS)
        .map(at)
        .max_by(|a, b| gain(&bare, &unit, *a).total_cmp(&gain(&bare, &unit, *b)))
        .unwrap_or(from)
}

/// Size of a member that adds variance, with its standard deviation: each row whose added variance stands out tells the
/// logarithm of the size to 1/sqrt 2.
pub fn size(model: &dyn SeparableModel, found: &Fit, index: usize) -> (f64, f64) {
    let member = &found.members[index];
    let value = member.values[0];
    if model.components()[member.component].kind != Kind::AddsVariance {
        return (value, 0.0);
    }
    let variances = model.unit_variance(member.component).into_iter();
    let telling: f64 = variances
        .map(|unit| {
            let added = value * value * unit;
            (added / (1.0 + added)).powi(2)
        })
        .sum();
    (value, value / (2.0 * telling.max(0.1)).sqrt())
}
