//! The shift of one axis and its interval.
//!
//! Within one record the noise is what all its rests and the plateau show (`noise.rs`), at the distance in time that lies
//! between the means. Of several files on a side the scatter between them counts: the mean of each side has the larger of
//! the two variances.

use shared::slope::{Estimate, SlopeError, Trace};
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::answer::{Axis, Verdict};
use super::noise::{self, Densities, Evidence, Part, Scatter, Shape};
use super::quantisation::Quantisation;
use super::segment::{Channel, Segment, Spread};
use crate::quantity::Quantity;

/// Two-sided risk at which a shift is called significant.
pub(super) const RISK: f64 = 0.05;

/// Risk beyond one standard deviation of a Gaussian deviate.
const RISK_OF_SIGMA: f64 = 0.317_310_5;

/// Degrees of freedom beyond which Student's t is the normal distribution.
const MAX_FREEDOM: f64 = 1e6;

/// A comparison reaches at most so many times farther than the longest stretch that shows the noise. Measured: up to there
/// the intervals hold (`cargo run --release -p host --example coverage`).
const REACH: f64 = 4.0;

/// Pieces of a mean whose noise is computed: twice as many change it by less than 1 %.
const CELLS: usize = 40;

/// What is compared.
#[derive(Clone, Debug)]
pub(super) struct Scene<'a> {
    /// Without the vibration: one segment of a record, or one a file.
    pub before: Vec<&'a Segment>,
    /// Under the vibration.
    pub during: Vec<&'a Segment>,
    /// The rest after the vibration, of the same record; it bears on the shift where `bracketed`.
    pub after: Option<&'a Segment>,
    /// Whether the shift is against the rests on either side.
    pub bracketed: bool,
    /// Stretches that show the noise.
    pub witnesses: Vec<&'a Segment>,
    /// Whether the segments are files of their own, with an unknown time between.
    pub separate: bool,
}

/// A shift before anything is doubted.
pub(super) struct Found {
    /// Without rivals and doubts.
    pub axis: Axis,
    /// Whether the record shows the noise at the time scale of the comparison.
    pub observed: bool,
    /// Whether the noise within the windows alone would make it a shift.
    pub beyond_own_noise: bool,
    /// Distance between the means, s or rows.
    pub distance: f64,
    /// Longest stretch that shows the noise, s or rows.
    pub longest: f64,
}

/// The shift of the column with this index.
pub(super) fn find(scene: &Scene<'_>, index: usize, column: &str) -> Result<Found, SlopeError> {
    let (shift, difference, reach) = if scene.separate {
        let shift = Shift::of_files(scene, index, true)?;
        (shift, Shift::of_files(scene, index, false)?, None)
    } else {
        let record = Record::of(scene, index);
        let shift = record.shift(scene, index, Shape::Parabola)?;
        let difference = record.shift(scene, index, Shape::Box)?;
        (shift, difference, Some(record.reach(scene)))
    };
    let all: Vec<&Segment> = [scene.before.as_slice(), &scene.during].concat();
    let quantisation = Quantisation::of(&all, index)?;
    let quantity = |shift: &Shift| match (&quantisation, shift.sigma) {
        (Some(hidden), sigma) => hidden.quantity(shift.value, sigma.unwrap_or(0.0), 2),
        (None, sigma) => Quantity {
            value: Some(shift.value),
            sigma,
        },
    };
    let noise = shift.half.unwrap_or(match quantisation {
        Some(_) => 0.0,
        None => f64::INFINITY,
    });
    let half = match &quantisation {
        Some(hidden) => noise + hidden.step_g.unwrap_or(f64::INFINITY),
        None => noise,
    };
    let verdict = match &quantisation {
        None if shift.p_value.is_some_and(|p| p < RISK) => Verdict::Shift,
        Some(_) if shift.value.abs() > half => Verdict::NotAttributable,
        _ => Verdict::NoShift,
    };
    let rms = |side: &[&Segment]| {
        let deviations = side.iter().filter_map(|s| s.channels.get(index));
        let squares: Spread = deviations
            .map(|c| c.spread.standard_deviation().powi(2))
            .collect();
        squares.mean.sqrt()
    };
    let (observed, distance, longest) = reach.unwrap_or((true, 0.0, 0.0));
    let axis = Axis {
        column: column.into(),
        verdict,
        shift_g: quantity(&shift),
        degrees_of_freedom: shift.freedom,
        p_value: if quantisation.is_none() {
            shift.p_value
        } else {
            None
        },
        interval_95_g: [shift.value - half, shift.value + half],
        mean_difference_g: quantity(&difference),
        rms_before_g: rms(&scene.before),
        rms_during_g: rms(&scene.during),
        quantisation,
        clipped_share: 0.0,
        rivals: Vec::new(),
        doubts: Vec::new(),
        reasons: Vec::new(),
        without_gross_g: without_gross(scene, index),
        after_less_before_g: returned(scene, index),
        motion: None,
    };
    let own = axis.quantisation.is_none() && beyond_own_noise(scene, index)?;
    Ok(Found {
        axis,
        observed,
        beyond_own_noise: own,
        distance,
        longest,
    })
}

/// A difference of means with what is known of its scatter.
struct Shift {
    value: f64,
    sigma: Option<f64>,
    freedom: f64,
    p_value: Option<f64>,
    half: Option<f64>,
}

impl Shift {
    /// Of files: their scatter counts.
    fn of_files(scene: &Scene<'_>, index: usize, line_fit: bool) -> Result<Self, SlopeError> {
        let longest = |side: &[&Segment]| side.iter().map(|s| s.count()).max().unwrap_or(0);
        let span = longest(&scene.before) + longest(&scene.during);
        let of = |side: &[&Segment], line_fit: bool| {
            let traces = side
                .iter()
                .filter_map(|s| s.channels.get(index))
                .map(|c| &c.trace);
            let estimates: Result<Vec<_>, _> = traces
                .map(|t| {
                    if line_fit {
                        t.line_fit_estimate(span)
                    } else {
                        t.mean_estimate(span)
                    }
                })
                .collect();
            estimates.map(|estimates| pooled(&estimates))
        };
        let shift = of(&scene.during, line_fit)?.minus(of(&scene.before, false)?);
        let (p_value, half) = significance(&shift);
        Ok(Self {
            value: shift.value,
            sigma: Some(shift.sigma),
            freedom: shift.degrees_of_freedom.min(MAX_FREEDOM),
            p_value: Some(p_value),
            half: Some(half),
        })
    }

    /// `least` is an uncertainty that it has at least: what the vibration leaks into the mean.
    fn of_record(value: f64, scatter: Option<Scatter>, least: f64) -> Self {
        let Some(scatter) = scatter else {
            return Self {
                value,
                sigma: None,
                freedom: 1.0,
                p_value: None,
                half: None,
            };
        };
        let [half, sigma] = [RISK, RISK_OF_SIGMA].map(|risk| scatter.half_width(risk));
        let wider = (least / sigma).max(1.0);
        let risks = [RISK, RISK_OF_SIGMA];
        Self {
            value,
            sigma: Some(wider * sigma),
            freedom: noise::degrees_of_freedom(half / sigma, risks, MAX_FREEDOM),
            p_value: Some(scatter.p_value(value / wider)),
            half: Some(wider * half),
        }
    }
}

/// What one record shows of its noise, for one column.
struct Record {
    evidence: Evidence,
    /// s or rows, of one sample.
    interval: f64,
}

impl Record {
    fn of(scene: &Scene<'_>, index: usize) -> Self {
        let interval = scene.during.first().map_or(1.0, |during| interval(during));
        let mut record = Self {
            evidence: Evidence::default(),
            interval,
        };
        for witness in &scene.witnesses {
            if let Some(channel) = witness.channels.get(index) {
                record.evidence.add(witness.role.state(), &channel.batches);
            }
        }
        let rests = scene
            .witnesses
            .iter()
            .filter(|w| w.role.state() == noise::State::Rest);
        let mut rests: Vec<&Segment> = rests.copied().collect();
        rests.sort_by(|a, b| start(a).total_cmp(&start(b)));
        for pair in rests.windows(2) {
            let means = pair
                .iter()
                .filter_map(|s| s.channels.get(index)?.trace.mean());
            if let [first, second] = means.collect::<Vec<_>>()[..]
                && start(pair[1]) >= end(pair[0])
            {
                let parts = [(pair[0], -1.0), (pair[1], 1.0)];
                let parts = parts.map(|(s, weight)| record.part(s, Shape::Box, weight));
                record
                    .evidence
                    .add_contrast(second - first, noise::response(&parts, CELLS));
            }
        }
        record
    }

    fn part(&self, segment: &Segment, shape: Shape, weight: f64) -> Part {
        let [from, to] = segment.extent.unwrap_or([0.0, 1.0]);
        let from = from / self.interval;
        Part {
            from,
            to: (to / self.interval + 1.0).max(from + 1.0),
            shape,
            weight,
            state: segment.role.state(),
        }
    }

    fn shift(&self, scene: &Scene<'_>, index: usize, shape: Shape) -> Result<Shift, SlopeError> {
        let mut value = 0.0;
        let mut parts = Vec::new();
        for (segment, weight) in weights(scene) {
            let shape = if weight > 0.0 { shape } else { Shape::Box };
            let trace = segment.channels.get(index).map(|c| &c.trace);
            value += weight * trace.and_then(|t| mean_of(t, shape)).unwrap_or(f64::NAN);
            parts.push(self.part(segment, shape, weight));
        }
        let from = parts.iter().map(|p| p.from).fold(f64::INFINITY, f64::min);
        let to = parts.iter().map(|p| p.to).fold(0.0, f64::max);
        let during = scene.during.first().and_then(|s| s.channels.get(index));
        let least = during.map(|channel| match shape {
            Shape::Parabola => channel.trace.line_fit_estimate(channel.trace.count()),
            _ => channel.trace.mean_estimate(channel.trace.count()),
        });
        let least = least.transpose()?.map_or(0.0, |estimate| estimate.sigma);
        let response: Densities = noise::response(&parts, CELLS);
        let scatter = self.evidence.scatter(&response, to - from);
        Ok(Shift::of_record(value, scatter, least))
    }

    /// Whether the noise is seen at the distance of the means, that distance, and the longest stretch, s or rows.
    fn reach(&self, scene: &Scene<'_>) -> (bool, f64, f64) {
        let (Some(before), Some(during)) = (scene.before.first(), scene.during.first()) else {
            return (false, 0.0, 0.0);
        };
        let distance = (middle(during) - middle(before)).abs();
        let longest = self.evidence.longest * self.interval;
        let bracketed = scene.bracketed && scene.after.is_some();
        (bracketed || distance <= REACH * longest, distance, longest)
    }
}

/// What of the vibration less what of the rests: against the rests on either side, their means are interpolated to the time
/// of the plateau.
fn weights<'a>(scene: &Scene<'a>) -> Vec<(&'a Segment, f64)> {
    let (Some(&before), Some(&during)) = (scene.before.first(), scene.during.first()) else {
        return Vec::new();
    };
    match scene.after.filter(|_| scene.bracketed) {
        Some(after) => {
            let share = (middle(during) - middle(before)) / (middle(after) - middle(before));
            vec![(before, share - 1.0), (during, 1.0), (after, -share)]
        }
        None => vec![(before, -1.0), (during, 1.0)],
    }
}

fn mean_of(trace: &Trace, shape: Shape) -> Option<f64> {
    if shape == Shape::Parabola {
        trace.line_fit()
    } else {
        trace.mean()
    }
}

fn start(segment: &Segment) -> f64 {
    segment.extent.map_or(0.0, |extent| extent[0])
}

fn end(segment: &Segment) -> f64 {
    segment.extent.map_or(0.0, |extent| extent[1])
}

pub(super) fn middle(segment: &Segment) -> f64 {
    0.5 * (start(segment) + end(segment))
}

/// Of one sample, s; or 1 row.
pub(super) fn interval(segment: &Segment) -> f64 {
    match segment.interval_s.mean {
        mean if mean > 0.0 => mean,
        _ => 1.0,
    }
}

/// Risk at which the noise within the windows alone would make a shift. Chosen: far from where slow noise decides.
const RISK_OF_OWN: f64 = 1e-3;

/// Whether the difference is significant against the noise of either window by itself.
fn beyond_own_noise(scene: &Scene<'_>, index: usize) -> Result<bool, SlopeError> {
    let estimate = |side: &[&Segment]| -> Result<Option<Estimate>, SlopeError> {
        let first = side.first().and_then(|s| s.channels.get(index));
        first
            .map(|c| c.trace.mean_estimate(c.trace.count()))
            .transpose()
    };
    let (Some(before), Some(during)) = (estimate(&scene.before)?, estimate(&scene.during)?) else {
        return Ok(false);
    };
    Ok(!scene.separate && significance(&during.minus(before)).0 < RISK_OF_OWN)
}

/// The shift with gross samples replaced; `None` without such.
fn without_gross(scene: &Scene<'_>, index: usize) -> Option<f64> {
    fn of<'a>(side: &[&'a Segment], index: usize) -> Vec<&'a Channel> {
        side.iter().filter_map(|s| s.channels.get(index)).collect()
    }
    fn clean(channel: &Channel) -> &Trace {
        channel.clean.as_deref().unwrap_or(&channel.trace)
    }
    let (before, during) = (of(&scene.before, index), of(&scene.during, index));
    let any = before.iter().chain(&during).any(|c| c.clean.is_some());
    let mean = |side: &[&Channel], shape: Shape| {
        let means = side.iter().filter_map(|c| mean_of(clean(c), shape));
        means.collect::<Spread>().mean
    };
    let shift = || {
        if scene.separate {
            return mean(&during, Shape::Parabola) - mean(&before, Shape::Box);
        }
        let terms = weights(scene).into_iter().filter_map(|(segment, weight)| {
            let shape = if weight > 0.0 {
                Shape::Parabola
            } else {
                Shape::Box
            };
            Some(weight * mean_of(clean(segment.channels.get(index)?), shape)?)
        });
        terms.sum()
    };
    any.then(shift)
}

/// Mean at rest after less before.
fn returned(scene: &Scene<'_>, index: usize) -> Option<Quantity> {
    let estimate = |segment: &Segment| {
        let trace = &segment.channels.get(index)?.trace;
        trace.mean_estimate(segment.count()).ok()
    };
    let (before, after) = (estimate(scene.before.first()?)?, estimate(scene.after?)?);
    let change = after.minus(before);
    Some(Quantity::new(change.value, change.sigma))
}

/// The mean of some estimates: its variance is that of the scatter between them or that within them,
/// whichever is larger.
fn pooled(estimates: &[Estimate]) -> Estimate {
    let n = estimates.len() as f64;
    let scatter: Spread = estimates.iter().map(|estimate| estimate.value).collect();
    let between = scatter.standard_deviation() / n.sqrt();
    // Adding up as differences of independent figures do, then the mean.
    let nothing = Estimate {
        value: 0.0,
        sigma: 0.0,
        degrees_of_freedom: f64::INFINITY,
    };
    let within = estimates
        .iter()
        .fold(nothing, |sum, &estimate| estimate.minus(sum))
        .divided_by(n);
    let (sigma, degrees_of_freedom) = if between > within.sigma {
        (between, n - 1.0)
    } else {
        (within.sigma, within.degrees_of_freedom)
    };
    Estimate {
        value: scatter.mean,
        sigma,
        degrees_of_freedom,
    }
}

/// Probability of a value as far from zero, and half the interval of 95 %; no claim where there is no
/// uncertainty to measure it by.
fn significance(estimate: &Estimate) -> (f64, f64) {
    let unknown = (1.0, f64::INFINITY);
    if !(estimate.value.is_finite() && estimate.sigma.is_finite()) {
        return unknown;
    }
    let freedom = estimate.degrees_of_freedom.clamp(0.1, MAX_FREEDOM);
    match StudentsT::new(0.0, 1.0, freedom) {
        Ok(t) if estimate.sigma > 0.0 => {
            let z = (estimate.value / estimate.sigma).abs();
            (
                2.0 * t.sf(z),
                t.inverse_cdf(1.0 - RISK / 2.0) * estimate.sigma,
            )
        }
        _ => unknown,
    }
}
