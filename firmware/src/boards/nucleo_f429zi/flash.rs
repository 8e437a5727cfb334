//! The memory of the configuration: the four sectors of 16 KiB at the beginning of the flash's bank 2, 0x0810_0000.
//!
//! The code runs on from bank 1 while bank 2 is programmed or erased (RM0090, 3.6.5), and the task that does so waits
//! for the flash's interrupt: 400 ms typically for a sector, erased by bytes as the driver does, and 16 µs for each word
//! of a record (DS9405, table 48). The driver switches the data cache off meanwhile, which could be spoilt (ES0206,
//! 2.2.15).

use embassy_stm32::flash::{Async, Bank2Region1, InterruptHandler};
use embassy_stm32::interrupt::typelevel::{Binding, FLASH as Line};
use embassy_stm32::peripherals::{FLASH, PA12};
use embassy_stm32::{Peri, pac};

/// The memory.
pub type Flash = Bank2Region1<'static, Async>;

/// Opens the memory. Takes PA12: parts before revision 3 read bank 2 wrongly unless it is an output that is low and
/// pulled down (ES0206 rev 24, 2.2.14).
pub fn open(
    flash: Peri<'static, FLASH>,
    interrupts: impl Binding<Line, InterruptHandler> + 'static,
    _: Peri<'static, PA12>,
) -> Flash {
    const PIN: usize = 12;
    let port = pac::GPIOA;
    port.odr()
        .modify(|w| w.set_odr(PIN, pac::gpio::vals::Odr::LOW));
    port.pupdr()
        .modify(|w| w.set_pupdr(PIN, pac::gpio::vals::Pupdr::PULL_DOWN));
    port.moder()
        .modify(|w| w.set_moder(PIN, pac::gpio::vals::Moder::OUTPUT));
    let flash = embassy_stm32::flash::Flash::new(flash, interrupts);
    flash.into_regions().bank2_region1
}
