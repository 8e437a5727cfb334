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

/// Reads the segments and what was lost; `file` is for errors only.
pub(super) fn read(
    file: &Path,
    source: impl Read,
    selection: Option<&Selection>,
    run: Option<u32>,
    calibration: &Calibration,
) -> Result<(Vec<Segment>, Tally), Error> {
    let mut reader = Frames {
        file,
        run,
        calibration,
        identity: None,
        segments: Vec::new(),
    };
    let tally = record::read(source, |event| {
        match event {
            Event::Hello(identity) => reader.identity = Some(identity),
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
    if tally.frames == 0 {
        let problem = match tally.bytes {
            0 => Problem::EmptyFile,
            bytes => Problem::Other(format!("not one sound frame in {bytes} bytes")),
        };
        return Err(Error::input(file, problem));
    }
    if reader.identity.is_none() {
        let problem = "the instrument never says who it is, so codes are no volts";
        return Err(Error::input(file, problem));
    }
    Ok((reader.segments, tally))
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
}

impl Frames<'_> {
    /// g a code of the instrument's channel.
    fn g_per_code(&self, identity: &Identity) -> f64 {
        let volts = identity.reference_v / f64::from(identity.gains[0].max(1)) / f64::from(1 << 23);
        volts / self.calibration.units_per_g
    }

    fn block(&mut self, block: &Block) -> Result<(), Failure> {
        let Belongs::Run(run) = block.segment else {
            return Ok(());
        };
        let Some(identity) = self.identity else {
            return Ok(());
        };
        let role = match run.plateau {
            Plateau::Before => Role::Before,
            Plateau::During => Role::During,
            Plateau::After => return Ok(()),
        };
        let wanted = *self.run.get_or_insert(run.run);
        if run.run != wanted {
            return Ok(());
        }
        let full = block.lost == 0 && block.count == u32::from(identity.block_samples);
        if !full {
            return Ok(()); // The first and the last of a plateau; their weight would differ.
        }
        let moments = Moments::<f64>::from_block(block)
            .map_err(|error| Failure::Input(Problem::Other(error.to_string())))?;
        let unit = self.g_per_code(&identity);
        let segment = self.segment(role);
        let Some(channel) = segment.channels.first_mut() else {
            return Ok(());
        };
        let (mean, m2) = (moments.mean()[0] * unit, moments.m2()[0] * unit * unit);
        channel
            .trace
            .push(mean)
            .map_err(|e| Failure::Input(Problem::Other(e.to_string())))?;
        channel.spread.merge(moments.count(), mean, m2);
        channel.clipped[0] += u64::from(moments.max()[0] >= LIMITS[0]);
        channel.clipped[1] += u64::from(moments.min()[0] <= LIMITS[1]);
        Ok(())
    }

    fn raw(&mut self, raw: &Raw<'_>, role: impl Fn(f64) -> Option<Role>) -> Result<(), Failure> {
        let Some(identity) = self.identity else {
            return Ok(());
        };
        let unit = self.g_per_code(&identity);
        let limit = self.calibration.clip_g();
        for (index, [code, ..]) in (raw.first_sample..).zip(raw.samples()) {
            let time_s = index as f64 / identity.sample_rate_hz;
            let Some(role) = role(time_s) else { continue };
            let segment = self.segment(role);
            // Samples that were lost are a gap in time.
            let _ = segment.tick(time_s);
            let Some(channel) = segment.channels.first_mut() else {
                continue;
            };
            channel
                .push(f64::from(code) * unit, limit)
                .map_err(|e| Failure::Input(Problem::Other(e.to_string())))?;
            channel.clipped[0] += u64::from(code >= LIMITS[0]);
            channel.clipped[1] += u64::from(code <= LIMITS[1]);
        }
        Ok(())
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
