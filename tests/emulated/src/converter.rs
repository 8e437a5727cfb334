//! A plain ADS131M04 on the emulated bus: frames, checksums, registers and DRDY; its codes count conversions.

use rigless::chip::{Timeline, spi};
use rigless::snapshot::Store;

use crate::board::{Shared, lock};

const FRAME: usize = 18;

/// The converter: what it holds, and the frame that is on the bus.
#[derive(Debug)]
pub struct Converter {
    period_ns: u64,
    next_ns: u64,
    now_ns: u64,
    in_reset: bool,
    waiting: u32,
    fallen: bool,
    /// Conversions so far.
    pub conversions: u64,
    registers: [u16; 16],
    answer: Option<u16>,
    status: u16,
    frame: [u8; FRAME],
    sent: Vec<u8>,
}

impl Default for Converter {
    fn default() -> Self {
        Self {
            period_ns: 250_000,
            next_ns: 250_000,
            now_ns: 0,
            in_reset: false,
            waiting: 0,
            fallen: false,
            conversions: 0,
            registers: [0; 16],
            answer: Some(0xFF24),
            status: 0x0500,
            frame: [0; FRAME],
            sent: Vec::new(),
        }
    }
}

/// CRC-16/CCITT, initial value 0xFFFF.
fn crc(bytes: &[u8]) -> u16 {
    let mut crc = 0xFFFFu16;
    for &b in bytes {
        crc ^= u16::from(b) << 8;
        for _ in 0..8 {
            crc = if crc & 0x8000 != 0 {
                crc << 1 ^ 0x1021
            } else {
                crc << 1
            };
        }
    }
    crc
}

impl Converter {
    /// Drives the pin SYNC/RESET; conversions begin anew when it is released.
    pub fn drive_reset(&mut self, now_ns: u64, low: bool) {
        if low && !self.in_reset {
            *self = Self {
                conversions: self.conversions,
                ..Self::default()
            };
        }
        if low {
            self.next_ns = now_ns + self.period_ns;
        }
        self.in_reset = low;
    }

    /// Converts up to this instant.
    pub fn advance(&mut self, now_ns: u64) {
        self.now_ns = now_ns;
        while self.next_ns <= now_ns {
            self.next_ns += self.period_ns;
            self.conversions += 1;
            self.waiting = (self.waiting + 1).min(2);
            self.fallen = true;
        }
    }

    /// When DRDY falls next.
    pub fn next_event_ns(&self) -> u64 {
        self.next_ns
    }

    /// True while a conversion waits to be read.
    pub fn drdy_is_low(&self) -> bool {
        self.fallen
    }

    fn select(&mut self) {
        let mut words = [0u32; 5];
        let data = if self.waiting > 0 { 0xF } else { 0 };
        words[0] = u32::from(self.answer.unwrap_or(self.status | data)) << 8;
        for (n, w) in words[1..].iter_mut().enumerate() {
            *w = (self.conversions as u32).wrapping_mul(n as u32 + 1) & 0xFF_FFFF;
        }
        for (n, w) in words.iter().enumerate() {
            self.frame[3 * n..3 * n + 3].copy_from_slice(&w.to_be_bytes()[1..]);
        }
        let sum = crc(&self.frame[..15]);
        self.frame[15..17].copy_from_slice(&sum.to_be_bytes());
        self.frame[17] = 0;
        self.sent.clear();
        self.waiting = self.waiting.saturating_sub(1);
        self.fallen = false;
    }

    fn exchange(&mut self, byte: u8) -> u8 {
        let out = self.frame.get(self.sent.len()).copied().unwrap_or(0);
        self.sent.push(byte);
        out
    }

    fn deselect(&mut self) {
        if self.sent.len() < 6 {
            return;
        }
        let word = u16::from_be_bytes([self.sent[0], self.sent[1]]);
        let value = u16::from_be_bytes([self.sent[3], self.sent[4]]);
        let address = usize::from(word >> 7 & 0xF);
        let answer = match word {
            0 => {
                self.answer = None;
                return;
            }
            0x0555 => {
                self.status |= 0x8000;
                word
            }
            0x0655 => {
                self.status &= !0x8000;
                word
            }
            _ if word >> 13 == 0b101 => {
                if address == 0 {
                    0x2403
                } else {
                    self.registers[address]
                }
            }
            _ if word >> 13 == 0b011 => {
                self.registers[address] = value;
                if address == 2 {
                    self.status &= !0x0400;
                }
                if address == 3 {
                    self.period_ns = 250_000 * (128 << (value >> 2 & 7)) / 1024;
                }
                0b010 << 13 | word & 0x1FFF
            }
            _ => 0,
        };
        self.answer = Some(answer);
    }
}

/// The converter behind its chip select.
#[derive(Debug)]
pub struct Bus(Shared<Converter>);

impl Bus {
    /// Of this converter.
    pub fn new(converter: Shared<Converter>) -> Self {
        Self(converter)
    }
}

impl Store for Bus {}

impl spi::Peer for Bus {
    fn transfer(&mut self, mosi: u32, _: u8, _: &mut Timeline<'_, '_>) -> u32 {
        u32::from(lock(&self.0).exchange(mosi as u8))
    }
    fn select(&mut self, _: &mut Timeline<'_, '_>) {
        lock(&self.0).select();
    }
    fn deselect(&mut self, _: &mut Timeline<'_, '_>) {
        lock(&self.0).deselect();
    }
}
