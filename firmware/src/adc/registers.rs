//! Registers and settings of the ADS131M04 (data sheet SBAS890, section 8.6).

/// A register's address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Register {
    /// Identification, read only: 0x24 and a revision.
    Id = 0x00,
    /// The status word, read only.
    Status = 0x01,
    /// Checksums, word length, DRDY.
    Mode = 0x02,
    /// Channels, oversampling, power.
    Clock = 0x03,
    /// Gain of the four channels.
    Gain1 = 0x04,
    /// Global chop and current detection.
    Cfg = 0x06,
}

/// The upper byte of [`Register::Id`]: four channels.
pub const ID: u16 = 0x2400;

/// The status word that begins each frame without an answer to a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status(pub u16);

impl Status {
    /// Commands that change anything are locked out.
    pub const LOCK: u16 = 1 << 15;
    /// The conversions were synchronised anew.
    pub const RESYNC: u16 = 1 << 14;
    /// The register map changed.
    pub const REGISTER_MAP: u16 = 1 << 13;
    /// The last frame to the converter had a wrong checksum.
    pub const INPUT_CHECKSUM: u16 = 1 << 12;
    /// The converter was reset since the flag was last cleared.
    pub const RESET: u16 = 1 << 10;
    /// Words of 24 bits.
    pub const WORD_24: u16 = 0b01 << 8;
    /// New data in all four channels.
    pub const DATA: u16 = 0b1111;

    /// The status of a converter set up by this driver, but for the data flags.
    pub const SOUND: u16 = Self::LOCK | Self::WORD_24;

    /// True when all four channels have data that were not read yet.
    pub const fn has_data(self) -> bool {
        self.0 & Self::DATA == Self::DATA
    }

    /// True when nothing but the data flags and the given ones differs from [`Self::SOUND`].
    pub const fn is_sound_but_for(self, flags: u16) -> bool {
        (self.0 ^ Self::SOUND) & !(Self::DATA | flags) == 0
    }
}

/// MODE: register map checked, input checksum checked, CCITT polynomial, reset flag cleared, 24-bit words, bus
/// time-out on, DRDY with the last channel, driven, low until read.
pub const MODE: u16 = 1 << 13 | 1 << 12 | Status::WORD_24 | 1 << 4;

/// CFG: no global chop, no current detection; the delay field as after reset.
pub const CFG: u16 = 0x0600;

/// Modulator cycles a conversion: the decimation of the sinc3 filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
#[doc(alias = "OSR")]
pub enum Oversampling {
    /// 32 kSPS at 8.192 MHz.
    X128 = 0,
    /// 16 kSPS at 8.192 MHz.
    X256 = 1,
    /// 8 kSPS at 8.192 MHz.
    X512 = 2,
    /// 4 kSPS at 8.192 MHz.
    X1024 = 3,
    /// 2 kSPS at 8.192 MHz.
    X2048 = 4,
    /// 1 kSPS at 8.192 MHz.
    X4096 = 5,
    /// 500 SPS at 8.192 MHz.
    X8192 = 6,
}

impl Oversampling {
    /// Modulator cycles a conversion.
    pub const fn ratio(self) -> u32 {
        128 << self as u16
    }

    /// Cycles of the converter's clock a conversion; the modulator runs at half of it.
    pub const fn clock_cycles(self) -> u32 {
        2 * self.ratio()
    }
}

/// Gain of a channel; full scale is the reference voltage over it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
#[doc(alias = "PGAGAIN")]
pub enum Gain {
    /// 1
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
        1 << self as u16
    }
}

/// How the converter is wired and set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Its master clock, Hz; 8.192 MHz nominal.
    #[doc(alias = "CLKIN")]
    pub clock_hz: u32,
    /// Decimation.
    pub oversampling: Oversampling,
    /// Gain of each channel.
    pub gains: [Gain; 4],
}

impl Default for Config {
    /// 4 kSPS, gain 1.
    fn default() -> Self {
        Self {
            clock_hz: 8_192_000,
            oversampling: Oversampling::X1024,
            gains: [Gain::X1; 4],
        }
    }
}

/// Reference voltage of the converter, V: full scale at gain 1.
pub const REFERENCE_V: f64 = 1.2;

impl Config {
    /// Conversions a second.
    pub fn sample_rate_hz(&self) -> f64 {
        f64::from(self.clock_hz) / f64::from(self.oversampling.clock_cycles())
    }

    /// CLOCK: all channels, the oversampling, high-resolution mode.
    pub const fn clock_register(&self) -> u16 {
        0x0F00 | (self.oversampling as u16) << 2 | 0b10
    }

    /// GAIN1.
    pub const fn gain_register(&self) -> u16 {
        let [a, b, c, d] = self.gains;
        a as u16 | (b as u16) << 4 | (c as u16) << 8 | (d as u16) << 12
    }

    /// All that is written, in order.
    pub const fn settings(&self) -> [(Register, u16); 4] {
        [
            (Register::Mode, MODE),
            (Register::Clock, self.clock_register()),
            (Register::Gain1, self.gain_register()),
            (Register::Cfg, CFG),
        ]
    }
}
