//! The marginal likelihood of a fitted hypothesis: its likelihood times its prior, integrated over all its parameters.
//!
//! With the likelihood exp(-objective/2) at the fit and the information about the base's unknowns and all parameters (thresholds
//! and sizes of added variance left out) factored to L L^T, Laplace's approximation is a chain: each unknown, given those
//! after it, is Gaussian about the fit with the standard deviation 1/L_ii. So
//!
//! ```text
//! ln evidence = -objective / 2 - sum over the base ln L_ii + sum over the parameters ln integral
//! ```
//!
//! with the integral of that Gaussian times the prior density (`over_cauchy`, `over_range`); what all hypotheses share
//! (the base's prior) is left out. It is exact for one parameter in proportion, however little is known of it.
//!
//! Thresholds and sizes are not for Laplace: the likelihood is a step function of the one, and skewed in the other. Both are
//! summed over their ranges: each adds the logarithm of the mean, over its prior, of the evidence there over that at
//! the fit, nonlinear parameters held.

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use statrs::function::erf::erfc;

use crate::dense::Cholesky;
use crate::linear::{Weighing, solve_linear};
use crate::model::{Fidelity, Kind, Member, SeparableModel};
use crate::prior::Prior;

/// What a fit ended at.
pub(crate) struct Ended<'f> {
    /// -2 log likelihood.
    pub(crate) objective: f64,
    /// Member and parameter of each unknown after the base's.
    pub(crate) unknowns: &'f [(usize, usize)],
    /// Factor of the information about all unknowns.
    pub(crate) factor: &'f Cholesky,
    /// Slope of half the objective's fall along each nonlinear unknown: none but at the end of a range.
    pub(crate) slopes: &'f [f64],
    /// Precision that the information holds on each nonlinear unknown beside the observations'.
    pub(crate) held: &'f [f64],
}

/// Logarithm of the marginal likelihood of members at their fitted values; rows count by `weighing`. Nonlinear parameters that
/// are no unknowns are known.
pub(crate) fn log_evidence(
    model: &dyn SeparableModel,
    members: &[Member],
    ended: &Ended<'_>,
    weighing: &Weighing,
) -> f64 {
    let mut log_evidence = of_proportions(model, members, (ended.objective, ended.factor));
    let base = model.base().columns.len();
    let first = ended.unknowns.len() - ended.slopes.len();
    for (m, member) in members.iter().enumerate() {
        let component = &model.components()[member.component];
        for (k, parameter) in component.parameters.iter().enumerate() {
            let prior = parameter.prior;
            log_evidence += match (prior, prior.range()) {
                (_, None) => 0.0,
                (Prior::Threshold { .. }, Some(range)) => {
                    over_steps(model, members, (m, k), range, weighing)
                }
                (_, Some(range)) if component.kind == Kind::AddsVariance => {
                    over_sizes(model, members, m, range, weighing)
                }
                (_, Some(range)) => match ended.unknowns.iter().position(|u| *u == (m, k)) {
                    Some(place) => {
                        let value = prior.inner(member.values[k]);
                        let sigma = ended.factor.sigma_given_later(base + place);
                        let beyond = (ended.slopes[place - first], ended.held[place - first]);
                        over_range(value, sigma, beyond, range)
                    }
                    None => 0.0,
                },
            };
        }
    }
    log_evidence
}

/// The same of the base and what is in proportion, all else being known. `factor` may be that of more unknowns: those after
/// the ones in proportion.
fn of_proportions(
    model: &dyn SeparableModel,
    members: &[Member],
    (objective, factor): (f64, &Cholesky),
) -> f64 {
    let base = model.base().columns.len();
    let of_base = (0..base).map(|i| factor.sigma_given_later(i).ln());
    let mut log_evidence = -0.5 * objective + of_base.sum::<f64>();
    let values = members.iter().flat_map(|member| {
        let parameters = model.components()[member.component].parameters;
        member.values.iter().zip(parameters)
    });
    let mut unknown = base;
    for (value, parameter) in values {
        if let Prior::Linear { width } = parameter.prior {
            log_evidence += over_cauchy(*value, factor.sigma_given_later(unknown), width).ln();
            unknown += 1;
        }
    }
    log_evidence
}

/// Integral of a Cauchy density of that half width about zero times exp(-(x - value)^2 / 2 sigma^2) (Voigt's profile), by the
/// trapezoidal rule. With steps of h sigma that is off by 2 exp(-2 pi width / (h sigma)) of itself, since the density's poles
/// lie a width away from the real axis: by less than 1e-5.
fn over_cauchy(value: f64, sigma: f64, width: f64) -> f64 {
    const REACH: f64 = 6.0;
    let step = 0.5 * (width / sigma).min(1.0);
    let steps = (REACH / step).ceil() as i64;
    let sum: f64 = (-steps..=steps)
        .map(|k| {
            let u = k as f64 * step;
            (-0.5 * u * u).exp() / (1.0 + ((value + sigma * u) / width).powi(2))
        })
        .sum();
    sigma * step * sum / (PI * width)
}

/// Logarithm of the integral, over a range that `value` lies in, of the even density over it times exp(-(t - value)^2 / 2
/// sigma^2), the precision `held` taken out of sigma. At an end of the range that the likelihood still rises to, it falls
/// by `slope` from there: exp(slope (t - value)) is a factor then.
fn over_range(value: f64, sigma: f64, (slope, held): (f64, f64), (from, to): (f64, f64)) -> f64 {
    let range = to - from;
    // A hundredth of what a flat likelihood over the range would have is flat.
    let sigma = (sigma.powi(-2) - held)
        .max(1e-2 / range.powi(2))
        .sqrt()
        .recip();
    let end = 1e-9 * range;
    let outward = (value < from + end && slope < 0.0) || (value > to - end && slope > 0.0);
    let rise = if outward { (slope * sigma).abs() } else { 0.0 };
    if rise > 8.0 {
        // Mills' ratio.
        return (sigma / (range * rise)).ln();
    }
    let normal = |z: f64| 0.5 * erfc(-z * FRAC_1_SQRT_2);
    let (below, above) = ((value - from) / sigma, (to - value) / sigma);
    let within = if outward {
        normal(-rise) - normal(-rise - below - above)
    } else {
        normal(above) - normal(-below)
    };
    (TAU.sqrt() * sigma / range * within).ln() + 0.5 * rise * rise
}

/// Logarithm of the evidence of what is in proportion at given values of all else.
fn at(model: &dyn SeparableModel, members: &[Member], weighing: &Weighing) -> Option<f64> {
    let prediction = model.predict(members, Fidelity::Full);
    let solution = solve_linear(model, members, &prediction, weighing)?;
    let mut members = members.to_vec();
    let mut found = solution.x[model.base().columns.len()..].iter();
    for member in &mut members {
        let linear = model.components()[member.component].linear();
        for (value, x) in member.values[..linear].iter_mut().zip(&mut found) {
            *value = *x;
        }
    }
    let solved = (solution.objective, &solution.factor);
    Some(of_proportions(model, &members, solved))
}

/// Threshold `k` of member `m`, evenly probable over its range: the mean over its steps by their widths. A step that does better
/// than the fit's counts as that: what is beyond it is another fit's.
fn over_steps(
    model: &dyn SeparableModel,
    members: &[Member],
    (m, k): (usize, usize),
    (from, to): (f64, f64),
    weighing: &Weighing,
) -> f64 {
    let Some(here) = at(model, members, weighing) else {
        return f64::NEG_INFINITY;
    };
    let mut moved = members.to_vec();
    let steps = model.threshold_steps(from, to).into_iter();
    let share = steps.filter_map(|(low, high)| {
        moved[m].values[k] = 0.5 * (low + high);
        let there = at(model, &moved, weighing)?;
        Some((high - low) / (to - from) * (there - here).min(0.0).exp())
    });
    share.sum::<f64>().ln()
}

/// The size of member `m` that adds variance, evenly probable in its logarithm: the mean by the trapezoidal rule, in steps of
/// the least standard deviation 1/sqrt(2 n) that n rows leave of that logarithm.
fn over_sizes(
    model: &dyn SeparableModel,
    members: &[Member],
    m: usize,
    (from, to): (f64, f64),
    weighing: &Weighing,
) -> f64 {
    let rows = model.unit_variance(members[m].component).into_iter();
    let rows = rows.filter(|unit| *unit > 0.0).count();
    let steps = ((to - from) * (2.0 * rows as f64).sqrt()).ceil().max(1.0) as i32;
    let prediction = model.predict(members, Fidelity::Full);
    let Some(found) = solve_linear(model, members, &prediction, weighing) else {
        return f64::NEG_INFINITY;
    };
    let with = |size: Option<f64>| {
        let mut members = members.to_vec();
        if let Some(size) = size {
            members[m].values[0] = size;
        }
        let prediction = model.predict(&members, Fidelity::Full);
        let extra = model.variance(&members, &prediction, &found.x);
        let log_variance: f64 = extra.iter().map(|extra| extra.ln_1p()).sum();
        let factors = extra.iter().map(|extra| 1.0 / (1.0 + extra)).collect();
        let there = at(model, &members, &Weighing::new(model, factors))?;
        Some(there - 0.5 * log_variance)
    };
    let Some(here) = with(None) else {
        return f64::NEG_INFINITY;
    };
    let share = (0..=steps).filter_map(|step| {
        let t = from + (to - from) * f64::from(step) / f64::from(steps);
        let end = if step % steps == 0 { 0.5 } else { 1.0 };
        Some(end / f64::from(steps) * (with(Some(t.exp()))? - here).exp())
    });
    share.sum::<f64>().ln()
}
