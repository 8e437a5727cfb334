//! What a unit of k2, k3 or k4 makes of a periodic motion: harmonics of the output, and moments of the motion.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use nalgebra::Complex;
use shared::model::{SpecificForce, terms};

use super::blocks::HARMONICS;

/// Phases of a period: the fourth power of five harmonics has twenty, and its fourth harmonic is exact from 25 on.
const PHASES: usize = 32;

/// Places of k2, k3 and k4 among the nominal coefficients.
pub(super) const PLACES: [usize; 3] = [3, 4, 5];

/// cos and sin of the phases.
static CIRCLE: LazyLock<[[f64; 2]; PHASES]> = LazyLock::new(|| {
    std::array::from_fn(|n| {
        let (sine, cosine) = (TAU * n as f64 / PHASES as f64).sin_cos();
        [cosine, sine]
    })
});

/// Columns of one block.
#[derive(Clone, Debug)]
pub(super) struct Column {
    /// Complex amplitude of each harmonic of the output from the fundamental on, by a unit of k2, k3 and k4.
    pub harmonics: [[Complex<f64>; 3]; HARMONICS],
    /// Time means of the motion's second, third and fourth power.
    pub moments: [f64; 3],
}

impl Column {
    /// Of the motion w(t) = Re sum_k W_k exp(i k w t) about a constant specific force on IA, by (1).
    pub fn of(a0_g: f64, motion_g: &[Complex<f64>; HARMONICS]) -> Self {
        let mut harmonics = [[Complex::default(); 3]; HARMONICS];
        let mut moments = [0.0; 3];
        let unit = |k: usize, n: usize| {
            let [cosine, sine] = CIRCLE[k * n % PHASES];
            Complex::new(cosine, sine)
        };
        let share = 1.0 / PHASES as f64;
        for n in 0..PHASES {
            let waves = motion_g.iter().zip(1..);
            let w: f64 = waves.map(|(w, k)| (w * unit(k, n)).re).sum();
            let powers = [w * w, w * w * w, w * w * w * w];
            moments
                .iter_mut()
                .zip(powers)
                .for_each(|(m, p)| *m += share * p);
            let all = terms(SpecificForce::new(a0_g + w, 0.0, 0.0));
            for (of_order, k) in harmonics.iter_mut().zip(1..) {
                let back = unit(k, n).conj() * (2.0 * share);
                for (sum, place) in of_order.iter_mut().zip(PLACES) {
                    *sum += back * all[place];
                }
            }
        }
        Self { harmonics, moments }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_has_the_harmonics_of_its_powers() {
        let mut motion = [Complex::default(); HARMONICS];
        motion[0] = Complex::from_polar(3.0, 0.7);
        let found = Column::of(0.5, &motion);
        // cos^2 = 1/2 + cos 2x / 2; cos^3 = 3/4 cos x + 1/4 cos 3x; cos^4 = 3/8 + 1/2 cos 2x + 1/8 cos 4x.
        let near = |a: Complex<f64>, b: Complex<f64>| (a - b).norm() < 1e-12 * (1.0 + b.norm());
        let w = motion[0];
        assert!(near(found.harmonics[1][0], w * w * 0.5));
        assert!(near(found.harmonics[2][1], w * w * w * 0.25));
        assert!(near(found.harmonics[0][0], w * (2.0 * 0.5)));
        assert!(near(found.harmonics[0][1], w * (0.75 * 9.0 + 3.0 * 0.25)));
        assert!(near(found.harmonics[3][2], w * w * w * w * 0.125));
        let moments = [4.5, 0.0, 0.375 * 81.0];
        assert!(
            found
                .moments
                .iter()
                .zip(moments)
                .all(|(a, b)| (a - b).abs() < 1e-12)
        );
    }
}
