//! Vibration rectification error, equations (2)-(9).
//!
//! ```text
//! VRE(a0, w) = M[ u(a0 + w(t)) ] - u(a0),   u = U / K1                                            (2)
//! ```
//!
//! Every term of the output model is a polynomial but three that have a kink or a jump at a_I = 0, so (2) is exact for any
//! zero-mean vibration from a handful of its moments and the means of these three:
//!
//! ```text
//! VRE = k1' (M|a_I0 + w_I| - |a_I0|) + k2 m2 + k3 (3 a_I0 m2 + m3) + k4 (6 a_I0^2 m2 + 4 a_I0 m3 + m4)
//!     + k_IP c_IP + k_IO c_IO + k_PO c_PO
//!     + k5 (10 a_I0^3 m2 + 10 a_I0^2 m3 + 5 a_I0 m4 + m5) + Kpp m2_P + Koo m2_O
//!     + K0' (M sign(a_I0 + w_I) - sign(a_I0)) + Koq (M[(a_I0 + w_I) |a_I0 + w_I|] - a_I0 |a_I0|)
//! ```
//!
//! With the moments of a sine this is (8), its parts (4), (5) and (7); with those of Gaussian noise, (9).
//! Misalignment adds nothing that depends on vibration, (6). The VRE is linear in the coefficients: its
//! derivatives, a [`Sensitivity`], *are* the prediction and carry the coefficients' uncertainty into it.
//!
//! `f32` is good to some 1e-6 of the VRE: enough for any compensation. `f64` is for identification.

use serde::{Deserialize, Serialize};

use crate::model::{Coefficients, FURTHER, NOMINAL, sign};
use crate::scalar::Real;
use crate::vibration::{Kinked, KinkedMeans, Moments};

/// The nominal coefficients that rectify, in the order of [`Coefficients::to_nominal`]: all but K1, bias and
/// misalignments.
pub const NOMINAL_RECTIFYING: [usize; 7] = [2, 3, 4, 5, 8, 9, 10];

/// Number of coefficients that rectify: those of [`NOMINAL_RECTIFYING`], then the further ones.
pub const RECTIFYING: usize = NOMINAL_RECTIFYING.len() + FURTHER;

/// Covariance of the [`RECTIFYING`] coefficients, in units of their products; symmetric. Those of no covariance are known
/// for sure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Covariance<T>(
    /// Lower triangle, row by row; cut into pieces that serde knows.
    [[T; RECTIFYING + 1]; RECTIFYING / 2],
);

impl<T: Real> Default for Covariance<T> {
    fn default() -> Self {
        Self::from_fn(|_, _| T::zero())
    }
}

impl<T: Real> Covariance<T> {
    /// Of the elements of its lower triangle by row and column.
    pub fn from_fn(element: impl Fn(usize, usize) -> T) -> Self {
        let mut packed = [[T::zero(); RECTIFYING + 1]; RECTIFYING / 2];
        let triangle = (0..RECTIFYING).flat_map(|row| (0..=row).map(move |column| (row, column)));
        for (to, (row, column)) in packed.as_flattened_mut().iter_mut().zip(triangle) {
            *to = element(row, column);
        }
        Self(packed)
    }

    /// Of the eleven nominal coefficients, in the order of [`Coefficients::to_nominal`]; the further ones are known for
    /// sure. The lower triangle is taken.
    pub fn from_nominal(covariance: &[[T; NOMINAL]; NOMINAL]) -> Self {
        Self::from_fn(|row, column| {
            let nominal = |k: usize| NOMINAL_RECTIFYING.get(k);
            match (nominal(row), nominal(column)) {
                (Some(&row), Some(&column)) => covariance[row][column],
                _ => T::zero(),
            }
        })
    }

    /// One element.
    pub fn get(&self, row: usize, column: usize) -> T {
        let (low, high) = (row.min(column), row.max(column));
        self.0.as_flattened()[high * (high + 1) / 2 + low]
    }

    /// The same numbers in another precision.
    pub fn narrow(&self) -> Covariance<f32> {
        Covariance(self.0.map(|piece| piece.map(|c| c.to_f64() as f32)))
    }
}

/// Derivatives of the vibration error (g) by the coefficients of the output model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity<T> {
    /// By the eleven coefficients in the order of [`Coefficients::to_nominal`]; zero for K1, bias and
    /// misalignments.
    pub nominal: [T; NOMINAL],
    /// By the further coefficients in the order of [`Coefficients::to_further`].
    pub further: [T; FURTHER],
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
        let [jump, absolute, signed_square] = kinked_excess(a, &w);
        Self {
            nominal: [
                zero,
                zero,
                absolute,
                w.m2_g2,
                three * a * w.m2_g2 + w.m3_g3,
                six * a2 * w.m2_g2 + four * a * w.m3_g3 + w.m4_g4,
                zero,
                zero,
                w.cross_ip_g2,
                w.cross_io_g2,
                w.cross_po_g2,
            ],
            further: [
                ten * a2 * (a * w.m2_g2 + w.m3_g3) + five * a * w.m4_g4 + w.m5_g5,
                jump,
                signed_square,
                w.m2_p_g2,
                w.m2_o_g2,
            ],
        }
    }

    /// The vibration error of an instrument with these coefficients, g.
    pub fn vre_g(&self, coefficients: &Coefficients<T>) -> T {
        // Written out, the instrument does it in a third of the instructions.
        let (c, s, further) = (coefficients, &self.nominal, &self.further);
        s[2] * c.asymmetry
            + s[3] * c.second_order_per_g
            + s[4] * c.third_order_per_g2
            + s[5] * c.fourth_order_per_g3
            + s[8] * c.cross_ip_per_g
            + s[9] * c.cross_io_per_g
            + s[10] * c.cross_po_per_g
            + further[0] * c.fifth_order_per_g4
            + further[1] * c.bias_asymmetry_g
            + further[2] * c.odd_quadratic_per_g
            + further[3] * c.cross_pp_per_g
            + further[4] * c.cross_oo_per_g
    }

    /// The derivatives by the coefficients that rectify, in the order of [`Covariance`].
    pub fn rectifying(&self) -> [T; RECTIFYING] {
        let [_, _, asymmetry, second, third, fourth, _, _, ip, io, po] = self.nominal;
        let [fifth, sign, odd, pp, oo] = self.further;
        [
            asymmetry, second, third, fourth, ip, io, po, fifth, sign, odd, pp, oo,
        ]
    }

    /// The variance that a covariance of the coefficients gives the predicted vibration error, g^2.
    pub fn variance_with_further_g2(&self, covariance: &Covariance<T>) -> T {
        let s = self.rectifying();
        let two = T::lit(2.0);
        let mut triangle = covariance.0.as_flattened();
        let mut sum = T::zero();
        for (n, s_n) in s.iter().enumerate() {
            let (row, rest) = triangle.split_at(n + 1);
            triangle = rest;
            // Two at a time: half of the instrument's instructions are the loop's own.
            let (pairs, one) = row.as_chunks::<2>();
            let (s_pairs, s_one) = s[..=n].as_chunks::<2>();
            let mut others = one
                .first()
                .zip(s_one.first())
                .map_or(T::zero(), |(c, s)| *c * *s);
            for ([c, d], [s, t]) in pairs.iter().zip(s_pairs) {
                others += *c * *s + *d * *t;
            }
            // The diagonal counts once, the others twice.
            sum += *s_n * (two * others - row[n] * *s_n);
        }
        sum
    }

    /// The same of the eleven nominal coefficients, from the lower triangle of their covariance.
    pub fn variance_g2(&self, covariance: &[[T; NOMINAL]; NOMINAL]) -> T {
        self.variance_with_further_g2(&Covariance::from_nominal(covariance))
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

/// The means of sign(a_I), |a_I| and a_I |a_I| less their values at rest: the factors of K0', k1' and Koq.
fn kinked_excess<T: Real>(a0: T, w: &Moments<T>) -> [T; 3] {
    match w.kinked {
        Kinked::Measured(KinkedMeans {
            sign: mean,
            absolute_g,
            signed_square_g2,
        }) => [mean - sign(a0), absolute_g, signed_square_g2],
        Kinked::Harmonic => harmonic_excess(a0, w.m2_g2),
        Kinked::NearGaussian => near_gaussian_excess(a0, w),
    }
}

/// Of a sine of amplitude w = sqrt(2 m2): for |a0| < w, with phi = arccos(|a0| / w), root = sqrt(w^2 - a0^2),
///
/// ```text
/// M sign(a_I) - sign(a0) = -(2/pi) phi sign(a0)
/// M|a_I| - |a0|          = (2/pi) (root - |a0| phi)                                                (4)
/// M[a_I|a_I|] - a0|a0|   = { w^2/2 + (2/pi) [1.5 |a0| root - (a0^2 + w^2/2) phi] } sign(a0)
/// ```
///
/// and otherwise 0, 0, m2 sign(a0). Written with the arc cosine nothing cancels near |a0| = w.
fn harmonic_excess<T: Real>(a0: T, m2: T) -> [T; 3] {
    let (a, amplitude) = (a0.abs(), (T::lit(2.0) * m2).sqrt());
    if a >= amplitude {
        return [T::zero(), T::zero(), m2 * sign(a0)];
    }
    let two_pi = T::FRAC_2_PI();
    let root = ((amplitude - a) * (amplitude + a)).sqrt();
    let phi = (a / amplitude).acos();
    let square = m2 + two_pi * (T::lit(1.5) * a * root - (a * a + m2) * phi);
    [
        -two_pi * phi * sign(a0),
        two_pi * (root - a * phi),
        square * sign(a0),
    ]
}

/// Of Gaussian noise, with alpha = a0 / sigma and phi the normal density; M|a_I| is the asymmetry's part of (9), plus
/// the Gram-Charlier correction for skewness s and kurtosis k:
///
/// ```text
/// M sign(a_I) - sign(a0) = -erfc(|alpha|/sqrt 2) sign(a0)
/// M|a_I| - |a0|          = 2 sigma phi(alpha) [1 - s alpha / 6 + (k - 3)(alpha^2 - 1) / 24]
///                        - |a0| erfc(|alpha|/sqrt 2)
/// M[a_I|a_I|] - a0|a0|   = { sigma^2 + 2 |a0| sigma phi(alpha)
///                        - (a0^2 + sigma^2) erfc(|alpha|/sqrt 2) } sign(a0)
/// ```
///
/// The correction is E[f He_n] = E[f^(n)] for f = |a0 + sigma x|, whose second derivative is 2 sigma^2 times
/// a delta function at a0 + sigma x = 0. The other two are needed for predictions from a density only, where the further
/// coefficients are zero; they do without.
fn near_gaussian_excess<T: Real>(a0: T, w: &Moments<T>) -> [T; 3] {
    let m2 = w.m2_g2;
    let sigma = m2.sqrt();
    if sigma <= T::zero() {
        return [T::zero(); 3];
    }
    let (a, alpha) = (a0.abs(), a0 / sigma);
    let alpha2 = alpha * alpha;
    let two_density = T::FRAC_2_SQRT_PI() * T::FRAC_1_SQRT_2() * (-T::lit(0.5) * alpha2).exp();
    let beyond = (alpha.abs() * T::FRAC_1_SQRT_2()).erfc();
    let skew = w.m3_g3 / (m2 * sigma);
    let excess = w.m4_g4 / (m2 * m2) - T::lit(3.0);
    let correction = -skew * alpha / T::lit(6.0) + excess * (alpha2 - T::one()) / T::lit(24.0);
    let square = m2 + a * sigma * two_density - (a * a + m2) * beyond;
    [
        -beyond * sign(a0),
        sigma * two_density * (T::one() + correction) - a * beyond,
        square * sign(a0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SpecificForce;
    use crate::vibration::{Harmonic, Random};

    fn instrument() -> Coefficients<f64> {
        Coefficients::from_nominal([
            1.3, 1e-4, -6.2e-4, 3.9e-4, 2.7e-4, -4.9e-5, 3.8e-4, -6e-4, -4.6e-5, 2.6e-5, 5e-5,
        ])
        .with_further([7e-6, 3e-4, -2e-4, 1.1e-4, -9e-5])
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

    /// The instrument without its jump, and with nothing but that: a mean over a grid takes a jump for one up to half a step
    /// away, which is its error.
    fn with_and_without_jump() -> (Coefficients<f64>, Coefficients<f64>) {
        let (c, nothing) = (instrument(), Coefficients::default());
        let bias_asymmetry_g = c.bias_asymmetry_g;
        let smooth = Coefficients {
            bias_asymmetry_g: 0.0,
            ..c
        };
        let jump = Coefficients {
            bias_asymmetry_g,
            ..nothing
        };
        (smooth, jump)
    }

    #[test]
    fn harmonic_form_equals_the_time_mean_of_the_output() {
        let (c, jump) = with_and_without_jump();
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
                let sine = Harmonic {
                    amplitude_g: at(1.0),
                };
                let predicted = vre_g(&c, a0, sine);
                assert!(
                    (predicted - truth).abs() < 1e-12,
                    "{peak} {a0}: {predicted} {truth}"
                );
                let jumping = time_mean_vre(&jump, g, (0..n).map(|k| at(phase(k).sin())));
                // Two passages through zero, each half a step off at the most, 2 K0' high.
                let tolerance = 2.0 * jump.bias_asymmetry_g / f64::from(n) + 1e-12;
                let predicted = vre_g(&jump, a0, sine);
                assert!(
                    (predicted - jumping).abs() < tolerance,
                    "{peak} {a0}: {predicted} {jumping}"
                );
                let single = Coefficients::from_nominal(c.to_nominal().map(|c| c as f32))
                    .with_further(c.to_further().map(|c| c as f32));
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

    #[test]
    fn variance_is_the_quadratic_form_of_the_whole_covariance() {
        let element = |j: usize, k: usize| (1 + j.min(k) + 16 * j.max(k)) as f64;
        let covariance = Covariance::from_fn(element);
        let amplitude_g = SpecificForce::new(0.8, 0.5, -0.3);
        let sensitivity = Sensitivity::new(0.4, Harmonic { amplitude_g });
        let s = sensitivity.rectifying();
        let mut sum = 0.0;
        for j in 0..RECTIFYING {
            for k in 0..RECTIFYING {
                assert_eq!(covariance.get(j, k), element(j, k));
                sum += s[j] * element(j, k) * s[k];
            }
        }
        let variance = sensitivity.variance_with_further_g2(&covariance);
        assert!((variance / sum - 1.0).abs() < 1e-14, "{variance} {sum}");
    }

    /// The time mean over Gaussian noise by the midpoint rule on a grid of two independent normals.
    #[test]
    fn random_form_equals_the_mean_over_gaussian_noise() {
        let (c, jump) = with_and_without_jump();
        let (rho, n, reach) = (-0.4f64, 1600, 8.0);
        let step = 2.0 * reach / f64::from(n);
        let node = |k: i32| (f64::from(k) + 0.5) * step - reach;
        let density = |x: f64| (-0.5 * x * x).exp() * step / core::f64::consts::TAU.sqrt();
        for sigma in [0.3f64, 1.0, 2.5] {
            for a0 in [-1.0, 0.0, 0.5] {
                let (mut mean, mut jumping) = (0.0, 0.0);
                let at_rest = SpecificForce::new(a0, 0.0, 0.0);
                for j in 0..n {
                    let x = node(j);
                    let along = SpecificForce::new(a0 + sigma * x, 0.0, 0.0);
                    jumping += density(x) * (jump.error_g(along) - jump.error_g(at_rest));
                    for k in (0..n).step_by(4) {
                        let y = rho * x + (1.0 - rho * rho).sqrt() * (node(k) + 1.5 * step);
                        let a = SpecificForce::new(a0 + sigma * x, 0.8 * sigma * y, 0.0);
                        let weight = 4.0 * density(x) * density(node(k) + 1.5 * step);
                        mean += weight * (c.error_g(a) - c.error_g(at_rest));
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
                // Half a step of the grid, under the density's peak of 0.4, 2 K0' high.
                let tolerance = 0.4 * step * jump.bias_asymmetry_g + 1e-12;
                let predicted = vre_g(&jump, a0, vibration);
                assert!(
                    (predicted - jumping).abs() < tolerance,
                    "{sigma} {a0}: {predicted} {jumping}"
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
                m2_p_g2: mean(&|w| w.p.powi(2)),
                m2_o_g2: mean(&|w| w.o.powi(2)),
                kinked: Kinked::Measured(KinkedMeans {
                    sign: mean(&|w| sign(a0 + w.i)),
                    absolute_g: mean(&|w| (a0 + w.i).abs()) - a0.abs(),
                    signed_square_g2: mean(&|w| (a0 + w.i) * (a0 + w.i).abs()) - a0 * a0.abs(),
                }),
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
                    kinked_excess(a0, &Moments::near_gaussian(rms, [0.0; 3], s, k))[1]
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
