//! What is measured in a campaign: dial positions, then shaker runs, then runs that are held out.
//!
//! Readings are 90 s apart; the shaker takes over an hour later, its runs 180 s apart and in random order, so
//! that a drift is not mistaken for an effect of level or frequency.

use serde::{Deserialize, Serialize};

use super::noise::Stream;
use crate::campaign::{Approach, Series, VibrationKind};

/// Time between two dial readings, s.
pub const READING_INTERVAL_S: f64 = 90.0;
/// Time between two shaker runs, s.
pub const RUN_INTERVAL_S: f64 = 180.0;
/// Time from the last dial reading to the first shaker run, s.
pub const CHANGEOVER_S: f64 = 3780.0;
/// Length of a vibration and of each plateau, s.
pub const DURATION_S: f64 = 8.0;

/// The static part of a plan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Static {
    /// 80 readings: 40 angles (the paper's 24, and 30 deg, 60 deg ... in series 1 and 2), counter-clockwise
    /// and back clockwise.
    #[default]
    Default,
    /// 48 readings: the paper's 24 angles, there and back. Of rank 10.
    Paper,
    /// 80 readings: the 40 angles once as mounted and once remounted by 180 deg on the dial's shaft.
    Remounted,
}

/// One dwell at a mark of the dial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dwell {
    /// The instrument axis along the dial's shaft.
    pub series: Series,
    /// Nominal dial angle, deg.
    pub dial_deg: f64,
    /// Angle of the instrument on the shaft, deg.
    pub mount_deg: f64,
    /// Sense of approach.
    pub approach: Approach,
}

/// One commanded vibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shake {
    /// Sine or random.
    pub kind: VibrationKind,
    /// Unit vector of the motion on IA, PA, OA.
    pub direction: [f64; 3],
    /// Peak (sine) or rms (random), g.
    pub level_g: f64,
    /// Lower edge of the band, or the sine's frequency, Hz.
    pub f_lo_hz: f64,
    /// Upper edge of the band, or the sine's frequency, Hz.
    pub f_hi_hz: f64,
    /// Gravity on IA, PA, OA during the run, g.
    pub a0: [f64; 3],
}

/// A whole campaign's plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Dial positions in the order they are taken.
    pub dwells: Vec<Dwell>,
    /// Shaker runs in the order they are made.
    pub runs: Vec<Shake>,
    /// Further runs, made after the campaign; their outputs are kept back.
    pub holdout: Vec<Shake>,
}

impl Plan {
    /// The plan that the bench uses: `statics` on the dial, then 96 runs on the shaker in an order drawn
    /// from `order`, then 38 runs to hold out.
    pub fn new(statics: Static, order: &mut Stream) -> Self {
        let mut runs = shaker_runs();
        order.shuffle(&mut runs);
        Self {
            dwells: dwells(statics),
            runs,
            holdout: holdout_runs(),
        }
    }
}

/// The dial positions of a static plan, in the order they are taken.
pub fn dwells(statics: Static) -> Vec<Dwell> {
    let eighths = |series: Series| (0..8).map(move |k| (series, 45.0 * f64::from(k)));
    let twelfths = |series: Series| {
        [30.0, 60.0, 120.0, 150.0, 210.0, 240.0, 300.0, 330.0].map(|degrees| (series, degrees))
    };
    let [first, second, third] = [Series::OutputAxis, Series::PendulousAxis, Series::InputAxis];
    let mut angles: Vec<_> = [first, second, third]
        .into_iter()
        .flat_map(eighths)
        .collect();
    if statics != Static::Paper {
        angles.extend([first, second].into_iter().flat_map(twelfths));
    }
    let there = angles.iter().map(|&(series, dial_deg)| Dwell {
        series,
        dial_deg,
        mount_deg: 0.0,
        approach: Approach::CounterClockwise,
    });
    let back = |dwell: Dwell| Dwell {
        approach: Approach::Clockwise,
        ..dwell
    };
    match statics {
        Static::Default | Static::Paper => {
            let there: Vec<_> = there.collect();
            let back = there.iter().rev().copied().map(back);
            there.iter().copied().chain(back).collect()
        }
        // The same attitudes at the opposite marks.
        Static::Remounted => {
            let remount = |dwell: Dwell| Dwell {
                dial_deg: (dwell.dial_deg + 180.0) % 360.0,
                mount_deg: 180.0,
                ..back(dwell)
            };
            there.clone().chain(there.map(remount)).collect()
        }
    }
}

const ALONG_I: [f64; 3] = [1.0, 0.0, 0.0];
const ALONG_P: [f64; 3] = [0.0, 1.0, 0.0];
const ALONG_O: [f64; 3] = [0.0, 0.0, 1.0];

fn diagonal(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| (a[axis] + b[axis]) * std::f64::consts::FRAC_1_SQRT_2)
}

fn sine(direction: [f64; 3], level_g: f64, f_hz: f64, a0: [f64; 3]) -> Shake {
    let kind = VibrationKind::Sine;
    let (f_lo_hz, f_hi_hz) = (f_hz, f_hz);
    Shake {
        kind,
        direction,
        level_g,
        f_lo_hz,
        f_hi_hz,
        a0,
    }
}

fn random(direction: [f64; 3], level_g: f64, band_hz: (f64, f64), a0: [f64; 3]) -> Shake {
    let kind = VibrationKind::Random;
    let (f_lo_hz, f_hi_hz) = band_hz;
    Shake {
        kind,
        direction,
        level_g,
        f_lo_hz,
        f_hi_hz,
        a0,
    }
}

/// Along IA over level, frequency and attitude; along the other axes and the diagonals over frequency.
fn shaker_runs() -> Vec<Shake> {
    let down = [-1.0, 0.0, 0.0];
    let mut runs = Vec::new();
    for f_hz in [60.0, 480.0] {
        for level_g in [1.0, 4.0, 6.0] {
            runs.push(sine(ALONG_I, level_g, f_hz, ALONG_O));
        }
        for level_g in [0.5, 2.0, 5.0] {
            runs.extend([down, ALONG_O, ALONG_I].map(|a0| sine(ALONG_I, level_g, f_hz, a0)));
        }
    }
    // Two multiples of the logger's rate and one that only comes near.
    runs.extend([400.0, 1000.0, 1333.0].map(|f_hz| sine(ALONG_I, 2.0, f_hz, ALONG_O)));
    let sweep_hz = [25.0, 60.0, 120.0, 240.0, 480.0, 800.0, 1250.0];
    runs.extend(sweep_hz.map(|f_hz| sine(ALONG_I, 3.0, f_hz, ALONG_O)));
    let bands_hz = [(20.0, 200.0), (20.0, 1000.0), (400.0, 1400.0)];
    runs.extend(bands_hz.map(|band_hz| random(ALONG_I, 1.5, band_hz, ALONG_O)));
    for level_g in [0.5, 1.0, 2.5] {
        let a0s = [down, ALONG_O, ALONG_I];
        runs.extend(a0s.map(|a0| random(ALONG_I, level_g, (20.0, 1000.0), a0)));
    }
    let across = [
        (ALONG_P, ALONG_O),
        (ALONG_O, ALONG_P),
        (diagonal(ALONG_I, ALONG_P), ALONG_O),
        (diagonal(ALONG_I, ALONG_O), ALONG_P),
        (diagonal(ALONG_P, ALONG_O), ALONG_I),
    ];
    for (direction, a0) in across {
        runs.extend(sweep_hz.map(|f_hz| sine(direction, 3.0, f_hz, a0)));
        runs.extend(bands_hz.map(|band_hz| random(direction, 1.5, band_hz, a0)));
    }
    runs
}

/// Conditions between those of [`shaker_runs`]: other frequencies, levels, directions, attitudes and bands.
fn holdout_runs() -> Vec<Shake> {
    let (cos, sin) = (0.4_f64.cos(), 0.4_f64.sin());
    let third = (1.0_f64 / 3.0).sqrt();
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let mut runs = Vec::new();
    let directions = [
        (ALONG_I, ALONG_O),
        ([cos, sin, 0.0], ALONG_O),
        ([cos, 0.0, sin], ALONG_P),
        ([third; 3], [half, -half, 0.0]),
    ];
    for (direction, a0) in directions {
        let sweep_hz = [40.0, 90.0, 180.0, 350.0, 650.0, 1050.0];
        runs.extend(sweep_hz.map(|f_hz| sine(direction, 2.5, f_hz, a0)));
    }
    let inclined = [0.5, 0.0, 0.75_f64.sqrt()];
    for level_g in [1.5, 4.5] {
        let a0s = [ALONG_O, inclined, [-1.0, 0.0, 0.0]];
        runs.extend(a0s.map(|a0| sine(ALONG_I, level_g, 200.0, a0)));
    }
    for direction in [ALONG_I, [cos, sin, 0.0]] {
        for (level_g, band_hz) in [(1.0, (20.0, 2000.0)), (2.0, (20.0, 600.0))] {
            runs.extend([ALONG_O, ALONG_I].map(|a0| random(direction, level_g, band_hz, a0)));
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::noise::Seed;

    #[test]
    fn the_default_plan_has_80_readings_96_runs_and_38_held_out() {
        let plan = Plan::new(Static::Default, &mut Seed(1).stream("plan", 0));
        assert_eq!(
            (plan.dwells.len(), plan.runs.len(), plan.holdout.len()),
            (80, 96, 38)
        );
        assert_eq!(dwells(Static::Remounted).len(), 80);
        assert_eq!(dwells(Static::Paper).len(), 48);
    }

    #[test]
    fn directions_and_gravity_are_unit_vectors() {
        let plan = Plan::new(Static::Default, &mut Seed(1).stream("plan", 0));
        for run in plan.runs.iter().chain(&plan.holdout) {
            for vector in [run.direction, run.a0] {
                let length = vector.iter().map(|x| x * x).sum::<f64>();
                assert!((length - 1.0).abs() < 1e-12, "{run:?}");
            }
        }
    }

    #[test]
    fn remounting_repeats_every_attitude_at_the_opposite_mark() {
        let dwells = dwells(Static::Remounted);
        for (first, second) in dwells[..40].iter().zip(&dwells[40..]) {
            let angle = |dwell: &Dwell| (dwell.dial_deg + dwell.mount_deg) % 360.0;
            assert_eq!((first.series, angle(first)), (second.series, angle(second)));
            assert_eq!((first.dial_deg - second.dial_deg).abs(), 180.0);
        }
    }
}
