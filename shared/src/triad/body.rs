//! Body axes, and the outputs of three instruments on one body.

use serde::{Deserialize, Serialize};

use crate::model::{Coefficients, SpecificForce};
use crate::scalar::Real;

/// Instruments of a triad.
pub const INSTRUMENTS: usize = 3;

/// An axis of the body, and the instrument whose input axis is nominally along it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// IA, PA, OA along x, y, z.
    X,
    /// IA, PA, OA along y, z, x.
    Y,
    /// IA, PA, OA along z, x, y.
    Z,
}

impl Axis {
    /// The three axes in order.
    pub const ALL: [Self; INSTRUMENTS] = [Self::X, Self::Y, Self::Z];

    /// 0, 1, 2.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Its name, a letter.
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }

    /// A vector on the body axes (x, y, z), g, on this instrument's axes.
    pub fn on_instrument<T: Real>(self, body: [T; 3]) -> SpecificForce<T> {
        let s = self.index();
        SpecificForce::new(body[s], body[(s + 1) % 3], body[(s + 2) % 3])
    }
}

/// Outputs, V, of three instruments at a specific force on the body axes, g.
pub fn outputs_v<T: Real>(
    instruments: &[Coefficients<T>; INSTRUMENTS],
    body_g: [T; 3],
) -> [T; INSTRUMENTS] {
    Axis::ALL.map(|axis| instruments[axis.index()].output_v(axis.on_instrument(body_g)))
}

/// Steps of the inversion at the most: each shrinks the error by the size of misalignments and nonlinearity, so that 5 %
/// leave 1e-39 after 30.
const STEPS: usize = 30;

/// The specific force on the body axes, g, that gives these outputs, V: the three output models (1) inverted together.
/// `None` where the inversion does not settle: no such triad gives these outputs.
pub fn specific_force_g<T: Real>(
    instruments: &[Coefficients<T>; INSTRUMENTS],
    outputs_v: [T; INSTRUMENTS],
) -> Option<[T; 3]> {
    let linear: [T; 3] =
        core::array::from_fn(|s| outputs_v[s] / instruments[s].scale_factor_v_per_g);
    let mut body = linear;
    for _ in 0..STEPS {
        let next = Axis::ALL.map(|axis| {
            let s = axis.index();
            linear[s] - instruments[s].error_g(axis.on_instrument(body))
        });
        if !next.iter().all(|x| x.is_finite()) {
            return None;
        }
        let size = linear
            .iter()
            .chain(&next)
            .fold(T::one(), |m, x| m.max(x.abs()));
        let moved = (0..3).fold(T::zero(), |m, s| m.max((next[s] - body[s]).abs()));
        body = next;
        if moved <= T::lit(4.0) * T::epsilon() * size {
            return Some(body);
        }
    }
    None
}

/// Inner product of two vectors on the body axes.
pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The unit vector along another; `None` if that has no length.
pub(crate) fn unit(a: [f64; 3]) -> Option<[f64; 3]> {
    let length = num_traits::Float::sqrt(dot(a, a));
    (length > 0.0 && length.is_finite()).then(|| a.map(|x| x / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inversion_gives_back_the_specific_force() {
        let instruments = [
            [
                1.2, 0.3, -6e-3, 4e-3, 3e-3, -5e-4, 0.03, -0.02, -5e-4, 3e-4, 5e-4,
            ],
            [
                -0.9, -8.1, 2e-3, 1e-3, -3e-3, 5e-4, 0.01, 0.04, 5e-4, 3e-4, 5e-4,
            ],
            [415.0, 0.0, 0.0, 4e-3, 0.0, 0.0, -0.02, 0.05, 0.0, 0.0, 0.0],
        ]
        .map(Coefficients::<f64>::from_nominal);
        let body = [0.48, -0.6, 0.64];
        let found = specific_force_g(&instruments, outputs_v(&instruments, body)).unwrap();
        for s in 0..3 {
            assert!((found[s] - body[s]).abs() < 1e-13, "{found:?}");
        }
    }

    #[test]
    fn outputs_that_no_triad_gives_have_no_specific_force() {
        let bent = Coefficients::<f64>::from_nominal([
            1.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        ]);
        assert_eq!(specific_force_g(&[bent; 3], [-1.0, 0.2, 0.1]), None);
        assert_eq!(specific_force_g(&[bent; 3], [f64::NAN, 0.2, 0.1]), None);
    }
}
