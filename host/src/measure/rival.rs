//! What else than the vibration could have shifted the mean.

use std::f64::consts::TAU;

use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

use super::segment::{Role, Segment, Spread};
use super::{Axis, Calibration, Verdict};

/// Share of the shift from which on a rival of known size forbids to attribute it.
const SHARE: f64 = 1.0 / 3.0;

/// Difference of temperature from which on it is a rival, C.
const TEMPERATURE_C: f64 = 0.1;

/// What it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The instrument was warmer or colder.
    Temperature,
    /// The output was cut at full scale, which itself rectifies.
    Clipping,
    /// The instrument stood in another direction to gravity.
    Orientation,
}

/// One other explanation of a shift.
#[derive(Clone, Debug, Serialize)]
pub struct Rival {
    /// What it is.
    pub kind: Kind,
    /// The shift that it makes, g; none if it could be anything.
    pub size_g: Option<f64>,
    /// Whether it forbids to attribute the shift to the vibration.
    pub decisive: bool,
    /// In words.
    pub finding: String,
}

/// Finds the rivals of each axis and takes the verdict back where they are decisive. Between `separate`
/// recordings the instrument can have been turned.
pub(super) fn judge(
    axes: &mut [Axis],
    segments: &[Segment],
    calibration: &Calibration,
    separate: bool,
) {
    let gravity = Gravity::of(segments, axes.len());
    for (index, axis) in axes.iter_mut().enumerate() {
        axis.clipped_share = clipped(segments, index).iter().sum::<f64>().min(1.0);
        let shift = axis.shift_g.value.unwrap_or(0.0);
        let found = [
            temperature(segments, index, shift, calibration),
            clipping(segments, index, calibration),
            separate.then(|| orientation(gravity.as_ref(), segments, index, shift)),
        ];
        axis.rivals = found.into_iter().flatten().collect();
        for rival in &mut axis.rivals {
            rival.decisive = rival
                .size_g
                .is_none_or(|size| size.abs() >= SHARE * shift.abs());
        }
        if axis.verdict == Verdict::Attributable && axis.rivals.iter().any(|rival| rival.decisive) {
            axis.verdict = Verdict::NotAttributable;
        }
    }
}

fn side(segments: &[Segment], role: Role) -> impl Iterator<Item = &Segment> {
    segments.iter().filter(move |segment| segment.role == role)
}

fn mean(segments: &[Segment], role: Role, index: usize) -> f64 {
    let means = side(segments, role).filter_map(|s| s.channels.get(index)?.trace.mean());
    means.collect::<Spread>().mean
}

fn temperature(
    segments: &[Segment],
    index: usize,
    shift: f64,
    calibration: &Calibration,
) -> Option<Rival> {
    if segments
        .iter()
        .any(|segment| segment.temperature_c.count == 0)
    {
        return None;
    }
    let of = |role| {
        side(segments, role)
            .map(|s| s.temperature_c.mean)
            .collect::<Spread>()
            .mean
    };
    let warmer = of(Role::During) - of(Role::Before);
    if warmer.abs() < TEMPERATURE_C {
        return None;
    }
    let known = calibration.temperature_sensitivity_g_per_c;
    let (sensitivity, whence) = match (known, quiet_sensitivity(segments, index)) {
        (Some(stated), _) => (Some(stated), "as stated"),
        (None, Some(seen)) => (Some(seen), "as the segments before show"),
        (None, None) => (None, ""),
    };
    let size = sensitivity.map(|sensitivity| sensitivity * warmer);
    let finding = match (sensitivity, size) {
        (Some(sensitivity), Some(size)) => format!(
            "{warmer:+.2} C during; at {:+.3} mg/C, {whence}, that is {:+.2} mg",
            1e3 * sensitivity,
            1e3 * size
        ),
        _ => format!(
            "{warmer:+.2} C during; a sensitivity of {:+.2} mg/C would explain the whole shift",
            1e3 * shift / warmer
        ),
    };
    Some(Rival {
        kind: Kind::Temperature,
        size_g: size,
        decisive: false,
        finding,
    })
}

/// Slope of the means before the vibration over their temperature, g/C: from four segments on that span
/// half a degree.
fn quiet_sensitivity(segments: &[Segment], index: usize) -> Option<f64> {
    let points: Vec<(f64, f64)> = side(segments, Role::Before)
        .filter_map(|s| Some((s.temperature_c.mean, s.channels.get(index)?.trace.mean()?)))
        .collect();
    let t: Spread = points.iter().map(|point| point.0).collect();
    let u: Spread = points.iter().map(|point| point.1).collect();
    if points.len() < 4 || t.max - t.min < 0.5 {
        return None;
    }
    let products: f64 = points
        .iter()
        .map(|point| (point.0 - t.mean) * (point.1 - u.mean))
        .sum();
    let squares: f64 = points.iter().map(|point| (point.0 - t.mean).powi(2)).sum();
    Some(products / squares)
}

/// Shares of the samples (or blocks) during the vibration at the upper and the lower limit.
fn clipped(segments: &[Segment], index: usize) -> [f64; 2] {
    let channels: Vec<_> = side(segments, Role::During)
        .filter_map(|s| s.channels.get(index))
        .collect();
    let all: u64 = channels.iter().map(|c| c.trace.count()).sum();
    [0, 1].map(|end| {
        let at_limit: u64 = channels.iter().map(|c| c.clipped[end]).sum();
        at_limit as f64 / all.max(1) as f64
    })
}

fn clipping(segments: &[Segment], index: usize, calibration: &Calibration) -> Option<Rival> {
    let [upper, lower] = clipped(segments, index);
    if upper + lower == 0.0 {
        return None;
    }
    // How many samples of a block are clipped nobody knows.
    let blocks = side(segments, Role::During).any(|s| s.samples_in_blocks().is_some());
    let full_scale_g = calibration.full_scale_g.filter(|_| !blocks);
    let size = full_scale_g.map(|limit| {
        let centre = mean(segments, Role::During, index);
        tail_mean(lower, limit + centre) - tail_mean(upper, limit - centre)
    });
    let cut = match size {
        Some(size) => format!(
            "clipping itself rectifies: {:+.3} mg if the tails are Gaussian, more for impulses",
            1e3 * size
        ),
        None => "clipping itself rectifies, by an unknown amount".into(),
    };
    let finding = format!(
        "{:.4} % of the {} clipped; {cut}",
        100.0 * (upper + lower).min(1.0),
        if blocks {
            "blocks hold samples that are"
        } else {
            "samples are"
        },
    );
    Some(Rival {
        kind: Kind::Clipping,
        size_g: size,
        decisive: false,
        finding,
    })
}

/// Mean of what Gaussian noise has beyond a limit that it passes with the probability `share`.
fn tail_mean(share: f64, limit: f64) -> f64 {
    if share <= 0.0 || limit <= 0.0 {
        return 0.0;
    }
    let a = -Normal::standard().inverse_cdf(share.min(0.4));
    let density = (-0.5 * a * a).exp() / TAU.sqrt();
    limit / a * (density - a * share)
}

/// Gravity as the means of three axes show it.
struct Gravity {
    /// Its length, g.
    total: f64,
    /// Angle between the means before and during, rad.
    turn: f64,
}

impl Gravity {
    fn of(segments: &[Segment], axes: usize) -> Option<Self> {
        if axes != 3 {
            return None;
        }
        let vector = |role| [0, 1, 2].map(|index| mean(segments, role, index));
        let (before, during) = (vector(Role::Before), vector(Role::During));
        let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let cosine = dot(before, during) / (dot(before, before) * dot(during, during)).sqrt();
        let total = dot(during, during).sqrt();
        Some(Self {
            total,
            turn: cosine.clamp(-1.0, 1.0).acos(),
        })
    }
}

/// A turn by an angle moves an axis by the angle times the gravity across it; 1 g is taken where three axes
/// do not show it.
fn orientation(gravity: Option<&Gravity>, segments: &[Segment], index: usize, shift: f64) -> Rival {
    let along = mean(segments, Role::During, index);
    let total = gravity.map_or(1.0, |gravity| gravity.total);
    let across = (total * total - along * along).max(0.0).sqrt();
    let explains = match (shift / across).abs().to_degrees() {
        degrees if degrees < 90.0 => format!("a turn by {degrees:.3} deg would explain the shift"),
        _ => "no small turn would explain the shift".into(),
    };
    let size = gravity.map(|gravity| gravity.turn * across);
    let finding = match (gravity, size) {
        (Some(gravity), Some(size)) => format!(
            "gravity turns by {:.3} deg between the recordings, up to {:.2} mg on this axis; {explains}",
            gravity.turn.to_degrees(),
            1e3 * size,
        ),
        _ => format!("without three axes nobody sees a turn between the recordings; {explains}"),
    };
    Rival {
        kind: Kind::Orientation,
        size_g: size,
        decisive: false,
        finding,
    }
}

/// What should be known about the record.
pub(super) fn notes(segments: &[Segment], columns: &[String]) -> Vec<String> {
    let mut notes = Vec::new();
    for role in [Role::Before, Role::During] {
        let count = side(segments, role).count();
        if segments.len() > 2 && count == 1 {
            notes.push(format!(
                "one segment {role}: what it does not repeat cannot be seen"
            ));
        }
        let unsteady: Vec<&str> = (0..columns.len())
            .filter(|&index| !repeats(segments, role, index))
            .filter_map(|index| columns.get(index).map(String::as_str))
            .collect();
        if !unsteady.is_empty() {
            notes.push(format!(
                "segments {role} differ more than their own noise allows ({}): handling, orientation, or a vibration \
                 of another kind",
                unsteady.join(", ")
            ));
        }
    }
    let gaps: u64 = segments.iter().map(|segment| segment.gaps).sum();
    let worst = segments
        .iter()
        .map(|s| s.interval_s.max / s.interval_s.mean)
        .fold(0.0, f64::max);
    if gaps > 0 {
        notes.push(format!(
            "irregular sampling: {gaps} intervals are more than 1.6 times the mean, the longest {worst:.1} times; means \
             take samples as even"
        ));
    }
    let rms = |segment: &Segment| {
        segment
            .channels
            .iter()
            .map(|c| c.spread.standard_deviation())
            .fold(0.0, f64::max)
    };
    let loudest_before = side(segments, Role::Before).map(rms).fold(0.0, f64::max);
    for quiet in side(segments, Role::During).filter(|&segment| rms(segment) < 2.0 * loudest_before)
    {
        notes.push(format!(
            "\"{}\" shakes less than twice as much as the segments before",
            quiet.name
        ));
    }
    notes
}

/// Whether the segments' means agree within the noise of each (chi-square at 1 %).
fn repeats(segments: &[Segment], role: Role, index: usize) -> bool {
    let estimates: Vec<_> = side(segments, role)
        .filter_map(|s| s.channels.get(index)?.trace.mean_estimate(s.count()).ok())
        .filter(|estimate| estimate.sigma > 0.0)
        .collect();
    let weight: f64 = estimates.iter().map(|e| e.sigma.powi(-2)).sum();
    let mean = estimates
        .iter()
        .map(|e| e.value * e.sigma.powi(-2))
        .sum::<f64>()
        / weight;
    let chi2: f64 = estimates
        .iter()
        .map(|e| ((e.value - mean) / e.sigma).powi(2))
        .sum();
    match ChiSquared::new(estimates.len().saturating_sub(1) as f64) {
        Ok(distribution) => distribution.cdf(chi2) < 0.99,
        Err(_) => true, // Fewer than two.
    }
}
