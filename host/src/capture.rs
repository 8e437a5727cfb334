//! A campaign measured by the instrument itself: commands go out, frames come in and are recorded, the record is read
//! back and reduced to a campaign's tables.

use std::fs;
use std::path::{Path, PathBuf};

use firmware::adc::registers::Config;
use shared::model::SpecificForce;
use shared::self_check::SetUp;
use shared::wire::message::{self, Command, Plateau};
use shared::wire::version;

use crate::bench::board::{Board, VirtualBoard};
use crate::bench::chain::Motion;
use crate::bench::converter::{Converter, OVERSAMPLING, Quiet, Signal};
use crate::bench::dial;
use crate::bench::excitation::{Excitation, FRONT_END, REFERENCE_V_PER_G};
use crate::bench::plan::{CHANGEOVER_S, Dwell, READING_INTERVAL_S, RUN_INTERVAL_S, Shake};
use crate::bench::shaker::Shaker;
use crate::bench::simulate::VirtualBench;
use crate::campaign::{
    Approach, Campaign, CampaignConfig, Drift, Measured, Reading, ReferenceMoments, Run,
    VibrationKind,
};
use crate::error::Error;
use crate::front_end::FrontEnd;
use crate::record::{self, RecordError, Tally, Writer};
use crate::reduction::{Reduction, ReductionError, SegmentSums};
use crate::source::FileSource;
use crate::statics;

/// The record's name in a campaign folder.
pub const RECORD: &str = "record.vre";

/// Samples in a block: 10 ms at 4 kSPS.
const BLOCK: u16 = 40;
/// Blocks of a dwell at a dial mark.
const DWELL_BLOCKS: u64 = 100;
/// Blocks of a plateau of a shaker run.
const PLATEAU_BLOCKS: u64 = 400;
/// Blocks for the shaker and the converter's filter to settle before a segment begins.
const SETTLING_BLOCKS: u64 = 4;

/// Blocks in which a board solves for its coefficients, in double precision without hardware for it.
const CONCLUDING_BLOCKS: u64 = 200;

/// An axis of the reference stands still below this rms, g: its noise has no shape of interest.
const STANDS_STILL_G: f64 = 1e-3;

/// What came of a capture.
#[derive(Clone, Debug)]
pub struct Captured {
    /// The campaign as reduced from the record.
    pub campaign: Campaign,
    /// What the record held and what was lost.
    pub tally: Tally,
}

/// Steps that [`capture_virtual`] reports: one a reading and one a run.
pub fn steps(bench: &VirtualBench) -> u64 {
    (bench.plan.dwells.len() + bench.plan.runs.len()) as u64
}

/// Measures the plan of a virtual bench through the firmware's own driver and application, and writes record and
/// campaign into `folder`. A record that is there already is kept: see [`make_way`].
///
/// # Errors
/// What the file system says; a record that does not make a campaign.
pub fn capture_virtual(
    bench: &VirtualBench,
    folder: &Path,
    step: impl FnMut(),
) -> Result<Captured, Error> {
    let serial = serial(bench);
    let board = VirtualBoard::new(Converter::new(Config::default()), BLOCK, serial);
    capture(bench, &mut { board }, folder, step)
}

/// Tables that a capture writes from its record.
const TABLES: [&str; 3] = ["campaign.toml", "static.csv", "vibration.csv"];

/// Makes way in `folder` for a new record: one that is there is kept as `record-1.vre` or the next number that is free, and
/// tables are removed, since they would pass for those of the new one.
///
/// # Errors
/// What the file system says.
pub fn make_way(folder: &Path) -> Result<(), Error> {
    let file = folder.join(RECORD);
    if file.exists() {
        let mut names = (1_u32..).map(|n| folder.join(format!("record-{n}.vre")));
        if let Some(kept) = names.find(|kept| !kept.exists()) {
            fs::rename(&file, &kept).map_err(Error::write(&kept))?;
        }
    }
    for table in TABLES.map(|name| folder.join(name)) {
        match fs::remove_file(&table) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(Error::write(&table)(error));
            }
            _ => {}
        }
    }
    Ok(())
}

fn serial(bench: &VirtualBench) -> [u8; 12] {
    let mut serial = [0; 12];
    for (to, from) in serial.iter_mut().zip(bench.serial().bytes()) {
        *to = from;
    }
    serial
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
    fs::create_dir_all(folder).map_err(Error::write(folder))?;
    make_way(folder)?;
    let file = folder.join(RECORD);
    let mut config = bench.config();
    config.acquisition = config.acquisition.with_front_end(FRONT_END);
    let mut session = Session::open(bench, board, &file)?;
    session.send(&Command::BeginCheck(set_up(&config)))?;
    for order in 0..bench.plan.dwells.len() {
        session.dwell(order)?;
        step();
    }
    session.send(&Command::Conclude)?;
    session.acquire(CONCLUDING_BLOCKS, &mut Quiet)?;
    for number in 0..bench.plan.runs.len() {
        session.run(number)?;
        step();
    }
    let conditions = session.finish()?;
    let (reduction, tally) = reduce(&file, DWELL_BLOCKS)?;
    let campaign = campaign(config, &reduction, &conditions, &file)?;
    campaign.write(folder)?;
    Ok(Captured { campaign, tally })
}

/// Reads a record, with so many blocks in a dwell, into the sums of its segments.
pub(crate) fn reduce(file: &Path, dwell_blocks: u64) -> Result<(Reduction, Tally), Error> {
    enum Failure {
        Record(RecordError),
        Reduction(ReductionError),
    }
    impl From<RecordError> for Failure {
        fn from(error: RecordError) -> Self {
            Self::Record(error)
        }
    }
    let mut reduction = Reduction::new(dwell_blocks, PLATEAU_BLOCKS);
    let source = FileSource::open(file)?;
    let tally = record::read(source, |event, _| {
        reduction.absorb(&event).map_err(Failure::Reduction)
    });
    match tally {
        Ok(tally) => Ok((reduction, tally)),
        Err(Failure::Record(error)) => Err(error.in_file(file)),
        Err(Failure::Reduction(error)) => Err(Error::input(file, error.to_string())),
    }
}

/// What the operator knows of a campaign and the instrument does not: conditions of each reading and run.
#[derive(Debug)]
pub(crate) struct Conditions {
    pub(crate) dwells: Vec<Taken>,
    pub(crate) shakes: Vec<Shaken>,
    pub(crate) local_gravity_g: f64,
    pub(crate) sample_rate_hz: f64,
}

/// A reading that was taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taken {
    /// As in the record.
    pub(crate) number: u32,
    pub(crate) dwell: Dwell,
    pub(crate) time_s: f64,
    pub(crate) temp_c: f64,
}

/// A shaker run that was made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shaken {
    pub(crate) shake: Shake,
    pub(crate) time_s: f64,
    pub(crate) temp_c: f64,
    /// Scale of the reference at the converter.
    pub(crate) reference_v_per_g: f64,
}

/// A conversation with the board while the bench does what the plan says.
struct Session<'b> {
    bench: &'b VirtualBench,
    board: &'b mut dyn Board,
    writer: Writer,
    shaker: Shaker,
    rate_hz: f64,
    conditions: Conditions,
}

impl<'b> Session<'b> {
    fn open(bench: &'b VirtualBench, board: &'b mut dyn Board, file: &Path) -> Result<Self, Error> {
        let config = Config::default();
        let sample_rate_hz = config.sample_rate_hz();
        let mut session = Self {
            board,
            bench,
            writer: Writer::append(file)?,
            shaker: Shaker::default(),
            rate_hz: sample_rate_hz * OVERSAMPLING as f64,
            conditions: Conditions {
                dwells: Vec::new(),
                shakes: Vec::new(),
                local_gravity_g: bench.specification.local_gravity_g,
                sample_rate_hz,
            },
        };
        session.greet()?;
        Ok(session)
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

    /// Lets the board acquire some blocks and records what it sends.
    fn acquire(&mut self, blocks: u64, signal: &mut dyn Signal) -> Result<(), Error> {
        let (writer, mut outcome) = (&mut self.writer, Ok(()));
        let mut sink = |bytes: &[u8]| {
            if outcome.is_ok() {
                outcome = writer.write(bytes);
            }
        };
        let samples = blocks * u64::from(BLOCK);
        let ran = self.board.run(samples, signal, &mut sink);
        ran.map_err(Error::Usage).and(outcome)
    }

    /// A segment: settle, greet, begin, acquire, end. The greeting's answer stands before every segment, so that damage
    /// to the record's beginning does not leave the rest without a unit.
    fn segment(
        &mut self,
        begin: Command,
        end: Command,
        blocks: u64,
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
        let plateau_samples = crate::bench::plan::DURATION_S * self.rate_hz;
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
        let number = order as u32;
        let begin = Command::StartPosition(position(number, &dwell));
        self.conditions.dwells.push(Taken {
            number,
            dwell,
            time_s,
            temp_c: bench.specification.reference_temp_c + constant.excess_k,
        });
        self.segment(begin, Command::StopPosition, DWELL_BLOCKS, &mut signal)
    }

    fn run(&mut self, number: usize) -> Result<(), Error> {
        let bench = self.bench;
        let shake = bench.plan.runs[number];
        let after_static_s = bench.plan.dwells.len() as f64 * READING_INTERVAL_S + CHANGEOVER_S;
        let time_s = after_static_s + number as f64 * RUN_INTERVAL_S;
        let a0_g = shake.a0.map(|a| a * bench.specification.local_gravity_g);
        let constant = bench.constant(a0_g, time_s, &[]);
        let duration_s = plateau_s(self.conditions.sample_rate_hz);
        let mut stream = bench.seed.stream("drive", number as u64);
        let drive = self
            .shaker
            .drive_at(&shake, duration_s, self.rate_hz, &mut stream);
        let moving = Motion::new(&mut self.shaker, &shake, drive, &bench.effects);
        let resting = Motion::rest(&bench.effects);
        let mut scales = bench.seed.stream("reference", number as u64);
        let reference_scale =
            [(); 3].map(|()| 1.0 + bench.specification.reference_rms_rel_sigma * scales.normal());
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
        let temp_c = bench.specification.reference_temp_c + constant.excess_k;
        self.conditions.shakes.push(Shaken {
            shake,
            time_s,
            temp_c,
            reference_v_per_g: REFERENCE_V_PER_G,
        });
        Ok(())
    }

    fn finish(self) -> Result<Conditions, Error> {
        self.writer.finish()?;
        Ok(self.conditions)
    }
}

/// What the instrument is told of a reading.
pub(crate) fn position(reading: u32, dwell: &Dwell) -> message::Position {
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
pub(crate) fn set_up(config: &CampaignConfig) -> SetUp {
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
    (PLATEAU_BLOCKS * u64::from(BLOCK)) as f64 / sample_rate_hz
}

/// The tables of a campaign from the sums of the record's segments.
pub(crate) fn campaign(
    mut config: CampaignConfig,
    reduction: &Reduction,
    conditions: &Conditions,
    file: &Path,
) -> Result<Campaign, Error> {
    config.acquisition.sample_rate_hz = conditions.sample_rate_hz;
    let mut tables = Tables {
        front_end: config.acquisition.front_end(),
        reduction,
        conditions,
        file: file.to_owned(),
        dwell_sigma_v: 0.0,
        plateau_sigma_v: 0.0,
    };
    let dwells = (0..conditions.dwells.len()).map(|order| tables.dwell(order));
    let dwell_sigma_v = tables.pooled_sigma_v(dwells)?;
    let quiet = [Plateau::Before, Plateau::After];
    let plateaus = (0..conditions.shakes.len())
        .flat_map(|number| quiet.map(|plateau| tables.plateau(number, plateau)));
    let plateau_sigma_v = tables.pooled_sigma_v(plateaus)?;
    (tables.dwell_sigma_v, tables.plateau_sigma_v) = (dwell_sigma_v, plateau_sigma_v);

    let readings = (0..conditions.dwells.len()).map(|order| tables.reading(order));
    let runs = (0..conditions.shakes.len()).map(|number| tables.run(number));
    Ok(Campaign {
        config,
        readings: readings.collect::<Result<_, _>>()?,
        runs: runs.collect::<Result<_, _>>()?,
    })
}

struct Tables<'r> {
    front_end: FrontEnd,
    reduction: &'r Reduction,
    conditions: &'r Conditions,
    file: PathBuf,
    /// Standard uncertainty of the mean of one dwell from noise, V.
    dwell_sigma_v: f64,
    /// Standard uncertainty of the mean of one plateau from noise, V.
    plateau_sigma_v: f64,
}

impl Tables<'_> {
    fn bad(&self, problem: impl ToString) -> Error {
        Error::input(&self.file, problem.to_string())
    }

    fn dwell(&self, order: usize) -> Result<&SegmentSums, Error> {
        let number = self.conditions.dwells[order].number;
        self.reduction
            .reading(number)
            .ok_or_else(|| self.bad(format!("has no blocks of reading {number}")))
    }

    fn plateau(&self, number: usize, plateau: Plateau) -> Result<&SegmentSums, Error> {
        self.reduction
            .plateau(number as u32, plateau)
            .ok_or_else(|| self.bad(format!("has no blocks of run {number}, {plateau:?}")))
    }

    /// Standard uncertainty of the mean of one of these equally long segments at rest, V at the instrument's output: pooled, since
    /// one segment alone tells its own noise badly.
    fn pooled_sigma_v<'s>(
        &self,
        segments: impl Iterator<Item = Result<&'s SegmentSums, Error>>,
    ) -> Result<f64, Error> {
        let (mut squares, mut count) = (0.0, 0.0);
        for segment in segments {
            let difference = segment?.half_difference();
            squares += difference
                .ok_or_else(|| self.bad("has segments cut short"))?
                .powi(2);
            count += 1.0;
        }
        Ok(self.output_v_per_code()? * (0.25 * squares / f64::max(count, 1.0)).sqrt())
    }

    /// The instrument's output per code of its channel, V.
    fn output_v_per_code(&self) -> Result<f64, Error> {
        let at_converter = self.reduction.volts_per_code(0);
        let at_converter = at_converter.map_err(|error| self.bad(error))?;
        Ok(self.front_end.output_v(at_converter))
    }

    /// Mean output of a segment, V.
    fn mean_v(&self, sums: &SegmentSums) -> Result<f64, Error> {
        Ok(self.output_v_per_code()? * sums.moments.mean()[0])
    }

    fn reading(&self, order: usize) -> Result<Reading, Error> {
        let Taken {
            number,
            dwell,
            time_s,
            temp_c,
        } = self.conditions.dwells[order];
        let [i, p, o] = dial::nominal(&dwell).map(|a| a * self.conditions.local_gravity_g);
        Ok(Reading {
            order: u64::from(number),
            time_s,
            series: dwell.series,
            dial_deg: dwell.dial_deg,
            mount_deg: dwell.mount_deg,
            approach: dwell.approach,
            specific_force_g: SpecificForce::new(i, p, o),
            temp_c,
            output_v: self.mean_v(self.dwell(order)?)?,
            sigma_v: self.dwell_sigma_v,
            session: None,
            exclude: false,
            line: u64::from(number) + 2,
            unknown: Vec::new(),
        })
    }

    fn run(&self, number: usize) -> Result<Run, Error> {
        let shaken = &self.conditions.shakes[number];
        let shake = &shaken.shake;
        let during = self.plateau(number, Plateau::During)?;
        let duration_s = plateau_s(self.conditions.sample_rate_hz);
        let (drift, drift_sigma) = during
            .drift_per_s(duration_s)
            .map_err(|error| self.bad(error))?;
        let scale = self.output_v_per_code()?;
        let a0_g = shake.a0.map(|a| a * self.conditions.local_gravity_g);
        Ok(Run {
            run: number as u64,
            time_s: shaken.time_s,
            kind: shake.kind,
            direction: shake.direction,
            level_g: shake.level_g,
            band_hz: [shake.f_lo_hz, shake.f_hi_hz],
            specific_force_g: SpecificForce::new(a0_g[0], a0_g[1], a0_g[2]),
            temp_c: shaken.temp_c,
            duration_s,
            measured: Some(Measured {
                before_v: self.mean_v(self.plateau(number, Plateau::Before)?)?,
                during_v: self.mean_v(during)?,
                after_v: Some(self.mean_v(self.plateau(number, Plateau::After)?)?),
                sigma_v: self.plateau_sigma_v,
                drift: Some(Drift {
                    v_per_s: scale * drift,
                    sigma_v_per_s: scale * drift_sigma,
                }),
                extremes: None,
            }),
            reference: Some(self.reference(shaken, during)?),
            session: None,
            exclude: false,
            line: number as u64 + 2,
            unknown: Vec::new(),
        })
    }

    /// What the reference saw; its rms is corrected for the droop of the converter's filter.
    fn reference(&self, shaken: &Shaken, during: &SegmentSums) -> Result<ReferenceMoments, Error> {
        let droop = droop(&shaken.shake, self.conditions.sample_rate_hz);
        let mut seen = ReferenceMoments {
            rms_g: [0.0; 3],
            skewness: [0.0; 3],
            kurtosis: [0.0; 3],
            correlation: Some(during.reference_correlation()),
        };
        for axis in 0..3 {
            let channel = axis + 1;
            let scale = self
                .reduction
                .volts_per_code(channel)
                .map_err(|error| self.bad(error))?;
            let (rms, skewness, kurtosis) = during.shape(channel);
            let rms_g = rms * scale / shaken.reference_v_per_g / droop;
            if rms_g > STANDS_STILL_G {
                (seen.rms_g[axis], seen.skewness[axis], seen.kurtosis[axis]) =
                    (rms_g, skewness, kurtosis);
            }
        }
        if let Some(correlation) = &mut seen.correlation {
            for (of, (j, k)) in correlation.iter_mut().zip([(0, 1), (0, 2), (1, 2)]) {
                let moves = seen.rms_g[j] > 0.0 && seen.rms_g[k] > 0.0;
                *of = if moves { of.clamp(-1.0, 1.0) } else { 0.0 };
            }
        }
        Ok(seen)
    }
}

/// Factor on the rms of a vibration by the converter's sinc3 filter; over a band the root of the mean square.
fn droop(shake: &Shake, sample_rate_hz: f64) -> f64 {
    let power = |frequency_hz: f64| {
        let x = std::f64::consts::PI * frequency_hz / sample_rate_hz;
        (x.sin() / x).powi(6)
    };
    match shake.kind {
        VibrationKind::Sine => power(shake.f_lo_hz).sqrt(),
        VibrationKind::Random => {
            let width = shake.f_hi_hz - shake.f_lo_hz;
            let at = |k: i32| shake.f_lo_hz + (f64::from(k) + 0.5) / 256.0 * width;
            ((0..256).map(|k| power(at(k))).sum::<f64>() / 256.0).sqrt()
        }
    }
}
