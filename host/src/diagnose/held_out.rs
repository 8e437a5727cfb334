//! How far the gap shrinks on runs that were not used: cross-validation over blocks of conditions.
//!
//! A block is taken away from a fit along its tangent. Where one block holds what determines a parameter (the runs that come
//! near a limit), the tangent leads anywhere: a block that the effects miss by more than the nominal model does is fitted anew.

use inference::fit::Fit;
use inference::model::SeparableModel;

use super::answer::Shrink;
use super::improvement::expected_improvement;
use super::settle::Settled;
use crate::campaign::Campaign;
use crate::prediction::sensitivity;
use crate::refit::{errors_of_refit, held_out_errors};
use crate::statics::fit_determined;

/// Cross-validates a fit against the nominal model; `None` without runs.
pub(super) fn shrink(campaign: &Campaign, settled: &Settled, shown: &Fit) -> Option<Shrink> {
    let Settled { model, search, .. } = settled;
    let belonging = settled.assumptions.applied_to_readings(campaign);
    let (statics, _) = fit_determined(&belonging, None).ok()?;
    let refit = held_out_errors(model, &search.null)?;
    if refit.is_empty() {
        return None;
    }
    let with_effects = errors_with_effects(campaign, settled, shown, &refit)?;
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

/// Row, error (g) and variance of the noise (g^2) of each run by the fit with effects, in the order of `refit`, which holds
/// those of the nominal model.
fn errors_with_effects(
    campaign: &Campaign,
    settled: &Settled,
    shown: &Fit,
    refit: &[(usize, f64, f64)],
) -> Option<Vec<(usize, f64, f64)>> {
    let Settled { model, .. } = settled;
    let mut errors = held_out_errors(model, shown)?;
    let square = |errors: &[(usize, f64, f64)]| errors.iter().map(|e| e.1 * e.1).sum::<f64>();
    let mut first = 0;
    for block in model.blocks() {
        let here = first..first + block.len();
        first = here.end;
        let noise: f64 = errors[here.clone()].iter().map(|e| e.2).sum();
        let nominal = square(&refit[here.clone()]).max(noise);
        if shown.members.is_empty() || square(&errors[here.clone()]) <= TANGENT_FAILS * nominal {
            continue;
        }
        let anew = errors_of_refit(campaign, &settled.assumptions, model, shown, &block);
        for (error, anew) in errors[here].iter_mut().zip(anew.into_iter().flatten()) {
            error.1 = anew;
        }
    }
    Some(errors)
}

/// Squared errors over those of the nominal model, or the noise, from which on a block is fitted anew: four is chosen.
const TANGENT_FAILS: f64 = 4.0;
