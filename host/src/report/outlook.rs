//! What the static test alone lets one say of a white noise along IA with a0 = 0.

use shared::identify::blindness::singular_values;
use shared::identify::static_test::Fit;
use shared::model::{NOMINAL, SpecificForce};
use shared::rectification::Sensitivity;
use shared::tumble::Position;
use shared::vibration::Random;

use crate::campaign::Campaign;
use crate::error::Error;
use crate::identification::{self, Identification};
use crate::planning::{Conditions, Environment, assess, twice_and_remounted};
use crate::prediction::DEFAULT_PRIOR_SIGMA;
use crate::quantity::Quantity;

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
    /// Unit vector, in the order of [`identification::NAMES`].
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
            .map(|d| identification::NAMES.map(|name| d.get(name).copied().unwrap_or(0.0)))
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

/// Standard uncertainties of the predicted vibration error at one level, g.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSigma {
    /// Root mean square of the white noise along IA, g.
    pub rms_g: f64,
    /// The predicted vibration error, g.
    pub vre_g: f64,
    /// By the plan as it was taken.
    pub taken_g: f64,
    /// By the plan taken twice, and by as many readings with half of them remounted by 180 deg; none if the plan
    /// has several mounts already.
    pub twice_and_remounted_g: Option<(f64, f64)>,
}

/// Levels from 0.1 g to a quarter of the full scale, where noise reaches the stops at 4 sigma.
pub(super) fn levels(campaign: &Campaign, fit: &Fit<f64>) -> Result<Vec<LevelSigma>, Error> {
    const COUNT: u32 = 25;
    let highest_g = (campaign.config.instrument.full_scale_g / 4.0).max(0.2);
    let rms_g = |k: u32| 0.1 * (highest_g / 0.1).powf(f64::from(k) / f64::from(COUNT - 1));
    let environments: Vec<_> = (0..COUNT)
        .map(|k| Environment {
            name: String::new(),
            a0_i_g: 0.0,
            moments: Random::along(SpecificForce::new(rms_g(k), 0.0, 0.0)).into(),
        })
        .collect();
    let readings = &campaign.readings;
    let k1 = fit.coefficients.scale_factor_v_per_g;
    let conditions = Conditions {
        bench: identification::bench(&campaign.config.bench),
        noise_g: readings.iter().map(|r| r.sigma_v).sum::<f64>() / readings.len() as f64 / k1,
        prior_sigma: DEFAULT_PRIOR_SIGMA,
    };
    let sigmas_g = |plan: &[Position]| -> Result<Vec<f64>, Error> {
        let judged = assess(plan, &conditions, &environments)
            .map_err(|error| Error::Usage(format!("the plan cannot be judged: {error}")))?;
        Ok(judged.environments.iter().map(|e| e.sigma_g()).collect())
    };
    let plan: Vec<Position> = readings.iter().map(identification::position).collect();
    let taken = sigmas_g(&plan)?;
    let one_mount = plan.iter().all(|p| p.mount_deg == plan[0].mount_deg);
    let other = if one_mount {
        let (twice, remounted) = twice_and_remounted(&plan);
        Some((sigmas_g(&twice)?, sigmas_g(&remounted)?))
    } else {
        None
    };
    let level = |k: u32| {
        let at = k as usize;
        LevelSigma {
            rms_g: rms_g(k),
            vre_g: white_noise(rms_g(k)).vre_g(&fit.coefficients),
            taken_g: taken[at],
            twice_and_remounted_g: other.as_ref().map(|(t, r)| (t[at], r[at])),
        }
    };
    Ok((0..COUNT).map(level).collect())
}
