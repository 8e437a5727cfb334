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

/// Words of memory that hold a frame.
pub const WORDS: usize = FRAME.div_ceil(4);

/// Opens a frame from the converter that lies in words of memory, the first byte lowest, as [`Response::decode`] does, which
/// takes frames of any format and so takes longer. What follows the frame in the last word does not matter.
///
/// # Errors
/// Its checksum is wrong.
#[inline]
pub fn decode(words: [u32; WORDS]) -> Result<Response, ChecksumError> {
    // a to e are the words as they came: status | A, A | B, B | C, D | checksum, checksum.
    let [a, b, c, d, e] = words.map(u32::swap_bytes);
    let sent = (d << 8 | e >> 24) as u16;
    // The remainder of a message with its checksum behind it is zero.
    let with_checksum = Polynomial::Ccitt.checksum_of_words([a, b, c, d], (e >> 24) as u8);
    if with_checksum != 0 {
        let bytes = [a, b, c, d].map(u32::to_be_bytes);
        let computed = Polynomial::Ccitt.checksum(&bytes.as_flattened()[..FRAME - 3]);
        return Err(ChecksumError { sent, computed });
    }
    Ok(Response {
        word: (a >> 16) as u16,
        codes: [
            code(a << 24 | b >> 16 << 8),
            code(b << 16 | c >> 24 << 8),
            code(c << 8),
            code(d),
        ],
    })
}

/// The code in the upper 24 bits, two's complement.
#[inline]
const fn code(word: u32) -> i32 {
    word as i32 >> 8
}

/// The bytes of a frame as they lie in words of memory.
#[inline]
pub fn words(frame: &[u8; FRAME]) -> [u32; WORDS] {
    let mut words = [0; WORDS];
    for (word, bytes) in words.iter_mut().zip(frame.chunks(4)) {
        let mut four = [0; 4];
        for (to, from) in four.iter_mut().zip(bytes) {
            *to = *from;
        }
        *word = u32::from_le_bytes(four);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_by_words_open_as_those_of_any_format_do() {
        let mut state = 1u32;
        for n in 0..5000 {
            let mut frame = [0; FRAME];
            for byte in &mut frame[..FRAME - 3] {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *byte = (state >> 24) as u8;
            }
            let sum = Polynomial::Ccitt.checksum(&frame[..FRAME - 3]);
            frame[FRAME - 3..FRAME - 1].copy_from_slice(&sum.to_be_bytes());
            if n % 2 == 0 {
                frame[n % (FRAME - 1)] ^= 1 << (n % 8);
            }
            assert_eq!(decode(words(&frame)), Response::decode(&frame, FORMAT));
            // What lies behind it does not matter.
            let mut behind = words(&frame);
            behind[WORDS - 1] |= 0xFFFF_0000;
            assert_eq!(decode(behind), Response::decode(&frame, FORMAT));
        }
    }
}
