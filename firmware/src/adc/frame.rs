//! Frames of the ADS131M04, without any input or output: six words of 24 bits each way, most significant byte
//! first, their checksum CRC-16/CCITT with initial value 0xFFFF (data sheet SBAS890, section 8.5.1).
//!
//! To the converter: a command, the registers it writes, the checksum of both, zeros. From it: the answer to the
//! *previous* frame's command (the status word after a null command), four channels, the checksum of all five.

use super::registers::{Register, Status};

/// Bytes of a frame.
pub const FRAME: usize = 18;

const WORD: usize = 3;

/// Answer to the first frame after a reset: 0xFF and the number of channels.
pub const RESET_RESPONSE: u16 = 0xFF24;

/// A command to the converter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Nothing; answered by the status word.
    Null,
    /// Back to the state after power-up.
    Reset,
    /// Lock out everything that changes the converter.
    Lock,
    /// The contrary.
    Unlock,
    /// Read one register; answered by its content.
    Read(Register),
    /// Write one register.
    Write(Register, u16),
}

impl Command {
    /// The command word.
    pub const fn word(self) -> u16 {
        match self {
            Self::Null => 0x0000,
            Self::Reset => 0x0011,
            Self::Lock => 0x0555,
            Self::Unlock => 0x0655,
            Self::Read(register) => 0b101 << 13 | (register as u16) << 7,
            Self::Write(register, _) => 0b011 << 13 | (register as u16) << 7,
        }
    }

    /// The answer that the next frame begins with, where it does not depend on the converter.
    pub const fn response(self) -> Option<u16> {
        match self {
            Self::Null | Self::Read(_) => None,
            Self::Reset => Some(RESET_RESPONSE),
            Self::Lock | Self::Unlock => Some(self.word()),
            Self::Write(register, _) => Some(0b010 << 13 | (register as u16) << 7),
        }
    }

    /// The frame to send.
    pub fn frame(self) -> [u8; FRAME] {
        let mut frame = [0; FRAME];
        let [high, low] = self.word().to_be_bytes();
        frame[0] = high;
        frame[1] = low;
        let mut length = WORD;
        if let Self::Write(_, value) = self {
            let [high, low] = value.to_be_bytes();
            frame[WORD] = high;
            frame[WORD + 1] = low;
            length = 2 * WORD;
        }
        let [high, low] = checksum(&frame[..length]).to_be_bytes();
        frame[length] = high;
        frame[length + 1] = low;
        frame
    }
}

/// The frame of [`Command::Null`], which reads a conversion.
pub const NULL: [u8; FRAME] = {
    let mut frame = [0; FRAME];
    let [high, low] = checksum(&[0; WORD]).to_be_bytes();
    frame[WORD] = high;
    frame[WORD + 1] = low;
    frame
};

/// A frame from the converter whose checksum is sound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Response {
    /// Answer to the previous command: the status word, a register or an acknowledgement.
    pub word: u16,
    /// Codes of the four channels.
    pub codes: [i32; 4],
}

impl Response {
    /// The status word, of a frame that follows a null command.
    pub const fn status(&self) -> Status {
        Status(self.word)
    }
}

/// The checksum of a frame from the converter is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChecksumError {
    /// As sent by the converter.
    pub sent: u16,
    /// As computed from what arrived.
    pub computed: u16,
}

/// Opens a frame from the converter.
#[inline]
pub fn decode(frame: &[u8; FRAME]) -> Result<Response, ChecksumError> {
    let [
        h,
        l,
        _,
        a2,
        a1,
        a0,
        b2,
        b1,
        b0,
        c2,
        c1,
        c0,
        d2,
        d1,
        d0,
        high,
        low,
        _,
    ] = *frame;
    let sent = u16::from_be_bytes([high, low]);
    let computed = checksum(&frame[..FRAME - WORD]);
    if sent != computed {
        return Err(ChecksumError { sent, computed });
    }
    Ok(Response {
        word: u16::from_be_bytes([h, l]),
        codes: [
            code([a2, a1, a0]),
            code([b2, b1, b0]),
            code([c2, c1, c0]),
            code([d2, d1, d0]),
        ],
    })
}

/// A code of 24 bits, two's complement.
#[inline]
const fn code([high, middle, low]: [u8; WORD]) -> i32 {
    i32::from_be_bytes([high, middle, low, 0]) >> 8
}

/// CRC-16/CCITT with initial value 0xFFFF (CRC-16/IBM-3740 in the catalogue of CRC algorithms).
#[inline]
pub const fn checksum(bytes: &[u8]) -> u16 {
    CRC.checksum(bytes)
}

static CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
