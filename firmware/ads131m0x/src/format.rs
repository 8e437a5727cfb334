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

const CCITT: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
const ANSI: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_CMS);

/// Both have their highest bit first, no final exclusive-or, and begin with all ones.
const INITIAL: u16 = 0xFFFF;

/// `[n][b]`: the checksum, begun with zero, of the byte `b` and `n` zeros after it. Four bytes are looked up at once.
type Tables = [[u16; 256]; 4];

const fn tables(crc: &crc::Crc<u16>) -> Tables {
    let mut tables = [[0; 256]; 4];
    let mut byte = 0;
    while byte < 256 {
        let mut zeros = 0;
        while zeros < 4 {
            let message = [byte as u8, 0, 0, 0];
            let digest = crc.digest_with_initial(0);
            let mut digest = digest;
            digest.update(message.split_at(zeros + 1).0);
            tables[zeros][byte] = digest.finalize();
            zeros += 1;
        }
        byte += 1;
    }
    tables
}

static CCITT_TABLES: Tables = tables(&CCITT);
static ANSI_TABLES: Tables = tables(&ANSI);

/// Goes on with four bytes, the first of them highest.
#[inline]
const fn with_word(tables: &Tables, sum: u16, word: u32) -> u16 {
    let [last, second, third, fourth] = tables;
    let word = word ^ (sum as u32) << 16;
    fourth[(word >> 24) as usize]
        ^ third[(word >> 16 & 0xFF) as usize]
        ^ second[(word >> 8 & 0xFF) as usize]
        ^ last[(word & 0xFF) as usize]
}

/// Goes on with a byte.
#[inline]
const fn with_byte(tables: &Tables, sum: u16, byte: u8) -> u16 {
    sum << 8 ^ tables[0][(sum >> 8) as usize ^ byte as usize]
}

#[inline]
const fn by_words(tables: &Tables, bytes: &[u8]) -> u16 {
    let (mut odd, mut words) = bytes.split_at(bytes.len() % 4);
    let mut sum = INITIAL;
    while let [byte, rest @ ..] = odd {
        sum = with_byte(tables, sum, *byte);
        odd = rest;
    }
    while let [a, b, c, d, rest @ ..] = words {
        sum = with_word(tables, sum, u32::from_be_bytes([*a, *b, *c, *d]));
        words = rest;
    }
    sum
}

impl Polynomial {
    /// The checksum of these bytes.
    #[inline]
    pub const fn checksum(self, bytes: &[u8]) -> u16 {
        match self {
            Self::Ccitt => by_words(&CCITT_TABLES, bytes),
            Self::Ansi => by_words(&ANSI_TABLES, bytes),
        }
    }

    /// The checksum of the bytes of these words, the highest byte first, and one byte more.
    #[inline]
    pub fn checksum_of_words<const N: usize>(self, words: [u32; N], byte: u8) -> u16 {
        let tables = match self {
            Self::Ccitt => &CCITT_TABLES,
            Self::Ansi => &ANSI_TABLES,
        };
        let sum = words
            .iter()
            .fold(INITIAL, |sum, word| with_word(tables, sum, *word));
        with_byte(tables, sum, byte)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_by_words_are_those_of_the_catalogue_for_every_length() {
        let mut bytes = [0; 64];
        let mut state = 1u32;
        for byte in &mut bytes {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *byte = (state >> 24) as u8;
        }
        for end in 0..=bytes.len() {
            for start in 0..end.min(5) {
                let message = &bytes[start..end];
                assert_eq!(Polynomial::Ccitt.checksum(message), CCITT.checksum(message));
                assert_eq!(Polynomial::Ansi.checksum(message), ANSI.checksum(message));
            }
        }
        let words = [u32::from_be_bytes(*b"1234"), u32::from_be_bytes(*b"5678")];
        assert_eq!(Polynomial::Ccitt.checksum_of_words(words, b'9'), 0x29B1);
        assert_eq!(Polynomial::Ansi.checksum_of_words(words, b'9'), 0xAEE7);
        assert_eq!(Polynomial::Ccitt.checksum(b"123456789"), 0x29B1);
        assert_eq!(Polynomial::Ansi.checksum(b"123456789"), 0xAEE7);
    }
}
