//! What a fit says of rows that it did not use, against fits anew without them.

mod common;

use common::*;
use inference::adequacy::leverages;
use inference::fit::{Fit, fit};
use inference::held_out::held_out;
use inference::model::{Member, SeparableModel};

/// A deleted row is one that tells nothing: so many times its standard deviation.
const DELETED: f64 = 1e7;

fn without(model: &Synthetic, rows: &[usize]) -> Synthetic {
    let mut covariance = model.covariance.clone();
    for &row in rows {
        covariance[(row, row)] *= DELETED * DELETED;
    }
    let (u, peak) = (model.u.clone(), model.peak.clone());
    Synthetic::observing(u, peak, covariance, model.observed.clone())
}

fn fitted(model: &Synthetic, members: &[Member]) -> Fit {
    let certain = vec![1.0; UNCERTAIN.len()];
    fit(model, members.to_vec(), &certain, 30).unwrap()
}

/// What a fit leaves of a row, in the observations' unit.
fn left(model: &Synthetic, fit: &Fit, row: usize) -> f64 {
    let base = nalgebra::DVector::from_row_slice(&fit.base_values);
    model.observed[row] - model.says(&fit.members, &base)[row]
}

/// Sets of members, what they are drawn with, and how far a linear answer may be off.
fn cases() -> [(Vec<Member>, f64); 4] {
    [
        (vec![], 1e-5),
        (vec![member(WAVE, &[0.7])], 1e-5),
        (vec![member(WAVE, &[0.7]), member(SCATTER, &[0.5])], 1e-5),
        (vec![member(BUMP, &[2.0, 0.2])], 0.1),
    ]
}

#[test]
fn a_residual_over_one_less_the_leverage_is_that_of_a_fit_without_the_row() {
    for seed in 0..10 {
        for (members, tolerance) in cases() {
            let model = Synthetic::draw(&mut Random::new(seed), &members);
            let whole = fitted(&model, &members);
            let leverage = leverages(&model, &whole);
            for row in PLAIN.chain(UNCERTAIN) {
                let anew = fitted(&without(&model, &[row]), &members);
                let said = left(&model, &whole, row) / (1.0 - leverage[row]);
                let found = left(&model, &anew, row);
                let off = (said - found).abs() * model.observations().weight(row);
                assert!(off < tolerance, "{seed} {members:?} {row}: {said} {found}");
            }
        }
    }
}

#[test]
fn leverages_sum_to_the_unknowns_less_what_the_prior_knows() {
    let members = [member(WAVE, &[0.7])];
    let model = Synthetic::draw(&mut Random::new(1), &members);
    let whole = fitted(&model, &members);
    let sum: f64 = leverages(&model, &whole).iter().sum();
    let by_prior = |k: usize| whole.covariance(k, k) * model.base().prior_precision[k];
    let taken = (UNKNOWNS + 1) as f64 - (0..UNKNOWNS).map(by_prior).sum::<f64>();
    assert!((sum - taken).abs() < 1e-3, "{sum} {taken}");
}

#[test]
fn held_out_errors_are_those_of_a_fit_without_the_rows() {
    for seed in 0..40 {
        for (members, tolerance) in cases() {
            let model = Synthetic::draw(&mut Random::new(seed), &members);
            let whole = fitted(&model, &members);
            let block: Vec<usize> = (10..14).chain(25..33).collect();
            let differences = [(26, 11), (30, 12), (25, 40), (28, 15)];
            let said = held_out(&model, &whole, &block, &differences).unwrap();
            let anew = fitted(&without(&model, &block), &members);
            for (said, (plus, minus)) in said.iter().zip(differences) {
                let found = left(&model, &anew, plus) - left(&model, &anew, minus);
                let off = (said - found).abs() * model.observations().weight(plus);
                assert!(off < tolerance, "{seed} {members:?} {plus}: {said} {found}");
            }
        }
    }
}
