//! The static test's stated uncertainty against what happens over many simulated campaigns.
//!
//! The simulation turns the instrument to the angle that the dial really gives and evaluates the output model
//! there; it knows nothing of linearisation or random effects.

use std::collections::HashMap;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use shared::identify::static_test::{Bench, Fit, Reading, StaticTest, workspace_len};
use shared::model::{Coefficients, NOMINAL, SpecificForce};
use shared::rectification::Sensitivity;
use shared::scalar::Real;
use shared::tumble::{Position, full_rank_plan, paper_plan};
use shared::vibration::Random;

const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;
const NOISE_V: f64 = 1.5e-6;

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

fn bench(dial_arcsec: f64) -> Bench<f64> {
    Bench {
        dial_sigma_rad: dial_arcsec * ARCSEC,
        dial_repeat_sigma_rad: 0.2 * ARCSEC,
        mount_sigma_rad: 120.0 * ARCSEC,
        level_sigma_rad: dial_arcsec * ARCSEC,
        local_gravity_g: 0.9981,
    }
}

fn random_instrument(rng: &mut ChaCha8Rng) -> Coefficients<f64> {
    let scale = [
        0.05, 2e-4, 6e-4, 4e-4, 3e-4, 5e-5, 5e-4, 5e-4, 5e-5, 5e-5, 5e-5,
    ];
    let mut c = scale.map(|s| s * normal(rng));
    c[0] += 1.2;
    Coefficients::from_nominal(c)
}

/// Readings of a plan by a bench whose errors are drawn anew.
fn measure(
    plan: &[Position],
    c: &Coefficients<f64>,
    bench: &Bench<f64>,
    rng: &mut ChaCha8Rng,
) -> Vec<Reading<f64>> {
    let (mut marks, mut mounts) = (HashMap::new(), HashMap::new());
    let zero = bench.level_sigma_rad * normal(rng);
    let lift = bench.level_sigma_rad * normal(rng);
    plan.iter()
        .map(|position| {
            let mark = *marks
                .entry(position.dial_deg.to_bits())
                .or_insert_with(|| bench.dial_sigma_rad * normal(rng));
            let mount = *mounts
                .entry((position.series, position.mount_deg.to_bits()))
                .or_insert_with(|| bench.mount_sigma_rad * normal(rng));
            let repeat = bench.dial_repeat_sigma_rad * normal(rng);
            let phi = (position.dial_deg + position.mount_deg).to_radians();
            let level = position
                .series
                .specific_force(phi + mark + mount + zero + repeat);
            let along = position.series.lift::<f64>();
            let (g, s, cos) = (bench.local_gravity_g, lift.sin(), lift.cos());
            let a = SpecificForce::new(
                g * (cos * level.i + s * along.i),
                g * (cos * level.p + s * along.p),
                g * (cos * level.o + s * along.o),
            );
            Reading {
                position: *position,
                output_v: c.output_v(a) + NOISE_V * normal(rng),
                sigma_v: NOISE_V,
            }
        })
        .collect()
}

/// Two passes: about the nominal instrument, then about what the first found.
fn identify(readings: &[Reading<f64>], bench: Bench<f64>) -> Fit<f64> {
    identify_beside(readings, bench, None)
}

fn identify_beside(
    readings: &[Reading<f64>],
    bench: Bench<f64>,
    prior_sigma: Option<&[f64; NOMINAL]>,
) -> Fit<f64> {
    let mounts: std::collections::HashSet<_> = readings
        .iter()
        .map(|r| (r.position.series, r.position.mount_deg.to_bits()))
        .collect();
    let marks: std::collections::HashSet<_> = readings
        .iter()
        .map(|r| r.position.dial_deg.to_bits())
        .collect();
    let marks = marks.len();
    let mut about = Coefficients::default();
    let mut found = Vec::new();
    let mut fit = None;
    for _pass in 0..2 {
        let mut workspace = vec![0.0; workspace_len(marks, mounts.len())];
        let mut test = StaticTest::new(bench, about, marks, mounts.len(), &mut workspace).unwrap();
        for mount in &found {
            test.linearise_mount(mount).unwrap();
        }
        for reading in readings {
            test.absorb(reading).unwrap();
        }
        let solved = test.solve(prior_sigma).unwrap();
        about = solved.coefficients;
        found = test.mount_estimates(&about).collect();
        fit = Some(solved);
    }
    fit.unwrap()
}

fn twice(plan: impl Iterator<Item = Position>, second_mount_deg: f64) -> Vec<Position> {
    plan.flat_map(|p| {
        [
            p,
            Position {
                mount_deg: second_mount_deg,
                ..p
            },
        ]
    })
    .collect()
}

/// Squared error over variance for each coefficient, and for the VRE predicted at 1 g rms and a0 = 0, averaged over
/// campaigns; chi-square over its degrees of freedom.
fn mean_squared_z(
    plan: &[Position],
    dial_arcsec: f64,
    campaigns: u64,
) -> ([f64; NOMINAL], f64, f64) {
    let bench = bench(dial_arcsec);
    let sigma = SpecificForce::new(1.0, 0.0, 0.0);
    let white = Sensitivity::new(
        0.0,
        Random {
            sigma_g: sigma,
            correlation: [0.0; 3],
        },
    );
    let (mut z2, mut vre_z2, mut chi2) = ([0.0; NOMINAL], 0.0, 0.0);
    for seed in 0..campaigns {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let truth = random_instrument(&mut rng);
        let fit = identify(&measure(plan, &truth, &bench, &mut rng), bench);
        let error = |k: usize| fit.coefficients.to_nominal()[k] - truth.to_nominal()[k];
        for k in 0..NOMINAL {
            z2[k] += error(k).powi(2) / fit.covariance[k][k] / campaigns as f64;
        }
        let vre_error = white.vre_g(&fit.coefficients) - white.vre_g(&truth);
        vre_z2 += vre_error.powi(2) / white.variance_g2(&fit.covariance) / campaigns as f64;
        chi2 += fit.chi2 / fit.degrees_of_freedom() as f64 / campaigns as f64;
    }
    (z2, vre_z2, chi2)
}

#[test]
fn truth_lies_within_the_stated_uncertainty_at_the_stated_rate() {
    // The mean of n squared unit normals has the standard deviation sqrt(2/n); five of them for some 60 figures.
    let campaigns = 400;
    let bound = 5.0 * (2.0 / campaigns as f64).sqrt();
    for (name, plan, dial_arcsec) in [
        ("one mount, 1 arcsec", twice(full_rank_plan(), 0.0), 1.0),
        ("one mount, 5.8 arcsec", twice(full_rank_plan(), 0.0), 5.8),
        (
            "two mounts, 5.8 arcsec",
            twice(full_rank_plan(), 180.0),
            5.8,
        ),
        (
            "four mounts",
            {
                let four = [0.0, 90.0, 180.0, 270.0];
                four.iter()
                    .flat_map(|m| full_rank_plan().map(|p| Position { mount_deg: *m, ..p }))
                    .collect()
            },
            10.0,
        ),
    ] {
        let (z2, vre_z2, chi2) = mean_squared_z(&plan, dial_arcsec, campaigns);
        for (k, z2) in z2.iter().enumerate() {
            assert!(
                (z2 - 1.0).abs() < bound,
                "{name}: coefficient {k}, mean squared z {z2}"
            );
        }
        assert!(
            (vre_z2 - 1.0).abs() < bound,
            "{name}: VRE, mean squared z {vre_z2}"
        );
        let dof = (plan.len() - NOMINAL) as f64;
        assert!(
            (chi2 - 1.0).abs() < bound / dof.sqrt(),
            "{name}: reduced chi-square {chi2}"
        );
    }
}

#[test]
fn independent_errors_would_state_intervals_that_are_too_narrow() {
    let plan = twice(full_rank_plan(), 0.0);
    let truth_bench = bench(5.8);
    let (mut inside, mut all) = (0, 0);
    for seed in 0..100 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let truth = random_instrument(&mut rng);
        let readings = measure(&plan, &truth, &truth_bench, &mut rng);
        // All of the angles' uncertainty taken as independent from reading to reading.
        let naive = Bench {
            dial_sigma_rad: 0.0,
            level_sigma_rad: 0.0,
            dial_repeat_sigma_rad: truth_bench.dial_sigma_rad * 2f64.sqrt(),
            ..truth_bench
        };
        let fit = identify(&readings, naive);
        for k in [2, 3, 5] {
            let error = fit.coefficients.to_nominal()[k] - truth.to_nominal()[k];
            inside += usize::from(error.abs() < 1.96 * fit.covariance[k][k].sqrt());
            all += 1;
        }
    }
    let coverage = f64::from(inside as u32) / f64::from(all as u32);
    assert!(coverage < 0.9, "95 % intervals cover {coverage}");
}

fn stated_sigmas(plan: &[Position], dial_arcsec: f64, repeat_arcsec: f64) -> [f64; 3] {
    let bench = Bench {
        local_gravity_g: 1.0,
        dial_repeat_sigma_rad: repeat_arcsec * ARCSEC,
        ..bench(dial_arcsec)
    };
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let readings = measure(plan, &Coefficients::default(), &bench, &mut rng);
    let fit = identify(&readings, bench);
    let vibration = Random {
        sigma_g: SpecificForce::new(1.0, 0.0, 0.0),
        correlation: [0.0; 3],
    };
    [
        fit.covariance[3][3].sqrt(),
        fit.covariance[5][5].sqrt(),
        Sensitivity::new(0.0, vibration)
            .variance_g2(&fit.covariance)
            .sqrt(),
    ]
}

#[test]
fn remounting_gains_what_closure_is_known_to_gain() {
    let four = |p: Position| [0.0, 90.0, 180.0, 270.0].map(|m| Position { mount_deg: m, ..p });
    // Sigma of k2, of k4 and of the VRE predicted at 1 g rms, 1e-6, from a calculation by full covariance matrices;
    // settings repeat to 1 arcsec on the coarse dial and to 0.2 arcsec on the fine one.
    for (plan, dial, repeat, independent) in [
        (twice(full_rank_plan(), 0.0), 5.8, 1.0, [202.0, 90.0, 162.0]),
        (twice(full_rank_plan(), 180.0), 5.8, 1.0, [20.0, 9.2, 17.0]),
        (
            full_rank_plan().flat_map(four).collect(),
            5.8,
            1.0,
            [14.0, 6.5, 12.0],
        ),
        (twice(full_rank_plan(), 0.0), 1.0, 0.2, [36.0, 16.0, 30.0]),
        (twice(full_rank_plan(), 180.0), 1.0, 0.2, [9.3, 4.8, 9.0]),
    ] {
        for (ours, theirs) in stated_sigmas(&plan, dial, repeat).iter().zip(independent) {
            let ratio = ours * 1e6 / theirs;
            assert!(
                (ratio - 1.0).abs() < 0.03,
                "stated {} against {theirs}",
                ours * 1e6
            );
        }
    }
}

#[test]
fn papers_plan_determines_all_but_one_direction_and_states_no_uncertainty_along_it() {
    let plan: Vec<_> = paper_plan().collect();
    let bench = bench(5.8);
    let campaigns = 400;
    let (mut z2, mut chi2) = ([0.0; NOMINAL], 0.0);
    for seed in 0..campaigns {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let truth = random_instrument(&mut rng);
        let fit = identify(&measure(&plan, &truth, &bench, &mut rng), bench);
        assert_eq!(fit.visibility.rank, 10);
        assert_eq!(fit.degrees_of_freedom(), 14);
        chi2 += fit.chi2 / campaigns as f64;
        let blind = fit.visibility.blind_directions()[0];
        let along: f64 = (0..NOMINAL)
            .map(|i| {
                blind[i]
                    * (0..NOMINAL)
                        .map(|j| fit.covariance[i][j] * blind[j])
                        .sum::<f64>()
            })
            .sum();
        assert!(
            along.abs() < 1e-18,
            "variance along the blind direction {along}"
        );
        for (k, z2) in z2.iter_mut().enumerate() {
            let error = fit.coefficients.to_nominal()[k] - truth.to_nominal()[k];
            *z2 += error.powi(2) / fit.covariance[k][k] / campaigns as f64;
        }
    }
    // Within five standard deviations of the mean of `campaigns` values with 14 degrees of freedom.
    let bound = 5.0 * (2.0 * 14.0 / campaigns as f64).sqrt();
    assert!((chi2 - 14.0).abs() < bound, "mean chi-square {chi2}");
    for k in (0..NOMINAL).filter(|k| ![2, 3, 5].contains(k)) {
        let bound = 5.0 * (2.0 / campaigns as f64).sqrt();
        assert!(
            (z2[k] - 1.0).abs() < bound,
            "coefficient {k}: mean squared z {}",
            z2[k]
        );
    }
}

#[test]
fn angles_read_off_an_encoder_are_as_blind_as_the_nominal_ones() {
    // 24 angles, each off by up to some thousandths of a degree, and known to be.
    let nominal: Vec<_> = paper_plan().collect();
    let bench = bench(5.8);
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for step_deg in [1e-4, 1e-3, 1e-2] {
        let read: Vec<_> = nominal
            .iter()
            .map(|p| Position {
                dial_deg: p.dial_deg + (3.0 * normal(&mut rng)).round() * step_deg,
                ..*p
            })
            .collect();
        let truth = random_instrument(&mut rng);
        let fit = identify(&measure(&read, &truth, &bench, &mut rng), bench);
        assert_eq!(fit.visibility.rank, 10, "{step_deg} deg");
        for k in 0..NOMINAL {
            let blind = [2, 3, 5].contains(&k);
            assert_eq!(fit.visibility.determines(k), !blind, "coefficient {k}");
        }
        // The published direction, as far as the angles are the paper's.
        let direction = fit.visibility.blind_directions()[0];
        for (k, published) in [(2, -0.4459), (3, 0.8153), (5, -0.3694)] {
            assert!((direction[k] - published).abs() < 0.02, "{direction:?}");
        }
        let of = |plan: &[Position]| {
            let mut rng = ChaCha8Rng::seed_from_u64(9);
            let readings = measure(plan, &truth, &bench, &mut rng);
            identify_beside(&readings, bench, Some(&[5e-4; NOMINAL]))
        };
        let along = SpecificForce::new(1.0, 0.0, 0.0);
        let sigma_g = |fit: &Fit<f64>| {
            let white = Sensitivity::new(0.0, Random::along(along));
            white.variance_g2(&fit.covariance).sqrt()
        };
        let ratio = sigma_g(&of(&read)) / sigma_g(&of(&nominal));
        assert!((ratio - 1.0).abs() < 0.02, "{step_deg} deg: {ratio}");
    }
}

#[test]
fn what_a_coarse_dial_leaves_to_the_prior_is_told_as_blind() {
    let plan = twice(full_rank_plan(), 0.0);
    let determined = [5.8, 600.0].map(|dial_arcsec| {
        let bench = bench(dial_arcsec);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let readings = measure(&plan, &Coefficients::default(), &bench, &mut rng);
        let seen = identify(&readings, bench).visibility;
        [0, 2, 3, 4, 5].map(|k| seen.determines(k))
    });
    assert_eq!(determined[0], [true; 5]);
    // 600 arcsec are up to 3e-3 g at every reading but those at +-1 g: k1', k2, k3 and k4 of 5e-4 drown, K1 does not.
    assert_eq!(determined[1], [true, false, false, false, false]);
}

#[test]
fn prior_gives_the_blind_direction_the_uncertainty_that_was_stated() {
    let plan: Vec<_> = paper_plan().collect();
    let bench = bench(1.0);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let about = random_instrument(&mut rng);
    let readings = measure(&plan, &about, &bench, &mut rng);
    let mut workspace = vec![0.0; workspace_len(8, 3)];
    let mut test = StaticTest::new(bench, about, 8, 3, &mut workspace).unwrap();
    readings.iter().for_each(|r| test.absorb(r).unwrap());
    let fit = test.solve(Some(&[1e-3; NOMINAL])).unwrap();
    let blind = fit.visibility.blind_directions()[0];
    let along: f64 = (0..NOMINAL)
        .map(|i| {
            blind[i]
                * (0..NOMINAL)
                    .map(|j| fit.covariance[i][j] * blind[j])
                    .sum::<f64>()
        })
        .sum();
    assert!((along.sqrt() / 1e-3 - 1.0).abs() < 0.01, "{}", along.sqrt());
}

/// Root mean square miss of k2 from noiseless readings of many instruments in the precision `T`.
fn miss_of_k2<T: Real>() -> f64 {
    let exact = Bench {
        dial_sigma_rad: T::zero(),
        dial_repeat_sigma_rad: T::zero(),
        mount_sigma_rad: T::zero(),
        level_sigma_rad: T::zero(),
        local_gravity_g: T::one(),
    };
    let instruments = 100;
    let squares: f64 = (0..instruments)
        .map(|seed| {
            let truth = random_instrument(&mut ChaCha8Rng::seed_from_u64(seed));
            let mut workspace = vec![T::zero(); workspace_len(1, 3)];
            let mut test =
                StaticTest::new(exact, Coefficients::default(), 1, 3, &mut workspace).unwrap();
            for position in full_rank_plan() {
                let output_v = T::lit(truth.output_v(position.specific_force()));
                test.absorb(&Reading {
                    position,
                    output_v,
                    sigma_v: T::lit(1e-6),
                })
                .unwrap();
            }
            let found = test
                .solve(None)
                .unwrap()
                .coefficients
                .second_order_per_g
                .to_f64();
            (found - truth.second_order_per_g).powi(2)
        })
        .sum();
    (squares / instruments as f64).sqrt()
}

#[test]
fn identification_at_1e_7_needs_double_precision() {
    let (double, single) = (miss_of_k2::<f64>(), miss_of_k2::<f32>());
    assert!(double < 1e-13, "f64 misses k2 by {double}");
    assert!(single > 1e-7, "f32 misses k2 by {single}");
}

/// At right angles the kink of |a_I| lies within the rounding of a cosine; a mount's estimate that is zero but for rounding must
/// not put a reading on this side or on that.
#[test]
fn the_order_of_readings_changes_no_coefficient() {
    let bench = Bench {
        dial_repeat_sigma_rad: 0.0,
        ..bench(1.0)
    };
    let plan: Vec<Position> = paper_plan().take(14).collect();
    for seed in 0..8 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let instrument = random_instrument(&mut rng);
        let mut readings = measure(&plan, &instrument, &bench, &mut rng);
        let in_order = identify(&readings, bench);
        for by in [3, 7, 9] {
            readings.rotate_left(by);
            readings.swap(0, by);
            let shuffled = identify(&readings, bench);
            let of = |fit: &Fit<f64>| fit.coefficients.to_nominal();
            for (k, (a, b)) in of(&in_order).into_iter().zip(of(&shuffled)).enumerate() {
                let sigma = in_order.covariance[k][k].sqrt();
                assert!((a - b).abs() <= 1e-3 * sigma + 1e-12, "{seed} {k}: {a} {b}");
            }
        }
    }
}
