//! The ends of the range: samples at them, and peaks between the samples.

use std::f64::consts::TAU;

use statrs::distribution::{ContinuousCDF, Normal};

use super::super::answer::{Doubt, Kind};
use super::super::motion::Motion;
use super::super::shift::Scene;
use super::{View, mean};

impl View<'_> {
    pub(super) fn clipping(&self) -> Doubt {
        let kind = Kind::Clipping;
        let [upper, lower] = clipped(self.scene, self.index);
        if upper + lower == 0.0 {
            return self.pile_up();
        }
        // How many samples of a block are clipped nobody knows.
        let blocks = self.in_blocks();
        let full_scale_g = self.calibration.full_scale_g.filter(|_| !blocks);
        let size = full_scale_g.map(|limit| {
            let centre = mean(&self.scene.during, self.index);
            tail_mean(lower, limit + centre) - tail_mean(upper, limit - centre)
        });
        let cut = match size {
            Some(size) => format!(
                "clipping itself rectifies: {:+.3} mg if the tails are Gaussian, more for impulses",
                1e3 * size
            ),
            None => "clipping itself rectifies, by an unknown amount".into(),
        };
        let text = format!(
            "{:.4} % of the {} clipped; {cut}",
            100.0 * (upper + lower).min(1.0),
            if blocks {
                "blocks hold samples that are"
            } else {
                "samples are"
            },
        );
        let doubt = Doubt::found(kind, text);
        match size {
            Some(size) => doubt.sized(size, self.shift),
            None => doubt,
        }
    }

    /// Samples that pile up at the ends of what was seen.
    fn pile_up(&self) -> Doubt {
        let kind = Kind::Clipping;
        if self.in_blocks() {
            return Doubt::clear(kind, "no block touches the converter's limits");
        }
        let mut tells = true;
        for (segment, channel) in self.both() {
            let [upper, lower] = channel.ends.pile_up();
            let share = |end: Option<(f64, u64)>| {
                end.map_or(0.0, |e| e.1 as f64) / segment.count().max(1) as f64
            };
            let ends: Vec<String> = [upper, lower]
                .iter()
                .flatten()
                .map(|e| format!("{:.6} g", e.0))
                .collect();
            if !ends.is_empty() {
                let text = format!(
                    "{:.3} % of the samples of \"{}\" pile up at {}, the end of the range",
                    100.0 * (share(upper) + share(lower)),
                    segment.name,
                    ends.join(" and ")
                );
                return Doubt::found(kind, text);
            }
            tells &= channel.ends.tells();
        }
        match tells {
            true => Doubt::clear(kind, "no samples pile up at the ends"),
            false => Doubt::unseen(kind, "too few different values to see a pile"),
        }
    }

    pub(super) fn hidden_peaks(&self, motion: Option<&Motion>) -> Doubt {
        let kind = Kind::HiddenPeaks;
        let Some(limit) = self.calibration.full_scale_g else {
            return Doubt::unseen(kind, "no range is given (--full-scale)");
        };
        let Some(motion) = motion else {
            return Doubt::unseen(kind, "no samples to interpolate");
        };
        let text = format!(
            "between the samples the output reaches {:.4} g of {limit} g",
            motion.peak_g
        );
        match motion.peak_g >= limit {
            true => Doubt::found(kind, text),
            false => Doubt::clear(kind, text),
        }
    }
}

/// Shares of the samples (or blocks) during the vibration at the upper and the lower limit.
pub(super) fn clipped(scene: &Scene<'_>, index: usize) -> [f64; 2] {
    let channels: Vec<_> = scene
        .during
        .iter()
        .filter_map(|s| s.channels.get(index))
        .collect();
    let all: u64 = channels.iter().map(|c| c.trace.count()).sum();
    [0, 1].map(|end| {
        let at_limit: u64 = channels.iter().map(|c| c.clipped[end]).sum();
        at_limit as f64 / all.max(1) as f64
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
