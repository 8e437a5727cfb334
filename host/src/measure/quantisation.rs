//! Noise below the step of the converter: a segment without scatter says nothing of its noise.

use serde::Serialize;
use shared::slope::{Estimate, SlopeError};

use super::segment::{Channel, Segment, Spread};
use crate::quantity::Quantity;

/// An uncertainty of so little of a step is none: half a step of noise averages to it in 10^11 samples.
const NOTHING: f64 = 1e-6;

/// A step that hides the noise of at least one segment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantisation {
    /// The step, g: of the converter if it is known, otherwise the least that is seen; none if all samples are
    /// equal.
    pub step_g: Option<f64>,
}

impl Quantisation {
    /// The step of a column, if it hides the noise of a segment.
    pub(super) fn of(segments: &[&Segment], index: usize) -> Result<Option<Self>, SlopeError> {
        let channels = || segments.iter().filter_map(|s| s.channels.get(index));
        let within = channels().filter_map(|c| c.step_g).reduce(f64::min);
        let means: Spread = channels().filter_map(|c| c.trace.mean()).collect();
        let between = Some(means.max - means.min).filter(|&step| step > 0.0);
        let step_g = within.or(between);
        for Channel { trace, .. } in channels() {
            let estimate = trace.mean_estimate(trace.count())?;
            if let Some(hidden) = Self::hides(&estimate, step_g) {
                return Ok(Some(hidden));
            }
        }
        Ok(None)
    }

    /// Whether the step hides the noise that makes the estimate uncertain.
    pub(super) fn hides(estimate: &Estimate, step_g: Option<f64>) -> Option<Self> {
        let hidden = step_g.is_none_or(|step| estimate.sigma <= NOTHING * step);
        hidden.then_some(Self { step_g })
    }

    /// With the uncertainty of `times` rectangular distributions of one step, JCGM 100:2008 F.2.2.1; of unknown
    /// uncertainty if the step is unknown.
    pub(super) fn quantity(&self, value: f64, sigma: f64, times: u8) -> Quantity {
        let step_sigma = |step: f64| step * (f64::from(times) / 12.0).sqrt();
        Quantity {
            value: Some(value),
            sigma: self.step_g.map(|step| sigma.hypot(step_sigma(step))),
        }
    }

    /// In words.
    pub(super) fn note(&self, column: &str) -> String {
        let limit = match self.step_g {
            Some(step) => format!("the step of {:.3e} mg is the limit", 1e3 * step),
            None => {
                "the step of the converter, which nobody sees in equal samples, is the limit".into()
            }
        };
        format!(
            "{column}: a segment without scatter: its noise is unknown, below the quantisation; {limit}"
        )
    }
}
