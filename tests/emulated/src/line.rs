//! The host's end of the serial line.

use std::collections::VecDeque;

use rigless::chip::{Timeline, uart};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

use crate::board::{Shared, lock};
use crate::random::Random;

/// What is on the line.
#[derive(Debug, Default)]
pub struct Line {
    /// Bytes that the host has still to send.
    pub to_board: VecDeque<u8>,
    /// Bytes that came from the board and were not fetched.
    pub from_board: Vec<u8>,
    /// What befalls bytes to the board.
    pub way_there: Noise,
    /// What befalls bytes from the board.
    pub way_back: Noise,
}

/// A noisy wire.
#[derive(Clone, Debug)]
pub struct Noise {
    /// Share of the bytes that are lost, 0 to 1.
    pub lost: f64,
    /// Share of the bytes in which a bit is flipped.
    pub flipped: f64,
    /// Share of the bytes that come twice.
    pub doubled: f64,
    /// Which ones.
    pub random: Random,
}

impl Default for Noise {
    /// None.
    fn default() -> Self {
        Self::new(0.0, 0)
    }
}

impl Noise {
    /// This share of the bytes is lost, as many flipped and as many doubled.
    pub const fn new(share: f64, seed: u64) -> Self {
        Self {
            lost: share,
            flipped: share,
            doubled: share,
            random: Random::new(seed),
        }
    }

    /// What arrives of a byte, and how often.
    fn pass(&mut self, mut byte: u8) -> (u8, usize) {
        if self.random.chance(self.flipped) {
            byte ^= 1 << self.random.below(8);
        }
        let count = match (
            self.random.chance(self.lost),
            self.random.chance(self.doubled),
        ) {
            (true, _) => 0,
            (false, true) => 2,
            (false, false) => 1,
        };
        (byte, count)
    }
}

/// The line as the emulated port sees it.
#[derive(Debug)]
pub struct HostEnd(Shared<Line>);

impl HostEnd {
    /// The far end of `line`.
    pub fn new(line: Shared<Line>) -> Self {
        Self(line)
    }
}

impl Store for HostEnd {}

impl uart::Peer for HostEnd {
    fn receive(&mut self, word: u16, _: &mut Timeline<'_, '_>) {
        let line = &mut *lock(&self.0);
        let (byte, count) = line.way_back.pass(word as u8);
        line.from_board.extend((0..count).map(|_| byte));
    }

    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        let line = &mut *lock(&self.0);
        loop {
            let byte = line.to_board.pop_front()?;
            match line.way_there.pass(byte) {
                (_, 0) => {}
                (byte, 1) => return Some(u16::from(byte)),
                (byte, _) => {
                    // Pushed back as it is; noise may befall it again.
                    line.to_board.push_front(byte);
                    return Some(u16::from(byte));
                }
            }
        }
    }
}
