//! The observations as one whitened vector, and columns over it.

use std::ops::Range;

use crate::dense::inner_product;

/// A vector over all observations; what lies outside its span is zero and costs nothing.
#[derive(Clone, Debug)]
pub struct Column {
    /// One number a row.
    pub values: Vec<f64>,
    /// Rows of the observables from the first to the last that may differ from zero.
    span: Range<usize>,
}

impl Column {
    /// Nothing but zeros.
    pub fn zero(rows: usize) -> Self {
        Self {
            values: vec![0.0; rows],
            span: 0..0,
        }
    }

    /// Adds to one row of an observable that takes `rows`.
    #[inline]
    pub fn add_at(&mut self, rows: Range<usize>, row: usize, value: f64) {
        if value != 0.0 {
            self.values[rows.start + row] += value;
            self.widen(rows);
        }
    }

    /// Adds another one.
    pub fn add(&mut self, other: &Self) {
        self.widen(other.span.clone());
        for (sum, value) in self.values.iter_mut().zip(&other.values) {
            *sum += value;
        }
    }

    /// Inner product.
    #[inline]
    pub fn dot(&self, other: &Self) -> f64 {
        self.dot_within(other, 0..usize::MAX)
    }

    /// Inner product over some rows.
    #[inline]
    pub(crate) fn dot_within(&self, other: &Self, rows: Range<usize>) -> f64 {
        let start = self.span.start.max(other.span.start).max(rows.start);
        let end = self.span.end.min(other.span.end).min(rows.end);
        if start < end {
            inner_product(&self.values[start..end], &other.values[start..end])
        } else {
            0.0
        }
    }

    #[inline]
    fn widen(&mut self, rows: Range<usize>) {
        self.span = if self.span.is_empty() {
            rows
        } else {
            self.span.start.min(rows.start)..self.span.end.max(rows.end)
        };
    }
}

/// One kind of observation: a range of rows with its properties.
#[derive(Clone, Debug)]
pub struct Observable {
    /// What it is called.
    pub name: &'static str,
    /// Its rows.
    pub rows: Range<usize>,
    /// Whether the base's columns change in these rows when a component transforms the base.
    pub transforms: bool,
}

/// What was observed, with its stated covariance.
#[derive(Clone, Debug)]
pub struct Observations {
    observables: Vec<Observable>,
    /// Observables that a misfit is looked for in, in the order of reports.
    gap: Vec<usize>,
    /// The observable whose variance a model may raise, row by row.
    uncertain: usize,
    /// Lower triangle of the Cholesky factor of the first observable's covariance, row by row.
    correlated: Vec<f64>,
    /// Reciprocal standard deviation of each row but the first observable's; zero where nothing was observed.
    weights: Vec<f64>,
    /// Errors that rows share, and where they lie.
    shared: Vec<SharedError>,
    observed: Column,
}

/// An error of one standard deviation that rows share, as it is left by those before it; and what takes it out of whitened
/// rows: x - factor (direction x) direction.
#[derive(Clone, Debug)]
struct SharedError {
    rows: Range<usize>,
    direction: Vec<f64>,
    factor: f64,
}

impl SharedError {
    fn take_out(&self, values: &mut [f64]) {
        let values = &mut values[self.rows.clone()];
        let along = self.factor * inner_product(&self.direction, values);
        for (value, direction) in values.iter_mut().zip(&self.direction) {
            *value -= along * direction;
        }
    }
}

impl Observations {
    /// Observations `observed` (not yet whitened), of observables that follow each other in rows. The first one's rows are
    /// correlated, with the packed lower Cholesky factor `correlated`; of the others the reciprocal standard deviations are
    /// `weights` (zero: not observed). A misfit is looked for in the observables `gap`; a model may raise the variance of
    /// those of `uncertain`.
    pub fn new(
        observables: Vec<Observable>,
        gap: Vec<usize>,
        uncertain: usize,
        correlated: Vec<f64>,
        weights: Vec<f64>,
        observed: Vec<f64>,
    ) -> Self {
        let rows = 0..observed.len();
        let mut observations = Self {
            observables,
            gap,
            uncertain,
            correlated,
            weights,
            shared: Vec::new(),
            observed: Column::zero(0),
        };
        observations.observed = observations.whiten(Column {
            values: observed,
            span: rows,
        });
        observations
    }

    /// The same with errors that the rows of one range share, each given by what one standard deviation of it does to them
    /// (not whitened). With the covariance 1 + a a^T of whitened rows, 1 - c a a^T whitens, c = (1 - 1/sqrt(1 + a^2)) / a^2;
    /// one error after another.
    pub fn with_shared_errors(mut self, rows: Range<usize>, errors: Vec<Vec<f64>>) -> Self {
        for error in errors {
            let mut values = vec![0.0; self.len()];
            values[rows.clone()].copy_from_slice(&error);
            let whitened = self.whiten(self.column(values)).values;
            let direction = whitened[rows.clone()].to_vec();
            let square = inner_product(&direction, &direction);
            if square > 0.0 {
                let shared = SharedError {
                    rows: rows.clone(),
                    factor: (1.0 - (1.0 + square).sqrt().recip()) / square,
                    direction,
                };
                shared.take_out(&mut self.observed.values);
                self.shared.push(shared);
            }
        }
        self
    }

    /// The same rows, each in its own unit and none unobserved: for predictions. Only the first observable stays whitened.
    pub fn in_units(&self) -> Self {
        Self {
            weights: vec![1.0; self.weights.len()],
            shared: Vec::new(),
            ..self.clone()
        }
    }

    /// Half the logarithm of the determinant of the first observable's covariance.
    pub fn log_spread_of_correlated(&self) -> f64 {
        let rows = self.observables[0].rows.len();
        (0..rows)
            .map(|i| self.correlated[i * (i + 1) / 2 + i].ln())
            .sum()
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.weights.len()
    }

    /// Whether there is nothing at all.
    pub fn is_empty(&self) -> bool {
        self.weights.is_empty()
    }

    /// The observations, whitened.
    pub fn observed(&self) -> &Column {
        &self.observed
    }

    /// All observables in the order of their rows.
    pub fn observables(&self) -> &[Observable] {
        &self.observables
    }

    /// Observables that a misfit is looked for in, in the order of reports.
    pub fn gap(&self) -> impl Iterator<Item = &Observable> {
        self.gap.iter().map(|&k| &self.observables[k])
    }

    /// Rows whose variance a model may raise.
    pub fn uncertain(&self) -> Range<usize> {
        self.observables[self.uncertain].rows.clone()
    }

    /// Observables that a transformation of the base changes.
    pub(crate) fn transforming(&self) -> impl Iterator<Item = &Observable> {
        self.observables.iter().filter(|o| o.transforms)
    }

    /// Reciprocal standard deviation of a row beyond the first observable; zero where nothing was observed.
    pub fn weight(&self, row: usize) -> f64 {
        self.weights[row]
    }

    /// Rows of a range that hold an observation.
    pub fn observed_rows(&self, rows: Range<usize>) -> impl Iterator<Item = usize> + '_ {
        let correlated = self.observables[0].rows.end;
        rows.filter(move |&row| row < correlated || self.weights[row] > 0.0)
    }

    /// A column of whitened values.
    pub fn column(&self, values: Vec<f64>) -> Column {
        let mut column = Column { values, span: 0..0 };
        for observable in &self.observables {
            let rows = observable.rows.clone();
            if column.values[rows.clone()].iter().any(|&v| v != 0.0) {
                column.widen(rows);
            }
        }
        column
    }

    /// A column in units of the observations' stated uncertainty.
    pub fn whiten(&self, mut column: Column) -> Column {
        let first = self.observables[0].rows.end;
        if column.span.start < first {
            let (head, _) = column.values.split_at_mut(first);
            let mut row = &self.correlated[..];
            for i in 0..first {
                let (coefficients, rest) = row.split_at(i + 1);
                let known: f64 = coefficients[..i]
                    .iter()
                    .zip(&*head)
                    .map(|(l, x)| l * x)
                    .sum();
                head[i] = (head[i] - known) / coefficients[i];
                row = rest;
            }
        }
        for (value, weight) in column.values[first..]
            .iter_mut()
            .zip(&self.weights[first..])
        {
            *value *= weight;
        }
        for shared in &self.shared {
            if column.span.start < shared.rows.end && column.span.end > shared.rows.start {
                shared.take_out(&mut column.values);
            }
        }
        column
    }

    /// Inner product with each uncertain row counted by its precision factor.
    pub(crate) fn dot(&self, a: &Column, b: &Column, precision_factor: &[f64]) -> f64 {
        let uncertain = self.uncertain();
        let touched = a.span.start.max(b.span.start) < uncertain.end
            && a.span.end.min(b.span.end) > uncertain.start;
        let weighted = if touched {
            let rows = a.values[uncertain.clone()]
                .iter()
                .zip(&b.values[uncertain.clone()]);
            rows.zip(precision_factor)
                .map(|((a, b), t)| a * b * t)
                .sum()
        } else {
            0.0
        };
        a.dot_within(b, 0..uncertain.start) + weighted + a.dot_within(b, uncertain.end..usize::MAX)
    }

    /// A column with each uncertain row times its factor.
    pub(crate) fn times(&self, column: &Column, factor: impl Iterator<Item = f64>) -> Column {
        let mut column = column.clone();
        for (value, factor) in column.values[self.uncertain()].iter_mut().zip(factor) {
            *value *= factor;
        }
        column
    }
}
