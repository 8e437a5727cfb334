//! One campaign with an imperfection, read from its files as a command reads it, diagnosed and held against the truth.

use std::path::Path;

use serde::Serialize;

use super::Case;
use super::told::{named_rows, told};
use crate::bench::effects;
use crate::bench::imperfections;
use crate::bench::noise::Seed;
use crate::bench::plan::Static;
use crate::bench::simulate::{Simulation, Specification, VirtualBench};
use crate::campaign::Campaign;
use crate::contradictions;
use crate::diagnose::{Diagnosis, Verdict, diagnose};
use crate::effects as catalogue;
use crate::error::Error;
use crate::study::visibility::strength_for;

/// How an answer turned out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Answer {
    /// What acts is named alone; nothing is named where nothing acts.
    Right,
    /// What acts is in the named class.
    InClass,
    /// Something else, or something more, is named.
    Wrong,
    /// Nothing is named though something acts.
    Missed,
    /// Called unexplained.
    Unexplained,
    /// Refused before a diagnosis, with one line that says why.
    Refused,
}

/// One campaign.
#[derive(Clone, Debug, Serialize)]
pub struct ImperfectOutcome {
    /// Its number in the study.
    pub campaign: u64,
    /// Seed of its bench.
    pub seed: u64,
    /// What the laboratory does; none on the bench as stated.
    pub imperfection: Option<&'static str>,
    /// Its size, if it has one.
    pub size: Option<f64>,
    /// The effect that acts, if one does.
    pub effect: Option<&'static str>,
    /// Its visibility on the bench as stated, and the strength that has it.
    pub visibility: Option<f64>,
    /// Strength by which the bench makes it so visible.
    pub strength: Option<f64>,
    /// How the answer turned out.
    pub answer: Answer,
    /// Effects named.
    pub named: Vec<String>,
    /// Probability of what is named, if effects are.
    pub probability: Option<f64>,
    /// Whether the imperfection itself is told; `None` where there is nothing to tell.
    pub told: Option<bool>,
    /// Rows that do not belong, by the truth: those that an imperfection of single rows touches.
    pub rows: Vec<String>,
    /// Rows that the answer names.
    pub named_rows: Vec<String>,
    /// The line of a refusal.
    pub refusal: Option<String>,
}

/// An effect of a certain strength.
type Acting = (&'static str, f64);

/// Effects that are tried, in a random order, until one can be made so visible.
const TRIED: usize = 6;

/// The campaign of that number; `None` if no effect can be made so visible in it.
pub(super) fn try_case(
    case: &Case,
    number: u64,
    seed: u64,
    without: &[String],
) -> Result<Option<ImperfectOutcome>, Error> {
    let seed = Seed(
        seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)
            .wrapping_add(number),
    );
    let acting = match case.visibility {
        None => None,
        Some(visibility) => match visible(visibility, seed, without) {
            None => return Ok(None),
            acting => acting,
        },
    };
    let imperfections = Vec::from_iter(case.imperfection);
    let simulation = imperfections::simulate(bench(seed, acting), &imperfections);
    let folder = tempfile::tempdir().map_err(Error::write(&std::env::temp_dir()))?;
    simulation.campaign.write(folder.path())?;
    let mut outcome = ImperfectOutcome {
        campaign: number,
        seed: seed.0,
        imperfection: case.imperfection.map(|one| one.entry.id),
        size: case.imperfection.and_then(|one| one.size),
        effect: acting.map(|(id, _)| id),
        visibility: case.visibility,
        strength: acting.map(|(_, strength)| strength),
        answer: Answer::Refused,
        named: Vec::new(),
        probability: None,
        told: None,
        rows: single_rows(&simulation),
        named_rows: Vec::new(),
        refusal: None,
    };
    let answer = answered(folder.path(), without);
    outcome.told = told(&simulation, &answer);
    match answer {
        Ok((campaign, diagnosis)) => judge(&mut outcome, &campaign, &diagnosis),
        Err(error @ (Error::Input { .. } | Error::Usage(_))) => {
            let folder = folder.path().display().to_string();
            outcome.refusal = Some(error.to_string().replace(&format!("{folder}/"), ""));
        }
        Err(error) => return Err(error),
    }
    Ok(Some(outcome))
}

/// What `vre diagnose` makes of the campaign in `folder`.
fn answered(folder: &Path, without: &[String]) -> Result<(Campaign, Diagnosis), Error> {
    let campaign = Campaign::read(folder)?.used();
    contradictions::check(folder, &campaign, false)?;
    let diagnosis = diagnose(&campaign, without)?.diagnosis;
    Ok((campaign, diagnosis))
}

fn bench(seed: Seed, acting: Option<Acting>) -> VirtualBench {
    let drawn = acting.and_then(|(id, strength)| {
        let mut stream = seed.stream("effect", 0);
        effects::find(id).map(|entry| (entry.draw)(strength, &mut stream))
    });
    let specification = Specification::with_dial_sigma(1.0);
    VirtualBench::new(seed, Static::Default, specification, Vec::from_iter(drawn))
}

/// An effect of the catalogue with the strength that makes it so visible on the bench as stated.
fn visible(visibility: f64, seed: Seed, without: &[String]) -> Option<Acting> {
    let known = catalogue::catalogue().map(|effect| effect.id);
    let known = known.filter(|id| effects::find(id).is_some() && !without.iter().any(|w| w == id));
    let mut ids: Vec<&'static str> = known.collect();
    seed.stream("which effect", 0).shuffle(&mut ids);
    let bare = bench(seed, None).simulate().campaign;
    ids.into_iter().take(TRIED).find_map(|id| {
        let with = |strength| bench(seed, Some((id, strength))).simulate().campaign;
        Some((id, strength_for(visibility, &bare, with)?))
    })
}

/// Rows of an imperfection that touches single ones.
fn single_rows(simulation: &Simulation) -> Vec<String> {
    let all = simulation.truth.imperfections.iter();
    let rows = all.flat_map(|one| &one.rows);
    rows.filter(|row| row.contains(':')).cloned().collect()
}

fn judge(outcome: &mut ImperfectOutcome, campaign: &Campaign, diagnosis: &Diagnosis) {
    outcome.named_rows = named_rows(campaign, diagnosis);
    let best = diagnosis.which.first();
    let names = matches!(diagnosis.verdict, Verdict::Explained | Verdict::Ambiguous);
    if let Some(best) = best.filter(|best| names && !best.effects.is_empty()) {
        outcome.named = best.effects.clone();
        outcome.named.sort();
        outcome.probability = Some(best.probability);
    }
    let acts = |set: &[String]| set.iter().map(String::as_str).eq(outcome.effect);
    let class = best.map_or(&[][..], |best| &best.indistinguishable_from);
    let in_class = diagnosis.verdict == Verdict::Ambiguous
        && class.iter().any(|set| Some(set.as_str()) == outcome.effect);
    outcome.answer = match diagnosis.verdict {
        Verdict::Unexplained => Answer::Unexplained,
        _ if acts(&outcome.named) => Answer::Right,
        _ if outcome.named.is_empty() => Answer::Missed,
        _ if in_class => Answer::InClass,
        _ => Answer::Wrong,
    };
}
