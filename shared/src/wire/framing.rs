//! Frames: COBS with delimiter 0x00, CRC-32, sequence number, protocol version.
//!
//! Consistent overhead byte stuffing (Cheshire and Baker, 1999) is written out here, because both sides
//! need it in place and over whole runs: the released crate goes byte by byte, at a third of the speed that
//! a recorded stream of raw samples is read with. The tests hold it against that crate.
//!
//! The checksum is CRC-32/ISO-HDLC (polynomial 0x04C11DB7 reflected, initial value and final exclusive-or all
//! ones). With the feature `fast-crc` it comes from `crc32fast` (carry-less multiplication on the host),
//! without it from `crc` with tables of 16 KiB, sixteen bytes at a time (the instrument). Both give the same bytes.

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
        // The content is laid down at the end of the buffer and stuffed towards its beginning: the output
        // grows by one byte a run and so never overtakes the input.
        let content = &mut self.bytes[STUFFING..];
        content[0] = message.version().0;
        content[1..HEADER].copy_from_slice(&sequence.to_le_bytes());
        let message = postcard::to_slice(message, &mut content[HEADER..HEADER + MAX_MESSAGE])
            .map_err(|_| EncodeError::TooLong)?
            .len();
        let end = HEADER + message;
        let sum = checksum(&content[..end]);
        content[end..end + CHECKSUM].copy_from_slice(&sum.to_le_bytes());
        let stuffed = stuff_down(&mut self.bytes, STUFFING, STUFFING + end + CHECKSUM);
        self.bytes[stuffed] = DELIMITER;
        self.length = stuffed + 1;
        Ok(())
    }
}

/// Stuffs `bytes[from..to]` to the beginning of `bytes`; returns the stuffed length. Four bytes at a time where none of
/// them is zero and the open run has room for all, as in raw samples; else byte by byte: a message has many zeros, and
/// moving the short runs between them takes longer to begin than to do.
fn stuff_down(bytes: &mut [u8; MAX_FRAME], from: usize, to: usize) -> usize {
    // Where the open run's code byte goes, and where its next byte.
    let (mut code, mut out) = (0, 1);
    let mut at = from;
    while at < to {
        // A full run has no zero after it; a shorter one ends at a zero, which the code byte stands for.
        if out - code == RUN + 1 {
            bytes[code] = u8::MAX;
            (code, out) = (out, out + 1);
        }
        if at + WORD <= to
            && out + WORD <= code + RUN + 1
            && let Some(&word) = bytes[at..].first_chunk::<WORD>()
            && let Some(place) = bytes[out..].first_chunk_mut::<WORD>()
            && !has_zero(u32::from_ne_bytes(word))
        {
            *place = word;
            out += WORD;
            at += WORD;
            continue;
        }
        match bytes[at] {
            0 => {
                bytes[code] = (out - code) as u8;
                (code, out) = (out, out + 1);
            }
            byte => {
                bytes[out] = byte;
                out += 1;
            }
        }
        at += 1;
    }
    bytes[code] = (out - code) as u8;
    out
}

/// Bytes of a word.
const WORD: usize = 4;

/// True if a byte of the word is zero: only there a borrow reaches the highest bit of a byte that had it clear.
#[inline]
const fn has_zero(word: u32) -> bool {
    word.wrapping_sub(0x0101_0101) & !word & 0x8080_8080 != 0
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
    static CRC: crc::Crc<u32, crc::Table<16>> =
        crc::Crc::<u32, crc::Table<16>>::new(&crc::CRC_32_ISO_HDLC);
    CRC.checksum(content)
}
