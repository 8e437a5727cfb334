//! The converter's bus: SPI4 by DMA2, stream 0 in and stream 1 out (RM0090, table 43: channel 4 of both).
//!
//! The HAL sets up pins and clock; for each transfer it would set up the peripheral and both streams anew, which takes
//! half of all the instructions of a sample. Here that is done once, and a transfer is a count and an enable bit for each
//! stream.
//!
//! **The conveyor.** While it runs, DRDY's interrupt starts the frame that reads the conversion, and the DMA's interrupt
//! opens it; the acquisition sleeps meanwhile and is woken for [`BATCH`] conversions. It runs only while each frame has
//! one DRDY edge more than the one before and a sound conversion. Where that is not so, or where there is no room, it
//! stops: then the driver, which counts the same edges, decides what the converter still holds.

use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU8, AtomicU32, Ordering, fence};
use core::task::Poll;

use embassy_stm32::gpio::Output;
use embassy_stm32::interrupt;
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac;
use embassy_stm32::pac::dma::regs::{Cr, Ixr, Ndtr};
use embassy_stm32::pac::dma::vals::{Dir, Pl};
use embassy_stm32::spi::{Spi, mode};
use embassy_sync::waitqueue::AtomicWaker;
use embedded_hal::spi::ErrorKind;
use firmware::adc::bus::{FetchError, Fetched, FrameBus, FrameError, open};
use firmware::adc::count::{Edge, Timers};
use firmware::adc::frame::{ChecksumError, FRAME, NULL, Response};
use firmware::adc::registers::{has_data, is_sound_but_for};
use shared::channels::CHANNELS;

use super::drdy::{self, DrdyTimers};

/// Conversions that wake the acquisition: fewer periods than the driver waits for the first.
const BATCH: u32 = 3;

/// Conversions that there is room for, a power of two: what the acquisition may be late.
const ROOM: u32 = 8;

/// How long a frame may take; at 10.5 MHz it takes 14 us.
const FRAME_US: u32 = 100;

/// How often the receive buffer is looked at before it is given up: some 20 cycles each, 20 us in all.
const DRAIN_READS: u32 = 200;

/// Words of memory that hold a frame.
const WORDS: usize = FRAME.div_ceil(4);

/// What the DMA reads or writes: nobody else holds a reference to it, and every access is atomic.
type Memory = [AtomicU32; WORDS];

/// What goes out.
static OUT: Memory = [const { AtomicU32::new(0) }; WORDS];

/// What comes in.
static IN: Memory = [const { AtomicU32::new(0) }; WORDS];

/// A conversion on the conveyor, as [`Fetched`] has it.
struct Slot {
    /// DRDY edges when its frame was begun, and TIM2 at the last of them.
    edges: AtomicU32,
    stamp: AtomicU32,
    kind: AtomicU8,
    /// The status word, or the two checksums.
    word: AtomicU32,
    codes: [AtomicI32; CHANNELS],
}

const OPENED: u8 = 0;
const CHECKSUM: u8 = 1;
const BUS: u8 = 2;

static CONVEYOR: [Slot; ROOM as usize] = [const {
    Slot {
        edges: AtomicU32::new(0),
        stamp: AtomicU32::new(0),
        kind: AtomicU8::new(BUS),
        word: AtomicU32::new(0),
        codes: [const { AtomicI32::new(0) }; CHANNELS],
    }
}; ROOM as usize];

impl Slot {
    #[inline]
    fn put(&self, response: &Result<Response, FrameError>) {
        let (kind, word) = match response {
            Ok(response) => {
                let [a, b, c, d] = response.codes;
                self.codes[0].store(a, Ordering::Relaxed);
                self.codes[1].store(b, Ordering::Relaxed);
                self.codes[2].store(c, Ordering::Relaxed);
                self.codes[3].store(d, Ordering::Relaxed);
                (OPENED, u32::from(response.word))
            }
            Err(FrameError::Checksum(error)) => (
                CHECKSUM,
                u32::from(error.sent) << 16 | u32::from(error.computed),
            ),
            Err(FrameError::Spi(_)) => (BUS, 0),
        };
        self.word.store(word, Ordering::Relaxed);
        self.kind.store(kind, Ordering::Relaxed);
    }

    #[inline]
    fn get(&self) -> Result<Response, FrameError> {
        let word = self.word.load(Ordering::Relaxed);
        let code = |k: usize| self.codes[k].load(Ordering::Relaxed);
        match self.kind.load(Ordering::Relaxed) {
            OPENED => Ok(Response {
                word: word as u16,
                codes: [code(0), code(1), code(2), code(3)],
            }),
            CHECKSUM => Err(FrameError::Checksum(ChecksumError {
                sent: (word >> 16) as u16,
                computed: word as u16,
            })),
            _ => Err(FrameError::Spi(ErrorKind::Other)),
        }
    }
}

/// Conversions that came, modulo 2^32; moved on by the DMA's interrupt.
static CAME: AtomicU32 = AtomicU32::new(0);

/// Conversions that were taken off, modulo 2^32; moved on by the acquisition.
static TAKEN: AtomicU32 = AtomicU32::new(0);

/// True while DRDY's interrupt starts frames.
static RUNS: AtomicBool = AtomicBool::new(false);

/// It stops after one.
static ALONE: AtomicBool = AtomicBool::new(false);

/// DRDY edges when the last frame was begun.
static EDGES: AtomicU32 = AtomicU32::new(0);

/// What is under way.
static UNDER_WAY: AtomicU8 = AtomicU8::new(NOTHING);
const NOTHING: u8 = 0;
const CONVERSION: u8 = 1;
const EXCHANGE: u8 = 2;

/// The last exchange succeeded.
static SOUND: AtomicBool = AtomicBool::new(false);

/// The acquisition, while it waits.
static WAKER: AtomicWaker = AtomicWaker::new();

const STREAM_IN: usize = 0;
const STREAM_OUT: usize = 1;

/// Channel 4 of either stream is SPI4.
const CHANNEL: u8 = 4;

/// The chip select is pin 4 of port E.
const SELECT: u32 = 1 << 4;

/// Every flag of both streams (RM0090, 10.5.3); a stream cannot be enabled with one set.
const FLAGS: Ixr = Ixr(0x3D << (6 * STREAM_IN) | 0x3D << (6 * STREAM_OUT));

/// The control words of the two streams as they run.
static CONTROL: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];

/// Throws away a byte that a transfer left in the data register when it was broken off: it would come as the first of the
/// next frame, and shift that one and all after it.
#[inline]
fn drop_left_byte() {
    if pac::SPI4.sr().read().rxne() {
        pac::SPI4.dr().read();
    }
}

/// Sends `OUT` and receives into `IN`.
#[inline]
fn begin(what: u8) {
    UNDER_WAY.store(what, Ordering::Relaxed);
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

/// Begins to read a conversion; whether the conveyor goes on after it is known by the edges.
#[inline]
fn begin_conversion() {
    let (edges, stamp) = drdy::edge();
    let before = EDGES.swap(edges, Ordering::Relaxed);
    let came = CAME.load(Ordering::Relaxed);
    let slot = &CONVEYOR[(came % ROOM) as usize];
    slot.edges.store(edges, Ordering::Relaxed);
    slot.stamp.store(stamp, Ordering::Relaxed);
    let full = came.wrapping_sub(TAKEN.load(Ordering::Acquire)) >= ROOM - 1;
    let alone = ALONE.load(Ordering::Relaxed);
    if full || alone || edges.wrapping_sub(before) != 1 {
        RUNS.store(false, Ordering::Relaxed);
    }
    begin(CONVERSION);
}

/// DRDY fell, or a deadline has passed.
#[interrupt]
fn TIM2() {
    let flags = drdy::take_flags();
    if flags.edge {
        on_edge();
    }
    if flags.deadline {
        WAKER.wake();
    }
}

/// DRDY fell.
#[inline]
fn on_edge() {
    let free = UNDER_WAY.load(Ordering::Relaxed) == NOTHING;
    // A pin that is high again was disturbed; its edge counts among those of the next conversion.
    if free && RUNS.load(Ordering::Relaxed) && drdy::is_low() {
        begin_conversion();
    }
}

/// The last byte came in, or the DMA could not go on.
#[interrupt]
fn DMA2_STREAM0() {
    let sound = !pac::DMA2.isr(0).read().teif(STREAM_IN);
    pac::GPIOE.bsrr().write(|w| w.0 = SELECT);
    if !sound {
        // The other stream may still be waiting for its turn.
        pac::DMA2.st(STREAM_OUT).cr().write_value(Cr(0));
    }
    pac::DMA2.ifcr(0).write_value(FLAGS);
    let what = UNDER_WAY.swap(NOTHING, Ordering::AcqRel);
    if what == EXCHANGE {
        SOUND.store(sound, Ordering::Relaxed);
        return WAKER.wake();
    }
    if what == NOTHING {
        // A frame that was given up ends after all.
        return;
    }
    fence(Ordering::SeqCst);
    let response = open(if sound {
        Ok(get())
    } else {
        Err(ErrorKind::Other)
    });
    let came = CAME.load(Ordering::Relaxed);
    CONVEYOR[(came % ROOM) as usize].put(&response);
    let came = came.wrapping_add(1);
    CAME.store(came, Ordering::Release);
    let goes_on = response.is_ok_and(|response| {
        let status = response.status();
        is_sound_but_for(status, 0) && has_data(status)
    });
    if !goes_on {
        RUNS.store(false, Ordering::Relaxed);
    }
    if !RUNS.load(Ordering::Relaxed) {
        WAKER.wake();
    } else {
        if drdy::is_low() {
            // It was converted while the frame was under way.
            begin_conversion();
        }
        if came.wrapping_sub(TAKEN.load(Ordering::Relaxed)) >= BATCH {
            WAKER.wake();
        }
    }
}

/// The bus with the converter's chip select and the timers that count DRDY.
pub struct Bus {
    _pins: Spi<'static, Blocking, mode::Master>,
    _select: Output<'static>,
    timers: DrdyTimers,
    /// A batch is being taken off.
    draining: bool,
}

impl Bus {
    /// On SPI4 as the HAL set it up, which nobody else may use; `select` is PE4.
    pub fn new(
        pins: Spi<'static, Blocking, mode::Master>,
        select: Output<'static>,
        timers: DrdyTimers,
    ) -> Self {
        let ways = [Dir::PERIPHERAL_TO_MEMORY, Dir::MEMORY_TO_PERIPHERAL];
        for (stream, (memory, way)) in [&IN, &OUT].into_iter().zip(ways).enumerate() {
            let registers = pac::DMA2.st(stream);
            let data = pac::SPI4.dr().as_ptr() as u32;
            registers.par().write_value(data);
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
        Self {
            _pins: pins,
            _select: select,
            timers,
            draining: false,
        }
    }

    /// Stops the conveyor, waits until nothing is under way and throws away what was fetched.
    async fn stop(&mut self) {
        RUNS.store(false, Ordering::Relaxed);
        until_idle().await;
        TAKEN.store(CAME.load(Ordering::Acquire), Ordering::Release);
        self.draining = false;
    }

    /// Starts the conveyor where it stands. A conversion that waits already is read alone in any case: the driver has to
    /// judge it by its edge before there is a next one.
    fn start(&self, ahead: bool) {
        put(&NULL);
        cortex_m::interrupt::free(|_| {
            ALONE.store(!ahead || drdy::is_low(), Ordering::Relaxed);
            if drdy::is_low() {
                begin_conversion();
            } else {
                EDGES.store(drdy::edge().0, Ordering::Relaxed);
                RUNS.store(true, Ordering::Relaxed);
            }
        });
    }

    /// Takes the oldest conversion off.
    #[inline]
    fn take(&mut self) -> Fetched {
        let taken = TAKEN.load(Ordering::Relaxed);
        let slot = &CONVEYOR[(taken % ROOM) as usize];
        let edges = slot.edges.load(Ordering::Relaxed);
        let stamp = slot.stamp.load(Ordering::Relaxed);
        let response = slot.get();
        TAKEN.store(taken.wrapping_add(1), Ordering::Release);
        Fetched {
            edge: self.timers.at(edges, stamp),
            response,
        }
    }
}

/// Conversions that were fetched and not taken off.
#[inline]
fn fetched() -> u32 {
    CAME.load(Ordering::Acquire)
        .wrapping_sub(TAKEN.load(Ordering::Relaxed))
}

fn is_idle() -> bool {
    UNDER_WAY.load(Ordering::Acquire) == NOTHING
}

async fn until_idle() {
    poll_fn(|context| {
        WAKER.register(context.waker());
        if is_idle() {
            Poll::Ready(())
        } else {
            Poll::Pending
        }
    })
    .await;
}

/// Empties the receive buffer: a byte in it would be taken for the first of the next frame, and leave that frame's last
/// for the one after it (RM0090, 28.3.8: read until RXNE is clear; 28.3.10: data and then status clear an overrun).
fn drain() {
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

/// Lays a frame out for the DMA.
#[inline]
fn put(frame: &[u8; FRAME]) {
    let (words, rest) = frame.as_chunks::<4>();
    for (to, word) in OUT.iter().zip(words) {
        to.store(u32::from_le_bytes(*word), Ordering::Relaxed);
    }
    if let (Some(to), [low, high]) = (OUT.last(), rest) {
        to.store(u32::from_le_bytes([*low, *high, 0, 0]), Ordering::Relaxed);
    }
}

/// The frame that the DMA brought.
#[inline]
fn get() -> [u8; FRAME] {
    let word = |k: usize| IN[k].load(Ordering::Relaxed).to_le_bytes();
    let ([a, b, c, d], [e, f, g, h], [i, j, k, l], [m, n, o, p], [q, r, ..]) =
        (word(0), word(1), word(2), word(3), word(4));
    [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r]
}

impl Timers for Bus {
    fn edge(&mut self) -> Edge {
        self.timers.edge()
    }

    fn now_us(&mut self) -> u64 {
        self.timers.now_us()
    }
}

impl FrameBus for Bus {
    async fn exchange(&mut self, frame: &[u8; FRAME]) -> Result<[u8; FRAME], ErrorKind> {
        self.stop().await;
        put(frame);
        begin(EXCHANGE);
        until_idle().await;
        fence(Ordering::SeqCst);
        if SOUND.load(Ordering::Relaxed) {
            Ok(get())
        } else {
            Err(ErrorKind::Other)
        }
    }

    async fn fetch(&mut self, patience_us: u32, ahead: bool) -> Result<Fetched, FetchError> {
        if !self.draining || fetched() == 0 {
            self.draining = false;
            if !RUNS.load(Ordering::Relaxed) && is_idle() && fetched() == 0 {
                self.start(ahead);
            }
            let end = drdy::Deadline::after_us(patience_us);
            poll_fn(|context| {
                WAKER.register(context.waker());
                let all = match fetched() {
                    0 => false,
                    // Nothing more comes by itself.
                    _ if !RUNS.load(Ordering::Relaxed) => is_idle(),
                    some => some >= BATCH,
                };
                if all || end.is_over() {
                    Poll::Ready(())
                } else {
                    Poll::Pending
                }
            })
            .await;
            if fetched() == 0 {
                self.stop().await;
                return Err(FetchError::Timeout);
            }
            self.draining = true;
        }
        Ok(self.take())
    }

    fn has_fetched(&self) -> bool {
        fetched() > 0
    }

    async fn recover(&mut self) {
        RUNS.store(false, Ordering::Relaxed);
        // A frame takes less; one that does not end by then never will.
        let end = drdy::Deadline::after_us(FRAME_US);
        poll_fn(|context| {
            WAKER.register(context.waker());
            if is_idle() || end.is_over() {
                Poll::Ready(())
            } else {
                Poll::Pending
            }
        })
        .await;
        cortex_m::interrupt::free(|_| {
            for stream in [STREAM_OUT, STREAM_IN] {
                pac::DMA2.st(stream).cr().write_value(Cr(0));
            }
            pac::GPIOE.bsrr().write(|w| w.0 = SELECT);
            pac::DMA2.ifcr(0).write_value(FLAGS);
            UNDER_WAY.store(NOTHING, Ordering::Relaxed);
        });
        drain();
        TAKEN.store(CAME.load(Ordering::Acquire), Ordering::Release);
        self.draining = false;
    }

    async fn pause_us(&mut self, duration_us: u32) {
        let end = drdy::Deadline::after_us(duration_us);
        poll_fn(|context| {
            WAKER.register(context.waker());
            if end.is_over() {
                Poll::Ready(())
            } else {
                Poll::Pending
            }
        })
        .await;
    }
}
