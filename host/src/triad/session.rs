//! The virtual bench of a triad, in the time domain: a body that a hand turns and leaves alone, and a shaker.
//!
//! The instruments are evaluated sample by sample by the output model (1); no averaged formula is used, and nothing of the
//! identification.

use std::f64::consts::TAU;

use shared::model::Coefficients;
use shared::triad::attitude::Attitude;
use shared::triad::body::outputs_v;
use shared::tumble::ARCSEC_RAD;

use super::coverage::spiral;
use crate::bench::noise::{Seed, Stream};
use crate::campaign::{
    TriadCampaign, TriadConfig, TriadMeasured, TriadPosition, TriadRun, VibrationKind,
};

/// What is simulated.
#[derive(Clone, Copy, Debug)]
pub struct Session {
    /// Fixes everything that is random.
    pub seed: Seed,
    /// Orientations.
    pub positions: usize,
    /// Error of each setting, arcsec, which is stated; `None` by hand.
    pub attitude_sigma_arcsec: Option<f64>,
    /// Noise of a mean over a rest, g.
    pub noise_g: f64,
}

/// A sample of the record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub time_s: f64,
    /// Outputs of x, y, z, V.
    pub output_v: [f64; 3],
    /// Whether the body is at rest.
    pub at_rest: bool,
}

/// What a session gave.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// The campaign; its positions are means over the rests that the bench knows.
    pub campaign: TriadCampaign,
    /// The continuous record.
    pub record: Vec<Sample>,
    /// The triad that was measured.
    pub triad: [Coefficients<f64>; 3],
}

/// Rate of the record, Hz.
const RATE_HZ: f64 = 100.0;
/// A rest lasts from here to here, s.
const REST_S: (f64, f64) = (4.0, 9.0);
/// A motion lasts from here to here, s.
const MOTION_S: (f64, f64) = (1.0, 4.0);
/// Tremor of the hand while it moves the body, g rms.
const TREMOR_G: f64 = 0.02;
/// Standard deviations of the coefficients: K1 relative, the others in their units.
const SPREAD: [f64; 11] = [
    0.03,
    2e-4,
    6e-4,
    4e-4,
    3e-4,
    5e-5,
    5e-4,
    5e-4,
    CROSS_SIGMA,
    CROSS_SIGMA,
    CROSS_SIGMA,
];
/// Of the cross-couplings, as campaign.toml states it, 1/g.
const CROSS_SIGMA: f64 = 5e-5;
/// The type's scale factor, V/g.
const NOMINAL_V_PER_G: f64 = 1.2;
const GRAVITY_G: f64 = 0.9992;

impl Session {
    /// Simulates the session without shaker runs.
    pub fn at_rest(&self) -> Simulated {
        let triad = self.triad();
        let mut record = Vec::new();
        let positions = self.turn(&triad, &mut record);
        let serial = format!("T{:05}", self.seed.0);
        let config = TriadConfig::new(&serial, NOMINAL_V_PER_G, Some(CROSS_SIGMA), GRAVITY_G);
        Simulated {
            campaign: TriadCampaign {
                config,
                positions,
                runs: Vec::new(),
            },
            record,
            triad,
        }
    }

    /// Simulates the session and the shaker runs after it.
    pub fn simulate(&self) -> Simulated {
        let mut simulated = self.at_rest();
        let shaken = runs()
            .into_iter()
            .map(|run| self.shake(&simulated.triad, run));
        simulated.campaign.runs = shaken.collect();
        simulated
    }

    /// Three instruments; held by hand the frame is theirs: IA of x is x, IA of y lies in the plane of x and y.
    fn triad(&self) -> [Coefficients<f64>; 3] {
        [0, 1, 2].map(|s| {
            let mut stream = self.seed.stream("triad", s);
            let mut c = SPREAD.map(|sigma| sigma * stream.normal());
            c[0] = NOMINAL_V_PER_G * (1.0 + c[0]);
            if self.attitude_sigma_arcsec.is_none() {
                match s {
                    0 => (c[6], c[7]) = (0.0, 0.0),
                    1 => c[6] = 0.0,
                    _ => {}
                }
            }
            Coefficients::from_nominal(c)
        })
    }

    fn turn(&self, triad: &[Coefficients<f64>; 3], record: &mut Vec<Sample>) -> Vec<TriadPosition> {
        let mut hand = self.seed.stream("hand", 0);
        let mut noise = self.seed.stream("noise", 0);
        let mut orientations = spiral(self.positions);
        hand.shuffle(&mut orientations);
        let mut sample = |direction: [f64; 3], at_rest: bool, record: &mut Vec<Sample>| {
            let sigma_g = self.noise_g * (RATE_HZ * REST_S.0).sqrt();
            let exact = outputs_v(triad, direction.map(|u| GRAVITY_G * u));
            let output_v = [0, 1, 2]
                .map(|s| exact[s] + sigma_g * triad[s].scale_factor_v_per_g * noise.normal());
            record.push(Sample {
                time_s: record.len() as f64 / RATE_HZ,
                output_v,
                at_rest,
            });
            output_v
        };
        let mut before: Option<[f64; 3]> = None;
        let mut positions = Vec::new();
        for (order, nominal) in orientations.into_iter().enumerate() {
            let there = self.setting(nominal, &mut hand);
            if let Some(from) = before.replace(there) {
                let steps = (hand.uniform(MOTION_S.0, MOTION_S.1) * RATE_HZ) as usize;
                let mut tremor = Tremor::new(&mut hand);
                for k in 0..steps {
                    let along = (k as f64 + 0.5) / steps as f64;
                    let force = tremor.disturb(turned(from, there, along), along, &mut hand);
                    sample(force, false, record);
                }
            }
            let count = (hand.uniform(REST_S.0, REST_S.1) * RATE_HZ) as usize;
            let mut sum = [0.0; 3];
            for _ in 0..count {
                let output_v = sample(there, true, record);
                (0..3).for_each(|s| sum[s] += output_v[s]);
            }
            positions.push(self.position(order, nominal, sum, count, triad, record.len()));
        }
        positions
    }

    /// The orientation that a setting really gives.
    fn setting(&self, nominal: [f64; 3], hand: &mut Stream) -> [f64; 3] {
        // By hand a setting is off by some degrees and nobody knows.
        let sigma_rad = self.attitude_sigma_arcsec.map_or(0.05, |a| a * ARCSEC_RAD);
        unit(nominal.map(|x| x + sigma_rad * hand.normal()))
    }

    fn position(
        &self,
        order: usize,
        nominal: [f64; 3],
        sum: [f64; 3],
        count: usize,
        triad: &[Coefficients<f64>; 3],
        end: usize,
    ) -> TriadPosition {
        let n = count as f64;
        let sigma_g = self.noise_g * (RATE_HZ * REST_S.0 / n).sqrt();
        TriadPosition {
            order: order as u64 + 1,
            line: 0,
            time_s: Some((end as f64 - n / 2.0) / RATE_HZ),
            output_v: sum.map(|sum| sum / n),
            sigma_v: triad.map(|c| sigma_g * c.scale_factor_v_per_g),
            temp_c: None,
            attitude: self.attitude_sigma_arcsec.map(|a| Attitude {
                direction: nominal,
                sigma_rad: a * ARCSEC_RAD,
            }),
            unknown: Vec::new(),
        }
    }

    /// Shakes the triad: the mean output over whole periods, sample by sample.
    fn shake(&self, triad: &[Coefficients<f64>; 3], run: TriadRun) -> TriadRun {
        const SAMPLES: usize = 40_000;
        let mut stream = self.seed.stream("shaker", run.run);
        let lines: Vec<(f64, f64)> = match run.kind {
            VibrationKind::Sine => vec![(7.0, stream.uniform(0.0, TAU))],
            // Two hundred lines of equal strength and any phase: Gaussian within their number.
            VibrationKind::Random => (0..200)
                .map(|k| (101.0 + 31.0 * f64::from(k), stream.uniform(0.0, TAU)))
                .collect(),
        };
        let amplitude = match run.kind {
            VibrationKind::Sine => run.level_g,
            VibrationKind::Random => run.level_g * (2.0 / lines.len() as f64).sqrt(),
        };
        let mut during = [0.0; 3];
        for k in 0..SAMPLES {
            let t = k as f64 / SAMPLES as f64;
            let wave: f64 = lines
                .iter()
                .map(|(f, phase)| (TAU * f * t + phase).sin())
                .sum();
            let a = [0, 1, 2].map(|i| run.a0_g[i] + amplitude * wave * run.direction[i]);
            let output = outputs_v(triad, a);
            (0..3).for_each(|s| during[s] += output[s] / SAMPLES as f64);
        }
        let still = outputs_v(triad, run.a0_g);
        let sigma_v = triad.map(|c| self.noise_g * c.scale_factor_v_per_g);
        let measured = TriadMeasured {
            before_v: [0, 1, 2].map(|s| still[s] + sigma_v[s] * stream.normal()),
            during_v: [0, 1, 2].map(|s| during[s] + sigma_v[s] * stream.normal()),
            sigma_v,
        };
        TriadRun {
            measured: Some(measured),
            ..run
        }
    }
}

/// Shaker runs along the axes and across: sines and noise.
fn runs() -> Vec<TriadRun> {
    let third = 3f64.sqrt().recip();
    let directions = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [third, third, third],
    ];
    let kinds = [
        (VibrationKind::Sine, 2.0),
        (VibrationKind::Sine, 4.0),
        (VibrationKind::Random, 1.0),
    ];
    let pairs = directions.iter().flat_map(|d| kinds.map(|kind| (*d, kind)));
    let run = |(run, (direction, (kind, level_g)))| TriadRun {
        run: run as u64,
        kind,
        direction,
        level_g,
        a0_g: [0.0, 0.0, GRAVITY_G],
        measured: None,
        unknown: Vec::new(),
    };
    pairs.enumerate().map(run).collect()
}

/// What a hand adds to gravity while it moves a body: acceleration at both ends and a tremor of some hertz.
struct Tremor {
    last: [f64; 3],
    push: [f64; 3],
}

impl Tremor {
    fn new(hand: &mut Stream) -> Self {
        Self {
            last: [0.0; 3],
            push: [0, 1, 2].map(|_| 0.1 * hand.normal()),
        }
    }

    /// The specific force with the hand's part; `along` from 0 to 1 is how far the motion is.
    fn disturb(&mut self, gravity: [f64; 3], along: f64, hand: &mut Stream) -> [f64; 3] {
        let swing = (TAU * along).sin();
        [0, 1, 2].map(|i| {
            self.last[i] = 0.9 * self.last[i] + (1.0f64 - 0.81).sqrt() * hand.normal();
            gravity[i] + swing * self.push[i] + TREMOR_G * self.last[i]
        })
    }
}

/// The direction on the way from one to another, smooth at both ends.
fn turned(from: [f64; 3], to: [f64; 3], along: f64) -> [f64; 3] {
    let cosine: f64 = from.iter().zip(to).map(|(a, b)| a * b).sum();
    let angle = cosine.clamp(-1.0, 1.0).acos();
    let smooth = along * along * (3.0 - 2.0 * along);
    if angle.sin() < 1e-6 {
        return from;
    }
    let (a, b) = (((1.0 - smooth) * angle).sin(), (smooth * angle).sin());
    [0, 1, 2].map(|i| (a * from[i] + b * to[i]) / angle.sin())
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}
