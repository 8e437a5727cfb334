//! Vibration error of each instrument of a triad, from the moments of the body's vibration.
//!
//! The three see the vibration that each of them needs: the cross-moments of (2) come from the triad itself. Instrument s has
//! IA, PA, OA along (s, s+1, s+2), so that its c_IP, c_PO, c_IO are the body's cross-moments s, s+1, s+2 of [`PAIRS`].

use super::body::{Axis, INSTRUMENTS};
use crate::model::{Coefficients, NOMINAL, SpecificForce};
use crate::rectification::Sensitivity;
use crate::scalar::Real;
use crate::vibration::{Harmonic, Kinked, Moments, Random};

/// The pairs of axes of [`BodyMoments::cross_g2`]: xy, yz, zx.
pub const PAIRS: [(usize, usize); 3] = [(0, 1), (1, 2), (2, 0)];

/// Moments of the vibration along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisMoments<T> {
    /// M[w^2], g^2.
    pub m2_g2: T,
    /// M[w^3], g^3.
    pub m3_g3: T,
    /// M[w^4], g^4.
    pub m4_g4: T,
    /// M[w^5], g^5; only the optional fifth order asks for it.
    pub m5_g5: T,
    /// Means of the functions with a kink.
    pub kinked: Kinked<T>,
}

/// Moments of the vibration on the body axes: all that the triad's rectification depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyMoments<T> {
    /// Along x, y, z.
    pub axes: [AxisMoments<T>; INSTRUMENTS],
    /// M[w_j w_k], g^2, in the order of [`PAIRS`].
    pub cross_g2: [T; INSTRUMENTS],
}

impl<T: Real> BodyMoments<T> {
    /// Of a sine of these amplitudes along x, y, z with their signs, g.
    pub fn harmonic(amplitude_g: [T; 3]) -> Self {
        Self::from_instruments(|axis| {
            let amplitude_g = axis.on_instrument(amplitude_g);
            Harmonic { amplitude_g }.into()
        })
    }

    /// Of Gaussian noise: rms along x, y, z, g, and correlations xy, yz, zx.
    pub fn random(rms_g: [T; 3], correlation: [T; 3]) -> Self {
        Self::from_instruments(|axis| {
            let SpecificForce { i, p, o } = axis.on_instrument(correlation);
            Random {
                sigma_g: axis.on_instrument(rms_g),
                correlation: [i, o, p],
            }
            .into()
        })
    }

    fn from_instruments(moments: impl Fn(Axis) -> Moments<T>) -> Self {
        let seen = Axis::ALL.map(moments);
        Self {
            axes: seen.map(|w| AxisMoments {
                m2_g2: w.m2_g2,
                m3_g3: w.m3_g3,
                m4_g4: w.m4_g4,
                m5_g5: w.m5_g5,
                kinked: w.kinked,
            }),
            cross_g2: seen.map(|w| w.cross_ip_g2),
        }
    }

    /// The vibration on the axes of one instrument.
    pub fn on_instrument(&self, axis: Axis) -> Moments<T> {
        let [own, pendulous, output] = [0, 1, 2].map(|k| (axis.index() + k) % INSTRUMENTS);
        let along = &self.axes[own];
        Moments {
            m2_g2: along.m2_g2,
            m3_g3: along.m3_g3,
            m4_g4: along.m4_g4,
            m5_g5: along.m5_g5,
            cross_ip_g2: self.cross_g2[own],
            cross_io_g2: self.cross_g2[output],
            cross_po_g2: self.cross_g2[pendulous],
            m2_p_g2: self.axes[pendulous].m2_g2,
            m2_o_g2: self.axes[output].m2_g2,
            kinked: along.kinked,
        }
    }

    /// Derivatives of each instrument's vibration error by its coefficients, at a systematic specific force on the body axes, g.
    pub fn sensitivities(&self, body_g: [T; 3]) -> [Sensitivity<T>; INSTRUMENTS] {
        Axis::ALL.map(|axis| Sensitivity::new(body_g[axis.index()], self.on_instrument(axis)))
    }
}

/// Vibration error of each instrument, g.
pub fn vre_g<T: Real>(
    sensitivities: &[Sensitivity<T>; INSTRUMENTS],
    instruments: &[Coefficients<T>; INSTRUMENTS],
) -> [T; INSTRUMENTS] {
    core::array::from_fn(|s| sensitivities[s].vre_g(&instruments[s]))
}

/// Covariance of the three vibration errors, g^2, from that of the coefficients: the three are correlated where positions
/// tell only what they have together.
pub fn vre_covariance_g2<const N: usize>(
    sensitivities: &[Sensitivity<f64>; INSTRUMENTS],
    covariance: &[[f64; N]; N],
) -> [[f64; INSTRUMENTS]; INSTRUMENTS] {
    core::array::from_fn(|i| {
        core::array::from_fn(|j| {
            let product = |m: usize, n: usize| {
                sensitivities[i].nominal[m]
                    * covariance[i * NOMINAL + m][j * NOMINAL + n]
                    * sensitivities[j].nominal[n]
            };
            let rows = (0..NOMINAL).map(|m| (0..NOMINAL).map(|n| product(m, n)).sum::<f64>());
            rows.sum()
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::triad::body::outputs_v;

    /// The time mean of the outputs over a Lissajous motion, against the moment form from the body's own moments.
    #[test]
    fn vibration_error_of_each_is_the_time_mean_of_its_output() {
        let instruments = [
            [
                1.2, 1e-4, -6e-4, 4e-4, 3e-4, -5e-5, 4e-4, -6e-4, -5e-5, 3e-5, 5e-5,
            ],
            [
                1.1, 2e-4, 3e-4, -2e-4, 1e-4, 5e-5, 4e-4, 6e-4, 7e-5, -3e-5, 2e-5,
            ],
            [
                0.9, 3e-4, 5e-4, 1e-4, -3e-4, 2e-5, -4e-4, 6e-4, 1e-5, 9e-5, -8e-5,
            ],
        ]
        .map(Coefficients::<f64>::from_nominal);
        let a0 = [0.6, -0.48, 0.64];
        let n = 40_000;
        let motion = |k: i32| {
            let t = (f64::from(k) + 0.5) / f64::from(n) * core::f64::consts::TAU;
            [
                2.0 * t.sin(),
                1.5 * (t + 0.7).sin() + 0.2 * (2.0 * t).cos(),
                (3.0 * t).sin() - 0.8 * t.sin(),
            ]
        };
        let mean =
            |f: &dyn Fn([f64; 3]) -> f64| (0..n).map(|k| f(motion(k))).sum::<f64>() / f64::from(n);
        let power = |s: usize, p: i32| mean(&|w| w[s].powi(p));
        let moments = BodyMoments {
            axes: core::array::from_fn(|s| {
                let a = a0[s];
                AxisMoments {
                    m2_g2: power(s, 2),
                    m3_g3: power(s, 3),
                    m4_g4: power(s, 4),
                    m5_g5: power(s, 5),
                    kinked: Kinked::Measured(crate::vibration::KinkedMeans {
                        sign: mean(&|w| (a + w[s]).signum()),
                        absolute_g: mean(&|w| (a + w[s]).abs()) - a.abs(),
                        signed_square_g2: 0.0,
                    }),
                }
            }),
            cross_g2: PAIRS.map(|(j, k)| mean(&|w| w[j] * w[k])),
        };
        let predicted = vre_g(&moments.sensitivities(a0), &instruments);
        let still = outputs_v(&instruments, a0);
        for s in 0..3 {
            let shaken =
                mean(&|w| outputs_v(&instruments, [a0[0] + w[0], a0[1] + w[1], a0[2] + w[2]])[s]);
            let truth = (shaken - still[s]) / instruments[s].scale_factor_v_per_g;
            assert!(
                (predicted[s] - truth).abs() < 1e-11,
                "{s}: {} {truth}",
                predicted[s]
            );
        }
    }

    #[test]
    fn sine_and_noise_have_the_cross_moments_of_their_axes() {
        let sine = BodyMoments::harmonic([1.0, -2.0, 3.0]);
        assert_eq!(sine.cross_g2, [-1.0, -3.0, 1.5]);
        let noise = BodyMoments::random([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]);
        for (found, expected) in noise.cross_g2.iter().zip([0.2f64, 1.2, 0.9]) {
            assert!((found - expected).abs() < 1e-15);
        }
        let along_y = noise.on_instrument(Axis::Y);
        assert_eq!(
            [
                along_y.m2_g2,
                along_y.cross_ip_g2,
                along_y.cross_io_g2,
                along_y.cross_po_g2
            ],
            [4.0, noise.cross_g2[1], noise.cross_g2[0], noise.cross_g2[2]]
        );
    }
}
