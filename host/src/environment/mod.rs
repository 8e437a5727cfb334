//! An instrument's vibration error where it is to work: a spectrum, sines on it, a mission, and a limit that must be kept.

mod limit;
mod mission;
mod mixture;
mod named;
mod spectrum;

pub use limit::{Judgement, Kept, judge};
pub use mission::{MissionError, mission};
pub use mixture::absolute_excess;
pub use spectrum::{Sine, Vibration};

use serde::Serialize;
use shared::identify::static_test::Fit;

use crate::quantity::Quantity;

/// Metres per second squared a g (CGPM 1901).
pub const G_M_S2: f64 = 9.806_65;

/// What is predicted of an instrument in an environment, `vre-environment/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EnvironmentPrediction {
    /// Always `vre-environment/1`.
    pub format: &'static str,
    /// Serial number of the instrument.
    pub serial: String,
    /// The vibration, as it was named.
    pub vibration: String,
    /// Its rms on IA, PA, OA, sines included, g.
    pub rms_g: [f64; 3],
    /// Systematic specific force on IA, g.
    pub a0_i_g: f64,
    /// Vibration error, g, by the coefficients of the static test.
    pub vre_g: Quantity,
    /// What it adds to the velocity in an hour, m/s.
    pub velocity_m_per_s_per_h: Quantity,
    /// Of a mission.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mission: Option<MissionError>,
    /// Against a limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit: Option<Judgement>,
}

/// The vibration error that a fit predicts, g, with the uncertainty of its coefficients.
pub fn vre_g(vibration: &Vibration, a0_i_g: f64, fit: &Fit<f64>) -> Quantity {
    let sensitivity = vibration.sensitivity(a0_i_g);
    let variance = sensitivity.variance_g2(&fit.covariance).max(0.0);
    Quantity::new(sensitivity.vre_g(&fit.coefficients), variance.sqrt())
}
