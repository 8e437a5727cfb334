//! Which gap a campaign could have shown.

use inference::adequacy::leverages;
use inference::fit::Fit;
use inference::model::SeparableModel;

use super::answer::Sight;
use crate::campaign_model::CampaignModel;
use crate::forward::contribution::Observable;

/// Distance from nothing, in standard deviations, from which on a gap is seen: what the prior of some thirty effects and of one's
/// parameters costs, a drop of chi-square of some 25.
const SEEN: f64 = 5.0;

/// What the runs of a fit without effects could have shown: a gap in proportion to each run's vibration error, less the part that the
/// unknowns of the fit take up. `None` without a run.
pub(super) fn sight(model: &CampaignModel, null: &Fit) -> Option<Sight> {
    let observations = model.observations();
    let observed = observations.observed().to_vec();
    let leverage = leverages(model, null);
    let during = model.rows(Observable::During);
    let rows = during.enumerate();
    let made = rows.filter(|(_, row)| observations.weight(*row) > 0.0);
    // Of a run: the squares of its vibration error in units of its free uncertainty, and in g^2.
    let squares = made.map(|(run, row)| {
        let vre_g = model.vre_g(&observed, run);
        let (_, before) = model.vre_rows(run);
        let variance = observations.weight(row).powi(-2) / null.precision_factor[run]
            + observations.weight(before).powi(-2);
        let free = (1.0 - leverage[row]).max(0.0);
        (free * vre_g * vre_g / variance, vre_g * vre_g)
    });
    let squares: Vec<(f64, f64)> = squares.filter(|s| s.0.is_finite()).collect();
    if squares.is_empty() {
        return None;
    }
    let (seen, whole) = squares
        .iter()
        .fold((0.0, 0.0), |sum, s| (sum.0 + s.0, sum.1 + s.1));
    let share_of_vre = SEEN / f64::sqrt(seen.max(f64::MIN_POSITIVE));
    (share_of_vre < MOST).then_some(Sight {
        share_of_vre,
        rms_g: share_of_vre * (whole / squares.len() as f64).sqrt(),
    })
}

/// A share beyond which a figure says nothing.
const MOST: f64 = 1e3;
