//! What goes over the link between instrument and host: one schema for firmware, host and tools.
//!
//! A frame on the line is
//!
//! ```text
//! COBS( version: u8 | sequence: u16 LE | message: postcard | CRC-32: u32 LE ) | 0x00
//! ```
//!
//! [`version`] says who understands whom, [`message`] what is said ([`Command`] to the instrument, [`Event`]
//! from it), [`configuration`] what the instrument keeps, [`board`] what the board says of itself, [`framing`] how it is
//! packed. Nothing here allocates, and no sequence of bytes makes it panic.

pub mod board;
pub mod configuration;
pub mod framing;
pub mod message;
mod ranges;
pub mod version;

pub use framing::{Deframer, EncodeError, Frame, FrameError, Packet};
pub use message::{Command, Event, Message};
pub use version::Version;
