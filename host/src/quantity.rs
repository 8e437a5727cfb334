//! A number with its standard uncertainty, as programs and people want to see it.

use std::fmt;

use serde::{Deserialize, Serialize};

/// An estimate and its standard uncertainty (coverage factor 1), in JSON `{"value": .., "sigma": ..}`. Both
/// are `None` where the measurements do not determine the quantity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    /// The estimate.
    pub value: Option<f64>,
    /// Its standard uncertainty, not negative.
    pub sigma: Option<f64>,
}

impl Quantity {
    /// A quantity that the measurements do not determine.
    pub const UNDETERMINED: Self = Self {
        value: None,
        sigma: None,
    };

    /// An estimate with its standard uncertainty, in the same unit.
    pub const fn new(value: f64, sigma: f64) -> Self {
        Self {
            value: Some(value),
            sigma: Some(sigma),
        }
    }

    /// Estimate and standard uncertainty, if both are known.
    pub fn known(&self) -> Option<(f64, f64)> {
        self.value.zip(self.sigma)
    }

    /// The same in a unit `factor` times smaller.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            value: self.value.map(|v| v * factor),
            sigma: self.sigma.map(|s| s * factor),
        }
    }
}

/// Concise notation of the GUM, 7.2.2: `-2.561(20)`, the parentheses holding the standard uncertainty in
/// units of the last digits; two significant digits of it. A very small or large number has an exponent,
/// `1.4142(31)e-9`.
impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((value, sigma)) = self.known() else {
            return f.pad("undetermined");
        };
        f.pad(&unsigned_zero(concise(value, sigma)))
    }
}

/// A number with so many decimals, without a sign where it rounds to zero.
pub fn fixed(value: f64, decimals: usize) -> String {
    unsigned_zero(format!("{value:.decimals$}"))
}

/// A number with so many significant digits and no zeros behind them.
pub fn significant(value: f64, digits: usize) -> String {
    let rounded: f64 = format!("{value:.*e}", digits.saturating_sub(1))
        .parse()
        .unwrap_or(value);
    unsigned_zero(crate::error::decimal(rounded))
}

/// Without the sign of a number whose digits before the uncertainty are all zero.
fn unsigned_zero(text: String) -> String {
    let digits = text.split(['(', 'e']).next().unwrap_or_default();
    match text.strip_prefix('-') {
        Some(rest) if !digits.contains(|c: char| ('1'..='9').contains(&c)) => rest.to_owned(),
        _ => text,
    }
}

fn concise(value: f64, sigma: f64) -> String {
    if !(value.is_finite() && sigma.is_finite() && sigma > 0.0) {
        return format!("{value}");
    }
    let magnitude = value.abs().max(sigma).log10().floor() as i32;
    if !(-4..=6).contains(&magnitude) {
        let unit = 10f64.powi(magnitude);
        return format!("{}e{magnitude}", concise(value / unit, sigma / unit));
    }
    // Rounding to two digits can carry into a third: 9.96 -> 10.
    let rounded: f64 = format!("{sigma:.1e}").parse().unwrap_or(sigma);
    let last_digit = rounded.log10().floor() as i32 - 1;
    if last_digit >= 0 {
        let unit = 10f64.powi(last_digit);
        return format!("{:.0}({:.0})", (value / unit).round() * unit, rounded);
    }
    let decimals = -last_digit as usize;
    let digits = (rounded * 10f64.powi(-last_digit)).round();
    match last_digit {
        // 301.5(1.5): a decimal point within the parentheses keeps the meaning plain.
        -1 => format!("{value:.1}({rounded:.1})"),
        _ => format!("{value:.decimals$}({digits:.0})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn concise_notation_has_two_digits_of_uncertainty() {
        let cases = [
            (-2.5613e0, 0.0204, "-2.561(20)"),
            (301.52, 1.48, "301.5(1.5)"),
            (3015.2, 14.8, "3015(15)"),
            (30152.0, 148.0, "30150(150)"),
            (0.0, 0.5, "0.00(50)"),
            (1.0, 0.0996, "1.00(10)"),
            (1.234, 0.00995, "1.234(10)"),
            (1.4142e-9, 3.1e-12, "1.4142(31)e-9"),
            (0.2, 162.0, "0(160)"),
            (1.2e-6, 2.4e-4, "0.00000(24)"),
            (-1.2e-6, 2.4e-4, "0.00000(24)"),
            (-2e4, 4.3e6, "0(4300000)"),
            (-1.0, 4.3e9, "0.0(4.3)e9"),
        ];
        for (value, sigma, expected) in cases {
            assert_eq!(Quantity::new(value, sigma).to_string(), expected);
        }
        assert_eq!(format!("{:>13}", Quantity::UNDETERMINED), " undetermined");
    }

    #[test]
    fn zero_has_no_sign_and_a_level_only_the_digits_that_count() {
        assert_eq!(fixed(-0.004, 2), "0.00");
        assert_eq!(fixed(-0.006, 2), "-0.01");
        assert_eq!(significant(2.000_000_000_4, 4), "2");
        assert_eq!(significant(-0.0, 4), "0");
        assert_eq!(significant(12.345_6, 4), "12.35");
    }

    #[test]
    fn an_undetermined_quantity_is_null_in_json() {
        let json = serde_json::to_string(&Quantity::UNDETERMINED).unwrap();
        assert_eq!(json, r#"{"value":null,"sigma":null}"#);
        let back: Quantity = serde_json::from_str(&json).unwrap();
        assert_eq!(back, Quantity::UNDETERMINED);
    }
}
