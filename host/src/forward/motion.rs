//! How the instrument moves in a run.

use shared::model::SpecificForce;
use shared::rectification::Sensitivity;
use shared::vibration::{Harmonic, Moments};

use super::rows::RunConditions;
use crate::campaign::{ReferenceMoments, VibrationKind};

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
    pub fn commanded(run: &RunConditions, seen: Option<&ReferenceMoments>) -> Self {
        let axis = main_axis(&run.direction);
        let shape = match (seen, run.kind) {
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

    /// Multiple of the amplitude at which the specific force along IA, `a0_i_g` at rest, is zero; infinite if it never is.
    pub fn zero(&self, a0_i_g: f64) -> f64 {
        -a0_i_g / self.amplitude_g[0]
    }

    /// Multiple of a sine's amplitude, its second harmonic included, at a phase.
    pub fn at_phase(&self, phase_rad: f64) -> f64 {
        self.at_sine(phase_rad.sin())
    }

    /// The same where the phase has this sine.
    pub(super) fn at_sine(&self, sine: f64) -> f64 {
        sine - self.second_harmonic * (1.0 - 2.0 * sine * sine)
    }

    /// Multiples of a sine's amplitude, its second harmonic included, at which IA feels most and least.
    pub fn extremes(&self) -> [f64; 2] {
        let h = self.second_harmonic;
        // From a quarter on it turns between the quarter periods as well.
        let turn = self.at_sine((-0.25 / h).clamp(-1.0, 1.0));
        let (least, most) = (turn.min(h - 1.0), turn.max(h + 1.0));
        if self.amplitude_g[0] < 0.0 {
            [least, most]
        } else {
            [most, least]
        }
    }

    /// Derivatives of the vibration error by the coefficients.
    pub fn sensitivity(&self, run: &RunConditions) -> Sensitivity<f64> {
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
        Sensitivity::new(run.specific_force_g.i, moments)
    }
}

/// The axis with the largest component, the first of equals.
pub fn main_axis(direction: &[f64; 3]) -> usize {
    let largest = direction.iter().fold(0.0_f64, |most, n| most.max(n.abs()));
    let found = direction.iter().position(|n| n.abs() > largest - 1e-6);
    found.unwrap_or(0)
}
