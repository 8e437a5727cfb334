//! What comes from the host, by DMA into a ring.
//!
//! The HAL's ring receiver reads the data register whenever it looks at the flags, and takes a byte away if one has just
//! come that the DMA has not fetched. This one reads it only where the flags tell of a byte that is spoilt anyway.

use core::sync::atomic::{AtomicU8, Ordering};

use embedded_io::{ErrorKind, ErrorType, Read, ReadReady};

use super::board::line::{self, BYTES, Pins};

/// Bytes of the ring: what comes in 20 ms at 1 Mbaud. It is looked at when bytes have come, and every few milliseconds
/// in any case.
pub const RING: usize = 2048;

/// The ring: nobody holds a reference to a byte, and every access is atomic.
pub type Ring = [AtomicU8; RING];

/// Changes with each byte that comes, since the DMA counts them: a look at it costs nothing and takes nothing.
#[inline]
pub fn received() -> u16 {
    line::remaining()
}

/// The host's bytes.
pub struct Receiver {
    _pins: Pins,
    /// Where the next byte is read.
    next: usize,
}

impl Receiver {
    /// Starts to receive on the port as the HAL set it up.
    pub fn start(pins: Pins) -> Self {
        line::start();
        Self {
            _pins: pins,
            next: 0,
        }
    }

    /// Where the DMA writes next.
    fn end(&self) -> usize {
        RING.saturating_sub(usize::from(received())) % RING
    }
}

impl ErrorType for Receiver {
    type Error = ErrorKind;
}

impl ReadReady for Receiver {
    fn read_ready(&mut self) -> Result<bool, ErrorKind> {
        if line::take_errors() {
            return Err(ErrorKind::Other);
        }
        Ok(self.end() != self.next)
    }
}

impl Read for Receiver {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, ErrorKind> {
        let end = self.end();
        let mut count = 0;
        for byte in bytes {
            if self.next == end {
                break;
            }
            if let Some(from) = BYTES.get(self.next) {
                *byte = from.load(Ordering::Relaxed);
            }
            self.next = (self.next + 1) % RING;
            count += 1;
        }
        Ok(count)
    }
}
