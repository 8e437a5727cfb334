//! The observations of a campaign as one whitened vector.
//!
//! Everything is divided by one scale factor, so that outputs are in g. Static readings are whitened by the Cholesky
//! factor of their covariance: noise and repeatability of each, one error a mark, two tilts of the base, one error a
//! remounting. The plateaus of a run stand for themselves, at the run's nominal attitude.

use inference::linear::inner_product;
use inference::observations::{self, Observations};

use crate::campaign::{Campaign, Measured, Run, VibrationKind};
use crate::forward::conditions::{RunConditions, seen_ratios};
use crate::forward::contribution::{Contribution, Layout, Observable};
use crate::forward::motion::main_axis;
use crate::statics::{bench, covariance};

/// Relative standard uncertainty of the peak detector's excursion, and of what small motions inside the instrument
/// add to it.
const EXTREME_REL_SIGMA: f64 = 5e-4;
/// Least excursion at which an extreme is used, g.
const EXTREME_LEAST_G: f64 = 0.1;
/// Uncertainty of a ratio of the reference's axes, and of the moments of a sine, beside the stated one.
const REFERENCE_SIGMA: f64 = 1e-5;
const SHAPE_SIGMA: f64 = 1e-4;
/// Least variance of a static reading beside all others, g^2: a picog, far below any noise, for readings stated to be exact.
const LEAST_VARIANCE_G2: f64 = 1e-24;

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
        let noise = measured.sigma_v / scale;
        self.put(Observable::Before, row, measured.before_v / scale, noise);
        self.put(Observable::During, row, measured.during_v / scale, noise);
        self.put(Observable::After, row, measured.after_v / scale, noise);
        self.put(
            Observable::Drift,
            row,
            measured.drift_v_per_s / scale,
            measured.drift_sigma_v_per_s / scale,
        );
        let excursion = (run.direction[0] * run.level_g).abs();
        let Some(extremes) = measured.extremes.filter(|_| excursion > EXTREME_LEAST_G) else {
            return;
        };
        // Nobody knows a random record's peaks beforehand: what is observed is by how much they pass a limit, nothing.
        let (sigma, seen) = match run.kind {
            VibrationKind::Sine => (EXTREME_REL_SIGMA * excursion, 1.0),
            VibrationKind::Random => (4.0 * EXTREME_REL_SIGMA * excursion, 0.0),
        };
        self.put(
            Observable::Maximum,
            row,
            seen * extremes.maximum_v / scale,
            sigma,
        );
        self.put(
            Observable::Minimum,
            row,
            seen * extremes.minimum_v / scale,
            sigma,
        );
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
    if slope.is_finite() && slope > 0.0 {
        slope
    } else {
        campaign.config.instrument.scale_factor_nominal_v_per_g
    }
}

/// Cholesky factor of the covariance of the static readings, packed as that is.
fn static_factor(campaign: &Campaign, scale_v_per_g: f64) -> Vec<f64> {
    let stated = bench(&campaign.config.bench);
    let mut packed = covariance(&campaign.readings, &stated, scale_v_per_g);
    for i in 0..campaign.readings.len() {
        let (above, row) = packed.split_at_mut(i * (i + 1) / 2);
        for j in 0..=i {
            let left = row[j]
                - inner_product(
                    &row[..j],
                    if j < i {
                        &above[j * (j + 1) / 2..][..j]
                    } else {
                        &row[..j]
                    },
                );
            row[j] = if j < i {
                left / above[j * (j + 1) / 2 + j]
            } else {
                left.max(LEAST_VARIANCE_G2).sqrt()
            };
        }
    }
    packed
}
