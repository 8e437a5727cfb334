//! The memory of the configuration: the four sectors of 16 KiB at the beginning of the flash's bank 2, 0x0810_0000.
//!
//! The code runs on from bank 1 while bank 2 is programmed or erased (RM0090, 3.6.5), and the task that does so waits
//! for the flash's interrupt: 400 ms typically for a sector, erased by bytes as the driver does, and 16 µs for each word
//! of a record (DS9405, table 48).

use embassy_stm32::flash::{Async, Bank2Region1, Flash, InterruptHandler};
use embassy_stm32::interrupt::typelevel::{Binding, FLASH as Line};
use embassy_stm32::peripherals::{FLASH, PA12};
use embassy_stm32::{Peri, pac};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use firmware::app::Keep;
use firmware::store::{Kept, Store};
use shared::wire::message::StoreFault;
use static_cell::StaticCell;

/// The memory.
pub type Memory = Store<Bank2Region1<'static, Async>>;

/// What is to be kept.
pub static KEEP: Signal<CriticalSectionRawMutex, Keep> = Signal::new();

/// What has become of it.
pub static KEPT: Signal<CriticalSectionRawMutex, Kept> = Signal::new();

/// Opens the memory. Takes PA12: parts before revision 3 read bank 2 wrongly unless it is an output that is low and
/// pulled down (ES0206 rev 24, 2.2.14).
pub fn open(
    flash: Peri<'static, FLASH>,
    interrupts: impl Binding<Line, InterruptHandler> + 'static,
    _: Peri<'static, PA12>,
) -> &'static mut Memory {
    static MEMORY: StaticCell<Memory> = StaticCell::new();
    const PIN: usize = 12;
    let port = pac::GPIOA;
    port.odr()
        .modify(|w| w.set_odr(PIN, pac::gpio::vals::Odr::LOW));
    port.pupdr()
        .modify(|w| w.set_pupdr(PIN, pac::gpio::vals::Pupdr::PULL_DOWN));
    port.moder()
        .modify(|w| w.set_moder(PIN, pac::gpio::vals::Moder::OUTPUT));
    let regions = Flash::new(flash, interrupts).into_regions();
    MEMORY.init(Store::new(regions.bank2_region1))
}

/// Keeps what it is told, for ever; `done` is called each time.
pub async fn serve(memory: &mut Memory, done: impl Fn()) -> ! {
    loop {
        let keep = KEEP.wait().await;
        let kept = memory.keep(keep.configuration.as_ref()).await;
        tell(kept);
        KEPT.signal(kept);
        done();
    }
}

/// Logs what is known of the memory.
pub fn tell(kept: Kept) {
    match kept.fault {
        None => defmt::info!("memory: written {} times", kept.writes),
        Some(fault) => defmt::error!("memory: {}", name(fault)),
    }
}

fn name(fault: StoreFault) -> &'static str {
    match fault {
        StoreFault::Flash => "the flash fails",
        StoreFault::Verify => "what is read back is not what was written",
        StoreFault::Corrupt => "what it holds is no configuration",
        StoreFault::Version => "a configuration of another version",
    }
}
