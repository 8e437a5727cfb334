//! Segments from a record of frames, streamed.
//!
//! With windows of time the raw samples are taken; without, the blocks of one shaker run, plateau by
//! plateau: the means of full blocks are samples as even as those that they are made of.

use std::io::Read;
use std::path::Path;

use shared::moments::Moments;
use shared::wire::Event;
use shared::wire::message::{Block, Identity, Plateau, Raw, Segment as Belongs};

use super::Calibration;
use super::segment::{Role, Segment};
use super::selection::Selection;
use crate::error::{Error, Problem};
use crate::record::{self, RecordError, Tally};

/// Codes of the instrument's channel that are the limits of the converter.
const LIMITS: [i32; 2] = [(1 << 23) - 1, -(1 << 23)];

/// Reads the segments, what was lost and what had to be left out; `file` is for errors only.
pub(super) fn read(
    file: &Path,
    source: impl Read,
    selection: Option<&Selection>,
    run: Option<u32>,
    calibration: &Calibration,
) -> Result<(Vec<Segment>, Tally, Option<String>), Error> {
    let mut identified = false;
    let mut reader = Frames {
        file,
        run,
        calibration,
        identity: None,
        segments: Vec::new(),
        session: Session::default(),
        measured: None,
        unidentified: [0; 2],
    };
    let mut held = [0u64; 2];
    let tally = record::read(source, |event, tally| {
        if tally.restarts > reader.session.restarts {
            reader.session = Session {
                restarts: tally.restarts,
                frame: tally.frames,
                byte: tally.bytes,
            };
            reader.identity = None;
        }
        match &event {
            Event::Block(_) => held[0] += 1,
            Event::Raw(_) => held[1] += 1,
            _ => {}
        }
        match event {
            Event::Hello(identity) => {
                reader.identity = Some(identity);
                identified = true;
            }
            Event::Block(block) if selection.is_none() => reader.block(&block)?,
            Event::Raw(raw) => {
                if let Some(Selection::Windows { before, during }) = selection {
                    reader.raw(&raw, |time_s| {
                        match (before.has(time_s), during.has(time_s)) {
                            (true, _) => Some(Role::Before),
                            (_, true) => Some(Role::During),
                            _ => None,
                        }
                    })?;
                }
            }
            _ => {}
        }
        Ok::<(), Failure>(())
    })
    .map_err(|failure| match failure {
        Failure::Record(error) => error.in_file(file),
        Failure::Input(problem) => Error::input(file, problem),
    })?;
    if !identified {
        return Err(Error::input(file, nobody(&tally, held)));
    }
    let note = reader.left_out();
    if let Some(problem) = reader.missing_side(selection) {
        let note = note.map(|note| format!("; {note}")).unwrap_or_default();
        return Err(Error::input(file, problem + &note));
    }
    let mut segments = reader.segments;
    segments.iter_mut().for_each(Segment::finish);
    Ok((segments, tally, note))
}

/// What is wrong with a record in which the instrument never says who it is; `held` counts its blocks and frames of raw
/// samples.
fn nobody(tally: &Tally, held: [u64; 2]) -> Problem {
    let [blocks, raw] = held;
    match (tally.frames, tally.bytes) {
        (0, 0) => Problem::EmptyFile,
        (0, bytes) => Problem::Other(format!(
            "not one sound frame in {bytes} bytes; a table needs --column"
        )),
        (frames, _) => Problem::Other(format!(
            "the instrument never says who it is, so codes are no volts; the record holds {frames} sound frames, {blocks} of \
             them blocks and {raw} of raw samples"
        )),
    }
}

/// Why reading stops.
enum Failure {
    Record(RecordError),
    Input(Problem),
}

impl From<RecordError> for Failure {
    fn from(error: RecordError) -> Self {
        Self::Record(error)
    }
}

struct Frames<'a> {
    file: &'a Path,
    run: Option<u32>,
    calibration: &'a Calibration,
    identity: Option<Identity>,
    segments: Vec<Segment>,
    /// The session that is being read, and that of the samples measured.
    session: Session,
    measured: Option<u64>,
    /// Blocks and frames of raw samples of interest that came while nobody knew from whom.
    unidentified: [u64; 2],
}

/// What lies between two restarts of the instrument.
#[derive(Default)]
struct Session {
    restarts: u64,
    /// Its first sound frame, and where that ends.
    frame: u64,
    byte: u64,
}

impl Frames<'_> {
    /// Samples of two sessions are not of one measurement.
    fn same_session(&mut self) -> Result<(), Failure> {
        let Session {
            restarts,
            frame,
            byte,
        } = self.session;
        if *self.measured.get_or_insert(restarts) == restarts {
            return Ok(());
        }
        let what = self
            .run
            .map_or("the selection".into(), |run| format!("run {run}"));
        Err(Failure::Input(Problem::Other(format!(
            "two sessions in one record: {what} has samples before and after the instrument starts anew in frame {frame} \
             (before byte {byte})"
        ))))
    }

    /// g a code of the instrument's channel; volts are those at the converter's input.
    fn g_per_code(&self, identity: &Identity) -> f64 {
        let volts = identity.reference_v / f64::from(identity.gains[0].max(1)) / f64::from(1 << 23);
        volts / self.calibration.units_per_g
    }

    fn block(&mut self, block: &Block) -> Result<(), Failure> {
        let Belongs::Run(run) = block.segment else {
            return Ok(());
        };
        if self.run.is_some_and(|wanted| run.run != wanted) {
            return Ok(());
        }
        let role = match run.plateau {
            Plateau::Before => Role::Before,
            Plateau::During => Role::During,
            Plateau::After => return Ok(()),
        };
        let Some(identity) = self.identity else {
            self.unidentified[0] += 1;
            return Ok(());
        };
        self.run = Some(run.run);
        self.same_session()?;
        let full = block.lost == 0 && block.count == u32::from(identity.block_samples);
        if !full {
            return Ok(()); // The first and the last of a plateau; their weight would differ.
        }
        let moments = Moments::<f64>::from_block(block)
            .map_err(|error| Failure::Input(Problem::Other(error.to_string())))?;
        let unit = self.g_per_code(&identity);
        let limit = self.calibration.clip_g().unwrap_or(f64::INFINITY);
        let segment = self.segment(role);
        segment.reach(block.first_sample as f64 / f64::from(block.count));
        let Some(channel) = segment.channels.first_mut() else {
            return Ok(());
        };
        let (mean, m2) = (moments.mean()[0] * unit, moments.m2()[0] * unit * unit);
        channel
            .push_block(moments.count(), mean, m2)
            .map_err(Failure::Input)?;
        channel.step_g = Some(unit);
        let (upper, lower) = (moments.max()[0], moments.min()[0]);
        channel.clipped[0] += u64::from(upper >= LIMITS[0] || f64::from(upper) * unit >= limit);
        channel.clipped[1] += u64::from(lower <= LIMITS[1] || f64::from(lower) * unit <= -limit);
        Ok(())
    }

    fn raw(&mut self, raw: &Raw<'_>, role: impl Fn(f64) -> Option<Role>) -> Result<(), Failure> {
        let Some(identity) = self.identity else {
            self.unidentified[1] += 1;
            return Ok(());
        };
        let unit = self.g_per_code(&identity);
        let limit = self.calibration.clip_g().unwrap_or(f64::INFINITY);
        for (index, [code, ..]) in (raw.first_sample..).zip(raw.samples()) {
            let time_s = index as f64 / identity.sample_rate_hz;
            let Some(role) = role(time_s) else { continue };
            self.same_session()?;
            let segment = self.segment(role);
            // Samples that were lost are a gap in time.
            segment.tick(time_s, index);
            let Some(channel) = segment.channels.first_mut() else {
                continue;
            };
            channel
                .push(f64::from(code) * unit, None, index)
                .map_err(Failure::Input)?;
            channel.step_g = Some(unit);
            let output_g = f64::from(code) * unit;
            channel.clipped[0] += u64::from(code >= LIMITS[0] || output_g >= limit);
            channel.clipped[1] += u64::from(code <= LIMITS[1] || output_g <= -limit);
        }
        Ok(())
    }

    /// What came while nobody knew from whom, in words.
    fn left_out(&self) -> Option<String> {
        let [blocks, raw] = self.unidentified;
        (blocks + raw > 0).then(|| {
            format!(
                "{blocks} blocks and {raw} frames of raw samples are left out: the instrument had not yet said who it is"
            )
        })
    }

    /// What is wrong if a side has no sample.
    fn missing_side(&self, selection: Option<&Selection>) -> Option<String> {
        let has = |role: &Role| self.segments.iter().any(|segment| segment.role == *role);
        let role = [Role::Before, Role::During]
            .into_iter()
            .find(|role| !has(role))?;
        Some(match (selection, self.run) {
            (Some(_), _) => format!("no raw sample is selected by --{role}"),
            (None, Some(run)) => format!("run {run} has no full block {role} the vibration"),
            (None, None) => "no block belongs to a shaker run".into(),
        })
    }

    fn segment(&mut self, role: Role) -> &mut Segment {
        let index = self
            .segments
            .iter()
            .position(|segment| segment.role == role);
        let index = index.unwrap_or_else(|| {
            let name = format!("{} {role}", self.file.display());
            self.segments.push(Segment::new(name, role, 1));
            self.segments.len() - 1
        });
        &mut self.segments[index]
    }
}
