//! What of a diagnosis the instrument's own compensation can carry: the coefficients of (1), k5 included, as they are
//! together with the effects. Other terms of the characteristic have no coefficient on board.

use serde::{Deserialize, Serialize};
use shared::model::Coefficients;

use super::catalogue::Stage;
use super::fit::{Fit, nominal};

/// Coefficients to hand to the instrument, and what they leave out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Compensation {
    /// The coefficients of (1), fitted to all readings and runs together with the effects.
    pub coefficients: Coefficients<f64>,
    /// Diagnosed terms of the characteristic that these hold.
    pub carried: Vec<String>,
    /// Diagnosed terms of the characteristic that no coefficient on board stands for; they stay uncompensated.
    pub not_carried: Vec<String>,
}

impl Compensation {
    /// Of a fit whose outputs were divided by a scale factor, V/g.
    pub fn new(fit: &Fit, scale_v_per_g: f64) -> Self {
        let mut coefficients = nominal(&fit.theta);
        coefficients.scale_factor_v_per_g = fit.theta[0] * scale_v_per_g;
        let (mut carried, mut not_carried) = (Vec::new(), Vec::new());
        for member in &fit.members {
            match (member.effect.id, member.effect.stage) {
                (id @ "quintic", _) => {
                    coefficients.fifth_order_per_g4 = member.values[0] / fit.theta[0];
                    carried.push(id.into());
                }
                (id, Stage::InstrumentStatics) => not_carried.push(id.into()),
                _ => {}
            }
        }
        Self {
            coefficients,
            carried,
            not_carried,
        }
    }
}
