//! The NUCLEO-H743ZI2: pins, peripherals and priorities. The wiring is that of the NUCLEO-F429ZI:
//!
//! | ADS131M04 | pin | connector |
//! |---|---|---|
//! | SCLK | PE2 (SPI4) | CN9-14 |
//! | CS | PE4 | CN9-16 |
//! | DOUT | PE5 (SPI4) | CN9-18 |
//! | DIN | PE6 (SPI4) | CN9-20 |
//! | SYNC/RESET | PE3 | CN9-22 |
//! | DRDY | PA0 (TIM2) | CN10-29 |
//!
//! The vehicle's pulse a second comes on PA3 (TIM2), CN9-1. PF8, CN9-24, forbids writing the memory while it is low.
//! The link to the host is USART3 (PD8, PD9), the debugger's virtual serial port.

mod clocks;
pub mod edges;
mod flash;
pub mod frames;
pub mod line;
mod memory;
mod thermometer;

use defmt_rtt as _;
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, Uart};
use embassy_stm32::{bind_interrupts, interrupt, pac};

use super::conveyor::{self, Bus};
use super::drdy::DrdyTimers;
use super::receiver::Receiver;
use super::{Parts, ResetFlags};
use crate::image::BAUD;

pub use clocks::is_lost as clock_is_lost;
pub use embassy_stm32::pac::IWDG1 as WATCHDOG;
pub use flash::Flash;
pub use line::Sender;
pub use thermometer::Thermometer;

/// A vector that no peripheral of this board uses carries the acquisition.
pub const ACQUISITION: Interrupt = Interrupt::CEC;

bind_interrupts!(struct Interrupts {
    FLASH => embassy_stm32::flash::InterruptHandler;
});

/// What the watchdog waits: 6 s nominal. The longest that a task may take for one step is erasing a sector of 128 KiB, 4 s at
/// the most (DS12110, table 140).
pub const WATCHDOG_TICKS: u32 = 3000;

/// Clock of the converter's bus, an eighth of 100 MHz.
const SPI_CLOCK: Hertz = Hertz(12_500_000);

/// What wakes the acquisition goes above it, the acquisition above all that may wait: link, memory, and the timer of
/// the tasks' delays.
const PRIORITIES: [(Interrupt, Priority); 6] = [
    (Interrupt::TIM2, Priority::P4),
    (Interrupt::DMA2_STREAM0, Priority::P4),
    (ACQUISITION, Priority::P6),
    (Interrupt::TIM4, Priority::P12),
    (Interrupt::DMA1_STREAM3, Priority::P12),
    (Interrupt::FLASH, Priority::P12),
];

#[interrupt]
fn CEC() {
    crate::image::on_acquisition_interrupt();
}

#[interrupt]
fn TIM2() {
    conveyor::on_timer();
}

#[interrupt]
fn DMA2_STREAM0() {
    conveyor::on_frame();
}

#[interrupt]
fn DMA1_STREAM3() {
    line::on_sent();
}

/// Starts the board: its memory, and everything else.
pub fn start() -> (Flash, Parts) {
    memory::start();
    let (p, time_base) = clocks::start();
    for (line, priority) in PRIORITIES {
        line.set_priority(priority);
    }
    for line in [
        Interrupt::TIM2,
        Interrupt::DMA2_STREAM0,
        Interrupt::DMA1_STREAM3,
    ] {
        // SAFETY: their handlers share nothing but atomics with the rest.
        #[allow(unsafe_code)]
        unsafe {
            line.enable();
        }
    }

    let mut spi_config = spi::Config::default();
    spi_config.mode = spi::MODE_1;
    spi_config.frequency = SPI_CLOCK;
    let spi = Spi::new_blocking(p.SPI4, p.PE2, p.PE6, p.PE5, spi_config);
    let select = Output::new(p.PE4, Level::High, Speed::VeryHigh);
    let timers = DrdyTimers::start(p.TIM2, p.TIM3, p.PA0, p.PA3);

    let mut uart_config = usart::Config::default();
    uart_config.baudrate = BAUD;
    let Ok(uart) = Uart::new_blocking(p.USART3, p.PD9, p.PD8, uart_config) else {
        defmt::panic!("the link's clock does not give {} baud", BAUD);
    };

    let parts = Parts {
        bus: Bus::new(spi, select, timers),
        reset: Output::new(p.PE3, Level::High, Speed::Low),
        receiver: Receiver::start(uart),
        sender: Sender,
        protect: Input::new(p.PF8, Pull::Up),
        thermometer: Thermometer::new(p.ADC3, time_base),
        time_base,
        // 3: reset threshold 2.7 V (RM0433, 4.9.8).
        brown_out_guarded: pac::FLASH.optsr_cur().read().bor_lev() == 3,
    };
    (flash::open(p.FLASH, Interrupts), parts)
}

/// Makes the backup registers writable.
pub fn unlock_backup() {
    pac::PWR.cr1().modify(|w| w.set_dbp(true));
}

/// Takes the reset flags.
pub fn take_reset_flags() -> ResetFlags {
    let flags = pac::RCC.rsr().read();
    pac::RCC.rsr().modify(|w| w.set_rmvf(true));
    ResetFlags {
        watchdog: flags.iwdg1rstf() || flags.wwdg1rstf(),
        software: flags.sftrstf(),
        power: flags.porrstf(),
        brown_out: flags.borrstf(),
    }
}
