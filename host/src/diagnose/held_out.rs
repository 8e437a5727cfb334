//! How far the gap shrinks on runs that were not used: cross-validation over blocks of conditions.

use inference::fit::Fit;
use inference::model::SeparableModel;

use super::answer::Shrink;
use super::improvement::expected_improvement;
use super::settle::Settled;
use crate::campaign::Campaign;
use crate::prediction::sensitivity;
use crate::refit::held_out_errors;
use crate::statics::fit_determined;

/// Cross-validates a fit against the nominal model; `None` without runs.
pub(super) fn shrink(campaign: &Campaign, settled: &Settled, shown: &Fit) -> Option<Shrink> {
    let Settled { model, search, .. } = settled;
    let belonging = settled.assumptions.applied_to_readings(campaign);
    let (statics, _) = fit_determined(&belonging, None).ok()?;
    let refit = held_out_errors(model, &search.null)?;
    let with_effects = held_out_errors(model, shown)?;
    if refit.is_empty() {
        return None;
    }
    let mut run_of_row = vec![0; campaign.runs.len()];
    for place in 0..campaign.runs.len() {
        run_of_row[model.row_of_run(place)] = place;
    }
    let observed = model.observations().observed().to_vec();
    let by_statics = |run: usize| {
        let predicted = sensitivity(&campaign.runs[run_of_row[run]]).vre_g(&statics.coefficients);
        model.vre_g(&observed, run) - predicted
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
