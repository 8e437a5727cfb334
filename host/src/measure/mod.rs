//! Measured vibration error from a raw record: how far the mean output shifts when the vibration sets in, with
//! its uncertainty, and what else could have shifted it.
//!
//! Within a segment the uncertainty is that of [`shared::slope`]. Of several segments (files of one family)
//! the scatter between them counts as well: the mean of each side has the larger of the two variances.
//! A shift that something else explains is never called a vibration error (`rival.rs`).

mod frames;
mod quantisation;
mod rival;
mod segment;
mod selection;
mod table;

use std::fs::File;
use std::io::{Cursor, Read};
use std::path::Path;

use serde::Serialize;
use shared::slope::{Estimate, MIN_SAMPLES, SlopeError};
use statrs::distribution::{ContinuousCDF, StudentsT};

pub use quantisation::Quantisation;
pub use rival::{Kind, Rival};
pub use segment::{Role, Segment, Spread};
pub use selection::{Names, Selection, Window};

pub use crate::import::delimited::Columns;

use crate::error::{Error, Problem, clip};
use crate::quantity::Quantity;
use crate::record::Tally;

/// Two-sided risk at which a shift is called significant.
const RISK: f64 = 0.05;

/// Degrees of freedom beyond which Student's t is the normal distribution.
const MAX_FREEDOM: f64 = 1e6;

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

/// The measured shift of the mean, `vre-measurement/1`.
#[derive(Clone, Debug, Serialize)]
pub struct Measurement {
    /// `vre-measurement/1`.
    pub format: &'static str,
    /// The file.
    pub input: String,
    /// What the worst axis gives.
    pub verdict: Verdict,
    /// One for each column.
    pub axes: Vec<Axis>,
    /// Scale factor: of a record of frames in V/g at the converter's input, behind all dividers.
    pub units_per_g: f64,
    /// The segments in the order of the record.
    pub segments: Vec<Summary>,
    /// What should be known about the record, without bearing on the verdict.
    pub notes: Vec<String>,
    /// What a record of frames holds and lost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub record: Option<Tally>,
}

/// What can be said of a shift.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Zero lies within the interval of 95 %.
    NoShift,
    /// Significant, and nothing that was looked at explains it but the vibration.
    Attributable,
    /// Significant, but something else explains as much.
    NotAttributable,
}

/// The shift of one axis.
#[derive(Clone, Debug, Serialize)]
pub struct Axis {
    /// The column.
    pub column: String,
    /// Verdict.
    pub verdict: Verdict,
    /// Shift by integration and line fit, g.
    pub shift_g: Quantity,
    /// Degrees of freedom of its uncertainty, at most a million.
    pub degrees_of_freedom: f64,
    /// Probability of a shift at least as large if there were none; none if the noise is unknown.
    pub p_value: Option<f64>,
    /// Interval of 95 %, g.
    pub interval_95_g: [f64; 2],
    /// Plain difference of the means, g.
    pub mean_difference_g: Quantity,
    /// Standard deviation before, the root of the mean square over segments, g.
    pub rms_before_g: f64,
    /// The same during, g.
    pub rms_during_g: f64,
    /// The step that hides the noise of a segment without scatter, g; the noise is unknown then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quantisation: Option<Quantisation>,
    /// Share of samples (or of blocks that hold some) at the limits during the vibration.
    pub clipped_share: f64,
    /// What else could have shifted the mean.
    pub rivals: Vec<Rival>,
}

/// One segment.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Its name.
    pub name: String,
    /// `before` or `during`.
    pub role: String,
    /// Samples.
    pub samples: u64,
    /// The blocks that they came in, if it was measured from blocks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blocks: Option<u64>,
    /// Mean of each column, with its uncertainty within the segment, g.
    pub mean_g: Vec<Quantity>,
    /// Standard deviation of each column, g.
    pub rms_g: Vec<f64>,
    /// Mean temperature, C.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
}

/// Measures the vibration error in `file`: a CSV table or a record of frames.
///
/// # Errors
/// Bad input, with file, row and column; nothing selected; too few samples.
pub fn measure(file: &Path, request: &Request) -> Result<Measurement, Error> {
    let mut source = File::open(file).map_err(Error::read(file))?;
    let mut head = Vec::new();
    source
        .by_ref()
        .take(SNIFF as u64)
        .read_to_end(&mut head)
        .map_err(Error::read(file))?;
    if head.is_empty() {
        return Err(Error::input(file, Problem::EmptyFile));
    }
    let is_record = request.columns.outputs.is_empty() || head.contains(&0);
    let source = Cursor::new(head).chain(source);
    let calibration = &request.calibration;
    let (segments, columns, record, left_out) = if is_record {
        let selection = request.selection.as_ref();
        if matches!(selection, Some(Selection::Groups { .. })) {
            let problem = "--group needs a table and its --column; a record of frames has none";
            return Err(Error::input(file, problem));
        }
        let (segments, tally, left_out) =
            frames::read(file, source, selection, request.run, calibration)?;
        (segments, vec!["instrument".into()], Some(tally), left_out)
    } else {
        let selection = request.selection.as_ref();
        let selection =
            selection.ok_or_else(|| Error::input(file, "a table needs --before and --during"))?;
        let segments = table::read(file, source, &request.columns, selection, calibration)?;
        (segments, request.columns.outputs.clone(), None, None)
    };
    // Between files the instrument can have been touched.
    let separate = matches!(request.selection, Some(Selection::Groups { .. }));
    let mut found = reduce(file, &segments, &columns, calibration, separate, record)?;
    found.notes.extend(left_out);
    Ok(found)
}

fn reduce(
    file: &Path,
    segments: &[Segment],
    columns: &[String],
    calibration: &Calibration,
    separate: bool,
    record: Option<Tally>,
) -> Result<Measurement, Error> {
    for role in [Role::Before, Role::During] {
        if !segments.iter().any(|segment| segment.role == role) {
            let problem = format!("no sample is selected by --{role}");
            return Err(Error::input(file, Problem::Other(problem)));
        }
    }
    if let Some(short) = segments
        .iter()
        .find(|segment| segment.count() < MIN_SAMPLES)
    {
        let (name, count) = (clip(&short.name), short.count());
        let what = short.samples_in_blocks().map_or("samples", |_| "blocks");
        let problem =
            format!("\"{name}\": {count} {what} are too few, at least {MIN_SAMPLES} are needed");
        return Err(Error::input(file, problem));
    }
    let failed = |error: SlopeError| Error::input(file, Problem::Other(error.to_string()));
    let mut axes = Vec::new();
    for (index, column) in columns.iter().enumerate() {
        axes.push(axis(segments, index, column).map_err(failed)?);
    }
    rival::judge(&mut axes, segments, calibration, separate);
    let mut summaries = Vec::new();
    for segment in segments {
        let mut mean_g = Vec::new();
        for channel in &segment.channels {
            let estimate = channel
                .trace
                .mean_estimate(segment.count())
                .map_err(failed)?;
            mean_g.push(match Quantisation::hides(&estimate, channel.step_g) {
                Some(hidden) => hidden.quantity(estimate, 1),
                None => Quantity::new(estimate.value, estimate.sigma),
            });
        }
        let in_blocks = segment.samples_in_blocks();
        summaries.push(Summary {
            name: segment.name.clone(),
            role: segment.role.to_string(),
            samples: in_blocks.unwrap_or(segment.count()),
            blocks: in_blocks.map(|_| segment.count()),
            mean_g,
            rms_g: segment
                .channels
                .iter()
                .map(|c| c.spread.standard_deviation())
                .collect(),
            temperature_c: (segment.temperature_c.count > 0).then_some(segment.temperature_c.mean),
        });
    }
    let mut notes = rival::notes(segments, columns);
    notes.extend(axes.iter().filter_map(|axis| {
        let hidden = axis.quantisation.as_ref()?;
        Some(hidden.note(&axis.column))
    }));
    Ok(Measurement {
        format: "vre-measurement/1",
        input: file.display().to_string(),
        verdict: axes
            .iter()
            .map(|axis| axis.verdict)
            .max()
            .unwrap_or(Verdict::NoShift),
        axes,
        units_per_g: calibration.units_per_g,
        segments: summaries,
        notes,
        record,
    })
}

fn axis(segments: &[Segment], index: usize, column: &str) -> Result<Axis, SlopeError> {
    let side = |role: Role| segments.iter().filter(move |segment| segment.role == role);
    let longest = |role| side(role).map(Segment::count).max().unwrap_or(0);
    let span = longest(Role::Before) + longest(Role::During);
    let of = |role: Role, line_fit: bool| {
        let traces = side(role)
            .filter_map(|s| s.channels.get(index))
            .map(|c| &c.trace);
        let estimates: Result<Vec<_>, _> = traces
            .map(|t| {
                if line_fit {
                    t.line_fit_estimate(span)
                } else {
                    t.mean_estimate(span)
                }
            })
            .collect();
        estimates.map(|estimates| pooled(&estimates))
    };
    let before = of(Role::Before, false)?;
    let shift = of(Role::During, true)?.minus(before);
    let difference = of(Role::During, false)?.minus(before);
    let rms = |role: Role| {
        let squares: Spread = side(role)
            .filter_map(|s| s.channels.get(index))
            .map(|c| c.spread.standard_deviation().powi(2))
            .collect();
        squares.mean.sqrt()
    };
    let (p_value, half) = significance(&shift);
    let quantisation = Quantisation::of(segments, index)?;
    let quantity = |figure: Estimate| match &quantisation {
        Some(hidden) => hidden.quantity(figure, 2),
        None => Quantity::new(figure.value, figure.sigma),
    };
    let half = match &quantisation {
        Some(hidden) => half + hidden.step_g.unwrap_or(f64::INFINITY),
        None => half,
    };
    let verdict = match &quantisation {
        None if p_value < RISK => Verdict::Attributable,
        Some(_) if shift.value.abs() > half => Verdict::NotAttributable,
        _ => Verdict::NoShift,
    };
    Ok(Axis {
        column: column.into(),
        verdict,
        shift_g: quantity(shift),
        degrees_of_freedom: shift.degrees_of_freedom.min(MAX_FREEDOM),
        p_value: quantisation.is_none().then_some(p_value),
        interval_95_g: [shift.value - half, shift.value + half],
        mean_difference_g: quantity(difference),
        rms_before_g: rms(Role::Before),
        rms_during_g: rms(Role::During),
        quantisation,
        clipped_share: 0.0,
        rivals: Vec::new(),
    })
}

/// The mean of some estimates: its variance is that of the scatter between them or that within them,
/// whichever is larger.
fn pooled(estimates: &[Estimate]) -> Estimate {
    let n = estimates.len() as f64;
    let scatter: Spread = estimates.iter().map(|estimate| estimate.value).collect();
    let between = scatter.standard_deviation() / n.sqrt();
    // Adding up as differences of independent figures do, then the mean.
    let nothing = Estimate {
        value: 0.0,
        sigma: 0.0,
        degrees_of_freedom: f64::INFINITY,
    };
    let within = estimates
        .iter()
        .fold(nothing, |sum, &estimate| estimate.minus(sum))
        .divided_by(n);
    let (sigma, degrees_of_freedom) = if between > within.sigma {
        (between, n - 1.0)
    } else {
        (within.sigma, within.degrees_of_freedom)
    };
    Estimate {
        value: scatter.mean,
        sigma,
        degrees_of_freedom,
    }
}

/// Probability of a value as far from zero, and half the interval of 95 %; no claim where there is no
/// uncertainty to measure it by.
fn significance(estimate: &Estimate) -> (f64, f64) {
    let unknown = (1.0, f64::INFINITY);
    if !(estimate.value.is_finite() && estimate.sigma.is_finite()) {
        return unknown;
    }
    let freedom = estimate.degrees_of_freedom.clamp(0.1, MAX_FREEDOM);
    match StudentsT::new(0.0, 1.0, freedom) {
        Ok(t) if estimate.sigma > 0.0 => {
            let z = (estimate.value / estimate.sigma).abs();
            (
                2.0 * t.sf(z),
                t.inverse_cdf(1.0 - RISK / 2.0) * estimate.sigma,
            )
        }
        _ => unknown,
    }
}
