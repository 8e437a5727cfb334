//! What is found, as plain types: `vre-measurement/1`.

use serde::Serialize;

use super::coefficients::answer::WaveformCoefficients;
use super::motion::Motion;
use super::quantisation::Quantisation;
use crate::quantity::Quantity;
use crate::record::Tally;

/// The measured shift of the mean, `vre-measurement/1`.
#[derive(Clone, Debug, Serialize)]
pub struct Measurement {
    /// `vre-measurement/1`.
    pub format: &'static str,
    /// The file.
    pub input: String,
    /// What the worst axis gives.
    pub verdict: Verdict,
    /// One for each column; none where plateaus were looked for, each of which has its own.
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
    /// What forbids a claim.
    pub reasons: Vec<Kind>,
    /// What was found without windows.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub plateaus: Vec<Plateau>,
    /// The record at a glance, if it was surveyed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<Picture>,
    /// Coefficients from the waveform, if a reference was named.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coefficients: Option<WaveformCoefficients>,
}

/// What can be said of a shift.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Zero lies within the interval of 95 %.
    NoShift,
    /// Significant, and nothing that was looked at explains it but the vibration.
    Shift,
    /// The record does not show the noise at the time scale of the comparison, or what it shows may hide a shift.
    CannotTell,
    /// Significant, but something else explains as much.
    NotAttributable,
}

impl Verdict {
    /// Its name, as in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoShift => "no-shift",
            Self::Shift => "shift",
            Self::CannotTell => "cannot-tell",
            Self::NotAttributable => "not-attributable",
        }
    }
}

/// What else than the vibration could shift a mean, or make it wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Nothing shakes more than before.
    NoMoreVibration,
    /// Drift and slow noise between the windows.
    Drift,
    /// The instrument was warmer or colder.
    Temperature,
    /// The output was cut at full scale, which itself rectifies.
    Clipping,
    /// Peaks between the samples pass full scale.
    HiddenPeaks,
    /// The output stood still.
    Stuck,
    /// Samples that are not of their neighbourhood.
    GrossSamples,
    /// Steps of the converter larger than the noise.
    Quantisation,
    /// A vibration near a multiple of the sample rate looks like a slow one.
    Aliasing,
    /// The chain passes no constant acceleration.
    AcCoupling,
    /// Times that run back, jump or jitter.
    TimeStamps,
    /// The instrument stood in another direction to gravity.
    Orientation,
    /// Three axes do not show the length of gravity.
    GravityLength,
}

/// What became of a doubt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// It was found.
    Found,
    /// It was looked for, and is not there.
    Clear,
    /// It could not be looked for.
    NotLookedFor,
}

/// One other explanation of a shift.
#[derive(Clone, Debug, Serialize)]
pub struct Doubt {
    /// What it is.
    pub kind: Kind,
    /// The shift that it makes, g; none if it could be anything.
    pub size_g: Option<f64>,
    /// Whether it forbids to attribute the shift to the vibration.
    pub decisive: bool,
    /// In words.
    pub finding: String,
    /// Whether it was found.
    pub outcome: Outcome,
}

impl Kind {
    /// Its name, as in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoMoreVibration => "no-more-vibration",
            Self::Drift => "drift",
            Self::Temperature => "temperature",
            Self::Clipping => "clipping",
            Self::HiddenPeaks => "hidden-peaks",
            Self::Stuck => "stuck",
            Self::GrossSamples => "gross-samples",
            Self::Quantisation => "quantisation",
            Self::Aliasing => "aliasing",
            Self::AcCoupling => "ac-coupling",
            Self::TimeStamps => "time-stamps",
            Self::Orientation => "orientation",
            Self::GravityLength => "gravity-length",
        }
    }
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
    /// The doubts that were found.
    pub rivals: Vec<Doubt>,
    /// All doubts: what was looked for, and what could not be.
    pub doubts: Vec<Doubt>,
    /// What forbids a claim.
    pub reasons: Vec<Kind>,
    /// Shift if gross samples are replaced by the median about them, g; none without such samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub without_gross_g: Option<f64>,
    /// Mean at rest after the vibration less that before, g, if the record has both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after_less_before_g: Option<Quantity>,
    /// The motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<Motion>,
}

/// One segment.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Its name.
    pub name: String,
    /// `before` or `during`, `rest` or `plateau`.
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
    /// From its first sample to its last, s; in rows in a record without time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extent_s: Option<[f64; 2]>,
}

/// A stretch of steady vibration that was found, and its shift against the rests on either side.
#[derive(Clone, Debug, Serialize)]
pub struct Plateau {
    /// First and last time, s; rows in a record without time.
    pub from_s: f64,
    /// Last time, s.
    pub to_s: f64,
    /// `sine` or `random`, of the axis that shakes most.
    pub kind: super::motion::Kind,
    /// Frequency of a sine, Hz.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Band of a random vibration, Hz.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_hz: Option<[f64; 2]>,
    /// Peak of a sine, rms of a random vibration, g.
    pub level_g: f64,
    /// The column that shakes most.
    pub column: String,
    /// Its shift, g.
    pub shift_g: Quantity,
    /// Its verdict.
    pub verdict: Verdict,
    /// What it is compared with: `before and after`, `before` or `after`.
    pub against: String,
    /// One for each column.
    pub axes: Vec<Axis>,
}

/// The record at a glance.
#[derive(Clone, Debug, Serialize)]
pub struct Picture {
    /// From the first time to the last, s; or in rows.
    pub extent_s: [f64; 2],
    /// What shakes in pieces of equal length: root of the sum of the variances of all columns, g.
    pub rms_g: Vec<f64>,
    /// Rests that were taken, s.
    pub rests_s: Vec<[f64; 2]>,
    /// Plateaus that were taken, s.
    pub plateaus_s: Vec<[f64; 2]>,
}
