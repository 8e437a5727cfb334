//! What a static test cannot tell: rank, condition number and blind directions.
//!
//! Twice. [`Design`] judges the positions alone: its matrix has a row of [`terms`] for each. [`Visibility::of_readings`]
//! judges what the readings of a test add to what is known beforehand: a direction in which they hardly narrow the
//! standard deviations stated before the first reading is blind, however it came about, be it by angles that nearly
//! coincide, by the dial's errors or by noise.
//!
//! Singular values come from one-sided Jacobi rotations (Hestenes 1958), which find small ones to high relative accuracy.

use crate::identify::square_root::{TriangularFactor, storage_len};
use crate::model::{NOMINAL, SpecificForce, terms};
use crate::scalar::Real;

/// The design matrix of a plan, position by position, in constant memory.
#[derive(Clone, Debug)]
pub struct Design<T> {
    factor: TriangularFactor<T, [T; storage_len(NOMINAL)]>,
    positions: usize,
}

/// From this condition number on positions are of deficient rank, in `f64`: rounding of 2e-16 then comes back as 2e-4 of
/// the largest coefficient.
pub const DEFICIENT_CONDITION: f64 = 1e12;

/// Standard deviations about zero of an instrument's coefficients before the first reading, in the order of
/// [`Coefficients::to_nominal`](crate::model::Coefficients::to_nominal); K1's is about the type's value, in terms of it.
/// For the terms that rectify about the root mean square of the source paper's Table 1; bias and misalignments, which
/// differ more and rectify nothing, as wide as any instrument of the kind.
pub const BEFOREHAND: [f64; NOMINAL] = [
    0.5, 0.02, 5e-4, 5e-4, 5e-4, 5e-4, 0.05, 0.05, 5e-4, 5e-4, 5e-4,
];

/// Least ratio of the standard deviation beforehand to that of the readings alone at which a direction is determined.
/// Below it the readings narrow what was known by less than 5 %: 1 / sqrt(1 + 1/9) = 0.95.
pub const LEAST_GAIN: f64 = 1.0 / 3.0;

/// Component of a blind unit vector below which a coefficient does not take part in it, both as the vector stands and in
/// units of the standard deviations beforehand. Chosen: a mount that is off by an angle tilts a blind direction by about
/// as much, and none is off by 2 deg; and a coefficient that is known to 3 % of what was known beforehand is determined.
/// What such a coefficient shares with the direction stays in its variance.
pub const NEGLIGIBLE: f64 = 0.03;

/// What a static test determines.
#[derive(Clone, Debug, PartialEq)]
pub struct Visibility<T> {
    /// Number of directions in coefficient space that are determined, 0 ..= 11.
    pub rank: usize,
    /// Ratio of the largest to the smallest of the eleven singular values of the positions' design matrix; beyond
    /// [`DEFICIENT_CONDITION`] (or infinite) for positions of deficient rank.
    pub condition: T,
    /// Orthonormal blind directions in the rows from `rank` on.
    blind: [[T; NOMINAL]; NOMINAL],
}

impl<T: Real> Visibility<T> {
    /// Judges readings by their information: `triangle` is the upper triangular factor of whitened rows on K1 times
    /// (1, coefficients), `scale_v_per_g` about K1, `beforehand` as [`BEFOREHAND`]. The `condition` is that of the
    /// positions.
    pub fn of_readings(
        triangle: &[[T; NOMINAL]; NOMINAL],
        scale_v_per_g: T,
        beforehand: &[T; NOMINAL],
        condition: T,
    ) -> Self {
        // In units of the standard deviations beforehand the singular values are the gains.
        let unit = beforehand.map(|sigma| sigma * scale_v_per_g);
        let scaled = triangle.map(|row| core::array::from_fn(|k| row[k] * unit[k]));
        let (gains, directions) = singular_values(scaled);
        let least = (gains[0] * T::epsilon() * T::lit(64.0)).max(T::lit(LEAST_GAIN));
        let rank = gains.iter().filter(|gain| **gain >= least).count();
        let mut blind = directions;
        for direction in &mut blind[rank..] {
            let negligible = T::lit(NEGLIGIBLE);
            let length = (0..NOMINAL)
                .fold(T::zero(), |sum, k| sum + (direction[k] * unit[k]).powi(2))
                .sqrt();
            *direction = core::array::from_fn(|k| {
                let component = direction[k] * unit[k];
                let takes_part =
                    direction[k].abs() >= negligible && component.abs() >= negligible * length;
                if takes_part { component } else { T::zero() }
            });
        }
        orthonormalise(&mut blind[rank..]);
        Self {
            rank,
            condition,
            blind,
        }
    }

    /// The directions that are blind, as unit vectors with the largest component positive. Components in the order of
    /// [`Coefficients::to_nominal`](crate::model::Coefficients::to_nominal), the first for K1, the others for K1 times
    /// the coefficient.
    pub fn blind_directions(&self) -> &[[T; NOMINAL]] {
        &self.blind[self.rank..]
    }

    /// Whether the coefficient of this index is determined.
    pub fn determines(&self, coefficient: usize) -> bool {
        self.blind_directions()
            .iter()
            .all(|d| d[coefficient].abs() < T::lit(NEGLIGIBLE))
    }
}

/// Gram-Schmidt, twice over for the sake of rounding.
fn orthonormalise<T: Real>(vectors: &mut [[T; NOMINAL]]) {
    for k in 0..vectors.len() {
        let (before, rest) = vectors.split_at_mut(k);
        let vector = &mut rest[0];
        for _ in 0..2 {
            for other in before.iter() {
                let along = dot(vector, other);
                for (x, o) in vector.iter_mut().zip(other) {
                    *x -= along * *o;
                }
            }
            let length = dot(vector, vector).sqrt();
            *vector = vector.map(|x| x / length);
        }
        *vector = largest_component_positive(*vector);
    }
}

impl<T: Real> Default for Design<T> {
    fn default() -> Self {
        let factor = TriangularFactor::new(NOMINAL, [T::zero(); storage_len(NOMINAL)]);
        Self {
            factor: factor.expect("the array has the length asked for"),
            positions: 0,
        }
    }
}

impl<T: Real> Design<T> {
    /// Adds a position at which the specific force is `a`, g.
    pub fn absorb(&mut self, a: SpecificForce<T>) {
        let mut row = [T::zero(); NOMINAL + 1];
        row[..NOMINAL].copy_from_slice(&terms(a));
        self.factor.absorb(&mut row);
        self.positions += 1;
    }

    /// Whether any position so far has a specific force along IA, beyond rounding: without, nothing tells the scale
    /// factor even if all other coefficients were known.
    pub fn sees_input_axis(&self) -> bool {
        self.factor.row(0)[0].abs() > T::lit(1e-6)
    }

    /// Rank, condition and directions of all positions so far.
    pub fn visibility(&self) -> Visibility<T> {
        let (triangle, _) = self.factor.trailing::<NOMINAL>();
        let (values, blind) = singular_values(triangle);
        // Rounding leaves a blind direction some eps sqrt(positions) of the largest value.
        let rounding = T::epsilon() * T::from_i64(64 + self.positions as i64);
        let tolerance = values[0] * rounding.max(T::lit(DEFICIENT_CONDITION.recip()));
        Visibility {
            rank: values.iter().filter(|v| **v > tolerance).count(),
            condition: values[0] / values[NOMINAL - 1],
            blind,
        }
    }
}

/// Singular values of a square matrix, given by rows, in falling order, and the right singular vectors.
pub fn singular_values<T: Real, const N: usize>(rows: [[T; N]; N]) -> ([T; N], [[T; N]; N]) {
    // One-sided Jacobi on the columns of A: `column[k]` becomes A v_k, `v[k]` the right singular vector.
    let mut column: [[T; N]; N] = core::array::from_fn(|k| core::array::from_fn(|i| rows[i][k]));
    let mut v: [[T; N]; N] = core::array::from_fn(|k| {
        core::array::from_fn(|i| if i == k { T::one() } else { T::zero() })
    });
    for _sweep in 0..60 {
        let mut turned = false;
        for p in 0..N {
            for q in p + 1..N {
                turned |= orthogonalise(&mut column, &mut v, p, q);
            }
        }
        if !turned {
            break;
        }
    }
    let mut order: [usize; N] = core::array::from_fn(|k| k);
    let norm = column.map(|c| dot(&c, &c).sqrt());
    order.sort_unstable_by(|x, y| {
        norm[*y]
            .partial_cmp(&norm[*x])
            .unwrap_or(core::cmp::Ordering::Equal)
    });
    (
        order.map(|k| norm[k]),
        order.map(|k| largest_component_positive(v[k])),
    )
}

fn dot<T: Real, const N: usize>(x: &[T; N], y: &[T; N]) -> T {
    x.iter().zip(y).fold(T::zero(), |sum, (a, b)| sum + *a * *b)
}

fn largest_component_positive<T: Real, const N: usize>(x: [T; N]) -> [T; N] {
    let largest = x
        .iter()
        .fold(T::zero(), |m, c| if c.abs() > m.abs() { *c } else { m });
    if largest < T::zero() {
        x.map(|c| -c)
    } else {
        x
    }
}

/// Turns columns p and q so that they are orthogonal; whether there was anything to turn.
fn orthogonalise<T: Real, const N: usize>(
    column: &mut [[T; N]; N],
    v: &mut [[T; N]; N],
    p: usize,
    q: usize,
) -> bool {
    let (pp, qq) = (dot(&column[p], &column[p]), dot(&column[q], &column[q]));
    let pq = dot(&column[p], &column[q]);
    // The second bound stops columns that are zero but for rounding from turning for ever.
    if pq.abs() <= T::epsilon() * (pp * qq).sqrt() || pq.abs() < T::min_positive_value() {
        return false;
    }
    let zeta = (qq - pp) / (pq + pq);
    let t = zeta.signum() / (zeta.abs() + (T::one() + zeta * zeta).sqrt());
    let cos = (T::one() + t * t).sqrt().recip();
    let sin = cos * t;
    for matrix in [column, v] {
        for i in 0..N {
            let (x, y) = (matrix[p][i], matrix[q][i]);
            matrix[p][i] = cos * x - sin * y;
            matrix[q][i] = sin * x + cos * y;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::closed_form::paper_blind_direction;
    use crate::tumble::{Position, Series, full_rank_plan, paper_plan};

    fn visibility(plan: impl Iterator<Item = Position>) -> Visibility<f64> {
        let mut design = Design::default();
        plan.for_each(|p| design.absorb(p.specific_force()));
        design.visibility()
    }

    #[test]
    fn papers_plan_has_rank_ten_and_the_published_blind_direction() {
        let seen = visibility(paper_plan());
        assert_eq!(seen.rank, 10);
        assert!(seen.condition > 1e12);
        let d = seen.blind_directions()[0];
        for (k, published) in [(2, -0.4459), (3, 0.8153), (5, -0.3694)] {
            assert!((d[k] - published).abs() < 5e-5);
            assert!(!seen.determines(k));
        }
        let exact = paper_blind_direction::<f64>();
        assert!((d[2] * exact[0] + d[3] * exact[1] + d[5] * exact[2] - 1.0).abs() < 1e-12);
        for k in [0, 1, 4, 6, 7, 8, 9, 10] {
            assert!(seen.determines(k), "coefficient {k}");
        }
    }

    #[test]
    fn sixteen_added_positions_give_full_rank_at_condition_80() {
        let seen = visibility(full_rank_plan());
        assert_eq!(seen.rank, NOMINAL);
        assert!(
            (seen.condition - 80.0).abs() < 5.0,
            "condition {}",
            seen.condition
        );
    }

    #[test]
    fn multiples_of_22_5_deg_give_full_rank_at_condition_65() {
        let fine = [Series::OutputAxis, Series::PendulousAxis]
            .into_iter()
            .flat_map(|series| {
                (0..8).map(move |k| Position {
                    series,
                    dial_deg: 22.5 + 45.0 * f64::from(k),
                    mount_deg: 0.0,
                })
            });
        let seen = visibility(paper_plan().chain(fine));
        assert_eq!(seen.rank, NOMINAL);
        assert!(
            (seen.condition - 65.0).abs() < 5.0,
            "condition {}",
            seen.condition
        );
    }

    #[test]
    fn positions_that_nearly_coincide_are_of_deficient_rank() {
        for (spread_deg, rank) in [(1e-3, NOMINAL), (1e-13, 10)] {
            let plan = paper_plan().enumerate().map(|(k, p)| Position {
                dial_deg: p.dial_deg + spread_deg * (k % 5) as f64,
                ..p
            });
            let seen = visibility(plan);
            assert_eq!(seen.rank, rank, "condition {}", seen.condition);
            assert_eq!(seen.condition > DEFICIENT_CONDITION, rank < NOMINAL);
        }
    }

    #[test]
    fn singular_values_of_a_known_product_come_back() {
        // A = U diag(5, 2, 1e-9) V^T with two plane rotations.
        let rotate = |m: [[f64; 3]; 3], p: usize, q: usize, angle: f64, left: bool| {
            let mut r = m;
            let (s, c) = (angle.sin(), angle.cos());
            for k in 0..3 {
                if left {
                    r[p][k] = c * m[p][k] - s * m[q][k];
                    r[q][k] = s * m[p][k] + c * m[q][k];
                } else {
                    r[k][p] = c * m[k][p] - s * m[k][q];
                    r[k][q] = s * m[k][p] + c * m[k][q];
                }
            }
            r
        };
        let mut m = [[5.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1e-9]];
        for (p, q, angle, left) in [
            (0, 1, 0.7, true),
            (1, 2, -1.1, true),
            (0, 2, 0.4, false),
            (0, 1, 2.0, false),
        ] {
            m = rotate(m, p, q, angle, left);
        }
        let (values, _) = singular_values(m);
        for (found, truth) in values.iter().zip([5.0, 2.0, 1e-9]) {
            assert!((found - truth).abs() < 1e-15 * 5.0, "{found} {truth}");
        }
    }
}
