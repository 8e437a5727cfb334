//! The observations of a campaign as one whitened vector.
//!
//! Everything is divided by one scale factor, so that outputs are in g. Static readings are whitened by the Cholesky
//! factor of their covariance: noise and repeatability of each, one error a mark, two tilts of the base, one error a
//! remounting. The plateaus of a run stand for themselves, at the run's nominal attitude.

use inference::dense::inner_product;
use inference::observations::{self, Observations};
use nalgebra::DMatrix;
use shared::tumble::within_a_turn;

use crate::campaign::{Campaign, Measured, Run, VibrationKind};
use crate::forward::conditions::seen_ratios;
use crate::forward::contribution::{Contribution, Layout, Observable};
use crate::forward::motion::main_axis;
use crate::forward::rows::RunConditions;
use crate::statics::{bench, covariance, position};

use super::assumptions::{Assumptions, Noise};
use super::reference::Reference;

/// Least excursion at which an extreme is used, g.
const EXTREME_LEAST_G: f64 = 0.1;
/// Uncertainty of the moments of a sine.
const SHAPE_SIGMA: f64 = 1e-4;
/// Standard uncertainty of a reading that does not belong, g: it tells nothing.
const EXCLUDED_SIGMA_G: f64 = 1e3;
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

/// What observations are made of.
pub(super) struct Observer<'a> {
    pub(super) campaign: &'a Campaign,
    pub(super) layout: &'a Layout,
    /// In the order of time.
    pub(super) runs: &'a [&'a Run],
    pub(super) scale_v_per_g: f64,
    pub(super) reference: Option<&'a Reference>,
    /// Of each run the table's level over its command, less 1, and its variance.
    pub(super) level_excess: &'a [(f64, f64)],
    pub(super) assumptions: &'a Assumptions,
    /// Of each run whether it does not belong.
    pub(super) excluded: &'a [bool],
}

impl Observer<'_> {
    /// The observations, whitened.
    pub(super) fn observe(&self) -> Observations {
        let (campaign, layout) = (self.campaign, self.layout);
        let mut seen = Seen {
            layout,
            scale_v_per_g: self.scale_v_per_g,
            assumptions: self.assumptions,
            peak_rel_sigma: campaign.config.peak_rel_sigma(),
            values: layout.nothing(),
            sigma: vec![f64::INFINITY; layout.row_count()],
        };
        for (row, reading) in campaign.readings.iter().enumerate() {
            seen.values.add(
                Observable::Static,
                row,
                reading.output_v / self.scale_v_per_g,
            );
        }
        for (row, run) in self
            .runs
            .iter()
            .enumerate()
            .filter(|(row, _)| !self.excluded[*row])
        {
            let Some(measured) = run.measured else {
                continue;
            };
            seen.output(row, run, &measured);
            if let Some(reference) = self.reference {
                seen.reference(row, run, reference, self.level_excess[row].0);
            }
        }
        let observables = Observable::ALL.map(|observable| observations::Observable {
            name: name(observable),
            rows: layout.rows(observable),
            transforms: properties(observable).moves,
        });
        let observations = Observations::new(
            observables.to_vec(),
            GAP.map(|observable| observable as usize).to_vec(),
            Observable::During as usize,
            static_factor(campaign, self.scale_v_per_g, self.assumptions),
            seen.sigma.iter().map(|sigma| sigma.recip()).collect(),
            seen.values.column.to_vec(),
        );
        match self.reference {
            Some(reference) => {
                let errors = self.reference_errors(reference);
                observations.with_shared_errors(layout.rows(Observable::Reference), errors)
            }
            None => observations,
        }
    }

    /// One standard deviation of each error that the reference makes in all runs alike, over its rows: the gain of each axis,
    /// and the sensitivity of each to motion along each other one.
    fn reference_errors(&self, reference: &Reference) -> Vec<Vec<f64>> {
        let mut errors = Vec::new();
        for axis in 0..3 {
            for along in 0..3 {
                let sigma = match axis == along {
                    true => reference.gain_sigma,
                    false => reference.cross_sigma,
                };
                let mut error = vec![0.0; 3 * self.runs.len()];
                for (row, run) in self.runs.iter().enumerate() {
                    error[3 * row + axis] = sigma * run.direction[along];
                }
                errors.push(error);
            }
        }
        errors
    }
}

/// What was seen so far.
struct Seen<'l> {
    layout: &'l Layout,
    scale_v_per_g: f64,
    assumptions: &'l Assumptions,
    peak_rel_sigma: f64,
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
        let noise = self.assumptions.factor(Noise::Plateaus) * measured.sigma_v / scale.abs();
        self.put(Observable::Before, row, measured.before_v / scale, noise);
        self.put(Observable::During, row, measured.during_v / scale, noise);
        if let Some(after_v) = measured.after_v {
            self.put(Observable::After, row, after_v / scale, noise);
        }
        if let Some(drift) = measured.drift {
            let noise = self.assumptions.factor(Noise::Drift) * drift.sigma_v_per_s / scale.abs();
            self.put(Observable::Drift, row, drift.v_per_s / scale, noise);
        }
        let excursion = (run.direction[0] * run.level_g).abs();
        let Some(extremes) = measured.extremes.filter(|_| excursion > EXTREME_LEAST_G) else {
            return;
        };
        // Nobody knows a random record's peaks beforehand: what is observed is by how much they pass a limit, nothing.
        let (sigma, seen) = match run.kind {
            VibrationKind::Sine => (self.peak_rel_sigma * excursion, 1.0),
            VibrationKind::Random => (4.0 * self.peak_rel_sigma * excursion, 0.0),
        };
        let [least_g, most_g] = extremes.over(scale);
        self.put(Observable::Maximum, row, seen * most_g, sigma);
        self.put(Observable::Minimum, row, seen * least_g, sigma);
    }

    /// What the reference says of the command, and of a sine's shape.
    fn reference(&mut self, row: usize, run: &Run, reference: &Reference, level_excess: f64) {
        let Some(seen) = &run.reference else { return };
        let conditions = RunConditions::from(run);
        let Some(ratios) = seen_ratios(&conditions, Some(seen)) else {
            return;
        };
        for axis in 0..3 {
            // Where table and reference cannot be told apart, what is left of the table's scatter is still in the ratio.
            let left = reference.table_scatter.min(reference.scatter) * ratios[axis];
            let sigma = reference.ratio_sigma(&conditions, ratios[axis]).hypot(left);
            let off = ratios[axis] / (1.0 + level_excess) - run.direction[axis];
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

/// What of the whitened covariance of the static readings is their own noise and what the errors of the dial's marks are;
/// readings that are set aside have neither. `whitening` is that of observations under the same assumptions.
/// `None` where other campaigns told of the marks.
pub(super) fn static_parts(
    campaign: &Campaign,
    scale_v_per_g: f64,
    assumptions: &Assumptions,
    whitening: &DMatrix<f64>,
) -> Option<[DMatrix<f64>; 2]> {
    if campaign.config.mark_errors.is_some() {
        return None;
    }
    let order = campaign.readings.len();
    let stated = bench(&campaign.config.bench);
    let sigma_g = stated.local_gravity_g * assumptions.factor(Noise::Marks) * stated.dial_sigma_rad;
    let factor = assumptions.factor(Noise::Readings) / scale_v_per_g;
    let mut own = whitening.clone();
    let mut known: Vec<f64> = Vec::new();
    let mut marks = DMatrix::zeros(order, order);
    for (place, reading) in campaign.readings.iter().enumerate() {
        let counts = f64::from(u8::from(!assumptions.excluded_readings.contains(&place)));
        own.row_mut(place)
            .scale_mut(counts * factor * reading.sigma_v);
        let at = position(reading);
        let mark = within_a_turn(at.dial_deg);
        let index = known.iter().position(|known| *known == mark);
        let index = index.unwrap_or_else(|| {
            known.push(mark);
            known.len() - 1
        });
        marks[(place, index)] = counts * sigma_g * at.series.tangent(at.phi_rad()).i;
    }
    let marks = whitening.transpose() * marks.columns(0, known.len());
    Some([own.transpose() * own, &marks * marks.transpose()])
}

/// Cholesky factor of the covariance of the static readings, packed as that is.
fn static_factor(campaign: &Campaign, scale_v_per_g: f64, assumptions: &Assumptions) -> Vec<f64> {
    let factor = assumptions.factor(Noise::Readings);
    let mut readings = campaign.readings.clone();
    for (place, reading) in readings.iter_mut().enumerate() {
        reading.sigma_v *= factor;
        if assumptions.excluded_readings.contains(&place) {
            reading.sigma_v = EXCLUDED_SIGMA_G * scale_v_per_g.abs();
        }
    }
    let mut stated = bench(&campaign.config.bench);
    stated.dial_sigma_rad *= assumptions.factor(Noise::Marks);
    let known = campaign.config.mark_errors.as_deref();
    let mut packed = covariance(&readings, &stated, known, scale_v_per_g);
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
