//! The emulated board: the image itself on an emulated microcontroller, with the bench's converter on its bus.

use std::collections::VecDeque;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use emulated::Emulator;
use emulated::converter::DataReady;
use firmware::adc::registers::Config;
use shared::wire::framing::Frame;
use shared::wire::message::Command;

use super::board::Board;
use super::converter::{Converter, OVERSAMPLING, Signal};

/// Conversions whose input is made at once.
const CHUNK: u64 = 64;

/// From power-up until the converter is set up.
const SET_UP: Duration = Duration::from_millis(20);

/// The input of one conversion, V.
type Input = [[f64; 4]; OVERSAMPLING];

/// Input of the conversions to come.
type Inputs = Arc<Mutex<VecDeque<Input>>>;

/// The converter with its clock and what is at its inputs.
struct Clocked {
    converter: Converter,
    inputs: Inputs,
    held: Input,
    conversions: u64,
    drdy: DataReady,
}

impl Clocked {
    /// When a conversion ends, ns.
    fn end_ns(&self, conversion: u64) -> u64 {
        let config = self.converter.config();
        let cycles = u64::from(config.oversampling.clock_cycles());
        (conversion + 1) * cycles * 1_000_000_000 / u64::from(config.clock_hz)
    }
}

impl fmt::Debug for Clocked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.converter.fmt(f)
    }
}

impl emulated::converter::Converter for Clocked {
    fn drive_reset(&mut self, _now_ns: u64, low: bool) {
        self.converter.set_reset_pin(low);
    }

    fn advance(&mut self, now_ns: u64) {
        while self.end_ns(self.conversions) <= now_ns {
            let mut inputs = self.inputs.lock().unwrap_or_else(PoisonError::into_inner);
            // Between two runs the last input stays.
            self.held = inputs.pop_front().unwrap_or(self.held);
            self.converter.convert(&self.held);
            self.conversions += 1;
        }
        self.drdy.advance(now_ns);
    }

    fn next_event_ns(&self) -> u64 {
        self.drdy.next_event_ns(self.end_ns(self.conversions))
    }

    fn drdy_is_low(&self) -> bool {
        let waits = self.converter.drdy_is_low();
        self.drdy.is_low(waits, self.end_ns(self.conversions))
    }

    fn select(&mut self) {
        self.drdy.select(self.converter.drdy_is_low());
        self.converter.select();
    }

    fn exchange(&mut self, byte: u8) -> u8 {
        self.drdy.exchange();
        self.converter.exchange(byte)
    }

    fn deselect(&mut self) {
        self.drdy.deselect();
        self.converter.deselect();
    }

    fn conversions(&self) -> u64 {
        self.conversions
    }
}

/// The emulated board.
pub struct EmulatedBoard {
    emulator: Emulator,
    inputs: Inputs,
    rate_hz: f64,
    /// Conversions whose input was made.
    made: u64,
    sequence: u16,
}

impl EmulatedBoard {
    /// Builds the image, switches the board on and waits until its converter is set up.
    ///
    /// # Errors
    /// One line on why it does not run.
    pub fn start() -> Result<Self, String> {
        let config = Config::default();
        let inputs = Inputs::default();
        let clocked = Clocked {
            converter: Converter::new(config),
            inputs: inputs.clone(),
            held: [[0.0; 4]; OVERSAMPLING],
            conversions: 0,
            drdy: DataReady::default(),
        };
        let mut emulator = Emulator::start(clocked).map_err(|error| error.to_string())?;
        emulator
            .run_for(SET_UP)
            .map_err(|error| error.to_string())?;
        Ok(Self {
            emulator,
            inputs,
            rate_hz: config.sample_rate_hz(),
            made: 0,
            sequence: 0,
        })
    }
}

impl Board for EmulatedBoard {
    fn send(&mut self, command: &Command) -> Result<(), String> {
        let mut frame = Frame::new();
        self.sequence = self.sequence.wrapping_add(1);
        match frame.encode(command, self.sequence) {
            Ok(()) => self.emulator.send(frame.as_bytes()),
            Err(error) => return Err(format!("a command cannot be framed: {error:?}")),
        }
        Ok(())
    }

    fn run(
        &mut self,
        mut samples: u64,
        signal: &mut dyn Signal,
        sink: &mut dyn FnMut(&[u8]),
    ) -> Result<(), String> {
        let inner_hz = self.rate_hz * OVERSAMPLING as f64;
        while samples > 0 {
            let part = samples.min(CHUNK);
            let mut values = vec![[0.0; 4]; part as usize * OVERSAMPLING];
            let start_s = self.made as f64 / self.rate_hz;
            signal.fill(start_s, inner_hz, &mut values);
            let (inputs, _) = values.as_chunks::<OVERSAMPLING>();
            let mut queue = self.inputs.lock().unwrap_or_else(PoisonError::into_inner);
            queue.extend(inputs);
            drop(queue);
            let time = Duration::from_secs_f64(part as f64 / self.rate_hz);
            self.emulator
                .run_for(time)
                .map_err(|error| error.to_string())?;
            sink(&self.emulator.received());
            self.made += part;
            samples -= part;
        }
        Ok(())
    }
}
