//! What the static test alone lets one say of a white noise along IA with a0 = 0.

use shared::identify::blindness::singular_values;
use shared::identify::static_test::Fit;
use shared::model::{NOMINAL, SpecificForce};
use shared::rectification::Sensitivity;
use shared::tumble::{COMPLETING_ANGLES_DEG, Position, Series};
use shared::vibration::Random;

use crate::campaign::Campaign;
use crate::error::Error;
use crate::quantity::Quantity;
use crate::statics::DEFAULT_PRIOR_SIGMA;
use crate::statics::{self, Conditions, Environment, Identification, assess, twice_and_remounted};

/// Derivatives of the vibration error in a white noise of `rms_g` along IA, a0 = 0, by the coefficients.
pub(super) fn white_noise(rms_g: f64) -> Sensitivity<f64> {
    Sensitivity::new(0.0, Random::along(SpecificForce::new(rms_g, 0.0, 0.0)))
}

/// The vibration error that a fit predicts in a white noise of `rms_g` along IA, g.
pub(super) fn vre_g(fit: &Fit<f64>, rms_g: f64) -> Quantity {
    let sensitivity = white_noise(rms_g);
    let variance = sensitivity.variance_g2(&fit.covariance).max(0.0);
    Quantity::new(sensitivity.vre_g(&fit.coefficients), variance.sqrt())
}

/// A direction in the space of the coefficients that the readings tell little or nothing about.
#[derive(Clone, Debug, PartialEq)]
pub struct Direction {
    /// Whether no reading sees it at all.
    pub blind: bool,
    /// Unit vector, in the order of [`statics::NAMES`].
    pub components: [f64; NOMINAL],
    /// Standard uncertainty along it, by the prior if blind; each coefficient in its own unit.
    pub sigma: f64,
    /// Change of the vibration error in a white noise of 1 g rms per unit along it, g.
    pub vre_g_per_unit: f64,
}

/// The coefficients that vibration turns into an error.
const RECTIFYING: [usize; 7] = [2, 3, 4, 5, 8, 9, 10];

impl Direction {
    /// Of the blind directions the combination that moves the vibration error most; for a plan of full rank the
    /// direction of greatest variance among the coefficients that make vibration error.
    pub(super) fn new(found: &Identification, fit: &Fit<f64>, prior_sigma: Option<f64>) -> Self {
        let by = white_noise(1.0).nominal;
        let dot = |a: &[f64; NOMINAL], b: &[f64; NOMINAL]| -> f64 {
            a.iter().zip(b).map(|(a, b)| a * b).sum()
        };
        let blind: Vec<[f64; NOMINAL]> = found
            .blind_directions
            .iter()
            .map(|d| statics::NAMES.map(|name| d.get(name).copied().unwrap_or(0.0)))
            .collect();
        let (components, sigma) = if let Some(first) = blind.first() {
            let seen: Vec<f64> = blind.iter().map(|d| dot(d, &by)).collect();
            let along = |k: usize| -> f64 { blind.iter().zip(&seen).map(|(d, s)| s * d[k]).sum() };
            let steepest: [f64; NOMINAL] = std::array::from_fn(along);
            let length = dot(&steepest, &steepest).sqrt();
            let unit = if length > 1e-9 {
                steepest.map(|c| c / length)
            } else {
                *first
            };
            (unit, prior_sigma.unwrap_or(DEFAULT_PRIOR_SIGMA))
        } else {
            let counts = |k: usize| RECTIFYING.contains(&k);
            let covariance = std::array::from_fn(|j| {
                std::array::from_fn(|k| {
                    if counts(j) && counts(k) {
                        fit.covariance[j][k]
                    } else {
                        0.0
                    }
                })
            });
            let (variances, directions) = singular_values(covariance);
            (directions[0], variances[0].sqrt())
        };
        let largest = components
            .iter()
            .fold(0.0, |l: f64, c| if c.abs() > l.abs() { *c } else { l });
        let components = components.map(|c| c * largest.signum());
        Self {
            blind: !blind.is_empty(),
            components,
            sigma,
            vre_g_per_unit: dot(&components, &by),
        }
    }
}

impl Direction {
    /// Whether it lies mostly among k1', k2 and k4, which more values of |a_I| tell apart.
    pub(super) fn among_even_terms(&self) -> bool {
        let even = [2, 3, 5].map(|k: usize| self.components[k].powi(2));
        even.iter().sum::<f64>() > 0.5
    }
}

/// How well static tests predict the vibration error of a white noise along IA with a0 = 0, over its level.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlook {
    /// Levels, g rms: from 0.1 g to a quarter of the full scale, where noise reaches the stops at 4 sigma.
    pub rms_g: Vec<f64>,
    /// The predicted vibration error at each level, g.
    pub vre_g: Vec<f64>,
    /// The plan as it was taken.
    pub taken: PlanSigma,
    /// Plans that would do better, and what they are compared with.
    pub others: Vec<PlanSigma>,
    /// By how much the last of the others divides the uncertainty of the first at the highest level.
    pub gain: Option<f64>,
}

/// Standard uncertainty of the vibration error that a plan of dial positions predicts.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanSigma {
    /// What the plan is.
    pub name: String,
    /// At each level, by the prior too where the plan is blind, g.
    pub sigma_g: Vec<f64>,
}

impl Outlook {
    const LEVELS: u32 = 25;

    /// For a plan with one mount: taken twice, and with half of the readings remounted by 180 deg; a blind plan is
    /// completed first.
    pub(super) fn new(
        campaign: &Campaign,
        found: &Identification,
        fit: &Fit<f64>,
    ) -> Result<Self, Error> {
        let highest_g = (campaign.config.instrument.full_scale_g / 4.0).max(0.2);
        let share = |k: u32| f64::from(k) / f64::from(Self::LEVELS - 1);
        let rms_g: Vec<f64> = (0..Self::LEVELS)
            .map(|k| 0.1 * (highest_g / 0.1).powf(share(k)))
            .collect();
        let judge = Judge::new(campaign, fit, &rms_g);
        let plan: Vec<Position> = campaign.readings.iter().map(statics::position).collect();
        let taken = judge.plan("as taken", &plan)?;
        let one_mount = plan.iter().all(|p| p.mount_deg == plan[0].mount_deg);
        let mut others = Vec::new();
        if found.rank < NOMINAL {
            let more = completing(plan[0].mount_deg);
            let completed: Vec<Position> = plan.iter().copied().chain(more).collect();
            others.push(judge.plan("with the angles named above added", &completed)?);
            others.push(judge.plan(
                "with these, all of it repeated after remounting by 180 deg",
                &twice_and_remounted(&completed).1,
            )?);
        } else if one_mount {
            let (twice, remounted) = twice_and_remounted(&plan);
            others.push(judge.plan("taken twice", &twice)?);
            others.push(judge.plan("repeated after remounting by 180 deg", &remounted)?);
        }
        let gain = match others.as_slice() {
            [first, .., last] => first
                .sigma_g
                .last()
                .zip(last.sigma_g.last())
                .map(|(f, l)| f / l),
            _ => None,
        };
        let vre_g = rms_g
            .iter()
            .map(|rms| white_noise(*rms).vre_g(&fit.coefficients))
            .collect();
        Ok(Self {
            rms_g,
            vre_g,
            taken,
            others,
            gain,
        })
    }
}

/// The angles that complete the paper's plan, in series 1 and 2.
fn completing(mount_deg: f64) -> impl Iterator<Item = Position> {
    [Series::OutputAxis, Series::PendulousAxis]
        .into_iter()
        .flat_map(move |series| {
            COMPLETING_ANGLES_DEG.map(move |dial_deg| Position {
                series,
                dial_deg,
                mount_deg,
            })
        })
}

/// The campaign's bench and the levels.
struct Judge {
    conditions: Conditions,
    environments: Vec<Environment>,
}

impl Judge {
    fn new(campaign: &Campaign, fit: &Fit<f64>, rms_g: &[f64]) -> Self {
        let readings = &campaign.readings;
        let k1 = fit.coefficients.scale_factor_v_per_g;
        let environment = |rms: &f64| Environment {
            name: String::new(),
            a0_i_g: 0.0,
            moments: Random::along(SpecificForce::new(*rms, 0.0, 0.0)).into(),
        };
        Self {
            conditions: Conditions {
                bench: statics::bench(&campaign.config.bench),
                noise_g: readings.iter().map(|r| r.sigma_v).sum::<f64>()
                    / readings.len() as f64
                    / k1.abs(),
                prior_sigma: DEFAULT_PRIOR_SIGMA,
            },
            environments: rms_g.iter().map(environment).collect(),
        }
    }

    fn plan(&self, name: &str, plan: &[Position]) -> Result<PlanSigma, Error> {
        let judged = assess(plan, &self.conditions, &self.environments)
            .map_err(|error| Error::Usage(format!("the plan cannot be judged: {error}")))?;
        Ok(PlanSigma {
            name: format!("this plan {name}, {} readings", plan.len()),
            sigma_g: judged.environments.iter().map(|e| e.sigma_g()).collect(),
        })
    }
}
