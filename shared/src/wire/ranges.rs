//! What a figure that comes over the link can be.
//!
//! The ranges are chosen, physical and generous: no accelerometer and no bench comes near an end. What is outside is another
//! unit, or damage. They hold for what comes over the link and for what the memory held.

/// Figures of one kind, both ends allowed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    least: f64,
    greatest: f64,
}

impl Range {
    const fn new(least: f64, greatest: f64) -> Self {
        Self { least, greatest }
    }

    /// True within; not of what is not a number.
    pub(super) fn has(self, value: impl Into<f64>) -> bool {
        (self.least..=self.greatest).contains(&value.into())
    }
}

/// Scale factor, V/g; that of the reference may have either sign.
pub(super) const SCALE_FACTOR_V_PER_G: Range = Range::new(1e-9, 1e7);

/// Every other coefficient of (1): a bias, g, or what a power of 1 g adds, g.
pub(super) const COEFFICIENT: Range = Range::new(-1e3, 1e3);

/// Variance of a coefficient: the square of its range.
pub(super) const VARIANCE: Range = Range::new(0.0, 1e6);

/// Output at zero specific force, V.
pub(super) const ZERO_V: Range = Range::new(-1e3, 1e3);

/// Relative standard uncertainty.
pub(super) const RELATIVE_SIGMA: Range = Range::new(0.0, 1.0);

/// Standard uncertainty of a bias, g, or its change, g/K.
pub(super) const BIAS_SIGMA_G: Range = Range::new(0.0, 1e3);

/// Temperature, degrees Celsius.
pub(super) const TEMPERATURE_C: Range = Range::new(-100.0, 300.0);
