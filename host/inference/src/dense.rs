//! Dense matrices: a symmetric positive definite one, factored.

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
