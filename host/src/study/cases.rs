//! The campaigns of a study: what acts in them, and how visibly.

use serde::Serialize;

use super::visibility::strength_for;
use crate::bench::effects;
use crate::bench::noise::Seed;
use crate::bench::plan::Static;
use crate::bench::simulate::{Simulation, Specification, VirtualBench};
use crate::effects as catalogue;

/// Visibilities at which single effects are tried.
pub(super) const VISIBILITIES: [f64; 2] = [300.0, 30.0];
/// Visibility of each of two effects at once, and of effects that the catalogue lacks.
const PAIR_VISIBILITY: f64 = 150.0;
const STRANGE_VISIBILITY: f64 = 150.0;

/// What a campaign of the study is about.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// One effect of the catalogue.
    Single,
    /// No effect.
    Nothing,
    /// No effect, on the paper's plan with a head of +-10 arcsec.
    NothingPaperPlan,
    /// An effect that the catalogue does not hold.
    OutsideCatalogue,
    /// An effect taken out of the catalogue.
    Withheld,
    /// Two effects.
    Pair,
}

/// One campaign of the study.
#[derive(Clone, Debug)]
pub(super) struct Case {
    pub(super) kind: Kind,
    pub(super) effects: Vec<&'static str>,
    pub(super) visibility: f64,
    /// Shaker runs that are made, of the plan's 96 in their random order.
    pub(super) runs: usize,
}

/// The round of cases that a study goes through.
pub(super) fn cases(without: &[String], runs: usize) -> Vec<Case> {
    let known: Vec<&'static str> = catalogue::catalogue()
        .map(|effect| effect.id)
        .filter(|id| effects::find(id).is_some() && !without.iter().any(|w| w == id))
        .collect();
    let mut cases = Vec::new();
    for (k, id) in known.iter().enumerate() {
        for visibility in VISIBILITIES {
            cases.push(Case {
                kind: Kind::Single,
                effects: vec![id],
                visibility,
                runs,
            });
        }
        // Each effect once with one some way down the list.
        let partner = known[(k + 7) % known.len()];
        cases.push(Case {
            kind: Kind::Pair,
            effects: vec![id, partner],
            visibility: PAIR_VISIBILITY,
            runs,
        });
        cases.push(Case {
            kind: Kind::Withheld,
            effects: vec![id],
            visibility: STRANGE_VISIBILITY,
            runs,
        });
        let kind = if k % 2 == 0 {
            Kind::Nothing
        } else {
            Kind::NothingPaperPlan
        };
        cases.push(Case {
            kind,
            effects: Vec::new(),
            visibility: 0.0,
            runs,
        });
    }
    for entry in effects::catalogue().filter(|entry| catalogue::find(entry.id).is_none()) {
        for visibility in VISIBILITIES {
            cases.push(Case {
                kind: Kind::OutsideCatalogue,
                effects: vec![entry.id],
                visibility,
                runs,
            });
        }
    }
    cases
}

pub(super) fn simulate(case: &Case, seed: Seed, strengths: &[f64]) -> Simulation {
    let (plan, dial_sigma_arcsec) = match case.kind {
        Kind::NothingPaperPlan => (Static::Paper, 10.0),
        _ => (Static::Default, 1.0),
    };
    let drawn = case
        .effects
        .iter()
        .zip(strengths)
        .enumerate()
        .filter_map(|(k, (id, strength))| {
            let mut stream = seed.stream("effect", k as u64);
            effects::find(id)
                .filter(|_| *strength > 0.0)
                .map(|entry| (entry.draw)(*strength, &mut stream))
        });
    let specification = Specification::with_dial_sigma(dial_sigma_arcsec);
    let mut simulation = VirtualBench::new(seed, plan, specification, drawn.collect()).simulate();
    simulation.campaign.runs.truncate(case.runs);
    simulation
}

/// Strengths that give each effect alone the visibility asked for; `None` if an effect cannot be seen so well.
pub(super) fn strengths(case: &Case, seed: Seed) -> Option<Vec<f64>> {
    let none = vec![0.0; case.effects.len()];
    let bare = simulate(case, seed, &none).campaign;
    let of = |k: usize| {
        strength_for(case.visibility, &bare, |strength| {
            let mut strengths = none.clone();
            strengths[k] = strength;
            simulate(case, seed, &strengths).campaign
        })
    };
    (0..case.effects.len()).map(of).collect()
}
