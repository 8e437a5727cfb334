//! Stated uncertainties, both ways: three times too large fails as three times too small.

mod common;

use common::*;
use inference::fit::fit_base;
use inference::model::SeparableModel;
use inference::profile::{is_wide, over_its_range};
use inference::variance::size;

/// Mean and standard deviation under weights that are given as logarithms.
fn moments(parts: &[(f64, f64, f64)]) -> (f64, f64) {
    let most = parts.iter().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    let weight = |p: &(f64, f64, f64)| (p.0 - most).exp() * (p.2 - p.1);
    let total: f64 = parts.iter().map(weight).sum();
    let mean = parts
        .iter()
        .map(|p| weight(p) * 0.5 * (p.1 + p.2))
        .sum::<f64>()
        / total;
    let square = parts.iter().map(|p| {
        let from_mean = 0.5 * (p.1 + p.2) - mean;
        weight(p) * (from_mean.powi(2) + (p.2 - p.1).powi(2) / 12.0)
    });
    (mean, (square.sum::<f64>() / total).sqrt())
}

/// Rise of ln likelihood by the best amount of `unit`.
fn gain(dense: &Dense, unit: &nalgebra::DVector<f64>) -> f64 {
    let (estimate, sigma) = dense.estimate(unit);
    if sigma.is_infinite() {
        0.0
    } else {
        0.5 * (estimate / sigma).powi(2)
    }
}

#[test]
fn a_wide_parameter_over_its_range_is_the_quadrature() {
    let mut wide = 0;
    for seed in 0..60 {
        let mut random = Random::new(seed);
        let height = random.uniform(0.2, 0.5);
        let model = Synthetic::draw(&mut random, &[member(BUMP, &[height, 0.1])]);
        let fit = best_fit(&model, BUMP);
        if !is_wide(&model, &fit, 0, 1) {
            continue;
        }
        wide += 1;
        let (mean, sigma) = over_its_range(&model, &fit, 0, 1);
        let dense = model.dense(&[]);
        let parts: Vec<(f64, f64, f64)> = (0..400)
            .map(|k| {
                let low = CENTRE.0 + f64::from(k) / 200.0;
                let unit = &model.units(&member(BUMP, &[0.0, low + 0.0025]))[0];
                (gain(&dense, unit), low, low + 0.005)
            })
            .collect();
        let (true_mean, true_sigma) = moments(&parts);
        let (off, ratio) = ((mean - true_mean) / true_sigma, sigma / true_sigma);
        assert!(
            off.abs() < 0.1 && (0.95..1.05).contains(&ratio),
            "{off} {ratio}"
        );
    }
    assert!(wide > 20, "{wide}");
}

#[test]
fn a_threshold_over_its_range_is_the_sum_over_its_steps() {
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let threshold = random.uniform(2.0, 8.0);
        let acting = [member(MEMORY, &[0.3, 0.8, threshold])];
        let model = Synthetic::draw(&mut random, &acting);
        let fit = best_fit(&model, MEMORY);
        assert!(is_wide(&model, &fit, 0, 2));
        let (mean, sigma) = over_its_range(&model, &fit, 0, 2);
        let dense = model.dense(&[]);
        let steps = model.threshold_steps(THRESHOLD.0, THRESHOLD.1).into_iter();
        let parts: Vec<(f64, f64, f64)> = steps
            .map(|(low, high)| {
                let gains = (0..=60).map(|k| {
                    let kept = KEPT.0 + (KEPT.1 - KEPT.0) * f64::from(k) / 60.0;
                    gain(
                        &dense,
                        &model.units(&member(MEMORY, &[0.0, kept, 0.5 * (low + high)]))[0],
                    )
                });
                (gains.fold(0.0, f64::max), low, high)
            })
            .collect();
        let (true_mean, true_sigma) = moments(&parts);
        let (off, ratio) = ((mean - true_mean) / true_sigma, sigma / true_sigma);
        assert!(
            off.abs() < 0.15 && (0.85..1.1).contains(&ratio),
            "{off} {ratio}"
        );
    }
}

#[test]
fn the_size_of_added_variance_is_within_its_sigma_and_fills_it() {
    for true_size in [0.4, 2.0] {
        let (mut square, seeds) = (0.0, 400);
        for seed in 0..seeds {
            let mut random = Random::new(seed);
            let model = Synthetic::draw(&mut random, &[member(SCATTER, &[true_size])]);
            let fit = best_fit(&model, SCATTER);
            let (value, sigma) = size(&model, &fit, 0);
            square += ((value / true_size).ln() * value / sigma).powi(2);
        }
        let mean = square / seeds as f64;
        assert!((0.7..1.4).contains(&mean), "{true_size}: {mean}");
    }
}

#[test]
fn unknowns_of_the_base_are_within_their_sigma_and_fill_it() {
    let (mut square, mut count) = (0.0, 0.0);
    for seed in 0..400 {
        let mut random = Random::new(seed);
        let amount = random.normal();
        let model = Synthetic::draw(&mut random, &[member(WAVE, &[amount])]);
        let fit = best_fit(&model, WAVE);
        let n = fit.base_values.len();
        square += ((fit.members[0].values[0] - amount) / fit.covariance(n, n).sqrt()).powi(2);
        count += 1.0;
        assert!(fit.log_evidence > fit_base(&model).unwrap().log_evidence - 10.0);
    }
    // Chi-square of 400 degrees of freedom: four of its standard deviations.
    let mean = square / count;
    assert!((mean - 1.0).abs() < 4.0 * (2.0 / count).sqrt(), "{mean}");
}
