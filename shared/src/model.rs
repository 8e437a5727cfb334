//! The output model of IEEE Std 1293 as the paper uses it, equation (1).
//!
//! ```text
//! U = K1 [ k0 + a_I + k1' |a_I| + k2 a_I^2 + k3 a_I^3 + k4 a_I^4 (+ k5 a_I^5)
//!          + d_OA a_P - d_PA a_O + k_IP a_I a_P + k_IO a_I a_O + k_PO a_P a_O ]
//! ```
//!
//! The model is linear in `K1` times (1, coefficients): [`terms`] gives the functions of the specific
//! force that multiply them, and everything that fits, predicts or propagates uncertainty is built on it.

use serde::{Deserialize, Serialize};

use crate::scalar::Real;

/// Number of coefficients of the nominal model, without the optional fifth order.
pub const NOMINAL: usize = 11;

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
/// IEEE 1293 writes the asymmetry as K1'/2: its K1' is twice [`asymmetry`](Self::asymmetry).
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
    /// Fifth-order nonlinearity, 1/g^4; zero unless asked for.
    #[doc(alias = "k5")]
    pub fifth_order_per_g4: T,
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

impl<T: Real> Coefficients<T> {
    /// From the eleven coefficients of the nominal model in the order of `vre-identification/1`: K1, k0,
    /// k1', k2, k3, k4, d_OA, d_PA, k_IP, k_IO, k_PO; k5 = 0.
    pub fn from_nominal(c: [T; NOMINAL]) -> Self {
        Self {
            scale_factor_v_per_g: c[0],
            bias_g: c[1],
            asymmetry: c[2],
            second_order_per_g: c[3],
            third_order_per_g2: c[4],
            fourth_order_per_g3: c[5],
            fifth_order_per_g4: T::zero(),
            misalignment_oa_rad: c[6],
            misalignment_pa_rad: c[7],
            cross_ip_per_g: c[8],
            cross_io_per_g: c[9],
            cross_po_per_g: c[10],
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
        // Horner in a_I, the cross-couplings folded into the linear term.
        let i = a.i;
        let powers = i
            * (self.cross_ip_per_g * a.p
                + self.cross_io_per_g * a.o
                + i * (self.second_order_per_g
                    + i * (self.third_order_per_g2
                        + i * (self.fourth_order_per_g3 + i * self.fifth_order_per_g4))));
        self.bias_g + self.asymmetry * i.abs() + powers + self.misalignment_oa_rad * a.p
            - self.misalignment_pa_rad * a.o
            + self.cross_po_per_g * a.p * a.o
    }

    /// Derivatives of u(a) = U/K1 by the three components of the specific force, dimensionless.
    ///
    /// At a_I = 0 the asymmetry's kink counts as flat.
    #[inline]
    pub fn gradient(&self, a: SpecificForce<T>) -> SpecificForce<T> {
        let i = a.i;
        let (two, three, four, five) = (T::lit(2.0), T::lit(3.0), T::lit(4.0), T::lit(5.0));
        let sign = if i == T::zero() {
            T::zero()
        } else {
            i.signum()
        };
        let powers = i
            * (two * self.second_order_per_g
                + i * (three * self.third_order_per_g2
                    + i * (four * self.fourth_order_per_g3 + i * five * self.fifth_order_per_g4)));
        SpecificForce {
            i: T::one()
                + self.asymmetry * sign
                + powers
                + self.cross_ip_per_g * a.p
                + self.cross_io_per_g * a.o,
            p: self.misalignment_oa_rad + self.cross_ip_per_g * i + self.cross_po_per_g * a.o,
            o: self.cross_io_per_g * i - self.misalignment_pa_rad + self.cross_po_per_g * a.p,
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

    #[test]
    fn output_is_the_sum_of_terms_times_coefficients() {
        let c = [
            1.2, 1e-4, -6e-4, 4e-4, 3e-4, -5e-5, 4e-4, -6e-4, -5e-5, 3e-6, 5e-5,
        ];
        let model = Coefficients::from_nominal(c);
        assert_eq!(model.to_nominal(), c);
        for a in [
            SpecificForce::new(0.3, -0.8, 0.5),
            SpecificForce::new(-4.0, 1.0, 2.0),
            SpecificForce::new(0.0, 0.0, 1.0),
        ] {
            let f = terms(a);
            let sum = f[0] + (1..NOMINAL).map(|k| c[k] * f[k]).sum::<f64>();
            assert!((model.output_g(a) - sum).abs() < 4.0 * f64::EPSILON * sum.abs().max(1.0));
            assert_eq!(model.output_v(a), 1.2 * model.output_g(a));
        }
    }

    #[test]
    fn gradient_is_the_slope_of_the_output() {
        let mut model = Coefficients::<f64>::from_nominal([
            1.3, 1e-2, -6e-2, 4e-2, 3e-2, -5e-3, 4e-2, -6e-2, -5e-3, 3e-3, 5e-2,
        ]);
        model.fifth_order_per_g4 = 2e-3;
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
    fn fifth_order_is_off_unless_asked_for() {
        let a = SpecificForce::new(-2.0, 0.0, 0.0);
        let mut model = Coefficients::<f64>::default();
        assert_eq!(model.error_g(a), 0.0);
        model.fifth_order_per_g4 = 1e-6;
        assert!((model.error_g(a) + 32e-6).abs() < 1e-18);
    }
}
