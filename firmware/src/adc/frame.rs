//! The frames of the four-channel converter as the acquisition reads them: six words of 24 bits, CCITT checksums.

pub use ads131m0x::frame::reset_answer;
pub use ads131m0x::{ChecksumError, Command, Format};

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

/// Opens a frame from the converter.
///
/// # Errors
/// Its checksum is wrong.
#[inline]
pub fn decode(frame: &[u8; FRAME]) -> Result<Response, ChecksumError> {
    Response::decode(frame, FORMAT)
}
