//! The host's end of the serial line.

use std::collections::VecDeque;

use rigless::chip::{Timeline, uart};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

use crate::board::{Shared, lock};

/// What is on the line.
#[derive(Debug, Default)]
pub struct Line {
    /// Bytes that the host has still to send.
    pub to_board: VecDeque<u8>,
    /// Bytes that came from the board and were not fetched.
    pub from_board: Vec<u8>,
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
        lock(&self.0).from_board.push(word as u8);
    }

    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        lock(&self.0).to_board.pop_front().map(u16::from)
    }
}
