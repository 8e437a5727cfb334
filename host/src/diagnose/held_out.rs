//! How far the gap shrinks on runs that were not used: cross-validation over blocks of conditions.

use inference::fit::Fit;
use inference::model::SeparableModel;
use inference::search::Search;
use shared::model::NOMINAL;

use super::answer::Shrink;
use super::improvement::expected_improvement;
use crate::campaign::Campaign;
use crate::campaign_model::CampaignModel;
use crate::refit::held_out_errors;

/// Cross-validates a fit against the nominal model; `None` without runs.
pub(super) fn shrink(
    campaign: &Campaign,
    model: &CampaignModel,
    search: &Search,
    shown: &Fit,
) -> Option<Shrink> {
    let statics = model.from_static_readings()?;
    let refit = held_out_errors(model, &search.null)?;
    let with_effects = held_out_errors(model, shown)?;
    if refit.is_empty() {
        return None;
    }
    let columns = &model.base().columns;
    let observed = &model.observations().observed().values;
    let by_statics = |run: usize| {
        let predicted = (0..NOMINAL).map(|k| statics[k] * model.vre_g(&columns[k].values, run));
        model.vre_g(observed, run) - predicted.sum::<f64>()
    };
    let rms =
        |squares: &mut dyn Iterator<Item = f64>| (squares.sum::<f64>() / refit.len() as f64).sqrt();
    let improvement = expected_improvement(campaign, model, search, shown);
    Some(Shrink {
        held_out_rms_static_only_g: rms(&mut refit
            .iter()
            .map(|(run, ..)| by_statics(*run).powi(2))),
        held_out_rms_refit_g: rms(&mut refit.iter().map(|(_, error, _)| error * error)),
        held_out_rms_with_effects_g: rms(&mut with_effects
            .iter()
            .map(|(_, error, _)| error * error)),
        noise_floor_rms_g: rms(&mut with_effects.iter().map(|(.., floor)| *floor)),
        closed_fraction: improvement.fraction,
        closed_fraction_interval_90: improvement.interval,
    })
}
