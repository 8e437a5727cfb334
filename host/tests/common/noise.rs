//! Records of white, flicker, walk and warm-up noise with a vibration in them, and whether the measured interval holds.

use std::f64::consts::{LN_2, TAU};
use std::fmt::Write as _;

use host::measure::{Calibration, Columns, Request, Selection, Verdict, measure};
use rand::SeedableRng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};

/// Sample rate, Hz.
const RATE_HZ: f64 = 50.0;

/// White noise of 0.1 mg/sqrt(Hz), as of a consumer MEMS accelerometer (ADXL355, ICM-42688 and the like: 0.025 to 0.1), g.
const WHITE_G: f64 = 5e-4;

/// Kinds of noise. All but the first have [`WHITE_G`] as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    White,
    /// Bias instability of 20 ug and of 60 ug.
    Flicker20,
    Flicker60,
    /// 7 ug/sqrt(s), and 35 ug/sqrt(s).
    Walk,
    FastWalk,
    /// 2 mg that go with 100 s.
    WarmUp,
    /// White, in steps of 1 mg.
    Quantised,
}

impl Noise {
    pub const ALL: [Self; 7] = [
        Self::White,
        Self::Flicker20,
        Self::Flicker60,
        Self::Walk,
        Self::FastWalk,
        Self::WarmUp,
        Self::Quantised,
    ];
}

/// Where the windows lie, s: the vibration begins with the second.
#[derive(Clone, Copy, Debug)]
pub struct Geometry {
    pub before_s: f64,
    pub gap_s: f64,
    pub during_s: f64,
    /// Whether the record holds the gap.
    pub whole: bool,
}

impl Geometry {
    pub const SHORT: Self = Self {
        before_s: 20.0,
        gap_s: 10.0,
        during_s: 20.0,
        whole: true,
    };
    pub const APART: Self = Self {
        before_s: 20.0,
        gap_s: 200.0,
        during_s: 20.0,
        whole: true,
    };
}

/// What came of one record.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    /// Whether the interval is stated as one: not `cannot-tell`.
    pub told: bool,
    pub holds: bool,
    /// Half of it over that of white noise of known density.
    pub half_over_white: f64,
}

/// The shift that the vibration makes, g.
const SHIFT_G: f64 = 1e-3;

impl Geometry {
    /// Measures one record.
    pub fn interval(self, noise: Noise, seed: u64) -> Interval {
        let from_s = self.before_s + self.gap_s;
        let mut source = Source::new(noise, seed);
        let mut table = String::from("t_s,u_g\n");
        let count = ((from_s + self.during_s) * RATE_HZ) as usize;
        for n in 0..count {
            let t = n as f64 / RATE_HZ;
            let shaken = SHIFT_G + 0.5 * (TAU * 11.3 * t).sin();
            let output = source.next() + if t >= from_s { shaken } else { 0.0 };
            let output = match noise {
                Noise::Quantised => (output / 1e-3).round() * 1e-3,
                _ => output,
            };
            if self.whole || t < self.before_s || t >= from_s {
                let _ = writeln!(table, "{t:.3},{output:.9}");
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("record.csv");
        std::fs::write(&file, table).unwrap();
        let before = format!("0..{}", self.before_s);
        let during = format!("{from_s}..{}", from_s + self.during_s);
        let request = Request {
            columns: Columns {
                outputs: vec!["u_g".into()],
                time: Some(("t_s".into(), 1.0)),
                temperature: None,
            },
            selection: Some(Selection::parse(None, &before, &during, None).unwrap()),
            run: None,
            calibration: Calibration {
                units_per_g: 1.0,
                full_scale_g: None,
                temperature_sensitivity_g_per_c: None,
            },
        };
        let found = measure(&file, &request).unwrap();
        let [low, high] = found.axes[0].interval_95_g;
        // White noise under the line fit has 6/5 of the variance of a plain mean.
        let variance = WHITE_G * WHITE_G / RATE_HZ * (1.0 / self.before_s + 1.2 / self.during_s);
        Interval {
            told: found.verdict != Verdict::CannotTell,
            holds: (low..high).contains(&SHIFT_G),
            half_over_white: 0.5 * (high - low) / (1.96 * variance.sqrt()),
        }
    }
}

/// Noise, sample by sample. Flicker is a sum of relaxations whose times are an octave apart.
struct Source {
    noise: Noise,
    rng: StdRng,
    relaxations: Vec<f64>,
    walk: f64,
    at: f64,
}

impl Source {
    fn new(noise: Noise, seed: u64) -> Self {
        let mut rng = StdRng::seed_from_u64(seed);
        let relaxations = (0..24).map(|_| StandardNormal.sample(&mut rng)).collect();
        Self {
            noise,
            rng,
            relaxations,
            walk: 0.0,
            at: 0.0,
        }
    }

    fn next(&mut self) -> f64 {
        let rng = &mut self.rng;
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let white = WHITE_G * normal();
        let flicker_g = match self.noise {
            Noise::Flicker20 => 20e-6,
            Noise::Flicker60 => 60e-6,
            _ => 0.0,
        };
        let step_g = match self.noise {
            Noise::Walk => 1e-6,
            Noise::FastWalk => 5e-6,
            _ => 0.0,
        };
        let mut flicker = 0.0;
        for (octave, relaxation) in self.relaxations.iter_mut().enumerate() {
            let keeps = (-1.0 / (0.5 * 2f64.powi(octave as i32))).exp();
            *relaxation = keeps * *relaxation + (1.0 - keeps * keeps).sqrt() * normal();
            flicker += *relaxation;
        }
        self.walk += step_g * normal();
        let warm = match self.noise {
            Noise::WarmUp => 2e-3 * (-self.at / 100.0).exp(),
            _ => 0.0,
        };
        self.at += 1.0 / RATE_HZ;
        white + flicker_g * LN_2.sqrt() * flicker + self.walk + warm
    }
}
