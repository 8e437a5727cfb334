//! Registers: their addresses, and their contents in types (section 8.6).

use crate::clock::{Oversampling, PowerMode};
use crate::format::{Format, Polynomial, WordLength};
use crate::values::{ChopDelay, CurrentDetect, DcBlock, Gain, Input, Phase, split};

/// A register's address. Channels are numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Register {
    /// Identification, read only.
    Id,
    /// The status word, read only.
    Status,
    /// Checksums, word length, DRDY.
    Mode,
    /// Channels, oversampling, power.
    Clock,
    /// Gains of channels 0 to 3.
    Gain1,
    /// Gains of channels 4 to 7; reserved where there are none.
    Gain2,
    /// Global chop and current detection.
    Cfg,
    /// Threshold of current detection, upper 16 bits.
    #[doc(alias = "THRSHLD_MSB")]
    ThresholdMsb,
    /// Threshold of current detection, lower 8 bits; filter against direct voltage.
    #[doc(alias = "THRSHLD_LSB")]
    ThresholdLsb,
    /// Phase and input of a channel.
    #[doc(alias = "CHn_CFG")]
    ChannelCfg(u8),
    /// Offset of a channel, upper 16 bits.
    #[doc(alias = "CHn_OCAL_MSB")]
    OffsetMsb(u8),
    /// Offset of a channel, lower 8 bits.
    #[doc(alias = "CHn_OCAL_LSB")]
    OffsetLsb(u8),
    /// Gain calibration of a channel, upper 16 bits.
    #[doc(alias = "CHn_GCAL_MSB")]
    GainMsb(u8),
    /// Gain calibration of a channel, lower 8 bits.
    #[doc(alias = "CHn_GCAL_LSB")]
    GainLsb(u8),
    /// Checksum of the register map, read only.
    #[doc(alias = "REGMAP_CRC")]
    MapChecksum,
}

/// Address of the first channel's registers, and how many each channel has.
const CHANNELS_FROM: u8 = 0x09;
const CHANNEL_REGISTERS: u8 = 5;

/// Address of the last writable register of a converter with so many channels.
pub const fn last_writable_address(channels: usize) -> u8 {
    CHANNELS_FROM + CHANNEL_REGISTERS * channels as u8 - 1
}

impl Register {
    /// The address.
    pub const fn address(self) -> u8 {
        let (channel, place) = match self {
            Self::Id => return 0x00,
            Self::Status => return 0x01,
            Self::Mode => return 0x02,
            Self::Clock => return 0x03,
            Self::Gain1 => return 0x04,
            Self::Gain2 => return 0x05,
            Self::Cfg => return 0x06,
            Self::ThresholdMsb => return 0x07,
            Self::ThresholdLsb => return 0x08,
            Self::MapChecksum => return 0x3E,
            Self::ChannelCfg(channel) => (channel, 0),
            Self::OffsetMsb(channel) => (channel, 1),
            Self::OffsetLsb(channel) => (channel, 2),
            Self::GainMsb(channel) => (channel, 3),
            Self::GainLsb(channel) => (channel, 4),
        };
        // Eight channels at the most; the field has six bits.
        CHANNELS_FROM + CHANNEL_REGISTERS * (channel & 7) + place
    }

    /// The register at an address, `None` where a converter of so many channels has none.
    pub const fn at(address: u8, channels: usize) -> Option<Self> {
        Some(match address {
            0x00 => Self::Id,
            0x01 => Self::Status,
            0x02 => Self::Mode,
            0x03 => Self::Clock,
            0x04 => Self::Gain1,
            0x05 if channels > 4 => Self::Gain2,
            0x06 => Self::Cfg,
            0x07 => Self::ThresholdMsb,
            0x08 => Self::ThresholdLsb,
            0x3E => Self::MapChecksum,
            _ if address >= CHANNELS_FROM && address <= last_writable_address(channels) => {
                let channel = (address - CHANNELS_FROM) / CHANNEL_REGISTERS;
                match (address - CHANNELS_FROM) % CHANNEL_REGISTERS {
                    0 => Self::ChannelCfg(channel),
                    1 => Self::OffsetMsb(channel),
                    2 => Self::OffsetLsb(channel),
                    3 => Self::GainMsb(channel),
                    _ => Self::GainLsb(channel),
                }
            }
            _ => return None,
        })
    }

    /// What it holds after a reset of a converter with so many channels; of [`Self::Id`] the upper byte alone counts.
    pub const fn reset_value(self, channels: usize) -> u16 {
        match self {
            Self::Id => Identification::of(channels).0,
            Self::Status => 0x0500,
            Self::Mode => 0x0510,
            Self::Clock => !(0xFFFF << channels) << 8 | 0x0E,
            Self::Cfg => 0x0600,
            Self::GainMsb(_) => 0x8000,
            _ => 0,
        }
    }
}

impl core::fmt::Display for Register {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Id => f.write_str("ID"),
            Self::Status => f.write_str("STATUS"),
            Self::Mode => f.write_str("MODE"),
            Self::Clock => f.write_str("CLOCK"),
            Self::Gain1 => f.write_str("GAIN1"),
            Self::Gain2 => f.write_str("GAIN2"),
            Self::Cfg => f.write_str("CFG"),
            Self::ThresholdMsb => f.write_str("THRSHLD_MSB"),
            Self::ThresholdLsb => f.write_str("THRSHLD_LSB"),
            Self::ChannelCfg(channel) => write!(f, "CH{channel}_CFG"),
            Self::OffsetMsb(channel) => write!(f, "CH{channel}_OCAL_MSB"),
            Self::OffsetLsb(channel) => write!(f, "CH{channel}_OCAL_LSB"),
            Self::GainMsb(channel) => write!(f, "CH{channel}_GCAL_MSB"),
            Self::GainLsb(channel) => write!(f, "CH{channel}_GCAL_LSB"),
            Self::MapChecksum => f.write_str("REGMAP_CRC"),
        }
    }
}

/// The register ID: 0x2n and a byte that may change without notice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Identification(pub u16);

impl Identification {
    /// Of a converter with so many channels, the lower byte zero.
    pub const fn of(channels: usize) -> Self {
        Self(0x2000 | (channels as u16) << 8)
    }

    /// Channels.
    #[doc(alias = "CHANCNT")]
    pub const fn channels(self) -> u8 {
        (self.0 >> 8) as u8 & 0xF
    }

    /// True for a converter of this family with so many channels.
    pub const fn is_of(self, channels: usize) -> bool {
        self.0 & 0xFF00 == Self::of(channels).0
    }
}

/// Which channel DRDY follows, where their phases differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "DRDY_SEL")]
pub enum DrdySource {
    /// The last one; then all are ready.
    #[default]
    MostLagging = 0,
    /// Each of them.
    Any = 1,
    /// The first one.
    MostLeading = 2,
}

/// The register MODE. Writing it clears the reset flag of the status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Mode {
    /// Watch the register map ([`Status::REGISTER_MAP`](crate::Status::REGISTER_MAP)).
    #[doc(alias = "REG_CRC_EN")]
    pub register_map_checksum: bool,
    /// Check the frames to the converter.
    #[doc(alias = "RX_CRC_EN")]
    pub input_checksum: bool,
    /// How frames are written.
    pub format: Format,
    /// Give a frame up that takes more than 32 768 clock cycles.
    pub timeout: bool,
    /// Which channel DRDY follows.
    pub drdy_source: DrdySource,
    /// DRDY is not driven high: a pull-up of 100 kOhm does that.
    #[doc(alias = "DRDY_HiZ")]
    pub drdy_open_drain: bool,
    /// DRDY is a short pulse instead of a level. A conversion that is not read then costs the pulse of the next one.
    #[doc(alias = "DRDY_FMT")]
    pub drdy_pulse: bool,
}

impl Default for Mode {
    /// After a reset.
    fn default() -> Self {
        Self::RESET
    }
}

impl Mode {
    /// After a reset.
    pub const RESET: Self = Self {
        register_map_checksum: false,
        input_checksum: false,
        format: Format::RESET,
        timeout: true,
        drdy_source: DrdySource::MostLagging,
        drdy_open_drain: false,
        drdy_pulse: false,
    };

    /// The register, its reset flag 0.
    pub const fn bits(self) -> u16 {
        (self.register_map_checksum as u16) << 13
            | (self.input_checksum as u16) << 12
            | (self.format.polynomial as u16) << 11
            | (self.format.word_length as u16) << 8
            | (self.timeout as u16) << 4
            | (self.drdy_source as u16) << 2
            | (self.drdy_open_drain as u16) << 1
            | self.drdy_pulse as u16
    }

    /// From the register.
    pub const fn from_bits(bits: u16) -> Self {
        Self {
            register_map_checksum: bits & 1 << 13 != 0,
            input_checksum: bits & 1 << 12 != 0,
            format: Format {
                word_length: WordLength::from_bits(bits),
                polynomial: if bits & 1 << 11 != 0 {
                    Polynomial::Ansi
                } else {
                    Polynomial::Ccitt
                },
            },
            timeout: bits & 1 << 4 != 0,
            drdy_source: match (bits >> 2) & 0b11 {
                0 => DrdySource::MostLagging,
                1 => DrdySource::Any,
                _ => DrdySource::MostLeading,
            },
            drdy_open_drain: bits & 1 << 1 != 0,
            drdy_pulse: bits & 1 != 0,
        }
    }
}

/// The register CLOCK.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Clock {
    /// Channels that convert, a bit for each.
    pub enabled: u8,
    /// The oscillator for a crystal is off: the clock comes from outside. With six or eight channels.
    #[doc(alias = "XTAL_DIS")]
    pub crystal_off: bool,
    /// The reference comes from outside. With six or eight channels.
    #[doc(alias = "EXTREF_EN")]
    pub external_reference: bool,
    /// Modulator cycles a conversion.
    pub oversampling: Oversampling,
    /// Current.
    pub power: PowerMode,
}

impl Clock {
    /// The register.
    pub const fn bits(self) -> u16 {
        (self.enabled as u16) << 8
            | (self.crystal_off as u16) << 7
            | (self.external_reference as u16) << 6
            | self.oversampling.bits()
            | self.power as u16
    }

    /// From the register.
    pub const fn from_bits(bits: u16) -> Self {
        Self {
            enabled: (bits >> 8) as u8,
            crystal_off: bits & 1 << 7 != 0,
            external_reference: bits & 1 << 6 != 0,
            oversampling: Oversampling::from_bits(bits),
            power: PowerMode::from_bits(bits),
        }
    }
}

/// The registers GAIN1 and GAIN2 of up to eight gains; further ones are disregarded.
pub const fn gain_bits(gains: &[Gain]) -> [u16; 2] {
    let mut registers = [0; 2];
    let mut channel = 0;
    while channel < gains.len() && channel < 8 {
        registers[channel / 4] |= (gains[channel] as u16) << (4 * (channel % 4));
        channel += 1;
    }
    registers
}

/// The gain of a channel, from the registers GAIN1 and GAIN2.
pub const fn gain_from_bits(registers: [u16; 2], channel: usize) -> Gain {
    let register = if channel < 4 {
        registers[0]
    } else {
        registers[1]
    };
    Gain::from_bits(register >> (4 * (channel % 4)))
}

/// The register CFG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Cfg {
    /// Swap the inputs at each conversion, after that delay.
    #[doc(alias = "GC_EN")]
    pub global_chop: Option<ChopDelay>,
    /// Watch for a current while standing by; the threshold has registers of its own.
    #[doc(alias = "CD_EN")]
    pub current_detect: Option<CurrentDetect>,
}

impl Cfg {
    /// The register. Where chopping is off the delay is that after a reset.
    pub const fn bits(self) -> u16 {
        let chop = match self.global_chop {
            Some(delay) => (delay as u16) << 9 | 1 << 8,
            None => (ChopDelay::RESET as u16) << 9,
        };
        let detect = match self.current_detect {
            Some(detect) => detect.bits() | 1,
            None => 0,
        };
        chop | detect
    }

    /// From the register, and the threshold from its own.
    pub const fn from_bits(bits: u16, threshold: u32) -> Self {
        Self {
            global_chop: if bits & 1 << 8 != 0 {
                Some(ChopDelay::from_bits(bits >> 9))
            } else {
                None
            },
            current_detect: if bits & 1 != 0 {
                Some(CurrentDetect::from_bits(bits, threshold))
            } else {
                None
            },
        }
    }
}

/// The registers THRSHLD_MSB and THRSHLD_LSB: the threshold of current detection and the filter against direct voltage.
pub const fn threshold_bits(threshold: u32, dc_block: Option<DcBlock>) -> [u16; 2] {
    let filter = match dc_block {
        Some(filter) => filter.bits(),
        None => 0,
    };
    let [high, low] = split(threshold);
    [high, low | filter]
}

/// The registers CHn_CFG: phase, filter against direct voltage, input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ChannelCfg {
    /// When it samples.
    pub phase: Phase,
    /// The filter against direct voltage leaves this channel alone.
    #[doc(alias = "DCBLKn_DIS")]
    pub dc_block_off: bool,
    /// What is measured.
    pub input: Input,
}

impl ChannelCfg {
    /// The register.
    pub const fn bits(self) -> u16 {
        (self.phase.cycles() as u16) << 6 | (self.dc_block_off as u16) << 2 | self.input as u16
    }

    /// From the register.
    pub const fn from_bits(bits: u16) -> Self {
        Self {
            phase: Phase::from_bits(bits),
            dc_block_off: bits & 1 << 2 != 0,
            input: match bits & 0b11 {
                0 => Input::Pins,
                1 => Input::Shorted,
                2 => Input::PositiveTest,
                _ => Input::NegativeTest,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_those_of_the_register_map() {
        // Of the eight-channel data sheet, section 8.6.
        for (register, address) in [
            (Register::ChannelCfg(0), 0x09),
            (Register::GainLsb(0), 0x0D),
            (Register::ChannelCfg(3), 0x18),
            (Register::GainLsb(3), 0x1C),
            (Register::OffsetMsb(5), 0x23),
            (Register::OffsetLsb(6), 0x29),
            (Register::GainMsb(7), 0x2F),
            (Register::GainLsb(7), 0x30),
        ] {
            assert_eq!(register.address(), address, "{register}");
        }
        assert_eq!(
            [2, 4, 6, 8].map(last_writable_address),
            [0x12, 0x1C, 0x26, 0x30]
        );
    }

    #[test]
    fn every_register_is_found_at_its_address() {
        for channels in [2, 3, 4, 6, 8] {
            let known = (0..64).filter_map(|address| {
                let register = Register::at(address, channels)?;
                assert_eq!(register.address(), address);
                Some(register)
            });
            let expected = 9 + usize::from(channels > 4) + 5 * channels;
            assert_eq!(known.count(), expected, "{channels} channels");
        }
    }

    #[test]
    fn reset_values_are_those_of_the_register_map() {
        let clock = [2, 3, 4, 6, 8].map(|channels| Register::Clock.reset_value(channels));
        assert_eq!(clock, [0x030E, 0x070E, 0x0F0E, 0x3F0E, 0xFF0E]);
        assert_eq!(Mode::RESET.bits() | 0x0400, Register::Mode.reset_value(4));
        let cfg = Cfg {
            global_chop: None,
            current_detect: None,
        };
        assert_eq!(cfg.bits(), Register::Cfg.reset_value(4));
    }

    #[test]
    fn registers_come_back_from_their_bits() {
        // Every content without its reserved and equivalent bits.
        for bits in 0..=0xFFFF_u16 {
            let mode = bits & 0x3B1F;
            if mode & 0b1100 != 0b1100 {
                assert_eq!(Mode::from_bits(mode).bits(), mode);
            }
            if bits & 0b11 != 0b11 && (bits & 1 << 5 == 0 || bits & 0b11100 == 0) {
                assert_eq!(Clock::from_bits(bits).bits(), bits);
            }
            let cfg = bits & 0x1FFF;
            if cfg & 1 << 8 != 0 && cfg & 1 != 0 {
                assert_eq!(Cfg::from_bits(cfg, 0).bits(), cfg);
            }
            let channel = bits & 0xFFC7;
            assert_eq!(ChannelCfg::from_bits(channel).bits(), channel);
        }
    }

    #[test]
    fn gains_lie_four_bits_apart() {
        let gains = [
            Gain::X1,
            Gain::X2,
            Gain::X4,
            Gain::X8,
            Gain::X16,
            Gain::X32,
            Gain::X64,
            Gain::X128,
        ];
        let registers = gain_bits(&gains);
        assert_eq!(registers, [0x3210, 0x7654]);
        for (channel, gain) in gains.into_iter().enumerate() {
            assert_eq!(gain_from_bits(registers, channel), gain);
        }
    }
}
