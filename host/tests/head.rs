//! A batch of instruments calibrates its dividing head.

use host::bench::noise::Seed;
use host::bench::plant::{Plant, every_fifteen_degrees};
use host::bench::simulate::Simulation;
use host::head::batch::sum;
use host::head::changes::changes;
use host::head::harmonics::advice;
use host::head::outlook::{Mounting, PlannedBatch, outlook};
use host::head::teaching::taught;
use host::head::{Batch, DEFAULT_SPREAD, HeadFile, Prior, Reduced, harmonics, known, settle};
use host::statics::{Environment, Method, identify};
use shared::identify::static_test::Bench;
use shared::model::SpecificForce;
use shared::rectification::Sensitivity;
use shared::tumble::{ARCSEC_RAD, Position};
use shared::vibration::Random;

/// Place of k2 among the coefficients of the model.
const K2: usize = 3;

fn environment() -> Environment {
    Environment {
        name: "random:1".into(),
        a0_i_g: 0.0,
        moments: Random::along(SpecificForce::new(1.0, 0.0, 0.0)).into(),
    }
}

fn made(plant: &Plant, count: u64) -> Vec<(Simulation, Reduced)> {
    let one = |number| {
        let simulation = plant.campaign(number);
        let reduced = Reduced::of(&simulation.campaign).unwrap();
        (simulation, reduced)
    };
    (0..count).map(one).collect()
}

/// The table of an independent calculation: sd of k2, 1e-6 / g, at 1, 10, 100, 1000 and 10 000 instruments. It states neither
/// the type's spread nor what is known of its mean; these are the ones at which it comes out.
#[test]
fn the_outlook_of_a_batch_is_the_published_table_within_10_percent() {
    const TABLE: [(Mounting, [f64; 5]); 3] = [
        (Mounting::Alike, [50.0, 49.9, 49.9, 49.9, 49.9]),
        (Mounting::Alternating, [50.0, 7.3, 4.7, 3.8, 3.7]),
        (Mounting::Remounted, [4.0, 3.2, 3.1, 3.1, 3.1]),
    ];
    let spread = [
        7.7e-6, 2.55e-5, 2.28e-5, 8.5e-6, 2.9e-6, 5.2e-5, 5.2e-5, 2.9e-6, 2.9e-6, 2.9e-6,
    ];
    let mean = [
        8.7e-5, 9e-5, 1.2e-4, 5.7e-4, 1.83e-5, 2.6e-4, 2.6e-4, 1.44e-5, 1.44e-5, 1.44e-5,
    ];
    let plan: Vec<Position> = every_fifteen_degrees()
        .iter()
        .map(|dwell| Position {
            series: dwell.series,
            dial_deg: dwell.dial_deg,
            mount_deg: 0.0,
        })
        .collect();
    let bench = Bench {
        dial_sigma_rad: 5.8 * ARCSEC_RAD,
        dial_repeat_sigma_rad: 0.0,
        mount_sigma_rad: 60.0 * ARCSEC_RAD,
        level_sigma_rad: 5.8 * ARCSEC_RAD,
        local_gravity_g: 1.0,
    };
    for (column, instruments) in [1, 10, 100, 1000, 10_000].into_iter().enumerate() {
        let planned = PlannedBatch {
            instruments,
            spread,
            prior: Prior::of_type(mean),
        };
        let told = outlook(&plan, &bench, 1e-6, &planned, &[environment()]).unwrap();
        for (outlook, (mounting, row)) in told.iter().zip(TABLE) {
            assert_eq!(outlook.mounting, mounting);
            let ratio = outlook.coefficient_sigma[K2] * 1e6 / row[column];
            assert!(
                (ratio.ln()).abs() < 0.1,
                "{mounting:?} {instruments}: {ratio}"
            );
            let alike = mounting == Mounting::Alike;
            // One instrument alone tells the first harmonic as little as many that are mounted alike.
            if instruments > 1 {
                assert_eq!(
                    outlook.blind_first_harmonic, alike,
                    "{mounting:?} {instruments}"
                );
            }
        }
    }
}

#[test]
fn sums_of_parts_in_any_order_are_the_sum_of_the_whole() {
    let all: Vec<Reduced> = made(&Plant::new(Seed(3), 5.8), 7)
        .into_iter()
        .map(|m| m.1)
        .collect();
    let whole = sum(&all, DEFAULT_SPREAD)
        .unwrap()
        .posterior(&Prior::default())
        .unwrap();
    let mut parts = Batch::new(DEFAULT_SPREAD);
    for part in [&all[4..], &all[..2], &all[2..4]] {
        let part = sum(part, DEFAULT_SPREAD).unwrap();
        let text = serde_json::to_string(&part).unwrap();
        parts.merge(&serde_json::from_str(&text).unwrap()).unwrap();
    }
    let parts = parts.posterior(&Prior::default()).unwrap();
    for (a, b) in whole.mean.iter().zip(&parts.mean) {
        assert!((a - b).abs() < 1e-11, "{a} {b}");
    }
    let removed = {
        let mut batch = sum(&all, DEFAULT_SPREAD).unwrap();
        batch.remove(&all[6]).unwrap();
        batch.posterior(&Prior::default()).unwrap()
    };
    let without = sum(&all[..6], DEFAULT_SPREAD)
        .unwrap()
        .posterior(&Prior::default())
        .unwrap();
    assert!((removed.squares / without.squares - 1.0).abs() < 1e-6);
}

/// What the batches of many plants come to.
struct Consistency {
    /// Mean squared z of k2, and of the static VRE, with the standard error over plants: instruments of one plant share the
    /// error of its head, so that plants count.
    mean_square_z: [(f64, f64); 2],
    /// Mean stated standard uncertainty of k2, 1 / g.
    sigma_k2: f64,
    /// Share of instruments whose static VRE is off by more than 35 %.
    off: f64,
}

fn consistency(plants: u64, instruments: u64, dial_sigma_arcsec: f64) -> Consistency {
    let sensitivity = Sensitivity::new(0.0, environment().moments);
    let mut of_plants = [Vec::new(), Vec::new()];
    let (mut sigma, mut off, mut count) = (0.0, 0.0, 0.0);
    for seed in 0..plants {
        let made = made(&Plant::new(Seed(seed), dial_sigma_arcsec), instruments);
        let reduced: Vec<Reduced> = made.iter().map(|m| m.1.clone()).collect();
        let (_, posterior) = settle(&reduced, DEFAULT_SPREAD, &Prior::default(), |_| ()).unwrap();
        let mut squares = [0.0; 2];
        for (simulation, reduced) in &made {
            let found = posterior.instrument(reduced).unwrap();
            let truth = simulation.truth.coefficients;
            let covariance: [[f64; 11]; 11] =
                std::array::from_fn(|i| std::array::from_fn(|j| found.covariance[(i, j)]));
            squares[0] += (found.values[K2] - truth[K2]).powi(2) / covariance[K2][K2];
            let vre = |c: &[f64; 11]| (1..11).map(|k| sensitivity.nominal[k] * c[k]).sum::<f64>();
            let error = vre(&found.values) - vre(&truth);
            squares[1] += error * error / sensitivity.variance_g2(&covariance);
            off += f64::from(u8::from(error.abs() > 0.35 * vre(&truth).abs()));
            sigma += covariance[K2][K2].sqrt();
            count += 1.0;
        }
        for (all, of_plant) in of_plants.iter_mut().zip(squares) {
            all.push(of_plant / instruments as f64);
        }
    }
    let mean_and_error = |values: &Vec<f64>| {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, (variance / n).sqrt())
    };
    Consistency {
        mean_square_z: [mean_and_error(&of_plants[0]), mean_and_error(&of_plants[1])],
        sigma_k2: sigma / count,
        off: off / count,
    }
}

/// The type's spread is not known beforehand, and is told by the batch itself.
#[test]
fn coefficients_of_a_batch_lie_within_their_uncertainty_as_often_as_it_claims() {
    for (plants, instruments, table) in [(200, 10, 7.3e-6), (40, 100, 4.7e-6)] {
        let found = consistency(plants, instruments, 5.8);
        println!(
            "{plants} plants of {instruments}: mean z^2 of k2 and VRE {:.3?}, sd of k2 {:.2}e-6",
            found.mean_square_z,
            1e6 * found.sigma_k2
        );
        for (mean, error) in found.mean_square_z {
            assert!((mean - 1.0).abs() < 4.0 * error, "{mean} +- {error}");
            assert!(error < 0.25, "{error}");
        }
        assert!(
            (found.sigma_k2 / table - 1.0).abs() < 0.1,
            "{}",
            found.sigma_k2
        );
    }
}

/// A head of the paper's 10 arcsec, taken as a standard deviation; no extra reading.
#[test]
fn the_static_vre_of_a_hundred_instruments_is_off_by_35_percent_in_5_percent_at_most() {
    let found = consistency(12, 100, 10.0);
    println!("off by more than 35 %: {:.3}", found.off);
    assert!(found.off < 0.05, "{}", found.off);
}

#[test]
fn a_batch_mounted_alike_is_blind_to_the_first_harmonic_and_says_so() {
    for (alternate, blind) in [(false, true), (true, false)] {
        let plant = Plant {
            alternate,
            ..Plant::new(Seed(5), 5.8)
        };
        let reduced: Vec<Reduced> = made(&plant, 40).into_iter().map(|m| m.1).collect();
        let (_, posterior) = settle(&reduced, DEFAULT_SPREAD, &Prior::default(), |_| ()).unwrap();
        let told = harmonics(&posterior);
        assert_eq!(advice(&told).is_some(), blind, "{told:?}");
    }
}

#[test]
fn a_rezeroed_head_is_found_within_10_instruments_and_a_steady_one_is_not() {
    for seed in 0..12 {
        for rezeroed_before in [None, Some(12)] {
            let plant = Plant {
                rezeroed_before,
                ..Plant::new(Seed(seed), 5.8)
            };
            let parts: Vec<Batch> = made(&plant, 22)
                .iter()
                .map(|(_, reduced)| sum(std::slice::from_ref(reduced), DEFAULT_SPREAD).unwrap())
                .collect();
            let expected: Vec<usize> = rezeroed_before.iter().map(|at| *at as usize).collect();
            assert_eq!(changes(&parts), expected, "{seed} {rezeroed_before:?}");
            // As early as after the first instrument on the changed head.
            if rezeroed_before.is_some() {
                assert_eq!(changes(&parts[..14]), expected, "{seed}");
            }
        }
    }
}

/// One instrument that was remounted teaches the head; the next one, mounted once, is sharp.
#[test]
fn one_remounted_instrument_teaches_the_head_for_the_next() {
    let mut plant = Plant {
        alternate: false,
        ..Plant::new(Seed(11), 5.8)
    };
    let once = plant.dwells.clone();
    let turned = once.iter().map(|dwell| host::bench::plan::Dwell {
        mount_deg: 180.0,
        ..*dwell
    });
    plant.dwells.extend(turned);
    let teacher = plant.campaign(0).campaign;
    let (head, _) = taught(None, "H1", &teacher, &Reduced::of(&teacher).unwrap()).unwrap();
    assert!(taught(Some(&head), "H1", &teacher, &Reduced::of(&teacher).unwrap()).is_err());
    let file = tempfile::tempdir().unwrap();
    let file = file.path().join("head.toml");
    head.write(&file).unwrap();
    let head = HeadFile::read(&file).unwrap();
    plant.dwells = once;
    let (mut squares, mut gain, count) = (0.0, f64::INFINITY, 40);
    for number in 1..=count {
        let Simulation {
            campaign, truth, ..
        } = plant.campaign(number);
        let alone = identify(&campaign, Method::LeastSquares, None).unwrap();
        let known = known(&campaign, &head).unwrap();
        assert!(known.holds(), "{number}: {}", known.log_odds);
        let found = identify(&known.campaign, Method::LeastSquares, None).unwrap();
        let (value, sigma) = found.coefficients[K2].known().unwrap();
        squares += ((value - truth.coefficients[K2]) / sigma).powi(2) / count as f64;
        gain = gain.min(alone.coefficients[K2].sigma.unwrap() / sigma);
    }
    // The error of the head is common to all of them: a bound, not a test of consistency.
    assert!(squares < 9.0, "{squares}");
    // The calculation has 162 microg before and 23 after: 7 times.
    assert!(gain > 7.0, "{gain}");
}

fn vre(arguments: &[&str]) -> assert_cmd::assert::Assert {
    assert_cmd::Command::cargo_bin("vre")
        .unwrap()
        .args(arguments)
        .assert()
}

#[test]
fn a_campaign_teaches_a_file_from_which_the_next_one_is_sharper() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let plant = Plant {
        shaken: true,
        alternate: false,
        ..Plant::new(Seed(4), 5.8)
    };
    plant
        .campaign(0)
        .campaign
        .write(&folder.path().join("first"))
        .unwrap();
    plant
        .campaign(1)
        .campaign
        .write(&folder.path().join("second"))
        .unwrap();
    let [first, second, head, json] = ["first", "second", "head.toml", "out.json"].map(place);
    let told = vre(&["identify", &first, "--teach", &head]).success();
    let told = String::from_utf8(told.get_output().stdout.clone()).unwrap();
    assert!(told.contains("head H1, 1 campaign, 24 marks"), "{told}");
    // It was shaken: the head is not blind. (The plan is, to k_PO.)
    assert!(!told.contains("BLIND: the first harmonic"), "{told}");
    let sigma = |arguments: &[&str]| {
        vre(&[&["identify", &second, "--json", &json], arguments].concat()).success();
        let answer: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
        answer["coefficients"]["k2_per_g"]["sigma"]
            .as_f64()
            .unwrap()
    };
    let (alone, beside) = (sigma(&[]), sigma(&["--head", &head]));
    assert!(alone > 7.0 * beside, "{alone} {beside}");
    for command in ["predict", "diagnose"] {
        vre(&[command, &second, "--head", &head, "--quiet"]).success();
    }
    let again = vre(&["identify", &first, "--teach", &head]).code(2);
    let again = String::from_utf8(again.get_output().stderr.clone()).unwrap();
    assert!(again.contains("taught this head already"), "{again}");
}

#[test]
fn fleets_are_a_program_of_their_own_and_how_to_get_it_is_told() {
    let folder = tempfile::tempdir().unwrap();
    // A copy where no vre-fleet is.
    let copy = folder.path().join("vre");
    std::fs::copy(assert_cmd::cargo::cargo_bin("vre"), &copy).unwrap();
    let told = assert_cmd::Command::new(&copy)
        .args(["fleet", "gather", "--out", "x"])
        .env("PATH", "")
        .assert()
        .code(2);
    let told = String::from_utf8(told.get_output().stderr.clone()).unwrap();
    assert!(told.contains("cargo install --path host/fleet"), "{told}");
}

#[test]
fn a_head_file_that_cannot_be_is_one_line_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("head.toml");
    let campaign = folder.path().join("campaign");
    Plant::new(Seed(4), 5.8)
        .campaign(0)
        .campaign
        .write(&campaign)
        .unwrap();
    for text in [
        "",
        "format = \"vre-head/2\"",
        "\u{1}",
        "format = \"vre-head/1\"\nid = \"H\"\ncampaigns = []\ncovariance = [[nan]]\n[marks]\ndial_deg=[]\nerror_arcsec=[]\nsigma_arcsec=[]\n[type]\nnames=[]\nmean=[]\nspread=[]",
    ] {
        std::fs::write(&file, text).unwrap();
        let arguments = [
            "identify",
            campaign.to_str().unwrap(),
            "--head",
            file.to_str().unwrap(),
        ];
        let told = vre(&arguments).code(2);
        let told = String::from_utf8(told.get_output().stderr.clone()).unwrap();
        assert!(
            told.contains("head.toml") && told.lines().count() == 1,
            "{told}"
        );
    }
}

#[test]
fn a_plan_tells_beforehand_what_alternating_mounts_gain() {
    let told = vre(&["plan", "full", "--batch", "100"]).success();
    let told = String::from_utf8(told.get_output().stdout.clone()).unwrap();
    for expected in [
        "all mounted alike",
        "every other one turned by 180 deg",
        "BLIND, mounted alike",
    ] {
        assert!(told.contains(expected), "{told}");
    }
}

#[test]
fn a_rezeroed_head_is_noticed_by_the_next_single_campaign() {
    for seed in 0..20 {
        let plant = Plant {
            rezeroed_before: Some(6),
            ..Plant::new(Seed(seed), 5.8)
        };
        let made = made(&plant, 8);
        let reduced: Vec<Reduced> = made[..6].iter().map(|m| m.1.clone()).collect();
        let (_, posterior) = settle(&reduced, DEFAULT_SPREAD, &Prior::default(), |_| ()).unwrap();
        let head = HeadFile::new("H1", &posterior, Vec::new());
        let after = known(&made[7].0.campaign, &head).unwrap();
        assert!(!after.holds(), "{seed}: {}", after.log_odds);
        assert_eq!(after.campaign, made[7].0.campaign);
    }
}
