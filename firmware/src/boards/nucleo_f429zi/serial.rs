//! What comes from the host: USART3 by DMA1, stream 1 (RM0090, table 42: channel 4), into a ring.
//!
//! The HAL's ring receiver reads the data register whenever it looks at the flags, and takes a byte away if one has just
//! come that the DMA has not fetched. This one reads it only where the flags tell of a byte that is spoilt anyway.

use core::sync::atomic::{AtomicU8, Ordering};

use embassy_stm32::mode::Async;
use embassy_stm32::pac;
use embassy_stm32::pac::dma::regs::{Cr, Ndtr};
use embassy_stm32::pac::dma::vals::Dir;
use embassy_stm32::usart::UartRx;
use embedded_io::{ErrorKind, ErrorType, Read, ReadReady};

/// Bytes of the ring: what comes in 20 ms at 1 Mbaud. It is looked at when bytes have come, and every few milliseconds
/// in any case.
const RING: usize = 2048;

const STREAM: usize = 1;
const CHANNEL: u8 = 4;

/// Nobody holds a reference to a byte, and every access is atomic.
static BYTES: [AtomicU8; RING] = [const { AtomicU8::new(0) }; RING];

/// Changes with each byte that comes, since the DMA counts them: a look at it costs nothing and takes nothing.
#[inline]
pub fn received() -> u16 {
    pac::DMA1.st(STREAM).ndtr().read().ndt()
}

/// The host's bytes.
pub struct Receiver {
    _pins: UartRx<'static, Async>,
    /// Where the next byte is read.
    next: usize,
}

impl Receiver {
    /// Starts to receive on the port as the HAL set it up.
    pub fn start(pins: UartRx<'static, Async>) -> Self {
        let stream = pac::DMA1.st(STREAM);
        stream.par().write_value(pac::USART3.dr().as_ptr() as u32);
        stream.m0ar().write_value(BYTES.as_ptr() as u32);
        stream.ndtr().write_value(Ndtr(RING as u32));
        let mut control = Cr(0);
        control.set_chsel(CHANNEL);
        control.set_minc(true);
        control.set_circ(true);
        control.set_dir(Dir::PERIPHERAL_TO_MEMORY);
        control.set_en(true);
        stream.cr().write_value(control);
        pac::USART3.cr3().modify(|w| w.set_dmar(true));
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
        let flags = pac::USART3.sr().read();
        if flags.ore() || flags.fe() || flags.ne() {
            // Flags are cleared by reading one register after the other.
            pac::USART3.dr().read();
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
