//! What no static test determines and somebody has to state: how gain and offset drift with temperature and time, and
//! how far the converter's own characteristic is from a line.

use serde::{Deserialize, Serialize};

use crate::scalar::Real;

/// Standard uncertainties beside those of the coefficients (JCGM 100, type B); zero for what is not stated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StatedErrors<T> {
    /// Relative change of the scale factor a kelvin, from the middle of the calibrated range on.
    pub scale_factor_per_k: T,
    /// Relative change of the scale factor until the next calibration.
    pub scale_factor_drift: T,
    /// Change of the bias a kelvin, g/K, from the middle of the calibrated range on.
    pub bias_g_per_k: T,
    /// Change of the bias until the next calibration, g.
    pub bias_drift_g: T,
    /// Integral nonlinearity of the converter, of full scale.
    pub converter_nonlinearity: T,
}

impl<T: Real> StatedErrors<T> {
    /// True when it matters how warm it is.
    pub fn depends_on_temperature(&self) -> bool {
        self.scale_factor_per_k > T::zero() || self.bias_g_per_k > T::zero()
    }

    /// Variance of a specific force, g^2, `away_k` kelvin from the middle of the calibrated range; `full_scale_g` is the
    /// end of the converter's range.
    pub fn variance_g2(&self, specific_force_g: T, away_k: T, full_scale_g: T) -> T {
        let terms = [
            self.scale_factor_per_k * away_k * specific_force_g,
            self.scale_factor_drift * specific_force_g,
            self.bias_g_per_k * away_k,
            self.bias_drift_g,
            self.converter_nonlinearity * full_scale_g,
        ];
        terms
            .iter()
            .fold(T::zero(), |sum, term| sum + *term * *term)
    }
}
