//! How the instrument moves in a run, and time means over that motion.

use shared::model::{NOMINAL, SpecificForce};
use shared::rectification::Sensitivity;
use shared::vibration::{AbsoluteMean, Harmonic, Moments};

use crate::campaign::{Run, VibrationKind};
use crate::finite_record::{ORDERS, correlation_integrals};

/// Phases at which half a period of a sine is sampled; a kink's mean is then good to some 1e-4.
const PHASES: usize = 512;
/// Gaussian abscissas: from -REACH to REACH standard deviations.
const REACH: f64 = 7.0;
const STEPS: usize = 280;

/// Motion of the instrument in one run, along one line in the three axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Signed peak (sine) or rms (random) on IA, PA, OA, g.
    pub amplitude_g: [f64; 3],
    /// Second harmonic relative to a sine's amplitude, in the phase that lifts the positive peak.
    pub second_harmonic: f64,
    /// Third and fourth standardized moments of a random record along the line.
    pub shape: [f64; 2],
    /// Relative variance of the mean square, from a spectrum that nobody measured.
    pub power_variance: f64,
}

impl Motion {
    /// The commanded motion, a random record's shape as the reference saw it.
    pub fn commanded(run: &Run) -> Self {
        let axis = main_axis(&run.direction);
        let shape = match (&run.reference, run.kind) {
            (Some(seen), VibrationKind::Random) if seen.kurtosis[axis] > 0.0 => [
                seen.skewness[axis] * run.direction[axis].signum(),
                seen.kurtosis[axis],
            ],
            _ => [0.0, 3.0],
        };
        Self {
            amplitude_g: run.direction.map(|n| n * run.level_g),
            second_harmonic: 0.0,
            shape,
            power_variance: 0.0,
        }
    }

    /// The same motion `factor` times as large.
    pub fn scale(&mut self, factor: f64) {
        self.amplitude_g = self.amplitude_g.map(|w| w * factor);
    }

    /// Extreme multiples of the amplitude of a sine with its second harmonic: least and greatest.
    pub fn extremes(&self) -> [f64; 2] {
        [-1.0 + self.second_harmonic, 1.0 + self.second_harmonic]
    }

    /// Derivatives of the vibration error by the nominal coefficients.
    pub fn sensitivity(&self, run: &Run) -> [f64; NOMINAL] {
        let [i, p, o] = self.amplitude_g;
        let moments: Moments<f64> = match run.kind {
            VibrationKind::Sine if self.second_harmonic == 0.0 => Harmonic {
                amplitude_g: SpecificForce::new(i, p, o),
            }
            .into(),
            VibrationKind::Sine => self.distorted(run.specific_force_g.i),
            VibrationKind::Random => {
                let line = |x: f64, y: f64| if x * y == 0.0 { 0.0 } else { (x * y).signum() };
                Moments::near_gaussian(
                    SpecificForce::new(i.abs(), p.abs(), o.abs()),
                    [line(i, p), line(i, o), line(p, o)],
                    self.shape[0] * i.signum(),
                    self.shape[1],
                )
            }
        };
        Sensitivity::new(run.specific_force_g.i, moments).nominal
    }

    /// Moments of a sine with its second harmonic, from its phases.
    fn distorted(&self, a0: f64) -> Moments<f64> {
        let [i, p, o] = self.amplitude_g;
        let mut sums = [0.0; 4];
        for k in 0..PHASES {
            let w = self.sine_at(k);
            let square = w * w;
            sums[0] += square;
            sums[1] += square * w;
            sums[2] += square * square;
            sums[3] += (a0 + i * w).abs();
        }
        let [m2, m3, m4, absolute] = sums.map(|sum| sum / PHASES as f64);
        Moments {
            m2_g2: m2 * i * i,
            m3_g3: m3 * i * i * i,
            m4_g4: m4 * i * i * i * i,
            m5_g5: 0.0,
            cross_ip_g2: m2 * i * p,
            cross_io_g2: m2 * i * o,
            cross_po_g2: m2 * p * o,
            absolute: AbsoluteMean::Measured(absolute),
        }
    }

    /// Multiple of the amplitude at phase number k of half a period, which passes every value of the whole.
    fn sine_at(&self, k: usize) -> f64 {
        let x = ((k as f64 + 0.5) / PHASES as f64 - 0.5) * std::f64::consts::PI;
        let sine = x.sin();
        sine - self.second_harmonic * (1.0 - 2.0 * sine * sine)
    }
}

/// The axis with the largest component, the first of equals.
pub fn main_axis(direction: &[f64; 3]) -> usize {
    let largest = direction.iter().fold(0.0_f64, |most, n| most.max(n.abs()));
    let found = direction.iter().position(|n| n.abs() > largest - 1e-6);
    found.unwrap_or(0)
}

/// Tables for time means, made once for all runs of a campaign.
#[derive(Debug)]
pub struct Averages {
    sines: Vec<f64>,
    /// Gaussian abscissas with their weights, and the weights times He_n, orthonormal, for n = 3 ..= ORDERS.
    normals: Vec<[f64; 2]>,
    hermites: Vec<[f64; ORDERS + 1]>,
    integrals: Vec<([f64; 2], [f64; ORDERS + 1])>,
}

/// The time mean of a function of the specific force over one run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeMean {
    /// Its expectation, given what the reference saw.
    pub value: f64,
    /// Its variance over records that the reference cannot tell apart.
    pub variance: f64,
}

impl Averages {
    /// Tables for these runs.
    pub fn new<'r>(runs: impl Iterator<Item = &'r Run>) -> Self {
        let still = Motion {
            amplitude_g: [0.0; 3],
            second_harmonic: 0.0,
            shape: [0.0, 3.0],
            power_variance: 0.0,
        };
        let step = 2.0 * REACH / STEPS as f64;
        let density = step / std::f64::consts::TAU.sqrt();
        let mut normals = Vec::with_capacity(STEPS + 1);
        let mut hermites = Vec::with_capacity(STEPS + 1);
        for k in 0..=STEPS {
            let x = (k as f64 - 0.5 * STEPS as f64) * step;
            let weight = density * (-0.5 * x * x).exp();
            normals.push([x, weight]);
            // Orthonormal: h_n = (x h_(n-1) - sqrt(n-1) h_(n-2)) / sqrt n.
            let mut h = [1.0; ORDERS + 1];
            h[1] = x;
            for n in 2..=ORDERS {
                h[n] = (x * h[n - 1] - ((n - 1) as f64).sqrt() * h[n - 2]) / (n as f64).sqrt();
            }
            hermites.push(h.map(|h| h * weight));
        }
        let mut integrals: Vec<([f64; 2], _)> = Vec::new();
        for run in runs.filter(|run| run.kind == VibrationKind::Random) {
            if !integrals.iter().any(|(band, _)| *band == run.band_hz) {
                integrals.push((run.band_hz, correlation_integrals(run.band_hz)));
            }
        }
        Self {
            sines: (0..PHASES).map(|k| still.sine_at(k)).collect(),
            normals,
            hermites,
            integrals,
        }
    }

    /// The time mean of `function` over a run with this motion.
    pub fn mean(&self, run: &Run, motion: &Motion, function: impl Fn([f64; 3]) -> f64) -> TimeMean {
        let a0 = run.specific_force_g;
        let [i, p, o] = motion.amplitude_g;
        let at = |w: f64| function([a0.i + i * w, a0.p + p * w, a0.o + o * w]);
        if run.kind == VibrationKind::Sine {
            let sum: f64 = self.sines.iter().map(|&w| at(w)).sum();
            return TimeMean {
                value: sum / self.sines.len() as f64,
                variance: 0.0,
            };
        }
        let (mut mean, mut square) = (0.0, 0.0);
        let mut c = [0.0; ORDERS + 1];
        for (&[x, weight], h) in self.normals.iter().zip(&self.hermites) {
            let f = at(x);
            mean += weight * f;
            square += weight * f * f;
            for (c, h) in c.iter_mut().zip(h) {
                *c += f * h;
            }
        }
        // M[He_3] is the skewness, M[He_4] the kurtosis less 3 (the mean square is exact).
        let [skew, kurt] = motion.shape;
        let value = mean + c[3] * skew / 6f64.sqrt() + c[4] * (kurt - 3.0) / 24f64.sqrt();
        let seen = if run.reference.is_some() { 4 } else { 2 };
        let integrals = self.integrals.iter().find(|(band, _)| *band == run.band_hz);
        let mut variance = 0.0;
        if let Some((_, integrals)) = integrals {
            let mut left = square - c[..=seen].iter().map(|c| c * c).sum::<f64>();
            for n in seen + 1..=ORDERS {
                variance += c[n] * c[n] * integrals[n] / run.duration_s;
                left -= c[n] * c[n];
            }
            variance += left.max(0.0) * integrals[ORDERS] / run.duration_s;
        }
        TimeMean { value, variance }
    }
}

/// Mean and relative-power variance over a run's band of a frequency response's squared magnitude. For a sine
/// the value at its frequency, with no variance; for a flat band the mean, and the variance of the mean over
/// records of that length whose total power is known: var_f(response) / (bandwidth x time).
pub fn band_mean(run: &Run, response: impl Fn(f64) -> f64) -> TimeMean {
    let [low, high] = run.band_hz;
    if run.kind == VibrationKind::Sine || high <= low {
        return TimeMean {
            value: response(low),
            variance: 0.0,
        };
    }
    const POINTS: usize = 256;
    // Equal steps of the logarithm, each weighted by its width: low edges need the finer steps.
    let low = low.max(1e-3 * high);
    let ratio = (high / low).ln() / POINTS as f64;
    let (mut mean, mut square) = (0.0, 0.0);
    for k in 0..POINTS {
        let f = low * ((k as f64 + 0.5) * ratio).exp();
        let weight = f * ratio / (high - low);
        let value = response(f);
        mean += weight * value;
        square += weight * value * value;
    }
    TimeMean {
        value: mean,
        variance: (square - mean * mean).max(0.0) / ((high - low) * run.duration_s),
    }
}
