//! What a fit leaves to further columns, once all its unknowns are eliminated from them.

use crate::dense::{Cholesky, inner_product};
use crate::fit::Fit;
use crate::model::SeparableModel;
use crate::observations::{Column, Observations};

/// Part of a column's information below which what is left of it is rounding.
const ROUNDING: f64 = 1e-7;

/// What a fit leaves.
pub struct Remainder<'m> {
    observations: &'m Observations,
    fit: &'m Fit,
    /// The fit's columns and residuals, uncertain rows by their precision.
    weighted: Vec<Column>,
    residual: Column,
    /// A fit that ended at the edge of a range leaves a slope; further columns must not be credited with it.
    slope: Vec<f64>,
}

impl<'m> Remainder<'m> {
    /// Of a fit of a model.
    pub fn new(model: &'m dyn SeparableModel, fit: &'m Fit) -> Self {
        let observations = model.observations();
        let factor = &fit.precision_factor;
        let residual = observations.column(fit.residuals.clone());
        let residual = observations.times(&residual, factor.iter().map(|f| f.sqrt()));
        let weighted = |column: &Column| observations.times(column, factor.iter().copied());
        Self {
            weighted: fit.columns.iter().map(weighted).collect(),
            slope: fit.columns.iter().map(|c| c.dot(&residual)).collect(),
            residual,
            observations,
            fit,
        }
    }

    /// Normal matrix, row by row, and right-hand side of further columns.
    pub(crate) fn normal(&self, columns: &[&Column]) -> (Vec<f64>, Vec<f64>) {
        let (n, k) = (self.weighted.len(), columns.len());
        let mut matrix = vec![0.0; k * k];
        let mut across = Vec::with_capacity(n * k);
        let mut right = Vec::with_capacity(k);
        for (j, column) in columns.iter().enumerate() {
            across.extend(self.weighted.iter().map(|c| c.dot(column)));
            let rows = self.fit.covariance.chunks_exact(n);
            let solved: Vec<f64> = rows
                .map(|row| inner_product(row, &across[j * n..]))
                .collect();
            right.push(column.dot(&self.residual) - inner_product(&solved, &self.slope));
            for i in 0..=j {
                let taken = inner_product(&across[i * n..(i + 1) * n], &solved);
                let factor = &self.fit.precision_factor;
                let whole = self.observations.dot(columns[i], column, factor);
                let mut value = whole - taken;
                if i == j && value < ROUNDING * whole {
                    value = 0.0;
                }
                matrix[i * k + j] = value;
                matrix[j * k + i] = value;
            }
        }
        (matrix, right)
    }

    /// Further columns together, scaled to unit information.
    pub(crate) fn family(&self, columns: &[&Column]) -> Family {
        let (mut matrix, mut right) = self.normal(columns);
        scale(&mut matrix, &mut right, columns.len());
        Family { matrix, right }
    }

    /// [`Family::gain`] of further columns.
    pub(crate) fn gain(&self, columns: &[&Column], size: f64) -> (f64, f64) {
        self.family(columns).gain(size)
    }

    /// Drop of chi-square by a column that is added as it is.
    pub(crate) fn fixed_gain(&self, column: &Column) -> f64 {
        let (matrix, right) = self.normal(&[column]);
        2.0 * right[0] - matrix[0]
    }

    /// Correlation of signatures, as far as the fit cannot imitate them; one that it imitates to rounding is like none.
    pub fn similarity(&self, signatures: &[&Column]) -> Vec<Vec<f64>> {
        let k = signatures.len();
        let (matrix, _) = self.normal(signatures);
        let left = |i: usize| Some(matrix[i * k + i].sqrt()).filter(|left| *left > 0.0);
        let like = |i: usize, j: usize| match (left(i), left(j)) {
            _ if i == j => 1.0,
            (Some(one), Some(other)) => (matrix[i * k + j] / (one * other)).clamp(-1.0, 1.0),
            _ => 0.0,
        };
        (0..k)
            .map(|i| (0..k).map(|j| like(i, j)).collect())
            .collect()
    }

    /// Length of a difference beyond what the fit can imitate.
    pub fn length(&self, difference: &Column) -> f64 {
        self.normal(&[difference]).0[0].max(0.0).sqrt()
    }
}

/// What a fit leaves to several columns together: their normal matrix and right-hand side, scaled to unit information.
pub(crate) struct Family {
    matrix: Vec<f64>,
    right: Vec<f64>,
}

impl Family {
    /// By how much the columns would lower chi-square, and how many of them count; the prior variance of each is `size` in
    /// units of its own information.
    pub(crate) fn gain(&self, size: f64) -> (f64, f64) {
        let Some(factor) = self.with_prior(size) else {
            return (0.0, 0.0);
        };
        let mut x = self.right.clone();
        factor.solve(&mut x);
        (
            inner_product(&x, &self.right),
            inner_product(&factor.inverse(), &self.matrix),
        )
    }

    /// Log evidence of the columns as random effects of a common, unknown size.
    pub(crate) fn something_else(&self) -> f64 {
        let k = self.right.len();
        if k == 0 {
            return f64::NEG_INFINITY;
        }
        let sizes = (0..12).map(|step| 10f64.powf(0.5 * f64::from(step)));
        let of_size = |size: f64| {
            // Evidence of x ~ N(0, size): exp(r' (M + 1/size)^-1 r / 2) / sqrt det(1 + size M).
            let factor = self.with_prior(size)?;
            let mut x = self.right.clone();
            factor.forward(&mut x);
            let gain = inner_product(&x, &x);
            Some(0.5 * (gain - factor.log_determinant() - k as f64 * size.ln()))
        };
        sizes.filter_map(of_size).fold(f64::NEG_INFINITY, f64::max) - 12f64.ln()
    }

    fn with_prior(&self, size: f64) -> Option<Cholesky> {
        let k = self.right.len();
        let mut matrix = self.matrix.clone();
        for i in 0..k {
            matrix[i * k + i] += 1.0 / size;
        }
        Cholesky::new(matrix, k)
    }
}

/// Scales columns to unit information.
fn scale(matrix: &mut [f64], right: &mut [f64], k: usize) {
    let size: Vec<f64> = (0..k)
        .map(|i| match matrix[i * k + i] {
            information if information > 0.0 => information.sqrt().recip(),
            _ => 0.0,
        })
        .collect();
    for i in 0..k {
        right[i] *= size[i];
        for j in 0..k {
            matrix[i * k + j] *= size[i] * size[j];
        }
    }
}

/// What the members of a fit add to the observations, whitened.
pub fn signature(model: &dyn SeparableModel, fit: &Fit) -> Column {
    let observations = model.observations();
    let observed = observations.observed().to_vec();
    let mut sum: Vec<f64> = observed.clone();
    for (sum, residual) in sum.iter_mut().zip(&fit.residuals) {
        *sum -= residual;
    }
    for (row, factor) in observations.uncertain().zip(&fit.precision_factor) {
        // Residuals are in units of the whole uncertainty.
        sum[row] = observed[row] - fit.residuals[row] / factor.sqrt();
    }
    for (column, x) in model.base().columns.iter().zip(&fit.base_values) {
        column.add_to(&mut sum, -x);
    }
    observations.column(sum)
}
