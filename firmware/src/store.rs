//! The memory: what the instrument keeps over a loss of power, in NOR flash, the old or the new at every instant.
//!
//! The flash is a ring of slots of [`SLOT`] bytes. Each writing has a number, 1 for the first, which tells its slot;
//! the sound record of the highest number holds. A record is a checksum, the version of its format, its number and the
//! configuration, or none: erasing is a writing as well. It is written into a blank slot and read back, and only then
//! is the record before it marked as superseded. A sector is erased when the ring enters it, and the one with the
//! record that holds never is.
//!
//! So a record that was torn does not count, and leftovers of a torn erasure have lower numbers or no checksum. A
//! record that was told as written and went bad since is noticed: the one before it is marked and has no successor.
//! A fault is told then, and not the configuration before last.
//!
//! ```text
//! 0          4                                            SLOT - WRITE_SIZE     SLOT
//! | checksum | version, number, configuration | 0xFF ...  | superseded if zeros |
//! ```

use crc::{CRC_32_ISO_HDLC, Crc};
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::NorFlash;
use shared::wire::configuration::Certified;
use shared::wire::message::StoreFault;

/// Bytes of a slot; a multiple of the flash's words, of which a sector holds a whole number.
pub const SLOT: usize = 1024;

/// A slot after its sector was erased.
const BLANK: [u8; SLOT] = [0xFF; SLOT];

/// Version of what follows the number in a record.
const VERSION: u16 = 2;

/// Bytes of the checksum, CRC-32/ISO-HDLC of the rest of the record, little-endian.
const CHECKSUM: usize = 4;

static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// What is known of the memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// How often it has been written.
    pub writes: u32,
    /// Why what is kept is not what was told last.
    pub fault: Option<StoreFault>,
}

/// A configuration in flash of at least two sectors.
pub struct Store<F> {
    flash: F,
    slot: [u8; SLOT],
}

/// A sound record.
#[derive(Clone, Copy)]
struct Found {
    writes: u32,
    superseded: bool,
}

/// What the flash is found to hold.
enum Contents {
    /// No record, nor anything else.
    Blank,
    /// No record.
    Unsound,
    /// The record of the highest number.
    Record(Found),
}

impl<F: NorFlash> Store<F> {
    /// Of the whole of that flash.
    pub fn new(flash: F) -> Self {
        const { assert!(SLOT.is_multiple_of(F::WRITE_SIZE) && SLOT.is_multiple_of(F::READ_SIZE)) };
        const { assert!(F::ERASE_SIZE.is_multiple_of(SLOT)) };
        Self { flash, slot: BLANK }
    }

    /// The flash.
    pub fn into_flash(self) -> F {
        self.flash
    }

    /// What is kept. It is `None` with a fault, and without one if nothing was ever kept or it was erased.
    ///
    /// [`StoreFault::Flash`]: reading fails; [`StoreFault::Version`]: the record is of another version;
    /// [`StoreFault::Corrupt`]: it is none that can be, or went bad. The flash is only read.
    pub async fn load(&mut self) -> (Option<Certified>, Kept) {
        let (writes, configuration, fault) = match self.recover().await {
            Ok(Some((writes, configuration))) => (writes, configuration, None),
            Ok(None) => (0, None, None),
            Err(fault) => (0, None, Some(fault)),
        };
        (configuration, Kept { writes, fault })
    }

    /// Keeps a configuration, or none, in place of what was kept, and tells what is kept then. What is kept already is
    /// not written again. Takes as long as writing one slot, and every now and then as long as erasing a sector.
    ///
    /// What was kept stays with [`StoreFault::Verify`]: what is read back is not what was written, or no slot can be
    /// written any more; and with [`StoreFault::Corrupt`]: the configuration cannot be. With [`StoreFault::Flash`] it is
    /// that or the new one.
    pub async fn keep(&mut self, configuration: Option<&Certified>) -> Kept {
        let fault = self.replace(configuration).await.err();
        let (_, kept) = self.load().await;
        Kept {
            fault: fault.or(kept.fault),
            ..kept
        }
    }

    async fn recover(&mut self) -> Result<Option<(u32, Option<Certified>)>, StoreFault> {
        let found = match self.contents().await? {
            Contents::Blank => return Ok(None),
            Contents::Unsound => return Err(StoreFault::Corrupt),
            Contents::Record(found) if found.superseded => return Err(StoreFault::Corrupt),
            Contents::Record(found) => found,
        };
        self.read(found.writes).await?;
        let Some((VERSION, writes, body)) = self.record() else {
            return Err(StoreFault::Version);
        };
        let configuration = postcard::from_bytes::<Option<Certified>>(body);
        match configuration {
            Ok(known) if known.is_none_or(|known| known.is_possible()) => Ok(Some((writes, known))),
            _ => Err(StoreFault::Corrupt),
        }
    }

    async fn replace(&mut self, configuration: Option<&Certified>) -> Result<(), StoreFault> {
        if configuration.is_some_and(|new| !new.is_possible()) {
            return Err(StoreFault::Corrupt);
        }
        if let Ok(kept) = self.recover().await
            && kept.and_then(|(_, kept)| kept).as_ref() == configuration
        {
            return Ok(());
        }
        let before = match self.contents().await? {
            Contents::Record(found) => Some(found),
            Contents::Blank | Contents::Unsound => None,
        };
        let writes = self.free(before).await?;
        self.compose(writes, configuration)?;
        self.flash
            .write(self.address(writes), &self.slot[..mark::<F>()])
            .await
            .map_err(flash)?;
        match self.recover().await? {
            Some((written, kept)) if written == writes && kept.as_ref() == configuration => {}
            _ => return Err(StoreFault::Verify),
        }
        match before {
            Some(before) if !before.superseded => self.supersede(before.writes).await,
            _ => Ok(()),
        }
    }

    /// The number of the next writing, whose slot is blank.
    async fn free(&mut self, before: Option<Found>) -> Result<u32, StoreFault> {
        let last = before.map_or(0, |found| found.writes);
        for writes in (last..=u32::MAX).skip(1).take(self.slots() as usize) {
            let address = self.address(writes);
            if address.is_multiple_of(F::ERASE_SIZE as u32) {
                let end = address + F::ERASE_SIZE as u32;
                if before.is_some_and(|found| (address..end).contains(&self.address(found.writes)))
                {
                    break;
                }
                self.flash.erase(address, end).await.map_err(flash)?;
            }
            self.read(writes).await?;
            if self.is_blank() {
                return Ok(writes);
            }
        }
        Err(StoreFault::Verify)
    }

    /// Puts a record into `slot`.
    fn compose(
        &mut self,
        writes: u32,
        configuration: Option<&Certified>,
    ) -> Result<(), StoreFault> {
        self.slot = BLANK;
        let (checksum, rest) = self.slot[..mark::<F>()].split_at_mut(CHECKSUM);
        // Never: the room is for the longest, which a test holds.
        postcard::to_slice(&(VERSION, writes, configuration), rest)
            .map_err(|_| StoreFault::Corrupt)?;
        checksum.copy_from_slice(&CRC.checksum(rest).to_le_bytes());
        Ok(())
    }

    async fn supersede(&mut self, writes: u32) -> Result<(), StoreFault> {
        let address = self.address(writes) + mark::<F>() as u32;
        self.slot = [0; SLOT];
        self.flash
            .write(address, &self.slot[mark::<F>()..])
            .await
            .map_err(flash)?;
        self.read(writes).await?;
        if self.is_superseded() {
            Ok(())
        } else {
            Err(StoreFault::Verify)
        }
    }

    async fn contents(&mut self) -> Result<Contents, StoreFault> {
        let mut contents = Contents::Blank;
        for slot in 1..=self.slots() {
            // As much as one slot takes is all that others have to wait.
            yield_now().await;
            self.read(slot).await?;
            if self.is_blank() {
                continue;
            }
            let highest = match contents {
                Contents::Record(found) => found.writes,
                Contents::Blank | Contents::Unsound => 0,
            };
            contents = match self.record() {
                Some((_, writes, _)) if writes > highest && self.is_in(slot, writes) => {
                    Contents::Record(Found {
                        writes,
                        superseded: self.is_superseded(),
                    })
                }
                _ if highest == 0 => Contents::Unsound,
                _ => contents,
            };
        }
        Ok(contents)
    }

    /// Reads the slot of that number into `slot`.
    async fn read(&mut self, writes: u32) -> Result<(), StoreFault> {
        let address = self.address(writes);
        let read = self.flash.read(address, &mut self.slot).await;
        read.map_err(flash)
    }

    /// The record in `slot`, if it is sound: version, number and the rest.
    fn record(&self) -> Option<(u16, u32, &[u8])> {
        let (checksum, rest) = self.slot[..mark::<F>()].split_first_chunk::<CHECKSUM>()?;
        if *checksum != CRC.checksum(rest).to_le_bytes() {
            return None;
        }
        let ((version, writes), body) = postcard::take_from_bytes::<(u16, u32)>(rest).ok()?;
        Some((version, writes, body))
    }

    /// A majority, so that a bit that flips decides nothing.
    fn is_superseded(&self) -> bool {
        let mark = &self.slot[mark::<F>()..];
        let zeros: u32 = mark.iter().map(|byte| byte.count_zeros()).sum();
        zeros as usize > 4 * mark.len()
    }

    fn is_blank(&self) -> bool {
        self.slot == BLANK
    }

    fn slots(&self) -> u32 {
        (self.flash.capacity() / SLOT) as u32
    }

    fn is_in(&self, slot: u32, writes: u32) -> bool {
        self.address(slot) == self.address(writes)
    }

    /// Where the record of that number is.
    fn address(&self, writes: u32) -> u32 {
        writes.saturating_sub(1) % self.slots().max(1) * SLOT as u32
    }
}

/// Offset of the mark in a slot.
const fn mark<F: NorFlash>() -> usize {
    SLOT - F::WRITE_SIZE
}

fn flash<E>(_: E) -> StoreFault {
    StoreFault::Flash
}
