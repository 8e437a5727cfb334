//! The virtual instrument in real time: the firmware's library behind a line without a cable, on a dial that turns when it is
//! told to.

use std::io::{self, Read};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::Source;
use crate::bench::board::VirtualBoard;
use crate::bench::chain::Motion;
use crate::bench::converter::{OVERSAMPLING, Signal};
use crate::bench::excitation::Excitation;
use crate::bench::plan::{DURATION_S, Dwell};
use crate::bench::simulate::VirtualBench;

/// Conversions between two looks at the line: 10 ms at 4 kSPS.
const STEP: u64 = 40;
const STEP_TIME: Duration = Duration::from_millis(10);

/// How long a read waits for bytes.
const PATIENCE: Duration = Duration::from_millis(50);

/// Where the dial stands: the index of a position of the bench's plan.
type Dial = Arc<Mutex<usize>>;

/// The virtual instrument, switched on while this lives.
#[derive(Debug)]
pub struct InstrumentSource {
    name: String,
    to_board: Sender<Vec<u8>>,
    from_board: Receiver<Vec<u8>>,
    /// Bytes that a read had no room for.
    rest: Vec<u8>,
    ends: Arc<AtomicBool>,
    board: Option<JoinHandle<()>>,
}

/// Turns the dial of an instrument.
#[derive(Clone, Debug, Default)]
pub struct Hand(Dial);

impl Hand {
    /// To the position of that index in the bench's plan.
    pub fn turn(&self, order: usize) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = order;
    }
}

impl InstrumentSource {
    /// Switches the instrument on. `bench` and `board` are made in a thread of their own.
    pub fn start(
        bench: impl FnOnce() -> VirtualBench + Send + 'static,
        board: impl FnOnce(&VirtualBench) -> VirtualBoard + Send + 'static,
        hand: &Hand,
    ) -> Self {
        let (to_board, commands) = channel();
        let (events, from_board) = channel();
        let ends = Arc::new(AtomicBool::new(false));
        let (ended, dial) = (Arc::clone(&ends), Arc::clone(&hand.0));
        let run = move || {
            let bench = bench();
            let board = board(&bench);
            converse(&bench, board, &dial, &commands, &events, &ended);
        };
        Self {
            name: "virtual instrument".into(),
            to_board,
            from_board,
            rest: Vec::new(),
            ends,
            board: Some(thread::spawn(run)),
        }
    }
}

impl Drop for InstrumentSource {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(board) = self.board.take() {
            // One that has panicked is as well switched off.
            let _ = board.join();
        }
    }
}

fn converse(
    bench: &VirtualBench,
    mut board: VirtualBoard,
    dial: &Dial,
    commands: &Receiver<Vec<u8>>,
    events: &Sender<Vec<u8>>,
    ended: &AtomicBool,
) {
    let mut at = None;
    let mut signal: Option<Excitation> = None;
    let begun = Instant::now();
    let mut steps = 0;
    while !ended.load(Ordering::Relaxed) {
        for bytes in commands.try_iter() {
            board.receive(&bytes);
        }
        let wanted = *dial.lock().unwrap_or_else(PoisonError::into_inner);
        if at != Some(wanted) {
            at = Some(wanted);
            signal = at_rest(bench, wanted, begun.elapsed().as_secs_f64());
        }
        if let Some(signal) = &mut signal {
            let mut send = |bytes: &[u8]| {
                // Nobody at the other end is no trouble.
                let _ = events.send(bytes.to_vec());
            };
            board.run(STEP, signal as &mut dyn Signal, &mut send);
        }
        steps += 1;
        thread::sleep((STEP_TIME * steps).saturating_sub(begun.elapsed()));
    }
}

/// The instrument at rest at a position of the plan.
fn at_rest(bench: &VirtualBench, order: usize, time_s: f64) -> Option<Excitation> {
    bench.plan.dwells.get(order)?;
    let constant = bench.constant(bench.dwell_force_g(order), time_s, &[]);
    let rate_hz =
        firmware::adc::registers::Config::default().sample_rate_hz() * OVERSAMPLING as f64;
    let k1 = bench.accelerometer.coefficients.scale_factor_v_per_g;
    let noise_v = k1 * bench.specification.noise_g * (DURATION_S * rate_hz).sqrt();
    Some(Excitation::new(
        &bench.chain(),
        &Motion::rest(&bench.effects),
        &constant,
        noise_v,
        [1.0; 3],
        bench.seed.stream("dial at rest", order as u64),
    ))
}

/// The index of a position in a plan.
pub fn order_of(plan: &[Dwell], dwell: &Dwell) -> Option<usize> {
    plan.iter().position(|known| known == dwell)
}

impl Read for InstrumentSource {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.rest.is_empty() {
            self.rest = match self.from_board.recv_timeout(PATIENCE) {
                Ok(bytes) => bytes,
                Err(RecvTimeoutError::Timeout) => return Err(io::ErrorKind::TimedOut.into()),
                Err(RecvTimeoutError::Disconnected) => return Ok(0),
            };
        }
        let length = buffer.len().min(self.rest.len());
        let left = self.rest.split_off(length);
        buffer[..length].copy_from_slice(&self.rest);
        self.rest = left;
        Ok(length)
    }
}

impl Source for InstrumentSource {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn send(&mut self, frame: &[u8]) -> io::Result<()> {
        let sent = self.to_board.send(frame.to_vec());
        sent.map_err(|_| io::ErrorKind::BrokenPipe.into())
    }
}
