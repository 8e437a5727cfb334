//! Frames over SPI4 by DMA2, stream 0 in and stream 1 out (RM0433, table 121: requests 83 and 84).
//!
//! The HAL sets up pins and clock. A frame is a transfer of fixed size: both streams, then the port are enabled, and the port
//! is switched off again when the last byte has come, which empties its buffers (RM0433, 50.4.9).

use core::sync::atomic::{AtomicU32, Ordering, fence};

use embassy_stm32::pac;
use embassy_stm32::pac::dma::regs::{Cr, Ixr, Ndtr};
use embassy_stm32::pac::dma::vals::{Dir, Pl};
use embassy_stm32::pac::spi::regs::{Cr1, Ifcr};
use firmware::adc::frame::{FRAME, WORDS};

use crate::boards::conveyor::Memory;

/// What goes out.
// SAFETY: the section is memory like any other, and every access is atomic; what it holds before does not matter.
#[allow(unsafe_code)]
#[unsafe(link_section = ".dma")]
pub static OUT: Memory = [const { AtomicU32::new(0) }; WORDS];

/// What comes in.
// SAFETY: as above.
#[allow(unsafe_code)]
#[unsafe(link_section = ".dma")]
pub static IN: Memory = [const { AtomicU32::new(0) }; WORDS];

const STREAM_IN: usize = 0;
const STREAM_OUT: usize = 1;

/// Requests of the port to the multiplexer, and the multiplexer's channel of DMA2's first stream.
const REQUESTS: [u8; 2] = [83, 84];
const FIRST_CHANNEL: usize = 8;

/// The chip select is pin 4 of port E.
const SELECT: u32 = 1 << 4;

/// Every flag of both streams (RM0433, 15.5.3); a stream cannot be enabled with one set.
const FLAGS: Ixr = Ixr(0x3D << (6 * STREAM_IN) | 0x3D << (6 * STREAM_OUT));

/// Every flag of the port that can be cleared (RM0433, 50.11.7).
const PORT_FLAGS: Ifcr = Ifcr(0xFF8);

/// The control words of the two streams as they run.
static CONTROL: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];

/// The port as it waits; with its enable bit; with its enable bit as it runs.
static PORT: [AtomicU32; 3] = [const { AtomicU32::new(0) }; 3];

/// Sets up the streams for SPI4 as the HAL set it up.
pub fn start() {
    let mut port = pac::SPI4.cr1().read();
    port.set_spe(false);
    pac::SPI4.cr1().write_value(port);
    let ways = [Dir::PERIPHERAL_TO_MEMORY, Dir::MEMORY_TO_PERIPHERAL];
    let data = [
        pac::SPI4.rxdr8().as_ptr() as u32,
        pac::SPI4.txdr8().as_ptr() as u32,
    ];
    for (stream, (memory, way)) in [&IN, &OUT].into_iter().zip(ways).enumerate() {
        let multiplexer = pac::DMAMUX1.ccr(FIRST_CHANNEL + stream);
        multiplexer.write(|w| w.set_dmareq_id(REQUESTS[stream]));
        let registers = pac::DMA2.st(stream);
        registers.par().write_value(data[stream]);
        registers.m0ar().write_value(memory.as_ptr() as u32);
        let mut control = Cr(0);
        control.set_minc(true);
        control.set_dir(way);
        if stream == STREAM_IN {
            // A byte that comes must be fetched before the buffer is full.
            control.set_pl(Pl::VERY_HIGH);
            control.set_tcie(true);
            control.set_teie(true);
        }
        control.set_en(true);
        CONTROL[stream].store(control.0, Ordering::Relaxed);
    }
    pac::SPI4.cr2().write(|w| w.set_tsize(FRAME as u16));
    pac::SPI4.cfg1().modify(|w| {
        w.set_rxdmaen(true);
        w.set_txdmaen(true);
    });
    let mut enabled = port;
    enabled.set_spe(true);
    let mut runs = enabled;
    runs.set_cstart(true);
    for (to, control) in PORT.iter().zip([port, enabled, runs]) {
        to.store(control.0, Ordering::Relaxed);
    }
}

#[inline]
fn switch(to: usize) {
    let control = PORT[to].load(Ordering::Relaxed);
    pac::SPI4.cr1().write_value(Cr1(control));
}

/// Sends [`OUT`] and receives into [`IN`].
#[inline]
pub fn begin() {
    pac::GPIOE.bsrr().write(|w| w.0 = SELECT << 16);
    // What was written to `OUT` has to be in memory before the DMA reads it.
    fence(Ordering::SeqCst);
    cortex_m::asm::dsb();
    for stream in [STREAM_IN, STREAM_OUT] {
        let registers = pac::DMA2.st(stream);
        registers.ndtr().write_value(Ndtr(FRAME as u32));
        let control = CONTROL[stream].load(Ordering::Relaxed);
        registers.cr().write_value(Cr(control));
    }
    switch(1);
    switch(2);
}

/// The last byte came in, or the DMA could not go on: ends the frame; true if it is whole.
#[inline]
pub fn end() -> bool {
    let sound = !pac::DMA2.isr(0).read().teif(STREAM_IN);
    if sound {
        release();
    } else {
        abort();
    }
    fence(Ordering::SeqCst);
    sound
}

/// Takes the chip select away and clears what is told of the frame.
#[inline]
fn release() {
    pac::GPIOE.bsrr().write(|w| w.0 = SELECT);
    switch(0);
    pac::SPI4.ifcr().write_value(PORT_FLAGS);
    pac::DMA2.ifcr(0).write_value(FLAGS);
}

/// Breaks a frame off.
pub fn abort() {
    for stream in [STREAM_OUT, STREAM_IN] {
        pac::DMA2.st(stream).cr().write_value(Cr(0));
    }
    release();
}

/// The port's buffers are emptied whenever it is switched off.
pub fn drain() {
    switch(0);
}
