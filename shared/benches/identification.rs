//! Identification of 80 readings with correlated errors: the 40 positions of full rank at two mounts, dial, mount
//! and level as random effects, in two passes as the host does it, covariance, rank and condition included.
//!
//! And of a triad: 80 orientations by hand, three passes and the answer with rank, blind directions and covariance.
//!
//! `cargo bench -p shared --bench identification`

use divan::{Bencher, black_box};
use shared::identify::static_test::{Bench, Fit, Reading, StaticTest, workspace_len};
use shared::model::Coefficients;
use shared::triad::attitude::Position as TriadPosition;
use shared::triad::body::outputs_v;
use shared::triad::identification::{Fit as TriadFit, Prior, identify};
use shared::tumble::{Position, full_rank_plan};

const MARKS: usize = 16;
const MOUNTS: usize = 6;
const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;

fn main() {
    divan::main();
}

fn readings() -> Vec<Reading<f64>> {
    let truth = Coefficients::from_nominal([
        1.2, 1e-4, -6e-4, 4e-4, 3e-4, -5e-5, 4e-4, -6e-4, -5e-5, 3e-5, 5e-5,
    ]);
    let mounted = |p: Position| [0.0, 180.0].map(|mount_deg| Position { mount_deg, ..p });
    full_rank_plan()
        .flat_map(mounted)
        .map(|position| Reading {
            position,
            output_v: truth.output_v(position.specific_force()),
            sigma_v: 1.5e-6,
        })
        .collect()
}

fn pass(
    readings: &[Reading<f64>],
    about: Coefficients<f64>,
    workspace: &mut [f64],
) -> Option<Fit<f64>> {
    let bench = Bench {
        dial_sigma_rad: 5.8 * ARCSEC,
        dial_repeat_sigma_rad: 0.2 * ARCSEC,
        mount_sigma_rad: 60.0 * ARCSEC,
        level_sigma_rad: 5.8 * ARCSEC,
        local_gravity_g: 1.0,
    };
    let mut test = StaticTest::new(bench, about, MARKS, MOUNTS, workspace).ok()?;
    for reading in readings {
        test.absorb(reading).ok()?;
    }
    test.solve(None).ok()
}

#[divan::bench]
fn eighty_readings(bencher: Bencher) {
    let readings = readings();
    let mut workspace = vec![0.0; workspace_len(MARKS, MOUNTS)];
    bencher.bench_local(|| {
        let first = pass(
            black_box(&readings),
            Coefficients::default(),
            &mut workspace,
        )?;
        pass(&readings, first.coefficients, &mut workspace)
    });
}

fn orientations_by_hand() -> Vec<TriadPosition> {
    let triad = [
        [
            1.2, 1e-4, -6e-4, 4e-4, 3e-4, -5e-5, 0.0, 0.0, -5e-5, 3e-5, 5e-5,
        ],
        [
            1.1, 2e-4, 6e-4, 1e-4, -3e-4, 5e-5, 0.0, -6e-4, 5e-5, 2e-5, -5e-5,
        ],
        [
            1.3, -1e-4, 3e-4, 2e-4, 1e-4, -2e-5, 4e-4, 3e-4, 2e-5, -3e-5, 1e-5,
        ],
    ]
    .map(Coefficients::from_nominal);
    (0..80)
        .map(|k| {
            let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 80.0;
            let (sin, cos) = (2.399_963 * f64::from(k)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            TriadPosition {
                output_v: outputs_v(&triad, [r * cos, r * sin, z]),
                sigma_v: [2.4e-6; 3],
                attitude: None,
            }
        })
        .collect()
}

#[divan::bench]
fn eighty_orientations_of_a_triad(bencher: Bencher) {
    let positions = orientations_by_hand();
    let nominal = Coefficients {
        scale_factor_v_per_g: 1.2,
        ..Coefficients::default()
    };
    bencher.bench_local(|| -> Option<TriadFit> {
        let prior = Prior::cross_couplings(5e-5);
        identify(black_box(&positions), [nominal; 3], 1.0, &prior).ok()
    });
}
