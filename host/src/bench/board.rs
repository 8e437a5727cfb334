//! The virtual board: the firmware's own driver, sampler and application, on a model of the converter.
//!
//! Time is counted in cycles of the converter's clock and moves only when the firmware waits. The bus takes no
//! time; the line to the host takes what is given to it.

use std::cell::RefCell;
use std::convert::Infallible;
use std::future::{Future, pending, poll_fn};
use std::pin::pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use embassy_futures::block_on;
use embedded_hal::digital::{ErrorType as PinErrorType, OutputPin};
use embedded_hal::spi::{ErrorType as SpiErrorType, Operation};
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::SpiDevice;
use firmware::adc::bus::HalBus;
use firmware::adc::count::{Edge, Timers};
use firmware::adc::registers::{Gain, REFERENCE_V};
use firmware::adc::{Ads131m04, Reset};
use firmware::app::App;
use firmware::check::Check;
use firmware::link::Queues;
use firmware::sampler::{Acquisition, Sampler};
use firmware::store::Store;
use shared::identify::static_test::workspace_len;
use shared::self_check::{MARKS, MOUNTS, SelfCheck, SetUp};
use shared::wire::configuration::Certified;
use shared::wire::framing::{EncodeError, Frame};
use shared::wire::message::{Command, Identity};
use shared::wire::version;

use super::converter::{Converter, OVERSAMPLING, Quiet, Signal};
use super::flash::Flash;

/// A board that acquires a signal and talks to a host.
pub trait Board {
    /// Sends a command; it is carried out when the board runs.
    ///
    /// # Errors
    /// One line on why it cannot be sent.
    fn send(&mut self, command: &Command) -> Result<(), String>;

    /// Makes that many conversions of the signal, and gives the bytes that the board sends meanwhile.
    ///
    /// # Errors
    /// One line on why the board does not run on.
    fn run(
        &mut self,
        samples: u64,
        signal: &mut dyn Signal,
        sink: &mut dyn FnMut(&[u8]),
    ) -> Result<(), String>;
}

/// Conversions whose input is made at once.
const CHUNK: u64 = 64;

/// Conversions that the converter takes to be reset, set up and settled.
const SET_UP: u64 = 64;

/// The converter and the time around it.
struct World {
    converter: Converter,
    /// Cycles of the converter's clock.
    now: u64,
    /// When DRDY fell last.
    fell: u64,
    /// Conversions whose period has begun and ended.
    conversions: u64,
    /// Input of the conversions that come.
    input_v: Vec<[f64; 4]>,
    /// Values of it that were used.
    used: usize,
}

impl World {
    fn period(&self) -> u64 {
        u64::from(self.converter.config().oversampling.clock_cycles())
    }

    fn microseconds(&self, cycles: u64) -> u64 {
        let clock_hz = u128::from(self.converter.config().clock_hz);
        (u128::from(cycles) * 1_000_000 / clock_hz) as u64
    }

    fn load(&mut self, conversions: u64, signal: &mut dyn Signal) {
        let rate_hz = self.converter.config().sample_rate_hz() * OVERSAMPLING as f64;
        let first = self.conversions * OVERSAMPLING as u64;
        self.used = 0;
        self.input_v
            .resize(conversions as usize * OVERSAMPLING, [0.0; 4]);
        signal.fill(first as f64 / rate_hz, rate_hz, &mut self.input_v);
    }

    /// Converts once more, at its time; false when there is no input left.
    fn convert(&mut self) -> bool {
        let Some(input_v) = self
            .input_v
            .get(self.used..)
            .and_then(|rest| rest.first_chunk())
        else {
            return false;
        };
        let edges = self.converter.drdy_edges();
        self.converter.convert(input_v);
        self.used += OVERSAMPLING;
        self.conversions += 1;
        let end = self.conversions * self.period();
        self.now = self.now.max(end);
        if self.converter.drdy_edges() != edges {
            self.fell = end;
        }
        true
    }

    /// Lets time pass; false when there is not input enough.
    fn pass_until(&mut self, time: u64) -> bool {
        while (self.conversions + 1) * self.period() <= time {
            if !self.convert() {
                return false;
            }
        }
        self.now = self.now.max(time);
        true
    }
}

#[derive(Clone)]
struct Shared(Rc<RefCell<World>>);

impl SpiErrorType for Shared {
    type Error = Infallible;
}

impl SpiDevice for Shared {
    async fn transaction(
        &mut self,
        operations: &mut [Operation<'_, u8>],
    ) -> Result<(), Infallible> {
        let converter = &mut self.0.borrow_mut().converter;
        if let [Operation::Transfer(receive, send)] = operations {
            converter.transfer(send, receive);
            return Ok(());
        }
        converter.select();
        for operation in operations {
            match operation {
                Operation::Read(bytes) => {
                    bytes.iter_mut().for_each(|b| *b = converter.exchange(0));
                }
                Operation::Write(bytes) => bytes.iter().for_each(|b| {
                    converter.exchange(*b);
                }),
                Operation::Transfer(receive, send) => {
                    for (n, to) in receive.iter_mut().enumerate() {
                        *to = converter.exchange(send.get(n).copied().unwrap_or(0));
                    }
                }
                Operation::TransferInPlace(bytes) => {
                    bytes.iter_mut().for_each(|b| *b = converter.exchange(*b));
                }
                Operation::DelayNs(_) => {}
            }
        }
        converter.deselect();
        Ok(())
    }
}

impl PinErrorType for Shared {
    type Error = Infallible;
}

impl OutputPin for Shared {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().converter.set_reset_pin(true);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().converter.set_reset_pin(false);
        Ok(())
    }
}

impl Wait for Shared {
    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        poll_fn(|_| {
            let mut world = self.0.borrow_mut();
            if !world.converter.drdy_is_low() {
                world.convert_if_drdy_answers();
            }
            if world.converter.drdy_is_low() {
                Poll::Ready(Ok(()))
            } else {
                Poll::Pending
            }
        })
        .await
    }

    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        pending().await
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }
}

impl World {
    /// Goes on to the next conversion if DRDY is going to tell of it.
    fn convert_if_drdy_answers(&mut self) {
        if self.converter.faults.drdy == super::converter::DrdyPin::Sound {
            self.convert();
        }
    }
}

impl DelayNs for Shared {
    async fn delay_ns(&mut self, ns: u32) {
        let end = {
            let world = self.0.borrow();
            let clock_hz = u64::from(world.converter.config().clock_hz);
            world.now + (u64::from(ns) * clock_hz).div_ceil(1_000_000_000)
        };
        poll_fn(|_| {
            if self.0.borrow_mut().pass_until(end) {
                Poll::Ready(())
            } else {
                Poll::Pending
            }
        })
        .await
    }
}

impl Timers for Shared {
    fn edge(&mut self) -> Edge {
        let world = self.0.borrow();
        Edge {
            count: world.converter.drdy_edges(),
            time_us: world.microseconds(world.fell),
        }
    }

    fn now_us(&mut self) -> u64 {
        let world = self.0.borrow();
        world.microseconds(world.now)
    }
}

/// The instrument, as far as its serial line shows.
pub struct VirtualBoard {
    world: Rc<RefCell<World>>,
    acquisition: Acquisition<'static, HalBus<Shared, Shared, Shared, Shared>, Shared>,
    app: App<'static>,
    memory: Store<Flash>,
    frame: Frame,
    command_sequence: u16,
}

/// A self-check in a work space that lasts, like the queues, until the program ends.
fn check() -> Check<'static> {
    let workspace = Box::leak(vec![0.0; workspace_len(MARKS, MOUNTS)].into_boxed_slice());
    let test = SelfCheck::new(SetUp::default(), workspace).expect("the work space has that length");
    Check::new(test)
}

impl Board for VirtualBoard {
    fn send(&mut self, command: &Command) -> Result<(), String> {
        match VirtualBoard::send(self, command) {
            Ok(_) => Ok(()),
            Err(error) => Err(format!("a command cannot be framed: {error:?}")),
        }
    }

    fn run(
        &mut self,
        samples: u64,
        signal: &mut dyn Signal,
        sink: &mut dyn FnMut(&[u8]),
    ) -> Result<(), String> {
        VirtualBoard::run(self, samples, signal, sink);
        Ok(())
    }
}

impl VirtualBoard {
    /// Switched on, with the converter set up and an empty memory; blocks of that many conversions. Each board keeps a
    /// few kilobytes until the program ends, as the firmware's queues are made for good.
    pub fn new(converter: Converter, block_samples: u16, serial: [u8; 12]) -> Self {
        Self::with_memory(converter, block_samples, serial, Flash::new(0))
    }

    /// The same with what the flash holds; blocks as that says, if it does.
    pub fn with_memory(
        converter: Converter,
        block_samples: u16,
        serial: [u8; 12],
        flash: Flash,
    ) -> Self {
        let config = *converter.config();
        let identity = Identity {
            minimum: version::MINIMUM,
            current: version::CURRENT,
            firmware: [0, 1, 0],
            serial,
            sample_rate_hz: config.sample_rate_hz(),
            reference_v: REFERENCE_V,
            gains: config.gains.map(Gain::factor),
            block_samples,
        };
        let world = Rc::new(RefCell::new(World {
            converter,
            now: 0,
            fell: 0,
            conversions: 0,
            input_v: Vec::new(),
            used: 0,
        }));
        let shared = || Shared(Rc::clone(&world));
        let driver = Ads131m04::new(shared(), shared(), shared(), shared(), shared(), config);
        let queues: &'static mut Queues = Box::leak(Box::default());
        let (acquisition_end, application_end) = queues.split();
        let mut sampler = Sampler::new(acquisition_end, block_samples);
        let mut memory = Store::new(flash);
        let known = block_on(memory.load());
        let app = App::new(identity, application_end).with_kept(known, &mut sampler);
        let mut board = Self {
            acquisition: Acquisition::new(driver, sampler, Reset::Pin),
            app: app.with_check(check()),
            memory,
            frame: Frame::new(),
            command_sequence: 0,
            world,
        };
        board.acquire(SET_UP, &mut Quiet, |_| {});
        board
    }

    /// Sends a command and returns the sequence number of its frame; the answer comes with the next [`Self::run`],
    /// also of no samples.
    ///
    /// # Errors
    /// [`EncodeError`]; no command is that long.
    pub fn send(&mut self, command: &Command) -> Result<u16, EncodeError> {
        let sequence = self.command_sequence;
        let mut frame = Frame::new();
        frame.encode(command, sequence)?;
        self.command_sequence = sequence.wrapping_add(1);
        self.receive(frame.as_bytes());
        Ok(sequence)
    }

    /// Makes it keep this in place of what it keeps, or nothing.
    ///
    /// # Errors
    /// As [`Self::send`].
    pub fn replace(&mut self, certified: Option<Certified>) -> Result<u16, EncodeError> {
        let writes = self.app.kept().writes;
        self.send(&Command::Replace { writes, certified })
    }

    /// Bytes on the line to the instrument.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.app.receive(bytes);
    }

    /// Carries out what was ordered, makes that many conversions of the signal, and gives the bytes that the instrument
    /// sends. The signal's time is that of the converter and goes on from run to run.
    pub fn run(&mut self, samples: u64, signal: &mut dyn Signal, sink: &mut dyn FnMut(&[u8])) {
        self.acquire(samples, signal, |board| board.drain(sink));
    }

    /// As [`Self::run`], with a line that is dead: what does not fit into the queue is dropped.
    pub fn run_unheard(&mut self, samples: u64, signal: &mut dyn Signal) {
        self.acquire(samples, signal, |_| {});
    }

    /// Lets conversions pass while the firmware does nothing, as under a load that it cannot bear.
    pub fn stall(&mut self, samples: u64, signal: &mut dyn Signal) {
        let mut world = self.world.borrow_mut();
        world.load(samples, signal);
        while world.convert() {}
    }

    /// Does something to the converter: sets a fault, resets it.
    pub fn disturb<T>(&mut self, what: impl FnOnce(&mut Converter) -> T) -> T {
        what(&mut self.world.borrow_mut().converter)
    }

    /// Switches it off; what the memory holds stays.
    pub fn switch_off(self) -> Flash {
        self.memory.into_flash()
    }

    /// Conversions until now, those in reset included.
    pub fn conversions(&self) -> u64 {
        self.world.borrow().conversions
    }

    fn acquire(
        &mut self,
        samples: u64,
        signal: &mut dyn Signal,
        mut after_chunk: impl FnMut(&mut Line<'_>),
    ) {
        let Self {
            world,
            acquisition,
            app,
            memory,
            frame,
            ..
        } = self;
        // As the bus, the memory takes no time.
        if let Some(keep) = app.keep() {
            app.stored(block_on(memory.keep(keep.certified.as_ref())));
        }
        let mut line = Line { app, frame };
        let mut context = Context::from_waker(Waker::noop());
        let mut steps = pin!(async {
            loop {
                acquisition.step().await;
            }
        });
        let mut left = samples;
        loop {
            let chunk = left.min(CHUNK);
            world.borrow_mut().load(chunk, signal);
            // The loop never ends; it waits when the input is used up.
            let _: Poll<()> = steps.as_mut().poll(&mut context);
            after_chunk(&mut line);
            left -= chunk;
            if left == 0 {
                return;
            }
        }
    }
}

/// The application and the frame that it packs into.
struct Line<'a> {
    app: &'a mut App<'static>,
    frame: &'a mut Frame,
}

impl Line<'_> {
    fn drain(&mut self, sink: &mut dyn FnMut(&[u8])) {
        while self.app.transmit(self.frame) {
            sink(self.frame.as_bytes());
        }
    }
}
