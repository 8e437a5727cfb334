//! What is kept of a stretch of samples: constant memory, however long it is.

use shared::slope::Trace;

use super::noise::{Batches, State};
use super::screen::{Ends, Gross, Repeats};
use crate::error::Problem;

pub use super::spread::Spread;

/// The largest output that can be meant, g: more is a wrong scale or a damaged number.
const MAX_OUTPUT_G: f64 = 1e9;

/// Samples that are judged together: long enough for a median, short enough to follow a drift.
const CHUNK: usize = 1024;

/// Samples of a stretch that are kept for the analysis of its motion.
const KEPT: usize = 1 << 16;

/// What a segment is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Output without the vibration.
    Before,
    /// Output under the vibration.
    During,
    /// Another stretch at rest: it shows noise and drift.
    Rest,
    /// Another stretch under vibration.
    Plateau,
}

impl Role {
    /// Whether the output is at rest.
    pub(super) fn state(self) -> State {
        match self {
            Self::Before | Self::Rest => State::Rest,
            Self::During | Self::Plateau => State::Shaken,
        }
    }
}

/// One uninterrupted stretch of samples of one or more columns.
#[derive(Clone, Debug)]
pub struct Segment {
    /// Its name: of the file or the time window.
    pub name: String,
    /// What it is for.
    pub role: Role,
    /// One for each column.
    pub channels: Vec<Channel>,
    /// Temperatures, if the record has them, C.
    pub temperature_c: Spread,
    /// Intervals between samples, if the record has a time, s.
    pub interval_s: Spread,
    /// Intervals that are longer than 1.6 times the mean of those before.
    pub gaps: u64,
    /// Times that are before the time of the sample before, and the number of the first such row, from 0.
    pub backward: (u64, u64),
    /// Time of the first and of the last sample, s; or their numbers in a record without time.
    pub extent: Option<[f64; 2]>,
    last_time_s: Option<f64>,
}

impl Segment {
    /// An empty segment of so many columns.
    pub fn new(name: String, role: Role, columns: usize) -> Self {
        Self {
            name,
            role,
            channels: vec![Channel::default(); columns],
            temperature_c: Spread::default(),
            interval_s: Spread::default(),
            gaps: 0,
            backward: (0, 0),
            extent: None,
            last_time_s: None,
        }
    }

    /// Samples, where [`Self::count`] counts blocks of them.
    pub fn samples_in_blocks(&self) -> Option<u64> {
        let samples = self.channels.first()?.spread.count;
        (samples > self.count()).then_some(samples)
    }

    /// Number of samples, or of blocks if it was made of those.
    pub fn count(&self) -> u64 {
        self.channels.first().map_or(0, |channel| channel.count)
    }

    /// Notes the time of a sample, which is that of a row.
    pub fn tick(&mut self, time_s: f64, row: u64) {
        self.reach(time_s);
        let Some(last) = self.last_time_s.replace(time_s) else {
            return;
        };
        let interval = time_s - last;
        if interval < 0.0 {
            if self.backward.0 == 0 {
                self.backward.1 = row;
            }
            self.backward.0 += 1;
            return;
        }
        if self.interval_s.count >= 16 && interval > 1.6 * self.interval_s.mean {
            self.gaps += 1;
        }
        self.interval_s.add(interval);
    }

    /// Notes where a sample lies, in the unit in which segments are to be compared.
    pub fn reach(&mut self, at: f64) {
        let [from, to] = self.extent.unwrap_or([at, at]);
        self.extent = Some([from.min(at), to.max(at)]);
    }

    /// To be called after the last sample.
    pub fn finish(&mut self) {
        self.channels.iter_mut().for_each(Channel::judge);
    }
}

/// One column of a segment, in g.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// For mean and line fit with their uncertainty.
    pub trace: Trace,
    /// The same with gross samples replaced by the median about them, if there are any.
    pub clean: Option<Box<Trace>>,
    /// For the noise at low frequencies.
    pub(super) batches: Batches,
    /// Mean and standard deviation.
    pub spread: Spread,
    /// Variance about the mean of some hundreds of samples: a drift is not in it.
    pub shake: Shake,
    /// Samples (or blocks) at the upper and at the lower limit.
    pub clipped: [u64; 2],
    /// The values at either end of what was seen.
    pub(super) ends: Ends,
    /// Values that stay.
    pub(super) repeats: Repeats,
    /// Samples that are not of their neighbourhood.
    pub(super) gross: Gross,
    /// The least difference of successive samples that are not equal, or the step of the converter, g.
    pub step_g: Option<f64>,
    /// The first samples.
    pub kept: Vec<f64>,
    count: u64,
    last_g: Option<f64>,
    chunk: Vec<(f64, u64)>,
}

impl Channel {
    /// Takes the sample of a row in g; `limit_g` is where it clips.
    ///
    /// # Errors
    /// The sample is not finite, or of more than a billion g.
    pub fn push(&mut self, output_g: f64, limit_g: Option<f64>, row: u64) -> Result<(), Problem> {
        check(output_g)?;
        self.count += 1;
        self.spread.add(output_g);
        self.batches.push(output_g);
        self.ends.add(output_g);
        self.repeats.add(output_g, row);
        if let Some(limit) = limit_g {
            self.clipped[0] += u64::from(output_g >= limit);
            self.clipped[1] += u64::from(output_g <= -limit);
        }
        let step = self
            .last_g
            .replace(output_g)
            .map(|last| (output_g - last).abs());
        // Less is what rounding leaves of equal numbers.
        if let Some(step) = step.filter(|&step| step > 1e-12 * output_g.abs()) {
            self.step_g = Some(self.step_g.map_or(step, |least| least.min(step)));
        }
        if self.kept.len() < KEPT {
            self.kept.push(output_g);
        }
        self.chunk.push((output_g, row));
        if self.chunk.len() == CHUNK {
            self.judge();
        }
        Ok(())
    }

    /// Takes a block of `count` samples, given their mean and their variance about it.
    ///
    /// # Errors
    /// As for [`Self::push`].
    pub fn push_block(&mut self, count: u64, mean_g: f64, variance_g2: f64) -> Result<(), Problem> {
        check(mean_g)?;
        self.count += 1;
        self.batches.push(mean_g);
        self.spread.merge(count, mean_g, variance_g2);
        self.shake.add(variance_g2 * count as f64, count as f64);
        let pushed = self.trace.push(mean_g);
        pushed.map_err(|error| Problem::Other(error.to_string()))
    }

    /// Judges the samples of a chunk against each other, and passes them on.
    fn judge(&mut self) {
        let chunk = std::mem::take(&mut self.chunk);
        if chunk.is_empty() {
            return;
        }
        let spread: Spread = chunk.iter().map(|sample| sample.0).collect();
        let n = chunk.len() as f64;
        self.shake
            .add(spread.standard_deviation().powi(2) * (n - 1.0), n - 1.0);
        let replaced = self.gross.find(&chunk, self.step_g.unwrap_or(0.0));
        if !replaced.is_empty() && self.clean.is_none() {
            self.clean = Some(Box::new(self.trace.clone()));
        }
        let mut next = replaced.iter().peekable();
        for (index, &(output_g, _)) in chunk.iter().enumerate() {
            // Samples are finite, as `push` has seen.
            let _ = self.trace.push(output_g);
            let median = next.next_if(|(gross, _)| *gross == index);
            if let Some(clean) = &mut self.clean {
                let _ = clean.push(median.map_or(output_g, |&(_, median)| median));
            }
        }
        self.chunk = chunk;
        self.chunk.clear();
    }
}

fn check(output_g: f64) -> Result<(), Problem> {
    if output_g.abs() > MAX_OUTPUT_G {
        let problem =
            format!("{output_g:e} g is more than {MAX_OUTPUT_G:e} g; is the scale right?");
        return Err(Problem::Other(problem));
    }
    match output_g.is_finite() {
        true => Ok(()),
        false => Err(Problem::NotFinite(output_g.to_string())),
    }
}

/// A variance that grows chunk by chunk.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shake {
    squares: f64,
    /// Degrees of freedom.
    pub freedom: f64,
}

impl Shake {
    fn add(&mut self, squares: f64, freedom: f64) {
        self.squares += squares;
        self.freedom += freedom;
    }

    /// Variance, g^2.
    pub fn variance(&self) -> f64 {
        self.squares / self.freedom.max(1.0)
    }
}
