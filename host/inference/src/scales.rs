//! How far the stated sizes of several independent errors hold, which correlated rows share in different ways: restricted
//! maximum likelihood (Patterson and Thompson, Biometrika 58, 1971), by Fisher's scoring.
//!
//! Of the rows nothing counts but what lies beyond all unknowns, z = K^T r with K^T X = 0. Its covariance is that of the errors
//! whose size is not in question, and a factor times that of each other one.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::dense::inverse_transposed;

/// Least part of an unknown's column beside the others that counts as its own.
const LEAST_LEFT: f64 = 1e-8;
/// Most steps, greatest step of a variance's logarithm, and the step, in standard deviations, at which the search ends.
const STEPS: usize = 60;
const LONGEST: f64 = 1.0;
const SETTLED: f64 = 0.01;
/// Bounds of a variance's logarithm: a hundred times the stated standard deviation, and a hundredth of it.
const BOUND: f64 = 9.21;

/// What of some correlated rows all unknowns take: an orthonormal base of it.
pub struct Beyond {
    rows: usize,
    taken: Vec<DVector<f64>>,
}

impl Beyond {
    /// Of so many rows; `unknowns` are the whitened columns of all that was or may be fitted.
    pub fn new(rows: usize, unknowns: &[Vec<f64>]) -> Self {
        let mut taken: Vec<DVector<f64>> = Vec::new();
        for unknown in unknowns {
            let column = DVector::from_column_slice(unknown);
            let least = LEAST_LEFT * column.norm();
            extend(&mut taken, column, least);
        }
        Self { rows, taken }
    }

    /// Of each error the factor on its stated standard deviation, with the factor's relative standard uncertainty.
    /// `residuals` are whitened by the stated covariance, and `parts` what each error adds to the whitened covariance, no more than
    /// the identity in sum. `None` where nothing tells them, or by the first step none is off by its standard deviations in
    /// `doubt` (score test).
    pub fn scales(
        &self,
        residuals: &[f64],
        parts: &[DMatrix<f64>],
        doubt: &[f64],
    ) -> Option<Vec<(f64, f64)>> {
        if self.taken.len() >= self.rows || parts.is_empty() {
            return None;
        }
        if self.as_stated(residuals, parts)?.nothing_off_by(doubt) {
            return None;
        }
        let base = self.base();
        let z = &base * DVector::from_column_slice(residuals);
        let transposed = base.transpose();
        let inside = |part: &DMatrix<f64>| &base * (part * &transposed);
        let parts: Vec<DMatrix<f64>> = parts.iter().map(inside).collect();
        let all = DMatrix::identity(z.len(), z.len());
        let fixed = parts.iter().fold(all, |rest, part| rest - part);
        let mut logarithms = vec![0.0_f64; parts.len()];
        let mut scoring = Scoring::new(&fixed, &parts, &z, &logarithms)?;
        for _ in 0..STEPS {
            let step = scoring.step();
            for (logarithm, step) in logarithms.iter_mut().zip(step.iter()) {
                *logarithm = (*logarithm + step.clamp(-LONGEST, LONGEST)).clamp(-BOUND, BOUND);
            }
            scoring = Scoring::new(&fixed, &parts, &z, &logarithms)?;
            if scoring.nothing_off_by(&vec![SETTLED; parts.len()]) {
                break;
            }
        }
        let scale = |(k, logarithm): (usize, &f64)| {
            let relative = 0.5 * scoring.inverse[(k, k)].max(0.0).sqrt();
            ((0.5 * logarithm).exp(), relative)
        };
        Some(logarithms.iter().enumerate().map(scale).collect())
    }

    /// What is taken, column by column.
    fn taken(&self) -> DMatrix<f64> {
        match self.taken.as_slice() {
            [] => DMatrix::zeros(self.rows, 0),
            taken => DMatrix::from_columns(taken),
        }
    }

    /// An orthonormal base of what lies beyond the unknowns, row by row: what Householder's reflections that take the unknowns to
    /// the first axes take to the others.
    fn base(&self) -> DMatrix<f64> {
        let mut all = DMatrix::identity(self.rows, self.rows);
        let count = self.taken.len();
        if count > 0 {
            self.taken().qr().q_tr_mul(&mut all);
        }
        all.rows(count, self.rows - count).into_owned()
    }

    /// The scoring where the whole covariance is the identity, without that base: with the projection P = 1 - Q Q^T for K K^T.
    fn as_stated(&self, residuals: &[f64], parts: &[DMatrix<f64>]) -> Option<Scoring> {
        let taken = self.taken();
        let residuals = DVector::from_column_slice(residuals);
        let left = &residuals - &taken * taken.tr_mul(&residuals);
        let across: Vec<DMatrix<f64>> = parts.iter().map(|part| part * &taken).collect();
        let transposed = taken.transpose();
        let within: Vec<DMatrix<f64>> = across.iter().map(|a| &transposed * a).collect();
        let gradient = |(k, part): (usize, &DMatrix<f64>)| {
            0.5 * (left.dot(&(part * &left)) - (part.trace() - within[k].trace()))
        };
        let gradient = DVector::from_iterator(parts.len(), parts.iter().enumerate().map(gradient));
        // Parts are symmetric: the trace of a product is the inner product.
        let information = DMatrix::from_fn(parts.len(), parts.len(), |k, l| {
            let outside = parts[k].dot(&parts[l]) - 2.0 * across[k].dot(&across[l]);
            0.5 * (outside + within[k].dot(&within[l]))
        });
        Scoring::of(gradient, information)
    }
}

/// Gradient and inverse information of the logarithms of the variances.
struct Scoring {
    gradient: DVector<f64>,
    inverse: DMatrix<f64>,
}

impl Scoring {
    /// `None` if the information is singular.
    fn of(gradient: DVector<f64>, information: DMatrix<f64>) -> Option<Self> {
        let inverse = Cholesky::new(information)?.inverse();
        Some(Self { gradient, inverse })
    }

    /// `None` if a covariance or the information is singular.
    fn new(
        fixed: &DMatrix<f64>,
        parts: &[DMatrix<f64>],
        z: &DVector<f64>,
        logarithms: &[f64],
    ) -> Option<Self> {
        let scaled: Vec<DMatrix<f64>> = parts
            .iter()
            .zip(logarithms)
            .map(|(part, logarithm)| part * logarithm.exp())
            .collect();
        let covariance = scaled.iter().fold(fixed.clone(), |sum, part| sum + part);
        let inverse = inverse(covariance)?;
        let weighed = &inverse * z;
        let relative: Vec<DMatrix<f64>> = scaled.iter().map(|part| &inverse * part).collect();
        let gradient = scaled
            .iter()
            .zip(&relative)
            .map(|(part, relative)| 0.5 * (weighed.dot(&(part * &weighed)) - relative.trace()));
        let gradient = DVector::from_iterator(parts.len(), gradient);
        let information = DMatrix::from_fn(parts.len(), parts.len(), |k, l| {
            // The trace of the product.
            0.5 * relative[k].dot(&relative[l].transpose())
        });
        Self::of(gradient, information)
    }

    fn step(&self) -> DVector<f64> {
        &self.inverse * &self.gradient
    }

    /// Whether no variance is its standard deviations in `doubt` off.
    fn nothing_off_by(&self, doubt: &[f64]) -> bool {
        let step = self.step();
        let sigma = |k: usize| self.inverse[(k, k)].max(0.0).sqrt();
        (0..step.len()).all(|k| step[k].abs() < doubt[k] * sigma(k))
    }
}

/// Of a symmetric positive definite matrix.
fn inverse(matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let upper = inverse_transposed(&Cholesky::new(matrix)?.unpack());
    let transposed = upper.transpose();
    Some(upper * transposed)
}

/// Adds to an orthonormal base what of a column lies beyond it, if that is longer than `least`.
fn extend(base: &mut Vec<DVector<f64>>, mut column: DVector<f64>, least: f64) {
    // Twice is enough (Parlett and Kahan).
    for _ in 0..2 {
        for known in base.iter() {
            let part = known.dot(&column);
            column.axpy(-part, known, 1.0);
        }
    }
    let size = column.norm();
    if size > least {
        base.push(column / size);
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::*;

    const ROWS: usize = 60;
    const GROUP: usize = 3;

    /// Whitened covariances of own errors (60 % of a variance) and of errors that three rows share (40 %), and the
    /// lower triangle that whitens them: both as they are stated.
    fn stated() -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
        let own = DMatrix::identity(ROWS, ROWS) * 0.6;
        let shared = DMatrix::from_fn(ROWS, ROWS, |i, j| match i / GROUP == j / GROUP {
            true => 0.4,
            false => 0.0,
        });
        let whole = Cholesky::new(&own + &shared).unwrap().unpack();
        (own, shared, whole)
    }

    #[test]
    fn factors_are_found_with_the_uncertainty_that_is_stated() {
        const TRUE: [f64; 2] = [1.6, 3.0];
        const CAMPAIGNS: usize = 400;
        let (own, shared, lower) = stated();
        let whitened = |part: &DMatrix<f64>| {
            let half = lower.solve_lower_triangular(part).unwrap();
            lower.solve_lower_triangular(&half.transpose()).unwrap()
        };
        let parts = [whitened(&own), whitened(&shared)];
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let slope = |i: usize| i as f64 / ROWS as f64;
        let unknowns: Vec<Vec<f64>> = (0..4)
            .map(|power| (0..ROWS).map(|i| slope(i).powi(power)).collect())
            .map(|column: Vec<f64>| {
                let column = DVector::from_vec(column);
                lower
                    .solve_lower_triangular(&column)
                    .unwrap()
                    .as_slice()
                    .to_vec()
            })
            .collect();
        let (mut squares, mut sums) = ([0.0; 2], [0.0; 2]);
        for _ in 0..CAMPAIGNS {
            let mut draw = || -> f64 { random.sample(StandardNormal) };
            let groups: Vec<f64> = (0..ROWS / GROUP).map(|_| 0.4_f64.sqrt() * draw()).collect();
            let errors = (0..ROWS).map(|i| {
                TRUE[0] * 0.6_f64.sqrt() * draw() + TRUE[1] * groups[i / GROUP] + 7.0 * slope(i)
            });
            let errors = DVector::from_iterator(ROWS, errors);
            let residuals = lower.solve_lower_triangular(&errors).unwrap();
            let beyond = Beyond::new(ROWS, &unknowns);
            let found = beyond
                .scales(residuals.as_slice(), &parts, &[1.0; 2])
                .unwrap();
            for k in 0..2 {
                let z = (found[k].0 / TRUE[k]).ln() / found[k].1;
                squares[k] += z * z / CAMPAIGNS as f64;
                sums[k] += z / CAMPAIGNS as f64;
            }
        }
        for k in 0..2 {
            // The mean square of 400 has a spread of 0.07, their mean one of 0.05.
            assert!((squares[k] - 1.0).abs() < 0.3, "{k}: {squares:?}");
            assert!(sums[k].abs() < 0.3, "{k}: {sums:?}");
        }
    }

    #[test]
    fn nothing_is_said_of_what_no_row_tells() {
        let one = Beyond::new(1, &[vec![1.0]]);
        assert_eq!(one.scales(&[1.0], &[DMatrix::identity(1, 1)], &[0.0]), None);
        let two = Beyond::new(2, &[vec![1.0, 1.0]]);
        // A residual of its stated size.
        assert_eq!(
            two.scales(&[0.7, -0.7], &[DMatrix::identity(2, 2)], &[1.0]),
            None
        );
    }
}
