//! The answer, `vre-diagnosis/1`.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};
use shared::model::NOMINAL;

use super::catalogue::{self, Effect, Role, Stage};
use super::compensation::Compensation;
use super::fit::{ALONG, Fit, Member, curved, range, settings};
use super::locate::{Condition, ObservableShare};
use super::next_test::NextTest;
use super::problem::{Block, Problem};
use super::search::{Hypothesis, Search};
use super::shrink::Shrink;
use crate::campaign::Campaign;
use crate::error::Error;

/// Odds against the best hypothesis at which another one no longer stands.
const STANDING_ODDS: f64 = 20.0;
/// Most effects, or sets of effects, in a class beside its most probable member.
const CLASS: usize = 2;
/// Hypotheses less probable than this are not listed, and most that are, of a gap that none explains fewer.
const LISTED: f64 = 1e-3;
const MOST_LISTED: usize = 8;
const LISTED_IF_UNEXPLAINED: usize = 3;
/// Standard deviation, as a part of its range, from which on a parameter is followed over all of that.
const WIDE: f64 = 0.03;
/// Parts of that range.
const FOLLOWED: usize = 16;
/// Rise of -2 log likelihood at which a value is out of the question.
const BEYOND: f64 = 25.0;

/// In a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing beyond the stated uncertainty.
    NoGap,
    /// One hypothesis holds.
    Explained,
    /// One class of hypotheses that these data do not split holds.
    Ambiguous,
    /// There is a gap and nothing in the catalogue explains it.
    Unexplained,
}

/// Size of the gap.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Root mean square over all observations in units of their stated uncertainty; about 1 without a gap.
    pub rms_over_noise: f64,
    /// Probability of so large a misfit of the nominal model by chance.
    pub p_value: f64,
}

/// Where it lies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Where {
    /// By observable.
    pub observables: Vec<ObservableShare>,
    /// By link of the chain, from the hypotheses.
    pub stages: Vec<StageProbability>,
    /// Regions of conditions that hold it.
    pub conditions: Vec<Condition>,
}

/// Probability that an effect of a stage acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageProbability {
    /// Link of the chain.
    pub stage: Stage,
    /// Sum of the probabilities of its hypotheses.
    pub probability: f64,
}

/// One hypothesis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Which {
    /// Effects that act; none is the nominal model.
    pub effects: Vec<String>,
    /// Its probability.
    pub probability: f64,
    /// Their parameters.
    pub parameters: Vec<ParameterEstimate>,
    /// What else these data cannot tell from it: effects, or sets of effects joined by `+`.
    pub indistinguishable_from: Vec<String>,
    /// Parameters as the catalogue has them, effect by effect: where a new fit starts.
    #[serde(default)]
    pub fitted: Vec<Vec<f64>>,
}

/// A parameter with its standard uncertainty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterEstimate {
    /// Effect that it belongs to.
    #[serde(default)]
    pub effect: String,
    /// Name with its unit.
    pub name: String,
    /// Estimate.
    pub value: f64,
    /// Standard uncertainty.
    pub sigma: f64,
}

/// A cause of a bad static prediction that is no effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentificationCause {
    /// `plan-blindness` or `dial-noise`.
    pub cause: String,
    /// Share of the static prediction's squared error beyond the noise that it explains.
    pub share: f64,
}

/// Likeness of the hypotheses' signatures beyond what the nominal model can imitate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Similarity {
    /// Hypotheses, effects joined by `+`.
    pub hypotheses: Vec<String>,
    /// Correlations, -1 to 1.
    pub correlation: Vec<Vec<f64>>,
}

/// `vre-diagnosis/1`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// Always `vre-diagnosis/1`.
    pub format: String,
    /// Serial number of the instrument.
    pub serial: String,
    /// In a word.
    pub verdict: Verdict,
    /// How large.
    pub gap: Gap,
    /// Where.
    #[serde(rename = "where")]
    pub location: Where,
    /// Which effects, most probable first.
    pub which: Vec<Which>,
    /// How far it shrinks; absent without runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shrink: Option<Shrink>,
    /// What to measure next.
    pub next_tests: Vec<NextTest>,
    /// Why the static prediction is off, if it is, without an effect.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identification: Option<IdentificationCause>,
    /// Which hypotheses look alike.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub similarity: Option<Similarity>,
    /// What the instrument's own compensation can carry of it; absent where no one hypothesis explains the gap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compensation: Option<Compensation>,
    /// What could not be looked at, and why.
    #[serde(default)]
    pub not_looked_at: Vec<String>,
}

const FORMAT: &str = "vre-diagnosis/1";

impl Diagnosis {
    /// Reads a diagnosis that `vre diagnose --json` wrote.
    ///
    /// # Errors
    /// Unreadable, not JSON of that format, or an effect that the catalogue does not hold.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let text = fs::read_to_string(file).map_err(Error::read(file))?;
        let diagnosis: Self = serde_json::from_str(&text)
            .map_err(|error| Error::input(file, error.to_string().replace('\n', " ")))?;
        if diagnosis.format != FORMAT {
            return Err(Error::input(
                file,
                format!("its format is \"{}\", not \"{FORMAT}\"", diagnosis.format),
            ));
        }
        for id in diagnosis.which.iter().flat_map(|which| &which.effects) {
            if catalogue::find(id).is_none() {
                return Err(Error::input(
                    file,
                    format!("\"{id}\" is no effect of the catalogue"),
                ));
            }
        }
        Ok(diagnosis)
    }

    /// Whether the effects that it names serve predictions: they explain the gap, and close something of it.
    pub fn serves(&self) -> bool {
        self.verdict != Verdict::Unexplained
            && self
                .shrink
                .is_none_or(|shrink| shrink.closed_fraction > 0.0)
    }

    /// What of it the instrument may be given.
    pub fn offered(&self) -> Option<&Compensation> {
        self.compensation.as_ref().filter(|_| self.serves())
    }

    /// The most probable effects with their parameters, as far as adding them makes predictions better.
    pub fn members(&self) -> Vec<Member> {
        let best = self.which.first().filter(|_| self.serves());
        let effects = best
            .into_iter()
            .flat_map(|which| which.effects.iter().zip(&which.fitted));
        effects
            .filter_map(|(id, values)| {
                let effect = catalogue::find(id)?;
                (values.len() == effect.parameters.len()).then(|| Member {
                    effect,
                    values: values.clone(),
                })
            })
            .collect()
    }
}

/// A diagnosis with what pictures of it need.
pub struct Study<'c> {
    /// The answer.
    pub diagnosis: Diagnosis,
    /// The whitened observations.
    pub problem: Problem<'c>,
    /// All hypotheses with their fits.
    pub search: Search,
}

impl Study<'_> {
    /// The hypothesis that the answer shows first.
    pub fn shown(&self) -> &Hypothesis {
        let hypotheses = &self.search.hypotheses;
        let nothing = (self.diagnosis.verdict == Verdict::NoGap)
            .then(|| hypotheses.iter().find(|h| h.fit.members.is_empty()));
        nothing.flatten().unwrap_or(&hypotheses[0])
    }
}

/// Diagnoses a campaign with the effects of the catalogue but those `without`.
///
/// # Errors
/// An unknown identifier in `without`, or a campaign that determines nothing.
pub fn diagnose<'c>(campaign: &'c Campaign, without: &[String]) -> Result<Study<'c>, Error> {
    if let Some(unknown) = without.iter().find(|id| catalogue::find(id).is_none()) {
        let known: Vec<&str> = catalogue::catalogue().map(|effect| effect.id).collect();
        return Err(Error::Usage(format!(
            "--without {unknown}: no effect of the catalogue ({})",
            known.join(", ")
        )));
    }
    let effects: Vec<&'static Effect> = catalogue::catalogue()
        .filter(|effect| !without.iter().any(|id| id == effect.id))
        .collect();
    let mut problem = Problem::new(campaign, &[]);
    let undetermined = || Error::Usage("the campaign does not determine the nominal model".into());
    let search = problem.search(&effects).ok_or_else(undetermined)?;
    let diagnosis = conclude(campaign, &problem, &search);
    Ok(Study {
        diagnosis,
        problem,
        search,
    })
}

fn conclude(campaign: &Campaign, problem: &Problem<'_>, search: &Search) -> Diagnosis {
    let best = &search.hypotheses[0];
    let null_probability = search
        .hypotheses
        .iter()
        .find(|h| h.fit.members.is_empty())
        .map_or(0.0, |h| h.probability);
    let nothing =
        best.fit.members.is_empty() || best.probability < STANDING_ODDS * null_probability;
    let verdict = match (search.unexplained, nothing) {
        (true, _) => Verdict::Unexplained,
        (false, true) => Verdict::NoGap,
        (false, false) => match standing(search).len() {
            1 => Verdict::Explained,
            _ => Verdict::Ambiguous,
        },
    };
    let mut ranked: Vec<&Hypothesis> = search.hypotheses.iter().collect();
    if verdict == Verdict::NoGap {
        ranked.sort_by_key(|h| !h.fit.members.is_empty());
    }
    let class: Vec<String> = match verdict {
        Verdict::Ambiguous => standing(search)[1..]
            .iter()
            .take(CLASS)
            .map(|h| name(&h.fit))
            .collect(),
        _ => Vec::new(),
    };
    let which = ranked
        .iter()
        .enumerate()
        .filter(|(k, h)| *k == 0 || h.probability >= LISTED)
        .map(|(k, h)| Which {
            effects: h.fit.members.iter().map(|m| m.effect.id.into()).collect(),
            probability: h.probability,
            parameters: parameters(problem, &h.fit),
            indistinguishable_from: if k == 0 { class.clone() } else { Vec::new() },
            fitted: h.fit.members.iter().map(|m| m.values.clone()).collect(),
        });
    let listed = if verdict == Verdict::Unexplained {
        LISTED_IF_UNEXPLAINED
    } else {
        MOST_LISTED
    };
    let which: Vec<Which> = which.take(listed).collect();
    let shown = ranked[0];
    let (observables, conditions) = problem.locate(&shown.fit);
    let stages = Stage::ALL.iter().map(|&stage| {
        let of_stage = |h: &&Hypothesis| h.fit.members.iter().any(|m| m.effect.stage == stage);
        let probability: f64 = search
            .hypotheses
            .iter()
            .filter(of_stage)
            .map(|h| h.probability)
            .sum();
        StageProbability { stage, probability }
    });
    let observed: usize = super::adequacy::OBSERVABLES
        .iter()
        .map(|(b, _)| problem.observed_rows(*b).count())
        .sum();
    let chi2: f64 = search.null_adequacy.observables.iter().map(|o| o.0).sum();
    let freedom: f64 = search.null_adequacy.observables.iter().map(|o| o.1).sum();
    let shrink = problem.shrink(campaign, search, &shown.fit);
    Diagnosis {
        format: FORMAT.into(),
        serial: campaign.config.instrument.serial.clone(),
        verdict,
        gap: Gap {
            rms_over_noise: if observed > 0 {
                (chi2 / freedom.max(1.0)).sqrt()
            } else {
                0.0
            },
            p_value: search.null_adequacy.p_value,
        },
        location: Where {
            observables,
            stages: stages.collect(),
            conditions,
        },
        which,
        shrink,
        next_tests: problem.next_tests(campaign, search, verdict),
        identification: if verdict == Verdict::NoGap {
            shrink.and_then(|s| identification(problem, s))
        } else {
            None
        },
        similarity: similarity(problem, search),
        compensation: matches!(verdict, Verdict::Explained | Verdict::NoGap)
            .then(|| Compensation::new(problem, &shown.fit)),
        not_looked_at: not_looked_at(campaign),
    }
}

/// Hypotheses that the data leave standing, best first.
pub fn standing(search: &Search) -> Vec<&Hypothesis> {
    let best = search.hypotheses[0].probability;
    let stands =
        |h: &&Hypothesis| h.probability * STANDING_ODDS > best && !h.fit.members.is_empty();
    search.hypotheses.iter().filter(stands).collect()
}

/// Effects of a fit joined by `+`.
pub fn name(fit: &Fit) -> String {
    let names: Vec<&str> = fit.members.iter().map(|m| m.effect.id).collect();
    if names.is_empty() {
        "none".into()
    } else {
        names.join("+")
    }
}

/// What of a fit's parameters is reported.
fn parameters(problem: &Problem<'_>, fit: &Fit) -> Vec<ParameterEstimate> {
    let n = fit.columns.len();
    let mut estimates = Vec::new();
    for (m, Member { effect, values }) in fit.members.iter().enumerate() {
        let index = |k: usize| Some(NOMINAL + fit.unknowns.iter().position(|&u| u == (m, k))?);
        // Derivative of a value by its unknown, which may be the value's logarithm.
        let slope = |k: usize| match effect.parameters[k].role {
            Role::Curved {
                logarithmic: true, ..
            } => values[k],
            _ => 1.0,
        };
        let covariance = |i: usize, j: usize| match (index(i), index(j)) {
            (Some(a), Some(b)) => fit.covariance[a * n + b] * slope(i) * slope(j),
            _ => 0.0,
        };
        let mut put = |name: &str, value: f64, sigma: f64| {
            estimates.push(ParameterEstimate {
                effect: effect.id.into(),
                name: name.into(),
                value,
                sigma,
            });
        };
        if let Some((names, report)) = effect.report {
            let reported = report(values);
            let gradients: Vec<Vec<f64>> = (0..values.len())
                .map(|k| {
                    let mut moved = values.clone();
                    let step = 1e-6 * values[k].abs().max(1e-9);
                    moved[k] += step;
                    report(&moved)
                        .iter()
                        .zip(&reported)
                        .map(|(a, b)| (a - b) / step)
                        .collect()
                })
                .collect();
            for (r, (name, value)) in names.iter().zip(&reported).enumerate() {
                let mut variance = 0.0;
                for i in 0..values.len() {
                    for j in 0..values.len() {
                        variance += gradients[i][r] * gradients[j][r] * covariance(i, j);
                    }
                }
                put(name, *value, variance.max(0.0).sqrt());
            }
            continue;
        }
        for (k, parameter) in effect
            .parameters
            .iter()
            .enumerate()
            .filter(|(_, p)| !p.name.starts_with('_'))
        {
            match parameter.role {
                Role::Curved { .. } if index(k).is_none() => {
                    let (value, sigma) = problem.scattered(fit, m);
                    put(parameter.name, value, sigma);
                }
                role => {
                    let mut estimate = (values[k], covariance(k, k).max(0.0).sqrt());
                    if wide(role, index(k).map(|i| fit.covariance[i * n + i])) {
                        let over_its_range = problem.over_its_range(fit, m, k);
                        if over_its_range.1 > estimate.1 {
                            estimate = over_its_range;
                        }
                    }
                    put(parameter.name, estimate.0, estimate.1);
                }
            }
        }
    }
    estimates
}

/// Whether a parameter, of this variance on its internal scale, is known over a part of its range only roughly or by
/// steps: the likelihood's curvature at the fit then says little.
fn wide(role: Role, variance: Option<f64>) -> bool {
    match (role, range(role), variance) {
        (Role::Curved { .. }, Some((from, to)), Some(variance)) => {
            variance.sqrt() > WIDE * (to - from)
        }
        (Role::Stepped { .. }, ..) => true,
        _ => false,
    }
}

fn similarity(problem: &Problem<'_>, search: &Search) -> Option<Similarity> {
    let shown: Vec<&Hypothesis> = search
        .hypotheses
        .iter()
        .filter(|h| !h.fit.members.is_empty())
        .take(8)
        .collect();
    if shown.is_empty() {
        return None;
    }
    let signatures: Vec<_> = shown.iter().map(|h| problem.signature(&h.fit)).collect();
    let references: Vec<_> = signatures.iter().collect();
    Some(Similarity {
        hypotheses: shown.iter().map(|h| name(&h.fit)).collect(),
        correlation: problem.remainder(&search.null).similarity(&references),
    })
}

/// Why the static prediction misses though nothing acts.
fn identification(problem: &Problem<'_>, shrink: Shrink) -> Option<IdentificationCause> {
    let [statics, refit, floor] = [
        shrink.held_out_rms_static_only_g,
        shrink.held_out_rms_refit_g,
        shrink.noise_floor_rms_g,
    ]
    .map(|rms| rms * rms);
    if statics < 2.0 * refit.max(floor) {
        return None;
    }
    let cause = if problem.blind_directions() > 0 {
        "plan-blindness"
    } else {
        "dial-noise"
    };
    let share = ((statics - refit) / (statics - floor)).clamp(0.0, 1.0);
    Some(IdentificationCause {
        cause: cause.into(),
        share,
    })
}

fn not_looked_at(campaign: &Campaign) -> Vec<String> {
    let mut notes = Vec::new();
    let made = campaign.runs.iter().filter(|run| run.measured.is_some());
    if made.clone().count() == 0 {
        notes.push(
            "no shaker runs: vibration error, bias before and recovery after runs, drift, and every effect that only vibration shows"
                .into(),
        );
        return notes;
    }
    if made.clone().all(|run| run.reference.is_none()) {
        notes.push("no reference accelerometer: what the table really did, and the shape of random records".into());
    } else if campaign.config.shaker.is_none() {
        notes.push(
            "campaign.toml has no [shaker]: the reference's rms is not compared with the command"
                .into(),
        );
    }
    if made
        .clone()
        .all(|run| run.measured.is_none_or(|m| m.extremes.is_none()))
    {
        notes.push("no extremes of the output: clipping, and the amplitude at the instrument, only through the means".into());
    }
    notes
}

impl Problem<'_> {
    /// Directions of the even coefficients that the static readings leave undetermined.
    pub(super) fn blind_directions(&self) -> usize {
        let design = self
            .situation
            .readings
            .iter()
            .map(|r| shared::model::terms(r.specific_force_g));
        let mut distinct: Vec<i64> = design
            .map(|terms| (terms[2] * 1e4).round() as i64)
            .collect();
        distinct.sort_unstable();
        distinct.dedup();
        // Four even functions of a_I need four values of |a_I|.
        4_usize.saturating_sub(distinct.len())
    }

    /// Mean and standard deviation of a parameter over its range, by the likelihood at parts of it: as far from the fit as it
    /// may be without a gap, the other parameters fitted to each part. One that goes by steps is followed over all of it, made up
    /// for by the effect's first curved parameter alone.
    fn over_its_range(&self, fit: &Fit, m: usize, k: usize) -> (f64, f64) {
        let member = &fit.members[m];
        let role = member.effect.parameters[k].role;
        let parts: Vec<Part> = match role {
            Role::Linear { .. } => return (member.values[k], 0.0),
            Role::Curved { .. } => {
                let mut others = curved(&fit.members);
                others.retain(|other| *other != (m, k));
                let (mut below, above): (Vec<f64>, Vec<f64>) = settings(role, FOLLOWED)
                    .into_iter()
                    .partition(|value| *value < member.values[k]);
                below.reverse();
                let mut parts = Vec::new();
                // From the fit to both ends, as far as it may be.
                for values in [below, above] {
                    let mut members = fit.members.clone();
                    for value in values {
                        members[m].values[k] = value;
                        let Some(best) = self.fit_some(members, others.clone(), &fit.trust, 1)
                        else {
                            break;
                        };
                        parts.push(Part {
                            value,
                            width: 0.0,
                            weight: 1.0,
                            score: best.objective,
                        });
                        if best.objective > fit.objective + BEYOND {
                            break;
                        }
                        members = best.members;
                    }
                }
                parts
            }
            Role::Stepped { from, to, .. } => {
                let weighing = self.weighing(fit.trust.clone());
                let first = member.effect.linear();
                let mut along = settings(member.effect.parameters[first].role, ALONG);
                along.push(member.values[first]);
                let part = |step: (f64, f64)| {
                    let best = self.best_at_step(&fit.members, (m, k), step, &along, &weighing);
                    let (low, high) = step;
                    Some(Part {
                        value: 0.5 * (low + high),
                        width: high - low,
                        weight: high - low,
                        score: best?.0,
                    })
                };
                self.steps(from, to).into_iter().filter_map(part).collect()
            }
        };
        moments(&parts)
    }

    /// Size of a scatter with its uncertainty, from the runs' residuals.
    fn scattered(&self, fit: &Fit, m: usize) -> (f64, f64) {
        let value = fit.members[m].values[0];
        let super::catalogue::Action::Scatters(scatter) = fit.members[m].effect.action else {
            return (value, 0.0);
        };
        let start = self.range(Block::During).start;
        // Of runs whose scatter stands out of the noise: each tells the logarithm of the size to 1/sqrt 2.
        let runs = self.situation.runs.iter().enumerate();
        let telling: f64 = runs
            .map(|(row, run)| {
                let added = value
                    * value
                    * scatter(run, &self.situation)
                    * self.weights[start + row].powi(2);
                (added / (1.0 + added)).powi(2)
            })
            .sum();
        (value, value / (2.0 * telling.max(0.1)).sqrt())
    }
}

/// A part of a parameter's range.
struct Part {
    value: f64,
    /// Width over which nothing is known, and prior weight.
    width: f64,
    weight: f64,
    /// -2 log likelihood.
    score: f64,
}

/// Mean and standard deviation under exp(-score/2).
fn moments(parts: &[Part]) -> (f64, f64) {
    let least = parts.iter().map(|p| p.score).fold(f64::INFINITY, f64::min);
    let (mut total, mut mean, mut square) = (0.0, 0.0, 0.0);
    for part in parts {
        let weight = part.weight * (-0.5 * (part.score - least)).exp();
        total += weight;
        mean += weight * part.value;
        square += weight * (part.value.powi(2) + part.width.powi(2) / 12.0);
    }
    let mean = mean / total;
    (mean, (square / total - mean * mean).max(0.0).sqrt())
}
