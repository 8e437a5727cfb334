//! Single settings of a channel or of the whole converter.

use core::fmt;

/// Voltage of the internal reference, V: full scale at gain 1.
pub const REFERENCE_V: f64 = 1.2;

/// Full scale at gain 1 over an external reference, which is 1.1 V to 1.3 V (of the six- and eight-channel converters).
pub const EXTERNAL_REFERENCE_SHARE: f64 = 0.96;

/// A setting that no converter takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OutOfRange {
    /// A phase of so many modulator cycles, which is not within -512 to 511.
    Phase(i16),
    /// An offset of so many codes, which is not within 24 bits with sign.
    Offset(i32),
    /// A gain calibration of so many steps, which does not fit into 24 bits.
    GainCalibration(u32),
    /// A threshold of so many codes, which does not fit into 24 bits.
    Threshold(u32),
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Phase(cycles) => write!(f, "phase {cycles} is not within -512 to 511"),
            Self::Offset(codes) => write!(f, "offset {codes} is not within 24 bits with sign"),
            Self::GainCalibration(steps) => {
                write!(f, "gain calibration {steps} is not within 24 bits")
            }
            Self::Threshold(codes) => write!(f, "threshold {codes} is not within 24 bits"),
        }
    }
}

impl core::error::Error for OutOfRange {}

/// Gain of a channel; full scale is the reference voltage over it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "PGAGAIN")]
pub enum Gain {
    /// 1
    #[default]
    X1 = 0,
    /// 2
    X2 = 1,
    /// 4
    X4 = 2,
    /// 8
    X8 = 3,
    /// 16
    X16 = 4,
    /// 32
    X32 = 5,
    /// 64
    X64 = 6,
    /// 128
    X128 = 7,
}

impl Gain {
    /// The factor.
    pub const fn factor(self) -> u8 {
        1 << self as u8
    }

    /// Volts that a code stands for, with the internal reference.
    pub const fn v_per_code(self) -> f64 {
        REFERENCE_V / ((self.factor() as u32) << 23) as f64
    }

    pub(crate) const fn from_bits(bits: u16) -> Self {
        match bits & 0b111 {
            0 => Self::X1,
            1 => Self::X2,
            2 => Self::X4,
            3 => Self::X8,
            4 => Self::X16,
            5 => Self::X32,
            6 => Self::X64,
            _ => Self::X128,
        }
    }
}

/// When a channel samples, in modulator cycles against phase 0: later where positive. Disregarded while chopping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Phase(i16);

impl Phase {
    /// So many modulator cycles, -512 to 511. The converter clips what is beyond half of the oversampling ratio.
    ///
    /// # Errors
    /// Out of range.
    pub const fn new(cycles: i16) -> Result<Self, OutOfRange> {
        if cycles >= -512 && cycles <= 511 {
            Ok(Self(cycles))
        } else {
            Err(OutOfRange::Phase(cycles))
        }
    }

    /// Modulator cycles.
    pub const fn cycles(self) -> i16 {
        self.0
    }

    /// True when the converter takes it without clipping at that oversampling ratio (table 8-5).
    pub const fn fits(self, ratio: u32) -> bool {
        let half = if ratio < 1024 { ratio as i16 / 2 } else { 512 };
        -half <= self.0 && self.0 < half
    }

    pub(crate) const fn from_bits(channel_cfg: u16) -> Self {
        Self(channel_cfg as i16 >> 6)
    }
}

/// What a channel measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "MUX")]
pub enum Input {
    /// Its pins.
    #[default]
    Pins = 0,
    /// Nothing: its inputs are shorted, away from the pins.
    Shorted = 1,
    /// 2/15 of full scale, 160 mV at gain 1. Cannot be measured while chopping.
    PositiveTest = 2,
    /// The contrary.
    NegativeTest = 3,
}

/// Codes that are subtracted from those of a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "OCAL")]
pub struct Offset(i32);

impl Offset {
    /// So many codes.
    ///
    /// # Errors
    /// Not within 24 bits with sign.
    pub const fn new(codes: i32) -> Result<Self, OutOfRange> {
        if codes >= -(1 << 23) && codes < 1 << 23 {
            Ok(Self(codes))
        } else {
            Err(OutOfRange::Offset(codes))
        }
    }

    /// Codes.
    pub const fn codes(self) -> i32 {
        self.0
    }

    /// The registers CHn_OCAL_MSB and CHn_OCAL_LSB.
    pub const fn bits(self) -> [u16; 2] {
        split(self.0 as u32)
    }
}

/// What the codes of a channel are multiplied by, in steps of 2^-23.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "GCAL")]
pub struct GainCalibration(u32);

impl Default for GainCalibration {
    fn default() -> Self {
        Self::ONE
    }
}

impl GainCalibration {
    /// No change; the state after a reset.
    pub const ONE: Self = Self(1 << 23);

    /// So many 2^-23, from 0 to just below 2.
    ///
    /// # Errors
    /// Not within 24 bits.
    pub const fn new(steps: u32) -> Result<Self, OutOfRange> {
        if steps < 1 << 24 {
            Ok(Self(steps))
        } else {
            Err(OutOfRange::GainCalibration(steps))
        }
    }

    /// Steps of 2^-23.
    pub const fn steps(self) -> u32 {
        self.0
    }

    /// The registers CHn_GCAL_MSB and CHn_GCAL_LSB.
    pub const fn bits(self) -> [u16; 2] {
        split(self.0)
    }
}

macro_rules! field {
    ($(#[$attribute:meta])* $name:ident, $mask:literal: $($(#[$variant_attribute:meta])* $variant:ident = $bits:literal),+) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[expect(missing_docs, reason = "the variants say their number")]
        pub enum $name {
            $($(#[$variant_attribute])* $variant = $bits),+
        }

        impl $name {
            pub(crate) const fn from_bits(bits: u16) -> Self {
                let variants = [$(Self::$variant),+];
                variants[(bits & $mask) as usize]
            }
        }
    };
}

field! {
    /// Modulator cycles between swapping the inputs and measuring, while chopping.
    #[doc(alias = "GC_DLY")]
    ChopDelay, 0xF:
    Cycles2 = 0, Cycles4 = 1, Cycles8 = 2, Cycles16 = 3, Cycles32 = 4, Cycles64 = 5, Cycles128 = 6, Cycles256 = 7,
    Cycles512 = 8, Cycles1024 = 9, Cycles2048 = 10, Cycles4096 = 11, Cycles8192 = 12, Cycles16384 = 13,
    Cycles32768 = 14, Cycles65536 = 15
}

impl ChopDelay {
    /// After a reset.
    pub const RESET: Self = Self::Cycles16;

    /// Modulator cycles.
    pub const fn cycles(self) -> u32 {
        2 << self as u32
    }
}

field! {
    /// How many conversions have to exceed the threshold.
    #[doc(alias = "CD_NUM")]
    DetectCount, 0b111:
    Of1 = 0, Of2 = 1, Of4 = 2, Of8 = 3, Of16 = 4, Of32 = 5, Of64 = 6, Of128 = 7
}

field! {
    /// Of how many, at 2.7 kSPS.
    #[doc(alias = "CD_LEN")]
    DetectLength, 0b111:
    Of128 = 0, Of256 = 1, Of512 = 2, Of768 = 3, Of1280 = 4, Of1792 = 5, Of2560 = 6, Of3584 = 7
}

/// Detection of a current while standing by: DRDY falls when enough conversions exceed the threshold (section 8.4.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CurrentDetect {
    /// All enabled channels have to show it, not any.
    #[doc(alias = "CD_ALLCH")]
    pub all_channels: bool,
    /// How many conversions have to exceed the threshold.
    pub count: DetectCount,
    /// Of how many.
    pub length: DetectLength,
    threshold: u32,
}

impl CurrentDetect {
    /// By one conversion of 128 in any channel that is more than so many codes from zero.
    ///
    /// # Errors
    /// Not within 24 bits.
    #[doc(alias = "CD_TH")]
    pub const fn new(threshold: u32) -> Result<Self, OutOfRange> {
        if threshold < 1 << 24 {
            Ok(Self {
                all_channels: false,
                count: DetectCount::Of1,
                length: DetectLength::Of128,
                threshold,
            })
        } else {
            Err(OutOfRange::Threshold(threshold))
        }
    }

    /// Codes.
    pub const fn threshold(self) -> u32 {
        self.threshold
    }

    pub(crate) const fn bits(self) -> u16 {
        (self.all_channels as u16) << 7 | (self.count as u16) << 4 | (self.length as u16) << 1
    }

    pub(crate) const fn from_bits(cfg: u16, threshold: u32) -> Self {
        Self {
            all_channels: cfg & 1 << 7 != 0,
            count: DetectCount::from_bits(cfg >> 4),
            length: DetectLength::from_bits(cfg >> 1),
            threshold: threshold & 0xFF_FFFF,
        }
    }
}

/// The filter against direct voltage: a high pass of first order with the coefficient a = 2^-exponent (table 8-4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "DCBLOCK")]
pub struct DcBlock(u8);

impl DcBlock {
    /// With a = 2^-exponent, the exponent from 2 (181 Hz at 4 kSPS) to 16 (9.7 mHz); `None` beyond.
    pub const fn new(exponent: u8) -> Option<Self> {
        match exponent {
            2..=16 => Some(Self(exponent)),
            _ => None,
        }
    }

    /// The exponent of a = 2^-exponent.
    pub const fn exponent(self) -> u8 {
        self.0
    }

    /// The field of the register THRSHLD_LSB.
    pub(crate) const fn bits(self) -> u16 {
        self.0 as u16 - 1
    }

    /// From the register THRSHLD_LSB; `None` where the filter is off.
    pub const fn from_bits(threshold_lsb: u16) -> Option<Self> {
        match (threshold_lsb & 0xF) as u8 {
            0 => None,
            field => Some(Self(field + 1)),
        }
    }
}

/// A number of 24 bits as two registers: its upper 16 bits, and its lower 8 in the upper byte.
pub(crate) const fn split(number: u32) -> [u16; 2] {
    [(number >> 8) as u16, (number << 8) as u16 & 0xFF00]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_fit_as_table_8_5_says() {
        for (ratio, lowest, highest) in [
            (64, -32, 31),
            (128, -64, 63),
            (1024, -512, 511),
            (16384, -512, 511),
        ] {
            let fits = |cycles| Phase::new(cycles).is_ok_and(|phase| phase.fits(ratio));
            assert!(fits(lowest) && fits(highest));
            assert!(!fits(lowest - 1) && !fits(highest + 1));
        }
    }

    #[test]
    fn numbers_of_24_bits_are_split_as_the_registers_hold_them() {
        assert_eq!(Offset::new(-1).unwrap().bits(), [0xFFFF, 0xFF00]);
        assert_eq!(Offset::new(0x12_3456).unwrap().bits(), [0x1234, 0x5600]);
        assert_eq!(GainCalibration::ONE.bits(), [0x8000, 0x0000]);
        assert_eq!(
            GainCalibration::new(0xFF_FFFF).unwrap().bits(),
            [0xFFFF, 0xFF00]
        );
        assert_eq!(Offset::new(1 << 23), Err(OutOfRange::Offset(1 << 23)));
        assert!(GainCalibration::new(1 << 24).is_err() && CurrentDetect::new(1 << 24).is_err());
    }

    #[test]
    fn a_code_is_the_fraction_of_full_scale_of_equation_10() {
        assert!((Gain::X1.v_per_code() - 2.4 / f64::from(1 << 24)).abs() < 1e-20);
        assert!((Gain::X128.v_per_code() * f64::from(1 << 23) - 9.375e-3).abs() < 1e-15);
    }

    #[test]
    fn the_high_pass_is_off_only_with_a_field_of_zero() {
        assert_eq!(DcBlock::from_bits(0xFF00), None);
        for exponent in 2..=16 {
            let filter = DcBlock::new(exponent).unwrap();
            assert_eq!(DcBlock::from_bits(filter.bits()), Some(filter));
        }
        assert_eq!((DcBlock::new(1), DcBlock::new(17)), (None, None));
    }
}
