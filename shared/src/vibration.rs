//! What shakes the instrument: a sine, wide-band Gaussian noise, or anything at all by its moments.
//!
//! The vibration w(t) has zero mean; its systematic part, a0, is given apart. [`Moments`] is the general
//! form; [`Harmonic`] and [`Random`] are the two special cases of the paper and convert into it.

use serde::{Deserialize, Serialize};

use crate::model::{SpecificForce, sign};
use crate::scalar::Real;

/// A sine along one fixed line, w_j(t) = w_j sin(2 pi f t).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Harmonic<T> {
    /// Peak amplitude on each axis with the sign of the direction cosine, g.
    #[doc(alias = "w")]
    pub amplitude_g: SpecificForce<T>,
}

/// Stationary Gaussian noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Random<T> {
    /// Standard deviation on each axis, >= 0, g; for a flat density S (g^2/Hz) over a band df (Hz) the root
    /// of S df, for a shaped density the root of its integral.
    #[doc(alias = "sigma")]
    pub sigma_g: SpecificForce<T>,
    /// Correlation of the axes IA-PA, IA-OA, PA-OA, each in [-1, 1]: +-1 for motion along one line.
    #[doc(alias = "rho")]
    pub correlation: [T; 3],
}

impl<T: Real> Random<T> {
    /// Noise along one fixed line: `sigma_g` holds the signed components of one vector, g.
    pub fn along(sigma_g: SpecificForce<T>) -> Self {
        let s = sigma_g;
        Self {
            sigma_g: SpecificForce::new(s.i.abs(), s.p.abs(), s.o.abs()),
            correlation: line_correlation(s),
        }
    }
}

/// Correlation of the axes IA-PA, IA-OA, PA-OA in motion along one line: the sign of the product of its components, 0
/// where an axis stands still.
pub fn line_correlation<T: Real>(along: SpecificForce<T>) -> [T; 3] {
    let SpecificForce { i, p, o } = along;
    [sign(i * p), sign(i * o), sign(p * o)]
}

/// Time means of the three functions of a_I = a0 + w_I that are no polynomial; of the two that do not jump only what they are
/// beyond their values at a0, which hardly changes with a0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KinkedMeans<T> {
    /// M sign(a_I), -1 to 1: the factor of the bias asymmetry.
    pub sign: T,
    /// M|a_I| - |a0|, g: the factor of the scale-factor asymmetry.
    pub absolute_g: T,
    /// M[a_I |a_I|] - a0 |a0|, g^2: the factor of the odd second order.
    pub signed_square_g2: T,
}

/// How [`KinkedMeans`] are known; it decides the parts of the two asymmetries and of the odd second order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Kinked<T> {
    /// Measured about this very a0.
    Measured(KinkedMeans<T>),
    /// w_I is a sine, its amplitude the root of 2 m2: equations (3), (4).
    Harmonic,
    /// w_I is nearly Gaussian: the density of m2, for M|a_I| corrected for m3 and m4 by the Gram-Charlier series.
    NearGaussian,
}

/// Central moments of a vibration: all that its rectification depends on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moments<T> {
    /// M[w_I^2], g^2.
    pub m2_g2: T,
    /// M[w_I^3], g^3.
    pub m3_g3: T,
    /// M[w_I^4], g^4.
    pub m4_g4: T,
    /// M[w_I^5], g^5; only the optional fifth-order coefficient asks for it.
    pub m5_g5: T,
    /// M[w_I w_P], g^2.
    pub cross_ip_g2: T,
    /// M[w_I w_O], g^2.
    pub cross_io_g2: T,
    /// M[w_P w_O], g^2.
    pub cross_po_g2: T,
    /// M[w_P^2], g^2; only the optional squares across ask for it and the next.
    pub m2_p_g2: T,
    /// M[w_O^2], g^2.
    pub m2_o_g2: T,
    /// What is known of the functions with a kink.
    pub kinked: Kinked<T>,
}

impl<T: Real> Moments<T> {
    /// From what a reference accelerometer reports: rms per axis (g, >= 0), correlations IA-PA, IA-OA, PA-OA
    /// and the third and fourth standardized moments of w_I (0 and 3 for Gaussian noise).
    ///
    /// The fifth moment is that of the Gram-Charlier density, 10 skewness rms^5.
    pub fn near_gaussian(rms_g: SpecificForce<T>, correlation: [T; 3], skew: T, kurt: T) -> Self {
        let m2 = rms_g.i * rms_g.i;
        let m3 = skew * m2 * rms_g.i;
        Self {
            m2_g2: m2,
            m3_g3: m3,
            m4_g4: kurt * m2 * m2,
            m5_g5: T::lit(10.0) * m3 * m2,
            cross_ip_g2: correlation[0] * rms_g.i * rms_g.p,
            cross_io_g2: correlation[1] * rms_g.i * rms_g.o,
            cross_po_g2: correlation[2] * rms_g.p * rms_g.o,
            m2_p_g2: rms_g.p * rms_g.p,
            m2_o_g2: rms_g.o * rms_g.o,
            kinked: Kinked::NearGaussian,
        }
    }
}

impl<T: Real> From<Harmonic<T>> for Moments<T> {
    fn from(vibration: Harmonic<T>) -> Self {
        let w = vibration.amplitude_g;
        let half = T::lit(0.5);
        let w2 = w.i * w.i;
        Self {
            m2_g2: half * w2,
            m3_g3: T::zero(),
            m4_g4: T::lit(0.375) * w2 * w2,
            m5_g5: T::zero(),
            cross_ip_g2: half * w.i * w.p,
            cross_io_g2: half * w.i * w.o,
            cross_po_g2: half * w.p * w.o,
            m2_p_g2: half * w.p * w.p,
            m2_o_g2: half * w.o * w.o,
            kinked: Kinked::Harmonic,
        }
    }
}

impl<T: Real> From<Random<T>> for Moments<T> {
    fn from(vibration: Random<T>) -> Self {
        Self::near_gaussian(
            vibration.sigma_g,
            vibration.correlation,
            T::zero(),
            T::lit(3.0),
        )
    }
}
