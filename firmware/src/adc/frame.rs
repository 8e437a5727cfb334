//! The frames of the four-channel converter as the acquisition reads them: six words of 24 bits, CCITT checksums.

pub use ads131m0x::frame::reset_answer;
pub use ads131m0x::{ChecksumError, Command, Format};

use ads131m0x::Polynomial;

/// Channels.
pub const CHANNELS: usize = 4;

/// How frames are written, before the converter is set up and after.
pub const FORMAT: Format = Format::RESET;

/// Bytes of a frame.
pub const FRAME: usize = FORMAT.frame_bytes(CHANNELS);

/// A frame from the converter whose checksum is sound.
pub type Response = ads131m0x::Response<CHANNELS>;

/// The frame of a command.
pub const fn encode(command: Command) -> [u8; FRAME] {
    let mut frame = [0; FRAME];
    command.encode(&mut frame, FORMAT);
    frame
}

/// The frame of [`Command::Null`], which reads a conversion.
pub const NULL: [u8; FRAME] = encode(Command::Null);

/// Opens a frame from the converter, as [`Response::decode`] does, which takes frames of any format and so takes longer.
///
/// # Errors
/// Its checksum is wrong.
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
    let computed = Polynomial::Ccitt.checksum(&frame[..FRAME - 3]);
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
const fn code([high, middle, low]: [u8; 3]) -> i32 {
    i32::from_be_bytes([high, middle, low, 0]) >> 8
}
