//! What lies between the instrument's output and the converter's input: a divider, an amplifier, or nothing.

use std::fmt;

/// A divider followed by an amplifier. The default is neither: the output goes straight to the converter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontEnd {
    /// The instrument's output is divided by this, > 0.
    pub divider: f64,
    /// And multiplied by this, > 0.
    pub gain: f64,
}

impl Default for FrontEnd {
    fn default() -> Self {
        Self {
            divider: 1.0,
            gain: 1.0,
        }
    }
}

impl FrontEnd {
    /// The instrument's output, V, for a voltage at the converter.
    pub fn output_v(&self, converter_v: f64) -> f64 {
        self.divider * converter_v / self.gain
    }

    /// The voltage at the converter for an output of the instrument, V; as well for what is in proportion to it, a
    /// scale factor or a noise.
    pub fn converter_v(&self, output_v: f64) -> f64 {
        output_v / self.divider * self.gain
    }
}

impl fmt::Display for FrontEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::default() {
            return f.write_str("none, the output goes straight to the converter");
        }
        write!(f, "divider {}, gain {}", self.divider, self.gain)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_and_converter_are_each_others_inverse() {
        let front_end = FrontEnd {
            divider: 8.0,
            gain: 2.0,
        };
        assert_eq!(front_end.converter_v(1.2), 0.3);
        assert_eq!(front_end.output_v(0.3), 1.2);
        assert_eq!(FrontEnd::default().output_v(0.7), 0.7);
    }
}
