//! Which rows belong, and how far the stated noise holds: first by what a flexible model leaves, then by what the most
//! probable hypothesis leaves, until the two agree.
//!
//! A gross error and an effect may stand in for one another: a narrow resonance looks like a few bad runs. So the search is
//! made with all rows as well, and the two are compared by their evidence; each row that does not belong costs as much as an
//! error of hand is improbable.

use inference::fit::{Fit, fit_base};
use inference::model::SeparableModel;
use inference::search::{Search, SearchPolicy, search};

use crate::campaign::Campaign;
use crate::campaign_model::CampaignModel;
use crate::campaign_model::assumptions::{Assumptions, Noise};
use crate::campaign_model::judge::{Suspect, beforehand, judge, noise, suspects};
use crate::effects::Effect;
use crate::forward::contribution::Observable;

/// Rows up to which an effect may have been found for them alone.
const FEW_ROWS: usize = 3;
/// Most rounds of search and judgement.
const ROUNDS: usize = 3;
/// Prior probability of an error of hand in a row, and the width of such errors in standard deviations (half, of a Cauchy
/// distribution).
const PRIOR_GROSS: f64 = 2e-3;
const GROSS_WIDTH: f64 = 30.0;
/// Standard deviation by which a reading that is set aside counts, over a usual one of a microg.
const EXCLUDED_OVER_STATED: f64 = 1e9;

/// A campaign's model under assumptions that agree with what was found.
pub(super) struct Settled {
    pub(super) model: CampaignModel,
    pub(super) search: Search,
    pub(super) assumptions: Assumptions,
    /// Logarithm of the posterior weight of what was found, up to what all ways to read the tables share.
    pub(super) weight: f64,
    /// Rows that do not belong, with their distance in standard deviations.
    pub(super) suspects: Vec<Suspect>,
    /// Each kind of noise: the factor on its stated size by what the answer leaves, and its relative standard uncertainty.
    pub(super) noise: Vec<(Noise, f64, f64)>,
}

/// Searches a campaign until assumptions and answer agree. `None` if it determines nothing.
pub(super) fn settle(campaign: &Campaign, effects: &[&'static Effect]) -> Option<Settled> {
    let stated = beforehand(campaign)?;
    let mut best = attempt(campaign, effects, stated.clone())?;
    let by_answer = judge(campaign, &best.model, best.fit(), false, &stated);
    let agreed = by_answer.agree(&stated);
    if !agreed || !best.fit().members.is_empty() {
        // Effects may have been found for a few bad rows, or bad rows hidden by effects that are none.
        let plain = CampaignModel::assuming(campaign, &[], effects, &stated);
        let nominal = fit_base(&plain)?;
        let flexible = judge(campaign, &plain, &nominal, true, &stated);
        let few = (1..=FEW_ROWS).contains(&flexible.rows());
        let other = !flexible.agree(&stated) && (few || !agreed);
        // One effect that leaves nothing is what it seems, unless nothing but bad rows does as well.
        let simple = agreed && best.fit().members.len() == 1 && !best.search.unexplained;
        if other && !(simple && nothing_but(campaign, &flexible)? < best.weight) {
            best = better(best, attempt(campaign, effects, flexible)?);
        }
        // Smooth functions of the angle take most of what a dial's marks err by: without them, marks that do all of it show.
        let bare = judge(campaign, &plain, &nominal, false, &stated);
        if bare.factor(Noise::Marks) != 1.0 && nothing_but(campaign, &bare)? > best.weight {
            best = better(best, attempt(campaign, effects, bare)?);
        }
    }
    for _ in 0..ROUNDS {
        let judged = judge(campaign, &best.model, best.fit(), false, &best.assumptions);
        if judged.agree(&best.assumptions) {
            break;
        }
        let next = attempt(campaign, effects, judged)?;
        // A row that belongs after all comes back, whatever that costs.
        let fewer = next.assumptions.rows() < best.assumptions.rows();
        // What stays unexplained is not explained by other noise.
        let futile = best.search.unexplained && next.search.unexplained;
        if !fewer && (futile || next.weight < best.weight) {
            break;
        }
        best = next;
    }
    let Attempt {
        model,
        search,
        assumptions,
        weight,
    } = best;
    let fit = &search.hypotheses[0].fit;
    let suspects = suspects(campaign, &model, fit, &assumptions);
    let noise = noise(campaign, &model, fit, &assumptions);
    Some(Settled {
        model,
        search,
        assumptions,
        weight,
        suspects,
        noise,
    })
}

/// A search under some assumptions.
struct Attempt {
    model: CampaignModel,
    search: Search,
    assumptions: Assumptions,
    /// Logarithm of the posterior weight of what it found, rows that do not belong and factors on the noise included, up to
    /// what all attempts share.
    weight: f64,
}

fn attempt(
    campaign: &Campaign,
    effects: &[&'static Effect],
    assumptions: Assumptions,
) -> Option<Attempt> {
    let mut model = CampaignModel::assuming(campaign, &[], effects, &assumptions);
    let search = search(&mut model, &SearchPolicy::default())?;
    let best = &search.hypotheses[0];
    let of_rows = log_weight_of_rows(campaign, &model, &best.fit, &assumptions);
    Some(Attempt {
        weight: best.log_posterior_weight + of_rows,
        model,
        search,
        assumptions,
    })
}

/// The weight that an attempt under these assumptions has at least: that of no effect.
pub(super) fn nothing_but(campaign: &Campaign, assumptions: &Assumptions) -> Option<f64> {
    let model = CampaignModel::assuming(campaign, &[], &[], assumptions);
    let fit = fit_base(&model)?;
    let of_rows = log_weight_of_rows(campaign, &model, &fit, assumptions);
    Some(SearchPolicy::default().prior_nothing.ln() + fit.log_evidence + of_rows)
}

/// Logarithm of what rows that do not belong and factors on the noise make of a fit's posterior weight, up to what all
/// attempts share.
fn log_weight_of_rows(
    campaign: &Campaign,
    model: &CampaignModel,
    fit: &Fit,
    assumptions: &Assumptions,
) -> f64 {
    // An error of a few tens of standard deviations under its own distribution, against a sound row's. What else was observed
    // of the row would have cost a sound row's half each.
    let improbable = -PRIOR_GROSS.ln() + (GROSS_WIDTH * (std::f64::consts::PI / 2.0).sqrt()).ln();
    let gross = |suspect: Suspect| {
        (suspect.distance / GROSS_WIDTH).powi(2).ln_1p() + 0.5 * suspect.others as f64
    };
    let suspects = suspects(campaign, model, fit, assumptions).into_iter();
    let gross: f64 = suspects.map(gross).sum();
    -improbable * assumptions.rows() as f64 - gross - log_spread(model, assumptions)
}

/// Sum of the logarithms of the standard deviations that the factors on the noise change.
fn log_spread(model: &CampaignModel, assumptions: &Assumptions) -> f64 {
    let rows = |observables: &[Observable]| -> f64 {
        let all = observables.iter().map(|o| model.rows(*o).len());
        all.sum::<usize>() as f64
    };
    let plateaus = rows(&[Observable::Before, Observable::During, Observable::After]);
    let drifts = rows(&[Observable::Drift]);
    // A reading that is set aside counts with the noise that it was stated to have.
    let set_aside = assumptions.excluded_readings.len() as f64 * EXCLUDED_OVER_STATED.ln();
    model.observations().log_spread_of_correlated() - set_aside
        + plateaus * assumptions.factor(Noise::Plateaus).ln()
        + drifts * assumptions.factor(Noise::Drift).ln()
}

impl Attempt {
    fn fit(&self) -> &Fit {
        &self.search.hypotheses[0].fit
    }
}

fn better(one: Attempt, other: Attempt) -> Attempt {
    if other.weight > one.weight {
        other
    } else {
        one
    }
}
