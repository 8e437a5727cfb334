//! Small dense symmetric systems.

/// A symmetric positive definite matrix, factored in place: lower triangle L of L L^T.
#[derive(Clone, Debug)]
pub struct Cholesky {
    order: usize,
    lower: Vec<f64>,
}

impl Cholesky {
    /// Factors `matrix` (row by row, `order` squared numbers); `None` if it is not positive definite.
    pub fn new(mut matrix: Vec<f64>, order: usize) -> Option<Self> {
        for j in 0..order {
            for i in j..order {
                let mut sum = matrix[i * order + j];
                for k in 0..j {
                    sum -= matrix[i * order + k] * matrix[j * order + k];
                }
                if i == j {
                    if sum.is_nan() || sum <= 0.0 {
                        return None;
                    }
                    matrix[i * order + i] = sum.sqrt();
                } else {
                    matrix[i * order + j] = sum / matrix[j * order + j];
                }
            }
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
            let mut sum = x[i];
            for k in i + 1..n {
                sum -= self.lower[k * n + i] * x[k];
            }
            x[i] = sum / self.lower[i * n + i];
        }
    }

    /// L^-1 x, in place.
    pub fn forward(&self, x: &mut [f64]) {
        let n = self.order;
        for i in 0..n {
            let mut sum = x[i];
            for k in 0..i {
                sum -= self.lower[i * n + k] * x[k];
            }
            x[i] = sum / self.lower[i * n + i];
        }
    }

    /// Logarithm of the determinant.
    pub fn log_determinant(&self) -> f64 {
        (0..self.order)
            .map(|i| 2.0 * self.lower[i * self.order + i].ln())
            .sum()
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
