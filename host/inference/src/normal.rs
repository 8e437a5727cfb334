//! Normal equations of a linear model.

use crate::dense::inner_product;
use crate::observations::Column;

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
    pub(crate) fn absorb_weighted(
        &mut self,
        columns: &[Column],
        observed: &Column,
        rows: std::ops::Range<usize>,
        factor: &[f64],
    ) {
        let n = columns.len();
        let weighted = |column: &Column| -> Vec<f64> {
            let values = column.part(rows.clone());
            let weighted = values.iter().zip(factor);
            weighted.map(|(value, factor)| value * factor).collect()
        };
        let y = &observed.part(rows.clone());
        for (i, column) in columns.iter().enumerate() {
            let weighted = weighted(column);
            self.right[i] += inner_product(&weighted, y);
            for (j, other) in columns[..=i].iter().enumerate() {
                self.matrix[i * n + j] += inner_product(&weighted, &other.part(rows.clone()));
            }
        }
        self.square += inner_product(&weighted(observed), y);
    }
}
