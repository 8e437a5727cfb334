//! Parameters of effects with their standard uncertainty.

use inference::fit::Fit;
use inference::model::Kind;
use inference::model::SeparableModel;
use inference::modes::modes;
use inference::profile::{is_wide, over_its_range};
use inference::search::SearchPolicy;
use inference::variance::size;

use super::answer::ParameterEstimate;
use crate::campaign_model::CampaignModel;
use crate::effects::{Effect, Renamed};

/// What of a fit's parameters is reported. Names that start with an underscore are not.
pub(super) fn estimates(model: &CampaignModel, fit: &Fit) -> Vec<ParameterEstimate> {
    (0..fit.members.len())
        .flat_map(|m| over_modes(model, fit, m))
        .collect()
}

/// Where other places of an effect's parameters do about as well, the uncertainty reaches to them, each by its share.
fn over_modes(model: &CampaignModel, fit: &Fit, m: usize) -> Vec<ParameterEstimate> {
    let mut found = of_member(model, fit, m);
    let modes = modes(model, &SearchPolicy::default(), fit, m);
    let split = modes.split_first();
    let Some((here, others)) = split.filter(|(_, others)| !others.is_empty()) else {
        return found;
    };
    let own = found.iter().map(|p| here.share * p.sigma.powi(2));
    let mut variances: Vec<f64> = own.collect();
    for mode in others {
        let there = of_member(model, &mode.fit, m);
        for ((variance, here), there) in variances.iter_mut().zip(&found).zip(there) {
            let off = there.value - here.value;
            *variance += mode.share * (off * off + there.sigma.powi(2));
        }
    }
    for (parameter, variance) in found.iter_mut().zip(variances) {
        parameter.sigma = variance.sqrt();
    }
    found
}

fn of_member(model: &CampaignModel, fit: &Fit, m: usize) -> Vec<ParameterEstimate> {
    let effect = model.effect(&fit.members[m]);
    let estimate = |name: &str, (value, sigma): (f64, f64)| ParameterEstimate {
        effect: effect.id.into(),
        name: name.into(),
        value,
        sigma,
    };
    if let Some(renamed) = effect.report {
        let found = of_renamed(effect, fit, m, renamed);
        return renamed
            .0
            .iter()
            .zip(found)
            .map(|(name, found)| estimate(name, found))
            .collect();
    }
    let reported = effect.parameters.iter().enumerate();
    let reported = reported.filter(|(_, p)| !p.name.starts_with('_'));
    reported
        .map(|(k, parameter)| estimate(parameter.name, of_parameter(model, fit, m, k)))
        .collect()
}

/// Value and standard uncertainty of parameter `k` of member `m`.
fn of_parameter(model: &CampaignModel, fit: &Fit, m: usize, k: usize) -> (f64, f64) {
    if model.components()[fit.members[m].component].kind == Kind::AddsVariance {
        return size(model, fit, m);
    }
    let value = fit.members[m].values[k];
    let effect = model.effect(&fit.members[m]);
    let at_fit = (value, covariance(effect, fit, m, k, k).max(0.0).sqrt());
    if is_wide(model, fit, m, k) {
        let over_its_range = over_its_range(model, fit, m, k);
        if over_its_range.1 > at_fit.1 {
            return over_its_range;
        }
    }
    at_fit
}

/// Covariance of two parameters of a member; zero of a threshold.
fn covariance(effect: &Effect, fit: &Fit, m: usize, i: usize, j: usize) -> f64 {
    // Derivative of a value by its unknown, which may be the value's logarithm.
    let slope = |k: usize| effect.parameters[k].prior.slope(fit.members[m].values[k]);
    match (fit.unknown(m, i), fit.unknown(m, j)) {
        (Some(a), Some(b)) => fit.covariance(a, b) * slope(i) * slope(j),
        _ => 0.0,
    }
}

/// Parameters by other names: the function of the fitted ones, and its uncertainty to the first order.
fn of_renamed(effect: &Effect, fit: &Fit, m: usize, (_, report): Renamed) -> Vec<(f64, f64)> {
    let values = &fit.members[m].values;
    let reported = report(values);
    let gradients: Vec<Vec<f64>> = (0..values.len())
        .map(|k| {
            let mut moved = values.clone();
            let step = 1e-6 * values[k].abs().max(1e-9);
            moved[k] += step;
            let change = report(&moved).into_iter().zip(&reported);
            change.map(|(a, b)| (a - b) / step).collect()
        })
        .collect();
    let found = reported.iter().enumerate().map(|(r, value)| {
        let mut variance = 0.0;
        for i in 0..values.len() {
            for j in 0..values.len() {
                variance += gradients[i][r] * gradients[j][r] * covariance(effect, fit, m, i, j);
            }
        }
        (*value, variance.max(0.0).sqrt())
    });
    found.collect()
}
