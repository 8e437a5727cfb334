//! The nominal model (1) over all observables.

use inference::observations::Column;
use shared::model::{Coefficients, NOMINAL, SpecificForce, terms};

use super::conditions::Conditions;
use super::contribution::{Layout, Observable};
use super::motion::Motion;
use super::rows::RunConditions;
use crate::campaign::VibrationKind;

/// The coefficients behind the linear unknowns of (1); the scale factor is over that by which outputs are divided.
pub fn coefficients(x: &[f64]) -> Coefficients<f64> {
    let k1 = x[0];
    let mut c: [f64; NOMINAL] = std::array::from_fn(|k| x[k] / k1);
    c[0] = k1;
    Coefficients::from_nominal(c)
}

/// The value of (1), or of its vibration error, in g, from its derivatives by the unknowns.
pub fn value(coefficients: &Coefficients<f64>, terms: &[f64; NOMINAL]) -> f64 {
    let mut c = coefficients.to_nominal();
    c[0] = 1.0;
    c.iter().zip(terms).map(|(c, term)| c * term).sum()
}

/// What each unknown of (1) does to the observables when the instrument moves so; not whitened.
pub fn design(conditions: &Conditions, layout: &Layout, motions: &[Motion]) -> Vec<Column> {
    let still: Vec<_> = conditions
        .readings
        .iter()
        .map(|r| terms(r.specific_force_g))
        .collect();
    let rest: Vec<_> = conditions
        .runs
        .iter()
        .map(|r| terms(r.specific_force_g))
        .collect();
    let moving = moving(&conditions.runs, motions);
    let column = |k: usize| {
        let mut sum = layout.nothing();
        for (row, terms) in still.iter().enumerate() {
            sum.add(Observable::Static, row, terms[k]);
        }
        for (row, (terms, [during, maximum, minimum])) in rest.iter().zip(&moving).enumerate() {
            sum.add(Observable::Before, row, terms[k]);
            sum.add(Observable::After, row, terms[k]);
            sum.add(Observable::During, row, terms[k] + during[k]);
            sum.add(Observable::Maximum, row, maximum[k]);
            sum.add(Observable::Minimum, row, minimum[k]);
        }
        sum.column
    };
    (0..NOMINAL).map(column).collect()
}

/// Of each run the derivatives of vibration error, greatest and least output by the coefficients.
pub fn moving(runs: &[RunConditions], motions: &[Motion]) -> Vec<[[f64; NOMINAL]; 3]> {
    let of = |(run, motion): (&RunConditions, &Motion)| {
        let at = |multiple: f64| {
            let [i, p, o] = motion.amplitude_g.map(|w| w * multiple);
            let a0 = run.specific_force_g;
            terms(SpecificForce::new(a0.i + i, a0.p + p, a0.o + o))
        };
        if run.kind == VibrationKind::Random {
            return [
                motion.sensitivity(run).nominal,
                [0.0; NOMINAL],
                [0.0; NOMINAL],
            ];
        }
        let [most, least] = motion.extremes();
        [motion.sensitivity(run).nominal, at(most), at(least)]
    };
    runs.iter().zip(motions).map(of).collect()
}

/// Variance of a run's vibration error from a spectrum that nobody measured, g^2.
pub fn spectral_variance_g2(
    run: &RunConditions,
    motion: &Motion,
    coefficients: &Coefficients<f64>,
) -> f64 {
    match motion.power_variance {
        0.0 => 0.0,
        variance => variance * power_slope(run, motion, coefficients).powi(2),
    }
}

/// Derivative of the vibration error by the logarithm of the mean square, g.
fn power_slope(run: &RunConditions, motion: &Motion, coefficients: &Coefficients<f64>) -> f64 {
    let at = |factor: f64| {
        let mut motion = *motion;
        motion.scale(factor);
        let c = coefficients.to_nominal();
        motion
            .sensitivity(run)
            .nominal
            .iter()
            .zip(c)
            .map(|(s, c)| s * c)
            .sum::<f64>()
    };
    (at(1.01) - at(0.99)) / 0.04
}
