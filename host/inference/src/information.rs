//! How much further observations are expected to tell about which hypothesis holds.

use crate::dense::Cholesky;
use crate::fit::{Fit, tangent};
use crate::model::SeparableModel;
use crate::observations::Column;

/// Squared distance, in units of noise, of what each fit predicts in `model`'s observations from the nearest that each other
/// one can say. The model may hold more uncertain rows than the fits know: their precision counts as stated.
pub fn separations(model: &dyn SeparableModel, fits: &[&Fit]) -> Vec<Vec<f64>> {
    let says: Vec<_> = fits
        .iter()
        .map(|fit| tangent(model, &fit.members, &fit.base_values))
        .collect();
    let distance = |truth: usize, other: usize| {
        if truth == other {
            return 0.0;
        }
        let (columns, imitates) = &says[other];
        let difference = says[truth].1.iter().zip(imitates).map(|(a, b)| a - b);
        let difference = model.observations().column(difference.collect());
        unlike(model, &difference, columns, &fits[truth].precision_factor)
    };
    let all = 0..fits.len();
    all.clone()
        .map(|truth| all.clone().map(|other| distance(truth, other)).collect())
        .collect()
}

/// Squared length of a difference beyond what `columns` can imitate; past the end of `precision_factor` it is 1.
fn unlike(
    model: &dyn SeparableModel,
    difference: &Column,
    columns: &[Column],
    precision_factor: &[f64],
) -> f64 {
    let observations = model.observations();
    let mut factor = precision_factor.to_vec();
    factor.resize(observations.uncertain().len(), 1.0);
    let n = columns.len();
    let mut matrix = vec![0.0; n * n];
    let mut x: Vec<f64> = columns
        .iter()
        .map(|c| observations.dot(c, difference, &factor))
        .collect();
    for i in 0..n {
        for j in 0..=i {
            matrix[i * n + j] = observations.dot(&columns[i], &columns[j], &factor);
        }
        matrix[i * n + i] = matrix[i * n + i] * (1.0 + 1e-9) + 1e-9;
    }
    let Some(cholesky) = Cholesky::new(matrix, n) else {
        return 0.0;
    };
    cholesky.forward(&mut x);
    observations.dot(difference, difference, &factor) - x.iter().map(|x| x * x).sum::<f64>()
}

/// Information, in bits, about which of several hypotheses of probabilities `p` holds, of a measurement by whose squared
/// signal-to-noise `d2` they differ: at least -sum p_i log2 sum p_j exp(-d2_ij / 8) (Kolchinsky and Tracey 2017, with
/// Bhattacharyya's distance).
pub fn expected_bits(p: &[f64], d2: &[Vec<f64>]) -> f64 {
    let bits = p.iter().zip(d2).map(|(p_i, d2)| {
        let alike = p.iter().zip(d2).map(|(p_j, d2)| p_j * (-d2 / 8.0).exp());
        -p_i * alike.sum::<f64>().log2()
    });
    bits.sum::<f64>().max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn information_is_nothing_without_a_difference_and_the_entropy_with_a_large_one() {
        let p = [0.5, 0.3, 0.2];
        let entropy: f64 = p.iter().map(|p: &f64| -p * p.log2()).sum();
        let bits = |d2: f64| {
            let row = |i: usize| (0..3).map(|j| if i == j { 0.0 } else { d2 }).collect();
            expected_bits(&p, &(0..3).map(row).collect::<Vec<Vec<f64>>>())
        };
        assert_eq!(bits(0.0), 0.0);
        assert!((bits(1e4) - entropy).abs() < 1e-12);
        assert!(bits(1.0) < bits(4.0) && bits(4.0) < entropy);
    }
}
