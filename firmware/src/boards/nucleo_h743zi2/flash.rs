//! The memory of the configuration: two sectors of 128 KiB at the end of the flash's bank 2.
//!
//! The code runs on from bank 1 while bank 2 is programmed or erased (RM0433, 4.3.11), and the task that does so waits for
//! the flash's interrupt. The flash is programmed by words of 32 bytes, each with a check code of its own, and no word twice.
//!
//! **A word whose writing was cut off** may have a check code that fits nothing, and the bus answers its reading with an
//! error (RM0433, 4.3.12), which would be a fault of the core. So the core never reads this memory: a DMA does, that stops at
//! such a word, and it is told as zeros. These are not blank, and no record.

use core::sync::atomic::{AtomicU32, Ordering, fence};

use embassy_stm32::Peri;
use embassy_stm32::flash::{Async, Bank2Region, Error, InterruptHandler, WRITE_SIZE};
use embassy_stm32::interrupt::typelevel::{Binding, FLASH as Line};
use embassy_stm32::pac;
use embassy_stm32::pac::dma::regs::{Cr, Ixr, Ndtr};
use embassy_stm32::pac::dma::vals::{Dir, Fth, Size};
use embassy_stm32::peripherals::FLASH;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

/// Bytes of a sector.
const SECTOR: u32 = 128 << 10;

/// Sectors that the memory has.
const SECTORS: u32 = 2;

/// Where it begins: in bank 2, and for the bus.
const BEGIN: u32 = 6 * SECTOR;
const ADDRESS: u32 = 0x0810_0000 + BEGIN;

/// DMA2's stream 7 reads; it needs no request.
const STREAM: usize = 7;

/// Every flag of it in the second register.
const FLAGS: Ixr = Ixr(0x3D << 22);

/// Words of 32 bits in one of the flash.
const WORDS: usize = WRITE_SIZE / 4;

/// What was read last.
// SAFETY: the section is memory like any other, and every access is atomic; what it holds before does not matter.
#[allow(unsafe_code)]
#[unsafe(link_section = ".dma")]
static WORD: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

/// The memory.
pub struct Flash(Bank2Region<'static, Async>);

/// Opens the memory.
pub fn open(
    flash: Peri<'static, FLASH>,
    interrupts: impl Binding<Line, InterruptHandler> + 'static,
) -> Flash {
    let flash = embassy_stm32::flash::Flash::new(flash, interrupts);
    Flash(flash.into_regions().bank2_region)
}

/// Reads a word of the flash into `WORD`; false if it cannot be read.
fn read_word(address: u32) -> bool {
    let stream = pac::DMA2.st(STREAM);
    pac::DMA2.ifcr(1).write_value(FLAGS);
    stream.par().write_value(address);
    stream.m0ar().write_value(WORD.as_ptr() as u32);
    stream.ndtr().write_value(Ndtr(WORDS as u32));
    // From memory to memory a stream needs its buffer (RM0433, 15.3.10).
    stream.fcr().write(|w| {
        w.set_dmdis(pac::dma::vals::Dmdis::DISABLED);
        w.set_fth(Fth::FULL);
    });
    stream.cr().write(|w| {
        w.set_dir(Dir::MEMORY_TO_MEMORY);
        w.set_pinc(true);
        w.set_minc(true);
        w.set_psize(Size::BITS32);
        w.set_msize(Size::BITS32);
        w.set_en(true);
    });
    // Eight words take less than a microsecond; the stream ends by itself, whole or at an error.
    while stream.cr().read().en() {}
    stream.cr().write_value(Cr(0));
    fence(Ordering::SeqCst);
    !pac::DMA2.isr(1).read().teif(STREAM - 4)
}

impl ErrorType for Flash {
    type Error = Error;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = WRITE_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        let end = offset as usize + bytes.len();
        if end > self.capacity() || !(offset as usize).is_multiple_of(WRITE_SIZE) {
            return Err(Error::Size);
        }
        let addresses = (ADDRESS + offset..).step_by(WRITE_SIZE);
        for (piece, address) in bytes.chunks_mut(WRITE_SIZE).zip(addresses) {
            let sound = read_word(address);
            for (to, word) in piece.chunks_mut(4).zip(&WORD) {
                let word = if sound {
                    word.load(Ordering::Relaxed)
                } else {
                    0
                };
                for (to, from) in to.iter_mut().zip(word.to_le_bytes()) {
                    *to = from;
                }
            }
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        (SECTORS * SECTOR) as usize
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WRITE_SIZE;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        if to > SECTORS * SECTOR {
            return Err(Error::Size);
        }
        self.0.erase(BEGIN + from, BEGIN + to).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        if offset as usize + bytes.len() > self.capacity() {
            return Err(Error::Size);
        }
        self.0.write(BEGIN + offset, bytes).await
    }
}
