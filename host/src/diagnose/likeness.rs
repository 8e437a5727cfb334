//! What an unexplained gap is like: the best set of effects, and what its fit leaves where.
//!
//! An effect whose real form is not quite the catalogue's (a loop of second order, a resonance of two modes) makes most of its
//! gap all the same. It is no explanation, but it tells where to look.

use inference::adequacy::adequacy;
use inference::search::Search;

use super::answer::Likeness;
use super::location;
use super::verdict::ids;
use crate::campaign_model::CampaignModel;

/// Least share of the gap's chi-square, beyond its expectation, with which effects are called alike: half is chosen.
const ALIKE: f64 = 0.5;

/// `None` where the best set of effects is none, or makes less than [`ALIKE`] of the gap.
pub(super) fn likeness(model: &CampaignModel, search: &Search) -> Option<Likeness> {
    let acting = search
        .hypotheses
        .iter()
        .find(|h| !h.fit.members.is_empty())?;
    let (of_gap, freedom) = search.null_adequacy.total();
    let (left, left_freedom) = adequacy(model, &acting.fit, &[]).total();
    let excess = (of_gap - freedom).max(0.0);
    let share_of_gap = (1.0 - (left - left_freedom).max(0.0) / excess).clamp(0.0, 1.0);
    if excess == 0.0 || share_of_gap < ALIKE {
        return None;
    }
    let squares: Vec<f64> = acting.fit.residuals.iter().map(|z| z * z - 1.0).collect();
    Some(Likeness {
        effects: ids(model, &acting.fit),
        share_of_gap,
        leaves_rms_over_noise: (left / left_freedom.max(1.0)).sqrt(),
        leaves_in: location::conditions(model, &squares),
    })
}
