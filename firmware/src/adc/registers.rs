//! How this instrument sets its converter.

pub use ads131m0x::registers::Identification;
pub use ads131m0x::{Gain, Mode, Oversampling, REFERENCE_V, Register, Settings, Status};

use super::frame::{CHANNELS, FORMAT};

/// The status of a converter that is set up and locked, but for the data flags.
pub const SOUND: Status = Status(Settings::<CHANNELS>::RESET.status().0 | Status::LOCK);

/// True when nothing but the data flags and the given ones differs from [`SOUND`].
#[inline]
pub const fn is_sound_but_for(status: Status, flags: u16) -> bool {
    status.differs_from(SOUND) & !flags == 0
}

/// True when all channels have data that were not read yet.
#[inline]
pub const fn has_data(status: Status) -> bool {
    status.has_all_data(CHANNELS)
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
    pub gains: [Gain; CHANNELS],
}

impl Default for Config {
    /// 4 kSPS, gain 1.
    fn default() -> Self {
        Self::at(Oversampling::X1024)
    }
}

impl Config {
    /// As the image is built: 16 kSPS with the feature `oversampling-256`, 32 kSPS with `oversampling-128`, else 4 kSPS.
    pub const BUILT: Self = Self::at(if cfg!(feature = "oversampling-128") {
        Oversampling::X128
    } else if cfg!(feature = "oversampling-256") {
        Oversampling::X256
    } else {
        Oversampling::X1024
    });

    /// With the nominal clock and gain 1.
    pub const fn at(oversampling: Oversampling) -> Self {
        Self {
            clock_hz: Settings::<CHANNELS>::RESET.clock_hz,
            oversampling,
            gains: [Gain::X1; CHANNELS],
        }
    }

    /// Conversions a second.
    pub fn sample_rate_hz(&self) -> f64 {
        f64::from(self.clock_hz) / f64::from(self.oversampling.clock_cycles())
    }

    /// All settings: register map and input watched, the rest as after a reset.
    pub const fn settings(&self) -> Settings<CHANNELS> {
        let mut settings = Settings::RESET;
        settings.clock_hz = self.clock_hz;
        settings.oversampling = self.oversampling;
        settings.mode = Mode {
            register_map_checksum: true,
            input_checksum: true,
            format: FORMAT,
            ..Mode::RESET
        };
        let mut channel = 0;
        while channel < CHANNELS {
            settings.channels[channel].gain = self.gains[channel];
            channel += 1;
        }
        settings
    }
}
