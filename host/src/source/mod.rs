//! Where the bytes of an instrument come from.

mod file;
mod instrument;
mod serial;

use std::io;

pub use file::FileSource;
pub use instrument::{Hand, InstrumentSource, order_of};
pub use serial::{BAUD, SerialSource};

/// A live or recorded instrument. Bytes are read as from any [`io::Read`]: 0 bytes are the end, an error of
/// kind `TimedOut` or `WouldBlock` means that nothing has come yet.
pub trait Source: io::Read {
    /// What to call it in a message: a file, a port, the virtual bench.
    fn name(&self) -> String;

    /// Sends the bytes of a command's frame.
    ///
    /// # Errors
    /// What the link reports; `Unsupported` if nobody listens.
    fn send(&mut self, frame: &[u8]) -> io::Result<()>;
}
