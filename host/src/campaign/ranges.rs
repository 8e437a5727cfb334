//! Ranges at the door: what a quantity of a campaign's files, or an option of the command, can be.
//!
//! They are chosen, physical and generous: no bench of any laboratory comes near an end, and no number within makes an
//! intermediate result overflow or vanish (squares and products of any three stay far inside a double). What is outside
//! is another unit, or damage.

use std::fmt;

use crate::error::{Problem, decimal};

/// What a quantity can be, both ends allowed.
#[derive(Debug)]
pub struct Range {
    /// What is measured.
    pub quantity: &'static str,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// Least value.
    pub least: f64,
    /// Greatest value.
    pub greatest: f64,
    /// Smallest magnitude beside zero.
    pub smallest: f64,
    /// Whether it can be zero.
    pub zero: bool,
}

/// Magnitude below which a signed number is damage: far below what a sum of doubles leaves of zero.
const NEARLY_ZERO: f64 = 1e-30;

impl Range {
    const fn positive(
        quantity: &'static str,
        unit: &'static str,
        least: f64,
        greatest: f64,
    ) -> Self {
        Self {
            quantity,
            unit,
            least,
            greatest,
            smallest: least,
            zero: false,
        }
    }

    const fn zero_or(
        quantity: &'static str,
        unit: &'static str,
        smallest: f64,
        greatest: f64,
    ) -> Self {
        Self {
            quantity,
            unit,
            least: 0.0,
            greatest,
            smallest,
            zero: true,
        }
    }

    const fn either_sign(
        quantity: &'static str,
        unit: &'static str,
        smallest: f64,
        greatest: f64,
    ) -> Self {
        Self {
            quantity,
            unit,
            least: -greatest,
            greatest,
            smallest,
            zero: false,
        }
    }

    const fn between(
        quantity: &'static str,
        unit: &'static str,
        least: f64,
        greatest: f64,
    ) -> Self {
        Self {
            quantity,
            unit,
            least,
            greatest,
            smallest: NEARLY_ZERO,
            zero: true,
        }
    }

    /// The value, if it lies within.
    ///
    /// # Errors
    /// Not finite, outside, or so small that only damage makes it.
    pub fn check(&'static self, value: f64) -> Result<f64, Problem> {
        let Self {
            unit,
            least,
            greatest,
            smallest,
            zero,
            ..
        } = *self;
        if !value.is_finite() {
            return Err(Problem::NotFinite(value.to_string()));
        }
        if !(least..=greatest).contains(&value) {
            return Err(Problem::OutOfRange {
                value,
                low: least,
                high: greatest,
                unit,
            });
        }
        if value.abs() < smallest && !(zero && value == 0.0) {
            return Err(Problem::TooSmall {
                value,
                smallest,
                zero,
                unit,
            });
        }
        Ok(value)
    }

    /// The number that `text` is, if it lies within.
    ///
    /// # Errors
    /// No number, or one outside.
    pub fn parse(&'static self, text: &str) -> Result<f64, Problem> {
        match text.trim().parse() {
            Ok(value) => self.check(value),
            Err(_) => Err(Problem::NotANumber(text.into())),
        }
    }
}

impl fmt::Display for Range {
    /// `level: 1e-6 to 1e4 g`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            quantity,
            unit,
            least,
            greatest,
            smallest,
            zero,
        } = self;
        let [least, greatest, smallest] = [least, greatest, smallest].map(|x| decimal(*x));
        write!(f, "{quantity}: ")?;
        match (zero, self.least < 0.0) {
            (true, false) => write!(f, "0 or {smallest} to {greatest}")?,
            (false, true) => write!(f, "{smallest} to {greatest}, or as much negative")?,
            _ => write!(f, "{least} to {greatest}")?,
        }
        if unit.is_empty() {
            return Ok(());
        }
        write!(f, " {unit}")
    }
}

macro_rules! ranges {
    ($($name:ident = $make:ident($($argument:expr),*);)*) => {
        $(/// A row of [`ALL`].
        pub static $name: Range = Range::$make($($argument),*);)*

        /// All ranges, for documents.
        pub static ALL: &[&Range] = &[$(&$name),*];
    };
}

ranges! {
    TIME = between("time", "s", -1e11, 1e11);
    DURATION = positive("duration", "s", 1e-3, 1e6);
    TEMPERATURE = between("temperature", "C", -100.0, 300.0);
    ANGLE = between("dial or mount angle", "deg", -3600.0, 3600.0);
    SPECIFIC_FORCE = between("gravity on an axis", "g", -1e3, 1e3);
    LOCAL_GRAVITY = positive("local gravity", "g", 0.9, 1.1);
    COSINE = between("component of a direction", "", -2.0, 2.0);
    LEVEL = positive("level of a vibration", "g", 1e-6, 1e4);
    FREQUENCY = positive("frequency", "Hz", 1e-3, 1e6);
    // Volts, or the counts of a 24-bit converter.
    OUTPUT = between("output", "V", -1e7, 1e7);
    OUTPUT_SIGMA = positive("standard uncertainty of an output", "V", 1e-12, 1e7);
    DRIFT = between("drift", "V/s", -1e7, 1e7);
    DRIFT_SIGMA = positive("standard uncertainty of a drift", "V/s", 1e-15, 1e7);
    RMS = zero_or("reference's rms", "g", 1e-12, 1e4);
    SKEWNESS = between("skewness", "", -1e3, 1e3);
    KURTOSIS = zero_or("kurtosis", "", 1e-3, 1e6);
    // Beyond 1 by what rounding adds.
    CORRELATION = between("correlation", "", -1.0 - 1e-6, 1.0 + 1e-6);
    SCALE_FACTOR = either_sign("scale factor", "V/g", 1e-9, 1e7);
    FULL_SCALE = positive("full scale", "g", 1e-3, 1e5);
    ARCSEC_SIGMA = zero_or("standard uncertainty of an angle", "arcsec", 1e-6, 36_000.0);
    SAMPLE_RATE = positive("sample rate", "Hz", 1e-3, 1e9);
    FACTOR = positive("divider or gain", "", 1e-6, 1e6);
    DEGREES_OF_FREEDOM = positive("degrees of freedom", "", 1e-3, 1e9);
    RELATIVE_SIGMA = zero_or("relative standard uncertainty", "", 1e-12, 1.0);
    G_SIGMA = zero_or("standard uncertainty or noise", "g", 1e-12, 1e3);
    DENSITY = positive("spectral density", "g^2/Hz", 1e-15, 1e6);
    MISSION_LEVEL = zero_or("level of a mission", "g", 1e-6, 1e4);
    VRE_LIMIT = positive("limit of the vibration error", "g", 1e-12, 1e3);
    // Options of the command.
    DIRECTION = between("component of a direction of any length", "", -1e6, 1e6);
    RISK = positive("risk of a judgement", "", 1e-9, 0.5);
    PRIOR_SIGMA = positive("what a coefficient can be beforehand", "", 1e-12, 1e3);
    READING_NOISE = positive("noise of a reading", "g", 1e-15, 1.0);
    ENOUGH = positive("share of an error that is enough", "", 1e-6, 1e3);
    RECORD_SCALE = either_sign("scale of a record", "1/g", 1e-12, 1e12);
    REFERENCE_SCALE = positive("scale of the reference at the converter", "V/g", 1e-9, 1e3);
    DISTORTION = zero_or("distortion of the reference", "", 1e-9, 1.0);
    BIAS_SENSITIVITY = between("sensitivity of the bias", "g/C", -1e3, 1e3);
    PARTS_PER_MILLION = zero_or("change or nonlinearity", "ppm", 1e-6, 1e6);
    BIAS_CHANGE = zero_or("change of the bias", "microg", 1e-6, 1e9);
    STRENGTH = positive("strength of an effect", "", 1e-6, 1e3);
    VISIBILITY = positive("visibility of an effect", "", 1e-3, 1e6);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_absurd_is_within_any_range() {
        for range in ALL {
            for value in [
                5e-324,
                -5e-324,
                1e160,
                -1e160,
                1e300,
                f64::NAN,
                f64::INFINITY,
            ] {
                assert!(range.check(value).is_err(), "{range}: {value:e}");
            }
            for value in [range.least, range.greatest, range.smallest] {
                assert!(range.check(value).is_ok(), "{range}: {value:e}");
            }
            assert_eq!(range.check(0.0).is_ok(), range.zero, "{range}");
        }
    }
}
