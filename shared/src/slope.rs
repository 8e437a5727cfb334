//! Measured vibration error by integration and line fit.
//!
//! ```text
//! v(t) = (1/K1) integral_0^t (U(t') - U0) dt',      v(t) ~ VRE * t + c  by least squares
//! ```
//!
//! A line fitted to an integral is a mean of the output under the parabola 6 t (T - t) / T^3. The constant
//! c makes the parabola vanish at both ends: a sine that does not fill whole periods leaks into the slope
//! as 12/(omega T)^2 of its amplitude, into a plain mean as 2/(omega T). That is what the integration is
//! good for; [`VibrationError::mean_difference`] stands beside it for comparison.
//!
//! The residuals of the line are an integrated noise, so the ordinary least-squares standard error of the
//! slope is wrong by orders of magnitude. For white noise of density S the slope's variance is (6/5) S/T.
//! S is measured in the record itself, at low frequencies: by batches whose length doubles from level to
//! level, each under the window (1 - s^2)^3, which keeps the vibration out, and by differences of
//! neighbouring batches, which a drift does not upset. The trend of S over the upper levels carries it on
//! to the length of the record (flicker noise: S grows with the length); what the vibration leaks is
//! measured by the same batches under the parabola. Degrees of freedom say how well the noise is known.
//! Intervals hold the true value as often as claimed for white and flicker noise, with or without a
//! sine, and more often than claimed if the noise remembers about a hundredth of the record.
//!
//! `f64` only: a mean of 10^6 samples to 1e-7 of a scale of 1 leaves not one sound digit in `f32`. Memory is constant:
//! one row of a few numbers for each doubling of the length.

use core::array::from_fn;

#[allow(unused_imports)] // std has them as inherent methods
use num_traits::Float;

/// Levels of doubling: records of up to 2^48 samples.
const LEVELS: usize = 45;

/// Fewest batches that make a level.
const BATCHES: u64 = 8;

/// Levels whose trend is followed, from the longest batches down.
const TREND: usize = 5;

/// Levels that a trend needs.
const LEAST: usize = 3;

/// Length of the shortest batches.
const SHORTEST: u64 = 8;

/// Fewest samples that a [`Trace`] must have to state an uncertainty.
pub const MIN_SAMPLES: u64 = BATCHES * SHORTEST;

/// Why there is no measured vibration error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SlopeError {
    /// A sample is NaN or infinite.
    NotFinite {
        /// Its number within the trace, from 0.
        sample: u64,
    },
    /// A trace has fewer than [`MIN_SAMPLES`].
    TooShort {
        /// How many it has.
        count: u64,
    },
    /// The scale factor is zero or not finite.
    ScaleFactor {
        /// The scale factor given, V/g.
        v_per_g: f64,
    },
}

impl core::fmt::Display for SlopeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotFinite { sample } => write!(f, "sample {sample} is not a finite number"),
            Self::TooShort { count } => {
                write!(
                    f,
                    "{count} samples are too few, at least {MIN_SAMPLES} are needed"
                )
            }
            Self::ScaleFactor { v_per_g } => write!(f, "scale factor {v_per_g} V/g"),
        }
    }
}

impl core::error::Error for SlopeError {}

/// A figure with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The figure.
    pub value: f64,
    /// Its standard uncertainty.
    pub sigma: f64,
    /// Degrees of freedom of the uncertainty, for Student's t.
    pub degrees_of_freedom: f64,
}

impl Estimate {
    /// The difference of two independent figures; degrees of freedom by Welch and Satterthwaite, JCGM
    /// 100:2008 (G.2b).
    pub fn minus(self, other: Self) -> Self {
        let (a, b) = (self.sigma * self.sigma, other.sigma * other.sigma);
        let spread = a * a / self.degrees_of_freedom + b * b / other.degrees_of_freedom;
        let variance = a + b;
        Self {
            value: self.value - other.value,
            sigma: variance.sqrt(),
            degrees_of_freedom: if spread > 0.0 {
                variance * variance / spread
            } else {
                f64::INFINITY
            },
        }
    }

    /// In another unit.
    pub fn divided_by(self, unit: f64) -> Self {
        Self {
            value: self.value / unit,
            sigma: self.sigma / unit.abs(),
            ..self
        }
    }
}

/// The measured vibration error, g.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VibrationError {
    /// Slope of the line fitted to the integrated output.
    #[doc(alias = "VRE")]
    pub line_fit: Estimate,
    /// Mean during less mean before.
    pub mean_difference: Estimate,
}

/// Noise of a trace at low frequencies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowFrequencyNoise {
    /// Variance of a mean of n samples times n, for n the span that was asked for.
    pub density: f64,
    /// Degrees of freedom of [`Self::density`].
    pub degrees_of_freedom: f64,
    /// Power of the span with which the density grows: 0 for white noise, 1 for flicker, 2 for a random walk.
    pub exponent: f64,
}

/// One evenly sampled stretch of output, absorbed sample by sample.
#[derive(Debug, Clone)]
pub struct Trace {
    count: u64,
    /// First sample: all sums are of differences from it.
    origin: f64,
    /// v, the running sum.
    integral: f64,
    /// Sum of v.
    sum: f64,
    /// Sum of v times its index.
    moment: f64,
    /// The shortest batch, not yet full.
    filling: Batch,
    levels: [Level; LEVELS],
}

impl Default for Trace {
    fn default() -> Self {
        Self::new()
    }
}

impl Trace {
    /// An empty trace.
    pub fn new() -> Self {
        Self {
            count: 0,
            origin: 0.0,
            integral: 0.0,
            sum: 0.0,
            moment: 0.0,
            filling: Batch::default(),
            levels: [Level::default(); LEVELS],
        }
    }

    /// Number of samples.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Takes the next sample.
    ///
    /// # Errors
    /// [`SlopeError::NotFinite`], and the sample is left out.
    pub fn push(&mut self, output: f64) -> Result<(), SlopeError> {
        if !output.is_finite() {
            return Err(SlopeError::NotFinite { sample: self.count });
        }
        if self.count == 0 {
            self.origin = output;
        }
        let x = output - self.origin;
        self.count += 1;
        self.integral += x;
        self.sum += self.integral;
        self.moment += self.integral * self.count as f64;
        let place = (self.count - 1) % SHORTEST;
        self.filling.add(x, place);
        if place + 1 < SHORTEST {
            return Ok(());
        }
        let mut batch = core::mem::take(&mut self.filling);
        for level in &mut self.levels {
            match level.take(batch) {
                Some(longer) => batch = longer,
                None => break,
            }
        }
        Ok(())
    }

    /// Plain mean of the samples, `None` of an empty trace.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.origin + self.integral / self.count as f64)
    }

    /// Slope per sample of the line fitted to the running sum, which is a mean under a parabola; `None` of
    /// an empty trace.
    pub fn line_fit(&self) -> Option<f64> {
        // Points (j, v_j), j = 0..=n, v_0 = 0; sum (j - n/2)^2 = n (n + 1)(n + 2) / 12.
        let n = self.count as f64;
        let slope = 12.0 * (self.moment - 0.5 * n * self.sum) / (n * (n + 1.0) * (n + 2.0));
        (self.count > 0).then_some(self.origin + slope)
    }

    /// Noise at low frequencies, for a mean over `span` samples, which may be more than there are.
    ///
    /// # Errors
    /// [`SlopeError::TooShort`].
    pub fn noise(&self, span: u64) -> Result<LowFrequencyNoise, SlopeError> {
        let mut trend = Trend::default();
        let mut above: Option<(f64, f64)> = None;
        let mut best: Option<LowFrequencyNoise> = None;
        for (used, (length, level)) in self.usable_levels().rev().take(TREND).enumerate() {
            let freedom = level.degrees_of_freedom();
            let density = level.variance(Window::Bell) * length / Window::Bell.noise();
            // The mean of the logarithm of a chi-square of f degrees of freedom is lower by 1/f.
            let log = density.max(f64::MIN_POSITIVE).ln() + 1.0 / freedom;
            if let Some((above, above_freedom)) = above
                && log - above > 3.0 * (2.0 / freedom + 2.0 / above_freedom).sqrt()
            {
                break; // Shorter batches still see the vibration.
            }
            above = Some((log, freedom));
            trend.add(length.log2(), log, freedom / 2.0);
            let noise = trend.at(span);
            if used < LEAST || best.is_none_or(|best| noise.exponent < best.exponent) {
                best = Some(noise);
            }
        }
        best.ok_or(SlopeError::TooShort { count: self.count })
    }

    /// [`Self::mean`] with its uncertainty, for comparison with another trace; `span` is the number of samples
    /// of both together, over which the noise at low frequencies acts.
    ///
    /// # Errors
    /// [`SlopeError::TooShort`].
    pub fn mean_estimate(&self, span: u64) -> Result<Estimate, SlopeError> {
        self.estimate(self.mean(), Window::Box, 2, span)
    }

    /// [`Self::line_fit`] with its uncertainty, as [`Self::mean_estimate`].
    ///
    /// # Errors
    /// [`SlopeError::TooShort`].
    pub fn line_fit_estimate(&self, span: u64) -> Result<Estimate, SlopeError> {
        self.estimate(self.line_fit(), Window::Parabola, 4, span)
    }

    fn estimate(
        &self,
        value: Option<f64>,
        window: Window,
        power: i32,
        span: u64,
    ) -> Result<Estimate, SlopeError> {
        let noise = self.noise(span)?;
        let from_noise = window.noise() * noise.density / self.count as f64;
        let variance = from_noise + self.leakage(window, power);
        let share = from_noise / variance;
        Ok(Estimate {
            value: value.ok_or(SlopeError::TooShort { count: self.count })?,
            sigma: variance.sqrt(),
            // The leakage is a bound, known as well as need be (G.2b of JCGM 100:2008).
            degrees_of_freedom: if share > 0.0 {
                noise.degrees_of_freedom / (share * share)
            } else {
                f64::INFINITY
            },
        })
    }

    /// Variance that the vibration itself adds to a full-length mean under the window, by not filling it
    /// with whole periods: falls as the length to the power -2 (plain mean) or -4 (parabola).
    fn leakage(&self, window: Window, power: i32) -> f64 {
        let excess = |(length, level): (f64, &Level)| {
            let noise = level.variance(Window::Bell) * window.noise() / Window::Bell.noise();
            (level.variance(window) - noise) * (length / self.count as f64).powi(power)
        };
        self.usable_levels().map(excess).fold(0.0, f64::max)
    }

    /// Levels of enough batches with the batch length, shortest first.
    fn usable_levels(&self) -> impl DoubleEndedIterator<Item = (f64, &Level)> {
        let levels = self.levels.iter().enumerate();
        levels
            .filter(|(_, level)| level.differences + 1 >= BATCHES)
            .map(|(doublings, level)| ((SHORTEST << doublings) as f64, level))
    }
}

/// The measured vibration error from the output before the vibration and during it, both sampled at the
/// same even rate; scale factor K1 in V/g (or 1 for traces in g).
///
/// # Errors
/// [`SlopeError::TooShort`] for either trace, [`SlopeError::ScaleFactor`].
pub fn vibration_error(
    before: &Trace,
    during: &Trace,
    scale_factor_v_per_g: f64,
) -> Result<VibrationError, SlopeError> {
    if !(scale_factor_v_per_g.is_normal()) {
        return Err(SlopeError::ScaleFactor {
            v_per_g: scale_factor_v_per_g,
        });
    }
    let span = before.count + during.count;
    let zero = before.mean_estimate(span)?;
    let in_g = |estimate: Estimate| estimate.minus(zero).divided_by(scale_factor_v_per_g);
    Ok(VibrationError {
        line_fit: in_g(during.line_fit_estimate(span)?),
        mean_difference: in_g(during.mean_estimate(span)?),
    })
}

/// Windows over a batch, s = -1..1.
#[derive(Debug, Clone, Copy)]
enum Window {
    /// 1.
    Box,
    /// 1 - s^2.
    Parabola,
    /// (1 - s^2)^3.
    Bell,
}

impl Window {
    /// Variance of the windowed mean of white noise, relative to that of a plain mean.
    fn noise(self) -> f64 {
        match self {
            Self::Box => 1.0,
            Self::Parabola => 6.0 / 5.0,
            Self::Bell => 700.0 / 429.0,
        }
    }
}

/// Sums of x s^k, k = 0..=6, over a batch of samples of unit total weight, s = -1..1.
#[derive(Debug, Clone, Copy, Default)]
pub struct Batch([f64; 7]);

impl Batch {
    /// Samples of a shortest batch.
    pub const SHORTEST: u64 = SHORTEST;

    /// Adds the sample at a place 0..[`Self::SHORTEST`] of a shortest batch.
    pub fn add(&mut self, x: f64, place: u64) {
        let s = (2 * place + 1) as f64 / SHORTEST as f64 - 1.0;
        let mut term = x / SHORTEST as f64;
        for sum in &mut self.0 {
            *sum += term;
            term *= s;
        }
    }

    /// Joins two neighbouring batches of equal length: s = (s' - 1)/2 in the left one, (s' + 1)/2 in the
    /// right one, where s' is that half's own coordinate.
    pub fn join(left: &Self, right: &Self) -> Self {
        // r + (-1)^j l, the sums that the binomials of (s' +- 1)^k multiply.
        let even: [f64; 7] = from_fn(|j| right.0[j] + left.0[j]);
        let odd: [f64; 7] = from_fn(|j| right.0[j] - left.0[j]);
        let mut scale = 1.0;
        Self(from_fn(|k| {
            scale *= 0.5;
            let sum = |j: usize| {
                if (k - j).is_multiple_of(2) {
                    even[j]
                } else {
                    odd[j]
                }
            };
            scale * (0..=k).map(|j| PASCAL[k][j] * sum(j)).sum::<f64>()
        }))
    }

    /// Plain mean.
    pub fn mean(&self) -> f64 {
        self.0[0]
    }

    /// Mean under the window (1 - s^2)^3, which keeps a vibration of more than some periods out.
    pub fn bell_mean(&self) -> f64 {
        self.means()[2]
    }

    /// Mean under each window, in the order of [`Window`].
    fn means(&self) -> [f64; 3] {
        let [m0, _, m2, _, m4, _, m6] = self.0;
        [
            m0,
            1.5 * (m0 - m2),
            35.0 / 16.0 * (m0 - m6 + 3.0 * (m4 - m2)),
        ]
    }
}

const PASCAL: [[f64; 7]; 7] = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    [1.0, 3.0, 3.0, 1.0, 0.0, 0.0, 0.0],
    [1.0, 4.0, 6.0, 4.0, 1.0, 0.0, 0.0],
    [1.0, 5.0, 10.0, 10.0, 5.0, 1.0, 0.0],
    [1.0, 6.0, 15.0, 20.0, 15.0, 6.0, 1.0],
];

/// Batches of one length.
#[derive(Debug, Clone, Copy, Default)]
struct Level {
    /// A batch that waits for its right neighbour, to make one of the next level.
    waiting: Option<Batch>,
    last: Option<[f64; 3]>,
    differences: u64,
    /// Sums of the squared differences of neighbours under each window.
    squares: [f64; 3],
}

impl Level {
    fn take(&mut self, batch: Batch) -> Option<Batch> {
        let means = batch.means();
        if let Some(last) = self.last.replace(means) {
            self.differences += 1;
            for (sum, (a, b)) in self.squares.iter_mut().zip(means.iter().zip(last)) {
                *sum += (a - b) * (a - b);
            }
        }
        match self.waiting.take() {
            Some(left) => Some(Batch::join(&left, &batch)),
            None => {
                self.waiting = Some(batch);
                None
            }
        }
    }

    /// Variance of the batch means under the window (the Allan variance, for a box).
    fn variance(&self, window: Window) -> f64 {
        self.squares[window as usize] / (2.0 * self.differences as f64)
    }

    /// Of that variance, for white noise (von Neumann): neighbouring differences share a batch.
    fn degrees_of_freedom(&self) -> f64 {
        let n = self.differences as f64;
        2.0 * n * n / (3.0 * n - 1.0)
    }
}

/// Weighted straight line through the logarithms of the density over the logarithm of the batch length.
#[derive(Debug, Default)]
struct Trend {
    weight: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
}

impl Trend {
    fn add(&mut self, x: f64, y: f64, weight: f64) {
        self.weight += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.xx += weight * x * x;
        self.xy += weight * x * y;
    }

    fn at(&self, span: u64) -> LowFrequencyNoise {
        let x = (span.max(1) as f64).log2();
        let (mean_x, mean_y) = (self.x / self.weight, self.y / self.weight);
        let spread = self.xx - self.x * mean_x;
        let (slope, slope_variance) = if spread > 1e-9 * self.xx {
            ((self.xy - self.x * mean_y) / spread, 1.0 / spread)
        } else {
            (0.0, 0.0) // One level shows no trend.
        };
        let per_octave = core::f64::consts::LN_2;
        let exponent = (slope / per_octave).clamp(0.0, 1.0);
        let reach = (x - mean_x).max(0.0);
        let free = exponent > 0.0 && exponent < 1.0;
        let slope_variance = if free { slope_variance } else { 0.0 };
        let variance = 1.0 / self.weight + slope_variance * reach * reach;
        LowFrequencyNoise {
            density: (mean_y + exponent * per_octave * reach).exp(),
            degrees_of_freedom: 2.0 / variance,
            exponent,
        }
    }
}
