//! Moments at which a head changed: re-zeroed, or a mark moved. The marks are the same only as long as the head is.

use nalgebra::{DMatrix, DVector};

use super::batch::{Batch, TYPE};
use super::posterior::{MEAN_SIGMA, solve};

/// Logarithm of the odds from which on a batch is split: one false split in a thousand batches, beside the number of
/// places at which it could be.
const ODDS: f64 = 6.9;

/// Places in `parts`, consecutive in time and of one spread, before which the head became another one.
pub fn changes(parts: &[Batch]) -> Vec<usize> {
    let mut found = Vec::new();
    search(parts, 0, &mut found);
    found.sort_unstable();
    found
}

fn search(parts: &[Batch], first: usize, found: &mut Vec<usize>) {
    let Some(together) = merged(parts) else {
        return;
    };
    let Some(whole) = log_evidence(&[&together]) else {
        return;
    };
    let best = (1..parts.len())
        .filter_map(|at| {
            let (before, after) = (merged(&parts[..at])?, merged(&parts[at..])?);
            Some((at, log_evidence(&[&before, &after])? - whole))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((at, gain)) = best else { return };
    if gain > ODDS + (parts.len() as f64).ln() {
        found.push(first + at);
        search(&parts[..at], first, found);
        search(&parts[at..], first + at, found);
    }
}

fn merged(parts: &[Batch]) -> Option<Batch> {
    let (first, rest) = parts.split_first()?;
    let mut sum = first.clone();
    rest.iter().try_for_each(|part| sum.merge(part)).ok()?;
    Some(sum)
}

/// Logarithm of the evidence of batches of one type, each with marks of its own.
fn log_evidence(batches: &[&Batch]) -> Option<f64> {
    let marks: usize = batches.iter().map(|batch| batch.marks_deg.len()).sum();
    let order = TYPE + marks;
    let mut form = DMatrix::zeros(order + 1, order + 1);
    let mut variance = DVector::from_iterator(
        order,
        MEAN_SIGMA
            .into_iter()
            .chain(std::iter::repeat_n(0.0, marks)),
    );
    variance.apply(|sigma| *sigma *= *sigma);
    let (mut first, mut log_determinant) = (TYPE + 1, 0.0);
    for batch in batches {
        let own = batch.squares.matrix();
        let count = batch.marks_deg.len();
        let place = |k: usize| if k <= TYPE { k } else { first + k - TYPE - 1 };
        for i in 0..own.nrows() {
            for j in 0..own.ncols() {
                form[(place(i), place(j))] += own[(i, j)];
            }
        }
        variance
            .rows_mut(first - 1, count)
            .fill(batch.dial_sigma_rad.powi(2));
        first += count;
        log_determinant += batch.log_determinant;
    }
    let prior = DMatrix::from_diagonal(&variance);
    let (_, _, squares, log_determinants) = solve(&form, &DVector::zeros(order), &prior)?;
    Some(-0.5 * (squares + log_determinants + log_determinant))
}
