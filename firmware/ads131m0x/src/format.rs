//! How frames are written: the length of their words and their checksums (section 8.5.1).

/// Length of the words, and how a code of 24 bits lies in one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "WLENGTH")]
pub enum WordLength {
    /// 16 bits: a code loses its lower eight.
    Bits16 = 0,
    /// 24 bits; the state after a reset.
    #[default]
    Bits24 = 1,
    /// 32 bits, zeros below the code.
    Bits32ZeroPadded = 2,
    /// 32 bits, the sign above the code.
    Bits32SignExtended = 3,
}

impl WordLength {
    /// Bytes of a word.
    pub const fn bytes(self) -> usize {
        match self {
            Self::Bits16 => 2,
            Self::Bits24 => 3,
            Self::Bits32ZeroPadded | Self::Bits32SignExtended => 4,
        }
    }

    pub(crate) const fn from_bits(mode: u16) -> Self {
        match (mode >> 8) & 0b11 {
            0 => Self::Bits16,
            1 => Self::Bits24,
            2 => Self::Bits32ZeroPadded,
            _ => Self::Bits32SignExtended,
        }
    }

    /// The code in a word, on the scale of 24 bits.
    #[inline]
    pub(crate) const fn code(self, word: &[u8]) -> i32 {
        match (self, word) {
            (Self::Bits16, &[a, b]) => i32::from_be_bytes([a, b, 0, 0]) >> 8,
            (Self::Bits24, &[a, b, c]) => i32::from_be_bytes([a, b, c, 0]) >> 8,
            (Self::Bits32ZeroPadded, &[a, b, c, _]) => i32::from_be_bytes([a, b, c, 0]) >> 8,
            (Self::Bits32SignExtended, &[a, b, c, d]) => i32::from_be_bytes([a, b, c, d]),
            _ => 0,
        }
    }
}

/// Polynomial of the checksums, both ways and of the register map; the initial value is 0xFFFF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[doc(alias = "CRC_TYPE")]
pub enum Polynomial {
    /// x^16 + x^12 + x^5 + 1, CRC-16/IBM-3740 in the catalogue of CRC algorithms; the state after a reset.
    #[default]
    Ccitt,
    /// x^16 + x^15 + x^2 + 1, CRC-16/CMS in the catalogue.
    Ansi,
}

static CCITT: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
static ANSI: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_CMS);

impl Polynomial {
    /// The checksum of these bytes.
    #[inline]
    pub const fn checksum(self, bytes: &[u8]) -> u16 {
        match self {
            Self::Ccitt => CCITT.checksum(bytes),
            Self::Ansi => ANSI.checksum(bytes),
        }
    }
}

/// How frames are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Format {
    /// Their words.
    pub word_length: WordLength,
    /// Their checksums.
    pub polynomial: Polynomial,
}

impl Format {
    /// After a reset.
    pub const RESET: Self = Self {
        word_length: WordLength::Bits24,
        polynomial: Polynomial::Ccitt,
    };

    /// Bytes of a frame: an answer, a word for each channel, a checksum.
    pub const fn frame_bytes(self, channels: usize) -> usize {
        (channels + 2) * self.word_length.bytes()
    }
}
