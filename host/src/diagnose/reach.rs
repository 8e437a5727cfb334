//! How far a bench can go: the instrument's full scale, and what its shaker has shown.

use std::f64::consts::TAU;

use crate::campaign::{Run, VibrationKind};

/// Levels of a proposal are whole steps of this, g.
const STEP_G: f64 = 0.1;
/// Least level of a proposal, g.
const LEAST_G: f64 = 0.5;
/// Part of the full scale that a proposal uses at most.
const OF_FULL_SCALE: f64 = 0.9;

/// Greatest amplitudes of the table's motion in the runs that were made: a shaker is limited in displacement at low, in velocity at
/// middle, in force (so in acceleration) at high frequencies.
pub(super) struct Reach {
    full_scale_g: f64,
    acceleration_g: f64,
    /// Acceleration over angular frequency, g s.
    velocity_g_s: f64,
    /// Acceleration over its square, g s^2.
    displacement_g_s2: f64,
    /// Frequencies at which it shook, Hz.
    band_hz: [f64; 2],
}

impl Reach {
    pub(super) fn of(full_scale_g: f64, made: &[&Run]) -> Self {
        let mut reach = Self {
            full_scale_g,
            acceleration_g: 0.0,
            velocity_g_s: 0.0,
            displacement_g_s2: 0.0,
            band_hz: [f64::INFINITY, 0.0],
        };
        for run in made.iter().filter(|run| run.level_g > 0.0) {
            let [low_hz, high_hz] = run.band_hz;
            reach.band_hz[0] = reach.band_hz[0].min(low_hz);
            reach.band_hz[1] = reach.band_hz[1].max(high_hz);
            reach.acceleration_g = reach.acceleration_g.max(run.level_g);
            if run.kind == VibrationKind::Sine {
                let w = TAU * low_hz;
                reach.velocity_g_s = reach.velocity_g_s.max(run.level_g / w);
                reach.displacement_g_s2 = reach.displacement_g_s2.max(run.level_g / (w * w));
            } else {
                // Of a flat band of rms A: v^2 = A^2 / (w1 w2), x^2 = A^2 (w1^2 + w1 w2 + w2^2) / 3 (w1 w2)^3.
                let [w1, w2] = [TAU * low_hz, TAU * high_hz];
                let product = w1 * w2;
                let displacement = (w1 * w1 + product + w2 * w2) / (3.0 * product.powi(3));
                reach.velocity_g_s = reach.velocity_g_s.max(run.level_g / product.sqrt());
                reach.displacement_g_s2 = reach
                    .displacement_g_s2
                    .max(run.level_g * displacement.sqrt());
            }
        }
        reach
    }

    /// Amplitude of the strongest sine, g, at a frequency, along a unit vector, on a static specific force: `None` where that frequency
    /// was never made or nothing of use is left.
    pub(super) fn sine_g(&self, f_hz: f64, direction: [f64; 3], a0_g: [f64; 3]) -> Option<f64> {
        if !(self.band_hz[0]..=self.band_hz[1]).contains(&f_hz) {
            return None;
        }
        let w = TAU * f_hz;
        let shaker_g = self
            .acceleration_g
            .min(self.velocity_g_s * w)
            .min(self.displacement_g_s2 * w * w);
        let left_g = OF_FULL_SCALE * self.full_scale_g - a0_g[0].abs();
        let instrument_g = match direction[0].abs() {
            0.0 => f64::INFINITY,
            along => left_g / along,
        };
        let level_g = (shaker_g.min(instrument_g) / STEP_G + 1e-9).floor() * STEP_G;
        (level_g >= LEAST_G).then_some((10.0 * level_g).round() / 10.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::noise::Seed;
    use crate::bench::plan::Static;
    use crate::bench::simulate::{Specification, VirtualBench};

    fn runs() -> Vec<Run> {
        let bench = VirtualBench::new(
            Seed(3),
            Static::Default,
            Specification::with_dial_sigma(1.0),
            Vec::new(),
        );
        bench.simulate().campaign.runs
    }

    fn sine(level_g: f64, f_hz: f64) -> Run {
        Run {
            kind: VibrationKind::Sine,
            level_g,
            band_hz: [f_hz; 2],
            ..runs()[0].clone()
        }
    }

    #[test]
    fn a_shaker_that_made_6_g_at_100_hz_and_12_at_1000_makes_3_at_50_and_12_at_500() {
        let made = [sine(6.0, 100.0), sine(12.0, 1000.0), sine(0.5, 20.0)];
        let reach = Reach::of(100.0, &made.iter().collect::<Vec<_>>());
        let along = |f_hz| reach.sine_g(f_hz, [1.0, 0.0, 0.0], [0.0; 3]);
        // The velocity is that of 6 g at 100 Hz, the displacement that of 0.5 g at 20 Hz.
        assert_eq!(along(50.0), Some(3.0));
        assert_eq!(along(30.0), Some(1.1));
        assert_eq!(along(500.0), Some(12.0));
        assert_eq!(along(1000.0), Some(12.0));
        assert_eq!(along(15.0), None);
        assert_eq!(along(1400.0), None);
    }

    #[test]
    fn nothing_is_proposed_beyond_the_full_scale_with_gravity_on_the_input_axis() {
        let made = [sine(12.0, 100.0), sine(12.0, 1000.0)];
        let reach = Reach::of(10.0, &made.iter().collect::<Vec<_>>());
        assert_eq!(
            reach.sine_g(500.0, [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]),
            Some(8.0)
        );
        assert_eq!(
            reach.sine_g(500.0, [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]),
            Some(12.0)
        );
    }
}
