//! The observations as one whitened vector, and columns over it.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use nalgebra::DMatrix;

use crate::dense::{inner_product, inverse_transposed};

/// A vector over all observations; what lies outside its span is zero and costs nothing.
#[derive(Clone, Debug)]
pub struct Column {
    rows: usize,
    /// First row of the span.
    start: usize,
    /// One number a row, of the observables from the first to the last that may differ from zero. Columns that are copied
    /// share them: every fit holds the base's.
    values: Arc<Vec<f64>>,
}

impl Column {
    /// Nothing but zeros.
    pub fn zero(rows: usize) -> Self {
        Self {
            rows,
            start: 0,
            values: Arc::default(),
        }
    }

    /// Whether all of it is zero.
    pub fn is_zero(&self) -> bool {
        self.values.iter().all(|&value| value == 0.0)
    }

    /// The number of a row.
    pub fn at(&self, row: usize) -> f64 {
        let within = row.checked_sub(self.start);
        within
            .and_then(|k| self.values.get(k))
            .copied()
            .unwrap_or(0.0)
    }

    /// The numbers of some rows.
    pub fn part(&self, rows: Range<usize>) -> Cow<'_, [f64]> {
        let span = self.span();
        if span.start <= rows.start && rows.end <= span.end {
            Cow::Borrowed(&self.values[rows.start - self.start..rows.end - self.start])
        } else {
            Cow::Owned(rows.map(|row| self.at(row)).collect())
        }
    }

    /// The numbers of all rows.
    pub fn to_vec(&self) -> Vec<f64> {
        let mut all = vec![0.0; self.rows];
        all[self.span()].copy_from_slice(self.values());
        all
    }

    /// Adds a multiple of it to a number a row.
    pub fn add_to(&self, sum: &mut [f64], factor: f64) {
        for (sum, value) in sum[self.span()].iter_mut().zip(self.values()) {
            *sum += factor * value;
        }
    }

    /// Adds to one row of an observable that takes `rows`.
    #[inline]
    pub fn add_at(&mut self, rows: Range<usize>, row: usize, value: f64) {
        if value != 0.0 {
            let at = rows.start + row;
            self.widen(rows);
            let at = at - self.start;
            self.values_mut()[at] += value;
        }
    }

    /// Adds another one.
    pub fn add(&mut self, other: &Self) {
        self.widen(other.span());
        let from = other.start.saturating_sub(self.start);
        for (sum, value) in self.values_mut()[from..].iter_mut().zip(other.values()) {
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
        let (a, b) = (self.span(), other.span());
        let start = a.start.max(b.start).max(rows.start);
        let end = a.end.min(b.end).min(rows.end);
        if start < end {
            inner_product(
                &self.values[start - a.start..end - a.start],
                &other.values[start - b.start..end - b.start],
            )
        } else {
            0.0
        }
    }

    fn values(&self) -> &[f64] {
        &self.values
    }

    /// The numbers as this column's own.
    fn values_mut(&mut self) -> &mut Vec<f64> {
        Arc::make_mut(&mut self.values)
    }

    fn touches(&self, rows: &Range<usize>) -> bool {
        let span = self.span();
        span.start < rows.end && rows.start < span.end
    }

    fn span(&self) -> Range<usize> {
        self.start..self.start + self.values.len()
    }

    #[inline]
    fn widen(&mut self, rows: Range<usize>) {
        let span = self.span();
        if span.start <= rows.start && rows.end <= span.end {
            return;
        }
        if span.is_empty() {
            self.start = rows.start;
            self.values_mut().resize(rows.len(), 0.0);
            return;
        }
        if rows.start < span.start {
            let before = span.start - rows.start;
            self.values_mut()
                .splice(0..0, std::iter::repeat_n(0.0, before));
            self.start = rows.start;
        }
        let end = span.end.max(rows.end);
        let length = end - self.start;
        self.values_mut().resize(length, 0.0);
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
    fn take_out(&self, column: &mut Column) {
        if !column.touches(&self.rows) {
            return;
        }
        column.widen(self.rows.clone());
        let from = self.rows.start - column.start;
        let values = &mut column.values_mut()[from..from + self.rows.len()];
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
        let rows = observed.len();
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
            rows,
            start: 0,
            values: Arc::new(observed),
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
            let whitened = self.whiten(self.column(values));
            let direction = whitened.part(rows.clone()).into_owned();
            let square = inner_product(&direction, &direction);
            if square > 0.0 {
                let shared = SharedError {
                    rows: rows.clone(),
                    factor: (1.0 - (1.0 + square).sqrt().recip()) / square,
                    direction,
                };
                shared.take_out(&mut self.observed);
                self.shared.push(shared);
            }
        }
        self
    }

    /// L^-T of the Cholesky factor L of the covariance of the first observable's rows: its transpose whitens them.
    pub fn whitening(&self) -> DMatrix<f64> {
        let order = self.observables[0].rows.len();
        inverse_transposed(&DMatrix::from_fn(order, order, |i, j| match j <= i {
            true => self.correlated[i * (i + 1) / 2 + j],
            false => 0.0,
        }))
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
        let touched = |o: &&Observable| values[o.rows.clone()].iter().any(|&v| v != 0.0);
        let mut touched = self.observables.iter().filter(touched);
        let first = touched.next();
        let last = touched.next_back().or(first);
        let span = first
            .zip(last)
            .map_or(0..0, |(first, last)| first.rows.start..last.rows.end);
        Column {
            rows: values.len(),
            start: span.start,
            values: Arc::new(match span.len() == values.len() {
                true => values,
                false => values[span].to_vec(),
            }),
        }
    }

    /// A column in units of the observations' stated uncertainty.
    pub fn whiten(&self, mut column: Column) -> Column {
        let first = self.observables[0].rows.end;
        let span = column.span();
        if span.start < first && !span.is_empty() {
            column.widen(0..first);
            let (head, _) = column.values_mut().split_at_mut(first);
            // Zeros at the beginning stay, and tell later rows nothing.
            let from = head.iter().position(|&x| x != 0.0).unwrap_or(first);
            for i in from..first {
                let row = &self.correlated[i * (i + 1) / 2..];
                let known = inner_product(&row[from..i], &head[from..i]);
                head[i] = (head[i] - known) / row[i];
            }
        }
        let from = first.saturating_sub(column.start).min(column.values.len());
        let weights = &self.weights[column.start + from..];
        for (value, weight) in column.values_mut()[from..].iter_mut().zip(weights) {
            *value *= weight;
        }
        for shared in &self.shared {
            shared.take_out(&mut column);
        }
        column
    }

    /// Inner product with each uncertain row counted by its precision factor.
    pub(crate) fn dot(&self, a: &Column, b: &Column, precision_factor: &[f64]) -> f64 {
        let uncertain = self.uncertain();
        let both = a.touches(&uncertain) && b.touches(&uncertain);
        let weighted = if both {
            let (a, b) = (a.part(uncertain.clone()), b.part(uncertain.clone()));
            let rows = a.iter().zip(&*b).zip(precision_factor);
            rows.map(|((a, b), t)| a * b * t).sum()
        } else {
            0.0
        };
        a.dot_within(b, 0..uncertain.start) + weighted + a.dot_within(b, uncertain.end..usize::MAX)
    }

    /// A column with each uncertain row times its factor.
    pub(crate) fn times(&self, column: &Column, factor: impl Iterator<Item = f64>) -> Column {
        let mut column = column.clone();
        let uncertain = self.uncertain();
        if column.touches(&uncertain) {
            column.widen(uncertain.clone());
            let from = uncertain.start - column.start;
            for (value, factor) in column.values_mut()[from..].iter_mut().zip(factor) {
                *value *= factor;
            }
        }
        column
    }
}
