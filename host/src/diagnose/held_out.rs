//! How far the gap shrinks on runs that were not used: cross-validation over blocks of conditions.

use inference::fit::Fit;
use inference::held_out::held_out;
use inference::model::SeparableModel;
use inference::search::Search;
use shared::model::NOMINAL;

use super::answer::Shrink;
use super::improvement::expected_improvement;
use crate::campaign::Campaign;
use crate::campaign_model::CampaignModel;
use crate::forward::contribution::Observable;

/// Observables of a run that are held out with it.
const HELD_OUT: [Observable; 6] = [
    Observable::Before,
    Observable::During,
    Observable::After,
    Observable::Drift,
    Observable::Maximum,
    Observable::Minimum,
];

/// Sums over runs of squared errors, g^2.
#[derive(Default)]
struct Squares {
    statics: f64,
    refit: f64,
    with_effects: f64,
    floor: f64,
}

/// Cross-validates a fit against the nominal model; `None` without runs.
pub(super) fn shrink(
    campaign: &Campaign,
    model: &CampaignModel,
    search: &Search,
    shown: &Fit,
) -> Option<Shrink> {
    let folds = folds(model);
    let made: usize = folds.iter().map(Vec::len).sum();
    if made == 0 {
        return None;
    }
    let statics = model.from_static_readings()?;
    let mut sums = Squares::default();
    for fold in &folds {
        add_fold(model, search, shown, &statics, fold, &mut sums)?;
    }
    let rms = |sum: f64| (sum / made as f64).sqrt();
    let improvement = expected_improvement(campaign, model, search, shown);
    Some(Shrink {
        held_out_rms_static_only_g: rms(sums.statics),
        held_out_rms_refit_g: rms(sums.refit),
        held_out_rms_with_effects_g: rms(sums.with_effects),
        noise_floor_rms_g: rms(sums.floor),
        closed_fraction: improvement.fraction,
        closed_fraction_interval_90: improvement.interval,
    })
}

/// The runs that were made, by kind, band and gravity along IA.
fn folds(model: &CampaignModel) -> Vec<Vec<usize>> {
    let runs = &model.conditions().runs;
    let mut folds: Vec<Vec<usize>> = Vec::new();
    let (observations, during) = (model.observations(), model.rows(Observable::During));
    let used = |row: usize| runs[row].made && observations.weight(during.start + row) > 0.0;
    for (row, run) in runs.iter().enumerate().filter(|(row, _)| used(*row)) {
        let key = (run.kind, run.band_hz, run.specific_force_g.i);
        let alike = |fold: &&mut Vec<usize>| {
            let first = &runs[fold[0]];
            (first.kind, first.band_hz, first.specific_force_g.i) == key
        };
        match folds.iter_mut().find(alike) {
            Some(fold) => fold.push(row),
            None => folds.push(vec![row]),
        }
    }
    folds
}

fn add_fold(
    model: &CampaignModel,
    search: &Search,
    shown: &Fit,
    statics: &[f64],
    fold: &[usize],
    sums: &mut Squares,
) -> Option<()> {
    let rows_of = |&run: &usize| HELD_OUT.map(|observable| model.rows(observable).start + run);
    let left_out: Vec<usize> = fold.iter().flat_map(rows_of).collect();
    let differences: Vec<(usize, usize)> = fold.iter().map(|&run| model.vre_rows(run)).collect();
    let square = |fit: &Fit| {
        let errors = held_out(model, fit, &left_out, &differences)?;
        Some(errors.iter().map(|error| error * error).sum::<f64>())
    };
    sums.refit += square(&search.null)?;
    sums.with_effects += square(shown)?;
    let observations = model.observations();
    for &run in fold {
        let columns = &model.base().columns;
        let predicted = (0..NOMINAL)
            .map(|k| statics[k] * model.vre_g(&columns[k].values, run))
            .sum::<f64>();
        let observed = model.vre_g(&observations.observed().values, run);
        sums.statics += (observed - predicted).powi(2);
        let (during, before) = model.vre_rows(run);
        let [during, before] = [during, before].map(|row| observations.weight(row).powi(-2));
        sums.floor += before + during / shown.precision_factor[run];
    }
    Some(())
}
