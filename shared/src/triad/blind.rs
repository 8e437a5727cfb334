//! What no attitude can tell of a triad, by name.
//!
//! Without any prior of the attitude the information in a position is sum_s u_s e_s(u), e_s the error of instrument s. On the
//! unit sphere it is blind to eight of 33 directions:
//!
//! * three rotations of the body's frame: a rotation about z is d_OA of x with d_PA of y;
//! * one an axis, since 1 = x^2 + y^2 + z^2: the bias of x with its k2, k_IO of y and k_IP of z, and cyclically. Bias and k2
//!   are apart only as far as the cross-couplings are known;
//! * two differences of the three k_PO, whose terms are all x y z.

use super::attitude::UNKNOWNS;
use super::body::{Axis, INSTRUMENTS};
use crate::model::NOMINAL;

/// Places of the coefficients in the order of [`Coefficients::to_nominal`](crate::model::Coefficients::to_nominal).
const BIAS: usize = 1;
const SECOND: usize = 3;
const MISALIGNMENT_OA: usize = 6;
const MISALIGNMENT_PA: usize = 7;
const CROSS_IP: usize = 8;
const CROSS_IO: usize = 9;
const CROSS_PO: usize = 10;

/// Number of directions that no attitude can tell.
pub const UNTOLD: usize = 8;

/// The unknown of a coefficient (its place) of an instrument.
pub const fn unknown(axis: Axis, coefficient: usize) -> usize {
    axis.index() * NOMINAL + coefficient
}

/// The three misalignments that are zero by the choice of a frame where no attitude is known: IA of x is x, IA of y lies in
/// the plane of x and y.
pub const FRAME: [usize; 3] = [
    unknown(Axis::X, MISALIGNMENT_OA),
    unknown(Axis::X, MISALIGNMENT_PA),
    unknown(Axis::Y, MISALIGNMENT_OA),
];

/// The directions that no attitude can tell, as orthonormal vectors over the 33 coefficients: rotations about z, x, y; bias
/// with k2 of x, y, z; two differences of the k_PO.
pub fn untold() -> [[f64; UNKNOWNS]; UNTOLD] {
    let mut found = [[0.0; UNKNOWNS]; UNTOLD];
    for (s, axis) in Axis::ALL.into_iter().enumerate() {
        let (next, after) = (
            Axis::ALL[(s + 1) % INSTRUMENTS],
            Axis::ALL[(s + 2) % INSTRUMENTS],
        );
        let half = core::f64::consts::FRAC_1_SQRT_2;
        found[s][unknown(axis, MISALIGNMENT_OA)] = half;
        found[s][unknown(next, MISALIGNMENT_PA)] = half;
        let with_bias = &mut found[INSTRUMENTS + s];
        with_bias[unknown(axis, BIAS)] = 0.5;
        with_bias[unknown(axis, SECOND)] = -0.5;
        with_bias[unknown(next, CROSS_IO)] = -0.5;
        with_bias[unknown(after, CROSS_IP)] = -0.5;
    }
    let sixth = 1.0 / num_traits::Float::sqrt(6.0);
    for (s, axis) in Axis::ALL.into_iter().enumerate() {
        let k = unknown(axis, CROSS_PO);
        let half = core::f64::consts::FRAC_1_SQRT_2;
        found[2 * INSTRUMENTS][k] = [half, -half, 0.0][s];
        found[2 * INSTRUMENTS + 1][k] = [sixth, sixth, -2.0 * sixth][s];
    }
    found
}
