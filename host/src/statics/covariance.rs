//! The covariance of static readings, one for everybody.
//!
//! A reading carries its own noise and repeatability, and errors that it shares with others: that of its dial mark, that
//! of its series and mount, and two tilts of the base, common to all. The first mount is a mount like any other. Marks of
//! which other campaigns tell something have the covariance that these leave.

use shared::identify::static_test::Bench;
use shared::tumble::within_a_turn;

use super::readings::position;
use crate::campaign::{MarkErrors, Reading};

/// Covariance of the outputs of `readings`, g^2: the lower triangle row by row, element (i, j <= i) at i (i + 1) / 2 + j.
///
/// To first order in the angles, for an instrument without nonlinearity; `scale_v_per_g` turns the stated noise from V
/// into g. Marks and mounts are the same if they are so within a turn. `known`: what is known of the marks' errors; the others
/// are uncertain as the bench states.
pub fn covariance(
    readings: &[Reading],
    bench: &Bench<f64>,
    known: Option<&MarkErrors>,
    scale_v_per_g: f64,
) -> Vec<f64> {
    let square = |x: f64| x * x;
    let variance = |sigma_rad: f64| square(sigma_rad * bench.local_gravity_g);
    let row = |reading| Row::new(reading, known);
    let rows: Vec<_> = readings.iter().map(row).collect();
    let mut triangle = Vec::with_capacity(rows.len() * (rows.len() + 1) / 2);
    for (i, a) in rows.iter().enumerate() {
        for (j, b) in rows[..=i].iter().enumerate() {
            let mut angle = variance(bench.level_sigma_rad);
            angle += match (known, a.known, b.known) {
                (Some(known), Some(a), Some(b)) => {
                    known.between(a, b) * square(bench.local_gravity_g)
                }
                _ if a.mark_deg == b.mark_deg => variance(bench.dial_sigma_rad),
                _ => 0.0,
            };
            if a.series == b.series && a.mount_deg == b.mount_deg {
                angle += variance(bench.mount_sigma_rad);
            }
            if i == j {
                angle += variance(bench.dial_repeat_sigma_rad);
            }
            let lift = variance(bench.level_sigma_rad);
            let mut element = angle * a.by_angle * b.by_angle + lift * a.by_lift * b.by_lift;
            if i == j {
                element += square(readings[i].sigma_v / scale_v_per_g);
            }
            triangle.push(element);
        }
    }
    triangle
}

/// The whole matrix, row by row, of a lower triangle of that order.
pub fn symmetric(triangle: &[f64], order: usize) -> Vec<f64> {
    let element = |place: usize| {
        let (i, j) = (place / order, place % order);
        let (i, j) = (i.max(j), i.min(j));
        triangle[i * (i + 1) / 2 + j]
    };
    (0..order * order).map(element).collect()
}

/// What of a reading its covariances depend on.
struct Row {
    series: shared::tumble::Series,
    mark_deg: f64,
    /// Place of its mark among the known ones.
    known: Option<usize>,
    mount_deg: f64,
    /// Derivative of a_I by the instrument's angle, and by the lift of the axis of rotation, in units of local gravity.
    by_angle: f64,
    by_lift: f64,
}

impl Row {
    fn new(reading: &Reading, known: Option<&MarkErrors>) -> Self {
        let place = position(reading);
        Self {
            series: place.series,
            mark_deg: within_a_turn(place.dial_deg),
            known: known.and_then(|known| known.place(place.dial_deg)),
            mount_deg: within_a_turn(place.mount_deg),
            by_angle: place.series.tangent(place.phi_rad()).i,
            by_lift: place.series.lift::<f64>().i,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use shared::identify::static_test;
    use shared::model::{Coefficients, NOMINAL, terms};

    use super::*;
    use crate::bench::noise::Seed;
    use crate::bench::plan::Static;
    use crate::bench::simulate::{Specification, VirtualBench};
    use crate::statics::least_squares::Workspace;
    use crate::statics::readings;

    #[test]
    fn least_squares_with_this_covariance_is_the_fit_with_random_effects() {
        for plan in [Static::Default, Static::Remounted] {
            let specification = Specification::with_dial_sigma(5.8);
            let mut bench = VirtualBench::new(Seed(3), plan, specification, Vec::new());
            bench.plan.runs.clear();
            bench.plan.holdout.clear();
            bench.accelerometer.coefficients = Coefficients::default();
            let campaign = bench.simulate().campaign;
            let n = campaign.readings.len();
            let stated = readings::bench(&campaign.config.bench);

            let matrix = covariance(&campaign.readings, &stated, None, 1.0);
            let matrix = DMatrix::from_row_slice(n, n, &symmetric(&matrix, n));
            let factor = matrix.cholesky().expect("a covariance");
            let design = DMatrix::from_fn(n, NOMINAL, |i, k| {
                terms(readings::position(&campaign.readings[i]).specific_force())[k]
            });
            let outputs = DVector::from_fn(n, |i, _| campaign.readings[i].output_v);
            let information = design.transpose() * factor.solve(&design);
            let dense = information.try_inverse().expect("full rank");
            let x = &dense * (design.transpose() * factor.solve(&outputs));

            let places = campaign.readings.iter().map(readings::position);
            let mut workspace = Workspace::of(places);
            let mut test = workspace.test(stated, Coefficients::default()).unwrap();
            for reading in &campaign.readings {
                let reading = static_test::Reading {
                    position: readings::position(reading),
                    output_v: reading.output_v,
                    sigma_v: reading.sigma_v,
                };
                test.absorb(&reading).unwrap();
            }
            let fit = test.solve(None).unwrap();
            // With K1 within 1e-4 of 1 and small coefficients the division by K1 changes sigmas by no more than 1e-3.
            let found = fit.coefficients.to_nominal();
            for k in 0..NOMINAL {
                let (theirs, ours) = (dense[(k, k)].sqrt(), fit.covariance[k][k].sqrt());
                assert!((ours / theirs - 1.0).abs() < 1e-3, "{k}: {ours} {theirs}");
                assert!((found[k] - x[k] / x[0].powi(i32::from(k > 0))).abs() < 1e-3 * theirs);
            }
        }
    }

    #[test]
    fn a_first_mount_errs_like_any_other() {
        let specification = Specification::with_dial_sigma(5.8);
        let bench = VirtualBench::new(Seed(1), Static::Remounted, specification, Vec::new());
        let campaign = bench.config();
        let stated = readings::bench(&campaign.bench);
        let exact = Bench {
            mount_sigma_rad: 0.0,
            ..stated
        };
        let reading = |mount_deg: f64| Reading {
            mount_deg,
            ..bench.simulate().campaign.readings[2].clone()
        };
        for mount_deg in [0.0, 180.0, 360.0] {
            let pair = [reading(mount_deg), reading(mount_deg)];
            let [with, without] = [&stated, &exact].map(|b| covariance(&pair, b, None, 1.0)[1]);
            let mount = (60.0 * shared::tumble::ARCSEC_RAD).powi(2);
            assert!(((with - without) / mount - 1.0).abs() < 1e-9, "{mount_deg}");
        }
    }
}
