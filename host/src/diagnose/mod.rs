//! Where the gap between prediction and shaker lies, which effect causes it, how far it shrinks.
//!
//! ```text
//! campaign -> campaign model -> search (all hypotheses) -> verdict -> answer
//!                 location, held-out errors, improvement, next tests, on board -/
//! ```
//!
//! Nominal coefficients, dial, mount and level errors and the effects are estimated jointly: an effect also bends the
//! static identification, so that residuals of a fit without it would mislead.

pub mod answer;
mod estimates;
mod held_out;
mod identification;
mod improvement;
mod likeness;
mod location;
mod next_tests;
mod onboard;
mod proposals;
mod reach;
mod remarks;
mod rereading;
mod rows;
mod settle;
mod sight;
mod static_test;
mod verdict;

pub use answer::{Compensation, Diagnosis, Verdict};
pub use onboard::WHY_NOT_CARRIED;
pub use rows::GapRow;
pub use static_test::{Identified, StaticTest, static_test};

use inference::search::SearchPolicy;

use crate::campaign::Campaign;
use crate::contradictions::{Contradiction, contradictions};
use crate::effects::{self, Effect};
use crate::error::Error;
use settle::{Settled, settle};
use verdict::Judgement;

/// A diagnosis with the rows that pictures of it need.
pub struct Study {
    /// The answer.
    pub diagnosis: Diagnosis,
    /// Every run that was made, in the order of time.
    pub rows: Vec<GapRow>,
}

/// Diagnoses a campaign with the effects of the catalogue but those `without`.
///
/// # Errors
/// An unknown identifier in `without`, or a campaign that determines nothing.
pub fn diagnose(campaign: &Campaign, without: &[String]) -> Result<Study, Error> {
    let effects = effects_but(without)?;
    let undetermined = || Error::Usage("the campaign does not determine the nominal model".into());
    let mut settled = settle(campaign, &effects).ok_or_else(undetermined)?;
    let slip = rereading::rereading(campaign, &settled);
    if slip.is_some() {
        settled.search.leave_unexplained(&SearchPolicy::default());
    }
    let best = &settled.search.hypotheses[0].fit;
    let shrink = held_out::shrink(campaign, &settled, best);
    let mut judgement = Judgement::of(&settled.search, shrink.as_ref());
    let sight = (judgement.verdict == Verdict::NoGap)
        .then(|| sight::sight(&settled.model, &settled.search.null));
    if sight.is_some_and(|sight| !sight.is_some_and(|sight| sight.suffices())) {
        judgement.verdict = Verdict::CannotTell;
    }
    Ok(Study {
        rows: rows::rows(&settled.model, judgement.shown(&settled.search)),
        diagnosis: answer(
            campaign,
            &settled,
            &judgement,
            shrink,
            sight.flatten(),
            slip.into_iter().chain(contradictions(campaign)).collect(),
        ),
    })
}

fn effects_but(without: &[String]) -> Result<Vec<&'static Effect>, Error> {
    if let Some(unknown) = without.iter().find(|id| effects::find(id).is_none()) {
        let known: Vec<&str> = effects::catalogue().map(|effect| effect.id).collect();
        return Err(Error::Usage(format!(
            "--without {unknown}: no effect of the catalogue ({})",
            known.join(", ")
        )));
    }
    let kept = |effect: &&Effect| !without.iter().any(|id| id == effect.id);
    Ok(effects::catalogue().filter(kept).collect())
}

fn answer(
    campaign: &Campaign,
    settled: &Settled,
    judgement: &Judgement,
    shrink_of_best: Option<answer::Shrink>,
    sight: Option<answer::Sight>,
    contradictions: Vec<Contradiction>,
) -> Diagnosis {
    let Settled { model, search, .. } = settled;
    let shown = judgement.shown(search);
    let verdict = judgement.verdict;
    // Where nothing is what is shown, it is held out instead.
    let shrink = match std::ptr::eq(shown, &search.hypotheses[0].fit) {
        true => shrink_of_best,
        false => held_out::shrink(campaign, settled, shown),
    };
    let shrink = shrink.map(|shrink| shrink.under(verdict));
    Diagnosis {
        format: answer::FORMAT.into(),
        serial: campaign.config.instrument.serial.clone(),
        verdict,
        gap: location::gap(model, search),
        location: location::locate(model, search, shown),
        which: judgement.which(model, search),
        shrink,
        next_tests: next_tests::next_tests(campaign, model, search, verdict),
        identification: shrink
            .filter(|_| verdict.sees_none())
            .and_then(|shrink| identification::cause(model, shrink)),
        similarity: verdict::similarity(model, search),
        compensation: (verdict == Verdict::Explained || verdict.sees_none())
            .then(|| onboard::compensation(model, shown)),
        suspects: remarks::suspect_rows(campaign, &settled.suspects, model, shown, &contradictions),
        contradictions,
        noise: settled.noise.iter().map(remarks::noise).collect(),
        sessions: remarks::sessions(model, shown),
        shaker: remarks::shaker(model, shown),
        not_looked_at: location::not_looked_at(campaign),
        sight,
        like: (verdict == Verdict::Unexplained)
            .then(|| likeness::likeness(model, search))
            .flatten(),
    }
}
