//! Where to linearise first: the ellipsoid on which the outputs of a linear triad lie.
//!
//! With |a| = g and U = S a + U0 the outputs satisfy (U - U0)^T M (U - U0) = g^2, M = (S S^T)^-1. Nine numbers describe such
//! an ellipsoid, and they are linear in
//!
//! ```text
//! |v|^2 = p1 (x^2 - y^2) + p2 (x^2 + y^2 - 2 z^2) + p3 x y + p4 x z + p5 y z + b . v + c
//! ```
//!
//! with v the outputs over the nominal scale factor, from an origin near them. S is the Cholesky factor of M^-1 in the frame
//! where IA of x is x and IA of y lies in the plane of x and y. Biases of any size are found, as in codes of offset binary.
//! Nonlinearity is left out: what comes is good to its size.

use num_traits::Float;

use super::body::INSTRUMENTS;
use crate::identify::square_root::{FactorError, TriangularFactor, storage_len};
use crate::model::{Coefficients, NOMINAL};

/// Numbers of an ellipsoid.
const NUMBERS: usize = 9;

/// The outputs so far, as a factor over the ellipsoid's nine numbers.
#[derive(Clone, Debug)]
pub struct Ellipsoid {
    nominal_v_per_g: [f64; INSTRUMENTS],
    origin: Option<[f64; INSTRUMENTS]>,
    factor: TriangularFactor<f64, [f64; storage_len(NUMBERS)]>,
}

/// Least diagonal element of the factor, in terms of the largest, at which positions determine an ellipsoid. Chosen: a plane
/// leaves 1e-16, noise of 1e-4 on a plane 1e-4; ten orientations by hand some 0.05.
const LEAST_DIAGONAL: f64 = 1e-3;
/// Ratio of a scale factor to the nominal one beyond which the ellipsoid is none of this triad.
const MOST_SCALE: f64 = 4.0;

impl Ellipsoid {
    /// No outputs yet; the type's scale factors, V/g, of either sign, which the answer's have too.
    ///
    /// # Errors
    /// [`FactorError`] if the storage did not fit, which its type rules out.
    pub fn new(nominal_v_per_g: [f64; INSTRUMENTS]) -> Result<Self, FactorError> {
        Ok(Self {
            nominal_v_per_g,
            origin: None,
            factor: TriangularFactor::new(NUMBERS, [0.0; storage_len(NUMBERS)])?,
        })
    }

    /// Absorbs the outputs of a position, V.
    pub fn absorb(&mut self, outputs_v: [f64; INSTRUMENTS]) {
        let scaled: [f64; 3] = core::array::from_fn(|s| outputs_v[s] / self.nominal_v_per_g[s]);
        let origin = *self.origin.get_or_insert(scaled);
        let [x, y, z]: [f64; 3] = core::array::from_fn(|s| scaled[s] - origin[s]);
        self.factor.absorb(&mut [
            x * x - y * y,
            x * x + y * y - 2.0 * z * z,
            x * y,
            x * z,
            y * z,
            x,
            y,
            z,
            1.0,
            x * x + y * y + z * z,
        ]);
    }

    /// A linear triad on whose ellipsoid the outputs lie, `gravity_g` local gravity; `None` where the positions do not
    /// determine one, as in a plane or with fewer than nine.
    pub fn triad(&self, gravity_g: f64) -> Option<[Coefficients<f64>; INSTRUMENTS]> {
        let origin = self.origin?;
        let diagonal = |k| self.factor.row(k)[0].abs();
        let largest = (0..NUMBERS).map(diagonal).fold(0.0, f64::max);
        let told = |k| diagonal(k) > LEAST_DIAGONAL * largest;
        if !(0..NUMBERS).all(told) {
            return None;
        }
        let mut q = [0.0; NUMBERS];
        self.factor.solve(0, &mut q).ok()?;
        let [p1, p2, p3, p4, p5, b0, b1, b2, c] = q;
        let m = [
            [1.0 - p1 - p2, -p3 / 2.0, -p4 / 2.0],
            [-p3 / 2.0, 1.0 + p1 - p2, -p5 / 2.0],
            [-p4 / 2.0, -p5 / 2.0, 1.0 + 2.0 * p2],
        ];
        let inverse = inverse(&m)?;
        let b = [b0, b1, b2];
        let product = |v: [f64; 3]| inverse.map(|row| (0..3).map(|k| row[k] * v[k]).sum::<f64>());
        let centre = product(b).map(|x| x / 2.0);
        let radius_squared = c + (0..3).map(|k| centre[k] * b[k] / 2.0).sum::<f64>();
        // S S^T, in terms of the nominal scale factors.
        let square = inverse.map(|row| row.map(|x| x * radius_squared / (gravity_g * gravity_g)));
        let s = cholesky(&square)?;
        let scale = [s[0][0], s[1][1], s[2][2]];
        let possible = |x: &f64| (MOST_SCALE.recip()..MOST_SCALE).contains(x);
        if !scale.iter().all(possible) {
            return None;
        }
        // u_x = a_x + k0; u_y = a_y - d_PA a_x + k0; u_z = a_z + d_OA a_x - d_PA a_y + k0.
        let mut nominal = [[0.0; NOMINAL]; INSTRUMENTS];
        for (k, c) in nominal.iter_mut().enumerate() {
            c[0] = scale[k] * self.nominal_v_per_g[k];
            c[1] = (centre[k] + origin[k]) / scale[k];
        }
        nominal[1][7] = -s[1][0] / scale[1];
        nominal[2][6] = s[2][0] / scale[2];
        nominal[2][7] = -s[2][1] / scale[2];
        Some(nominal.map(Coefficients::from_nominal))
    }
}

/// Of a symmetric matrix, by its cofactors; `None` if it is not positive definite.
fn inverse(m: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let minor = |i: usize, j: usize| {
        let (r, s) = ((i + 1) % 3, (i + 2) % 3);
        let (c, d) = ((j + 1) % 3, (j + 2) % 3);
        m[r][c] * m[s][d] - m[r][d] * m[s][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    let definite = m[0][0] > 0.0 && minor(2, 2) > 0.0 && determinant > 0.0;
    definite.then(|| core::array::from_fn(|i| core::array::from_fn(|j| minor(j, i) / determinant)))
}

/// The lower triangle L of a positive definite matrix L L^T.
fn cholesky(a: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let mut l = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = if i == j {
                Float::sqrt(Some(sum).filter(|sum| *sum > 0.0)?)
            } else {
                sum / l[j][j]
            };
        }
    }
    Some(l)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::triad::body::{outputs_v, unit};

    fn direction(k: u32) -> [f64; 3] {
        // Points of a spiral over the sphere.
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 20.0;
        let (sin, cos) = (2.4 * f64::from(k)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        unit([r * cos, r * sin, z]).unwrap()
    }

    #[test]
    fn a_linear_triad_with_biases_of_many_g_comes_back() {
        let truth = [
            [415.0, 80.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [-420.0, 79.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0],
            [390.0, -3.0, 0.0, 0.0, 0.0, 0.0, -0.01, 0.03, 0.0, 0.0, 0.0],
        ];
        let instruments = truth.map(Coefficients::<f64>::from_nominal);
        let mut ellipsoid = Ellipsoid::new([413.0, -413.0, 413.0]).unwrap();
        for k in 0..20 {
            let body = direction(k).map(|u| 0.998 * u);
            ellipsoid.absorb(outputs_v(&instruments, body));
        }
        let found = ellipsoid.triad(0.998).unwrap();
        for (found, truth) in found.iter().zip(truth) {
            for (x, y) in found.to_nominal().iter().zip(truth) {
                assert!((x - y).abs() < 1e-9 * (1.0 + y.abs()), "{x} {y}");
            }
        }
    }

    #[test]
    fn a_plane_and_few_positions_give_no_ellipsoid() {
        let of = |count: u32, flat: f64| {
            let mut ellipsoid = Ellipsoid::new([1.0; 3]).unwrap();
            for k in 0..count {
                let [x, y, z] = direction(k);
                let body = unit([x, y, flat * z]).unwrap();
                ellipsoid.absorb(body);
            }
            ellipsoid.triad(1.0)
        };
        assert!(of(20, 1.0).is_some());
        assert_eq!(of(8, 1.0), None);
        assert_eq!(of(20, 0.0), None);
        assert_eq!(of(0, 1.0), None);
    }
}
