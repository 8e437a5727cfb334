//! The shaker's drive as a record: one period of a sine, or the whole finite record of a random run.
//!
//! Both are periodic records, sums of harmonics of a fundamental: the sine's own frequency, or 1/duration. A
//! linear part of the chain (a fixture, the servo loop, the proof mass) acts on such a record by its frequency
//! response, which is the exact steady state of its differential equation with no error of integration;
//! everything that is not linear acts on the samples.
//!
//! A random record is one realisation of Gaussian noise, flat over its band, that the controller has levelled
//! to the commanded rms value: its own skewness and kurtosis are not a Gaussian's.

use std::collections::HashMap;
use std::sync::Arc;

use realfft::num_complex::Complex64;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

use super::noise::Stream;
use super::plan::Shake;
use crate::campaign::VibrationKind;

/// Samples in the period of a sine. Its kinked functions (clipping) are averaged to some 1e-7 of the level.
const SINE_SAMPLES: usize = 4096;
/// Samples per period of a random band's upper edge, at least.
const OVERSAMPLING: f64 = 8.0;
/// Random records have a multiple of this many samples per second, the logger's own rate, Hz.
const RATE_UNIT_HZ: f64 = 400.0;

/// A periodic waveform in g.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Frequency of its period, Hz.
    pub fundamental_hz: f64,
    /// Samples over one period, g.
    pub samples: Vec<f64>,
}

impl Record {
    /// Samples per second, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.fundamental_hz * self.samples.len() as f64
    }

    /// The `power`th moment about zero.
    pub fn moment(&self, power: i32) -> f64 {
        self.samples.iter().map(|x| x.powi(power)).sum::<f64>() / self.samples.len() as f64
    }

    /// Root of the mean square, g.
    pub fn rms(&self) -> f64 {
        self.moment(2).sqrt()
    }
}

/// Makes records and filters them; keeps the Fourier plans.
#[derive(Default)]
pub struct Shaker {
    planner: RealFftPlanner<f64>,
    forward: HashMap<usize, Arc<dyn RealToComplex<f64>>>,
    inverse: HashMap<usize, Arc<dyn ComplexToReal<f64>>>,
}

impl Shaker {
    /// The drive of a run, `duration_s` long, at a rate that resolves its highest frequency at least eight
    /// times. A sine needs, and takes, no random number.
    pub fn drive(&mut self, shake: &Shake, duration_s: f64, stream: &mut Stream) -> Record {
        match shake.kind {
            VibrationKind::Sine => sine(shake.level_g, shake.f_lo_hz, SINE_SAMPLES),
            VibrationKind::Random => {
                let units = (OVERSAMPLING * shake.f_hi_hz / RATE_UNIT_HZ).ceil();
                let count = (units * RATE_UNIT_HZ * duration_s).round() as usize;
                self.random(shake, duration_s, count, stream)
            }
        }
    }

    /// The drive of a run at a rate of the caller's: `rate_hz` x `duration_s` samples of the whole run.
    pub fn drive_at(
        &mut self,
        shake: &Shake,
        duration_s: f64,
        rate_hz: f64,
        stream: &mut Stream,
    ) -> Record {
        let count = (rate_hz * duration_s).round() as usize;
        match shake.kind {
            VibrationKind::Sine => {
                let step = std::f64::consts::TAU * shake.f_lo_hz / rate_hz;
                let samples = (0..count).map(|n| shake.level_g * (step * n as f64).sin());
                Record {
                    fundamental_hz: 1.0 / duration_s,
                    samples: samples.collect(),
                }
            }
            VibrationKind::Random => self.random(shake, duration_s, count, stream),
        }
    }

    fn random(
        &mut self,
        shake: &Shake,
        duration_s: f64,
        count: usize,
        stream: &mut Stream,
    ) -> Record {
        let mut lines = vec![Complex64::ZERO; count / 2 + 1];
        let first = (shake.f_lo_hz * duration_s).ceil() as usize;
        let last = ((shake.f_hi_hz * duration_s).floor() as usize).min((count - 1) / 2);
        for line in lines.iter_mut().take(last + 1).skip(first.max(1)) {
            *line = Complex64::new(stream.normal(), stream.normal());
        }
        let mut samples = self.synthesise(&mut lines, count);
        let rms = (samples.iter().map(|x| x * x).sum::<f64>() / count as f64).sqrt();
        let gain = shake.level_g / rms;
        samples.iter_mut().for_each(|x| *x *= gain);
        Record {
            fundamental_hz: 1.0 / duration_s,
            samples,
        }
    }

    /// The record behind a linear part with this frequency response (Hz to complex gain).
    pub fn filter(&mut self, record: &Record, response: impl Fn(f64) -> Complex64) -> Record {
        let count = record.samples.len();
        let plan = self.forward.entry(count);
        let plan = plan.or_insert_with(|| self.planner.plan_fft_forward(count));
        let mut lines = plan.make_output_vec();
        plan.process(&mut record.samples.clone(), &mut lines)
            .expect("buffers have the lengths that the plan made");
        let last = lines.len() - 1;
        for (number, line) in lines.iter_mut().enumerate() {
            // Half the sampling rate has no phase of its own; nothing of the drive is there.
            *line *= if number == last && count.is_multiple_of(2) {
                Complex64::ZERO
            } else {
                response(number as f64 * record.fundamental_hz) / count as f64
            };
        }
        // The mean of a real waveform is real; rounding must not say otherwise.
        lines[0].im = 0.0;
        Record {
            fundamental_hz: record.fundamental_hz,
            samples: self.synthesise(&mut lines, count),
        }
    }

    fn synthesise(&mut self, lines: &mut [Complex64], count: usize) -> Vec<f64> {
        let plan = self.inverse.entry(count);
        let plan = plan.or_insert_with(|| self.planner.plan_fft_inverse(count));
        let mut samples = plan.make_output_vec();
        plan.process(lines, &mut samples)
            .expect("buffers have the lengths that the plan made, the mean is real");
        samples
    }
}

fn sine(level_g: f64, frequency_hz: f64, count: usize) -> Record {
    let step = std::f64::consts::TAU / count as f64;
    let samples = (0..count).map(|n| level_g * (step * n as f64).sin());
    Record {
        fundamental_hz: frequency_hz,
        samples: samples.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::noise::Seed;

    fn noise(level_g: f64, f_lo_hz: f64, f_hi_hz: f64) -> Shake {
        Shake {
            kind: VibrationKind::Random,
            direction: [1.0, 0.0, 0.0],
            level_g,
            f_lo_hz,
            f_hi_hz,
            a0: [0.0, 0.0, 1.0],
        }
    }

    #[test]
    fn a_random_record_has_its_level_no_mean_and_nothing_outside_its_band() {
        let mut shaker = Shaker::default();
        let shake = noise(1.5, 400.0, 1400.0);
        let record = shaker.drive(&shake, 8.0, &mut Seed(3).stream("drive", 0));
        assert!((record.rms() - 1.5).abs() < 1e-12);
        assert!(record.moment(1).abs() < 1e-12);
        assert!(record.rate_hz() >= 8.0 * 1400.0);
        let outside = shaker.filter(&record, |f_hz| {
            let inside = (399.9..=1400.1).contains(&f_hz);
            Complex64::new(f64::from(u8::from(!inside)), 0.0)
        });
        assert!(outside.rms() < 1e-12);
    }

    #[test]
    fn random_records_are_gaussian_to_within_their_bandwidth_time_product() {
        // Over many records skewness scatters about 0 and kurtosis about 3; a mean of N records about as
        // 1/sqrt(N) of the scatter.
        let mut shaker = Shaker::default();
        let shake = noise(2.0, 20.0, 200.0);
        let count = 200;
        let (mut skews, mut kurts) = (Vec::new(), Vec::new());
        for index in 0..count {
            let record = shaker.drive(&shake, 8.0, &mut Seed(9).stream("drive", index));
            let sigma = record.rms();
            skews.push(record.moment(3) / sigma.powi(3));
            kurts.push(record.moment(4) / sigma.powi(4));
        }
        for (values, centre) in [(skews, 0.0), (kurts, 3.0)] {
            let mean = values.iter().sum::<f64>() / count as f64;
            let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count as f64;
            // A finite record of 1440 independent pairs: kurtosis is biased by some -6/2880.
            assert!((mean - centre).abs() < 4.0 * (variance / count as f64).sqrt() + 2.1e-3);
            assert!(variance.sqrt() > 0.01, "records differ among themselves");
        }
    }

    #[test]
    fn a_filtered_record_is_the_steady_state_of_the_differential_equation() {
        // x' = 2 pi fc (w - x), integrated by Runge-Kutta from rest until the start is forgotten.
        let (fc_hz, f_hz) = (300.0, 250.0);
        let drive = sine(2.0, f_hz, 4096);
        let lag = |f: f64| Complex64::ONE / Complex64::new(1.0, f / fc_hz);
        let filtered = Shaker::default().filter(&drive, lag);
        let (rate, tau) = (std::f64::consts::TAU * fc_hz, std::f64::consts::TAU);
        let step_s = 1.0 / drive.rate_hz();
        let slope = |t: f64, x: f64| rate * (2.0 * (tau * f_hz * t).sin() - x);
        let (mut x, mut worst) = (0.0_f64, 0.0_f64);
        for n in 0..20 * 4096 {
            let t = n as f64 * step_s;
            if n >= 19 * 4096 {
                worst = worst.max((x - filtered.samples[n % 4096]).abs());
            }
            let k1 = slope(t, x);
            let k2 = slope(t + step_s / 2.0, x + step_s / 2.0 * k1);
            let k3 = slope(t + step_s / 2.0, x + step_s / 2.0 * k2);
            let k4 = slope(t + step_s, x + step_s * k3);
            x += step_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
        assert!(worst < 1e-9, "{worst}");
    }
}
