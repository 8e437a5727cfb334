//! The master clock, what it allows, and the digital filter that runs on it.

use core::ops::RangeInclusive;

/// Modulator cycles a conversion. The modulator runs at half of the master clock.
///
/// Up to 1024 the filter is sinc3; from 2048 on it is a sinc3 of 1024 and a sinc1 (a mean) of 2 to 16 of its outputs,
/// so that its droop is smaller than that of a sinc3 of the whole ratio (section 8.3.7.1.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "OSR")]
pub enum Oversampling {
    /// 64 kSPS at 8.192 MHz; with four channels or fewer.
    #[doc(alias = "TBM")]
    X64,
    /// 32 kSPS at 8.192 MHz.
    X128,
    /// 16 kSPS at 8.192 MHz.
    X256,
    /// 8 kSPS at 8.192 MHz.
    X512,
    /// 4 kSPS at 8.192 MHz; the state after a reset.
    #[default]
    X1024,
    /// 2 kSPS at 8.192 MHz.
    X2048,
    /// 1 kSPS at 8.192 MHz.
    X4096,
    /// 500 SPS at 8.192 MHz.
    X8192,
    /// 250 SPS at 8.192 MHz. Where the register is described, the data sheets print 16256; everywhere else 16384.
    X16384,
}

/// The highest ratio that the sinc3 filter has itself.
const SINC3_HIGHEST: u32 = 1024;

/// Modulator cycles after a start before the filters are fed: 256 + 44 (section 8.4.2).
const START_CYCLES: u32 = 300;

impl Oversampling {
    /// Every ratio, from the fastest on.
    pub const ALL: [Self; 9] = [
        Self::X64,
        Self::X128,
        Self::X256,
        Self::X512,
        Self::X1024,
        Self::X2048,
        Self::X4096,
        Self::X8192,
        Self::X16384,
    ];

    /// Modulator cycles a conversion.
    pub const fn ratio(self) -> u32 {
        64 << self as u32
    }

    /// Cycles of the master clock a conversion, without global chop.
    pub const fn clock_cycles(self) -> u32 {
        2 * self.ratio()
    }

    /// The part of the ratio that the sinc3 filter has.
    pub const fn sinc3_ratio(self) -> u32 {
        if self.ratio() < SINC3_HIGHEST {
            self.ratio()
        } else {
            SINC3_HIGHEST
        }
    }

    /// How many outputs of the sinc3 filter are averaged; 1 where there is no such stage.
    pub const fn sinc1_ratio(self) -> u32 {
        self.ratio() / self.sinc3_ratio()
    }

    /// Delay of the filter in cycles of the master clock, which are halves of modulator cycles: a conversion is of the
    /// time that much before the end of its period. Derived: the centre of the response, 3 (R - 1) + (M - 1) R with the
    /// ratios R of the sinc3 and M of the sinc1.
    pub const fn delay_clock_cycles(self) -> u32 {
        let (r, m) = (self.sinc3_ratio(), self.sinc1_ratio());
        3 * (r - 1) + (m - 1) * r
    }

    /// Cycles of the master clock from a reset or a synchronisation until a conversion holds nothing from before.
    ///
    /// Derived from section 8.4.2 (t_SETTLE3): 300 modulator cycles, three periods of the sinc3 and the further ones of
    /// the sinc1. Table 8-3 gives less, the first output of the fast-settling filter that serves after a reset.
    pub const fn settling_clock_cycles(self) -> u32 {
        2 * (START_CYCLES + self.ratio() + 2 * self.sinc3_ratio())
    }

    /// The fields TBM and OSR of the register CLOCK.
    pub(crate) const fn bits(self) -> u16 {
        match self {
            Self::X64 => 1 << 5,
            _ => (self as u16 - 1) << 2,
        }
    }

    pub(crate) const fn from_bits(clock: u16) -> Self {
        if clock & (1 << 5) != 0 {
            return Self::X64;
        }
        match (clock >> 2) & 0b111 {
            0 => Self::X128,
            1 => Self::X256,
            2 => Self::X512,
            3 => Self::X1024,
            4 => Self::X2048,
            5 => Self::X4096,
            6 => Self::X8192,
            _ => Self::X16384,
        }
    }
}

/// How much current the converter may draw, and with it which clocks it takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "PWR")]
pub enum PowerMode {
    /// Up to 2.08 MHz.
    #[doc(alias = "VLP")]
    VeryLow = 0,
    /// Up to 4.15 MHz.
    #[doc(alias = "LP")]
    Low = 1,
    /// Up to 8.4 MHz; the state after a reset.
    #[default]
    #[doc(alias = "HR")]
    HighResolution = 2,
}

impl PowerMode {
    /// The master clocks that the data sheet allows, Hz, at a duty cycle of 40 % to 60 % (section 6.3). The six- and
    /// eight-channel converters take 8.2 MHz at the most where a gain is above 2.
    pub const fn clocks_hz(self, channels: usize, highest_gain: u8) -> RangeInclusive<u32> {
        let highest = match self {
            Self::VeryLow => 2_080_000,
            Self::Low => 4_150_000,
            Self::HighResolution if channels > 4 && highest_gain > 2 => 8_200_000,
            Self::HighResolution => 8_400_000,
        };
        300_000..=highest
    }

    pub(crate) const fn from_bits(clock: u16) -> Self {
        match clock & 0b11 {
            0 => Self::VeryLow,
            1 => Self::Low,
            _ => Self::HighResolution,
        }
    }
}

/// Lengths of the pulse on SYNC/RESET, in cycles of the master clock (section 6.6).
pub(crate) mod pulse {
    /// A reset takes 2048 cycles at least; a quarter more for the tolerance of both clocks.
    pub const RESET_CYCLES: u32 = 2560;
    /// A synchronisation takes 1 to 2047 cycles. Few, so that a delay that takes longer does not become a reset.
    pub const SYNCHRONISE_CYCLES: u32 = 16;
    /// From the end of a reset to the first frame, over t_REGACQ = 5 us.
    pub const REGISTERS_READY_US: u32 = 10;

    /// How long that many cycles last, ns, rounded up.
    pub const fn ns(cycles: u32, clock_hz: u32) -> u32 {
        let clock_hz = if clock_hz == 0 { 1 } else { clock_hz as u64 };
        let ns = (cycles as u64 * 1_000_000_000).div_ceil(clock_hz);
        if ns > u32::MAX as u64 {
            u32::MAX
        } else {
            ns as u32
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The response of a moving mean of `length` after that of `before`.
    fn average(before: &[f64], length: usize, spread: usize) -> Vec<f64> {
        let mut after = vec![0.0; before.len() + (length - 1) * spread];
        for (n, value) in before.iter().enumerate() {
            for k in 0..length {
                after[n + k * spread] += value / length as f64;
            }
        }
        after
    }

    #[test]
    fn delay_is_the_centroid_of_the_filters_response() {
        for oversampling in Oversampling::ALL {
            let r = oversampling.sinc3_ratio() as usize;
            let mut response = vec![1.0];
            for _ in 0..3 {
                response = average(&response, r, 1);
            }
            response = average(&response, oversampling.sinc1_ratio() as usize, r);
            let centroid: f64 = response.iter().enumerate().map(|(n, h)| n as f64 * h).sum();
            let delay = f64::from(oversampling.delay_clock_cycles()) / 2.0;
            assert!((centroid - delay).abs() < 1e-6, "{oversampling:?}");
            // Table 8-3 has the ratios of both stages.
            assert_eq!(r as u32 * oversampling.sinc1_ratio(), oversampling.ratio());
        }
    }

    #[test]
    fn settling_at_1024_is_that_of_table_8_8() {
        assert_eq!(Oversampling::X1024.settling_clock_cycles(), 2 * 3372);
    }

    #[test]
    fn ratios_come_back_from_their_bits() {
        for oversampling in Oversampling::ALL {
            assert_eq!(Oversampling::from_bits(oversampling.bits()), oversampling);
        }
        assert_eq!(Oversampling::X1024.bits(), 0b011 << 2);
        assert_eq!(Oversampling::X16384.bits(), 0b111 << 2);
    }

    #[test]
    fn a_pulse_is_never_shorter_than_asked() {
        assert_eq!(pulse::ns(2560, 8_192_000), 312_500);
        assert_eq!(pulse::ns(1, 8_192_000), 123);
        assert_eq!(pulse::ns(1, 0), 1_000_000_000);
    }
}
