//! Whether a fit leaves more than noise: what it leaves in each observable, and what smooth functions of the conditions
//! would still explain.

use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::fit::Fit;
use crate::model::SeparableModel;
use crate::observations::Column;
use crate::remainder::Remainder;

/// What a fit leaves unexplained.
#[derive(Clone, Debug)]
pub struct Adequacy {
    /// Chi-square and degrees of freedom of each observable that a misfit is looked for in, in the order of reports.
    pub observables: Vec<(f64, f64)>,
    /// Least probability of so large a misfit, corrected for the number of tests.
    pub p_value: f64,
    /// Largest chi-square beyond its expectation that a test found.
    pub excess: f64,
    /// Logarithm of the evidence that something else acts besides, in the shape of any one family, over that of the fit alone.
    pub log_something_else: f64,
}

impl Adequacy {
    /// Chi-square and degrees of freedom of all observables together.
    pub fn total(&self) -> (f64, f64) {
        let add = |sum: (f64, f64), o: &(f64, f64)| (sum.0 + o.0, sum.1 + o.1);
        self.observables.iter().fold((0.0, 0.0), add)
    }
}

/// Judges a fit. `families` are columns of smooth functions of the conditions.
pub fn adequacy(model: &dyn SeparableModel, fit: &Fit, families: &[Vec<Column>]) -> Adequacy {
    let observations = model.observations();
    let leverage = leverages(model, fit);
    let mut observables = Vec::new();
    let mut least = 1.0_f64;
    let mut excess = 0.0_f64;
    let mut tests = 0.0;
    for observable in observations.gap() {
        let rows = observable.rows.clone();
        let (mut chi2, mut freedom) = (0.0, 0.0);
        for (r, h) in fit.residuals[rows.clone()]
            .iter()
            .zip(&leverage[rows.clone()])
        {
            chi2 += r * r;
            freedom += 1.0 - h;
        }
        let observed = observations.observed_rows(rows.clone()).count();
        freedom -= (rows.len() - observed) as f64;
        if freedom > 0.5 {
            least = least.min(chi2_tail(chi2, freedom));
            excess = excess.max(chi2 - freedom);
            tests += 1.0;
        }
        observables.push((chi2, freedom));
    }
    let remainder = Remainder::new(model, fit);
    let mut something_else = Vec::new();
    for family in families {
        let family = remainder.family(&family.iter().collect::<Vec<_>>());
        let (gain, count) = family.gain(1e6);
        if count > 0.0 {
            least = least.min(chi2_tail(gain, count));
            excess = excess.max(gain - count);
            tests += 1.0;
        }
        something_else.push(family.something_else());
    }
    Adequacy {
        observables,
        p_value: (least * f64::max(tests, 1.0)).min(1.0),
        excess,
        log_something_else: log_mean(&something_else),
    }
}

/// Logarithm of the mean of numbers that are given by their logarithms.
fn log_mean(logarithms: &[f64]) -> f64 {
    let largest = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    let sum: f64 = logarithms.iter().map(|l| (l - largest).exp()).sum();
    largest + (sum / logarithms.len() as f64).ln()
}

/// Evidence that something else acts besides, over that of a fit alone: see [`Adequacy::log_something_else`].
pub fn log_something_else(model: &dyn SeparableModel, fit: &Fit, families: &[Vec<Column>]) -> f64 {
    let remainder = Remainder::new(model, fit);
    let of_family = |family: &Vec<Column>| {
        let columns: Vec<&Column> = family.iter().collect();
        remainder.family(&columns).something_else()
    };
    log_mean(&families.iter().map(of_family).collect::<Vec<_>>())
}

/// Share of each row that a fit's unknowns take; of the observables that a misfit is looked for in.
pub fn leverages(model: &dyn SeparableModel, fit: &Fit) -> Vec<f64> {
    let observations = model.observations();
    let n = fit.columns.len();
    let mut leverage = vec![0.0; observations.len()];
    let mut x = vec![0.0; n];
    for row in observations.gap().flat_map(|o| o.rows.clone()) {
        for (x, column) in x.iter_mut().zip(&fit.columns) {
            *x = column.at(row);
        }
        let mut sum = 0.0;
        for i in 0..n {
            let covariance = &fit.covariance[i * n..(i + 1) * n];
            sum += x[i] * covariance.iter().zip(&x).map(|(c, x)| c * x).sum::<f64>();
        }
        leverage[row] = sum;
    }
    let uncertain = leverage[observations.uncertain()].iter_mut();
    for (h, factor) in uncertain.zip(&fit.precision_factor) {
        *h *= factor;
    }
    leverage
}

/// Observed less the base's part, in units of the noise; uncertain rows by their whole uncertainty.
pub fn gap(model: &dyn SeparableModel, fit: &Fit) -> Vec<f64> {
    let observations = model.observations();
    let mut gap = observations.observed().to_vec();
    for (column, x) in model.base().columns.iter().zip(&fit.base_values) {
        column.add_to(&mut gap, -x);
    }
    let uncertain = gap[observations.uncertain()].iter_mut();
    for (g, factor) in uncertain.zip(&fit.precision_factor) {
        *g *= factor.sqrt();
    }
    gap
}

/// Probability that chi-square of so many degrees of freedom, a whole number or not, exceeds a value.
fn chi2_tail(value: f64, freedom: f64) -> f64 {
    ChiSquared::new(freedom).map_or(1.0, |distribution| distribution.sf(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Percentage points of Pearson and Hartley, Biometrika Tables for Statisticians (1966), table 8.
    #[test]
    fn chi_square_tails_are_the_published_ones() {
        for (freedom, p, value) in [
            (1.0, 0.05, 3.84146),
            (1.0, 0.001, 10.828),
            (2.0, 0.001, 13.816),
            (5.0, 0.001, 20.515),
            (10.0, 0.005, 25.1882),
            (30.0, 0.95, 18.4926),
            (100.0, 0.001, 149.449),
        ] {
            let found = chi2_tail(value, freedom);
            assert!((found / p - 1.0).abs() < 5e-4, "{freedom} {value}: {found}");
        }
    }

    /// Of an even number of degrees of freedom it is a sum of Poisson's probabilities, of 1 twice the normal tail; half a
    /// degree lies between.
    #[test]
    fn chi_square_tails_are_right_where_they_decide() {
        let poisson = |value: f64, half: i32| -> f64 {
            let mut term = (-0.5 * value).exp();
            let mut sum = term;
            for k in 1..half {
                term *= 0.5 * value / f64::from(k);
                sum += term;
            }
            sum
        };
        for (value, half) in [(23.0, 1), (28.5, 2), (33.1, 3), (90.0, 20), (700.0, 200)] {
            let (found, sum) = (
                chi2_tail(value, 2.0 * f64::from(half)),
                poisson(value, half),
            );
            assert!(
                (found / sum - 1.0).abs() < 1e-9,
                "{value} {half}: {found} {sum}"
            );
        }
        // Five standard deviations, both tails.
        assert!((chi2_tail(25.0, 1.0) / 5.733_031e-7 - 1.0).abs() < 1e-6);
        // Of 2.5 degrees by Simpson's rule over the density, from 20 to where nothing is left.
        let gamma_of_1_25 = 0.906_402_477_055_477;
        let density = |x: f64| x.powf(0.25) * (-0.5 * x).exp() / (2_f64.powf(1.25) * gamma_of_1_25);
        let (parts, step) = (4000, 0.02);
        let sum: f64 = (0..=parts)
            .map(|k| {
                let weight = match k {
                    0 => 1.0,
                    k if k == parts => 1.0,
                    k if k % 2 == 1 => 4.0,
                    _ => 2.0,
                };
                weight * density(20.0 + step * f64::from(k))
            })
            .sum();
        let integral = sum * step / 3.0;
        assert!((chi2_tail(20.0, 2.5) / integral - 1.0).abs() < 1e-9);
        assert_eq!(chi2_tail(1e6, 3.0), 0.0);
        assert_eq!(chi2_tail(0.0, 0.7), 1.0);
    }
}
