//! The observations of a campaign as one whitened vector.
//!
//! Everything is divided by one scale factor, so that outputs are in g. Static readings are whitened by the Cholesky
//! factor of their covariance: noise and repeatability of each, one error a mark, two tilts of the base, one error a
//! remounting. The plateaus of a run stand for themselves, at the run's nominal attitude.

use inference::observations::{self, Observations};
use shared::tumble::within_a_turn;

use crate::campaign::{Campaign, Measured, Run, VibrationKind};
use crate::forward::conditions::{ARCSEC_RAD, RunConditions, seen_ratios};
use crate::forward::contribution::{Contribution, Layout, Observable};
use crate::forward::motion::main_axis;
use crate::statics::position;

/// Relative standard uncertainty of the peak detector's excursion, and of what small motions inside the instrument
/// add to it.
const EXTREME_REL_SIGMA: f64 = 5e-4;
/// Least excursion at which an extreme is used, g.
const EXTREME_LEAST_G: f64 = 0.1;
/// Uncertainty of a ratio of the reference's axes, and of the moments of a sine, beside the stated one.
const REFERENCE_SIGMA: f64 = 1e-5;
const SHAPE_SIGMA: f64 = 1e-4;

/// What is special about an observable.
struct Properties {
    /// Name in the answer's gap; none where no gap is looked for.
    gap: Option<&'static str>,
    /// Whether it depends on how the instrument moves.
    moves: bool,
}

/// The properties of each observable.
const fn properties(observable: Observable) -> Properties {
    let (gap, moves) = match observable {
        Observable::Static => (Some("static"), false),
        Observable::Before => (Some("bias"), false),
        Observable::During => (Some("vibration"), true),
        Observable::After => (Some("recovery"), false),
        Observable::Drift => (Some("in-run-drift"), false),
        Observable::Maximum | Observable::Minimum => (None, true),
        Observable::Reference | Observable::Shape => (None, false),
    };
    Properties { gap, moves }
}

/// Observables of a gap, in the order of reports.
pub const GAP: [Observable; 5] = [
    Observable::Static,
    Observable::During,
    Observable::Before,
    Observable::After,
    Observable::Drift,
];

/// Name of an observable in the answer's gap.
pub fn name(observable: Observable) -> &'static str {
    properties(observable).gap.unwrap_or("")
}

/// The observations of a campaign's readings and of runs in the order of time.
pub fn observe(
    campaign: &Campaign,
    layout: &Layout,
    runs: &[&Run],
    scale_v_per_g: f64,
) -> Observations {
    let mut seen = Seen {
        layout,
        scale_v_per_g,
        values: layout.nothing(),
        sigma: vec![f64::INFINITY; layout.len()],
    };
    for (row, reading) in campaign.readings.iter().enumerate() {
        seen.values
            .add(Observable::Static, row, reading.output_v / scale_v_per_g);
    }
    let shaker = campaign.config.shaker.as_ref();
    for (row, run) in runs.iter().enumerate() {
        let Some(measured) = run.measured else {
            continue;
        };
        seen.output(row, run, &measured);
        if let Some(shaker) = shaker {
            seen.reference(row, run, shaker.reference_rms_rel_sigma);
        }
    }
    let observables = Observable::ALL.map(|observable| observations::Observable {
        name: name(observable),
        rows: layout.rows(observable),
        transforms: properties(observable).moves,
    });
    Observations::new(
        observables.to_vec(),
        GAP.map(|observable| observable as usize).to_vec(),
        Observable::During as usize,
        static_factor(campaign, scale_v_per_g),
        seen.sigma.iter().map(|sigma| sigma.recip()).collect(),
        seen.values.column.values,
    )
}

/// What was seen so far.
struct Seen<'l> {
    layout: &'l Layout,
    scale_v_per_g: f64,
    values: Contribution,
    sigma: Vec<f64>,
}

impl Seen<'_> {
    fn put(&mut self, observable: Observable, row: usize, value: f64, sigma: f64) {
        self.values.add(observable, row, value);
        self.sigma[self.layout.rows(observable).start + row] = sigma;
    }

    /// The plateaus, the drift, and the extremes where they tell anything.
    fn output(&mut self, row: usize, run: &Run, measured: &Measured) {
        let scale = self.scale_v_per_g;
        let noise = measured.sigma_v / scale.abs();
        self.put(Observable::Before, row, measured.before_v / scale, noise);
        self.put(Observable::During, row, measured.during_v / scale, noise);
        if let Some(after_v) = measured.after_v {
            self.put(Observable::After, row, after_v / scale, noise);
        }
        if let Some(drift) = measured.drift {
            self.put(
                Observable::Drift,
                row,
                drift.v_per_s / scale,
                drift.sigma_v_per_s / scale.abs(),
            );
        }
        let excursion = (run.direction[0] * run.level_g).abs();
        let Some(extremes) = measured.extremes.filter(|_| excursion > EXTREME_LEAST_G) else {
            return;
        };
        // Nobody knows a random record's peaks beforehand: what is observed is by how much they pass a limit, nothing.
        let (sigma, seen) = match run.kind {
            VibrationKind::Sine => (EXTREME_REL_SIGMA * excursion, 1.0),
            VibrationKind::Random => (4.0 * EXTREME_REL_SIGMA * excursion, 0.0),
        };
        let [least_g, most_g] = extremes.over(scale);
        self.put(Observable::Maximum, row, seen * most_g, sigma);
        self.put(Observable::Minimum, row, seen * least_g, sigma);
    }

    /// What the reference says of the command, and of a sine's shape.
    fn reference(&mut self, row: usize, run: &Run, relative: f64) {
        let Some(seen) = &run.reference else { return };
        let Some(ratios) = seen_ratios(&RunConditions::from(run), Some(seen)) else {
            return;
        };
        for axis in 0..3 {
            let sigma = (relative * ratios[axis]).hypot(REFERENCE_SIGMA);
            let off = ratios[axis] - run.direction[axis];
            self.put(Observable::Reference, 3 * row + axis, off, sigma);
        }
        if run.kind == VibrationKind::Sine {
            let axis = main_axis(&run.direction);
            let skewness = seen.skewness[axis] * run.direction[axis].signum();
            self.put(Observable::Shape, 2 * row, skewness, SHAPE_SIGMA);
            self.put(
                Observable::Shape,
                2 * row + 1,
                seen.kurtosis[axis] - 1.5,
                SHAPE_SIGMA,
            );
        }
    }
}

/// K1 to some 1e-4 from all that stands still: enough to turn volts into g.
pub fn scale_factor(campaign: &Campaign) -> f64 {
    let readings = campaign
        .readings
        .iter()
        .map(|r| (r.specific_force_g.i, r.output_v));
    let runs = campaign
        .runs
        .iter()
        .filter_map(|r| Some((r.specific_force_g.i, r.measured?.before_v)));
    let (mut n, mut a, mut u, mut aa, mut au) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (force, output) in readings.chain(runs) {
        n += 1.0;
        a += force;
        u += output;
        aa += force * force;
        au += force * output;
    }
    let slope = (n * au - a * u) / (n * aa - a * a);
    let nominal = campaign.config.instrument.scale_factor_nominal_v_per_g;
    if slope.is_finite() && slope * nominal > 0.0 {
        slope
    } else {
        nominal
    }
}

/// Cholesky factor of the covariance of the static readings in g^2.
fn static_factor(campaign: &Campaign, scale_v_per_g: f64) -> Vec<f64> {
    let bench = &campaign.config.bench;
    let radians = |arcsec: f64| (arcsec * ARCSEC_RAD * bench.local_gravity_g).powi(2);
    let (mark, repeat) = (
        radians(bench.dial_sigma_arcsec),
        radians(bench.dial_repeat_sigma_arcsec),
    );
    let (mount, level) = (
        radians(bench.mount_sigma_arcsec),
        radians(bench.level_sigma_arcsec),
    );
    let rows: Vec<_> = campaign
        .readings
        .iter()
        .map(|reading| {
            let tangent = reading.series.tangent(position(reading).phi_rad()).i;
            let lift = reading.series.lift::<f64>().i;
            (
                tangent,
                lift,
                within_a_turn(reading.dial_deg),
                within_a_turn(reading.mount_deg),
                reading.series,
            )
        })
        .collect();
    let mut factor: Vec<f64> = Vec::with_capacity(rows.len() * (rows.len() + 1) / 2);
    for (i, a) in rows.iter().enumerate() {
        let start = factor.len();
        for (j, b) in rows[..=i].iter().enumerate() {
            let mut covariance = level * (a.0 * b.0 + a.1 * b.1);
            if a.2 == b.2 {
                covariance += mark * a.0 * b.0;
            }
            // As first mounted the instrument defines its own angle.
            if a.3 != 0.0 && a.3 == b.3 && a.4 == b.4 {
                covariance += mount * a.0 * b.0;
            }
            if i == j {
                covariance +=
                    (campaign.readings[i].sigma_v / scale_v_per_g).powi(2) + repeat * a.0 * a.0;
            }
            let row_j = j * (j + 1) / 2;
            let dot: f64 = factor[start..start + j]
                .iter()
                .zip(&factor[row_j..row_j + j])
                .map(|(x, y)| x * y)
                .sum();
            let left = covariance - dot;
            let value = if i == j {
                left.max(1e-24).sqrt()
            } else {
                left / factor[row_j + j]
            };
            factor.push(value);
        }
    }
    factor
}
