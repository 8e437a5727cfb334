//! Frames: COBS with delimiter 0x00, CRC-32, sequence number, protocol version.
//!
//! Consistent overhead byte stuffing (Cheshire and Baker, 1999) is written out here, because both sides
//! need it in place and over whole runs: the released crate goes byte by byte, at a third of the speed that
//! a recorded stream of raw samples is read with. The tests hold it against that crate.
//!
//! The checksum is CRC-32/ISO-HDLC (polynomial 0x04C11DB7 reflected, initial value and final exclusive-or all
//! ones). With the feature `fast-crc` it comes from `crc32fast` (carry-less multiplication on the host),
//! without it by words, with tables of 4 KiB (the instrument). Both give the same bytes.

use serde::Deserialize;

use super::message::Message;
use super::version::Version;

/// Ends every frame and occurs nowhere inside one.
pub const DELIMITER: u8 = 0x00;

/// Bytes before the message: version and sequence number.
pub const HEADER: usize = 3;

/// Bytes after the message: the checksum.
pub const CHECKSUM: usize = 4;

/// Largest message in bytes, after postcard.
pub const MAX_MESSAGE: usize = 800;

/// Largest content of a frame before byte stuffing.
pub const MAX_CONTENT: usize = HEADER + MAX_MESSAGE + CHECKSUM;

/// Longest stretch without a zero that one code byte stands for.
const RUN: usize = 254;

/// Bytes that stuffing can add: one, and one more for each full run.
const STUFFING: usize = 1 + MAX_CONTENT / RUN;

/// Longest frame on the line, delimiter included. A frame of n bytes of message takes at most
/// n + 3 + 4 + 1 + (n + 7) / 254 + 1 bytes.
pub const MAX_FRAME: usize = MAX_CONTENT + STUFFING + 1;

/// Why a message was not put into a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// The message is longer than [`MAX_MESSAGE`].
    TooLong,
}

/// Why bytes between two delimiters are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// More bytes without a delimiter than any frame has.
    TooLong,
    /// Shorter than header and checksum.
    TooShort {
        /// Bytes after unstuffing.
        length: usize,
    },
    /// A code byte points past the end of the frame, or a zero stands inside it.
    Stuffing,
    /// The checksum does not fit the content.
    Checksum {
        /// Sent with the frame.
        sent: u32,
        /// Computed from what arrived.
        computed: u32,
    },
    /// A sound frame of a version that this code does not understand.
    Version(Version),
    /// A sound frame whose message does not follow the schema, or has bytes left over.
    Message,
}

/// One frame as it goes over the line, delimiter included.
#[derive(Clone)]
pub struct Frame {
    bytes: [u8; MAX_FRAME],
    length: usize,
}

impl Default for Frame {
    fn default() -> Self {
        Self::new()
    }
}

impl Frame {
    /// An empty frame.
    pub const fn new() -> Self {
        Self {
            bytes: [0; MAX_FRAME],
            length: 0,
        }
    }

    /// The bytes for the line; empty before the first [`Self::encode`].
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or(&[])
    }

    /// Packs one message under the oldest protocol version that knows it. On an error the frame is empty.
    pub fn encode<M: Message>(&mut self, message: &M, sequence: u16) -> Result<(), EncodeError> {
        self.length = 0;
        // The content lies behind the first code byte and is stuffed where it lies.
        let content = &mut self.bytes[1..];
        content[0] = message.version().0;
        content[1..HEADER].copy_from_slice(&sequence.to_le_bytes());
        let message = postcard::to_slice(message, &mut content[HEADER..HEADER + MAX_MESSAGE])
            .map_err(|_| EncodeError::TooLong)?
            .len();
        let end = HEADER + message;
        let sum = checksum(&content[..end]);
        content[end..end + CHECKSUM].copy_from_slice(&sum.to_le_bytes());
        let stuffed = stuff(&mut self.bytes, 1 + end + CHECKSUM);
        self.bytes[stuffed] = DELIMITER;
        self.length = stuffed + 1;
        Ok(())
    }
}

/// Stuffs `bytes[1..end]` where it lies; returns the stuffed length. A zero becomes the code byte of what follows it, so that
/// nothing moves, but for what is behind a full run.
fn stuff(bytes: &mut [u8; MAX_FRAME], mut end: usize) -> usize {
    // Where the open run's code byte goes.
    let mut code = 0;
    loop {
        let start = code + 1;
        let reach = end.min(start + RUN);
        match bytes.get(start..reach).and_then(first_zero) {
            Some(run) => {
                bytes[code] = (run + 1) as u8;
                code = start + run;
            }
            None if reach == end => {
                bytes[code] = (end - code) as u8;
                return end;
            }
            // A full run has no zero after it; its code byte is one more.
            None => {
                bytes.copy_within(reach..end, reach + 1);
                bytes[code] = u8::MAX;
                (code, end) = (reach, end + 1);
            }
        }
    }
}

/// Where the first zero is, looked for by words.
#[inline]
fn first_zero(bytes: &[u8]) -> Option<usize> {
    let (words, rest) = bytes.as_chunks::<WORD>();
    for (n, word) in words.iter().enumerate() {
        let zeros = zero_bytes(u32::from_le_bytes(*word));
        if zeros != 0 {
            return Some(WORD * n + zeros.trailing_zeros() as usize / 8);
        }
    }
    let odd = rest.iter().position(|byte| *byte == 0)?;
    Some(WORD * words.len() + odd)
}

/// Bytes of a word.
const WORD: usize = 4;

/// Not zero if a byte of the word is; the lowest bit that is set is then the highest of the lowest such byte: only there a
/// borrow reaches the highest bit of a byte that had it clear.
#[inline]
const fn zero_bytes(word: u32) -> u32 {
    word.wrapping_sub(0x0101_0101) & !word & 0x8080_8080
}

/// Takes the stuffing out of `bytes` in place; returns the content's length.
fn unstuff(bytes: &mut [u8]) -> Result<usize, FrameError> {
    let mut from = 0;
    let mut out = 0;
    while let Some(&code) = bytes.get(from) {
        let run = usize::from(code);
        if run == 0 || from + run > bytes.len() {
            return Err(FrameError::Stuffing);
        }
        bytes.copy_within(from + 1..from + run, out);
        out += run - 1;
        from += run;
        if run <= RUN && from < bytes.len() {
            bytes[out] = 0;
            out += 1;
        }
    }
    Ok(out)
}

/// A frame whose checksum and version are sound; the message is not yet looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// The sender's protocol version.
    pub version: Version,
    /// Counts the sender's frames and wraps at 2^16.
    pub sequence: u16,
    message: &'a [u8],
}

impl<'a> Packet<'a> {
    /// Opens what stands between two delimiters, in place. `stuffed` has no delimiter in it.
    pub fn open(stuffed: &'a mut [u8]) -> Result<Self, FrameError> {
        let packet = Self::open_any(stuffed)?;
        if !packet.version.is_understood() {
            return Err(FrameError::Version(packet.version));
        }
        Ok(packet)
    }

    /// The same of whatever version, for a reader that knows frames which never go over the line.
    pub fn open_any(stuffed: &'a mut [u8]) -> Result<Self, FrameError> {
        if stuffed.len() >= MAX_FRAME {
            return Err(FrameError::TooLong);
        }
        let length = unstuff(stuffed)?;
        let content = stuffed.get(..length).ok_or(FrameError::Stuffing)?;
        let (content, sent) = content
            .split_last_chunk::<CHECKSUM>()
            .ok_or(FrameError::TooShort { length })?;
        let (&[version, low, high], message) = content
            .split_first_chunk::<HEADER>()
            .ok_or(FrameError::TooShort { length })?;
        let sent = u32::from_le_bytes(*sent);
        let computed = checksum(content);
        if sent != computed {
            return Err(FrameError::Checksum { sent, computed });
        }
        Ok(Self {
            version: Version(version),
            sequence: u16::from_le_bytes([low, high]),
            message,
        })
    }

    /// The message itself: a [`Command`](super::Command) or an [`Event`](super::Event), which may borrow from
    /// the frame.
    pub fn message<M: Deserialize<'a>>(&self) -> Result<M, FrameError> {
        match postcard::take_from_bytes(self.message) {
            Ok((message, [])) => Ok(message),
            _ => Err(FrameError::Message),
        }
    }
}

/// Cuts a stream of bytes, however it arrives, into frames; for the sides that cannot hold a whole record.
#[derive(Clone)]
pub struct Deframer {
    buffer: [u8; MAX_FRAME],
    length: usize,
}

impl Default for Deframer {
    fn default() -> Self {
        Self::new()
    }
}

impl Deframer {
    /// At the beginning of a stream.
    pub const fn new() -> Self {
        Self {
            buffer: [0; MAX_FRAME],
            length: 0,
        }
    }

    /// Takes bytes up to the first delimiter. Returns how many were taken, never none of a non-empty slice,
    /// and the frame or the error that the delimiter ended, if one came. Empty frames are skipped.
    ///
    /// A stretch without delimiter that is longer than any frame is one [`FrameError::TooLong`], told at its
    /// end.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Result<Packet<'_>, FrameError>>) {
        let end = bytes.iter().position(|&byte| byte == DELIMITER);
        let part = bytes.get(..end.unwrap_or(bytes.len())).unwrap_or(&[]);
        let length = self.length.saturating_add(part.len());
        if let Some(room) = self.buffer.get_mut(self.length..length) {
            room.copy_from_slice(part);
        }
        // A length past the buffer marks an overlong frame until its delimiter comes.
        self.length = length.min(MAX_FRAME + 1);
        let Some(end) = end else {
            return (bytes.len(), None);
        };
        let length = core::mem::take(&mut self.length);
        let packet = match self.buffer.get_mut(..length) {
            Some([]) => None,
            Some(stuffed) => Some(Packet::open(stuffed)),
            None => Some(Err(FrameError::TooLong)),
        };
        (end + 1, packet)
    }
}

/// CRC-32/ISO-HDLC of a frame's content.
#[cfg(feature = "fast-crc")]
fn checksum(content: &[u8]) -> u32 {
    crc32fast::hash(content)
}

/// CRC-32/ISO-HDLC of a frame's content.
#[cfg(not(feature = "fast-crc"))]
fn checksum(content: &[u8]) -> u32 {
    by_words(content)
}

#[cfg(any(test, not(feature = "fast-crc")))]
fn by_words(content: &[u8]) -> u32 {
    let [last, second, third, fourth] = &CRC_TABLES;
    let at = |table: &[u32; 256], byte: u32| table[(byte & 0xFF) as usize];
    let (words, odd) = content.as_chunks::<WORD>();
    let mut sum = u32::MAX;
    for word in words {
        let x = sum ^ u32::from_le_bytes(*word);
        sum = at(fourth, x) ^ at(third, x >> 8) ^ at(second, x >> 16) ^ at(last, x >> 24);
    }
    for byte in odd {
        sum = sum >> 8 ^ at(last, sum ^ u32::from(*byte));
    }
    !sum
}

/// `[n][b]`: the remainder of the byte `b` with `n` zeros after it. Four bytes are looked up at once: sixteen take 16 KiB of
/// tables, which no microcontroller's cache holds.
#[cfg(any(test, not(feature = "fast-crc")))]
static CRC_TABLES: [[u32; 256]; WORD] = crc_tables();

#[cfg(any(test, not(feature = "fast-crc")))]
const fn crc_tables() -> [[u32; 256]; WORD] {
    let mut tables = [[0; 256]; WORD];
    let mut byte = 0;
    while byte < 256 {
        let (mut sum, mut zeros) = (byte as u32, 0);
        while zeros < WORD {
            let mut bit = 0;
            while bit < 8 {
                sum = if sum & 1 == 0 {
                    sum >> 1
                } else {
                    sum >> 1 ^ 0xEDB8_8320
                };
                bit += 1;
            }
            tables[zeros][byte] = sum;
            zeros += 1;
        }
        byte += 1;
    }
    tables
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_by_words_is_that_of_bit_by_bit_for_every_length() {
        // The check value of the catalogue of CRC algorithms.
        assert_eq!(by_words(b"123456789"), 0xCBF4_3926);
        let bytes: [u8; 40] = core::array::from_fn(|n| (n * n * 31 + 7) as u8);
        for end in 0..=bytes.len() {
            let mut sum = u32::MAX;
            for byte in &bytes[..end] {
                sum ^= u32::from(*byte);
                for _ in 0..8 {
                    sum = (sum >> 1) ^ ((sum & 1) * 0xEDB8_8320);
                }
            }
            assert_eq!(by_words(&bytes[..end]), !sum, "{end}");
        }
    }
}
