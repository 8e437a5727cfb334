//! The whole path: virtual bench, converter, the firmware's driver and application, frames, record, reduction,
//! identification, prediction.

use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Specification, VirtualBench};
use host::capture::{Captured, capture_virtual};
use host::prediction::predict;
use host::statics::{Method, identify};
use nalgebra::{SMatrix, SVector};

fn bench(seed: u64, runs: usize) -> VirtualBench {
    let specification = Specification::with_dial_sigma(5.8);
    let mut bench = VirtualBench::new(Seed(seed), Static::Remounted, specification, Vec::new());
    bench.plan.runs.retain(|run| run.f_hi_hz <= 480.0);
    bench.plan.runs.truncate(runs);
    bench
}

fn capture(bench: &VirtualBench) -> Captured {
    let folder = tempfile::tempdir().unwrap();
    capture_virtual(bench, folder.path(), || ()).unwrap()
}

#[test]
fn no_sample_is_lost_and_every_reading_comes_back() {
    let bench = bench(3, 4);
    let Captured {
        campaign, tally, ..
    } = capture(&bench);
    assert_eq!((campaign.readings.len(), campaign.runs.len()), (80, 4));
    assert_eq!(
        (
            tally.blocks.missing,
            tally.missing_frames,
            tally.damaged_bytes
        ),
        (0, 0, 0)
    );
    for (run, shake) in campaign.runs.iter().zip(&bench.plan.runs) {
        let seen = run.reference.unwrap();
        let root = if shake.f_lo_hz == shake.f_hi_hz {
            2f64.sqrt()
        } else {
            1.0
        };
        for axis in 0..3 {
            let commanded_g = (shake.level_g * shake.direction[axis]).abs() / root;
            // The reference's scale is good to 2e-4; the droop of a band is corrected by its flat spectrum's.
            assert!((seen.rms_g[axis] - commanded_g).abs() < 2e-3 * commanded_g.max(1e-3));
        }
    }
}

#[test]
fn coefficients_and_chi_square_are_as_stated_over_many_instruments() {
    let campaigns = 16;
    let (mut squares, mut freedom, mut chi2, mut dof) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..campaigns {
        let bench = bench(100 + seed, 0);
        let found = identify(&capture(&bench).campaign, Method::LeastSquares, None).unwrap();
        let truth = bench.accelerometer.coefficients.to_nominal();
        // The eleven are correlated: their joint distance from the truth is a chi-square of eleven degrees of freedom.
        let error = SVector::from(found.model.to_nominal()) - SVector::from(truth);
        let covariance: SMatrix<f64, 11, 11> = found.covariance.into();
        let factor = covariance.cholesky().expect("a covariance");
        squares += error.dot(&factor.solve(&error));
        freedom += error.len() as f64;
        chi2 += found.chi2.unwrap();
        dof += found.dof as f64;
    }
    // Five of its standard deviations are 0.53: a sigma of 0.8 or of 1.5 times the true one fails.
    let mean = squares / freedom;
    assert!(
        (mean - 1.0).abs() < 5.0 * (2.0 / freedom).sqrt(),
        "mean square of the joint error {mean}"
    );
    // The noise itself is known to 8 %, its variance to 16 %, from 80 readings.
    let noise = 0.16 / (campaigns as f64).sqrt();
    let bound = 5.0 * (2.0 / dof + noise * noise).sqrt();
    assert!(
        (chi2 / dof - 1.0).abs() < bound,
        "reduced chi-square {}",
        chi2 / dof
    );
}

#[test]
fn measured_vibration_errors_agree_with_the_refitted_model() {
    let (mut squares, mut most, mut fewest) = (0.0, 0.0, 0.0);
    for seed in 5..8 {
        let Captured { campaign, .. } = capture(&bench(seed, 61));
        let prediction = predict(&campaign, &campaign.runs, None).unwrap();
        for run in &prediction.runs {
            let (measured, sigma) = run.measured_vre_g.unwrap().known().unwrap();
            let (refitted, _) = run.refit_vre_g.unwrap().known().unwrap();
            squares += ((measured - refitted) / sigma).powi(2);
        }
        // Of the eleven coefficients the seven that rectify take up to as many degrees of freedom off the runs.
        most += prediction.runs.len() as f64;
        fewest += prediction.runs.len() as f64 - 7.0;
    }
    let spread = |freedom: f64| 5.0 * (2.0 * freedom).sqrt();
    let allowed = fewest - spread(fewest)..most + spread(most);
    assert!(
        allowed.contains(&squares),
        "{squares} is not within {allowed:?}"
    );
}
