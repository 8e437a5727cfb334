//! DRDY on TIM2 and TIM5: every falling edge is stamped and counted in hardware.
//!
//! TIM2 runs at 1 MHz and captures the falling edges on PA0. Each capture sends a trigger pulse, and TIM5 counts
//! these pulses, so that the count holds however late the software is.

use embassy_stm32::Peri;
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::typelevel::Binding;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{PA0, TIM2, TIM5};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::input_capture::{CapturePin, Ch1, InputCapture};
use embassy_stm32::timer::low_level::{CountingMode, MasterMode, SlaveMode, Timer, TriggerSource};
use embassy_stm32::timer::{CaptureCompareInterruptHandler, Channel, GeneralInstance1Channel};
use embedded_hal::digital::{Error, ErrorKind, ErrorType};
use embedded_hal_async::digital::Wait;
use firmware::adc::count::Timers;

/// Ticks of TIM2.
const CLOCK: Hertz = Hertz(1_000_000);

/// The pin DRDY, whose falling edges TIM2 captures.
pub struct Drdy(InputCapture<'static, TIM2>);

/// The clock TIM2 and the count TIM5.
pub struct DrdyTimers {
    count: Timer<'static, TIM5>,
    now_us: u64,
}

/// Starts both timers.
pub fn start(
    clock: Peri<'static, TIM2>,
    count: Peri<'static, TIM5>,
    pin: Peri<'static, PA0>,
    interrupts: impl Binding<
        <TIM2 as GeneralInstance1Channel>::CaptureCompareInterrupt,
        CaptureCompareInterruptHandler<TIM2>,
    > + 'static,
) -> (Drdy, DrdyTimers) {
    let count = Timer::new(count);
    // Internal trigger 0 of TIM5 is the output of TIM2 (RM0090, table 98).
    count.set_trigger_source(TriggerSource::ITR0);
    count.set_slave_mode(SlaveMode::EXT_CLOCK_MODE);
    count.start();

    let pin = CapturePin::<_, Ch1>::new(pin, Pull::Up);
    let clock = InputCapture::new(
        clock,
        Some(pin),
        None,
        None,
        None,
        interrupts,
        CLOCK,
        CountingMode::EdgeAlignedUp,
    );
    pac::TIM2
        .cr2()
        .modify(|w| w.set_mms(MasterMode::COMPARE_PULSE));
    (Drdy(clock), DrdyTimers { count, now_us: 0 })
}

impl Timers for DrdyTimers {
    fn drdy_edges(&mut self) -> u32 {
        self.count.regs_gp32().cnt().read()
    }

    /// The counter has 32 bits; asked at least once an hour, this clock does not lose a turn.
    fn now_us(&mut self) -> u64 {
        let passed = pac::TIM2.cnt().read().wrapping_sub(self.now_us as u32);
        self.now_us += u64::from(passed);
        self.now_us
    }
}

/// Only falling edges are captured: waiting for others is not supported.
#[derive(Debug)]
pub struct NotCaptured;

impl Error for NotCaptured {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ErrorType for Drdy {
    type Error = NotCaptured;
}

impl Wait for Drdy {
    async fn wait_for_low(&mut self) -> Result<(), NotCaptured> {
        // An edge between the look and the wait has set its flag and ends the wait at once.
        while pac::GPIOA.idr().read().idr(0) == pac::gpio::vals::Idr::HIGH {
            self.wait_for_falling_edge().await?;
        }
        Ok(())
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), NotCaptured> {
        self.0.wait_for_falling_edge(Channel::Ch1).await;
        Ok(())
    }

    async fn wait_for_high(&mut self) -> Result<(), NotCaptured> {
        Err(NotCaptured)
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), NotCaptured> {
        Err(NotCaptured)
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), NotCaptured> {
        Err(NotCaptured)
    }
}
