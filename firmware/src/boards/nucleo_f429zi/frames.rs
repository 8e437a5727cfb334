//! Frames over SPI4 by DMA2, stream 0 in and stream 1 out (RM0090, table 43: channel 4 of both).
//!
//! The HAL sets up pins and clock; for each transfer it would set up the peripheral and both streams anew, which takes
//! half of all the instructions of a sample. Here that is done once, and a transfer is a count and an enable bit for each
//! stream.

use core::sync::atomic::{AtomicU32, Ordering, fence};

use embassy_stm32::pac;
use embassy_stm32::pac::dma::regs::{Cr, Ixr, Ndtr};
use embassy_stm32::pac::dma::vals::{Dir, Pl};
use firmware::adc::frame::{FRAME, WORDS};

use crate::boards::conveyor::Memory;

/// What goes out.
pub static OUT: Memory = [const { AtomicU32::new(0) }; WORDS];

/// What comes in.
pub static IN: Memory = [const { AtomicU32::new(0) }; WORDS];

const STREAM_IN: usize = 0;
const STREAM_OUT: usize = 1;

/// Channel 4 of either stream is SPI4.
const CHANNEL: u8 = 4;

/// The chip select is pin 4 of port E.
const SELECT: u32 = 1 << 4;

/// Every flag of both streams (RM0090, 10.5.3); a stream cannot be enabled with one set.
const FLAGS: Ixr = Ixr(0x3D << (6 * STREAM_IN) | 0x3D << (6 * STREAM_OUT));

/// How often the receive buffer is looked at before it is given up: some 20 cycles each, 20 us in all.
const DRAIN_READS: u32 = 200;

/// The control words of the two streams as they run.
static CONTROL: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];

/// Sets up the streams for SPI4 as the HAL set it up.
pub fn start() {
    let ways = [Dir::PERIPHERAL_TO_MEMORY, Dir::MEMORY_TO_PERIPHERAL];
    for (stream, (memory, way)) in [&IN, &OUT].into_iter().zip(ways).enumerate() {
        let registers = pac::DMA2.st(stream);
        registers.par().write_value(pac::SPI4.dr().as_ptr() as u32);
        registers.m0ar().write_value(memory.as_ptr() as u32);
        let mut control = Cr(0);
        control.set_chsel(CHANNEL);
        control.set_minc(true);
        control.set_dir(way);
        if stream == STREAM_IN {
            // A byte that comes must be fetched before the next one is sent.
            control.set_pl(Pl::VERY_HIGH);
            control.set_tcie(true);
            control.set_teie(true);
        }
        control.set_en(true);
        CONTROL[stream].store(control.0, Ordering::Relaxed);
    }
    pac::SPI4.cr2().modify(|w| {
        w.set_rxdmaen(true);
        w.set_txdmaen(true);
    });
    pac::SPI4.cr1().modify(|w| w.set_spe(true));
}

/// Throws away a byte that a transfer left in the data register when it was broken off: it would come as the first of the
/// next frame, and shift that one and all after it.
#[inline]
fn drop_left_byte() {
    if pac::SPI4.sr().read().rxne() {
        pac::SPI4.dr().read();
    }
}

/// Sends [`OUT`] and receives into [`IN`].
#[inline]
pub fn begin() {
    drop_left_byte();
    pac::GPIOE.bsrr().write(|w| w.0 = SELECT << 16);
    // What was written to `OUT` has to be in memory before the DMA reads it.
    fence(Ordering::SeqCst);
    for stream in [STREAM_IN, STREAM_OUT] {
        let registers = pac::DMA2.st(stream);
        registers.ndtr().write_value(Ndtr(FRAME as u32));
        let control = CONTROL[stream].load(Ordering::Relaxed);
        registers.cr().write_value(Cr(control));
    }
}

/// The last byte came in, or the DMA could not go on: ends the frame; true if it is whole.
#[inline]
pub fn end() -> bool {
    let sound = !pac::DMA2.isr(0).read().teif(STREAM_IN);
    pac::GPIOE.bsrr().write(|w| w.0 = SELECT);
    if !sound {
        // The other stream may still be waiting for its turn.
        pac::DMA2.st(STREAM_OUT).cr().write_value(Cr(0));
    }
    pac::DMA2.ifcr(0).write_value(FLAGS);
    fence(Ordering::SeqCst);
    sound
}

/// Breaks a frame off.
pub fn abort() {
    for stream in [STREAM_OUT, STREAM_IN] {
        pac::DMA2.st(stream).cr().write_value(Cr(0));
    }
    pac::GPIOE.bsrr().write(|w| w.0 = SELECT);
    pac::DMA2.ifcr(0).write_value(FLAGS);
}

/// Empties the receive buffer: a byte in it would be taken for the first of the next frame, and leave that frame's last
/// for the one after it (RM0090, 28.3.8: read until RXNE is clear; 28.3.10: data and then status clear an overrun).
pub fn drain() {
    // One byte in the buffer, one in the shift register, each a byte's time of at most 2 us.
    for _ in 0..DRAIN_READS {
        let status = pac::SPI4.sr().read();
        if status.rxne() || status.ovr() {
            let _ = pac::SPI4.dr().read();
        } else if !status.bsy() {
            break;
        }
    }
}
