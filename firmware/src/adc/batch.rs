//! Conversions one after the other, none lost between them: what is fetched together is worked on together.

use super::Conversion;
use super::frame::CHANNELS;

/// Conversions that a batch has room for; a power of two.
pub const ROOM: usize = 16;

/// None or some conversions.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    first: u64,
    first_us: u64,
    /// Time of each since the first.
    since_us: [u32; ROOM],
    codes: [[i32; CHANNELS]; ROOM],
    len: usize,
}

impl Batch {
    /// Of one conversion.
    pub fn new(conversion: &Conversion) -> Self {
        let mut batch = Self::default();
        batch.begin(conversion);
        batch
    }

    /// Empty.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Of this one alone.
    pub fn begin(&mut self, conversion: &Conversion) {
        self.len = 0;
        (self.first, self.first_us) = (conversion.index, conversion.time_us);
        self.push(conversion.time_us, conversion.codes);
    }

    /// Adds the next conversion; false without room.
    #[inline]
    pub fn push(&mut self, time_us: u64, codes: [i32; CHANNELS]) -> bool {
        let (Some(since), Some(code)) = (
            self.since_us.get_mut(self.len),
            self.codes.get_mut(self.len),
        ) else {
            return false;
        };
        *since = time_us.wrapping_sub(self.first_us) as u32;
        *code = codes;
        self.len += 1;
        true
    }

    /// True when nothing more fits.
    pub fn is_full(&self) -> bool {
        self.len >= ROOM
    }

    /// Index of the first conversion.
    pub fn first(&self) -> u64 {
        self.first
    }

    /// When DRDY told of that one, on the clock of [`Timers`](super::count::Timers).
    pub fn time_us(&self, at: usize) -> u64 {
        let since_us = self.since_us.get(at).copied().unwrap_or_default();
        self.first_us.saturating_add(u64::from(since_us))
    }

    /// The codes of each.
    pub fn codes(&self) -> &[[i32; CHANNELS]] {
        self.codes.get(..self.len).unwrap_or(&[])
    }
}
