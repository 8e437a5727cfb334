//! Identification of 80 readings with correlated errors: the 40 positions of full rank at two mounts, dial, mount
//! and level as random effects, in two passes as the host does it, covariance, rank and condition included.
//!
//! `cargo bench -p shared --bench identification`

use divan::{Bencher, black_box};
use shared::identify::static_test::{Bench, Fit, Reading, StaticTest, workspace_len};
use shared::model::Coefficients;
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
