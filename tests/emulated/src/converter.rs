//! The converter on the emulated bus: what the bus asks of a model of one, and a plain one.

use std::fmt::Debug;

use rigless::chip::{Timeline, spi};
use rigless::snapshot::Store;

use crate::board::{Shared, lock};

/// A converter as its pins show it. Instants are nanoseconds since power came on and never go back.
pub trait Converter: Debug + Send {
    /// Drives the pin SYNC/RESET; conversions begin anew when it is released.
    fn drive_reset(&mut self, now_ns: u64, low: bool);

    /// Converts up to this instant.
    fn advance(&mut self, now_ns: u64);

    /// When DRDY changes by itself next; later than the last [`Self::advance`].
    fn next_event_ns(&self) -> u64;

    /// The pin DRDY.
    fn drdy_is_low(&self) -> bool;

    /// The chip select falls.
    fn select(&mut self);

    /// A byte each way.
    fn exchange(&mut self, byte: u8) -> u8;

    /// The chip select rises.
    fn deselect(&mut self);

    /// Conversions since power came on.
    fn conversions(&self) -> u64;
}

/// The four codes of a conversion, by its number.
pub type Signal = Box<dyn FnMut(u64) -> [i32; 4] + Send>;

const FRAME: usize = 18;
const WORD: usize = 3;

/// Bytes of a frame until the four channels are shifted out.
const CHANNELS_OUT: usize = 5 * WORD;

/// How long before the next conversion DRDY rises when the one before was not read, t_w(DRH); 4 cycles of the nominal
/// clock.
const UNREAD_HIGH_NS: u64 = 488;

/// When DRDY is low, of which a converter that is not read in time has its own opinion (data sheets SBAS890, section
/// 8.5.1, and SBASA31B of a sibling, section 8.3.9): from a conversion until its channels are shifted out, but for a
/// short time before the next one. This pulse is left out while a frame goes over the bus, so that a conversion
/// that ends meanwhile makes no edge.
#[derive(Clone, Copy, Debug, Default)]
pub struct DataReady {
    now_ns: u64,
    /// Bytes of the frame that goes over the bus, if it carries a conversion that was not read before.
    shifted: Option<usize>,
}

impl DataReady {
    /// Time goes by.
    pub fn advance(&mut self, now_ns: u64) {
        self.now_ns = now_ns;
    }

    /// A frame begins, with a conversion that was not read before or without.
    pub fn select(&mut self, is_new: bool) {
        self.shifted = is_new.then_some(0);
    }

    /// One more byte of it.
    pub fn exchange(&mut self) {
        self.shifted = self.shifted.map(|shifted| shifted + 1);
    }

    /// It ends.
    pub fn deselect(&mut self) {
        self.shifted = None;
    }

    /// The pin, with or without conversions that wait to be read; the next one ends then.
    pub fn is_low(&self, waits: bool, next_ns: u64) -> bool {
        match self.shifted {
            Some(shifted) => waits || shifted < CHANNELS_OUT,
            None => waits && self.now_ns + UNREAD_HIGH_NS < next_ns,
        }
    }

    /// When the pin changes by itself.
    pub fn next_event_ns(&self, next_ns: u64) -> u64 {
        let rises_ns = next_ns.saturating_sub(UNREAD_HIGH_NS);
        if rises_ns > self.now_ns {
            rises_ns
        } else {
            next_ns
        }
    }
}

/// Registers that can be written, 02h to 1Ch.
const WRITABLE: std::ops::Range<usize> = 0x02..0x1D;

/// Clock cycles in which the converter looks over them once, a bit a cycle (section 8.3.13).
const PASS_CYCLES: u64 = 16 * 27;

/// Clock cycles of a conversion at an oversampling of 1024.
const CYCLES_1024: u64 = 2048;

const MODE: usize = 2;
const CLOCK: usize = 3;

/// MODE: the register map is watched.
const MODE_REGISTER_MAP: u16 = 1 << 13;
/// MODE: the checksums of what comes in are checked.
const MODE_INPUT_CHECKSUM: u16 = 1 << 12;
/// MODE: the converter was reset.
const MODE_RESET: u16 = 1 << 10;

/// Answer to the first frame after a reset.
const AFTER_RESET: u16 = 0xFF24;

/// Registers after a reset (section 8.6).
fn reset_values() -> [u16; 64] {
    let mut registers = [0; 64];
    registers[0] = 0x2403;
    registers[MODE] = 0x0510;
    registers[CLOCK] = 0x0F0E;
    registers[6] = 0x0600;
    for channel in 0..4 {
        registers[0x0C + 5 * channel] = 0x8000;
    }
    registers
}

/// A sound ADS131M04: frames, checksums, registers and DRDY, and a signal.
pub struct Plain {
    signal: Signal,
    /// A conversion at an oversampling of 1024, ns.
    period_1024_ns: u64,
    period_ns: u64,
    next_ns: u64,
    now_ns: u64,
    in_reset: bool,
    conversions: u64,
    /// Conversions that wait to be read, at most two, the older first.
    waiting: Vec<[i32; 4]>,
    drdy: DataReady,
    registers: [u16; 64],
    locked: bool,
    /// A frame came with a wrong checksum.
    input_checksum_failed: bool,
    /// The checksum of the register map changed.
    register_map_changed: bool,
    /// When it will change: the pass that is under way sees a write half done, the next one whole.
    looks_ns: Vec<u64>,
    /// What the next frame begins with, unless it is the status word.
    answer: Option<u16>,
    frame: [u8; FRAME],
    received: Vec<u8>,
}

impl Debug for Plain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Plain")
            .field("conversions", &self.conversions)
            .finish_non_exhaustive()
    }
}

impl Plain {
    /// With the given clock, 8.192 MHz nominal, and signal.
    pub fn new(clock_hz: u32, signal: impl FnMut(u64) -> [i32; 4] + Send + 'static) -> Self {
        let period_1024_ns = CYCLES_1024 * 1_000_000_000 / u64::from(clock_hz.max(1));
        Self {
            signal: Box::new(signal),
            period_1024_ns,
            period_ns: period_1024_ns,
            next_ns: period_1024_ns,
            now_ns: 0,
            in_reset: false,
            conversions: 0,
            waiting: Vec::new(),
            drdy: DataReady::default(),
            registers: reset_values(),
            locked: false,
            input_checksum_failed: false,
            register_map_changed: false,
            looks_ns: Vec::new(),
            answer: Some(AFTER_RESET),
            frame: [0; FRAME],
            received: Vec::new(),
        }
    }

    fn reset(&mut self) {
        self.period_ns = self.period_1024_ns;
        self.next_ns = self.now_ns + self.period_ns;
        self.waiting.clear();
        self.registers = reset_values();
        self.locked = false;
        self.input_checksum_failed = false;
        self.register_map_changed = false;
        self.looks_ns.clear();
        self.answer = Some(AFTER_RESET);
    }

    /// The status word on its way out, which clears what it tells of.
    fn put_status_out(&mut self) -> u16 {
        let data = if self.waiting.is_empty() { 0 } else { 0b1111 };
        let changed = std::mem::take(&mut self.register_map_changed);
        let failed = std::mem::take(&mut self.input_checksum_failed);
        u16::from(self.locked) << 15
            | u16::from(changed) << 13
            | u16::from(failed) << 12
            | self.registers[MODE] & (MODE_RESET | 0x0300)
            | data
    }

    fn write(&mut self, address: usize, value: u16) {
        if !WRITABLE.contains(&address) {
            return;
        }
        let changed = std::mem::replace(&mut self.registers[address], value) != value;
        if address == CLOCK {
            let turbo = value & 1 << 5 != 0;
            let longer = if turbo { 0 } else { 1 + (value >> 2 & 0b111) };
            self.period_ns = (self.period_1024_ns << longer) / 16;
        }
        if changed && self.registers[MODE] & MODE_REGISTER_MAP != 0 {
            let pass_ns = self.period_1024_ns * PASS_CYCLES / CYCLES_1024;
            self.looks_ns = vec![self.now_ns + pass_ns, self.now_ns + 2 * pass_ns];
        }
    }

    /// Carries out the command of a frame; what the next one begins with, if not the status word.
    fn command(&mut self, frame: &[u8]) -> Option<u16> {
        let word = |k: usize| match frame.get(WORD * k..WORD * k + 2) {
            Some(&[high, low]) => u16::from_be_bytes([high, low]),
            _ => 0,
        };
        let command = word(0);
        let address = usize::from(command >> 7 & 0x3F);
        let writes = command >> 13 == 0b011 && !self.locked;
        if writes {
            // Carried out as it comes in, whatever its checksum (section 8.5.1.10.8).
            self.write(address, word(1));
        }
        if self.registers[MODE] & MODE_INPUT_CHECKSUM != 0 {
            let end = if command >> 13 == 0b011 { 2 } else { 1 };
            let covered = frame.get(..WORD * end)?;
            if checksum(covered) != word(end) {
                self.input_checksum_failed = true;
                return None;
            }
        }
        match command {
            0x0655 => self.locked = false,
            _ if command >> 13 == 0b101 => {
                return Some(match address {
                    1 => self.put_status_out(),
                    _ => self.registers[address],
                });
            }
            _ if self.locked => return None,
            0x0011 if frame.len() >= FRAME => {
                self.reset();
                return self.answer;
            }
            0x0555 => self.locked = true,
            _ if writes => return Some(0b010 << 13 | command & 0x1FFF),
            _ => return None,
        }
        Some(command)
    }
}

impl Converter for Plain {
    fn drive_reset(&mut self, now_ns: u64, low: bool) {
        self.now_ns = now_ns;
        if low && !self.in_reset {
            self.reset();
        }
        if low {
            self.next_ns = now_ns + self.period_ns;
        }
        self.in_reset = low;
    }

    fn advance(&mut self, now_ns: u64) {
        self.now_ns = now_ns;
        let looks = self.looks_ns.len();
        self.looks_ns.retain(|look_ns| *look_ns > now_ns);
        self.register_map_changed |= self.looks_ns.len() < looks;
        while self.next_ns <= now_ns {
            self.next_ns += self.period_ns;
            if self.waiting.len() == 2 {
                self.waiting.remove(0);
            }
            self.waiting.push((self.signal)(self.conversions));
            self.conversions += 1;
        }
        self.drdy.advance(now_ns);
    }

    fn next_event_ns(&self) -> u64 {
        self.drdy.next_event_ns(self.next_ns)
    }

    fn drdy_is_low(&self) -> bool {
        self.drdy.is_low(!self.waiting.is_empty(), self.next_ns)
    }

    fn select(&mut self) {
        let first = match self.answer.take() {
            Some(answer) => answer,
            None => self.put_status_out(),
        };
        self.frame = [0; FRAME];
        self.frame[..2].copy_from_slice(&first.to_be_bytes());
        self.drdy.select(!self.waiting.is_empty());
        if !self.waiting.is_empty() {
            let codes = self.waiting.remove(0);
            let (words, _) = self.frame[WORD..].as_chunks_mut::<WORD>();
            for (word, code) in words.iter_mut().zip(codes) {
                let [_, a, b, c] = code.to_be_bytes();
                *word = [a, b, c];
            }
        }
        let end = FRAME - WORD;
        let sum = checksum(&self.frame[..end]);
        self.frame[end..end + 2].copy_from_slice(&sum.to_be_bytes());
        self.received.clear();
    }

    fn exchange(&mut self, byte: u8) -> u8 {
        let sent = self.frame.get(self.received.len()).copied();
        self.received.push(byte);
        self.drdy.exchange();
        sent.unwrap_or(0)
    }

    fn deselect(&mut self) {
        self.drdy.deselect();
        let received = std::mem::take(&mut self.received);
        if received.len() >= 2 * WORD && !self.in_reset {
            self.answer = self.command(&received);
        }
        self.received = received;
    }

    fn conversions(&self) -> u64 {
        self.conversions
    }
}

/// CRC-16/CCITT, initial value 0xFFFF.
fn checksum(bytes: &[u8]) -> u16 {
    let shift = |sum: u16, _| {
        if sum & 0x8000 != 0 {
            sum << 1 ^ 0x1021
        } else {
            sum << 1
        }
    };
    let byte = |sum: u16, &byte: &u8| (0..8).fold(sum ^ u16::from(byte) << 8, shift);
    bytes.iter().fold(0xFFFF, byte)
}

/// A converter behind its chip select.
#[derive(Debug)]
pub struct Bus(Shared<dyn Converter>);

impl Bus {
    /// Of this converter.
    pub fn new(converter: Shared<dyn Converter>) -> Self {
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
