//! Frames, without any input or output (section 8.5.1).
//!
//! To the converter: a command, the registers that it writes, the checksum of both, zeros. From it: the answer to the
//! *previous* frame's command, a word for each channel, the checksum of all of them. Words of commands, answers, registers
//! and checksums have 16 bits, filled up with zeros on the right.

use crate::format::Format;
use crate::registers::Register;
use crate::status::Status;

/// A command to the converter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// Nothing; answered by the status word.
    Null,
    /// Back to the state after power-up. Needs a whole frame.
    Reset,
    /// Stop converting and save current; the settings stay.
    StandBy,
    /// Convert again.
    WakeUp,
    /// Take nothing but [`Self::Null`], [`Self::Read`] and [`Self::Unlock`].
    Lock,
    /// The contrary.
    Unlock,
    /// Read a register; answered by its content.
    #[doc(alias = "RREG")]
    Read(Register),
    /// Write a register. It is written even if the checksum of the frame is wrong (section 8.5.1.10.8).
    #[doc(alias = "WREG")]
    Write(Register, u16),
}

impl Command {
    /// The command word (table 8-11).
    pub const fn word(self) -> u16 {
        match self {
            Self::Null => 0x0000,
            Self::Reset => 0x0011,
            Self::StandBy => 0x0022,
            Self::WakeUp => 0x0033,
            Self::Lock => 0x0555,
            Self::Unlock => 0x0655,
            Self::Read(register) => 0b101 << 13 | (register.address() as u16) << 7,
            Self::Write(register, _) => 0b011 << 13 | (register.address() as u16) << 7,
        }
    }

    /// The answer that the next frame begins with, where it does not depend on the converter's state.
    pub const fn answer(self, channels: usize) -> Option<u16> {
        match self {
            Self::Null | Self::Read(_) => None,
            Self::Reset => Some(reset_answer(channels)),
            Self::StandBy | Self::WakeUp | Self::Lock | Self::Unlock => Some(self.word()),
            Self::Write(register, _) => Some(0b010 << 13 | (register.address() as u16) << 7),
        }
    }

    /// Writes the frame that carries it, all of `frame`. The checksum is always there: the converter disregards it
    /// unless told to check it.
    pub const fn encode(self, frame: &mut [u8], format: Format) {
        let bytes = format.word_length.bytes();
        let mut end = put(frame, 0, bytes, self.word());
        if let Self::Write(_, value) = self {
            end = put(frame, end, bytes, value);
        }
        if end <= frame.len() {
            let sum = format.polynomial.checksum(frame.split_at(end).0);
            end = put(frame, end, bytes, sum);
        }
        while end < frame.len() {
            frame[end] = 0;
            end += 1;
        }
    }
}

/// Writes a word of that many bytes, as far as there is room; where the next one begins.
const fn put(frame: &mut [u8], start: usize, bytes: usize, word: u16) -> usize {
    let [high, low] = word.to_be_bytes();
    let end = start + bytes;
    if end <= frame.len() {
        frame[start] = high;
        frame[start + 1] = low;
        let mut k = start + 2;
        while k < end {
            frame[k] = 0;
            k += 1;
        }
    }
    end
}

/// The answer of the first frame after a reset: 0xFF2n, n channels.
pub const fn reset_answer(channels: usize) -> u16 {
    0xFF20 | channels as u16
}

/// A frame from the converter whose checksum is right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Response<const CHANNELS: usize> {
    /// Answer to the previous command: the status word, a register or an acknowledgement.
    pub word: u16,
    /// Codes of the channels, on the scale of 24 bits with sign whatever the length of the words.
    pub codes: [i32; CHANNELS],
}

impl<const CHANNELS: usize> Response<CHANNELS> {
    /// The status word, of a frame that follows a null command.
    pub const fn status(&self) -> Status {
        Status(self.word)
    }

    /// Opens a frame.
    ///
    /// # Errors
    /// The checksum is wrong. A frame that is too short is told as one whose checksum was sent as zero.
    #[inline]
    pub fn decode(frame: &[u8], format: Format) -> Result<Self, ChecksumError> {
        let bytes = format.word_length.bytes();
        let end = (CHANNELS + 1) * bytes;
        let covered = frame.get(..end).unwrap_or(frame);
        let computed = format.polynomial.checksum(covered);
        let sent = match frame.get(end..) {
            Some(&[high, low, ..]) => u16::from_be_bytes([high, low]),
            _ => return Err(ChecksumError { sent: 0, computed }),
        };
        if sent != computed {
            return Err(ChecksumError { sent, computed });
        }
        let mut words = covered.chunks_exact(bytes);
        let word = match words.next() {
            Some(&[high, low, ..]) => u16::from_be_bytes([high, low]),
            _ => 0,
        };
        let mut codes = [0; CHANNELS];
        for (code, word) in codes.iter_mut().zip(words) {
            *code = format.word_length.code(word);
        }
        Ok(Self { word, codes })
    }
}

/// The checksum of a frame from the converter is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ChecksumError {
    /// As sent by the converter.
    pub sent: u16,
    /// As computed from what arrived.
    pub computed: u16,
}

impl core::fmt::Display for ChecksumError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { sent, computed } = self;
        write!(f, "checksum {sent:#06x}, computed {computed:#06x}")
    }
}

impl core::error::Error for ChecksumError {}
