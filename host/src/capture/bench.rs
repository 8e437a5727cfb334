//! A campaign of the virtual bench, measured through the firmware's own driver and application.

use std::ops::ControlFlow;
use std::path::Path;

use firmware::adc::registers::Config;
use shared::self_check::SetUp;
use shared::wire::message::{self, Command, Event, Plateau};
use shared::wire::version;

use super::Captured;
use super::folder::Folder;
use super::ledger::{Ledger, LedgerError};
use super::recorder::Recorder;
use crate::bench::board::{Board, VirtualBoard};
use crate::bench::chain::Motion;
use crate::bench::converter::{Converter, OVERSAMPLING, Quiet, Signal};
use crate::bench::excitation::{Excitation, FRONT_END, REFERENCE_V_PER_G};
use crate::bench::plan::{CHANGEOVER_S, DURATION_S, Dwell, READING_INTERVAL_S, RUN_INTERVAL_S};
use crate::bench::shaker::Shaker;
use crate::bench::simulate::VirtualBench;
use crate::campaign::{Approach, Campaign, CampaignConfig, VibrationKind};
use crate::error::Error;
use crate::record::{Note, Reader, ReadingNote, RunNote, Tally};
use crate::statics;

/// Samples in a block: 10 ms at 4 kSPS.
const BLOCK: u16 = 40;
/// Blocks of a dwell at a dial mark.
const DWELL_BLOCKS: u32 = 100;
/// Blocks of a plateau of a shaker run.
const PLATEAU_BLOCKS: u32 = 400;
/// Blocks for the shaker and the converter's filter to settle before a segment begins.
const SETTLING_BLOCKS: u32 = 4;
/// Blocks in which a board solves for its coefficients, in double precision without hardware for it.
const CONCLUDING_BLOCKS: u32 = 200;

/// Steps that [`capture_virtual`] reports: one a reading and one a run.
pub fn steps(bench: &VirtualBench) -> u64 {
    (bench.plan.dwells.len() + bench.plan.runs.len()) as u64
}

/// The board on which [`capture_virtual`] runs.
pub fn virtual_board(bench: &VirtualBench) -> VirtualBoard {
    let mut serial = [0; 12];
    for (to, from) in serial.iter_mut().zip(bench.serial().bytes()) {
        *to = from;
    }
    VirtualBoard::new(Converter::new(Config::default()), BLOCK, serial)
}

/// Measures the plan of a virtual bench through the firmware's own driver and application, and writes record and
/// campaign into `folder`, over a campaign that is there; its record is kept under another name.
///
/// # Errors
/// What the file system says; a record that does not make a campaign.
pub fn capture_virtual(
    bench: &VirtualBench,
    folder: &Path,
    step: impl FnMut(),
) -> Result<Captured, Error> {
    capture(bench, &mut virtual_board(bench), folder, step)
}

/// As [`capture_virtual`], with any board that makes blocks of 40 samples at 4 kSPS. A board that can do a self-check
/// does one over the readings, and its outcome is in the record.
///
/// # Errors
/// As [`capture_virtual`], and when the board does not run.
pub fn capture(
    bench: &VirtualBench,
    board: &mut dyn Board,
    folder: &Path,
    mut step: impl FnMut(),
) -> Result<Captured, Error> {
    let folder = Folder::claim(folder, true)?;
    capture_until(bench, board, &folder, Ledger::default(), &mut || {
        step();
        ControlFlow::Continue(())
    })
}

/// As [`capture`], in a folder whose record tells `ledger` already: what it has is not measured again. `step` is asked before
/// each reading and run whether to go on; what was measured until then is in order.
///
/// # Errors
/// As [`capture`], and a record of another instrument.
pub fn capture_until(
    bench: &VirtualBench,
    board: &mut dyn Board,
    folder: &Folder,
    ledger: Ledger,
    step: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Captured, Error> {
    let mut config = bench.config();
    config.acquisition = config.acquisition.with_front_end(FRONT_END);
    let recorder = folder.begin(&config, ledger)?;
    let mut session = Session::open(bench, board, recorder)?;
    let walked = session.walk(&config, folder, step);
    // What was measured is in order, whatever came between.
    let (ledger, tally) = session.finish()?;
    let complete = walked?;
    let campaign = folder.write_tables(&config, &ledger)?;
    let campaign = campaign.unwrap_or_else(|| Campaign {
        config,
        readings: Vec::new(),
        runs: Vec::new(),
    });
    Ok(Captured {
        campaign,
        tally,
        complete,
    })
}

/// A conversation with the board while the bench does what the plan says.
struct Session<'b> {
    bench: &'b VirtualBench,
    board: &'b mut dyn Board,
    recorder: Recorder,
    reader: Reader,
    shaker: Shaker,
    /// Rate of the converter's inner samples, Hz.
    rate_hz: f64,
    sample_rate_hz: f64,
}

impl<'b> Session<'b> {
    fn open(
        bench: &'b VirtualBench,
        board: &'b mut dyn Board,
        recorder: Recorder,
    ) -> Result<Self, Error> {
        let sample_rate_hz = Config::default().sample_rate_hz();
        let mut session = Self {
            board,
            bench,
            recorder,
            reader: Reader::new(),
            shaker: Shaker::default(),
            rate_hz: sample_rate_hz * OVERSAMPLING as f64,
            sample_rate_hz,
        };
        session.greet()?;
        Ok(session)
    }

    /// The plan, as far as the record does not have it; true if it came to its end.
    fn walk(
        &mut self,
        config: &CampaignConfig,
        folder: &Folder,
        step: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<bool, Error> {
        self.send(&Command::BeginCheck(set_up(config)))?;
        for order in 0..self.bench.plan.dwells.len() {
            if step().is_break() {
                return Ok(false);
            }
            let number = order as u32;
            if !self
                .recorder
                .ledger()
                .readings()
                .any(|taken| taken.number == number)
            {
                self.dwell(order)?;
                folder.write_tables(config, self.recorder.ledger())?;
            }
        }
        self.send(&Command::Conclude)?;
        self.acquire(CONCLUDING_BLOCKS, &mut Quiet)?;
        for order in 0..self.bench.plan.runs.len() {
            if step().is_break() {
                return Ok(false);
            }
            let number = order as u32;
            if !self
                .recorder
                .ledger()
                .runs()
                .any(|shaken| shaken.number == number)
            {
                self.run(order)?;
                folder.write_tables(config, self.recorder.ledger())?;
            }
        }
        Ok(true)
    }

    /// Asks the instrument who it is.
    fn greet(&mut self) -> Result<(), Error> {
        self.send(&Command::Hello {
            version: version::CURRENT,
        })
    }

    fn send(&mut self, command: &Command) -> Result<(), Error> {
        self.board.send(command).map_err(Error::Usage)
    }

    /// Lets the board acquire some blocks, records what it sends and hears it.
    fn acquire(&mut self, blocks: u32, signal: &mut dyn Signal) -> Result<(), Error> {
        let Self {
            recorder, reader, ..
        } = self;
        let mut outcome = Ok(());
        let mut sink = |bytes: &[u8]| {
            if outcome.is_ok() {
                outcome = take(recorder, reader, bytes);
            }
        };
        let samples = u64::from(blocks) * u64::from(BLOCK);
        let ran = self.board.run(samples, signal, &mut sink);
        ran.map_err(Error::Usage).and(outcome)
    }

    /// A segment: settle, greet, begin, acquire, end. The greeting's answer stands before every segment, so that damage
    /// to the record's beginning does not leave the rest without a unit.
    fn segment(
        &mut self,
        begin: Command,
        end: Command,
        blocks: u32,
        signal: &mut Excitation,
    ) -> Result<(), Error> {
        self.greet()?;
        self.acquire(SETTLING_BLOCKS, signal)?;
        self.send(&begin)?;
        self.acquire(blocks, signal)?;
        self.send(&end)?;
        self.acquire(1, signal)
    }

    /// Standard deviation of the instrument's noise at each of the converter's inner samples, V: the specification
    /// states that of an 8 s plateau's mean.
    fn noise_v(&self) -> f64 {
        let plateau_samples = DURATION_S * self.rate_hz;
        let k1 = self.bench.accelerometer.coefficients.scale_factor_v_per_g;
        k1 * self.bench.specification.noise_g * plateau_samples.sqrt()
    }

    fn dwell(&mut self, order: usize) -> Result<(), Error> {
        let bench = self.bench;
        let dwell = bench.plan.dwells[order];
        let time_s = (order + 1) as f64 * READING_INTERVAL_S;
        let constant = bench.constant(bench.dwell_force_g(order), time_s, &[]);
        let mut signal = Excitation::new(
            &bench.chain(),
            &Motion::rest(&bench.effects),
            &constant,
            self.noise_v(),
            [1.0; 3],
            bench.seed.stream("dwell waveform", order as u64),
        );
        let reading = order as u32;
        let position = position(reading, &dwell);
        self.recorder.note(&Note::Reading(ReadingNote {
            position,
            time_s,
            temp_c: bench.specification.reference_temp_c + constant.excess_k,
            blocks: DWELL_BLOCKS,
        }))?;
        let begin = Command::StartPosition(position);
        self.segment(begin, Command::StopPosition, DWELL_BLOCKS, &mut signal)?;
        self.recorder.note(&Note::ReadingTaken { reading })
    }

    fn run(&mut self, number: usize) -> Result<(), Error> {
        let bench = self.bench;
        let shake = bench.plan.runs[number];
        let after_static_s = bench.plan.dwells.len() as f64 * READING_INTERVAL_S + CHANGEOVER_S;
        let time_s = after_static_s + number as f64 * RUN_INTERVAL_S;
        let a0_g = shake.a0.map(|a| a * bench.specification.local_gravity_g);
        let constant = bench.constant(a0_g, time_s, &[]);
        let duration_s = plateau_s(self.sample_rate_hz);
        let mut stream = bench.seed.stream("drive", number as u64);
        let drive = self
            .shaker
            .drive_at(&shake, duration_s, self.rate_hz, &mut stream);
        let moving = Motion::new(&mut self.shaker, &shake, drive, &bench.effects);
        let resting = Motion::rest(&bench.effects);
        let mut scales = bench.seed.stream("reference", number as u64);
        let reference_scale =
            [(); 3].map(|()| 1.0 + bench.specification.reference_rms_rel_sigma * scales.normal());
        let temp_c = bench.specification.reference_temp_c + constant.excess_k;
        self.recorder.note(&Note::Run(RunNote {
            run: number as u32,
            random: shake.kind == VibrationKind::Random,
            direction: shake.direction,
            level_g: shake.level_g,
            band_hz: [shake.f_lo_hz, shake.f_hi_hz],
            a0: shake.a0,
            time_s,
            temp_c,
            blocks: PLATEAU_BLOCKS,
            reference_v_per_g: REFERENCE_V_PER_G,
        }))?;
        for plateau in [Plateau::Before, Plateau::During, Plateau::After] {
            let motion = if plateau == Plateau::During {
                &moving
            } else {
                &resting
            };
            let index = 3 * number as u64 + plateau as u64;
            let mut signal = Excitation::new(
                &bench.chain(),
                motion,
                &constant,
                self.noise_v(),
                reference_scale,
                bench.seed.stream("plateau waveform", index),
            );
            let begin = Command::StartRun(message::Run {
                run: number as u32,
                plateau,
            });
            self.segment(begin, Command::StopRun, PLATEAU_BLOCKS, &mut signal)?;
        }
        self.recorder.note(&Note::RunTaken { run: number as u32 })
    }

    fn finish(self) -> Result<(Ledger, Tally), Error> {
        Ok((self.recorder.finish()?, self.reader.finish()))
    }
}

/// Records what came and hears it.
fn take(recorder: &mut Recorder, reader: &mut Reader, bytes: &[u8]) -> Result<(), Error> {
    recorder.write(bytes)?;
    let mut bytes = bytes.to_vec();
    let fed = reader.feed(&mut bytes, &mut |event: Event<'_>, _: &Tally| {
        recorder.hear(&event).map_err(LedgerError::from)
    });
    fed.map_err(|error| Error::Usage(error.to_string()))
}

/// What the instrument is told of a reading.
pub fn position(reading: u32, dwell: &Dwell) -> message::Position {
    message::Position {
        reading,
        series: dwell.series.into(),
        dial_deg: dwell.dial_deg,
        mount_deg: dwell.mount_deg,
        approach: match dwell.approach {
            Approach::Clockwise => message::Approach::Cw,
            Approach::CounterClockwise => message::Approach::Ccw,
        },
    }
}

/// What a self-check has to know of a bench, in terms of the volts at the converter.
pub fn set_up(config: &CampaignConfig) -> SetUp {
    SetUp {
        bench: statics::bench(&config.bench),
        nominal_v_per_g: config
            .acquisition
            .front_end()
            .converter_v(config.instrument.scale_factor_nominal_v_per_g),
        // The bench's reference is for vibration.
        reference_v_per_g: None,
    }
}

fn plateau_s(sample_rate_hz: f64) -> f64 {
    f64::from(PLATEAU_BLOCKS * u32::from(BLOCK)) / sample_rate_hz
}
