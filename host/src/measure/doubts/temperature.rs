//! An instrument that was warmer or colder.

use super::super::answer::{Doubt, Kind};
use super::super::segment::{Segment, Spread};
use super::super::shift::Scene;
use super::View;

/// Difference of temperature from which on it is a rival, C.
const TEMPERATURE_C: f64 = 0.1;

impl View<'_> {
    pub(super) fn temperature(&self) -> Doubt {
        let kind = Kind::Temperature;
        let all = || self.scene.before.iter().chain(&self.scene.during);
        if all().any(|segment| segment.temperature_c.count == 0) {
            return Doubt::unseen(kind, "no temperature is given (--temperature)");
        }
        let of = |side: &[&Segment]| {
            let means: Spread = side.iter().map(|s| s.temperature_c.mean).collect();
            means.mean
        };
        let warmer = of(&self.scene.during) - of(&self.scene.before);
        if warmer.abs() < TEMPERATURE_C {
            return Doubt::clear(kind, format!("{warmer:+.2} C during"));
        }
        let known = self.calibration.temperature_sensitivity_g_per_c;
        let (sensitivity, whence) = match (known, quiet_sensitivity(self.scene, self.index)) {
            (Some(stated), _) => (stated, "as stated"),
            (None, Some(seen)) => (seen, "as the segments before show"),
            (None, None) => {
                let text = format!(
                    "{warmer:+.2} C during; a sensitivity of {:+.2} mg/C would explain the whole shift",
                    1e3 * self.shift / warmer
                );
                return Doubt::found(kind, text);
            }
        };
        let size = sensitivity * warmer;
        let text = format!(
            "{warmer:+.2} C during; at {:+.3} mg/C, {whence}, that is {:+.2} mg",
            1e3 * sensitivity,
            1e3 * size
        );
        Doubt::found(kind, text).sized(size, self.shift)
    }
}

/// Slope of the means before the vibration over their temperature, g/C: from four segments on that span
/// half a degree.
fn quiet_sensitivity(scene: &Scene<'_>, index: usize) -> Option<f64> {
    let points: Vec<(f64, f64)> = scene
        .before
        .iter()
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
