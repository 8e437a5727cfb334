//! The line from the host: USART3 by DMA1, stream 1 (RM0090, table 42: channel 4), into a ring.

use core::sync::atomic::AtomicU8;

use embassy_stm32::mode::Async;
use embassy_stm32::pac;
use embassy_stm32::pac::dma::regs::{Cr, Ndtr};
use embassy_stm32::pac::dma::vals::Dir;
use embassy_stm32::usart::UartRx;

use crate::boards::receiver::{RING, Ring};

const STREAM: usize = 1;
const CHANNEL: u8 = 4;

/// The port's receiving half as the HAL set it up.
pub type Pins = UartRx<'static, Async>;

/// What comes.
pub static BYTES: Ring = [const { AtomicU8::new(0) }; RING];

/// Bytes until the DMA begins the ring anew.
#[inline]
pub fn remaining() -> u16 {
    pac::DMA1.st(STREAM).ndtr().read().ndt()
}

/// Starts to receive on the port as the HAL set it up.
pub fn start() {
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
}

/// True if the flags tell of a spoilt byte, which is thrown away.
pub fn take_errors() -> bool {
    let flags = pac::USART3.sr().read();
    let spoilt = flags.ore() || flags.fe() || flags.ne();
    if spoilt {
        // Flags are cleared by reading one register after the other.
        pac::USART3.dr().read();
    }
    spoilt
}
