//! A better test plan: positions to add, and the best plan of so many readings.

use std::collections::BTreeSet;

use shared::identify::blindness::Design;
use shared::identify::square_root::FactorError;
use shared::identify::static_test::StaticTestError;
use shared::model::NOMINAL;
use shared::rectification::Sensitivity;
use shared::tumble::{Position, Series};

use super::assessment::{Conditions, Environment, fit};

/// Positions to add one after another, each the one that lowers the worst environment's uncertainty most, with that
/// uncertainty after it, g. Stops before `most` when another position would gain less than 2 %.
///
/// # Errors
/// As [`super::assess`].
pub fn positions_to_add(
    plan: &[Position],
    conditions: &Conditions,
    environments: &[Environment],
    most: usize,
) -> Result<Vec<(Position, f64)>, StaticTestError> {
    let mounts: BTreeSet<u64> = plan.iter().map(|p| p.mount_deg.to_bits()).collect();
    let candidates = candidates(&mounts.into_iter().map(f64::from_bits).collect::<Vec<_>>());
    let mut grown = plan.to_vec();
    let mut added = Vec::new();
    let mut now = objective(&grown, conditions, environments)?;
    for _ in 0..most {
        let (best, position) = best_addition(&mut grown, &candidates, |plan| {
            objective(plan, conditions, environments)
        })?;
        if best.sqrt() > 0.98 * now.sqrt() {
            break;
        }
        grown.push(position);
        added.push((position, best.sqrt()));
        now = best;
    }
    Ok(added)
}

/// The same plan taken twice with one mount, and half of it remounted by 180 deg: the gain of closure for the same
/// number of readings.
pub fn twice_and_remounted(plan: &[Position]) -> (Vec<Position>, Vec<Position>) {
    let with = |mount_deg: f64| {
        plan.iter().map(move |p| Position {
            mount_deg: p.mount_deg + mount_deg,
            ..*p
        })
    };
    (
        with(0.0).chain(with(0.0)).collect(),
        with(0.0).chain(with(180.0)).collect(),
    )
}

/// A plan of `readings` positions (at least 11) of full rank with least uncertainty of the predicted vibration error in
/// the worst environment. The first positions see every coefficient; the others are placed greedily for the
/// environments and then exchanged one by one (Fedorov): a local optimum. `step` is called after each position placed or
/// examined, at most twice `readings` times.
///
/// # Errors
/// As [`super::assess`].
pub fn best_plan(
    readings: usize,
    conditions: &Conditions,
    environments: &[Environment],
    mut step: impl FnMut(),
) -> Result<Vec<Position>, StaticTestError> {
    let candidates = candidates(&[0.0, 180.0]);
    let all_coefficients = |plan: &[Position]| variance(plan, conditions, trace);
    let mut base = Vec::new();
    while base.len() < NOMINAL || (base.len() < readings && geometric_rank(&base) < NOMINAL) {
        let (_, position) = best_addition(&mut base, &candidates, all_coefficients)?;
        base.push(position);
        step();
    }
    let for_environments = |plan: &[Position]| objective(plan, conditions, environments);
    let mut plan = base.clone();
    while plan.len() < readings {
        let (_, position) = best_addition(&mut plan, &candidates, for_environments)?;
        plan.push(position);
        step();
    }
    let mut now = for_environments(&plan)?;
    for _ in base.len()..plan.len() {
        let old = plan.remove(base.len());
        let (best, position) = best_addition(&mut plan, &candidates, for_environments)?;
        let improved = best < now * (1.0 - 1e-6);
        plan.push(if improved { position } else { old });
        now = now.min(best);
        step();
    }
    plan.sort_by(|a, b| {
        let key = |p: &Position| (p.series, p.mount_deg, p.dial_deg);
        key(a)
            .partial_cmp(&key(b))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    Ok(plan)
}

/// Rank of the positions, whatever the errors of a reading.
fn geometric_rank(plan: &[Position]) -> usize {
    let mut design = Design::default();
    plan.iter().for_each(|p| design.absorb(p.specific_force()));
    design.visibility().rank
}

/// Every position at multiples of 15 and of 22.5 deg, in three series, for the given mounts (deg).
fn candidates(mounts_deg: &[f64]) -> Vec<Position> {
    let mut angles: Vec<f64> = (0..24).map(|k| 15.0 * f64::from(k)).collect();
    angles.extend((0..8).map(|k| 22.5 + 45.0 * f64::from(k)));
    let mut all = Vec::new();
    for series in Series::ALL {
        for dial_deg in &angles {
            for mount_deg in mounts_deg {
                all.push(Position {
                    series,
                    dial_deg: *dial_deg,
                    mount_deg: *mount_deg,
                });
            }
        }
    }
    all
}

/// The candidate that lowers the objective most, and the objective with it.
fn best_addition(
    plan: &mut Vec<Position>,
    candidates: &[Position],
    objective: impl Fn(&[Position]) -> Result<f64, StaticTestError>,
) -> Result<(f64, Position), StaticTestError> {
    let mut best = (f64::INFINITY, candidates[0]);
    for candidate in candidates {
        plan.push(*candidate);
        let value = objective(plan);
        plan.pop();
        let value = value?;
        if value < best.0 * (1.0 - 1e-12) {
            best = (value, *candidate);
        }
    }
    Ok(best)
}

/// Variance of the predicted vibration error in the worst environment, prior included, g^2.
fn objective(
    plan: &[Position],
    conditions: &Conditions,
    environments: &[Environment],
) -> Result<f64, StaticTestError> {
    variance(plan, conditions, |covariance| {
        let of = |e: &Environment| Sensitivity::new(e.a0_i_g, e.moments).variance_g2(covariance);
        environments.iter().map(of).fold(0.0, f64::max)
    })
}

/// A figure of the covariance that a plan leaves, prior included; infinite while not even the scale factor is
/// determined.
fn variance(
    plan: &[Position],
    conditions: &Conditions,
    figure: impl Fn(&[[f64; NOMINAL]; NOMINAL]) -> f64,
) -> Result<f64, StaticTestError> {
    match fit(plan, conditions, true) {
        Err(StaticTestError::Workspace(FactorError::Undetermined { .. })) => Ok(f64::INFINITY),
        fit => Ok(figure(&fit?.covariance)),
    }
}

fn trace(covariance: &[[f64; NOMINAL]; NOMINAL]) -> f64 {
    (0..NOMINAL).map(|k| covariance[k][k]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statics::assessment::assess;
    use shared::identify::static_test::Bench;
    use shared::model::SpecificForce;
    use shared::tumble::{full_rank_plan, paper_plan};
    use shared::vibration::{Harmonic, Random};

    fn conditions() -> Conditions {
        let arcsec = |angle: f64| angle * shared::tumble::ARCSEC_RAD;
        Conditions {
            bench: Bench {
                dial_sigma_rad: arcsec(5.8),
                dial_repeat_sigma_rad: arcsec(1.0),
                mount_sigma_rad: arcsec(60.0),
                level_sigma_rad: arcsec(5.8),
                local_gravity_g: 1.0,
            },
            noise_g: 1.5e-6,
            prior_sigma: 5e-4,
        }
    }

    fn white_noise() -> Environment {
        let along = SpecificForce::new(1.0, 0.0, 0.0);
        Environment {
            name: "random:1".into(),
            a0_i_g: 0.0,
            moments: Random::along(along).into(),
        }
    }

    #[test]
    fn papers_plan_rests_on_its_prior_and_added_angles_relieve_it() {
        let plan: Vec<_> = paper_plan().collect();
        let environment = [white_noise()];
        let judged = assess(&plan, &conditions(), &environment).unwrap();
        assert_eq!((judged.rank, judged.blind_directions.len()), (10, 1));
        assert_eq!(judged.coefficient_sigma["k2_per_g"], None);
        let blind = &judged.environments[0];
        // The predicted error moves by 0.65 per unit along the blind direction.
        assert!((blind.blind_sigma_g / 5e-4 - 0.65).abs() < 0.01);
        let added = positions_to_add(&plan, &conditions(), &environment, 8).unwrap();
        assert!(added[0].1 < 0.8 * blind.sigma_g());
        assert!(added.windows(2).all(|pair| pair[1].1 < pair[0].1));
        let grown: Vec<_> = plan
            .into_iter()
            .chain(added.iter().map(|(p, _)| *p))
            .collect();
        assert_eq!(
            assess(&grown, &conditions(), &environment).unwrap().rank,
            NOMINAL
        );
    }

    #[test]
    fn remounting_divides_the_uncertainty_by_nearly_ten() {
        let (twice, remounted) = twice_and_remounted(&full_rank_plan().collect::<Vec<_>>());
        let sigma = |plan: &[Position]| {
            assess(plan, &conditions(), &[white_noise()])
                .unwrap()
                .environments[0]
                .sigma_g()
        };
        assert_eq!(twice.len(), remounted.len());
        assert!((sigma(&twice) / sigma(&remounted) - 9.6).abs() < 0.2);
    }

    #[test]
    fn best_plan_beats_the_remounted_one_with_as_many_readings_and_keeps_full_rank() {
        let sine = Environment {
            name: "sine:5".into(),
            a0_i_g: 0.5,
            moments: Harmonic {
                amplitude_g: SpecificForce::new(5.0, 0.0, 0.0),
            }
            .into(),
        };
        for environment in [white_noise(), sine] {
            let environment = [environment];
            let (_, remounted) = twice_and_remounted(&paper_plan().collect::<Vec<_>>());
            let best = best_plan(48, &conditions(), &environment, || ()).unwrap();
            let judged = assess(&best, &conditions(), &environment).unwrap();
            let other = assess(&remounted, &conditions(), &environment).unwrap();
            assert_eq!((best.len(), judged.rank), (48, NOMINAL));
            assert!(judged.environments[0].sigma_g() < 0.5 * other.environments[0].sigma_g());
        }
    }
}
