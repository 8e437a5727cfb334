//! Vibration rectification error, equations (2)-(9).
//!
//! ```text
//! VRE(a0, w) = M[ u(a0 + w(t)) ] - u(a0),   u = U / K1                                            (2)
//! ```
//!
//! Every term of the output model is a polynomial but the asymmetry, so (2) is exact for any zero-mean
//! vibration from a handful of its moments:
//!
//! ```text
//! VRE = k1' (M|a_I0 + w_I| - |a_I0|) + k2 m2 + k3 (3 a_I0 m2 + m3) + k4 (6 a_I0^2 m2 + 4 a_I0 m3 + m4)
//!     + k5 (10 a_I0^3 m2 + 10 a_I0^2 m3 + 5 a_I0 m4 + m5) + k_IP c_IP + k_IO c_IO + k_PO c_PO
//! ```
//!
//! With the moments of a sine this is (8), its parts (4), (5) and (7); with those of Gaussian noise, (9).
//! Misalignment adds nothing that depends on vibration, (6). The VRE is linear in the coefficients: its
//! derivatives, a [`Sensitivity`], *are* the prediction and carry the coefficients' uncertainty into it.
//!
//! `f32` is good to some 1e-6 of the VRE: enough for any compensation. `f64` is for identification.

use crate::model::{Coefficients, NOMINAL};
use crate::scalar::Real;
use crate::vibration::{AbsoluteMean, Moments};

/// The coefficients that rectify, in the order of [`Coefficients::to_nominal`]: all but K1, bias and misalignments.
const RECTIFYING: [usize; 7] = [2, 3, 4, 5, 8, 9, 10];

/// Derivatives of the vibration error (g) by the coefficients of the output model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity<T> {
    /// By the eleven coefficients in the order of [`Coefficients::to_nominal`]; zero for K1, bias and
    /// misalignments.
    pub nominal: [T; NOMINAL],
    /// By the fifth-order nonlinearity.
    pub fifth_order: T,
}

impl<T: Real> Sensitivity<T> {
    /// The sensitivity of the VRE at a systematic specific force `a0_i_g` (g) on IA under a vibration.
    ///
    /// Gravity on the other axes does not enter: w has zero mean, so a cross-coupling sees only M[w_j w_k].
    pub fn new(a0_i_g: T, vibration: impl Into<Moments<T>>) -> Self {
        let w: Moments<T> = vibration.into();
        let a = a0_i_g;
        let a2 = a * a;
        let (three, four, five, six, ten) = (
            T::lit(3.0),
            T::lit(4.0),
            T::lit(5.0),
            T::lit(6.0),
            T::lit(10.0),
        );
        let zero = T::zero();
        Self {
            nominal: [
                zero,
                zero,
                absolute_excess(a, &w),
                w.m2_g2,
                three * a * w.m2_g2 + w.m3_g3,
                six * a2 * w.m2_g2 + four * a * w.m3_g3 + w.m4_g4,
                zero,
                zero,
                w.cross_ip_g2,
                w.cross_io_g2,
                w.cross_po_g2,
            ],
            fifth_order: ten * a2 * (a * w.m2_g2 + w.m3_g3) + five * a * w.m4_g4 + w.m5_g5,
        }
    }

    /// The vibration error of an instrument with these coefficients, g.
    pub fn vre_g(&self, coefficients: &Coefficients<T>) -> T {
        let c = coefficients.to_nominal();
        let mut sum = self.fifth_order * coefficients.fifth_order_per_g4;
        for (s, c) in self.nominal.iter().zip(c) {
            sum += *s * c;
        }
        sum
    }

    /// The variance that a covariance of the eleven coefficients gives the predicted vibration error, g^2; its lower
    /// triangle is taken.
    pub fn variance_g2(&self, covariance: &[[T; NOMINAL]; NOMINAL]) -> T {
        let two = T::lit(2.0);
        let mut sum = T::zero();
        for (n, &j) in RECTIFYING.iter().enumerate() {
            let s = self.nominal[j];
            let mut others = T::zero();
            for &k in &RECTIFYING[..n] {
                others += covariance[j][k] * self.nominal[k];
            }
            sum += s * (covariance[j][j] * s + two * others);
        }
        sum
    }
}

/// The vibration error VRE(a0, w) of (2) in g: (8) for a [`Harmonic`](crate::vibration::Harmonic), (9) for a
/// [`Random`](crate::vibration::Random), the moment form for [`Moments`].
pub fn vre_g<T: Real>(
    coefficients: &Coefficients<T>,
    a0_i_g: T,
    vibration: impl Into<Moments<T>>,
) -> T {
    Sensitivity::new(a0_i_g, vibration).vre_g(coefficients)
}

/// M|a0 + w_I| - |a0| in g, the factor of the asymmetry k1'.
fn absolute_excess<T: Real>(a0: T, w: &Moments<T>) -> T {
    let a = a0.abs();
    match w.absolute {
        AbsoluteMean::Measured(mean) => mean - a,
        AbsoluteMean::Harmonic => harmonic_excess(a, (T::lit(2.0) * w.m2_g2).sqrt()),
        AbsoluteMean::NearGaussian => near_gaussian_excess(a0, w),
    }
}

/// (4), written with the arc cosine, so that nothing cancels near |a0| = |w|. `a` = |a0|, `amplitude` >= 0.
fn harmonic_excess<T: Real>(a: T, amplitude: T) -> T {
    if a >= amplitude {
        return T::zero();
    }
    let root = ((amplitude - a) * (amplitude + a)).sqrt();
    T::FRAC_2_PI() * (root - a * (a / amplitude).acos())
}

/// The asymmetry's part of (9), plus the Gram-Charlier correction for skewness s and kurtosis k:
///
/// ```text
/// sigma sqrt(2/pi) exp(-alpha^2/2) - |a0| erfc(|alpha|/sqrt 2)
///   + 2 sigma phi(alpha) [ -s alpha / 6 + (k - 3)(alpha^2 - 1) / 24 ],   alpha = a0 / sigma
/// ```
///
/// The correction is E[f He_n] = E[f^(n)] for f = |a0 + sigma x|, whose second derivative is 2 sigma^2 times
/// a delta function at a0 + sigma x = 0.
fn near_gaussian_excess<T: Real>(a0: T, w: &Moments<T>) -> T {
    let sigma = w.m2_g2.sqrt();
    if sigma <= T::zero() {
        return T::zero();
    }
    let alpha = a0 / sigma;
    let alpha2 = alpha * alpha;
    let two_density = T::FRAC_2_SQRT_PI() * T::FRAC_1_SQRT_2() * (-T::lit(0.5) * alpha2).exp();
    let skew = w.m3_g3 / (w.m2_g2 * sigma);
    let excess = w.m4_g4 / (w.m2_g2 * w.m2_g2) - T::lit(3.0);
    let correction = -skew * alpha / T::lit(6.0) + excess * (alpha2 - T::one()) / T::lit(24.0);
    sigma * two_density * (T::one() + correction)
        - a0.abs() * (alpha.abs() * T::FRAC_1_SQRT_2()).erfc()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SpecificForce;
    use crate::vibration::{Harmonic, Random};

    fn instrument() -> Coefficients<f64> {
        let mut c = Coefficients::from_nominal([
            1.3, 1e-4, -6.2e-4, 3.9e-4, 2.7e-4, -4.9e-5, 3.8e-4, -6e-4, -4.6e-5, 2.6e-5, 5e-5,
        ]);
        c.fifth_order_per_g4 = 7e-6;
        c
    }

    /// (2) as it stands: the time mean of the output model, sample by sample, less the output at rest.
    fn time_mean_vre(
        c: &Coefficients<f64>,
        a0: SpecificForce<f64>,
        samples: impl Iterator<Item = SpecificForce<f64>>,
    ) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for w in samples {
            sum += c.error_g(SpecificForce::new(a0.i + w.i, a0.p + w.p, a0.o + w.o)) + w.i;
            n += 1.0;
        }
        sum / n - c.error_g(a0)
    }

    #[test]
    fn harmonic_form_equals_the_time_mean_of_the_output() {
        let c = instrument();
        let direction = SpecificForce::new(0.6, -0.64, 0.48);
        for peak in [0.1f64, 0.9, 3.0, 6.0] {
            for a0 in [-1.0f64, 0.0, 0.5, 1.0] {
                let g = SpecificForce::new(a0, (1.0 - a0 * a0).sqrt(), 0.0);
                let at = |s: f64| {
                    SpecificForce::new(
                        direction.i * peak * s,
                        direction.p * peak * s,
                        direction.o * peak * s,
                    )
                };
                let n = 200_000;
                let phase = |k| (f64::from(k) + 0.5) / f64::from(n) * core::f64::consts::TAU;
                let truth = time_mean_vre(&c, g, (0..n).map(|k| at(phase(k).sin())));
                let predicted = vre_g(
                    &c,
                    a0,
                    Harmonic {
                        amplitude_g: at(1.0),
                    },
                );
                assert!(
                    (predicted - truth).abs() < 1e-12,
                    "{peak} {a0}: {predicted} {truth}"
                );
                let single = Coefficients::<f32> {
                    scale_factor_v_per_g: 1.3,
                    bias_g: 1e-4,
                    asymmetry: -6.2e-4,
                    second_order_per_g: 3.9e-4,
                    third_order_per_g2: 2.7e-4,
                    fourth_order_per_g3: -4.9e-5,
                    fifth_order_per_g4: 7e-6,
                    misalignment_oa_rad: 3.8e-4,
                    misalignment_pa_rad: -6e-4,
                    cross_ip_per_g: -4.6e-5,
                    cross_io_per_g: 2.6e-5,
                    cross_po_per_g: 5e-5,
                };
                let w = at(1.0);
                let f32_vre = vre_g(
                    &single,
                    a0 as f32,
                    Harmonic {
                        amplitude_g: SpecificForce::new(w.i as f32, w.p as f32, w.o as f32),
                    },
                );
                // Terms of either sign cancel: f32 is judged against their size, not their sum.
                let size = 6.2e-4 * peak + 3.9e-4 * peak * peak + 1e-4 * peak.powi(4);
                assert!((f64::from(f32_vre) - truth).abs() < 1e-6 * size);
            }
        }
    }

    /// The time mean over Gaussian noise by the midpoint rule on a grid of two independent normals.
    #[test]
    fn random_form_equals_the_mean_over_gaussian_noise() {
        let c = instrument();
        let (rho, n, reach) = (-0.4f64, 1600, 8.0);
        let step = 2.0 * reach / f64::from(n);
        let node = |k: i32| (f64::from(k) + 0.5) * step - reach;
        let density = |x: f64| (-0.5 * x * x).exp() * step / core::f64::consts::TAU.sqrt();
        for sigma in [0.3f64, 1.0, 2.5] {
            for a0 in [-1.0, 0.0, 0.5] {
                let mut mean = 0.0;
                for j in 0..n {
                    let x = node(j);
                    for k in (0..n).step_by(4) {
                        let y = rho * x + (1.0 - rho * rho).sqrt() * (node(k) + 1.5 * step);
                        let a = SpecificForce::new(a0 + sigma * x, 0.8 * sigma * y, 0.0);
                        let weight = 4.0 * density(x) * density(node(k) + 1.5 * step);
                        mean +=
                            weight * (c.error_g(a) - c.error_g(SpecificForce::new(a0, 0.0, 0.0)));
                    }
                }
                let vibration = Random {
                    sigma_g: SpecificForce::new(sigma, 0.8 * sigma, 0.0),
                    correlation: [rho, 0.0, 0.0],
                };
                let predicted = vre_g(&c, a0, vibration);
                // The kink of |a| costs the midpoint rule up to k1' sigma step^2 / 4.
                let tolerance = 6.2e-4 * sigma * step * step / 4.0 + 1e-12;
                assert!(
                    (predicted - mean).abs() < tolerance,
                    "{sigma} {a0}: {predicted} {mean}"
                );
            }
        }
    }

    #[test]
    fn moment_form_is_exact_for_a_waveform_of_no_name() {
        let c = instrument();
        let n = 4096;
        let wave = |k: i32| {
            let t = f64::from(k) / f64::from(n) * core::f64::consts::TAU;
            SpecificForce::new(
                1.4 * t.sin() + 0.6 * (2.0 * t).cos() + 0.2 * (5.0 * t).sin(),
                0.5 * t.sin() - 0.3 * (3.0 * t).cos(),
                0.7 * (2.0 * t).cos(),
            )
        };
        for a0 in [-0.7, 0.0, 0.2, 1.0] {
            let mean = |f: &dyn Fn(SpecificForce<f64>) -> f64| {
                (0..n).map(|k| f(wave(k))).sum::<f64>() / f64::from(n)
            };
            let moments = Moments {
                m2_g2: mean(&|w| w.i.powi(2)),
                m3_g3: mean(&|w| w.i.powi(3)),
                m4_g4: mean(&|w| w.i.powi(4)),
                m5_g5: mean(&|w| w.i.powi(5)),
                cross_ip_g2: mean(&|w| w.i * w.p),
                cross_io_g2: mean(&|w| w.i * w.o),
                cross_po_g2: mean(&|w| w.p * w.o),
                absolute: AbsoluteMean::Measured(mean(&|w| (a0 + w.i).abs())),
            };
            let truth = time_mean_vre(&c, SpecificForce::new(a0, 0.3, 0.4), (0..n).map(wave));
            // The rounding of a mean of 4096 outputs of some g.
            let predicted = vre_g(&c, a0, moments);
            assert!(
                (predicted - truth).abs() < 1e-14,
                "{a0}: {predicted} {truth}"
            );
        }
    }

    /// A sum of many sines of random phase is a noise of slightly wrong kurtosis; the plain Gaussian misses
    /// its M|a0+w| by more than the Gram-Charlier form does.
    #[test]
    fn gram_charlier_takes_most_of_a_finite_records_asymmetry() {
        let (mut plain, mut corrected) = (0.0, 0.0);
        let mut state = 12345u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for _ in 0..60 {
            let n = 4096;
            let tones: std::vec::Vec<(f64, f64)> = (0..20)
                .map(|k| (f64::from(40 + k), uniform() * core::f64::consts::TAU))
                .collect();
            let raw: std::vec::Vec<f64> = (0..n)
                .map(|k| {
                    let t = f64::from(k) / f64::from(n) * core::f64::consts::TAU;
                    tones.iter().map(|(f, p)| (f * t + p).sin()).sum::<f64>()
                })
                .collect();
            let mean =
                |f: &dyn Fn(f64) -> f64| raw.iter().map(|w| f(*w)).sum::<f64>() / f64::from(n);
            let rms = mean(&|w| w * w).sqrt();
            let (skew, kurt) = (mean(&|w| (w / rms).powi(3)), mean(&|w| (w / rms).powi(4)));
            for a0 in [0.0, 0.4, 1.1] {
                let truth = mean(&|w| (a0 + w / rms).abs()) - a0;
                let form = |s, k| {
                    let rms = SpecificForce::new(1.0, 0.0, 0.0);
                    absolute_excess(a0, &Moments::near_gaussian(rms, [0.0; 3], s, k))
                };
                plain += (form(0.0, 3.0) - truth).powi(2);
                corrected += (form(skew, kurt) - truth).powi(2);
            }
        }
        assert!(
            corrected < 0.25 * plain,
            "variance left {}",
            corrected / plain
        );
    }
}
