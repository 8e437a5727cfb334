//! A quadratic form over (1, unknowns): sums of squares of affine functions, which add up.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// A symmetric form; its first row and column belong to the constant 1.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Form {
    order: usize,
    /// Row by row, the whole matrix.
    elements: Vec<f64>,
}

impl Form {
    /// Nothing, over `order - 1` unknowns.
    pub fn zero(order: usize) -> Self {
        Self {
            order,
            elements: vec![0.0; order * order],
        }
    }

    /// Adds `factor` times `other`, whose k-th row and column stand at `places[k]` of this one.
    pub fn add(&mut self, other: &DMatrix<f64>, places: &[usize], factor: f64) {
        for (i, &row) in places.iter().enumerate() {
            for (j, &column) in places.iter().enumerate() {
                self.elements[row * self.order + column] += factor * other[(i, j)];
            }
        }
    }

    /// Adds `amount` to the constant.
    pub fn add_constant(&mut self, amount: f64) {
        self.elements[0] += amount;
    }

    /// Makes room for more unknowns at the end.
    pub fn grow(&mut self, order: usize) {
        if order > self.order {
            let old = std::mem::replace(self, Self::zero(order));
            let places: Vec<usize> = (0..old.order).collect();
            self.add(&old.matrix(), &places, 1.0);
        }
    }

    /// The matrix of the form.
    pub fn matrix(&self) -> DMatrix<f64> {
        DMatrix::from_row_slice(self.order, self.order, &self.elements)
    }
}
