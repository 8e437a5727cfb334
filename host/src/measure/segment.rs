//! What is kept of a stretch of samples: constant memory, however long it is.

use shared::slope::Trace;

use crate::error::Problem;

/// The largest output that can be meant, g: more is a wrong scale or a damaged number.
const MAX_OUTPUT_G: f64 = 1e9;

/// What a segment is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Output without the vibration.
    Before,
    /// Output under the vibration.
    During,
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
        self.channels
            .first()
            .map_or(0, |channel| channel.trace.count())
    }

    /// Notes the time of a sample.
    ///
    /// # Errors
    /// The interval in s, if time does not go on.
    pub fn tick(&mut self, time_s: f64) -> Result<(), f64> {
        let Some(last) = self.last_time_s.replace(time_s) else {
            return Ok(());
        };
        let interval = time_s - last;
        if interval <= 0.0 {
            return Err(interval);
        }
        if self.interval_s.count >= 16 && interval > 1.6 * self.interval_s.mean {
            self.gaps += 1;
        }
        self.interval_s.add(interval);
        Ok(())
    }
}

/// One column of a segment, in g.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// For mean and line fit with their uncertainty.
    pub trace: Trace,
    /// Mean and standard deviation.
    pub spread: Spread,
    /// Samples (or blocks) at the upper and at the lower limit.
    pub clipped: [u64; 2],
    /// The least difference of successive samples that are not equal, or the step of the converter, g.
    pub step_g: Option<f64>,
    last_g: Option<f64>,
}

impl Channel {
    /// Takes a sample in g; `limit_g` is where it clips.
    ///
    /// # Errors
    /// The sample is not finite, or of more than a billion g.
    pub fn push(&mut self, output_g: f64, limit_g: Option<f64>) -> Result<(), Problem> {
        self.trace(output_g)?;
        self.spread.add(output_g);
        if let Some(limit) = limit_g {
            self.clipped[0] += u64::from(output_g >= limit);
            self.clipped[1] += u64::from(output_g <= -limit);
        }
        let step = self
            .last_g
            .replace(output_g)
            .map(|last| (output_g - last).abs());
        if let Some(step) = step.filter(|&step| step > 0.0) {
            self.step_g = Some(self.step_g.map_or(step, |least| least.min(step)));
        }
        Ok(())
    }

    /// Takes a block of `count` samples, given their mean and their variance about it.
    ///
    /// # Errors
    /// As for [`Self::push`].
    pub fn push_block(&mut self, count: u64, mean_g: f64, variance_g2: f64) -> Result<(), Problem> {
        self.trace(mean_g)?;
        self.spread.merge(count, mean_g, variance_g2);
        Ok(())
    }

    fn trace(&mut self, output_g: f64) -> Result<(), Problem> {
        if output_g.abs() > MAX_OUTPUT_G {
            let problem =
                format!("{output_g:e} g is more than {MAX_OUTPUT_G:e} g; is the scale right?");
            return Err(Problem::Other(problem));
        }
        self.trace
            .push(output_g)
            .map_err(|error| Problem::Other(error.to_string()))
    }
}

/// Mean and standard deviation (Welford).
#[derive(Clone, Copy, Debug, Default)]
pub struct Spread {
    /// Number of values.
    pub count: u64,
    /// Their mean, 0 of none.
    pub mean: f64,
    squares: f64,
    /// The largest, 0 of none.
    pub max: f64,
    /// The smallest, 0 of none.
    pub min: f64,
}

impl Spread {
    /// Takes a value.
    pub fn add(&mut self, value: f64) {
        (self.min, self.max) = match self.count {
            0 => (value, value),
            _ => (self.min.min(value), self.max.max(value)),
        };
        self.count += 1;
        let delta = value - self.mean;
        self.mean += delta / self.count as f64;
        self.squares += delta * (value - self.mean);
    }

    /// Takes `count` values at once, given their mean and variance; extremes are left as they are.
    pub fn merge(&mut self, count: u64, mean: f64, variance: f64) {
        let (a, b) = (self.count as f64, count as f64);
        let delta = mean - self.mean;
        self.count += count;
        self.mean += delta * b / (a + b);
        self.squares += variance * b + delta * delta * a * b / (a + b);
    }

    /// Of the values themselves, n - 1 in the denominator; 0 of fewer than two.
    pub fn standard_deviation(&self) -> f64 {
        match self.count {
            0 | 1 => 0.0,
            n => (self.squares / (n - 1) as f64).sqrt(),
        }
    }
}

impl FromIterator<f64> for Spread {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut spread = Self::default();
        values.into_iter().for_each(|value| spread.add(value));
        spread
    }
}
