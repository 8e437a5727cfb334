//! The NUCLEO-F429ZI: pins, peripherals and priorities.
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
mod thermometer;

use defmt_rtt as _;
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, Uart};
use embassy_stm32::{bind_interrupts, dma, interrupt, pac, peripherals};

use super::conveyor::{self, Bus};
use super::drdy::DrdyTimers;
use super::receiver::Receiver;
use super::{Parts, ResetFlags};
use crate::image::BAUD;

pub use clocks::is_lost as clock_is_lost;
pub use embassy_stm32::pac::IWDG as WATCHDOG;
pub use flash::Flash;
pub use thermometer::Thermometer;

/// What goes to the host.
pub type Sender = usart::UartTx<'static, Async>;

/// A vector that no peripheral of this board uses carries the acquisition.
pub const ACQUISITION: Interrupt = Interrupt::CAN2_SCE;

bind_interrupts!(struct Interrupts {
    USART3 => usart::InterruptHandler<peripherals::USART3>;
    DMA1_STREAM1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
    DMA1_STREAM3 => dma::InterruptHandler<peripherals::DMA1_CH3>;
    FLASH => embassy_stm32::flash::InterruptHandler;
});

/// What the watchdog waits: 2 s nominal; the oscillator's 17 to 47 kHz (DS9405, table 42) make 1.4 to 3.8 s of it. The longest
/// that a task may take for one step is erasing a sector, 0.8 s at the most (DS9405, table 48).
pub const WATCHDOG_TICKS: u32 = 1000;

/// Clock of the converter's bus; the divider gives 10.5 MHz.
const SPI_CLOCK: Hertz = Hertz(10_500_000);

/// What wakes the acquisition goes above it, the acquisition above all that may wait: link, memory, and the timer of
/// the tasks' delays.
const PRIORITIES: [(Interrupt, Priority); 8] = [
    (Interrupt::TIM2, Priority::P4),
    (Interrupt::DMA2_STREAM0, Priority::P4),
    (ACQUISITION, Priority::P6),
    (Interrupt::TIM4, Priority::P12),
    (Interrupt::USART3, Priority::P12),
    (Interrupt::DMA1_STREAM1, Priority::P12),
    (Interrupt::DMA1_STREAM3, Priority::P12),
    (Interrupt::FLASH, Priority::P12),
];

#[interrupt]
fn CAN2_SCE() {
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

/// Starts the board: its memory, and everything else.
pub fn start() -> (Flash, Parts) {
    let (p, time_base) = clocks::start();
    for (line, priority) in PRIORITIES {
        line.set_priority(priority);
    }
    for converter in [Interrupt::TIM2, Interrupt::DMA2_STREAM0] {
        // SAFETY: their handlers share nothing but atomics with the rest.
        #[allow(unsafe_code)]
        unsafe {
            converter.enable();
        }
    }

    let mut spi_config = spi::Config::default();
    spi_config.mode = spi::MODE_1;
    spi_config.frequency = SPI_CLOCK;
    let spi = Spi::new_blocking(p.SPI4, p.PE2, p.PE6, p.PE5, spi_config);
    let select = Output::new(p.PE4, Level::High, Speed::VeryHigh);
    let timers = DrdyTimers::start(p.TIM2, p.TIM5, p.PA0, p.PA3);

    let mut uart_config = usart::Config::default();
    uart_config.baudrate = BAUD;
    let uart = Uart::new(
        p.USART3,
        p.PD9,
        p.PD8,
        p.DMA1_CH3,
        p.DMA1_CH1,
        Interrupts,
        uart_config,
    );
    let Ok(uart) = uart else {
        defmt::panic!("the link's clock does not give {} baud", BAUD);
    };
    let (sender, receiver) = uart.split();

    let flash = flash::open(p.FLASH, Interrupts, p.PA12);
    let parts = Parts {
        bus: Bus::new(spi, select, timers),
        reset: Output::new(p.PE3, Level::High, Speed::Low),
        receiver: Receiver::start(receiver),
        sender,
        protect: Input::new(p.PF8, Pull::Up),
        thermometer: Thermometer::new(p.ADC1, time_base),
        time_base,
        // 0: reset threshold level 3, 2.7 V (RM0090, 3.9.10).
        brown_out_guarded: pac::FLASH.optcr().read().bor_lev() == 0,
    };
    (flash, parts)
}

/// Makes the backup registers writable.
pub fn unlock_backup() {
    pac::RCC.apb1enr().modify(|w| w.set_pwren(true));
    pac::PWR.cr1().modify(|w| w.set_dbp(true));
}

/// Takes the reset flags.
pub fn take_reset_flags() -> ResetFlags {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    ResetFlags {
        watchdog: flags.wdgrstf() || flags.wwdgrstf(),
        software: flags.sftrstf(),
        power: flags.porrstf(),
        brown_out: flags.borrstf(),
    }
}
