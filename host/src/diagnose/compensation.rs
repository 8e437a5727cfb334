//! What of a diagnosis the instrument's own compensation can carry: the coefficients of (1), the further ones included, as
//! they are together with the effects, with their uncertainty.

use serde::{Deserialize, Serialize};
use shared::compensate::Calibration;
use shared::model::{Coefficients, FURTHER, NOMINAL};
use shared::rectification::{Covariance, NOMINAL_RECTIFYING, RECTIFYING};

use super::catalogue::Stage;
use super::fit::{Fit, nominal};
use super::problem::Problem;

/// Effect and number of the parameter that each further coefficient is, in the order of [`Coefficients::to_further`].
const CARRIED: [(&str, usize); FURTHER] = [
    ("quintic", 0),
    ("bias-asymmetry", 0),
    ("odd-quadratic", 0),
    ("cross-axis-squares", 0),
    ("cross-axis-squares", 1),
];

/// Coefficients to hand to the instrument, and what they leave out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Compensation {
    /// The coefficients of (1), fitted to all readings and runs together with the effects.
    pub coefficients: Coefficients<f64>,
    /// Covariance of those that rectify: k1', k2, k3, k4, k_IP, k_IO, k_PO, k5, K0', Koq, Kpp, Koo. Zero for a term that was
    /// not diagnosed.
    #[serde(default)]
    pub covariance: [[f64; RECTIFYING]; RECTIFYING],
    /// Diagnosed terms of the characteristic that these hold.
    pub carried: Vec<String>,
    /// Diagnosed terms of the characteristic that stay uncompensated: [`WHY_NOT_CARRIED`].
    pub not_carried: Vec<String>,
    /// Nominal coefficients that readings and runs determine, 0 to 11; of the others nothing but the prior is known.
    #[serde(default)]
    pub rank: u8,
}

/// Why a sixth order stays uncompensated.
pub const WHY_NOT_CARRIED: &str =
    "what it rectifies takes moments up to the sixth, a block's stop at the fourth";
/// Part of a coefficient's prior variance above which the data tell nothing of it.
const UNTOLD: f64 = 0.5;

impl Compensation {
    /// Of a fit of a problem.
    pub fn new(problem: &Problem<'_>, fit: &Fit) -> Self {
        let unknown = CARRIED.map(|(id, parameter)| {
            let of_it = |&(m, k): &(usize, usize)| fit.members[m].effect.id == id && k == parameter;
            Some(NOMINAL + fit.unknowns.iter().position(of_it)?)
        });
        let further = CARRIED.map(|(id, parameter)| {
            let member = fit.members.iter().find(|m| m.effect.id == id);
            member.map_or(0.0, |m| m.values[parameter] / fit.theta[0])
        });
        let mut coefficients = nominal(&fit.theta).with_further(further);
        let covariance = covariance(fit, &coefficients, &unknown);
        coefficients.scale_factor_v_per_g = fit.theta[0] * problem.scale_v_per_g;
        let told = |&(k, precision): &(usize, &f64)| {
            fit.covariance[k * fit.columns.len() + k] * precision < UNTOLD
        };
        let priors = problem.prior_precision.iter().enumerate();
        let rank = priors.filter(told).count() as u8;
        let (mut carried, mut not_carried) = (Vec::new(), Vec::new());
        for member in &fit.members {
            let id = member.effect.id;
            if CARRIED.iter().any(|(carried, _)| *carried == id) {
                carried.push(id.into());
            } else if member.effect.stage == Stage::InstrumentStatics {
                not_carried.push(id.into());
            }
        }
        Self {
            coefficients,
            covariance,
            carried,
            not_carried,
            rank,
        }
    }

    /// For the instrument.
    pub fn calibration(&self) -> Calibration<f64> {
        Calibration {
            coefficients: self.coefficients,
            covariance: Covariance::from_fn(|j, k| self.covariance[j][k]),
            rank: self.rank,
        }
    }
}

/// Covariance of the rectifying coefficients c = x/x0, of unknowns x with the scale factor x0, to the first order:
/// dc = (dx - c dx0) / x0. `unknown` says where the further ones are.
fn covariance(
    fit: &Fit,
    coefficients: &Coefficients<f64>,
    unknown: &[Option<usize>; FURTHER],
) -> [[f64; RECTIFYING]; RECTIFYING] {
    let (order, x0) = (fit.columns.len(), fit.theta[0]);
    let (nominal, further) = (coefficients.to_nominal(), coefficients.to_further());
    let of = |n: usize| match NOMINAL_RECTIFYING.get(n) {
        Some(&k) => (nominal[k], Some(k)),
        None => {
            let k = n - NOMINAL_RECTIFYING.len();
            (further[k], unknown[k])
        }
    };
    let element = |j: usize, k: usize| {
        let ((c_j, Some(j)), (c_k, Some(k))) = (of(j), of(k)) else {
            return 0.0;
        };
        let x = |row: usize, column: usize| fit.covariance[row * order + column];
        (x(j, k) - c_j * x(0, k) - c_k * x(j, 0) + c_j * c_k * x(0, 0)) / (x0 * x0)
    };
    std::array::from_fn(|j| std::array::from_fn(|k| element(j, k)))
}
