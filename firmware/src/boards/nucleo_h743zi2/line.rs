//! The line to the host: USART3 by DMA1, stream 1 from it into a ring and stream 3 to it (RM0433, table 121: requests 45
//! and 46). The HAL sets up pins and baud; it sends from where the frame lies, which no DMA reaches here. Bufferable transfers
//! keep a stream from staying locked (ES0392, 2.20.4).

use core::convert::Infallible;
use core::future::poll_fn;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering, fence};
use core::task::Poll;

use embassy_stm32::mode::Blocking;
use embassy_stm32::pac;
use embassy_stm32::pac::dma::regs::{Cr, Ixr, Ndtr};
use embassy_stm32::pac::dma::vals::Dir;
use embassy_stm32::usart::Uart;
use embassy_sync::waitqueue::AtomicWaker;
use embedded_io::ErrorType;
use embedded_io_async::Write;
use shared::wire::framing::MAX_FRAME;

use crate::boards::receiver::{RING, Ring};

const STREAM_IN: usize = 1;
const STREAM_OUT: usize = 3;
const REQUESTS: [(usize, u8); 2] = [(STREAM_IN, 45), (STREAM_OUT, 46)];

/// Every flag of a stream in its register, of which each has four streams.
const FLAGS_OUT: Ixr = Ixr(0x3D << 22);

/// Words of the longest frame.
const WORDS: usize = MAX_FRAME.div_ceil(4);

/// The port as the HAL set it up.
pub type Pins = Uart<'static, Blocking>;

/// What comes.
// SAFETY: the section is memory like any other, and every access is atomic; what it holds before does not matter.
#[allow(unsafe_code)]
#[unsafe(link_section = ".dma")]
pub static BYTES: Ring = [const { AtomicU8::new(0) }; RING];

/// What goes.
// SAFETY: as above.
#[allow(unsafe_code)]
#[unsafe(link_section = ".dma")]
static OUT: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

static WAKER: AtomicWaker = AtomicWaker::new();

/// Bytes until the DMA begins the ring anew.
#[inline]
pub fn remaining() -> u16 {
    pac::DMA1.st(STREAM_IN).ndtr().read().ndt()
}

/// Starts to receive on the port as the HAL set it up.
pub fn start() {
    for (stream, request) in REQUESTS {
        let multiplexer = pac::DMAMUX1.ccr(stream);
        multiplexer.write(|w| w.set_dmareq_id(request));
    }
    let stream = pac::DMA1.st(STREAM_IN);
    stream.par().write_value(pac::USART3.rdr().as_ptr() as u32);
    stream.m0ar().write_value(BYTES.as_ptr() as u32);
    stream.ndtr().write_value(Ndtr(RING as u32));
    stream.cr().write(|w| {
        w.set_minc(true);
        w.set_circ(true);
        w.set_trbuff(true);
        w.set_dir(Dir::PERIPHERAL_TO_MEMORY);
        w.set_en(true);
    });
    let stream = pac::DMA1.st(STREAM_OUT);
    stream.par().write_value(pac::USART3.tdr().as_ptr() as u32);
    stream.m0ar().write_value(OUT.as_ptr() as u32);
    pac::USART3.cr3().modify(|w| {
        w.set_dmar(true);
        w.set_dmat(true);
    });
}

/// True if the flags tell of a spoilt byte, which is thrown away.
pub fn take_errors() -> bool {
    let flags = pac::USART3.isr().read();
    let spoilt = flags.ore() || flags.fe() || flags.ne();
    if spoilt {
        pac::USART3.icr().write(|w| {
            w.set_ore(true);
            w.set_fe(true);
            w.set_ne(true);
        });
        // The DMA does not fetch a byte that came with an error.
        pac::USART3.rdr().read();
    }
    spoilt
}

/// What was sent has left the memory: to be called by the interrupt of stream 3 and by nobody else.
pub fn on_sent() {
    pac::DMA1.ifcr(0).write_value(FLAGS_OUT);
    WAKER.wake();
}

/// What goes to the host.
pub struct Sender;

impl Sender {
    fn begin(bytes: &[u8]) {
        // One that was given up is still under way.
        let stream = pac::DMA1.st(STREAM_OUT);
        stream.cr().write_value(Cr(0));
        while stream.cr().read().en() {}
        pac::DMA1.ifcr(0).write_value(FLAGS_OUT);
        for (to, piece) in OUT.iter().zip(bytes.chunks(4)) {
            let mut word = [0; 4];
            for (to, from) in word.iter_mut().zip(piece) {
                *to = *from;
            }
            to.store(u32::from_le_bytes(word), Ordering::Relaxed);
        }
        fence(Ordering::SeqCst);
        cortex_m::asm::dsb();
        stream.ndtr().write_value(Ndtr(bytes.len() as u32));
        stream.cr().write(|w| {
            w.set_minc(true);
            w.set_dir(Dir::MEMORY_TO_PERIPHERAL);
            w.set_trbuff(true);
            w.set_tcie(true);
            w.set_en(true);
        });
    }
}

impl ErrorType for Sender {
    type Error = Infallible;
}

impl Write for Sender {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let taken = bytes.len().min(4 * WORDS);
        Self::begin(bytes.get(..taken).unwrap_or(&[]));
        poll_fn(|context| {
            WAKER.register(context.waker());
            if pac::DMA1.st(STREAM_OUT).cr().read().en() {
                Poll::Pending
            } else {
                Poll::Ready(())
            }
        })
        .await;
        Ok(taken)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
