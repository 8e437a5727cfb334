//! The ADS131M04 as seen from its pins (data sheet SBAS890D): registers, commands, answers, checksums, the buffer of
//! two conversions, DRDY, and in front the filter, gain and quantisation.
//!
//! Plain code without time: whoever owns a [`Converter`] says when it converts. The emulator's bus goes byte by byte
//! ([`Converter::select`], [`Converter::exchange`], [`Converter::deselect`]), the virtual board by whole frames.
//!
//! Simplified: conversions keep their beat through resets and settings; global chop, phase delays, calibration and
//! power modes are not modelled; words have 24 bits and CCITT checksums; the filter's response is that of the part's at
//! [`OVERSAMPLING`] times the data rate (`filter`). The register map's checksum is looked at when a conversion ends.

use firmware::adc::ads131m0x::registers::last_writable_address;
use firmware::adc::frame::{CHANNELS, FORMAT, FRAME, reset_answer};
use firmware::adc::registers::{
    Config, Identification, Oversampling, REFERENCE_V, Register, Settings, Status,
};

/// Input values for each conversion.
pub const OVERSAMPLING: usize = 8;

/// Length of the longest response, that of sinc3, in input values.
const TAPS: usize = 3 * OVERSAMPLING - 2;

/// Input values that one conversion shares with those after it.
const HISTORY: usize = TAPS - OVERSAMPLING;

/// Volts at the converter's four inputs.
pub trait Signal {
    /// Fills in the values from `start_s` on at `rate_hz`. Calls follow each other without gap or overlap.
    fn fill(&mut self, start_s: f64, rate_hz: f64, out: &mut [[f64; 4]]);
}

/// Nothing at all inputs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quiet;

impl Signal for Quiet {
    fn fill(&mut self, _start_s: f64, _rate_hz: f64, out: &mut [[f64; 4]]) {
        out.fill([0.0; 4]);
    }
}

/// What the pin DRDY does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DrdyPin {
    /// It follows the conversions.
    #[default]
    Sound,
    /// Always low.
    StuckLow,
    /// Always high.
    StuckHigh,
}

/// What is broken, to be set from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// So many of the next frames carry a wrong checksum.
    pub wrong_checksums: u32,
    /// So many of the next frames lose a byte on their way.
    pub missing_bytes: u32,
    /// What the pin DRDY does.
    pub drdy: DrdyPin,
    /// The register ID, if it is another device's.
    pub id: Option<u16>,
    /// A register that takes no writing.
    pub stuck_register: Option<Register>,
}

/// The converter.
#[derive(Clone, Debug)]
pub struct Converter {
    /// What is broken.
    pub faults: Faults,
    config: Config,
    registers: [u16; 64],
    locked: bool,
    input_checksum_error: bool,
    /// The checksum of the register map changed.
    register_map_changed: bool,
    /// Clock cycles in which it may change once more, since a register was written.
    register_map_cycles: u32,
    held_in_reset: bool,
    /// The beginning of the next frame: an answer, or the status if there is none.
    answer: Option<u16>,
    /// Conversions that were not read, oldest first.
    buffer: [[i32; 4]; 2],
    buffered: usize,
    /// What is read when there is no new conversion.
    last: [i32; 4],
    edges: u32,
    sent: [u8; FRAME],
    received: [u8; FRAME],
    position: usize,
    history: [[f64; 4]; HISTORY],
    taps: [f64; TAPS],
    code_per_v: [f64; 4],
}

const MODE: usize = Register::Mode.address() as usize;
const GAIN1: usize = Register::Gain1.address() as usize;

/// MODE: the converter was reset.
const MODE_RESET: u16 = 1 << 10;
/// MODE: the checksum of what comes in is checked.
const MODE_INPUT_CHECKSUM: u16 = 1 << 12;
/// MODE: the checksum of the register map is watched.
const MODE_REGISTER_MAP: u16 = 1 << 13;

impl Converter {
    /// After power-up, at a board that is wired and will be set so.
    pub fn new(config: Config) -> Self {
        let mut converter = Self {
            faults: Faults::default(),
            config,
            registers: [0; 64],
            locked: false,
            input_checksum_error: false,
            register_map_changed: false,
            register_map_cycles: 0,
            held_in_reset: false,
            answer: None,
            buffer: [[0; 4]; 2],
            buffered: 0,
            last: [0; 4],
            edges: 0,
            sent: [0; FRAME],
            received: [0; FRAME],
            position: 0,
            history: [[0.0; 4]; HISTORY],
            taps: filter(config.oversampling),
            code_per_v: [0.0; 4],
        };
        converter.reset();
        converter
    }

    /// How the board is wired and will be set.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Back to the state after power-up: by the command, the pin or a fault of the supply.
    pub fn reset(&mut self) {
        self.registers = std::array::from_fn(|address| {
            let register = Register::at(address as u8, CHANNELS);
            register.map_or(0, |register| register.reset_value(CHANNELS))
        });
        self.locked = false;
        self.input_checksum_error = false;
        self.register_map_changed = false;
        self.register_map_cycles = 0;
        self.answer = Some(reset_answer(CHANNELS));
        self.buffered = 0;
        self.set_gains();
    }

    /// Drives the pin SYNC/RESET.
    pub fn set_reset_pin(&mut self, low: bool) {
        if low && !self.held_in_reset {
            self.reset();
        }
        self.held_in_reset = low;
    }

    /// True while the pin DRDY is low.
    pub fn drdy_is_low(&self) -> bool {
        match self.faults.drdy {
            DrdyPin::Sound => self.buffered > 0,
            DrdyPin::StuckLow => true,
            DrdyPin::StuckHigh => false,
        }
    }

    /// Falling edges of DRDY until now, modulo 2^32.
    pub fn drdy_edges(&self) -> u32 {
        self.edges
    }

    /// Ends a conversion with the [`OVERSAMPLING`] input values, V, that came during its period.
    #[inline]
    pub fn convert(&mut self, input_v: &[[f64; 4]; OVERSAMPLING]) {
        let mut sum_v = [0.0; 4];
        let inputs = self.history.iter().chain(input_v);
        for (tap, input) in self.taps.iter().zip(inputs) {
            for (sum, v) in sum_v.iter_mut().zip(input) {
                *sum += tap * v;
            }
        }
        self.history.copy_within(OVERSAMPLING.., 0);
        self.history[HISTORY - OVERSAMPLING..].copy_from_slice(input_v);
        if self.held_in_reset {
            return;
        }
        let codes = std::array::from_fn(|k| {
            (sum_v[k] * self.code_per_v[k])
                .round_ties_even()
                .clamp(-8_388_608.0, 8_388_607.0) as i32
        });
        self.complete(codes);
    }

    /// Ends a conversion with these codes.
    pub fn complete(&mut self, codes: [i32; 4]) {
        if self.held_in_reset {
            return;
        }
        // A third one takes the place of the newer of the two.
        self.buffered = (self.buffered + 1).min(2);
        self.buffer[self.buffered - 1] = codes;
        if self.faults.drdy == DrdyPin::Sound {
            self.edges = self.edges.wrapping_add(1);
        }
        // One pass has seen a write half done, the next one whole: each changes the checksum.
        self.register_map_changed |= self.register_map_cycles > 0;
        let period = self.config.oversampling.clock_cycles();
        self.register_map_cycles = self.register_map_cycles.saturating_sub(period);
    }

    /// Writes a register, if it is one that can be written.
    fn write(&mut self, register: Register, value: u16) {
        let address = register.address();
        let writable = (2..=last_writable_address(CHANNELS)).contains(&address);
        if !writable || self.faults.stuck_register == Some(register) {
            return;
        }
        let changed = std::mem::replace(&mut self.registers[usize::from(address)], value) != value;
        if changed && self.registers[MODE] & MODE_REGISTER_MAP != 0 {
            self.register_map_cycles = Settings::<CHANNELS>::RESET.register_map_cycles();
        }
        self.set_gains();
    }

    fn set_gains(&mut self) {
        let gains = self.registers[GAIN1];
        self.code_per_v = std::array::from_fn(|k| {
            let gain = f64::from(1u32 << (gains >> (4 * k) & 7));
            gain / REFERENCE_V * f64::from(1 << 23)
        });
    }

    /// The status word as it is now.
    fn status(&self) -> u16 {
        let mut status = self.registers[MODE] & (MODE_RESET | 0x0300);
        if self.locked {
            status |= Status::LOCK;
        }
        if self.input_checksum_error {
            status |= Status::INPUT_CHECKSUM;
        }
        if self.register_map_changed {
            status |= Status::REGISTER_MAP;
        }
        if self.buffered > 0 {
            status |= Status::data_bits(CHANNELS);
        }
        status
    }

    /// The status word on its way out, which clears what it tells of.
    fn put_status_out(&mut self) -> u16 {
        let status = self.status();
        self.input_checksum_error = false;
        self.register_map_changed = false;
        status
    }

    fn read_register(&mut self, address: u16) -> u16 {
        match address {
            0x00 => self
                .faults
                .id
                .unwrap_or(Identification::of(CHANNELS).0 | 0x01),
            0x01 => self.put_status_out(),
            _ => self.registers[usize::from(address & 0x3F)],
        }
    }

    /// Chip select falls: the frame to be sent is fixed.
    pub fn select(&mut self) {
        self.position = 0;
        self.received = [0; FRAME];
        let word = match self.answer.take() {
            Some(word) => word,
            None => self.put_status_out(),
        };
        if self.buffered > 0 {
            self.last = self.buffer[0];
            self.buffer[0] = self.buffer[1];
            self.buffered -= 1;
        }
        let mut sent = [0; FRAME];
        sent[..2].copy_from_slice(&word.to_be_bytes());
        for (place, code) in sent[3..15].as_chunks_mut::<3>().0.iter_mut().zip(self.last) {
            place.copy_from_slice(&code.to_be_bytes()[1..]);
        }
        let mut sum = FORMAT.polynomial.checksum(&sent[..15]);
        if self.faults.wrong_checksums > 0 {
            self.faults.wrong_checksums -= 1;
            sum ^= 0x0100;
        }
        sent[15..17].copy_from_slice(&sum.to_be_bytes());
        if self.faults.missing_bytes > 0 {
            self.faults.missing_bytes -= 1;
            sent.copy_within(1.., 0);
            sent[FRAME - 1] = 0xFF;
        }
        self.sent = sent;
    }

    /// One byte each way.
    pub fn exchange(&mut self, byte: u8) -> u8 {
        let Some(received) = self.received.get_mut(self.position) else {
            return 0;
        };
        *received = byte;
        self.position += 1;
        self.sent[self.position - 1]
    }

    /// Chip select rises: a whole frame's command is carried out.
    pub fn deselect(&mut self) {
        if self.position == FRAME && !self.held_in_reset {
            self.command();
        }
    }

    /// A whole frame at once.
    pub fn transfer(&mut self, send: &[u8], receive: &mut [u8]) {
        self.select();
        let length = send.len().min(FRAME);
        if length == FRAME && receive.len() == FRAME {
            self.received.copy_from_slice(send);
            receive.copy_from_slice(&self.sent);
            self.position = FRAME;
        } else {
            for (n, to) in receive.iter_mut().enumerate() {
                *to = self.exchange(send.get(n).copied().unwrap_or(0));
            }
        }
        self.deselect();
    }

    fn command(&mut self) {
        let word = |n: usize| u16::from_be_bytes([self.received[3 * n], self.received[3 * n + 1]]);
        let command = word(0);
        let is_write = command & 0xE000 == 0x6000;
        let registers = if is_write {
            usize::from(command & 0x7F) + 1
        } else {
            0
        };
        let mut sound = true;
        if self.registers[MODE] & MODE_INPUT_CHECKSUM != 0 {
            let end = 1 + registers.min(4);
            sound = FORMAT.polynomial.checksum(&self.received[..3 * end]) == word(end);
            self.input_checksum_error |= !sound;
        }
        if !sound {
            // A register is written as it comes in, before its checksum is known (section 8.5.1.10.8).
            if is_write && !self.locked {
                let register = Register::at((command >> 7 & 0x3F) as u8, CHANNELS);
                let value = word(1);
                if let Some(register) = register {
                    self.write(register, value);
                }
            }
            return;
        }
        self.answer = match command {
            0x0000 => None,
            0x0655 => {
                self.locked = false;
                Some(command)
            }
            _ if command & 0xE000 == 0xA000 => Some(self.read_register(command >> 7 & 0x3F)),
            _ if self.locked => None,
            0x0011 => return self.reset(),
            0x0555 => {
                self.locked = true;
                Some(command)
            }
            _ if is_write => {
                let address = command >> 7 & 0x3F;
                let value = word(1);
                if let Some(register) = Register::at(address as u8, CHANNELS) {
                    self.write(register, value);
                }
                Some(0x4000 | address << 7)
            }
            _ => None,
        };
    }
}

/// The filter as one response of unit gain: three moving means over the sinc3's share of a conversion one after the other,
/// then the mean over the outputs that the sinc1 takes (section 8.3.7.1.2). At a ratio of 16384 the sinc3's share is half
/// an input value; it is left out.
fn filter(oversampling: Oversampling) -> [f64; TAPS] {
    let sinc1 = (oversampling.sinc1_ratio() as usize).min(OVERSAMPLING);
    let sinc3 = OVERSAMPLING / sinc1;
    let mut response = vec![1.0];
    for (length, spread) in [(sinc3, 1), (sinc3, 1), (sinc3, 1), (sinc1, sinc3)] {
        let mut next = vec![0.0; response.len() + (length - 1) * spread];
        for (n, value) in response.iter().enumerate() {
            for k in 0..length {
                next[n + k * spread] += value / length as f64;
            }
        }
        response = next;
    }
    // The last input value is the newest: a shorter response begins later.
    let before = TAPS - response.len();
    std::array::from_fn(|n| n.checked_sub(before).map_or(0.0, |n| response[n]))
}

#[cfg(test)]
mod tests {
    use firmware::adc::frame::{NULL, decode, words};

    use super::*;
    use firmware::adc::frame::Command;

    /// Gain at a frequency, in cycles a conversion.
    fn gain(taps: &[f64; TAPS], cycles_per_conversion: f64) -> f64 {
        let (mut re, mut im) = (0.0, 0.0);
        for (n, tap) in taps.iter().enumerate() {
            let phase =
                std::f64::consts::TAU * cycles_per_conversion * n as f64 / OVERSAMPLING as f64;
            re += tap * phase.cos();
            im += tap * phase.sin();
        }
        f64::hypot(re, im)
    }

    #[test]
    fn filter_has_unit_gain_and_zeros_at_multiples_of_the_data_rate() {
        for oversampling in Oversampling::ALL {
            let taps = filter(oversampling);
            assert!((gain(&taps, 0.0) - 1.0).abs() < 1e-15);
            for zero in 1..OVERSAMPLING {
                assert!(gain(&taps, zero as f64) < 1e-12, "{oversampling:?} {zero}");
            }
        }
        // THEORY's figures for the converter at 4 kSPS: m2 keeps 95 % at 300 Hz, 53 % at 1 kHz, 7 % at 2 kHz.
        for (hz, kept) in [(300.0, 0.95), (1000.0, 0.53), (2000.0, 0.07)] {
            let taps = filter(Oversampling::X1024);
            assert!(
                (gain(&taps, hz / 4000.0).powi(2) - kept).abs() < 0.01,
                "{hz}"
            );
        }
    }

    #[test]
    fn from_a_ratio_of_2048_on_the_droop_is_that_of_sinc3_of_1024_and_a_mean() {
        // |sin(pi f N / fm) / (N sin(pi f / fm))| (equation 7), the modulator at 2^20 cycles a conversion, where its own
        // droop is none.
        let mean = |x: f64, length: f64| {
            let step = std::f64::consts::PI * x / length;
            (std::f64::consts::PI * x).sin() / (length * step.sin())
        };
        for (oversampling, m) in [
            (Oversampling::X1024, 1.0),
            (Oversampling::X2048, 2.0),
            (Oversampling::X4096, 4.0),
            (Oversampling::X8192, 8.0),
            (Oversampling::X16384, 16.0),
        ] {
            let x = 0.25;
            let part = mean(x / m, 1048576.0).powi(3) * if m > 1.0 { mean(x, m) } else { 1.0 };
            // The model's input is coarser than the modulator: three means of 8 values droop less by 3/6 (pi x / 8)^2.
            let coarse = 0.5 * (std::f64::consts::PI * x / 8.0).powi(2);
            assert!(
                (gain(&filter(oversampling), x) - part).abs() < coarse,
                "{m}"
            );
        }
    }

    /// A converter that is set up but for the flag of its register map, and the status of the next frame.
    fn status_after(conversions: u32, converter: &mut Converter) -> Status {
        for _ in 0..conversions {
            converter.complete([0; 4]);
        }
        exchange(converter, Command::Null);
        let mut received = [0; FRAME];
        converter.transfer(&NULL, &mut received);
        decode(words(&received)).unwrap().status()
    }

    fn exchange(converter: &mut Converter, command: Command) {
        converter.transfer(&firmware::adc::frame::encode(command), &mut [0; FRAME]);
    }

    #[test]
    fn a_write_sets_the_flag_of_the_register_map_until_its_status_is_put_out() {
        let mut converter = Converter::new(Config::default());
        exchange(&mut converter, Command::Write(Register::Gain1, 0x1111));
        // The register map is not watched after a reset.
        assert!(!status_after(3, &mut converter).register_map_changed());
        exchange(&mut converter, Command::Write(Register::Mode, 0x3110));
        exchange(&mut converter, Command::Write(Register::Gain1, 0x2222));
        // The converter has not looked yet.
        assert!(!status_after(0, &mut converter).register_map_changed());
        for _ in 0..3 {
            converter.complete([0; 4]);
        }
        let mut received = [0; FRAME];
        converter.transfer(&NULL, &mut received);
        let told = decode(words(&received)).unwrap().status();
        assert!(told.register_map_changed());
        assert!(!status_after(3, &mut converter).register_map_changed());
        // What is written again changes nothing.
        exchange(&mut converter, Command::Write(Register::Gain1, 0x2222));
        assert!(!status_after(3, &mut converter).register_map_changed());
    }

    #[test]
    fn a_write_with_a_wrong_checksum_is_carried_out_and_told() {
        let mut converter = Converter::new(Config::default());
        exchange(&mut converter, Command::Write(Register::Mode, 0x3110));
        let mut frame = firmware::adc::frame::encode(Command::Write(Register::Gain1, 0x0001));
        frame[4] = 0x03;
        converter.transfer(&frame, &mut [0; FRAME]);
        assert_eq!(converter.registers[GAIN1], 0x0003);
        assert!(converter.input_checksum_error);
    }

    #[test]
    fn a_constant_becomes_its_code_and_full_scale_is_clipped() {
        let mut converter = Converter::new(Config::default());
        let volts = [0.3, -1.2, 2.0, -2.0];
        for _ in 0..4 {
            converter.buffered = 0;
            converter.convert(&[volts; OVERSAMPLING]);
        }
        let code = (0.3 / REFERENCE_V * 8_388_608.0_f64).round() as i32;
        assert_eq!(
            converter.buffer[0],
            [code, -8_388_608, 8_388_607, -8_388_608]
        );
    }
}
