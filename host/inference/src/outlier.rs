//! Rows that do not belong: how far each lies from what all the others say of it.
//!
//! A gross error shifts one row. With its column c (a unit in that row, whitened), residuals r and the projection P onto
//! what all unknowns leave, the shift's estimate over its standard deviation is c'Pr / sqrt(c'Pc): for rows of their own
//! error the studentized residual, for correlated ones the residual given all the others.

use std::ops::Range;

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::dense::inverse_transposed;
use crate::fit::Fit;
use crate::model::SeparableModel;
use crate::observations::Column;

/// Least share of a row's information that counts as left by the unknowns: below it the row tells nothing of its own error.
const LEAST_LEFT: f64 = 1e-5;
/// Ridge on columns of unit information: such that are alike are told apart no further.
const RIDGE: f64 = 1e-6;
/// Rows that are taken at once.
const BLOCK: usize = 512;

/// Of each row its distance from what a fit with `further` columns expects of it, in standard deviations; zero where nothing
/// was observed or nothing is left to tell it by.
pub fn distances(model: &dyn SeparableModel, fit: &Fit, further: &[Column]) -> Vec<f64> {
    let observations = model.observations();
    let roots = fit.precision_factor.iter().map(|factor| factor.sqrt());
    let weigh = |column: &Column| observations.times(column, roots.clone());
    let n = fit.columns.len();
    let mut left = Left {
        own: fit.columns.iter().map(weigh).collect(),
        covariance: DMatrix::from_row_slice(n, n, &fit.covariance),
        further: Vec::new(),
        factor: None,
        residuals: fit.residuals.clone(),
    };
    left.eliminate(further.iter().map(weigh).collect());
    let correlated = observations.observables()[0].rows.clone();
    let units = observations.whitening();
    let mut found = left.distances(correlated.clone(), Some(&units));
    for start in (correlated.end..observations.len()).step_by(BLOCK) {
        let rows = start..(start + BLOCK).min(observations.len());
        found.extend(left.distances(rows, None));
    }
    for row in correlated.end..observations.len() {
        if observations.weight(row) == 0.0 {
            found[row] = 0.0;
        }
    }
    found
}

/// What a fit and further columns leave.
struct Left {
    own: Vec<Column>,
    covariance: DMatrix<f64>,
    /// Further columns without what the fit's own imitate of them, of unit length.
    further: Vec<DVector<f64>>,
    /// L^-T of the Cholesky factor L of their inner products.
    factor: Option<DMatrix<f64>>,
    residuals: Vec<f64>,
}

impl Left {
    fn eliminate(&mut self, further: Vec<Column>) {
        let across = further
            .iter()
            .flat_map(|column| self.own.iter().map(|own| own.dot(column)));
        let across = DMatrix::from_iterator(self.own.len(), further.len(), across);
        let parts = &self.covariance * across;
        for (column, parts) in further.iter().zip(parts.column_iter()) {
            let mut rest = column.to_vec();
            for (part, own) in parts.iter().zip(&self.own) {
                own.add_to(&mut rest, -part);
            }
            let rest = DVector::from_vec(rest);
            let (square, whole) = (rest.norm_squared(), column.dot(column));
            if square > RIDGE * whole {
                self.further.push(rest / square.sqrt());
            }
        }
        if self.further.is_empty() {
            return;
        }
        let columns = DMatrix::from_columns(&self.further);
        let mut matrix = columns.transpose() * &columns;
        (0..matrix.nrows()).for_each(|i| matrix[(i, i)] += RIDGE);
        let Some(factor) = Cholesky::new(matrix) else {
            self.further.clear();
            return;
        };
        let mut residuals = DVector::from_column_slice(&self.residuals);
        let explained = factor.solve(&columns.tr_mul(&residuals));
        residuals -= columns * explained;
        self.residuals = residuals.as_slice().to_vec();
        self.factor = Some(inverse_transposed(&factor.unpack()));
    }

    /// c'Pr / sqrt(c'Pc) of the unit of each of some rows, or of the columns C that are given as `units` = C^T.
    fn distances(&self, rows: Range<usize>, units: Option<&DMatrix<f64>>) -> Vec<f64> {
        let seen = |part: DMatrix<f64>| match units {
            Some(units) => units * part,
            None => part,
        };
        let own = self.own.iter().flat_map(|c| c.part(rows.clone()).to_vec());
        let own = DMatrix::from_iterator(rows.len(), self.own.len(), own);
        let further = self
            .further
            .iter()
            .flat_map(|c| &c.as_slice()[rows.clone()]);
        let further = DMatrix::from_iterator(rows.len(), self.further.len(), further.copied());
        let residuals = DMatrix::from_column_slice(rows.len(), 1, &self.residuals[rows.clone()]);
        let (own, further, along) = (seen(own), seen(further), seen(residuals));
        let whole = match units {
            Some(units) => squares(units, units),
            None => DVector::repeat(rows.len(), 1.0),
        };
        let mut information = &whole - squares(&own, &(&own * &self.covariance));
        if let Some(factor) = &self.factor {
            let further = further * factor;
            information -= squares(&further, &further);
        }
        let distance = |((along, information), whole): ((&f64, &f64), &f64)| match *information
            < LEAST_LEFT * whole
        {
            true => 0.0,
            false => along / information.sqrt(),
        };
        let known = along.iter().zip(&information).zip(&whole);
        known.map(distance).collect()
    }
}

/// Row by row the inner product of two matrices.
fn squares(one: &DMatrix<f64>, other: &DMatrix<f64>) -> DVector<f64> {
    one.component_mul(other).column_sum()
}
