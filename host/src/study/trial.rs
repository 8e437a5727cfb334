//! One campaign of a study, diagnosed and held against the truth.

use serde::Serialize;
use shared::model::{Coefficients, NOMINAL};

use super::cases::{Case, Kind, simulate, strengths};
use crate::bench::noise::Seed;
use crate::bench::simulate::{EffectTruth, Simulation};
use crate::campaign::Run;
use crate::diagnose::{Diagnosis, Verdict, diagnose};
use crate::effects;
use crate::error::Error;
use crate::forward::finite_record::unseen_variance_g2;
use crate::quantity::Quantity;
use crate::refit::predict_refitted;

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

pub(super) fn try_case(
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
    let served = predict_refitted(&campaign, diagnosis.serving(), &holdout, None)?;
    let with = mean_square_g2(&served, &truth.holdout_vre_g);
    let refitted = predict_refitted(&campaign, [], &holdout, None)?;
    let refit = mean_square_g2(&refitted, &truth.holdout_vre_g);
    let floor = unseen_g2(&holdout, truth.coefficients);
    let best = &diagnosis.which[0];
    let mut named = best.effects.clone();
    named.sort();
    let mut acting: Vec<String> = case.effects.iter().map(|id| (*id).to_owned()).collect();
    acting.sort();
    let score = score(case, &diagnosis, &named, &acting);
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
        stage_right: stage_right(&diagnosis, &acting),
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

/// Mean square of predicted less true vibration error, g^2.
fn mean_square_g2(predicted: &[Quantity], truth_g: &[f64]) -> f64 {
    let errors = predicted.iter().zip(truth_g);
    let squares =
        errors.map(|(quantity, truth)| (quantity.value.unwrap_or(f64::NAN) - truth).powi(2));
    squares.sum::<f64>() / truth_g.len().max(1) as f64
}

/// Mean over runs of the variance that no prediction from the command can remove, g^2.
fn unseen_g2(runs: &[Run], nominal: [f64; NOMINAL]) -> f64 {
    let coefficients = Coefficients::from_nominal(nominal);
    let unseen = runs
        .iter()
        .map(|run| unseen_variance_g2(&run.into(), &coefficients));
    unseen.sum::<f64>() / runs.len().max(1) as f64
}

/// Whether the most probable stage is that of an effect which acts.
fn stage_right(diagnosis: &Diagnosis, acting: &[String]) -> bool {
    let stages = diagnosis.location.stages.iter();
    let likely = stages.max_by(|a, b| a.probability.total_cmp(&b.probability));
    likely.is_some_and(|likely| {
        let mut acting = acting.iter().filter_map(|id| effects::find(id));
        acting.any(|effect| effect.stage == likely.stage)
    })
}

fn score(case: &Case, diagnosis: &Diagnosis, named: &[String], acting: &[String]) -> Score {
    let strange = matches!(case.kind, Kind::OutsideCatalogue | Kind::Withheld);
    match diagnosis.verdict {
        Verdict::Unexplained if strange => Score::Right,
        Verdict::Unexplained => Score::Unexplained,
        verdict if verdict.sees_none() && acting.is_empty() => Score::Right,
        Verdict::NoGap | Verdict::CannotTell => Score::Missed,
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
fn worst_parameter(diagnosis: &Diagnosis, truth: &[EffectTruth]) -> Option<f64> {
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
