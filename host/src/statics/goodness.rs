//! Whether static readings scatter as their stated uncertainties say.

use shared::identify::static_test::Fit;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability of a chi-square at least as large as that of a fit, if the stated uncertainties hold; none without degrees
/// of freedom.
pub fn p_value(fit: &Fit<f64>) -> Option<f64> {
    let distribution = ChiSquared::new(fit.degrees_of_freedom() as f64).ok()?;
    Some(distribution.sf(fit.chi2))
}

/// A chi-square less likely than this, on either side, is told.
pub const SUSPICIOUS: f64 = 1e-3;

/// What an improbable chi-square of static readings means, if it is improbable.
pub fn scatter_warning(p_value: Option<f64>) -> Option<&'static str> {
    match p_value? {
        p if p < SUSPICIOUS => Some(
            "WARNING: the static readings scatter more than the uncertainties stated in campaign.toml allow; those of the \
             coefficients, and of what they predict, are too small.",
        ),
        p if p > 1.0 - SUSPICIOUS => Some(
            "WARNING: the static readings scatter less than stated in campaign.toml; the uncertainties are too large.",
        ),
        _ => None,
    }
}
