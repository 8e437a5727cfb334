//! The linear part: least squares over the unknowns of a base and further columns.

use crate::model::{Base, Prediction, SeparableModel};
use crate::observations::{Column, Observations};

/// A symmetric positive definite matrix, factored in place: lower triangle L of L L^T.
#[derive(Clone, Debug)]
pub struct Cholesky {
    order: usize,
    lower: Vec<f64>,
}

impl Cholesky {
    /// Factors `matrix` (row by row, `order` squared numbers, the lower triangle counts); `None` if it is not positive
    /// definite.
    pub fn new(mut matrix: Vec<f64>, order: usize) -> Option<Self> {
        for i in 0..order {
            let (above, row) = matrix.split_at_mut(i * order);
            for j in 0..i {
                let other = &above[j * order..=j * order + j];
                row[j] = (row[j] - inner_product(&row[..j], &other[..j])) / other[j];
            }
            let left = row[i] - inner_product(&row[..i], &row[..i]);
            if left.is_nan() || left <= 0.0 {
                return None;
            }
            row[i] = left.sqrt();
        }
        Some(Self {
            order,
            lower: matrix,
        })
    }

    /// Solves for one right-hand side, in place.
    pub fn solve(&self, x: &mut [f64]) {
        self.forward(x);
        let n = self.order;
        for i in (0..n).rev() {
            let row = &self.lower[i * n..=i * n + i];
            x[i] /= row[i];
            let known = x[i];
            for (x, l) in x[..i].iter_mut().zip(row) {
                *x -= l * known;
            }
        }
    }

    /// L^-1 x, in place.
    pub fn forward(&self, x: &mut [f64]) {
        for (i, row) in self.lower.chunks_exact(self.order.max(1)).enumerate() {
            x[i] = (x[i] - inner_product(&row[..i], &x[..i])) / row[i];
        }
    }

    /// L x, in place: of standard normal numbers, ones with the matrix as their covariance.
    pub fn times(&self, x: &mut [f64]) {
        for (i, row) in self.lower.chunks_exact(self.order.max(1)).enumerate().rev() {
            x[i] = inner_product(&row[..=i], &x[..=i]);
        }
    }

    /// Logarithm of the determinant.
    pub fn log_determinant(&self) -> f64 {
        (0..self.order)
            .map(|i| 2.0 * self.lower[i * self.order + i].ln())
            .sum()
    }

    /// Of a variable with this matrix as its precision: the standard deviation of element `i` where all later ones are known
    /// and no earlier one is.
    pub(crate) fn sigma_given_later(&self, i: usize) -> f64 {
        1.0 / self.lower[i * self.order + i]
    }

    /// The inverse, row by row.
    pub fn inverse(&self) -> Vec<f64> {
        let n = self.order;
        let mut inverse = vec![0.0; n * n];
        for i in 0..n {
            let column = &mut inverse[i * n..(i + 1) * n];
            column[i] = 1.0;
            self.solve(column);
        }
        inverse
    }
}

/// Sum of products, by eight independent accumulators, so that the loop vectorises.
#[inline]
pub fn inner_product(x: &[f64], y: &[f64]) -> f64 {
    const LANES: usize = 8;
    let (x_lanes, x_rest) = x.as_chunks::<LANES>();
    let (y_lanes, y_rest) = y.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (x, y) in x_lanes.iter().zip(y_lanes) {
        for k in 0..LANES {
            sums[k] += x[k] * y[k];
        }
    }
    let rest: f64 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f64>() + rest
}

/// Normal equations of a base's unknowns, prior included.
#[derive(Clone, Debug)]
pub(crate) struct Normal {
    /// Matrix, row by row, lower triangle.
    pub(crate) matrix: Vec<f64>,
    pub(crate) right: Vec<f64>,
    /// Sum of squares of the observations.
    pub(crate) square: f64,
}

impl Normal {
    /// Of the prior alone.
    pub(crate) fn prior(precision: &[f64], mean: &[f64]) -> Self {
        let n = precision.len();
        let mut matrix = vec![0.0; n * n];
        let (mut right, mut square) = (vec![0.0; n], 0.0);
        for i in 0..n {
            matrix[i * n + i] = precision[i];
            right[i] = precision[i] * mean[i];
            square += right[i] * mean[i];
        }
        Self {
            matrix,
            right,
            square,
        }
    }

    /// Adds rows that count alike.
    pub(crate) fn absorb(
        &mut self,
        columns: &[Column],
        observed: &Column,
        rows: std::ops::Range<usize>,
    ) {
        let n = columns.len();
        for (i, column) in columns.iter().enumerate() {
            self.right[i] += column.dot_within(observed, rows.clone());
            for (j, other) in columns[..=i].iter().enumerate() {
                self.matrix[i * n + j] += column.dot_within(other, rows.clone());
            }
        }
        self.square += observed.dot_within(observed, rows);
    }

    /// Adds rows that count by factors.
    fn absorb_weighted(
        &mut self,
        columns: &[Column],
        observed: &Column,
        rows: std::ops::Range<usize>,
        factor: &[f64],
    ) {
        let n = columns.len();
        let weighted = |column: &Column| -> Vec<f64> {
            let values = column.values[rows.clone()].iter().zip(factor);
            values.map(|(value, factor)| value * factor).collect()
        };
        let y = &observed.values[rows.clone()];
        for (i, column) in columns.iter().enumerate() {
            let weighted = weighted(column);
            self.right[i] += inner_product(&weighted, y);
            for (j, other) in columns[..=i].iter().enumerate() {
                self.matrix[i * n + j] += inner_product(&weighted, &other.values[rows.clone()]);
            }
        }
        self.square += inner_product(&weighted(observed), y);
    }

    /// Of a base whose columns are `columns`, each uncertain row counting by its precision factor.
    pub(crate) fn of(
        observations: &Observations,
        base: &Base,
        columns: &[Column],
        precision_factor: &[f64],
    ) -> Self {
        let mut normal = base.still.clone();
        let uncertain = observations.uncertain();
        for observable in observations.transforming() {
            if observable.rows != uncertain {
                normal.absorb(columns, observations.observed(), observable.rows.clone());
            }
        }
        normal.absorb_weighted(
            columns,
            observations.observed(),
            uncertain,
            precision_factor,
        );
        normal
    }
}

/// How much each uncertain row counts, and the normal equations of the base as it is under that.
pub(crate) struct Weighing {
    pub(crate) precision_factor: Vec<f64>,
    untransformed: Normal,
}

impl Weighing {
    pub(crate) fn new(model: &dyn SeparableModel, precision_factor: Vec<f64>) -> Self {
        let (observations, base) = (model.observations(), model.base());
        let untransformed = Normal::of(observations, base, &base.columns, &precision_factor);
        Self {
            precision_factor,
            untransformed,
        }
    }
}

/// A solved linear problem.
pub(crate) struct Solution {
    pub(crate) x: Vec<f64>,
    /// -2 log likelihood at it, priors included.
    pub(crate) objective: f64,
    pub(crate) factor: Cholesky,
}

/// Solves for the unknowns of the base and all in proportion, and for small changes along `derivatives`; `precision` is
/// the prior's on what is in proportion, then on those.
pub(crate) fn solve(
    model: &dyn SeparableModel,
    prediction: &Prediction,
    derivatives: &[Column],
    precision: &[f64],
    weighing: &Weighing,
) -> Option<Solution> {
    let (observations, base) = (model.observations(), model.base());
    let factor = &weighing.precision_factor;
    let transformed = prediction.transformed(base, observations);
    let normal = transformed.map(|columns| Normal::of(observations, base, columns, factor));
    let normal = normal.as_ref().unwrap_or(&weighing.untransformed);
    let base_columns = transformed.unwrap_or(&base.columns);
    let linear = prediction.linear().map(|(column, _)| column);
    let further: Vec<&Column> = linear.chain(derivatives).collect();
    let (of_base, n) = (base.columns.len(), base.columns.len() + further.len());
    let columns = || base_columns.iter().chain(further.iter().copied());
    let mut matrix = vec![0.0; n * n];
    for i in 0..of_base {
        let row = &normal.matrix[i * of_base..=i * of_base + i];
        matrix[i * n..=i * n + i].copy_from_slice(row);
    }
    let mut x = normal.right.clone();
    for (i, column) in further.iter().enumerate() {
        let row = &mut matrix[(of_base + i) * n..][..=of_base + i];
        for (value, other) in row.iter_mut().zip(columns()) {
            *value = observations.dot(column, other, factor);
        }
        row[of_base + i] += precision[i];
        x.push(observations.dot(column, observations.observed(), factor));
    }
    let mut square = normal.square;
    if let Some(offset) = prediction.offset() {
        for (x, column) in x.iter_mut().zip(columns()) {
            *x -= observations.dot(offset, column, factor);
        }
        square += observations.dot(offset, offset, factor);
        square -= 2.0 * observations.dot(offset, observations.observed(), factor);
    }
    let right = x.clone();
    let factor = Cholesky::new(matrix, n)?;
    factor.solve(&mut x);
    let explained: f64 = x.iter().zip(&right).map(|(x, r)| x * r).sum();
    Some(Solution {
        x,
        objective: square - explained,
        factor,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_times_matrix_is_the_identity() {
        let matrix = vec![4.0, 2.0, 0.6, 2.0, 5.0, 1.0, 0.6, 1.0, 3.0];
        let factor = Cholesky::new(matrix.clone(), 3).unwrap();
        let inverse = factor.inverse();
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| inverse[i * 3 + k] * matrix[k * 3 + j]).sum();
                assert!((product - f64::from(u8::from(i == j))).abs() < 1e-14);
            }
        }
        let determinant = 4.0 * (15.0 - 1.0) - 2.0 * (6.0 - 0.6) + 0.6 * (2.0 - 3.0);
        assert!((factor.log_determinant() - f64::ln(determinant)).abs() < 1e-14);
        assert!(Cholesky::new(vec![1.0, 2.0, 2.0, 1.0], 2).is_none());
    }
}
