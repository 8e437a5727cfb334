//! The verdict: nothing, one hypothesis, a class of them, or none that is known.

use inference::fit::Fit;
use inference::remainder::{Remainder, signature};
use inference::search::{Hypothesis, Search};

use super::answer::{Shrink, Similarity, Verdict, Which};
use super::estimates::estimates;
use crate::campaign_model::CampaignModel;

/// Odds against the best hypothesis at which another one no longer stands.
const STANDING_ODDS: f64 = 20.0;
/// Probability from which on a hypothesis explains: below, something that the catalogue lacks may as well.
const EXPLAINS: f64 = 0.8;
/// Most effects, or sets of effects, in a class beside its most probable member.
const CLASS: usize = 2;
/// Hypotheses less probable than this are not listed, and most that are, of a gap that none explains fewer.
const LISTED: f64 = 1e-3;
const MOST_LISTED: usize = 8;
const LISTED_IF_UNEXPLAINED: usize = 3;
/// Chance of the nominal model's misfit above which there is nothing to explain.
const FITS: f64 = 1e-2;
/// Growth of the error on held-out runs with which an effect explains nothing.
const WORSE: f64 = 1.2;
/// Most hypotheses whose likeness is told.
const MOST_COMPARED: usize = 8;

/// What is said of a search.
pub(super) struct Judgement {
    pub(super) verdict: Verdict,
}

impl Judgement {
    /// `shrink` is that of the most probable hypothesis.
    pub(super) fn of(search: &Search, shrink: Option<&Shrink>) -> Self {
        let best = &search.hypotheses[0];
        let null = search.hypotheses.iter().find(|h| h.fit.members.is_empty());
        let null_probability = null.map_or(0.0, |h| h.probability);
        let nothing =
            best.fit.members.is_empty() || best.probability < STANDING_ODDS * null_probability;
        let fits = search.null_adequacy.p_value > FITS;
        let worse = shrink.is_some_and(|shrink| {
            let with = shrink.held_out_rms_with_effects_g;
            with > WORSE * shrink.held_out_rms_refit_g.max(shrink.noise_floor_rms_g)
        });
        let verdict = match (search.unexplained, nothing || fits) {
            (true, _) => Verdict::Unexplained,
            (false, false) if worse => Verdict::Unexplained,
            (false, true) => Verdict::NoGap,
            (false, false) if credible_set(search).len() == 1 && best.probability > EXPLAINS => {
                Verdict::Explained
            }
            (false, false) => Verdict::Ambiguous,
        };
        Self { verdict }
    }

    /// Hypotheses in the order in which they are shown.
    fn ranked<'s>(&self, search: &'s Search) -> Vec<&'s Hypothesis> {
        let mut ranked: Vec<&Hypothesis> = search.hypotheses.iter().collect();
        if self.verdict.sees_none() {
            ranked.sort_by_key(|h| !h.fit.members.is_empty());
        }
        ranked
    }

    /// The fit that is shown first.
    pub(super) fn shown<'s>(&self, search: &'s Search) -> &'s Fit {
        &self.ranked(search)[0].fit
    }

    /// The hypotheses that are listed.
    pub(super) fn which(&self, model: &CampaignModel, search: &Search) -> Vec<Which> {
        let class: Vec<String> = match self.verdict {
            Verdict::Ambiguous => credible_set(search)[1..]
                .iter()
                .take(CLASS)
                .map(|h| name(model, &h.fit))
                .collect(),
            _ => Vec::new(),
        };
        let most = match self.verdict {
            Verdict::Unexplained => LISTED_IF_UNEXPLAINED,
            _ => MOST_LISTED,
        };
        let ranked = self.ranked(search).into_iter().enumerate();
        ranked
            .filter(|(k, h)| *k == 0 || h.probability >= LISTED)
            .map(|(k, h)| Which {
                effects: ids(model, &h.fit),
                probability: h.probability,
                parameters: estimates(model, &h.fit),
                indistinguishable_from: if k == 0 { class.clone() } else { Vec::new() },
                fitted: h.fit.members.iter().map(|m| m.values.clone()).collect(),
            })
            .take(most)
            .collect()
    }
}

/// Hypotheses that the data leave standing, best first.
pub(super) fn credible_set(search: &Search) -> Vec<&Hypothesis> {
    let best = search.hypotheses[0].probability;
    let stands =
        |h: &&Hypothesis| h.probability * STANDING_ODDS > best && !h.fit.members.is_empty();
    search.hypotheses.iter().filter(stands).collect()
}

/// Effects of a fit.
pub(super) fn ids(model: &CampaignModel, fit: &Fit) -> Vec<String> {
    fit.members
        .iter()
        .map(|m| model.effect(m).id.into())
        .collect()
}

/// Effects of a fit joined by `+`.
pub(super) fn name(model: &CampaignModel, fit: &Fit) -> String {
    let names = ids(model, fit);
    if names.is_empty() {
        "none".into()
    } else {
        names.join("+")
    }
}

/// Which hypotheses look alike beyond what the nominal model can imitate; none without effects.
pub(super) fn similarity(model: &CampaignModel, search: &Search) -> Option<Similarity> {
    let acting = search
        .hypotheses
        .iter()
        .filter(|h| !h.fit.members.is_empty());
    let shown: Vec<&Hypothesis> = acting.take(MOST_COMPARED).collect();
    if shown.is_empty() {
        return None;
    }
    let signatures: Vec<_> = shown.iter().map(|h| signature(model, &h.fit)).collect();
    let references: Vec<_> = signatures.iter().collect();
    Some(Similarity {
        hypotheses: shown.iter().map(|h| name(model, &h.fit)).collect(),
        correlation: Remainder::new(model, &search.null).similarity(&references),
    })
}
