//! The flash of the instrument's memory: bank 2 of the STM32F429, its four sectors of 16 KiB, with power that fails.
//!
//! Bits are programmed from one to zero, four bytes at a time, and come back by erasing a sector (RM0090, 3.4, 3.6.3
//! and 3.6.4). What an operation leaves that power or reset interrupts is not specified there (3.6), so the model leaves
//! what is worst: some bits of the byte that is being programmed, and of a sector being erased any mixture of what was
//! there, of ones and of nothing in particular.

use std::ops::Range;

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Bytes that are erased at once.
pub const SECTOR: usize = 16 * 1024;

/// Sectors.
pub const SECTORS: usize = 4;

/// Bytes that are programmed at once.
pub const WORD: usize = 4;

/// What erasing a sector takes of [`Power::Left`].
pub const ERASURE: usize = 64;

/// How long power lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// It does not fail.
    On,
    /// For so many more bytes to be programmed, or [`ERASURE`] for a sector to be erased, if there is any left.
    Left(usize),
    /// It failed; nothing is programmed or erased.
    Failed,
}

/// What else is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Nothing.
    None,
    /// Reading fails.
    Read,
    /// Programming fails.
    Write,
    /// Erasing fails.
    Erase,
    /// Programming and erasing are told to have gone well, and change nothing.
    Deaf,
    /// Bit 0 of the bytes from one address to another is zero for good.
    Stuck(usize, usize),
    /// Bit 0 of that byte is not programmed.
    Weak(usize),
}

/// Why an operation failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The addresses are beyond the end or within a word.
    Address(NorFlashErrorKind),
    /// Power failed.
    Power,
    /// As [`Fault`] says.
    Fault,
}

impl NorFlashError for Error {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Address(kind) => *kind,
            Self::Power | Self::Fault => NorFlashErrorKind::Other,
        }
    }
}

/// The flash.
#[derive(Clone, Debug)]
pub struct Flash {
    /// What it holds.
    pub bytes: Vec<u8>,
    /// How long power lasts.
    pub power: Power,
    /// What is wrong with it.
    pub fault: Fault,
    /// Words that were programmed without having been blank.
    pub overwritten: usize,
    /// Sectors that were erased, or begun to be.
    pub erasures: usize,
    chance: ChaCha8Rng,
}

impl Flash {
    /// Erased; what a failure of power leaves depends on the seed.
    pub fn new(seed: u64) -> Self {
        Self {
            bytes: vec![0xFF; SECTORS * SECTOR],
            power: Power::On,
            fault: Fault::None,
            overwritten: 0,
            erasures: 0,
            chance: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// The same, from here on with another seed.
    pub fn with_seed(self, seed: u64) -> Self {
        Self {
            chance: ChaCha8Rng::seed_from_u64(seed),
            ..self
        }
    }

    /// The bytes from one address to another, both in steps of so many.
    fn range(&self, from: u32, to: u32, step: usize) -> Result<Range<usize>, Error> {
        let (from, to) = (from as usize, to as usize);
        if from > to || to > self.bytes.len() {
            return Err(Error::Address(NorFlashErrorKind::OutOfBounds));
        }
        if !(from.is_multiple_of(step) && to.is_multiple_of(step)) {
            return Err(Error::Address(NorFlashErrorKind::NotAligned));
        }
        Ok(from..to)
    }

    fn program(&mut self, at: usize, byte: u8) -> Result<(), Error> {
        let byte = byte | u8::from(self.fault == Fault::Weak(at));
        match &mut self.power {
            Power::On => {}
            Power::Failed => return Err(Error::Power),
            Power::Left(0) => {
                self.power = Power::Failed;
                self.bytes[at] &= byte | self.chance.random::<u8>();
                return Err(Error::Power);
            }
            Power::Left(left) => *left -= 1,
        }
        self.bytes[at] &= byte;
        Ok(())
    }

    fn erase_sector(&mut self, start: usize) -> Result<(), Error> {
        let sector = &mut self.bytes[start..start + SECTOR];
        match &mut self.power {
            Power::Failed => return Err(Error::Power),
            Power::Left(left) if *left < ERASURE => {
                let share = *left as f64 / ERASURE as f64;
                self.power = Power::Failed;
                self.erasures += 1;
                spoil(sector, share, &mut self.chance);
                return Err(Error::Power);
            }
            Power::Left(left) => *left -= ERASURE,
            Power::On => {}
        }
        self.erasures += 1;
        sector.fill(0xFF);
        Ok(())
    }

    fn stick(&mut self) {
        if let Fault::Stuck(from, to) = self.fault {
            self.bytes[from..to].iter_mut().for_each(|byte| *byte &= !1);
        }
    }
}

/// A sector of which that share is erased, in one of the ways in which it may be.
fn spoil(sector: &mut [u8], share: f64, chance: &mut ChaCha8Rng) {
    let length = sector.len();
    let erased = (share * length as f64) as usize;
    match chance.random_range(0..7) {
        // From one end, or from the other.
        0 => sector[..erased].fill(0xFF),
        1 => sector[length - erased..].fill(0xFF),
        // Bytes here and there.
        2 => sector
            .iter_mut()
            .filter(|_| chance.random_bool(share))
            .for_each(|byte| *byte = 0xFF),
        // Bits here and there.
        3 => sector.iter_mut().for_each(|byte| {
            for bit in 0..8 {
                *byte |= u8::from(chance.random_bool(share)) << bit;
            }
        }),
        // Pieces of it.
        4 => {
            let piece = *[WORD, 128, 512, 2048].choose(chance).expect("some");
            sector
                .chunks_mut(piece)
                .filter(|_| chance.random_bool(share))
                .for_each(|piece| piece.fill(0xFF));
        }
        // Anything at all.
        5 => chance.fill(sector),
        // All but one byte.
        _ => {
            let left = chance.random_range(0..length);
            let byte = sector[left];
            sector.fill(0xFF);
            sector[left] = byte;
        }
    }
}

impl ErrorType for Flash {
    type Error = Error;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        let range = self.range(offset, offset + bytes.len() as u32, 1)?;
        if self.fault == Fault::Read {
            return Err(Error::Fault);
        }
        bytes.copy_from_slice(&self.bytes[range]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        let range = self.range(from, to, SECTOR)?;
        match self.fault {
            Fault::Erase => return Err(Error::Fault),
            Fault::Deaf => return Ok(()),
            _ => {}
        }
        for start in range.step_by(SECTOR) {
            self.erase_sector(start)?;
        }
        self.stick();
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        let range = self.range(offset, offset + bytes.len() as u32, WORD)?;
        match self.fault {
            Fault::Write => return Err(Error::Fault),
            Fault::Deaf => return Ok(()),
            _ => {}
        }
        let written = |word: &&[u8]| word.iter().any(|byte| *byte != 0xFF);
        self.overwritten += self.bytes[range.clone()]
            .chunks(WORD)
            .filter(written)
            .count();
        for (at, byte) in range.zip(bytes) {
            self.program(at, *byte)?;
        }
        self.stick();
        Ok(())
    }
}
