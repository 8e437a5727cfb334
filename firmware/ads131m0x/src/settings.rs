//! All settings of a converter together, and whether it takes them.

use core::fmt;

use crate::clock::{Oversampling, PowerMode};
use crate::registers::{
    Cfg, ChannelCfg, Clock, Mode, Register, gain_bits, last_writable_address, threshold_bits,
};
use crate::status::Status;
use crate::values::{ChopDelay, CurrentDetect, DcBlock, Gain, GainCalibration, Offset};

/// How a channel is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Channel {
    /// It converts.
    pub enabled: bool,
    /// Of the amplifier.
    pub gain: Gain,
    /// Phase, input, and whether the filter against direct voltage leaves it alone.
    pub cfg: ChannelCfg,
    /// Subtracted from its codes.
    pub offset: Offset,
    /// Multiplied with its codes after that.
    pub gain_calibration: GainCalibration,
}

impl Channel {
    /// After a reset.
    pub const RESET: Self = Self {
        enabled: true,
        gain: Gain::X1,
        cfg: ChannelCfg::from_bits(0),
        offset: match Offset::new(0) {
            Ok(none) => none,
            Err(_) => unreachable!(),
        },
        gain_calibration: GainCalibration::ONE,
    };

    /// What [`Register::ChannelCfg`] and the four calibration registers of a channel hold.
    pub const fn registers(&self, channel: u8) -> [(Register, u16); 5] {
        let ([offset, offset_low], [gain, gain_low]) =
            (self.offset.bits(), self.gain_calibration.bits());
        [
            (Register::ChannelCfg(channel), self.cfg.bits()),
            (Register::OffsetMsb(channel), offset),
            (Register::OffsetLsb(channel), offset_low),
            (Register::GainMsb(channel), gain),
            (Register::GainLsb(channel), gain_low),
        ]
    }
}

impl Default for Channel {
    fn default() -> Self {
        Self::RESET
    }
}

/// How a converter is wired and set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings<const CHANNELS: usize> {
    /// Its master clock, Hz.
    #[doc(alias = "CLKIN")]
    pub clock_hz: u32,
    /// Checksums, words, DRDY.
    pub mode: Mode,
    /// Modulator cycles a conversion.
    pub oversampling: Oversampling,
    /// Current.
    pub power: PowerMode,
    /// The oscillator for a crystal is off: the clock comes from outside. With six or eight channels.
    pub crystal_off: bool,
    /// The reference comes from outside. With six or eight channels.
    pub external_reference: bool,
    /// Swap the inputs at each conversion, which frees it of the converter's offset.
    pub global_chop: Option<ChopDelay>,
    /// Watch for a current while standing by.
    pub current_detect: Option<CurrentDetect>,
    /// The filter against direct voltage.
    pub dc_block: Option<DcBlock>,
    /// Of each channel.
    pub channels: [Channel; CHANNELS],
}

impl<const CHANNELS: usize> Default for Settings<CHANNELS> {
    /// After a reset, with the nominal clock.
    fn default() -> Self {
        Self::RESET
    }
}

impl<const CHANNELS: usize> Settings<CHANNELS> {
    /// After a reset, with the nominal clock of 8.192 MHz.
    pub const RESET: Self = Self {
        clock_hz: 8_192_000,
        mode: Mode::RESET,
        oversampling: Oversampling::X1024,
        power: PowerMode::HighResolution,
        crystal_off: false,
        external_reference: false,
        global_chop: None,
        current_detect: None,
        dc_block: None,
        channels: [Channel::RESET; CHANNELS],
    };

    /// Cycles of the master clock a conversion. While chopping, three conversions and a delay make one (equation 8).
    pub const fn clock_cycles(&self) -> u32 {
        match self.global_chop {
            None => self.oversampling.clock_cycles(),
            Some(delay) => 2 * delay.cycles() + 3 * self.oversampling.clock_cycles(),
        }
    }

    /// Conversions a second.
    pub const fn sample_rate_hz(&self) -> f64 {
        self.clock_hz as f64 / self.clock_cycles() as f64
    }

    /// Cycles of the master clock in which a write has changed the flag [`Status::REGISTER_MAP`] for the last time: two
    /// passes over the writable registers, a bit a cycle. The first pass may see the write half done.
    pub const fn register_map_cycles(&self) -> u32 {
        // From the register MODE on.
        let registers = last_writable_address(CHANNELS) as u32 - 1;
        2 * 16 * registers
    }

    /// The status of a converter that is set so and has nothing to tell, unlocked and without new data.
    pub const fn status(&self) -> Status {
        let Mode { format, .. } = self.mode;
        Status((format.polynomial as u16) << 11 | (format.word_length as u16) << 8)
    }

    /// Whether a converter of so many channels takes all that.
    ///
    /// # Errors
    /// The first thing that it does not take.
    pub fn check(&self) -> Result<(), SettingsError> {
        let gains = self.channels.iter().map(|channel| channel.gain.factor());
        let clocks = self.power.clocks_hz(CHANNELS, gains.max().unwrap_or(1));
        if !clocks.contains(&self.clock_hz) {
            return Err(SettingsError::Clock {
                clock_hz: self.clock_hz,
                lowest_hz: *clocks.start(),
                highest_hz: *clocks.end(),
            });
        }
        if CHANNELS > 4 && self.oversampling == Oversampling::X64 {
            return Err(SettingsError::Oversampling);
        }
        if CHANNELS <= 4 && (self.external_reference || self.crystal_off) {
            return Err(SettingsError::SmallPackage);
        }
        for (number, channel) in self.channels.iter().enumerate() {
            if !channel.cfg.phase.fits(self.oversampling.ratio()) {
                return Err(SettingsError::Phase {
                    channel: number as u8,
                    cycles: channel.cfg.phase.cycles(),
                });
            }
        }
        Ok(())
    }

    /// What is written, in order: MODE first, since it changes the frames.
    pub fn registers(&self) -> impl Iterator<Item = (Register, u16)> + '_ {
        let mut enabled = 0;
        for (number, channel) in self.channels.iter().enumerate() {
            enabled |= u8::from(channel.enabled) << (number & 7);
        }
        let clock = Clock {
            enabled,
            crystal_off: self.crystal_off,
            external_reference: self.external_reference,
            oversampling: self.oversampling,
            power: self.power,
        };
        let [gain1, gain2] = gain_bits(&self.channels.map(|channel| channel.gain));
        let cfg = Cfg {
            global_chop: self.global_chop,
            current_detect: self.current_detect,
        };
        let threshold = self.current_detect.map_or(0, CurrentDetect::threshold);
        let [threshold_msb, threshold_lsb] = threshold_bits(threshold, self.dc_block);
        let common = [
            (Register::Mode, self.mode.bits()),
            (Register::Clock, clock.bits()),
            (Register::Gain1, gain1),
            (Register::Gain2, gain2),
            (Register::Cfg, cfg.bits()),
            (Register::ThresholdMsb, threshold_msb),
            (Register::ThresholdLsb, threshold_lsb),
        ];
        let common = common
            .into_iter()
            .filter(|(register, _)| CHANNELS > 4 || *register != Register::Gain2);
        let channels = self.channels.iter().enumerate();
        common.chain(channels.flat_map(|(number, channel)| channel.registers(number as u8)))
    }
}

/// What a converter does not take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SettingsError {
    /// The master clock is outside of what the power mode allows.
    Clock {
        /// As set.
        clock_hz: u32,
        /// The slowest allowed.
        lowest_hz: u32,
        /// The fastest allowed.
        highest_hz: u32,
    },
    /// More than four channels have no oversampling ratio of 64.
    Oversampling,
    /// Up to four channels have neither an external reference nor an oscillator.
    SmallPackage,
    /// A phase beyond half of the oversampling ratio, which the converter would clip.
    Phase {
        /// Of this channel.
        channel: u8,
        /// As set.
        cycles: i16,
    },
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Clock {
                clock_hz,
                lowest_hz,
                highest_hz,
            } => write!(
                f,
                "a clock of {clock_hz} Hz is not within {lowest_hz} to {highest_hz} Hz"
            ),
            Self::Oversampling => {
                f.write_str("more than four channels have no oversampling ratio of 64")
            }
            Self::SmallPackage => f.write_str(
                "up to four channels have neither an external reference nor an oscillator",
            ),
            Self::Phase { channel, cycles } => write!(
                f,
                "channel {channel}: a phase of {cycles} modulator cycles is beyond half of the oversampling ratio"
            ),
        }
    }
}

impl core::error::Error for SettingsError {}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares what is written with the register map.
    fn written<const CHANNELS: usize>() {
        let settings = Settings::<CHANNELS>::RESET;
        let mut registers = settings.registers();
        for address in 2..=last_writable_address(CHANNELS) {
            let Some(register) = Register::at(address, CHANNELS) else {
                continue;
            };
            let flag = u16::from(register == Register::Mode) << 10;
            let value = register.reset_value(CHANNELS) & !flag;
            assert_eq!(registers.next(), Some((register, value)));
        }
        assert_eq!(registers.next(), None);
    }

    #[test]
    fn settings_after_a_reset_are_the_reset_values_of_every_writable_register() {
        written::<2>();
        written::<3>();
        written::<4>();
        written::<6>();
        written::<8>();
    }

    #[test]
    fn two_passes_over_the_register_map_are_as_long_as_its_registers() {
        // 02h to 12h, 1Ch, 26h and 30h are 17, 27, 37 and 47 registers.
        assert_eq!(Settings::<2>::RESET.register_map_cycles(), 2 * 17 * 16);
        assert_eq!(Settings::<4>::RESET.register_map_cycles(), 2 * 27 * 16);
        assert_eq!(Settings::<6>::RESET.register_map_cycles(), 2 * 37 * 16);
        assert_eq!(Settings::<8>::RESET.register_map_cycles(), 2 * 47 * 16);
    }
}
