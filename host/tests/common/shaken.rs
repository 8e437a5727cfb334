//! A record in the time domain: a shaker with harmonics of its own ramps a sine up and down, an instrument with coefficients and
//! a loop of second order follows, and a reference beside it sees the motion with noise and distortion.

use std::f64::consts::TAU;

use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};

/// Sample rate, Hz.
pub const RATE_HZ: f64 = 2000.0;

/// Steps of the loop in a sample.
const STEPS: usize = 8;

/// Drive, Hz.
const DRIVE_HZ: f64 = 80.0;

/// Rest before and after, ramp on either side, and plateau, s.
const REST_S: f64 = 6.0;
const RAMP_S: f64 = 2.0;
const PLATEAU_S: f64 = 10.0;

/// Amplitude of the plateau, g.
const LEVEL_G: f64 = 5.0;

/// What is recorded.
#[derive(Clone, Copy, Debug)]
pub struct Bench {
    /// k2, k3, k4.
    pub coefficients: [f64; 3],
    /// Gravity on IA, g.
    pub a0_g: f64,
    /// Shares of the second and third harmonic of the shaker at the plateau; half of each grows with the amplitude.
    pub shaker: [f64; 2],
    /// Share of the second harmonic that the reference makes of the amplitude of the plateau, and its change of gain there.
    pub reference: [f64; 2],
    /// Noise of a sample of output and reference, g.
    pub noise_g: [f64; 2],
    /// Random walk of the output's bias, g/sqrt(s).
    pub walk_g: f64,
    /// Natural frequency of the loop, Hz; its damping is 0.7.
    pub loop_hz: f64,
}

pub const BENCH: Bench = Bench {
    coefficients: [0.0; 3],
    a0_g: 1.0,
    shaker: [0.002, 0.002],
    reference: [0.0; 2],
    noise_g: [1e-3, 1e-3],
    walk_g: 5e-6,
    loop_hz: 900.0,
};

pub fn normal(rng: &mut StdRng) -> f64 {
    StandardNormal.sample(rng)
}

/// Amplitude at a time, g.
fn amplitude(t: f64) -> f64 {
    let up = (t - REST_S) / RAMP_S;
    let down = (REST_S + 2.0 * RAMP_S + PLATEAU_S - t) / RAMP_S;
    LEVEL_G * up.min(down).clamp(0.0, 1.0)
}

impl Bench {
    fn motion(&self, t: f64) -> f64 {
        let (a, x) = (amplitude(t), TAU * DRIVE_HZ * t);
        let grown = 0.5 + 0.5 * a / LEVEL_G;
        let [second, third] = self.shaker;
        a * (x.sin() + grown * (second * (2.0 * x + 0.8).sin() + third * (3.0 * x - 1.1).sin()))
    }

    /// Samples of output and reference, g.
    pub fn record(&self, rng: &mut StdRng) -> Vec<[f64; 2]> {
        let [k2, k3, k4] = self.coefficients;
        let count = ((2.0 * (REST_S + RAMP_S) + PLATEAU_S) * RATE_HZ) as usize;
        let step = 1.0 / (RATE_HZ * STEPS as f64);
        // y'' = w^2 (u - y) - 1.4 w y', by the trapezoidal rule.
        let w = TAU * self.loop_hz;
        let gain = 0.5 * step;
        let denominator = 1.0 + gain * (1.4 * w) + gain * gain * w * w;
        let at_rest = |a: f64| a + k2 * a * a + k3 * a.powi(3) + k4 * a.powi(4);
        let (mut y, mut v) = (at_rest(self.a0_g), 0.0);
        let (mut bias, mut before) = (0.0, y);
        let mut samples = Vec::with_capacity(count);
        for n in 0..count {
            let r = self.motion(n as f64 / RATE_HZ);
            let [q2, q3] = self.reference;
            let seen =
                r + 2.0 * q2 * r * r / LEVEL_G + 4.0 / 3.0 * q3 * r.powi(3) / LEVEL_G.powi(2);
            samples.push([
                y + bias + self.noise_g[0] * normal(rng),
                seen + self.noise_g[1] * normal(rng),
            ]);
            bias += self.walk_g / RATE_HZ.sqrt() * normal(rng);
            for s in 1..=STEPS {
                let t = (n as f64 + s as f64 / STEPS as f64) / RATE_HZ;
                let u = at_rest(self.a0_g + self.motion(t));
                let pull = w * w * (u + before - 2.0 * y - gain * v) - 1.4 * w * v;
                let next = (v + gain * pull) / denominator;
                y += gain * (v + next);
                (v, before) = (next, u);
            }
        }
        samples
    }
}
