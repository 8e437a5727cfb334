//! Dense matrices: a symmetric positive definite one, factored.

use nalgebra::linalg;
use nalgebra::{DMatrix, DVectorView, DVectorViewMut, Dyn};

/// A symmetric positive definite matrix, factored: lower triangle L of L L^T.
#[derive(Clone, Debug)]
pub struct Cholesky(linalg::Cholesky<f64, Dyn>);

impl Cholesky {
    /// Factors `matrix` (row by row, `order` squared numbers, the lower triangle counts); `None` if it is not positive
    /// definite.
    pub fn new(matrix: Vec<f64>, order: usize) -> Option<Self> {
        let matrix = DMatrix::from_row_slice(order, order, &matrix);
        linalg::Cholesky::new(matrix).map(Self)
    }

    /// Solves for one right-hand side, in place.
    pub fn solve(&self, x: &mut [f64]) {
        let rows = x.len();
        self.0.solve_mut(&mut DVectorViewMut::from_slice(x, rows));
    }

    /// L^-1 x, in place.
    pub fn forward(&self, x: &mut [f64]) {
        let rows = x.len();
        self.0
            .l_dirty()
            .solve_lower_triangular_unchecked_mut(&mut DVectorViewMut::from_slice(x, rows));
    }

    /// L x, in place: of standard normal numbers, ones with the matrix as their covariance.
    pub fn times(&self, x: &mut [f64]) {
        let lower = self.0.l();
        let product = lower * DVectorView::from_slice(x, x.len());
        x.copy_from_slice(product.as_slice());
    }

    /// Logarithm of the determinant.
    pub fn log_determinant(&self) -> f64 {
        self.0.ln_determinant()
    }

    /// Of a variable with this matrix as its precision: the standard deviation of element `i` where all later ones are known
    /// and no earlier one is.
    pub(crate) fn sigma_given_later(&self, i: usize) -> f64 {
        1.0 / self.0.l_dirty()[(i, i)]
    }

    /// The inverse, row by row.
    pub fn inverse(&self) -> Vec<f64> {
        // Symmetric: rows are columns.
        self.0.inverse().as_slice().to_vec()
    }
}

/// L^-T of a lower triangle L.
pub(crate) fn inverse_transposed(lower: &DMatrix<f64>) -> DMatrix<f64> {
    let order = lower.nrows();
    // Its columns are the rows of L^-1: each is a unit less multiples of those above.
    let mut columns = vec![0.0; order * order];
    for i in 0..order {
        let (above, own) = columns.split_at_mut(i * order);
        for (column, factor) in above.chunks_exact(order).zip(&lower.row(i)) {
            for (own, value) in own[..i].iter_mut().zip(column) {
                *own -= factor * value;
            }
        }
        own[i] = 1.0;
        own[..=i]
            .iter_mut()
            .for_each(|value| *value /= lower[(i, i)]);
    }
    DMatrix::from_vec(order, order, columns)
}

/// Sum of products.
#[inline]
pub fn inner_product(x: &[f64], y: &[f64]) -> f64 {
    DVectorView::from_slice(x, x.len()).dot(&DVectorView::from_slice(y, y.len()))
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

    #[test]
    fn a_lower_triangle_times_its_inverse_is_the_identity() {
        let lower = DMatrix::from_row_slice(3, 3, &[2.0, 0.0, 0.0, 0.5, 3.0, 0.0, -1.0, 0.7, 1.5]);
        let product = &lower * inverse_transposed(&lower).transpose();
        assert!((product - DMatrix::identity(3, 3)).amax() < 1e-15);
    }
}
