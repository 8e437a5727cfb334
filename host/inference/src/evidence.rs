//! The marginal likelihood of a fitted hypothesis, by Laplace's approximation.
//!
//! With the likelihood exp(-objective/2) at the fit and the determinant D of the information about its k parameters and the
//! base's unknowns,
//!
//! ```text
//! ln evidence = (k ln 2 pi - ln D - objective) / 2 + sum ln prior density
//! ```
//!
//! where what all hypotheses share (the base's own volume and prior) is left out.

use std::f64::consts::{PI, TAU};

use crate::linear::Cholesky;
use crate::model::{Kind, Member, SeparableModel};
use crate::prior::Prior;

/// The approximation of the volume: `parameters` beside the base's unknowns, `factor` that of all information.
pub(crate) fn log_volume(parameters: usize, factor: &Cholesky) -> f64 {
    parameters as f64 * TAU.ln() - factor.log_determinant()
}

/// Logarithm of the prior density at the members' values, each parameter on the scale that it is refined on.
pub(crate) fn log_prior(model: &dyn SeparableModel, members: &[Member]) -> f64 {
    let mut log_prior = 0.0;
    let parameters = || {
        members.iter().flat_map(|member| {
            let component = &model.components()[member.component];
            let values = member.values.iter().zip(component.parameters);
            values.map(|(value, parameter)| (component.kind, *value, parameter.prior))
        })
    };
    for (kind, value, prior) in parameters() {
        match prior {
            Prior::Linear { width } => {
                log_prior -= (PI * width * (1.0 + (value / width).powi(2))).ln();
            }
            Prior::Threshold { points, .. } => log_prior -= 0.5 * (points as f64).ln(),
            Prior::Nonlinear { .. } if kind == Kind::AddsVariance => log_prior -= 2.0,
            Prior::Nonlinear { .. } => {}
        }
    }
    for (kind, _, prior) in parameters() {
        if let (Prior::Nonlinear { .. }, Some((from, to))) = (prior, prior.range())
            && kind != Kind::AddsVariance
        {
            log_prior -= (to - from).ln();
        }
    }
    log_prior
}
