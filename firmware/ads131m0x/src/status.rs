//! The status word.

use crate::format::{Polynomial, WordLength};

/// The status word: the register STATUS, and the first word of each frame that follows a null command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status(pub u16);

impl Status {
    /// Commands that change anything are locked out.
    pub const LOCK: u16 = 1 << 15;
    /// The conversions were synchronised anew. The data sheets do not say when it is cleared.
    #[doc(alias = "F_RESYNC")]
    pub const RESYNC: u16 = 1 << 14;
    /// The checksum of the register map changed, be it by a write. Set within two passes over the map of one bit a clock
    /// cycle, cleared when the status is put out (section 8.3.13).
    #[doc(alias = "REG_MAP")]
    pub const REGISTER_MAP: u16 = 1 << 13;
    /// A frame to the converter had a wrong checksum; cleared when the status is put out.
    #[doc(alias = "CRC_ERR")]
    pub const INPUT_CHECKSUM: u16 = 1 << 12;
    /// Checksums by [`Polynomial::Ansi`].
    #[doc(alias = "CRC_TYPE")]
    pub const ANSI: u16 = 1 << 11;
    /// The converter was reset since the register MODE was last written.
    pub const RESET: u16 = 1 << 10;
    /// Length of the words, as [`WordLength`] numbers it.
    #[doc(alias = "WLENGTH")]
    pub const WORD_LENGTH: u16 = 0b11 << 8;
    /// New data, a bit for each channel.
    #[doc(alias = "DRDY")]
    pub const DATA: u16 = 0xFF;

    /// The bits of [`Self::DATA`] that a converter of so many channels has.
    pub const fn data_bits(channels: usize) -> u16 {
        Self::DATA >> (8 - if channels < 8 { channels } else { 8 })
    }

    /// True when the interface is locked.
    pub const fn is_locked(self) -> bool {
        self.0 & Self::LOCK != 0
    }

    /// True when the conversions were synchronised anew.
    pub const fn was_resynchronised(self) -> bool {
        self.0 & Self::RESYNC != 0
    }

    /// True when a register changed, by a write or by itself.
    pub const fn register_map_changed(self) -> bool {
        self.0 & Self::REGISTER_MAP != 0
    }

    /// True when a frame arrived at the converter with a wrong checksum.
    pub const fn input_checksum_failed(self) -> bool {
        self.0 & Self::INPUT_CHECKSUM != 0
    }

    /// True when the converter was reset and not set up since.
    pub const fn was_reset(self) -> bool {
        self.0 & Self::RESET != 0
    }

    /// Polynomial of the checksums.
    pub const fn polynomial(self) -> Polynomial {
        if self.0 & Self::ANSI != 0 {
            Polynomial::Ansi
        } else {
            Polynomial::Ccitt
        }
    }

    /// Length of the words.
    pub const fn word_length(self) -> WordLength {
        WordLength::from_bits(self.0)
    }

    /// True when the channel has a conversion that was not read yet.
    pub const fn has_data(self, channel: usize) -> bool {
        channel < 8 && self.0 & (1 << channel) != 0
    }

    /// True when all of so many channels have.
    pub const fn has_all_data(self, channels: usize) -> bool {
        let all = Self::data_bits(channels);
        self.0 & all == all
    }

    /// The bits in which it differs from another one, the data bits left out.
    pub const fn differs_from(self, expected: Self) -> u16 {
        (self.0 ^ expected.0) & !Self::DATA
    }
}
