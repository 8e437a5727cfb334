//! The conveyor of conversions: frames over the converter's bus, begun and ended by interrupts.
//!
//! While it runs, DRDY's interrupt starts the frame that reads the conversion, and the DMA's interrupt
//! opens it; the acquisition sleeps meanwhile and is woken for [`BATCH`] conversions. It runs only while each frame has
//! one DRDY edge more than the one before and a sound conversion. Where that is not so, or where there is no room, it
//! stops: then the driver, which counts the same edges, decides what the converter still holds.

use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU8, AtomicU32, Ordering};
use core::task::Poll;

use embassy_stm32::gpio::Output;
use embassy_stm32::mode::Blocking;
use embassy_stm32::spi::{Spi, mode};
use embassy_sync::waitqueue::AtomicWaker;
use embedded_hal::spi::ErrorKind;
use firmware::adc::batch;
use firmware::adc::bus::{FetchError, Fetched, FrameBus, FrameError};
use firmware::adc::count::{Edge, Timers};
use firmware::adc::frame::{self, ChecksumError, FRAME, NULL, Response, WORDS, decode};
use firmware::adc::registers::{has_data, is_sound_but_for};
use shared::channels::CHANNELS;

use super::board::frames::{self, IN, OUT};
use super::drdy::{self, DrdyTimers};

/// Conversions that wake the acquisition: fewer periods than the driver waits for the first.
const BATCH: u32 = batch::ROOM as u32;

/// Conversions that there is room for, a power of two: what the acquisition may be late.
const ROOM: u32 = 2 * BATCH;

/// How long a frame may take; at 10.5 MHz it takes 14 us.
const FRAME_US: u32 = 100;

/// What the DMA reads or writes: nobody else holds a reference to it, and every access is atomic.
pub type Memory = [AtomicU32; WORDS];

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
/// Opened, and a conversion that nothing is wrong with.
const SOUND: u8 = 3;

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
    fn put(&self, response: &Result<Response, FrameError>, sound: bool) {
        let (kind, word) = match response {
            Ok(response) => {
                let [a, b, c, d] = response.codes;
                self.codes[0].store(a, Ordering::Relaxed);
                self.codes[1].store(b, Ordering::Relaxed);
                self.codes[2].store(c, Ordering::Relaxed);
                self.codes[3].store(d, Ordering::Relaxed);
                let kind = if sound { SOUND } else { OPENED };
                (kind, u32::from(response.word))
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
    fn codes(&self) -> [i32; CHANNELS] {
        self.codes
            .each_ref()
            .map(|code| code.load(Ordering::Relaxed))
    }

    /// Its edge, on the clock that stands at `now_us`, less than an hour later.
    #[inline]
    fn edge(&self, now_us: u64) -> Edge {
        let stamp = self.stamp.load(Ordering::Relaxed);
        drdy::edge_at(now_us, self.edges.load(Ordering::Relaxed), stamp)
    }

    #[inline]
    fn get(&self) -> Result<Response, FrameError> {
        let word = self.word.load(Ordering::Relaxed);
        match self.kind.load(Ordering::Relaxed) {
            OPENED | SOUND => Ok(Response {
                word: word as u16,
                codes: self.codes(),
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
static EXCHANGED: AtomicBool = AtomicBool::new(false);

/// The acquisition, while it waits.
static WAKER: AtomicWaker = AtomicWaker::new();

/// Sends what is laid out.
#[inline]
fn begin(what: u8) {
    UNDER_WAY.store(what, Ordering::Relaxed);
    frames::begin();
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

/// DRDY fell, or a deadline has passed: to be called by the interrupt of TIM2 and by nobody else.
#[inline]
pub fn on_timer() {
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

/// A frame ended, or the DMA could not go on: to be called by its interrupt and by nobody else.
#[inline]
pub fn on_frame() {
    let sound = frames::end();
    let what = UNDER_WAY.swap(NOTHING, Ordering::AcqRel);
    if what == EXCHANGE {
        EXCHANGED.store(sound, Ordering::Relaxed);
        return WAKER.wake();
    }
    if what == NOTHING {
        // A frame that was given up ends after all.
        return;
    }
    let response = if sound {
        decode(words()).map_err(FrameError::Checksum)
    } else {
        Err(FrameError::Spi(ErrorKind::Other))
    };
    let goes_on = response.is_ok_and(|response| {
        let status = response.status();
        is_sound_but_for(status, 0) && has_data(status)
    });
    let came = CAME.load(Ordering::Relaxed);
    CONVEYOR[(came % ROOM) as usize].put(&response, goes_on);
    let came = came.wrapping_add(1);
    CAME.store(came, Ordering::Release);
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
    /// On the board's SPI as the HAL set it up, which nobody else may use, with its chip select.
    pub fn new(
        pins: Spi<'static, Blocking, mode::Master>,
        select: Output<'static>,
        timers: DrdyTimers,
    ) -> Self {
        frames::start();
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
        let now_us = self.timers.now_us();
        let taken = TAKEN.load(Ordering::Relaxed);
        let slot = &CONVEYOR[(taken % ROOM) as usize];
        let (edge, response) = (slot.edge(now_us), slot.get());
        TAKEN.store(taken.wrapping_add(1), Ordering::Release);
        Fetched { edge, response }
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

/// Lays a frame out for the DMA.
fn put(frame: &[u8; FRAME]) {
    for (to, word) in OUT.iter().zip(frame::words(frame)) {
        to.store(word, Ordering::Relaxed);
    }
}

/// The frame that the DMA brought, as it lies in memory.
#[inline]
fn words() -> [u32; WORDS] {
    IN.each_ref().map(|word| word.load(Ordering::Relaxed))
}

/// The same as bytes.
fn get() -> [u8; FRAME] {
    let words = words().map(u32::to_le_bytes);
    let mut frame = [0; FRAME];
    for (to, from) in frame.iter_mut().zip(words.as_flattened()) {
        *to = *from;
    }
    frame
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
        if EXCHANGED.load(Ordering::Relaxed) {
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

    fn drain(&mut self, mut take: impl FnMut(Edge, [i32; CHANNELS]) -> bool) {
        let came = CAME.load(Ordering::Acquire);
        let mut taken = TAKEN.load(Ordering::Relaxed);
        // One look at the clock for all of them.
        let now_us = self.timers.now_us();
        while taken != came {
            let slot = &CONVEYOR[(taken % ROOM) as usize];
            let sound = slot.kind.load(Ordering::Relaxed) == SOUND;
            if !(sound && take(slot.edge(now_us), slot.codes())) {
                break;
            }
            taken = taken.wrapping_add(1);
        }
        TAKEN.store(taken, Ordering::Release);
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
            frames::abort();
            UNDER_WAY.store(NOTHING, Ordering::Relaxed);
        });
        frames::drain();
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
