//! Whether a fit leaves more than noise: what it leaves in each observable, and what a smooth function of the
//! conditions (a Gaussian process by its leading basis functions) would still explain.

use shared::model::NOMINAL;

use super::dense::{Cholesky, inner_product};
use super::fit::Fit;
use super::problem::{Block, Change, Column, Problem};
use crate::campaign::{Series, VibrationKind};

/// The observables of a gap, in the order of reports.
pub const OBSERVABLES: [(Block, &str); 5] = [
    (Block::Static, "static"),
    (Block::During, "vibration"),
    (Block::Before, "bias"),
    (Block::After, "recovery"),
    (Block::Drift, "in-run-drift"),
];

/// What a fit leaves unexplained.
#[derive(Clone, Debug)]
pub struct Adequacy {
    /// Chi-square and degrees of freedom of each observable, in the order of [`OBSERVABLES`].
    pub observables: [(f64, f64); 5],
    /// Least probability of so large a misfit, corrected for the number of tests.
    pub p_value: f64,
    /// Largest chi-square beyond its expectation that a test found.
    pub excess: f64,
    /// Logarithm of the evidence that "something else" acts besides, over that of the fit alone.
    pub log_something_else: f64,
}

impl Problem<'_> {
    /// Judges a fit. `families` are the columns of [`Problem::families`].
    pub fn adequacy(&self, fit: &Fit, families: &[Vec<Column>]) -> Adequacy {
        let leverage = self.leverages(fit);
        let mut observables = [(0.0, 0.0); 5];
        let mut least = 1.0_f64;
        let mut excess = 0.0_f64;
        let mut tests = 0.0;
        for ((block, _), (chi2, freedom)) in OBSERVABLES.iter().zip(&mut observables) {
            let rows = self.range(*block);
            for (r, h) in fit.residuals[rows.clone()]
                .iter()
                .zip(&leverage[rows.clone()])
            {
                *chi2 += r * r;
                *freedom += 1.0 - h;
            }
            *freedom -= self.unobserved(rows) as f64;
            if *freedom > 0.5 {
                least = least.min(chi2_tail(*chi2, *freedom));
                excess = excess.max(*chi2 - *freedom);
                tests += 1.0;
            }
        }
        let remainder = self.remainder(fit);
        let mut all: Vec<&Column> = Vec::new();
        for family in families {
            let columns: Vec<&Column> = family.iter().collect();
            let (gain, count) = remainder.gain(&columns, 1e6);
            if count > 0.0 {
                least = least.min(chi2_tail(gain, count));
                excess = excess.max(gain - count);
                tests += 1.0;
            }
            all.extend(columns);
        }
        Adequacy {
            observables,
            p_value: (least * f64::max(tests, 1.0)).min(1.0),
            excess,
            log_something_else: remainder.something_else(&all),
        }
    }

    fn unobserved(&self, rows: std::ops::Range<usize>) -> usize {
        let first = self.starts[1];
        rows.filter(|&row| row >= first && self.weights[row] == 0.0)
            .count()
    }

    /// Share of each row that the fit's unknowns take.
    pub fn leverages(&self, fit: &Fit) -> Vec<f64> {
        let n = fit.columns.len();
        let mut leverage = vec![0.0; self.weights.len()];
        let mut x = vec![0.0; n];
        for (block, _) in OBSERVABLES {
            for row in self.range(block) {
                for (x, column) in x.iter_mut().zip(&fit.columns) {
                    *x = column.values[row];
                }
                let mut sum = 0.0;
                for i in 0..n {
                    let covariance = &fit.covariance[i * n..(i + 1) * n];
                    sum += x[i] * covariance.iter().zip(&x).map(|(c, x)| c * x).sum::<f64>();
                }
                leverage[row] = sum;
            }
        }
        for (h, trust) in leverage[self.range(Block::During)]
            .iter_mut()
            .zip(&fit.trust)
        {
            *h *= trust;
        }
        leverage
    }

    /// What a fit leaves to further columns.
    pub(super) fn remainder<'p>(&'p self, fit: &'p Fit) -> Remainder<'p> {
        let mut residual = self.column(fit.residuals.clone());
        for (value, trust) in residual.values[self.range(Block::During)]
            .iter_mut()
            .zip(&fit.trust)
        {
            *value *= trust.sqrt();
        }
        Remainder {
            weighted: self.weighted(&fit.columns, &fit.trust),
            slope: fit.columns.iter().map(|c| c.dot(&residual)).collect(),
            residual,
            problem: self,
            fit,
        }
    }

    /// Smooth functions of the conditions, whitened: frequency by direction, level by attitude, time, temperature,
    /// dial angle, exposure.
    pub fn families(&self) -> Vec<Vec<Column>> {
        let s = &self.situation;
        let square = |run: &crate::campaign::Run| {
            let square = run.level_g * run.level_g;
            if run.kind == VibrationKind::Sine {
                0.5 * square
            } else {
                square
            }
        };
        let mut families: Vec<Vec<Change>> = Vec::new();
        let mut family = Vec::new();
        let mut directions: Vec<[f64; 3]> = Vec::new();
        for run in s.runs.iter().filter(|run| run.measured.is_some()) {
            if directions.len() < 8 && !directions.contains(&run.direction) {
                directions.push(run.direction);
            }
        }
        for direction in directions {
            for order in 0..4 {
                let mut change = self.no_change();
                for (row, run) in s
                    .runs
                    .iter()
                    .enumerate()
                    .filter(|(_, run)| run.direction == direction)
                {
                    let centre = (run.band_hz[0] * run.band_hz[1]).sqrt().max(1.0);
                    change.add(
                        Block::During,
                        row,
                        square(run) * (centre / 200.0).ln().powi(order),
                    );
                }
                family.push(change);
            }
        }
        families.push(std::mem::take(&mut family));
        for attitude in [-1.0, 0.0, 1.0] {
            for order in 1..5 {
                let mut change = self.no_change();
                for (row, run) in s.runs.iter().enumerate() {
                    if (run.specific_force_g.i - attitude).abs() < 0.5 {
                        let rms = square(run).sqrt() * run.direction[0].abs();
                        change.add(Block::During, row, rms.powi(order));
                    }
                }
                family.push(change);
            }
        }
        families.push(std::mem::take(&mut family));
        let end_s = s
            .runs
            .last()
            .map_or(0.0, |run| run.time_s)
            .max(s.readings.last().map_or(0.0, |r| r.time_s));
        for order in 1..9 {
            let mut change = self.no_change();
            let wave = |time_s: f64| {
                (std::f64::consts::PI * f64::from(order) * time_s / end_s.max(1.0)).cos()
            };
            for (row, reading) in s.readings.iter().enumerate() {
                change.add(Block::Static, row, wave(reading.time_s));
            }
            for (row, run) in s.runs.iter().enumerate() {
                for block in [Block::Before, Block::During, Block::After] {
                    change.add(block, row, wave(run.time_s));
                }
            }
            family.push(change);
        }
        families.push(std::mem::take(&mut family));
        for order in 0..4 {
            let mut change = self.no_change();
            for (row, reading) in s.readings.iter().enumerate().filter(|_| order < 3) {
                change.add(
                    Block::Static,
                    row,
                    (reading.temp_c - s.reference_temp_c) * reading.specific_force_g.i.powi(order),
                );
            }
            for (row, run) in s.runs.iter().enumerate() {
                let excess_k = run.temp_c - s.reference_temp_c;
                let rest = if order < 3 {
                    run.specific_force_g.i.powi(order)
                } else {
                    0.0
                };
                change.add(Block::Before, row, excess_k * rest);
                change.add(Block::After, row, excess_k * rest);
                let moving = if order > 1 {
                    square(run) * run.direction[0].powi(2)
                } else {
                    0.0
                };
                change.add(Block::During, row, excess_k * (rest + moving));
            }
            family.push(change);
        }
        families.push(std::mem::take(&mut family));
        for series in [Series::OutputAxis, Series::PendulousAxis, Series::InputAxis] {
            for order in 0..5 {
                for quadrature in [false, true] {
                    let mut change = self.no_change();
                    for (row, reading) in s
                        .readings
                        .iter()
                        .enumerate()
                        .filter(|(_, r)| r.series == series)
                    {
                        let angle = f64::from(order) * reading.dial_deg.to_radians();
                        change.add(
                            Block::Static,
                            row,
                            if quadrature { angle.sin() } else { angle.cos() },
                        );
                    }
                    family.push(change);
                }
            }
        }
        families.push(std::mem::take(&mut family));
        for (block, order) in [
            (Block::After, 1),
            (Block::After, 2),
            (Block::Drift, 1),
            (Block::Drift, 2),
        ] {
            for axes in [0, 1] {
                let mut change = self.no_change();
                for (row, run) in s.runs.iter().enumerate() {
                    let rms = square(run).sqrt()
                        * if axes == 0 {
                            1.0
                        } else {
                            run.direction[0].abs()
                        };
                    change.add(block, row, rms.powi(order));
                }
                family.push(change);
            }
        }
        families.push(family);
        families
            .into_iter()
            .map(|family| {
                let columns = family.into_iter().map(|change| self.whiten(change).0);
                columns
                    .filter(|column| column.values.iter().any(|&v| v != 0.0))
                    .collect()
            })
            .collect()
    }

    /// What the effects of a fit add to the observations, whitened.
    pub fn signature(&self, fit: &Fit) -> Column {
        let mut sum: Vec<f64> = self.observed.values.clone();
        for (sum, residual) in sum.iter_mut().zip(&fit.residuals) {
            *sum -= residual;
        }
        for (row, trust) in self.range(Block::During).zip(&fit.trust) {
            // Residuals are in units of the whole uncertainty.
            sum[row] = self.observed.values[row] - fit.residuals[row] / trust.sqrt();
        }
        for (column, x) in self.nominal.iter().zip(&fit.theta) {
            for (s, v) in sum.iter_mut().zip(&column.values) {
                *s -= x * v;
            }
        }
        debug_assert!(fit.columns.len() >= NOMINAL);
        self.column(sum)
    }
}

/// What a fit leaves to further columns, once all its unknowns are eliminated from them.
pub(super) struct Remainder<'p> {
    problem: &'p Problem<'p>,
    fit: &'p Fit,
    /// The fit's columns and residuals, `during` weighted by its trust.
    weighted: Vec<Column>,
    residual: Column,
    /// A fit that ended at the edge of a range leaves a slope; further columns must not be credited with it.
    slope: Vec<f64>,
}

impl Remainder<'_> {
    /// Normal matrix, row by row, and right-hand side of further columns.
    pub(super) fn normal(&self, columns: &[&Column]) -> (Vec<f64>, Vec<f64>) {
        let (n, k) = (self.weighted.len(), columns.len());
        let mut matrix = vec![0.0; k * k];
        let mut across = Vec::with_capacity(n * k);
        let mut right = Vec::with_capacity(k);
        for (j, column) in columns.iter().enumerate() {
            across.extend(self.weighted.iter().map(|c| c.dot(column)));
            let rows = self.fit.covariance.chunks_exact(n);
            let solved: Vec<f64> = rows
                .map(|row| inner_product(row, &across[j * n..]))
                .collect();
            right.push(column.dot(&self.residual) - inner_product(&solved, &self.slope));
            for i in 0..=j {
                let taken = inner_product(&across[i * n..(i + 1) * n], &solved);
                let whole = self.problem.dot(columns[i], column, &self.fit.trust);
                let mut value = whole - taken;
                // What the fit's unknowns imitate but for rounding is nothing.
                if i == j && value < 1e-7 * whole {
                    value = 0.0;
                }
                matrix[i * k + j] = value;
                matrix[j * k + i] = value;
            }
        }
        (matrix, right)
    }

    /// By how much further columns would lower chi-square, and how many of them count; the prior variance of each
    /// is `size` in units of its own information.
    pub(super) fn gain(&self, columns: &[&Column], size: f64) -> (f64, f64) {
        let k = columns.len();
        let (mut matrix, mut right) = self.normal(columns);
        scale(&mut matrix, &mut right, k);
        let before = matrix.clone();
        for i in 0..k {
            matrix[i * k + i] += 1.0 / size;
        }
        let Some(factor) = Cholesky::new(matrix, k) else {
            return (0.0, 0.0);
        };
        let mut x = right.clone();
        factor.solve(&mut x);
        let inverse = factor.inverse();
        (inner_product(&x, &right), inner_product(&inverse, &before))
    }

    /// Log evidence of the columns as random effects of a common, unknown size.
    fn something_else(&self, columns: &[&Column]) -> f64 {
        let k = columns.len();
        if k == 0 {
            return f64::NEG_INFINITY;
        }
        let (mut matrix, mut right) = self.normal(columns);
        scale(&mut matrix, &mut right, k);
        let sizes = (0..12).map(|step| 10f64.powf(0.5 * f64::from(step)));
        let of_size = |size: f64| {
            // Evidence of x ~ N(0, size): exp(r' (M + 1/size)^-1 r / 2) / sqrt det(1 + size M).
            let mut inner = matrix.clone();
            for i in 0..k {
                inner[i * k + i] += 1.0 / size;
            }
            let factor = Cholesky::new(inner, k)?;
            let mut x = right.clone();
            factor.forward(&mut x);
            let gain = inner_product(&x, &x);
            Some(0.5 * (gain - factor.log_determinant() - k as f64 * size.ln()))
        };
        sizes.filter_map(of_size).fold(f64::NEG_INFINITY, f64::max) - 12f64.ln()
    }

    /// Correlation of what hypotheses add to the observations, as far as the fit cannot imitate it.
    pub(super) fn similarity(&self, signatures: &[&Column]) -> Vec<Vec<f64>> {
        let k = signatures.len();
        let (matrix, _) = self.normal(signatures);
        let size = |i: usize| matrix[i * k + i].max(f64::MIN_POSITIVE).sqrt();
        let like = |i: usize, j: usize| matrix[i * k + j] / (size(i) * size(j));
        (0..k)
            .map(|i| (0..k).map(|j| like(i, j)).collect())
            .collect()
    }

    /// Length of a difference beyond what the fit can imitate.
    pub(super) fn length(&self, difference: &Column) -> f64 {
        self.normal(&[difference]).0[0].max(0.0).sqrt()
    }
}

/// Scales columns to unit information.
fn scale(matrix: &mut [f64], right: &mut [f64], k: usize) {
    let size: Vec<f64> = (0..k)
        .map(|i| match matrix[i * k + i] {
            information if information > 0.0 => information.sqrt().recip(),
            _ => 0.0,
        })
        .collect();
    for i in 0..k {
        right[i] *= size[i];
        for j in 0..k {
            matrix[i * k + j] *= size[i] * size[j];
        }
    }
}

/// Probability that chi-square exceeds a value, by Wilson and Hilferty's cube root.
pub fn chi2_tail(value: f64, freedom: f64) -> f64 {
    let variance = 2.0 / (9.0 * freedom);
    let z = ((value / freedom).max(0.0).cbrt() - (1.0 - variance)) / variance.sqrt();
    0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2)
}
