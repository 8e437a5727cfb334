//! The memory of the configuration, and the task that writes it.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use firmware::app::Keep;
use firmware::store::{Kept, Store};
use shared::wire::message::StoreFault;

use super::{REMEMBERS, TASKS};
use crate::boards::board::Flash;

/// The memory.
pub type Memory = Store<Stepping<Flash>>;

/// What is to be kept.
pub static KEEP: Signal<CriticalSectionRawMutex, Keep> = Signal::new();

/// What has become of it.
pub static KEPT: Signal<CriticalSectionRawMutex, Kept> = Signal::new();

/// A flash each of whose operations is a step of the memory's task: a writing takes several, each of them far shorter than
/// what the watchdog waits.
pub struct Stepping<F>(F);

impl<F: ErrorType> ErrorType for Stepping<F> {
    type Error = F::Error;
}

impl<F: ReadNorFlash> ReadNorFlash for Stepping<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        TASKS[REMEMBERS].step();
        self.0.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<F: NorFlash> NorFlash for Stepping<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        TASKS[REMEMBERS].step();
        self.0.erase(from, to).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        TASKS[REMEMBERS].step();
        self.0.write(offset, bytes).await
    }
}

/// Opens the memory.
pub fn open(flash: Flash) -> Memory {
    Store::new(Stepping(flash))
}

/// Keeps what it is told, for ever; `done` is called each time.
pub async fn serve(memory: &mut Memory, done: impl Fn()) -> ! {
    loop {
        TASKS[REMEMBERS].rest();
        let keep = KEEP.wait().await;
        TASKS[REMEMBERS].step();
        let kept = memory.keep(keep.certified.as_ref()).await;
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
