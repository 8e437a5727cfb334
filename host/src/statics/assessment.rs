//! What a test plan can and cannot tell.
//!
//! All judged by the covariance that the readings of a plan would have, before a single one is taken: that of the
//! coefficients, and that of the vibration error which they predict in the environments that the user names.

use std::collections::BTreeMap;

use serde::Serialize;
use shared::identify::static_test::{Bench, Fit, Reading, StaticTestError};
use shared::model::{Coefficients, NOMINAL};
use shared::rectification::Sensitivity;
use shared::tumble::Position;
use shared::vibration::Moments;

use super::coefficients::{NAMES, blind_directions};
use super::least_squares::Workspace;

/// A vibration in which the error is to be predicted.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// What the user calls it.
    pub name: String,
    /// Systematic specific force on IA, g.
    pub a0_i_g: f64,
    /// Its moments.
    pub moments: Moments<f64>,
}

/// The bench on which a plan would be carried out, for an instrument of unit scale factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Uncertainties of the dividing head.
    pub bench: Bench<f64>,
    /// Standard uncertainty of one reading from noise alone, g.
    pub noise_g: f64,
    /// Standard deviation about zero of every coefficient but K1 before the test, each in its own unit: only
    /// what the readings leave blind rests on it.
    pub prior_sigma: f64,
}

/// What a plan tells.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Assessment {
    /// Number of readings.
    pub readings: usize,
    /// Number of directions that the readings determine beside the prior, 0 to 11.
    pub rank: usize,
    /// Condition number of the design matrix.
    pub condition: f64,
    /// Unit directions in coefficient space that the prior knows as well as the readings.
    pub blind_directions: Vec<BTreeMap<&'static str, f64>>,
    /// Standard uncertainty of each coefficient under its name; null where undetermined.
    pub coefficient_sigma: BTreeMap<&'static str, Option<f64>>,
    /// Standard uncertainty of the predicted vibration error in each environment.
    pub environments: Vec<EnvironmentSigma>,
}

/// Standard uncertainty of the vibration error that a plan would predict in an environment, g.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EnvironmentSigma {
    /// Name of the environment.
    pub name: String,
    /// From noise, dial, mount and level alone, g.
    pub readings_sigma_g: f64,
    /// From what the plan is blind to, by the prior, g.
    pub blind_sigma_g: f64,
}

impl EnvironmentSigma {
    /// Both together, g.
    pub fn sigma_g(&self) -> f64 {
        self.readings_sigma_g.hypot(self.blind_sigma_g)
    }
}

/// Judges a plan.
///
/// # Errors
/// Fewer independent readings than the rank of the plan.
pub fn assess(
    plan: &[Position],
    conditions: &Conditions,
    environments: &[Environment],
) -> Result<Assessment, StaticTestError> {
    let fit = fit(plan, conditions, false)?;
    let seen = &fit.visibility;
    let sigma = |k: usize| {
        seen.determines(k)
            .then(|| fit.covariance[k][k].max(0.0).sqrt())
    };
    let judge = |environment: &Environment| {
        let sensitivity = Sensitivity::new(environment.a0_i_g, environment.moments);
        let along = |direction: &[f64; NOMINAL]| -> f64 {
            direction
                .iter()
                .zip(sensitivity.nominal)
                .map(|(d, s)| d * s)
                .sum()
        };
        let blind: f64 = seen
            .blind_directions()
            .iter()
            .map(|d| along(d).powi(2))
            .sum();
        EnvironmentSigma {
            name: environment.name.clone(),
            readings_sigma_g: sensitivity.variance_g2(&fit.covariance).max(0.0).sqrt(),
            blind_sigma_g: conditions.prior_sigma * blind.sqrt(),
        }
    };
    Ok(Assessment {
        readings: plan.len(),
        rank: seen.rank,
        condition: seen.condition.min(f64::MAX),
        blind_directions: blind_directions(seen),
        coefficient_sigma: NAMES
            .into_iter()
            .enumerate()
            .map(|(k, n)| (n, sigma(k)))
            .collect(),
        environments: environments.iter().map(judge).collect(),
    })
}

/// The fit that readings of this plan would give; their values do not matter to its covariance.
pub(super) fn fit(
    plan: &[Position],
    conditions: &Conditions,
    with_prior: bool,
) -> Result<Fit<f64>, StaticTestError> {
    let mut workspace = Workspace::of(plan.iter().copied());
    let ideal = Coefficients::default();
    let mut test = workspace.test(conditions.bench, ideal)?;
    for position in plan {
        let output_v = ideal.output_v(position.specific_force());
        test.absorb(&Reading {
            position: *position,
            output_v,
            sigma_v: conditions.noise_g,
        })?;
    }
    // Blind is what the readings tell no better than the prior for which the plan is judged.
    test.solve_beside(&[conditions.prior_sigma; NOMINAL], with_prior)
        .map_err(StaticTestError::Workspace)
}
