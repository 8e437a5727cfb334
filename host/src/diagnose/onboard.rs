//! What of a diagnosis the instrument's own compensation can carry: the coefficients of (1), the further ones included, as
//! they are together with the effects, with their uncertainty.

use inference::fit::Fit;
use inference::model::SeparableModel;
use shared::model::{Coefficients, FURTHER, NOMINAL};
use shared::rectification::{NOMINAL_RECTIFYING, RECTIFYING};

use super::answer::Compensation;
use crate::campaign_model::CampaignModel;
use crate::effects::identity::Stage;
use crate::forward::nominal::coefficients;

/// Effect and number of the parameter that each further coefficient is, in the order of [`Coefficients::to_further`].
const CARRIED: [(&str, usize); FURTHER] = [
    ("quintic", 0),
    ("bias-asymmetry", 0),
    ("odd-quadratic", 0),
    ("cross-axis-squares", 0),
    ("cross-axis-squares", 1),
];

/// Why a sixth order stays uncompensated.
pub const WHY_NOT_CARRIED: &str =
    "what it rectifies takes moments up to the sixth, a block's stop at the fourth";
/// Part of a coefficient's prior variance above which the data tell nothing of it.
const UNTOLD: f64 = 0.5;

/// Of a fit of a campaign's model.
pub(super) fn compensation(model: &CampaignModel, fit: &Fit) -> Compensation {
    let unknown = CARRIED.map(|(id, parameter)| {
        fit.unknown(
            fit.members.iter().position(|m| model.effect(m).id == id)?,
            parameter,
        )
    });
    let further = CARRIED.map(|(id, parameter)| {
        let member = fit.members.iter().find(|m| model.effect(m).id == id);
        member.map_or(0.0, |m| m.values[parameter] / fit.base_values[0])
    });
    let mut handed = coefficients(&fit.base_values).with_further(further);
    let covariance = covariance(fit, &handed, &unknown);
    handed.scale_factor_v_per_g = fit.base_values[0] * model.scale_v_per_g();
    let told = |&(k, precision): &(usize, &f64)| fit.covariance(k, k) * precision < UNTOLD;
    let priors = model
        .base()
        .prior_precision
        .iter()
        .take(NOMINAL)
        .enumerate();
    let rank = priors.filter(told).count() as u8;
    let (mut carried, mut not_carried) = (Vec::new(), Vec::new());
    for member in &fit.members {
        let id = model.effect(member).id;
        if CARRIED.iter().any(|(carried, _)| *carried == id) {
            carried.push(id.into());
        } else if model.effect(member).stage == Stage::InstrumentStatics {
            not_carried.push(id.into());
        }
    }
    Compensation {
        coefficients: handed,
        covariance,
        carried,
        not_carried,
        rank,
    }
}

/// Covariance of the rectifying coefficients c = x/x0, of unknowns x with the scale factor x0, to the first order:
/// dc = (dx - c dx0) / x0. `unknown` says where the further ones are.
fn covariance(
    fit: &Fit,
    coefficients: &Coefficients<f64>,
    unknown: &[Option<usize>; FURTHER],
) -> [[f64; RECTIFYING]; RECTIFYING] {
    let x0 = fit.base_values[0];
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
        let x = |row: usize, column: usize| fit.covariance(row, column);
        (x(j, k) - c_j * x(0, k) - c_k * x(j, 0) + c_j * c_k * x(0, 0)) / (x0 * x0)
    };
    std::array::from_fn(|j| std::array::from_fn(|k| element(j, k)))
}
