//! What should be known about the record, without bearing on the verdict.

use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::super::segment::{Role, Segment};
use super::super::shift::Scene;

/// What should be known about the record.
pub(in crate::measure) fn notes(scene: &Scene<'_>, columns: &[String]) -> Vec<String> {
    let mut notes = Vec::new();
    let segments: Vec<&Segment> = [scene.before.as_slice(), &scene.during].concat();
    for (role, side) in [(Role::Before, &scene.before), (Role::During, &scene.during)] {
        if segments.len() > 2 && side.len() == 1 {
            notes.push(format!(
                "one segment {role}: what it does not repeat cannot be seen"
            ));
        }
        let unsteady: Vec<&str> = (0..columns.len())
            .filter(|&index| !repeats(side, index))
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
    let loudest_before = scene.before.iter().map(|s| rms(s)).fold(0.0, f64::max);
    for quiet in scene
        .during
        .iter()
        .filter(|segment| rms(segment) < 2.0 * loudest_before)
    {
        notes.push(format!(
            "\"{}\" shakes less than twice as much as the segments before",
            quiet.name
        ));
    }
    notes
}

/// Whether the segments' means agree within the noise of each (chi-square at 1 %).
fn repeats(side: &[&Segment], index: usize) -> bool {
    let estimates: Vec<_> = side
        .iter()
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
