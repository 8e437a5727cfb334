//! The output model of IEEE Std 1293 as the paper uses it, equation (1).
//!
//! ```text
//! U = K1 [ k0 + a_I + k1' |a_I| + k2 a_I^2 + k3 a_I^3 + k4 a_I^4
//!          + d_OA a_P - d_PA a_O + k_IP a_I a_P + k_IO a_I a_O + k_PO a_P a_O
//!          (+ k5 a_I^5 + K0' sign(a_I) + Koq a_I |a_I| + Kpp a_P^2 + Koo a_O^2) ]
//! ```
//!
//! The terms in round brackets are further ones of IEEE 1293 that a diagnosis may ask for; the nominal model has none
//! of them. The sixth order is not among them: what it rectifies takes moments of the vibration beyond the fourth.
//!
//! The model is linear in `K1` times (1, coefficients): [`terms`] gives the functions of the specific force that multiply
//! the nominal ones, and everything that fits, predicts or propagates uncertainty is built on it.

use serde::{Deserialize, Serialize};

use crate::scalar::Real;

/// Number of coefficients of the nominal model.
pub const NOMINAL: usize = 11;

/// Number of further coefficients, zero unless a diagnosis asks for them.
pub const FURTHER: usize = 5;

/// Symbols of the further coefficients, in the order of [`Coefficients::to_further`].
pub const FURTHER_NAMES: [&str; FURTHER] = ["k5", "K0_prime", "Koq", "Kpp", "Koo"];

/// A vector of specific force on the instrument's axes, in g.
#[doc(alias = "a")]
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpecificForce<T> {
    /// Along the input axis IA, g.
    #[doc(alias = "a_I")]
    pub i: T,
    /// Along the pendulous axis PA, g.
    #[doc(alias = "a_P")]
    pub p: T,
    /// Along the output (hinge) axis OA, g.
    #[doc(alias = "a_O")]
    pub o: T,
}

impl<T> SpecificForce<T> {
    /// From its components on IA, PA and OA, in g.
    pub const fn new(i: T, p: T, o: T) -> Self {
        Self { i, p, o }
    }
}

impl<T: Real> SpecificForce<T> {
    /// Euclidean length, g.
    pub fn length(self) -> T {
        (self.i * self.i + self.p * self.p + self.o * self.o).sqrt()
    }
}

/// The coefficients of (1). `Default` is the ideal instrument of 1 V/g.
///
/// IEEE 1293 writes the asymmetries as K1'/2 and K0'/2: its K1' is twice [`asymmetry`](Self::asymmetry), its K0' twice
/// [`bias_asymmetry_g`](Self::bias_asymmetry_g).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coefficients<T> {
    /// Scale factor, V/g.
    #[doc(alias = "K1")]
    pub scale_factor_v_per_g: T,
    /// Bias, g.
    #[doc(alias = "k0")]
    pub bias_g: T,
    /// Scale-factor asymmetry, dimensionless.
    #[doc(alias = "k1_prime")]
    pub asymmetry: T,
    /// Second-order nonlinearity, 1/g.
    #[doc(alias = "k2")]
    pub second_order_per_g: T,
    /// Third-order nonlinearity, 1/g^2.
    #[doc(alias = "k3")]
    pub third_order_per_g2: T,
    /// Fourth-order nonlinearity, 1/g^3.
    #[doc(alias = "k4")]
    pub fourth_order_per_g3: T,
    /// Misalignment of OA, rad; multiplies +a_P.
    #[doc(alias = "d_OA")]
    pub misalignment_oa_rad: T,
    /// Misalignment of PA, rad; multiplies -a_O.
    #[doc(alias = "d_PA")]
    pub misalignment_pa_rad: T,
    /// Cross-coupling of IA and PA, 1/g.
    #[doc(alias = "k_IP")]
    pub cross_ip_per_g: T,
    /// Cross-coupling of IA and OA, 1/g.
    #[doc(alias = "k_IO")]
    pub cross_io_per_g: T,
    /// Cross-coupling of PA and OA, 1/g.
    #[doc(alias = "k_PO")]
    pub cross_po_per_g: T,
    /// Fifth-order nonlinearity, 1/g^4; zero unless asked for, as all below.
    #[doc(alias = "k5")]
    pub fifth_order_per_g4: T,
    /// Bias asymmetry, g; multiplies sign(a_I), which is 0 at 0.
    #[doc(alias = "K0_prime")]
    pub bias_asymmetry_g: T,
    /// Odd second-order nonlinearity, 1/g; multiplies a_I |a_I|.
    #[doc(alias = "Koq")]
    pub odd_quadratic_per_g: T,
    /// Second-order nonlinearity across, along PA, 1/g; multiplies a_P^2.
    #[doc(alias = "Kpp")]
    pub cross_pp_per_g: T,
    /// Second-order nonlinearity across, along OA, 1/g; multiplies a_O^2.
    #[doc(alias = "Koo")]
    pub cross_oo_per_g: T,
}

impl<T: Real> Default for Coefficients<T> {
    fn default() -> Self {
        Self::from_nominal([
            T::one(),
            T::zero(),
            T::zero(),
            T::zero(),
            T::zero(),
            T::zero(),
            T::zero(),
            T::zero(),
            T::zero(),
            T::zero(),
            T::zero(),
        ])
    }
}

/// The functions of the specific force (g) in (1), bracket only, in the order of
/// [`Coefficients::to_nominal`]: a_I (which `K1` multiplies), 1, |a_I|, a_I^2, a_I^3, a_I^4, a_P, -a_O,
/// a_I a_P, a_I a_O, a_P a_O.
#[inline]
pub fn terms<T: Real>(a: SpecificForce<T>) -> [T; NOMINAL] {
    let i2 = a.i * a.i;
    [
        a.i,
        T::one(),
        a.i.abs(),
        i2,
        i2 * a.i,
        i2 * i2,
        a.p,
        -a.o,
        a.i * a.p,
        a.i * a.o,
        a.p * a.o,
    ]
}

/// -1, 0 or 1.
#[inline]
pub(crate) fn sign<T: Real>(x: T) -> T {
    if x == T::zero() {
        T::zero()
    } else {
        x.signum()
    }
}

impl<T: Real> Coefficients<T> {
    /// From the eleven coefficients of the nominal model in the order of `vre-identification/1`: K1, k0,
    /// k1', k2, k3, k4, d_OA, d_PA, k_IP, k_IO, k_PO; the further ones are zero.
    pub fn from_nominal(c: [T; NOMINAL]) -> Self {
        Self {
            scale_factor_v_per_g: c[0],
            bias_g: c[1],
            asymmetry: c[2],
            second_order_per_g: c[3],
            third_order_per_g2: c[4],
            fourth_order_per_g3: c[5],
            misalignment_oa_rad: c[6],
            misalignment_pa_rad: c[7],
            cross_ip_per_g: c[8],
            cross_io_per_g: c[9],
            cross_po_per_g: c[10],
            fifth_order_per_g4: T::zero(),
            bias_asymmetry_g: T::zero(),
            odd_quadratic_per_g: T::zero(),
            cross_pp_per_g: T::zero(),
            cross_oo_per_g: T::zero(),
        }
    }

    /// The same with these further coefficients: k5, K0', Koq, Kpp, Koo.
    pub fn with_further(self, c: [T; FURTHER]) -> Self {
        Self {
            fifth_order_per_g4: c[0],
            bias_asymmetry_g: c[1],
            odd_quadratic_per_g: c[2],
            cross_pp_per_g: c[3],
            cross_oo_per_g: c[4],
            ..self
        }
    }

    /// The eleven coefficients of the nominal model, in the order of [`Self::from_nominal`].
    pub fn to_nominal(&self) -> [T; NOMINAL] {
        [
            self.scale_factor_v_per_g,
            self.bias_g,
            self.asymmetry,
            self.second_order_per_g,
            self.third_order_per_g2,
            self.fourth_order_per_g3,
            self.misalignment_oa_rad,
            self.misalignment_pa_rad,
            self.cross_ip_per_g,
            self.cross_io_per_g,
            self.cross_po_per_g,
        ]
    }

    /// The five further coefficients, in the order of [`Self::with_further`].
    pub fn to_further(&self) -> [T; FURTHER] {
        [
            self.fifth_order_per_g4,
            self.bias_asymmetry_g,
            self.odd_quadratic_per_g,
            self.cross_pp_per_g,
            self.cross_oo_per_g,
        ]
    }

    /// u(a) = U/K1, the bracket of (1), in g.
    ///
    /// In `f32` the result carries the rounding of a_I itself, some 6e-8 of it.
    #[inline]
    pub fn output_g(&self, a: SpecificForce<T>) -> T {
        a.i + self.error_g(a)
    }

    /// u(a) - a_I, the *basic error* of the paper's (2), in g.
    #[inline]
    pub fn error_g(&self, a: SpecificForce<T>) -> T {
        // Horner in a_I, the cross-couplings and the odd square folded into the linear term.
        let i = a.i;
        let powers = i
            * (self.cross_ip_per_g * a.p
                + self.cross_io_per_g * a.o
                + self.odd_quadratic_per_g * i.abs()
                + i * (self.second_order_per_g
                    + i * (self.third_order_per_g2
                        + i * (self.fourth_order_per_g3 + i * self.fifth_order_per_g4))));
        self.bias_g
            + self.bias_asymmetry_g * sign(i)
            + self.asymmetry * i.abs()
            + powers
            + a.p
                * (self.misalignment_oa_rad + self.cross_po_per_g * a.o + self.cross_pp_per_g * a.p)
            + a.o * (self.cross_oo_per_g * a.o - self.misalignment_pa_rad)
    }

    /// Derivatives of u(a) = U/K1 by the three components of the specific force, dimensionless.
    ///
    /// At a_I = 0 the asymmetries' kink and jump count as flat.
    #[inline]
    pub fn gradient(&self, a: SpecificForce<T>) -> SpecificForce<T> {
        let i = a.i;
        let (two, three, four, five) = (T::lit(2.0), T::lit(3.0), T::lit(4.0), T::lit(5.0));
        let powers = i
            * (two * self.second_order_per_g
                + i * (three * self.third_order_per_g2
                    + i * (four * self.fourth_order_per_g3 + i * five * self.fifth_order_per_g4)));
        SpecificForce {
            i: T::one()
                + self.asymmetry * sign(i)
                + two * self.odd_quadratic_per_g * i.abs()
                + powers
                + self.cross_ip_per_g * a.p
                + self.cross_io_per_g * a.o,
            p: self.misalignment_oa_rad
                + self.cross_ip_per_g * i
                + self.cross_po_per_g * a.o
                + two * self.cross_pp_per_g * a.p,
            o: self.cross_io_per_g * i - self.misalignment_pa_rad
                + self.cross_po_per_g * a.p
                + two * self.cross_oo_per_g * a.o,
        }
    }

    /// U(a) of (1), in V.
    #[inline]
    pub fn output_v(&self, a: SpecificForce<T>) -> T {
        self.scale_factor_v_per_g * self.output_g(a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The functions of the specific force (g) that the further coefficients multiply, in the order of
    /// [`Coefficients::to_further`]: a_I^5, sign(a_I), a_I |a_I|, a_P^2, a_O^2.
    fn further_terms(a: SpecificForce<f64>) -> [f64; FURTHER] {
        [
            a.i.powi(5),
            sign(a.i),
            a.i * a.i.abs(),
            a.p * a.p,
            a.o * a.o,
        ]
    }

    #[test]
    fn output_is_the_sum_of_terms_times_coefficients() {
        let c = [
            1.2, 1e-4, -6e-4, 4e-4, 3e-4, -5e-5, 4e-4, -6e-4, -5e-5, 3e-6, 5e-5,
        ];
        let further = [2e-6, 3e-4, -2e-4, 7e-5, -8e-5];
        let model = Coefficients::from_nominal(c).with_further(further);
        assert_eq!((model.to_nominal(), model.to_further()), (c, further));
        for a in [
            SpecificForce::new(0.3, -0.8, 0.5),
            SpecificForce::new(-4.0, 1.0, 2.0),
            SpecificForce::new(0.0, 0.0, 1.0),
        ] {
            let f = terms(a);
            let nominal = f[0] + (1..NOMINAL).map(|k| c[k] * f[k]).sum::<f64>();
            let added = further.iter().zip(further_terms(a)).map(|(c, f)| c * f);
            let sum = nominal + added.sum::<f64>();
            assert!((model.output_g(a) - sum).abs() < 4.0 * f64::EPSILON * sum.abs().max(1.0));
            assert_eq!(model.output_v(a), 1.2 * model.output_g(a));
        }
    }

    #[test]
    fn gradient_is_the_slope_of_the_output() {
        let model = Coefficients::<f64>::from_nominal([
            1.3, 1e-2, -6e-2, 4e-2, 3e-2, -5e-3, 4e-2, -6e-2, -5e-3, 3e-3, 5e-2,
        ])
        .with_further([2e-3, 3e-2, -2e-2, 7e-3, -8e-3]);
        let step = 1e-6;
        for a in [
            SpecificForce::new(0.3, -0.8, 0.5),
            SpecificForce::new(-1.4, 1.0, 2.0),
        ] {
            let slope = model.gradient(a);
            let along = |d: SpecificForce<f64>| {
                let at = |s: f64| {
                    model.output_g(SpecificForce::new(
                        a.i + s * d.i,
                        a.p + s * d.p,
                        a.o + s * d.o,
                    ))
                };
                (at(step) - at(-step)) / (2.0 * step)
            };
            assert!((slope.i - along(SpecificForce::new(1.0, 0.0, 0.0))).abs() < 1e-9);
            assert!((slope.p - along(SpecificForce::new(0.0, 1.0, 0.0))).abs() < 1e-9);
            assert!((slope.o - along(SpecificForce::new(0.0, 0.0, 1.0))).abs() < 1e-9);
        }
    }

    #[test]
    fn further_terms_are_off_unless_asked_for() {
        let a = SpecificForce::new(-2.0, 3.0, 4.0);
        let ideal = Coefficients::<f64>::default();
        assert_eq!(ideal.error_g(a), 0.0);
        for (k, term) in [-32.0, -1.0, -4.0, 9.0, 16.0].into_iter().enumerate() {
            let mut one = [0.0; FURTHER];
            one[k] = 1e-6;
            let error_g = ideal.with_further(one).error_g(a);
            assert!((error_g - 1e-6 * term).abs() < 1e-18, "{k}: {error_g:e}");
        }
    }

    #[test]
    fn bias_asymmetry_is_nothing_at_zero() {
        let model = Coefficients::<f64>::default().with_further([0.0, 1e-4, 0.0, 0.0, 0.0]);
        assert_eq!(model.error_g(SpecificForce::default()), 0.0);
    }
}
