//! Rows that do not belong: how far each lies from what all the others say of it.
//!
//! A gross error shifts one row. With its column c (a unit in that row, whitened), residuals r and the projection P onto
//! what all unknowns leave, the shift's estimate over its standard deviation is c'Pr / sqrt(c'Pc): for rows of their own
//! error the studentized residual, for correlated ones the residual given all the others.

use crate::dense::{Cholesky, inner_product};
use crate::fit::Fit;
use crate::model::SeparableModel;
use crate::observations::Column;

/// Least share of a row's information that counts as left by the unknowns: below it the row tells nothing of its own error.
const LEAST_LEFT: f64 = 1e-5;
/// Ridge on columns of unit information: such that are alike are told apart no further.
const RIDGE: f64 = 1e-6;

/// Of each row its distance from what a fit with `further` columns expects of it, in standard deviations; zero where nothing
/// was observed or nothing is left to tell it by.
pub fn distances(model: &dyn SeparableModel, fit: &Fit, further: &[Column]) -> Vec<f64> {
    let observations = model.observations();
    let roots = fit.precision_factor.iter().map(|factor| factor.sqrt());
    let weigh = |column: &Column| observations.times(column, roots.clone());
    let own: Vec<Column> = fit.columns.iter().map(weigh).collect();
    let mut left = Left {
        own,
        covariance: &fit.covariance,
        further: Vec::new(),
        factor: None,
        residuals: fit.residuals.clone(),
    };
    left.eliminate(further.iter().map(weigh).collect());
    let correlated = observations.observables()[0].rows.clone();
    let distance = |row: usize| {
        if correlated.contains(&row) {
            let mut unit = Column::zero(observations.len());
            unit.add_at(correlated.clone(), row - correlated.start, 1.0);
            let unit = observations.whiten(unit);
            left.distance(correlated.clone(), &unit.part(correlated.clone()))
        } else if observations.weight(row) == 0.0 {
            0.0
        } else {
            left.distance(row..row + 1, &[1.0])
        }
    };
    (0..observations.len()).map(distance).collect()
}

/// What a fit and further columns leave.
struct Left<'f> {
    own: Vec<Column>,
    covariance: &'f [f64],
    /// Further columns without what the fit's own imitate of them, of unit length.
    further: Vec<Vec<f64>>,
    factor: Option<Cholesky>,
    residuals: Vec<f64>,
}

impl Left<'_> {
    fn eliminate(&mut self, further: Vec<Column>) {
        let n = self.own.len();
        for column in &further {
            let across: Vec<f64> = self.own.iter().map(|c| c.dot(column)).collect();
            let mut rest = column.to_vec();
            for (row, own) in self.covariance.chunks_exact(n).zip(&self.own) {
                let part = inner_product(row, &across);
                own.add_to(&mut rest, -part);
            }
            let (square, whole) = (inner_product(&rest, &rest), column.dot(column));
            if square > RIDGE * whole {
                let size = square.sqrt().recip();
                rest.iter_mut().for_each(|r| *r *= size);
                self.further.push(rest);
            }
        }
        let k = self.further.len();
        let mut matrix = vec![0.0; k * k];
        for i in 0..k {
            for j in 0..=i {
                matrix[i * k + j] = inner_product(&self.further[i], &self.further[j]);
            }
            matrix[i * k + i] += RIDGE;
        }
        let Some(factor) = Cholesky::new(matrix, k).filter(|_| k > 0) else {
            self.further.clear();
            return;
        };
        let right = self
            .further
            .iter()
            .map(|c| inner_product(c, &self.residuals));
        let mut x: Vec<f64> = right.collect();
        factor.solve(&mut x);
        for (x, column) in x.iter().zip(&self.further) {
            self.residuals
                .iter_mut()
                .zip(column)
                .for_each(|(r, v)| *r -= x * v);
        }
        self.factor = Some(factor);
    }

    /// c'Pr / sqrt(c'Pc) of a column that is `unit` in some rows and zero elsewhere.
    fn distance(&self, rows: std::ops::Range<usize>, unit: &[f64]) -> f64 {
        let n = self.own.len();
        let whole = inner_product(unit, unit);
        let along = |column: &[f64]| inner_product(unit, &column[rows.clone()]);
        let own = self
            .own
            .iter()
            .map(|c| inner_product(unit, &c.part(rows.clone())));
        let x: Vec<f64> = own.collect();
        let covariance = self.covariance.chunks_exact(n).zip(&x);
        let mut information = whole
            - covariance
                .map(|(row, x_i)| x_i * inner_product(row, &x))
                .sum::<f64>();
        if let Some(factor) = &self.factor {
            let mut x: Vec<f64> = self.further.iter().map(|c| along(c)).collect();
            factor.forward(&mut x);
            information -= inner_product(&x, &x);
        }
        if information < LEAST_LEFT * whole {
            return 0.0;
        }
        along(&self.residuals) / information.sqrt()
    }
}
