//! Errors of predictions of rows that a fit did not use: the normal equations less those rows, linear about the fit.

use crate::dense::Cholesky;
use crate::fit::Fit;
use crate::model::SeparableModel;

/// With the rows `left_out` taken away from a fit, the error of its prediction of each difference of two rows (the first less
/// the second), in the observations' unit. `None` if the rest does not determine the fit.
pub fn held_out(
    model: &dyn SeparableModel,
    fit: &Fit,
    left_out: &[usize],
    differences: &[(usize, usize)],
) -> Option<Vec<f64>> {
    let observations = model.observations();
    let (n, uncertain) = (fit.columns.len(), observations.uncertain());
    let root = |row: usize| match uncertain.contains(&row) {
        true => fit.precision_factor[row - uncertain.start].sqrt(),
        false => 1.0,
    };
    let mut matrix = Cholesky::new(fit.covariance.clone(), n)?.inverse();
    let mut right = vec![0.0; n];
    for &row in left_out {
        let root = root(row);
        let x: Vec<f64> = fit.columns.iter().map(|c| c.at(row) * root).collect();
        for i in 0..n {
            right[i] -= x[i] * fit.residuals[row];
            for j in 0..n {
                matrix[i * n + j] -= x[i] * x[j];
            }
        }
    }
    let factor = Cholesky::new(matrix, n)?;
    factor.solve(&mut right);
    let error = |&(plus, minus): &(usize, usize)| {
        let [p, m] = [plus, minus].map(|row| observations.weight(row));
        let x = fit.columns.iter().map(|c| c.at(plus) / p - c.at(minus) / m);
        let residual =
            fit.residuals[plus] / (p * root(plus)) - fit.residuals[minus] / (m * root(minus));
        residual - x.zip(&right).map(|(x, d)| x * d).sum::<f64>()
    };
    Some(differences.iter().map(error).collect())
}
