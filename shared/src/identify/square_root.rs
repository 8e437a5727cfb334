//! Weighted least squares by orthogonal transformations, one row at a time, in constant memory.
//!
//! The information of all rows so far is kept as an upper triangular factor R and a right-hand side z with
//! R x = z at the minimum; a new row is rotated in by Givens rotations and forgotten. No normal equations are
//! formed, so that nothing of the condition number is squared. Written after the square-root information
//! filter of Bierman, *Factorization Methods for Discrete Sequential Estimation*, 1977, ch. V.
//!
//! Unknowns that are put first can be left out of the answer: the trailing rows of R are the information on the
//! last unknowns alone, all others eliminated.

use crate::scalar::Real;

/// An upper triangular factor over `n` unknowns with its right-hand side, in storage of the caller: an array on the
/// instrument, a vector on the host.
#[derive(Clone, Debug)]
pub struct TriangularFactor<T, S> {
    unknowns: usize,
    /// Row by row the upper triangle, each row followed by its right-hand side.
    storage: S,
    residual_squares: T,
}

/// The number of numbers that a factor of `unknowns` keeps.
pub const fn storage_len(unknowns: usize) -> usize {
    unknowns * (unknowns + 1) / 2 + unknowns
}

/// Why a factor cannot answer or be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FactorError {
    /// Storage given and storage needed, in numbers.
    StorageTooSmall {
        /// Numbers given.
        given: usize,
        /// Numbers needed.
        needed: usize,
    },
    /// No row so far has determined this unknown.
    Undetermined {
        /// Index of the unknown.
        unknown: usize,
    },
    /// Rounding has left this unknown no positive variance.
    NoVariance {
        /// Index of the unknown.
        unknown: usize,
    },
}

impl core::fmt::Display for FactorError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::StorageTooSmall { given, needed } => {
                write!(
                    f,
                    "storage of {given} numbers is too small, {needed} are needed"
                )
            }
            Self::Undetermined { unknown } => write!(f, "unknown {unknown} is not determined"),
            Self::NoVariance { unknown } => {
                write!(f, "rounding leaves unknown {unknown} no positive variance")
            }
        }
    }
}

impl core::error::Error for FactorError {}

impl<T: Real, S: AsRef<[T]> + AsMut<[T]>> TriangularFactor<T, S> {
    /// An empty factor.
    ///
    /// # Errors
    /// [`FactorError::StorageTooSmall`] if `storage` holds fewer than [`storage_len`] numbers.
    pub fn new(unknowns: usize, mut storage: S) -> Result<Self, FactorError> {
        let (given, needed) = (storage.as_ref().len(), storage_len(unknowns));
        if given < needed {
            return Err(FactorError::StorageTooSmall { given, needed });
        }
        storage.as_mut()[..needed].fill(T::zero());
        Ok(Self {
            unknowns,
            storage,
            residual_squares: T::zero(),
        })
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        let needed = storage_len(self.unknowns);
        self.storage.as_mut()[..needed].fill(T::zero());
        self.residual_squares = T::zero();
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Row `k` of R from its diagonal on, followed by z_k: `unknowns - k + 1` numbers.
    pub fn row(&self, k: usize) -> &[T] {
        let start = self.start(k);
        &self.storage.as_ref()[start..start + self.unknowns - k + 1]
    }

    /// The sum of squares that no choice of the unknowns removes: chi-square of whitened rows.
    pub fn residual_squares(&self) -> T {
        self.residual_squares
    }

    /// Absorbs one whitened row (divided by its standard uncertainty): `row` holds the coefficients of the
    /// `unknowns` and, last, the right-hand side. The row is used up as work space.
    ///
    /// # Panics
    /// If `row` has not `unknowns + 1` numbers.
    pub fn absorb(&mut self, row: &mut [T]) {
        let n = self.unknowns;
        assert_eq!(
            row.len(),
            n + 1,
            "a row holds every unknown and the right-hand side"
        );
        for k in 0..n {
            let b = row[k];
            if b == T::zero() {
                continue;
            }
            let start = self.start(k);
            let kept = &mut self.storage.as_mut()[start..start + n - k + 1];
            let new = &mut row[k..];
            let a = kept[0];
            // Not hypot: a square root is the same on every processor, to the last bit.
            let length = (a * a + b * b).sqrt();
            if length == T::zero() {
                continue; // Too small for its square, and so for any answer.
            }
            let (cos, sin) = (a / length, b / length);
            kept[0] = length;
            for (r, x) in kept[1..].iter_mut().zip(&mut new[1..]) {
                let (old_r, old_x) = (*r, *x);
                *r = cos * old_r + sin * old_x;
                *x = cos * old_x - sin * old_r;
            }
        }
        self.residual_squares += row[n] * row[n];
    }

    /// Solves R x = z for the unknowns from `first` on into `x` (`unknowns - first` numbers), all unknowns before
    /// `first` eliminated.
    ///
    /// # Errors
    /// [`FactorError::Undetermined`] if a diagonal element is zero: a rank deficiency that rounding has not
    /// hidden. Judge the rank by [`blindness`](super::blindness) first.
    pub fn solve(&self, first: usize, x: &mut [T]) -> Result<(), FactorError> {
        for k in (first..self.unknowns).rev() {
            let row = self.row(k);
            let diagonal = row[0];
            if diagonal == T::zero() {
                return Err(FactorError::Undetermined { unknown: k });
            }
            let mut sum = row[row.len() - 1];
            for (r, x) in row[1..].iter().zip(&x[k + 1 - first..]) {
                sum -= *r * *x;
            }
            x[k - first] = sum / diagonal;
        }
        Ok(())
    }

    /// The trailing N x N block of R and its right-hand side: the information on the last N unknowns alone.
    ///
    /// # Panics
    /// If N is more than the number of unknowns.
    pub fn trailing<const N: usize>(&self) -> ([[T; N]; N], [T; N]) {
        let first = self.unknowns - N;
        let (mut r, mut z) = ([[T::zero(); N]; N], [T::zero(); N]);
        for k in 0..N {
            let row = self.row(first + k);
            r[k][k..].copy_from_slice(&row[..N - k]);
            z[k] = row[N - k];
        }
        (r, z)
    }

    fn start(&self, k: usize) -> usize {
        // Rows 0..k hold n+1, n, ... numbers.
        k * (self.unknowns + 1) - k * k.saturating_sub(1) / 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 4;

    fn noise(seed: &mut u64) -> f64 {
        *seed = seed
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (*seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    #[test]
    fn least_squares_leaves_a_residual_orthogonal_to_every_column() {
        let mut seed = 7;
        let mut factor = TriangularFactor::new(N, [0.0f64; storage_len(N)]).unwrap();
        let rows: std::vec::Vec<[f64; N + 1]> = (0..30)
            .map(|_| core::array::from_fn(|_| noise(&mut seed)))
            .collect();
        for row in &rows {
            factor.absorb(&mut row.clone());
        }
        let mut x = [0.0; N];
        factor.solve(0, &mut x).unwrap();
        let residual = |r: &[f64; N + 1]| r[N] - (0..N).map(|k| r[k] * x[k]).sum::<f64>();
        for k in 0..N {
            let along: f64 = rows.iter().map(|r| r[k] * residual(r)).sum();
            assert!(along.abs() < 1e-13, "column {k}: {along}");
        }
        let squares: f64 = rows.iter().map(|r| residual(r).powi(2)).sum();
        assert!((factor.residual_squares() - squares).abs() < 1e-13);
    }

    #[test]
    fn trailing_unknowns_are_the_same_with_the_leading_ones_eliminated() {
        let mut seed = 99;
        let mut factor = TriangularFactor::new(N, [0.0f64; storage_len(N)]).unwrap();
        for _ in 0..9 {
            factor.absorb(&mut core::array::from_fn::<f64, { N + 1 }, _>(|_| {
                noise(&mut seed)
            }));
        }
        let (mut all, mut last) = ([0.0; N], [0.0; 2]);
        factor.solve(0, &mut all).unwrap();
        factor.solve(2, &mut last).unwrap();
        assert_eq!(all[2..], last);
        let (r, z) = factor.trailing::<2>();
        assert!((r[1][1] * last[1] - z[1]).abs() < 1e-15);
        assert!((r[0][0] * last[0] + r[0][1] * last[1] - z[0]).abs() < 1e-15);
        assert_eq!(r[1][0], 0.0);
    }

    #[test]
    fn too_little_storage_and_too_few_rows_are_errors() {
        assert_eq!(
            TriangularFactor::new(3, [0.0f32; 8]).unwrap_err(),
            FactorError::StorageTooSmall {
                given: 8,
                needed: 9
            }
        );
        let mut factor = TriangularFactor::new(2, [0.0f64; 5]).unwrap();
        factor.absorb(&mut [1.0, 0.0, 3.0]);
        assert_eq!(
            factor.solve(0, &mut [0.0; 2]),
            Err(FactorError::Undetermined { unknown: 1 })
        );
    }
}
