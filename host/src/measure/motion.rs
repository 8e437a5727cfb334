//! What kind of motion a stretch of samples holds: a sine with its harmonics, or a random band.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use realfft::RealFftPlanner;
use serde::Serialize;

use super::spread::Spread;

/// Highest harmonic that is fitted.
const HARMONICS: usize = 5;

/// Share of the variance from which on a line and its harmonics are the motion. Chosen: a line in random vibration has less.
const SINE: f64 = 0.8;

/// Fewest samples that are analysed.
const FEWEST: usize = 64;

/// A motion, of one column.
#[derive(Clone, Debug, Serialize)]
pub struct Motion {
    /// `sine` or `random`.
    pub kind: Kind,
    /// Standard deviation, g.
    pub rms_g: f64,
    /// Third standardised moment.
    pub skewness: f64,
    /// Fourth standardised moment: 1.5 of a sine, 3 of Gaussian noise.
    pub kurtosis: f64,
    /// Frequency of a sine, Hz; in cycles a sample if the record has no time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Amplitudes of the sine and its harmonics up to the fifth, g.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub amplitudes_g: Vec<f64>,
    /// Band that holds 95 % of the variance of a random vibration, Hz.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_hz: Option<[f64; 2]>,
    /// Greatest modulus of the output between the samples, g: interpolated to a quarter of their distance.
    #[serde(skip)]
    pub peak_g: f64,
    /// Cycles a sample of the strongest line, and its share of the variance.
    #[serde(skip)]
    pub line: (f64, f64),
}

/// Kinds of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// One line and its harmonics.
    Sine,
    /// Anything else.
    Random,
}

impl Motion {
    /// Of samples in g at an even rate; `None` of too few, or of samples without scatter.
    pub fn of(samples: &[f64], rate_hz: Option<f64>) -> Option<Self> {
        let spread: Spread = samples.iter().copied().collect();
        let rms = spread.standard_deviation();
        if samples.len() < FEWEST || rms <= 0.0 {
            return None;
        }
        let n = samples.len() as f64;
        let moment = |power: i32| {
            let terms = samples
                .iter()
                .map(|x| ((x - spread.mean) / rms).powi(power));
            terms.sum::<f64>() / n
        };
        let power = spectrum(samples, spread.mean);
        let cycles = frequency(samples, spread.mean, &power);
        let amplitudes = harmonics(samples, cycles);
        let share = amplitudes.iter().map(|a| 0.5 * a * a).sum::<f64>() / (rms * rms);
        let sine = share > SINE;
        let rate = rate_hz.unwrap_or(1.0);
        Some(Self {
            kind: if sine { Kind::Sine } else { Kind::Random },
            rms_g: rms,
            skewness: moment(3),
            kurtosis: moment(4),
            frequency_hz: sine.then_some(cycles * rate),
            band_hz: (!sine).then(|| band(&power).map(|cycles: f64| cycles * rate)),
            line: (cycles, (0.5 * amplitudes[0].powi(2) / (rms * rms)).min(1.0)),
            amplitudes_g: if sine { amplitudes } else { Vec::new() },
            peak_g: peak(samples),
        })
    }
}

/// Power in each of the frequencies k/n, k = 0..n/2, n being the number of samples, under Hann's window.
fn spectrum(samples: &[f64], mean: f64) -> Vec<f64> {
    let n = samples.len();
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(n);
    let window = |k: usize| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / n as f64).cos();
    let mut input: Vec<f64> = samples
        .iter()
        .enumerate()
        .map(|(k, x)| window(k) * (x - mean))
        .collect();
    let mut output = transform.make_output_vec();
    // The lengths are the plan's own.
    let _ = transform.process(&mut input, &mut output);
    output.iter().map(|c| c.norm_sqr()).collect()
}

/// Frequency of the strongest line, cycles a sample: the maximum of the projection within a bin about the spectrum's.
fn frequency(samples: &[f64], mean: f64, power: &[f64]) -> f64 {
    let n = samples.len() as f64;
    let strongest = (1..power.len()).max_by(|&a, &b| power[a].total_cmp(&power[b]));
    let centre = strongest.unwrap_or(1) as f64;
    let projection = |bin: f64| {
        let (sine, cosine) = (TAU * bin / n).sin_cos();
        let (mut re, mut im, mut x, mut y) = (0.0, 0.0, 1.0, 0.0);
        for sample in samples {
            re += (sample - mean) * x;
            im += (sample - mean) * y;
            (x, y) = (x * cosine - y * sine, x * sine + y * cosine);
        }
        re * re + im * im
    };
    let (mut low, mut high) = ((centre - 1.0).max(0.25), centre + 1.0);
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let mut inner = [high - golden * (high - low), low + golden * (high - low)];
    let mut values = inner.map(projection);
    for _ in 0..30 {
        if values[0] > values[1] {
            high = inner[1];
            inner = [high - golden * (high - low), inner[0]];
            values = [projection(inner[0]), values[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + golden * (high - low)];
            values = [values[1], projection(inner[1])];
        }
    }
    0.5 * (low + high) / n
}

/// Amplitudes of the harmonics by least squares, with a mean; none above half the rate.
fn harmonics(samples: &[f64], cycles: f64) -> Vec<f64> {
    let count = (1..=HARMONICS)
        .take_while(|&k| k as f64 * cycles < 0.5)
        .count()
        .max(1);
    let size = 2 * count + 1;
    let mut normal = DMatrix::<f64>::zeros(size, size);
    let mut right = DVector::<f64>::zeros(size);
    let mut row = vec![1.0; size];
    for (k, sample) in samples.iter().enumerate() {
        for harmonic in 1..=count {
            let phase = TAU * (harmonic as f64 * cycles * k as f64).fract();
            (row[2 * harmonic], row[2 * harmonic - 1]) = phase.sin_cos();
        }
        for a in 0..size {
            right[a] += row[a] * sample;
            for b in 0..=a {
                normal[(a, b)] += row[a] * row[b];
            }
        }
    }
    normal.fill_upper_triangle_with_lower_triangle();
    let Some(factor) = normal.cholesky() else {
        return vec![0.0; count];
    };
    let found = factor.solve(&right);
    (1..=count)
        .map(|k| found[2 * k - 1].hypot(found[2 * k]))
        .collect()
}

/// Frequencies, in cycles a sample, below and above which there is 2.5 % of the variance.
fn band(power: &[f64]) -> [f64; 2] {
    let total: f64 = power[1..].iter().sum();
    let bins = 2.0 * (power.len() - 1) as f64;
    [0.025, 0.975].map(|share| {
        let mut sum = 0.0;
        let place = power[1..].iter().position(|p| {
            sum += p;
            sum >= share * total
        });
        place.map_or(0.5, |place| (place + 1) as f64 / bins)
    })
}

/// The greatest modulus of the interpolated samples, away from the ends where interpolation rings.
fn peak(samples: &[f64]) -> f64 {
    const FACTOR: usize = 4;
    let n = samples.len() - samples.len() % 2;
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (
        planner.plan_fft_forward(n),
        planner.plan_fft_inverse(FACTOR * n),
    );
    let mean = samples[..n].iter().sum::<f64>() / n as f64;
    let mut input: Vec<f64> = samples[..n].iter().map(|x| x - mean).collect();
    let mut half = forward.make_output_vec();
    let _ = forward.process(&mut input, &mut half);
    let mut padded = inverse.make_input_vec();
    padded[..half.len() - 1].copy_from_slice(&half[..half.len() - 1]);
    let mut output = inverse.make_output_vec();
    let _ = inverse.process(&mut padded, &mut output);
    let margin = output.len() / 16;
    let inside = output[margin..output.len() - margin].iter();
    inside
        .map(|x| (x / n as f64 + mean).abs())
        .fold(0.0, f64::max)
}
