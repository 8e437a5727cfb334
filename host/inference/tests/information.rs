//! Expected bits against a simulation of the experiment, and the distances that they rest on against fits.

mod common;

use common::*;
use inference::fit::{fit, fit_base};
use inference::information::{expected_bits, separations};
use inference::model::SeparableModel;
use inference::remainder::Remainder;

/// Mutual information, bits, of a measurement whose mean is one of `places` in units of its noise, with its standard error.
fn simulated_bits(p: &[f64], places: &[Vec<f64>], random: &mut Random) -> (f64, f64) {
    const DRAWS: usize = 20_000;
    let (mut sum, mut square) = (0.0, 0.0);
    for _ in 0..DRAWS {
        let mut chance = random.uniform(0.0, 1.0);
        let truth = p.iter().position(|p| {
            chance -= p;
            chance < 0.0
        });
        let truth = truth.unwrap_or(p.len() - 1);
        let measured: Vec<f64> = places[truth].iter().map(|x| x + random.normal()).collect();
        let likelihood = |place: &Vec<f64>| {
            let off = place.iter().zip(&measured).map(|(x, y)| (x - y).powi(2));
            (-0.5 * off.sum::<f64>()).exp()
        };
        let all: f64 = p
            .iter()
            .zip(places)
            .map(|(p, place)| p * likelihood(place))
            .sum();
        let bits = (likelihood(&places[truth]) / all).log2();
        sum += bits;
        square += bits * bits;
    }
    let n = DRAWS as f64;
    (sum / n, ((square / n - (sum / n).powi(2)) / n).sqrt())
}

fn entropy(p: &[f64]) -> f64 {
    p.iter().map(|p| -p * p.log2()).sum()
}

/// They are a lower bound: never above the simulation; half of it where a measurement tells next to nothing (d^2/8 against d^2/4 of
/// the exact series), three quarters and more where it tells most of what there is.
#[test]
fn expected_bits_are_a_lower_bound_of_the_simulated_ones_and_not_far_below() {
    let mut random = Random::new(1);
    for round in 0..60 {
        let count = 2 + round % 3;
        let weights: Vec<f64> = (0..count).map(|_| random.uniform(0.1, 1.0)).collect();
        let total: f64 = weights.iter().sum();
        let p: Vec<f64> = weights.iter().map(|w| w / total).collect();
        let apart = random.log_uniform(0.2, 6.0);
        let mut place = || (0..3).map(|_| apart * random.normal()).collect();
        let places: Vec<Vec<f64>> = (0..count).map(|_| place()).collect();
        let distance = |a: &Vec<f64>, b: &Vec<f64>| {
            let off = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
            off.sum::<f64>()
        };
        let d2: Vec<Vec<f64>> = places
            .iter()
            .map(|a| places.iter().map(|b| distance(a, b)).collect())
            .collect();
        let said = expected_bits(&p, &d2);
        let (bits, error) = simulated_bits(&p, &places, &mut random);
        let slack = 4.0 * error;
        assert!(said < bits + slack, "{apart}: {said}, simulated {bits}");
        assert!(
            said > 0.48 * bits - slack,
            "{apart}: {said}, simulated {bits}"
        );
        if bits > 0.8 * entropy(&p) {
            assert!(
                said > 0.75 * bits - slack,
                "{apart}: {said}, simulated {bits}"
            );
        }
    }
}

#[test]
fn a_separation_is_what_a_fit_leaves_of_the_other_hypothesis() {
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let acting = [member(
            BUMP,
            &[3.0 * random.normal(), random.uniform(-0.8, 0.8)],
        )];
        let model = Synthetic::draw(&mut random, &acting);
        let certain = vec![1.0; UNCERTAIN.len()];
        let bump = fit(&model, acting.to_vec(), &certain, 10).unwrap();
        let wave = fit(&model, vec![member(WAVE, &[0.0])], &certain, 10).unwrap();
        let none = fit_base(&model).unwrap();
        let said = separations(&model, &[&bump, &wave, &none]);
        // What the bump says, without noise, seen by each.
        let base = nalgebra::DVector::from_row_slice(&bump.base_values);
        let observed = model.says(&bump.members, &base);
        let (u, peak) = (model.u.clone(), model.peak.clone());
        let without_noise = Synthetic::observing(u, peak, model.covariance.clone(), observed);
        let wave = fit(&without_noise, wave.members.clone(), &certain, 10).unwrap();
        for (said, seen) in [
            (said[0][1], wave),
            (said[0][2], fit_base(&without_noise).unwrap()),
        ] {
            let left: f64 = seen.residuals.iter().map(|r| r * r).sum();
            // The base's prior takes a part of a small one.
            let off = (said - left).abs();
            assert!(off < 0.01 * left + 0.02, "{seed}: {said} {left}");
        }
        assert_eq!(said[0][0], 0.0);
        assert_eq!(model.components().len(), 6);
    }
}

#[test]
fn correlations_of_signatures_are_within_one_even_of_such_that_the_fit_nearly_imitates() {
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let model = Synthetic::draw(&mut random, &[]);
        let fit = fit_base(&model).unwrap();
        let mut twin = fit.columns[1].clone();
        twin.add(&fit.columns[2]);
        let draws = UNCERTAIN.map(|_| random.normal());
        let mut own = vec![0.0; ROWS];
        own[UNCERTAIN].copy_from_slice(&draws.collect::<Vec<_>>());
        let own = model.observations().column(own);
        let like = Remainder::new(&model, &fit).similarity(&[&twin, &own, &own, &fit.columns[0]]);
        for (i, row) in like.iter().enumerate() {
            assert!(row.iter().all(|r| r.abs() <= 1.0), "{seed}: {row:?}");
            assert_eq!(row[i], 1.0);
        }
        assert!((like[1][2] - 1.0).abs() < 1e-9);
    }
}
