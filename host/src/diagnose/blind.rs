//! The whole study: campaigns whose effect the diagnosis does not know, and how often it finds it.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;

use super::catalogue;
use super::diagnosis::{Diagnosis, Verdict, diagnose};
use super::forecast::{predict_refitted, predict_with_effects};
use super::visibility::strength_for;
use crate::bench::effects;
use crate::bench::noise::Seed;
use crate::bench::plan::Static;
use crate::bench::simulate::{Simulation, Specification, VirtualBench};
use crate::error::Error;
use crate::quantity::Quantity;

/// Visibilities at which single effects are tried.
const VISIBILITIES: [f64; 2] = [300.0, 30.0];
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
struct Case {
    kind: Kind,
    effects: Vec<&'static str>,
    visibility: f64,
}

/// How a diagnosis turned out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Score {
    /// Named; or rightly nothing, or rightly unexplained.
    Right,
    /// In the named class of at most three.
    InClass,
    /// Another name.
    Wrong,
    /// No gap seen.
    Missed,
    /// Called unexplained though the catalogue holds it.
    Unexplained,
}

/// One diagnosed campaign.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Its number in the study.
    pub campaign: u64,
    /// What it is about.
    pub kind: Kind,
    /// What acted.
    pub effects: Vec<String>,
    /// How visible.
    pub visibility: f64,
    /// Strengths by which the bench makes them so visible.
    pub strengths: Vec<f64>,
    /// Seed of its bench.
    pub seed: u64,
    /// How the diagnosis turned out.
    pub score: Score,
    /// What was named.
    pub named: Vec<String>,
    /// Probability of what was named.
    pub probability: f64,
    /// Whether the most probable stage is an acting one's.
    pub stage_right: bool,
    /// Largest error of a parameter in its stated sigmas, if the name is right.
    pub worst_parameter_sigmas: Option<f64>,
    /// Fraction of the gap on hold-out runs above the floor that was closed.
    pub closed: Option<f64>,
    /// What the diagnosis itself says of that.
    pub closed_stated: Option<f64>,
    /// The central 90 % that it states.
    pub closed_interval: Option<[f64; 2]>,
    /// Root mean square error on hold-out runs with effects over that of the refit.
    pub hold_out_ratio: f64,
}

/// The scoreboard.
#[derive(Clone, Debug, Serialize)]
pub struct Scoreboard {
    /// Always `vre-blind-check/1`.
    pub format: &'static str,
    /// The seed.
    pub seed: u64,
    /// Every campaign.
    pub outcomes: Vec<Outcome>,
}

/// Runs the study on `campaigns` campaigns; `without` are taken out of the catalogue throughout. `tick` is called after
/// each.
///
/// # Errors
/// Those of [`diagnose`].
pub fn blind_check(
    campaigns: u64,
    seed: u64,
    without: &[String],
    tick: impl Fn() + Sync,
) -> Result<Scoreboard, Error> {
    let cases = cases(without);
    let one = |number: u64| {
        let outcome = try_case(&cases[number as usize % cases.len()], number, seed, without);
        tick();
        outcome
    };
    let outcomes: Result<Vec<Option<Outcome>>, Error> =
        (0..campaigns).into_par_iter().map(one).collect();
    Ok(Scoreboard {
        format: "vre-blind-check/1",
        seed,
        outcomes: outcomes?.into_iter().flatten().collect(),
    })
}

/// The round of cases that a study goes through.
fn cases(without: &[String]) -> Vec<Case> {
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
            });
        }
        // Each effect once with one some way down the list.
        let partner = known[(k + 7) % known.len()];
        cases.push(Case {
            kind: Kind::Pair,
            effects: vec![id, partner],
            visibility: PAIR_VISIBILITY,
        });
        cases.push(Case {
            kind: Kind::Withheld,
            effects: vec![id],
            visibility: STRANGE_VISIBILITY,
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
        });
    }
    for entry in effects::catalogue().filter(|entry| catalogue::find(entry.id).is_none()) {
        for visibility in VISIBILITIES {
            cases.push(Case {
                kind: Kind::OutsideCatalogue,
                effects: vec![entry.id],
                visibility,
            });
        }
    }
    cases
}

fn simulate(case: &Case, seed: Seed, strengths: &[f64]) -> Simulation {
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
    VirtualBench::new(seed, plan, specification, drawn.collect()).simulate()
}

/// Strengths that give each effect alone the visibility asked for; `None` if an effect cannot be seen so well.
fn strengths(case: &Case, seed: Seed) -> Option<Vec<f64>> {
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

fn try_case(
    case: &Case,
    number: u64,
    seed: u64,
    without: &[String],
) -> Result<Option<Outcome>, Error> {
    // One bench per campaign; campaigns of neighbouring seeds share nothing.
    let seed = Seed(
        seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)
            .wrapping_add(number),
    );
    let Some(strengths) = strengths(case, seed) else {
        return Ok(None);
    };
    let Simulation {
        campaign,
        holdout,
        truth,
    } = simulate(case, seed, &strengths);
    let mut without = without.to_vec();
    if case.kind == Kind::Withheld {
        without.extend(case.effects.iter().map(|id| (*id).to_owned()));
    }
    let diagnosis = diagnose(&campaign, &without)?.diagnosis;
    let mean_square = |predicted: Vec<Quantity>| {
        let errors = predicted.iter().zip(&truth.holdout_vre_g);
        let squares =
            errors.map(|(quantity, truth)| (quantity.value.unwrap_or(f64::NAN) - truth).powi(2));
        squares.sum::<f64>() / holdout.len().max(1) as f64
    };
    let with = mean_square(predict_with_effects(&campaign, &diagnosis, &holdout, None)?);
    let refit = mean_square(predict_refitted(&campaign, &holdout, None)?);
    let floor = {
        let coefficients = shared::model::Coefficients::from_nominal(truth.coefficients);
        let unseen = holdout
            .iter()
            .map(|run| crate::finite_record::unseen_variance_g2(run, &coefficients));
        unseen.sum::<f64>() / holdout.len().max(1) as f64
    };
    let best = &diagnosis.which[0];
    let mut named = best.effects.clone();
    named.sort();
    let mut acting: Vec<String> = case.effects.iter().map(|id| (*id).to_owned()).collect();
    acting.sort();
    let score = score(case, &diagnosis, &named, &acting);
    let likely = diagnosis
        .location
        .stages
        .iter()
        .max_by(|a, b| a.probability.total_cmp(&b.probability));
    let stage_right = likely.is_some_and(|likely| {
        acting
            .iter()
            .any(|id| catalogue::find(id).is_some_and(|effect| effect.stage == likely.stage))
    });
    let closed = (refit > 2.0 * floor && !acting.is_empty())
        .then(|| 1.0 - ((with - floor).max(0.0) / (refit - floor)).sqrt());
    Ok(Some(Outcome {
        campaign: number,
        kind: case.kind.clone(),
        visibility: case.visibility,
        strengths,
        seed: seed.0,
        score,
        probability: best.probability,
        stage_right,
        worst_parameter_sigmas: (named == acting && !acting.is_empty())
            .then(|| worst_parameter(&diagnosis, &truth.effects))
            .flatten(),
        closed,
        closed_stated: diagnosis.shrink.map(|s| s.closed_fraction),
        closed_interval: diagnosis.shrink.map(|s| s.closed_fraction_interval_90),
        hold_out_ratio: (with / refit.max(f64::MIN_POSITIVE)).sqrt(),
        effects: acting,
        named,
    }))
}

fn score(case: &Case, diagnosis: &Diagnosis, named: &[String], acting: &[String]) -> Score {
    let strange = matches!(case.kind, Kind::OutsideCatalogue | Kind::Withheld);
    match diagnosis.verdict {
        Verdict::Unexplained if strange => Score::Right,
        Verdict::Unexplained => Score::Unexplained,
        Verdict::NoGap if acting.is_empty() => Score::Right,
        Verdict::NoGap => Score::Missed,
        _ if strange => Score::Wrong,
        Verdict::Explained if named == acting => Score::Right,
        Verdict::Ambiguous => {
            let others = diagnosis.which[0].indistinguishable_from.iter().map(|set| {
                let mut set: Vec<String> = set.split('+').map(str::to_owned).collect();
                set.sort();
                set
            });
            if named == acting || others.into_iter().any(|set| set == acting) {
                Score::InClass
            } else {
                Score::Wrong
            }
        }
        Verdict::Explained => Score::Wrong,
    }
}

/// Largest error of a named parameter in its stated sigmas; phases count modulo a turn.
fn worst_parameter(
    diagnosis: &Diagnosis,
    truth: &[crate::bench::simulate::EffectTruth],
) -> Option<f64> {
    let mut worst: Option<f64> = None;
    for estimate in &diagnosis.which[0].parameters {
        let effect = truth.iter().find(|effect| effect.id == estimate.effect);
        let Some(value) = effect.and_then(|effect| effect.parameters.get(&estimate.name)?.as_f64())
        else {
            continue;
        };
        let mut error = (estimate.value - value).abs();
        if estimate.name.ends_with("phase_rad") {
            error = error.rem_euclid(std::f64::consts::TAU);
            error = error.min(std::f64::consts::TAU - error);
        }
        let sigmas = error / estimate.sigma.max(f64::MIN_POSITIVE);
        worst = Some(worst.map_or(sigmas, |w| w.max(sigmas)));
    }
    worst
}

impl Scoreboard {
    /// Counts of the scores by kind, effects and visibility.
    pub fn table(&self) -> BTreeMap<(Kind, String, u64), BTreeMap<Score, usize>> {
        let mut table: BTreeMap<_, BTreeMap<Score, usize>> = BTreeMap::new();
        for outcome in &self.outcomes {
            let key = (
                outcome.kind.clone(),
                outcome.effects.join("+"),
                outcome.visibility as u64,
            );
            *table
                .entry(key)
                .or_default()
                .entry(outcome.score)
                .or_default() += 1;
        }
        table
    }
}

/// Shares of a set of outcomes, as text.
fn share(count: usize, of: usize) -> String {
    if of == 0 {
        "-".into()
    } else {
        format!(
            "{:.1} % ({count} of {of})",
            100.0 * count as f64 / of as f64
        )
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

impl Scoreboard {
    /// The scoreboard for the terminal.
    pub fn text(&self) -> String {
        use std::fmt::Write as _;
        let mut out = String::new();
        let scores = [
            Score::Right,
            Score::InClass,
            Score::Wrong,
            Score::Missed,
            Score::Unexplained,
        ];
        let _ = writeln!(
            out,
            "{:<44} {:>5} {:>6} {:>6} {:>6} {:>6} {:>8}",
            "effect", "vis.", "right", "class", "wrong", "missed", "unexpl."
        );
        for ((kind, effects, visibility), counts) in self.table() {
            let label = match kind {
                Kind::Single | Kind::Pair => effects,
                Kind::Nothing => "none".into(),
                Kind::NothingPaperPlan => "none, paper's plan, 10 arcsec".into(),
                Kind::OutsideCatalogue => format!("{effects} (not in the catalogue)"),
                Kind::Withheld => format!("{effects} (withheld)"),
            };
            let counts = scores.map(|score| counts.get(&score).copied().unwrap_or(0));
            let [right, class, wrong, missed, unexplained] = counts;
            let _ = writeln!(
                out,
                "{label:<44} {visibility:>5} {right:>6} {class:>6} {wrong:>6} {missed:>6} {unexplained:>8}"
            );
        }
        let _ = writeln!(out);
        let of = |test: &dyn Fn(&&Outcome) -> bool| {
            self.outcomes.iter().filter(test).collect::<Vec<_>>()
        };
        let count = |set: &[&Outcome], score: &[Score]| {
            set.iter().filter(|o| score.contains(&o.score)).count()
        };
        for visibility in VISIBILITIES {
            let set = of(&|o| o.kind == Kind::Single && o.visibility == visibility);
            let _ = writeln!(
                out,
                "single effects, visibility {visibility}: right or in class {}, of these by class {}, wrong {}",
                share(count(&set, &[Score::Right, Score::InClass]), set.len()),
                share(count(&set, &[Score::InClass]), set.len()),
                share(count(&set, &[Score::Wrong]), set.len()),
            );
        }
        let row = |out: &mut String, words: &str, set: Vec<&Outcome>, score: &[Score]| {
            let _ = writeln!(out, "{words}: {}", share(count(&set, score), set.len()));
        };
        let alarms = [Score::Wrong, Score::Unexplained];
        row(
            &mut out,
            "no effect: false alarms",
            of(&|o| o.kind == Kind::Nothing),
            &alarms,
        );
        row(
            &mut out,
            "no effect, paper's plan and head: false alarms",
            of(&|o| o.kind == Kind::NothingPaperPlan),
            &alarms,
        );
        row(
            &mut out,
            "outside the catalogue: called unexplained",
            of(&|o| o.kind == Kind::OutsideCatalogue),
            &[Score::Right],
        );
        row(
            &mut out,
            "withheld from the catalogue: called unexplained",
            of(&|o| o.kind == Kind::Withheld),
            &[Score::Right],
        );
        row(
            &mut out,
            "pairs: both named",
            of(&|o| o.kind == Kind::Pair),
            &[Score::Right, Score::InClass],
        );
        let singles = of(&|o| o.kind == Kind::Single);
        let right = singles.iter().filter(|o| o.stage_right).count();
        let _ = writeln!(
            out,
            "single effects, right link of the chain: {}",
            share(right, singles.len())
        );
        let sigmas: Vec<f64> = self
            .outcomes
            .iter()
            .filter_map(|o| o.worst_parameter_sigmas)
            .collect();
        let within = sigmas.iter().filter(|s| **s <= 4.0).count();
        let _ = writeln!(
            out,
            "parameters all within four of their sigmas: {}",
            share(within, sigmas.len())
        );
        let closing: Vec<&Outcome> = singles
            .iter()
            .copied()
            .filter(|o| o.closed.is_some())
            .collect();
        if let Some(closed) = median(closing.iter().filter_map(|o| o.closed).collect()) {
            let held = |o: &&&Outcome| matches!((o.closed, o.closed_interval), (Some(a), Some([low, high])) if (low..=high).contains(&a));
            let close = |o: &&&Outcome| matches!((o.closed, o.closed_stated), (Some(a), Some(b)) if (a - b).abs() <= 0.15);
            let _ = writeln!(
                out,
                "gap on hold-out runs closed: median {:.0} %; stated within 0.15 of it {}, its 90 % interval holds it {}",
                100.0 * closed,
                share(closing.iter().filter(close).count(), closing.len()),
                share(closing.iter().filter(held).count(), closing.len()),
            );
        }
        let worse = self
            .outcomes
            .iter()
            .filter(|o| o.hold_out_ratio > 1.05)
            .count();
        let _ = writeln!(
            out,
            "hold-out runs made worse by more than 5 %: {}",
            share(worse, self.outcomes.len())
        );
        self.calibration(&mut out);
        out
    }

    /// Reliability of the probability of what is named, in bins, and its Brier score.
    fn calibration(&self, out: &mut String) {
        use std::fmt::Write as _;
        let judged: Vec<(f64, bool)> = self
            .outcomes
            .iter()
            .filter(|o| {
                !matches!(o.kind, Kind::OutsideCatalogue | Kind::Withheld)
                    || o.score == Score::Wrong
            })
            .map(|o| (o.probability, o.named == o.effects))
            .collect();
        if judged.is_empty() {
            return;
        }
        let brier: f64 = judged
            .iter()
            .map(|(p, right)| (p - f64::from(u8::from(*right))).powi(2))
            .sum::<f64>()
            / judged.len() as f64;
        let _ = writeln!(
            out,
            "probability of what is named (Brier score {brier:.3}):"
        );
        for (low, high) in [(0.0, 0.5), (0.5, 0.9), (0.9, 0.99), (0.99, 1.01)] {
            let bin: Vec<&(f64, bool)> = judged
                .iter()
                .filter(|(p, _)| (low..high).contains(p))
                .collect();
            let right = bin.iter().filter(|(_, right)| *right).count();
            let _ = writeln!(
                out,
                "  {low:.2} to {:.2}: right {}",
                f64::min(high, 1.0),
                share(right, bin.len())
            );
        }
    }
}
