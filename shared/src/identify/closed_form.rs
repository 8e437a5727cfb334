//! The paper's closed formulas (10)-(17) for its own 24 positions.

use crate::model::Coefficients;
use crate::scalar::Real;

/// What the 24 voltages determine: ten numbers, not eleven.
///
/// On this plan |a_I| is 0, 1/sqrt2 or 1 only, so that k1', k2 and k4 enter every voltage through the two sums
/// E1 and E2 of (14): the system (14), (15) for them is singular, and this type does not pretend otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosedForm<T> {
    /// The coefficients, with the undetermined direction of (k1', k2, k4) set to zero: of all triples that
    /// satisfy (14) the one of least norm.
    pub coefficients: Coefficients<T>,
    /// (10), the scale factor before the correction for k3, V/g.
    pub approximate_scale_factor_v_per_g: T,
    /// (12), the asymmetry before the correction (13) for k2 and k4.
    pub approximate_asymmetry: T,
    /// (14), E1 = k1' + k2 + k4, in g.
    pub even_sum_at_one_g: T,
    /// (14), E2 = k1'/sqrt2 + k2/2 + k4/4, in g.
    pub even_sum_at_45_deg: T,
}

/// The unit direction of (k1', k2, k4) that no voltage of the paper's plan sees, in closed form: the cross product
/// of the two rows of (14).
pub fn paper_blind_direction<T: Real>() -> [T; 3] {
    let (h, q) = (T::FRAC_1_SQRT_2(), T::lit(0.25));
    let v = [q - T::lit(0.5), h - q, T::lit(0.5) - h];
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    // Of the two signs the one with k2 positive.
    v.map(|x| x / length)
}

/// Identifies from the voltages of the paper's 24 positions, `u_v[i - 1][j - 1]` = U_ij: series i = 1, 2, 3, dial
/// angle 45 deg (j - 1), j = 1..8; V.
///
/// `T` = `f64`; in `f32` the rounding of the voltages alone, 6e-8 of 1 g, comes back as some 1e-7 in every
/// coefficient.
pub fn identify<T: Real>(u_v: &[[T; 8]; 3]) -> ClosedForm<T> {
    let [one, two, three] = u_v;
    let sqrt2 = T::SQRT_2();
    let (n2, n4, n6) = (T::lit(2.0), T::lit(4.0), T::lit(6.0));

    // (10), (11): odd differences at 1 g and at 1/sqrt2 g.
    let straight = one[4] - one[0];
    let oblique = one[3] + one[5] - one[1] - one[7];
    let (d1, d2) = (straight / n2, oblique / (n2 * sqrt2));
    let k1 = n2 * d2 - d1;
    let k3 = n2 * (d1 - d2) / k1;

    // The positions at a_I = 0 of series 1 and 2; the mean of series 3, over which a_P and a_O vanish.
    let turn = three.iter().fold(T::zero(), |sum, u| sum + *u);
    let level = one[2] + one[6] + two[2] + two[6];
    let k0 = (level + turn / n4) / (n6 * k1);

    // (12), (14): even sums.
    let at_one = one[0] + one[4];
    let at_45 = one[1] + one[3] + one[5] + one[7];
    let even_sum_at_one_g = at_one / (n2 * k1) - k0;
    let even_sum_at_45_deg = at_45 / (n4 * k1) - k0;
    let [k1_prime, k2, k4] = least_norm(even_sum_at_one_g, even_sum_at_45_deg);

    // (16), (17).
    let coupling = |u: &[T; 8]| (u[3] - u[5] - u[1] + u[7]) / (n2 * k1);
    ClosedForm {
        coefficients: Coefficients {
            scale_factor_v_per_g: k1,
            bias_g: k0,
            asymmetry: k1_prime,
            second_order_per_g: k2,
            third_order_per_g2: k3,
            fourth_order_per_g3: k4,
            misalignment_oa_rad: (one[2] - one[6]) / (n2 * k1),
            misalignment_pa_rad: -(two[2] - two[6]) / (n2 * k1),
            cross_ip_per_g: coupling(one),
            cross_io_per_g: coupling(two),
            cross_po_per_g: coupling(three),
            ..Coefficients::default()
        },
        approximate_scale_factor_v_per_g: (straight + sqrt2 * oblique) / n6,
        approximate_asymmetry: (at_one + sqrt2 * at_45 - (n2 + n4 * sqrt2) * k1 * k0) / (n6 * k1),
        even_sum_at_one_g,
        even_sum_at_45_deg,
    }
}

/// The triple (k1', k2, k4) of least norm with k1' + k2 + k4 = e1 and k1'/sqrt2 + k2/2 + k4/4 = e2.
fn least_norm<T: Real>(e1: T, e2: T) -> [T; 3] {
    let (p, q) = (
        [T::one(); 3],
        [T::FRAC_1_SQRT_2(), T::lit(0.5), T::lit(0.25)],
    );
    let dot = |x: &[T; 3], y: &[T; 3]| x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    let (pp, pq, qq) = (dot(&p, &p), dot(&p, &q), dot(&q, &q));
    let determinant = pp * qq - pq * pq;
    let (s, t) = (
        (qq * e1 - pq * e2) / determinant,
        (pp * e2 - pq * e1) / determinant,
    );
    [
        s * p[0] + t * q[0],
        s * p[1] + t * q[1],
        s * p[2] + t * q[2],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tumble::{PAPER_ANGLES_DEG, Series};

    fn voltages(c: &Coefficients<f64>) -> [[f64; 8]; 3] {
        Series::ALL.map(|series| {
            PAPER_ANGLES_DEG
                .map(|deg| c.output_v(series.specific_force(num_traits::Float::to_radians(deg))))
        })
    }

    fn instrument() -> Coefficients<f64> {
        Coefficients::from_nominal([
            1.3, 1e-4, -6.2e-4, 3.9e-4, 2.7e-4, -4.9e-5, 3.8e-4, -6e-4, -4.6e-5, 2.6e-5, 5e-5,
        ])
    }

    #[test]
    fn everything_but_the_blind_direction_comes_back_exactly() {
        let truth = instrument();
        let found = identify(&voltages(&truth)).coefficients;
        let blind = paper_blind_direction::<f64>();
        for (k, (t, f)) in truth
            .to_nominal()
            .iter()
            .zip(found.to_nominal())
            .enumerate()
        {
            if !matches!(k, 2 | 3 | 5) {
                assert!((t - f).abs() < 1e-14, "coefficient {k}: {t} {f}");
            }
        }
        let missed = [
            truth.asymmetry - found.asymmetry,
            truth.second_order_per_g - found.second_order_per_g,
            truth.fourth_order_per_g3 - found.fourth_order_per_g3,
        ];
        let along: f64 = missed.iter().zip(blind).map(|(m, b)| m * b).sum();
        for (m, b) in missed.iter().zip(blind) {
            assert!(
                (m - along * b).abs() < 1e-14,
                "the miss lies along the blind direction"
            );
        }
        assert!(along.abs() > 1e-5, "and is not zero for this instrument");
    }

    #[test]
    fn published_blind_direction_is_seen_by_no_voltage() {
        let d = paper_blind_direction::<f64>();
        for (ours, published) in d.iter().zip([-0.4459, 0.8153, -0.3694]) {
            assert!((ours - published).abs() < 5e-5);
        }
        let mut moved = instrument();
        moved.asymmetry += 1e-2 * d[0];
        moved.second_order_per_g += 1e-2 * d[1];
        moved.fourth_order_per_g3 += 1e-2 * d[2];
        let (u, v) = (voltages(&instrument()), voltages(&moved));
        for (x, y) in u.iter().flatten().zip(v.iter().flatten()) {
            assert!((x - y).abs() < 1e-15);
        }
    }

    #[test]
    fn uncorrected_estimates_are_off_by_the_methods_own_error() {
        let (c, form) = (instrument(), identify(&voltages(&instrument())));
        let (k1, k3) = (c.scale_factor_v_per_g, c.third_order_per_g2);
        let error_11 = form.approximate_scale_factor_v_per_g - k1;
        assert!((error_11 - 2.0 / 3.0 * k1 * k3).abs() < 1e-14);
        let sqrt2 = core::f64::consts::SQRT_2;
        let (k2, k4) = (c.second_order_per_g, c.fourth_order_per_g3);
        let error_13 = form.approximate_asymmetry - c.asymmetry;
        assert!((error_13 - ((1.0 + sqrt2) * k2 + (1.0 + sqrt2 / 2.0) * k4) / 3.0).abs() < 1e-14);
    }

    #[test]
    fn single_precision_loses_what_identification_is_for() {
        let c = instrument();
        let rounded = voltages(&c).map(|series| series.map(|u| u as f32));
        let miss =
            f64::from(identify(&rounded).coefficients.third_order_per_g2) - c.third_order_per_g2;
        assert!(miss.abs() > 1e-8, "f32 is off by {miss}, f64 by 1e-15");
    }
}
