//! The board: a microcontroller, the converter on SPI4 and a host on USART3.

use std::num::NonZeroU64;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::device::Level;
use rigless::machine::{Board, Target};
use rigless::mcu::Mcu;
use rigless::snapshot::Store;
use rigless::soc::Error;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32h743::peripherals::gpio::Pin;
use rigless::time::VirtualNanos;

use crate::converter::Converter;
use crate::line::Line;
use crate::part::{Model, Part};

/// Instructions a second of virtual time. At 168 MHz this is 1.7 cycles an instruction, flash wait states included; at 400 MHz
/// it is 4.
pub const INSTRUCTIONS_PER_SECOND: NonZeroU64 = NonZeroU64::new(100_000_000).unwrap();

/// The one microcontroller.
const TARGET: &str = "mcu";

const GPIOA: usize = 0;
const GPIOE: usize = 4;
const GPIOF: usize = 5;

const fn pin(index: u8) -> Pin {
    match Pin::new(index) {
        Some(pin) => pin,
        None => panic!("a port has sixteen pins"),
    }
}

const DRDY: Pin = pin(0);
const RESET: Pin = pin(3);
const CHIP_SELECT: Pin = pin(4);
const PULSE: Pin = pin(3);
const PROTECT: Pin = pin(8);
const CAPTURE: u8 = 1;
const PULSE_CAPTURE: u8 = 4;

/// A value that the models on the core's thread and the test share.
pub type Shared<T> = Arc<Mutex<T>>;

/// The value, also after a panic elsewhere.
pub fn lock<T: ?Sized>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The board.
#[derive(Debug)]
pub struct Nucleo {
    model: Model,
    part: Part,
    /// The converter.
    pub converter: Shared<dyn Converter>,
    /// False: the debugger gives no clock.
    pub external_clock: bool,
    drdy: Level,
    captures: u64,
    instructions_per_second: NonZeroU64,
}

impl Store for Nucleo {}

impl Nucleo {
    /// Powered, with the converter and the host's end of the line fitted.
    pub fn new(
        model: Model,
        converter: Shared<dyn Converter>,
        line: Shared<Line>,
        instructions_per_second: NonZeroU64,
    ) -> Result<Self, Error> {
        Ok(Self {
            model,
            part: Part::new(model, converter.clone(), CHIP_SELECT, line)?,
            converter,
            external_clock: true,
            drdy: Level::Low,
            captures: 0,
            instructions_per_second,
        })
    }

    /// Which board it is.
    pub fn model(&self) -> Model {
        self.model
    }

    /// The microcontroller of a NUCLEO-F429ZI, for what only its model has.
    pub fn f427(&mut self) -> Option<&mut Stm32f427> {
        match &mut self.part {
            Part::F427(mcu) => Some(mcu),
            Part::H743(_) => None,
        }
    }

    /// The emulator's oscillator is ready whether there is one or not: it is not, without.
    pub fn settle_clock(&mut self) {
        if !self.external_clock {
            self.part.without_clock();
        }
    }

    /// The debugger's clock stops.
    pub fn stop_clock(&mut self, at: VirtualNanos) {
        self.external_clock = false;
        self.part.fail_clock(at);
    }

    /// Drives the vehicle's pulse.
    pub fn drive_pulse(&mut self, at: VirtualNanos, high: bool) {
        let level = Level::from(high);
        self.part.drive_pin(at, GPIOA, PULSE, Some(level));
        self.part.drive_timer(at, PULSE_CAPTURE, level);
    }

    /// Closes or opens the write-protect jumper.
    pub fn protect(&mut self, at: VirtualNanos, closed: bool) {
        let level = closed.then_some(Level::Low);
        self.part.drive_pin(at, GPIOF, PROTECT, level);
    }

    /// Carries the levels between converter and microcontroller: SYNC/RESET to the one, DRDY to the other.
    pub fn settle(&mut self, at: VirtualNanos) {
        let reset = self.part.pin(GPIOE, RESET) == Level::Low;
        let drdy = {
            let mut converter = lock(&self.converter);
            converter.drive_reset(at.0, reset);
            converter.advance(at.0);
            Level::from(!converter.drdy_is_low())
        };
        if drdy != self.drdy {
            self.drive_drdy(at, drdy);
        }
    }

    fn drive_drdy(&mut self, at: VirtualNanos, level: Level) {
        self.drdy = level;
        self.part.drive_pin(at, GPIOA, DRDY, Some(level));
        let captures = self.part.drive_timer(at, CAPTURE, level);
        if captures != self.captures {
            self.captures = captures;
            self.part.count(at);
        }
    }
}

impl Board for Nucleo {
    fn name(&self) -> &'static str {
        self.model.name()
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![TARGET]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then(|| self.part.mcu())
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        vec![self.part.target(TARGET, self.instructions_per_second)]
    }
}
