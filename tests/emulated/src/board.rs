//! The board: an STM32F427 in place of the STM32F429 (the two differ by the display controller), the converter on
//! SPI4 and a host on USART3.

use std::num::{NonZeroU32, NonZeroU64};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::device::Level;
use rigless::machine::{Board, Target, armv7m};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::Error;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::rcc;
use rigless::soc::stm32f427::peripherals::gpio::Pin;
use rigless::soc::stm32f427::peripherals::spi::Select;
use rigless::soc::stm32f427::peripherals::tim::Channel;
use rigless::time::VirtualNanos;

use crate::converter::Converter;
use crate::line::{HostEnd, Line};

/// The debugger's clock output, on the high-speed oscillator's pin.
const HSE_HZ: u64 = 8_000_000;
const SUPPLY_MV: u32 = 3300;

/// Instructions a second of virtual time. At 168 MHz this is 1.7 cycles an instruction, flash wait states included.
pub const INSTRUCTIONS_PER_SECOND: NonZeroU64 = NonZeroU64::new(100_000_000).unwrap();

const GPIOA: usize = 0;
const GPIOE: usize = 4;
const GPIOF: usize = 5;
const SPI4: usize = 3;
const USART3: usize = 2;
const TIM2: usize = 0;
const TIM5: usize = 3;

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
const CAPTURE: Channel = channel(1);
const PULSE_CAPTURE: Channel = channel(4);

const fn channel(index: u8) -> Channel {
    match Channel::new(index) {
        Some(channel) => channel,
        None => panic!("a timer has four channels"),
    }
}

/// A value that the models on the core's thread and the test share.
pub type Shared<T> = Arc<Mutex<T>>;

/// The value, also after a panic elsewhere.
pub fn lock<T: ?Sized>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The board.
#[derive(Debug)]
pub struct Nucleo {
    /// The microcontroller.
    pub mcu: Stm32f427,
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
        converter: Shared<dyn Converter>,
        line: Shared<Line>,
        instructions_per_second: NonZeroU64,
    ) -> Result<Self, Error> {
        let mut mcu = Stm32f427::new()?;
        mcu.rcc.attach_crystals(HSE_HZ, 0);
        mcu.set_supply(SUPPLY_MV);
        mcu.spi[SPI4].attach_selected(
            crate::converter::Bus::new(converter.clone()),
            Select {
                port: "GPIOE",
                pin: CHIP_SELECT,
                active: Level::Low,
            },
        );
        mcu.usart[USART3].attach(HostEnd::new(line));
        Ok(Self {
            mcu,
            converter,
            external_clock: true,
            drdy: Level::Low,
            captures: 0,
            instructions_per_second,
        })
    }

    /// The emulator's oscillator is ready whether there is one or not: it is not, without.
    pub fn settle_clock(&mut self) {
        if !self.external_clock {
            let (_, registers) = self.mcu.clocks();
            let control = registers.get(rcc::Register::Cr);
            registers.set(rcc::Register::Cr, rcc::cr::HSERDY.set(control, 0));
        }
    }

    /// The debugger's clock stops.
    pub fn stop_clock(&mut self, at: VirtualNanos) {
        self.external_clock = false;
        self.mcu.drive_clocks(at, |clocks, registers, context| {
            clocks.fail_hse(registers, context);
        });
    }

    /// Drives the vehicle's pulse.
    pub fn drive_pulse(&mut self, at: VirtualNanos, high: bool) {
        let level = Level::from(high);
        self.mcu.drive_port(at, GPIOA, |gpio, registers, context| {
            gpio.drive(PULSE, Some(level), registers, context);
        });
        self.mcu.drive_timer(at, TIM2, |timer, registers, context| {
            timer.drive_input(PULSE_CAPTURE, level, registers, context);
        });
    }

    /// Closes or opens the write-protect jumper.
    pub fn protect(&mut self, at: VirtualNanos, closed: bool) {
        let level = closed.then_some(Level::Low);
        self.mcu.drive_port(at, GPIOF, |gpio, registers, context| {
            gpio.drive(PROTECT, level, registers, context);
        });
    }

    /// Carries the levels between converter and microcontroller: SYNC/RESET to the one, DRDY to the other.
    pub fn settle(&mut self, at: VirtualNanos) {
        let (gpio, registers) = self.mcu.port(GPIOE);
        let reset = gpio.level(RESET, registers) == Level::Low;
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
        self.mcu.drive_port(at, GPIOA, |gpio, registers, context| {
            gpio.drive(DRDY, Some(level), registers, context);
        });
        let captures = self.mcu.drive_timer(at, TIM2, |timer, registers, context| {
            timer.drive_input(CAPTURE, level, registers, context);
            timer.trigger_output().1
        });
        // The part's internal triggers are not wired in the emulator: TIM2's output is input 0 of TIM5.
        if captures != self.captures {
            self.captures = captures;
            self.mcu.drive_timer(at, TIM5, |timer, registers, context| {
                timer.drive_internal_trigger(0, Level::High, registers, context);
                timer.drive_internal_trigger(0, Level::Low, registers, context);
            });
        }
    }
}

impl Board for Nucleo {
    fn name(&self) -> &'static str {
        "nucleo-f429zi"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32f427"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.mcu)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let lines = NonZeroU32::new(u32::from(self.mcu.cpu().interrupt_lines));
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: NonZeroU64::new(168_000_000).expect("not zero"),
            interrupt_lines: lines.expect("the part has interrupts"),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).expect("not zero"),
            instructions_per_second: self.instructions_per_second,
            boot: "flash",
        }
        .spec_with_parts(
            &rigless::cpu::armv7m::windows(self.mcu.bus()),
            armv7m::Fpu::FpV4Sp,
            armv7m::MpuRegions::Eight,
        );
        vec![Target::new("stm32f427", &mut self.mcu, core)]
    }
}
