//! Measured vibration error from a raw record: how far the mean output shifts when the vibration sets in, with
//! its uncertainty, and what else could have shifted it.
//!
//! A record goes one way: `survey.rs` finds rests and plateaus, `table.rs` or `frames.rs` make segments of them,
//! `shift.rs` compares their means by what `noise.rs` learns of the noise, and `doubts.rs` looks for everything else that
//! could have shifted a mean. A shift that something else explains is never called a vibration error.

mod answer;
mod coefficients;
mod doubts;
mod frames;
mod motion;
mod noise;
mod overview;
mod plateaus;
mod quantisation;
mod runs;
mod screen;
mod segment;
mod selection;
mod shift;
mod spread;
mod survey;
mod table;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use shared::slope::{MIN_SAMPLES, SlopeError};

pub use answer::{Axis, Doubt, Kind, Measurement, Outcome, Picture, Plateau, Summary, Verdict};
pub use coefficients::{
    HarmonicFit, Response, Source as MotionSource, Test, WaveformCoefficients, coefficients,
};
pub use motion::{Kind as MotionKind, Motion};
pub use overview::{ChannelOverview, Drawn, Overview, look};
pub use quantisation::Quantisation;
pub use runs::{APART_S, Station, runs};
pub use segment::{Role, Segment, Spread};
pub use selection::{Names, Selection, Window};

pub use crate::import::{Columns, Unit};

use crate::error::{Error, Problem, clip};
use crate::quantity::Quantity;
use shift::Scene;
use survey::Stretch;
use table::Wanted;

/// Bytes by which a record of frames is told from a table, if columns are named: a table has no zero byte.
const SNIFF: usize = 4096;

/// How numbers become g.
#[derive(Clone, Copy, Debug)]
pub struct Calibration {
    /// Units (counts, volts) a g: the scale factor K1, negative of an inverted output. Of a record of frames it is in V/g at the converter's input:
    /// a record knows nothing of what divides the voltage before.
    pub units_per_g: f64,
    /// Where the output clips, g.
    pub full_scale_g: Option<f64>,
    /// Sensitivity of the bias to temperature, g/C, if it is known.
    pub temperature_sensitivity_g_per_c: Option<f64>,
}

impl Calibration {
    /// From where on a sample counts as clipped: one unit below full scale, for integer counts.
    fn clip_g(&self) -> Option<f64> {
        self.full_scale_g
            .map(|limit| limit - limit.min(1.0 / self.units_per_g.abs()).min(1e-3 * limit))
    }
}

/// What is measured, and how.
#[derive(Clone, Debug)]
pub struct Request {
    /// For a table.
    pub columns: Columns,
    /// Which samples; a record of frames knows its plateaus itself.
    pub selection: Option<Selection>,
    /// The shaker run, if a record of frames has several.
    pub run: Option<u32>,
    /// Units.
    pub calibration: Calibration,
}

/// Measures the vibration error in `file`: a table of any format that [`import`](crate::import) knows, or a record of
/// frames. Without a selection the rests and plateaus of a table are found.
///
/// # Errors
/// Bad input, with file, row and column; nothing selected; too few samples.
pub fn measure(file: &Path, request: &Request) -> Result<Measurement, Error> {
    let columns = &request.columns;
    if columns.outputs.is_empty() || is_record(file, &columns.outputs)? {
        let source = File::open(file).map_err(Error::read(file))?;
        return of_frames(file, source, request);
    }
    let mut found = match &request.selection {
        Some(selection @ Selection::Groups { .. }) => {
            let segments = table::read_groups(file, columns, selection, &request.calibration)?;
            let scene = Scene {
                before: of_role(&segments, Role::Before),
                during: of_role(&segments, Role::During),
                after: None,
                bracketed: false,
                witnesses: Vec::new(),
                separate: true,
            };
            reduce(file, &scene, &columns.outputs, &request.calibration)?
        }
        Some(selection) => of_windows(file, request, selection)?,
        None => plateaus::measure(file, request)?,
    };
    name_rows(file, columns, &mut found)?;
    Ok(found)
}

/// Whether `file` is a record of frames: no file of another maker's channels, and no table, which has no zero byte at its
/// beginning, and whose columns are named.
///
/// # Errors
/// The file cannot be read, or is empty.
pub fn is_record(file: &Path, columns: &[String]) -> Result<bool, Error> {
    if crate::import::format(file)?.is_some() {
        return Ok(false);
    }
    let mut head = Vec::new();
    let source = File::open(file).map_err(Error::read(file))?;
    let mut source = source.take(SNIFF as u64);
    source.read_to_end(&mut head).map_err(Error::read(file))?;
    match head.as_slice() {
        [] => Err(Error::input(file, Problem::EmptyFile)),
        head if crate::import::workbook::is_workbook(head) => Ok(false),
        // Rubbish before the first frame may be long; a table has lines.
        head => Ok(head.contains(&0) || (columns.is_empty() && !head.contains(&b'\n'))),
    }
}

fn of_frames(file: &Path, source: impl Read, request: &Request) -> Result<Measurement, Error> {
    let selection = request.selection.as_ref();
    if matches!(selection, Some(Selection::Groups { .. })) {
        let problem = "--group needs a table and its --column; a record of frames has none";
        return Err(Error::input(file, problem));
    }
    let (segments, tally, left_out) =
        frames::read(file, source, selection, request.run, &request.calibration)?;
    let scene = scene(&segments);
    let columns = ["instrument".to_owned()];
    let mut found = reduce(file, &scene, &columns, &request.calibration)?;
    found.notes.extend(left_out);
    found.record = Some(tally);
    found.axes.iter_mut().flat_map(texts).for_each(|text| {
        *text = doubts::named(text, |sample| format!("sample {sample}"));
    });
    Ok(found)
}

/// Two windows of one record, which is surveyed for more of its noise and for a rest after the vibration.
fn of_windows(file: &Path, request: &Request, selection: &Selection) -> Result<Measurement, Error> {
    let Request {
        columns,
        calibration,
        ..
    } = request;
    let needed = |at: f64| match selection {
        Selection::Windows { before, during } => before.has(at) || during.has(at),
        Selection::Groups { .. } => false,
    };
    let (survey, remark) = table::survey(file, columns, calibration, needed)?;
    let stretches = survey.stretches().into_iter();
    let rests = stretches.filter(|(kind, _)| *kind == Stretch::Rest);
    let wanted: Vec<Wanted> = rests
        .map(|(_, rows)| Wanted {
            name: "rest".into(),
            role: Role::Rest,
            rows: Some(rows),
        })
        .collect();
    // A rest that cannot be read is no witness.
    let segments = table::read_stretches(file, columns, Some(selection), &wanted, calibration)
        .or_else(|_| table::read_stretches(file, columns, Some(selection), &[], calibration))?;
    let mut found = reduce(file, &scene(&segments), &columns.outputs, calibration)?;
    found.notes.extend(remark);
    Ok(found)
}

/// Of the segments of one record: a rest that holds the window before stands for it where noise is concerned.
fn scene(segments: &[Segment]) -> Scene<'_> {
    let [before, during] = [Role::Before, Role::During].map(|role| of_role(segments, role));
    let overlap = |a: &Segment, b: &Segment| match (a.extent, b.extent) {
        (Some([a0, a1]), Some([b0, b1])) => ((a1.min(b1) - a0.max(b0)) / (b1 - b0)).max(0.0),
        _ => 0.0,
    };
    let shaken = |rest: &&Segment| during.iter().all(|during| overlap(during, rest) == 0.0);
    let mut witnesses: Vec<&Segment> = of_role(segments, Role::Rest);
    witnesses.retain(shaken);
    let covered = |window: &&Segment| witnesses.iter().any(|rest| overlap(rest, window) > 0.8);
    let own: Vec<&Segment> = before.iter().copied().filter(|b| !covered(b)).collect();
    witnesses.retain(|rest| own.iter().all(|b| overlap(b, rest) == 0.0));
    let end = during
        .first()
        .and_then(|d| d.extent)
        .map_or(f64::INFINITY, |e| e[1]);
    let after = witnesses
        .iter()
        .copied()
        .filter(|rest| rest.extent.is_some_and(|e| e[0] >= end));
    let after = after.min_by(|a, b| shift::middle(a).total_cmp(&shift::middle(b)));
    witnesses.extend(own);
    witnesses.extend(during.first());
    Scene {
        before,
        during,
        after,
        bracketed: false,
        witnesses,
        separate: false,
    }
}

fn of_role(segments: &[Segment], role: Role) -> Vec<&Segment> {
    segments
        .iter()
        .filter(|segment| segment.role == role)
        .collect()
}

/// The answer of one scene.
fn reduce(
    file: &Path,
    scene: &Scene<'_>,
    columns: &[String],
    calibration: &Calibration,
) -> Result<Measurement, Error> {
    for (role, side) in [(Role::Before, &scene.before), (Role::During, &scene.during)] {
        if side.is_empty() {
            let problem = format!("no sample is selected by --{role}");
            return Err(Error::input(file, Problem::Other(problem)));
        }
    }
    let segments: Vec<&Segment> = [scene.before.as_slice(), &scene.during].concat();
    if let Some(short) = segments.iter().find(|s| s.count() < MIN_SAMPLES) {
        let (name, count) = (clip(&short.name), short.count());
        let what = short.samples_in_blocks().map_or("samples", |_| "blocks");
        let problem =
            format!("\"{name}\": {count} {what} are too few, at least {MIN_SAMPLES} are needed");
        return Err(Error::input(file, problem));
    }
    let failed = |error: SlopeError| Error::input(file, Problem::Other(error.to_string()));
    let axes = columns.iter().enumerate();
    let axes = axes.map(|(index, column)| shift::find(scene, index, column));
    let axes = axes.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let timed = segments.iter().all(|s| s.interval_s.count > 0);
    let axes = doubts::judge(axes, scene, calibration, timed);
    let summaries = segments.iter().map(|segment| summary(segment));
    let summaries = summaries.collect::<Result<_, _>>().map_err(failed)?;
    let mut notes = doubts::notes(scene, columns);
    notes.extend(axes.iter().filter_map(|axis| {
        let hidden = axis.quantisation.as_ref()?;
        Some(hidden.note(&axis.column))
    }));
    Ok(Measurement {
        format: "vre-measurement/1",
        input: file.display().to_string(),
        verdict: worst(&axes),
        reasons: reasons(&axes),
        axes,
        units_per_g: calibration.units_per_g,
        segments: summaries,
        notes,
        record: None,
        plateaus: Vec::new(),
        picture: None,
        coefficients: None,
    })
}

fn worst(axes: &[Axis]) -> Verdict {
    let verdicts = axes.iter().map(|axis| axis.verdict);
    verdicts.max().unwrap_or(Verdict::NoShift)
}

/// Reasons of the axes of whose shift nothing can be claimed.
fn reasons(axes: &[Axis]) -> Vec<Kind> {
    let mut all = Vec::new();
    for reason in axes
        .iter()
        .filter(|axis| axis.verdict >= Verdict::CannotTell)
        .flat_map(|axis| &axis.reasons)
    {
        if !all.contains(reason) {
            all.push(*reason);
        }
    }
    all
}

fn summary(segment: &Segment) -> Result<Summary, SlopeError> {
    let mut mean_g = Vec::new();
    for channel in &segment.channels {
        let estimate = channel.trace.mean_estimate(segment.count())?;
        mean_g.push(match Quantisation::hides(&estimate, channel.step_g) {
            Some(hidden) => hidden.quantity(estimate.value, estimate.sigma, 1),
            None => Quantity::new(estimate.value, estimate.sigma),
        });
    }
    let in_blocks = segment.samples_in_blocks();
    let deviations = segment.channels.iter();
    Ok(Summary {
        name: segment.name.clone(),
        role: segment.role.to_string(),
        samples: in_blocks.unwrap_or(segment.count()),
        blocks: in_blocks.map(|_| segment.count()),
        mean_g,
        rms_g: deviations.map(|c| c.spread.standard_deviation()).collect(),
        temperature_c: (segment.temperature_c.count > 0).then_some(segment.temperature_c.mean),
        extent_s: segment.extent,
    })
}

/// The texts of an axis that may name rows.
fn texts(axis: &mut Axis) -> impl Iterator<Item = &mut String> {
    let all = axis.doubts.iter_mut().chain(&mut axis.rivals);
    all.map(|doubt| &mut doubt.finding)
}

/// Puts lines of the file in the place of numbers of rows.
fn name_rows(file: &Path, columns: &Columns, found: &mut Measurement) -> Result<(), Error> {
    let plateaus = found.plateaus.iter_mut().flat_map(|p| &mut p.axes);
    let mut texts: Vec<&mut String> = found
        .axes
        .iter_mut()
        .chain(plateaus)
        .flat_map(texts)
        .collect();
    let wanted: Vec<u64> = texts.iter().flat_map(|text| doubts::rows(text)).collect();
    if wanted.is_empty() {
        return Ok(());
    }
    let lines = table::lines(file, columns, &wanted)?;
    for text in &mut texts {
        **text = doubts::named(text, |row| match lines.get(&row) {
            Some(line) => format!("row {line}"),
            None => format!("sample {row}"),
        });
    }
    Ok(())
}
