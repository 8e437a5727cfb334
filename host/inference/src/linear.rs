//! The linear part: least squares over the unknowns of a base and further columns.

use crate::dense::Cholesky;
use crate::model::{Base, Member, Prediction, SeparableModel, linear_precision};
use crate::normal::Normal;
use crate::observations::{Column, Observations};

/// Of a base whose columns are `columns`, each uncertain row counting by its precision factor.
fn normal_of(
    observations: &Observations,
    base: &Base,
    columns: &[Column],
    precision_factor: &[f64],
) -> Normal {
    let mut normal = base.still.clone();
    let uncertain = observations.uncertain();
    for observable in observations.transforming() {
        if observable.rows != uncertain {
            normal.absorb(columns, observations.observed(), observable.rows.clone());
        }
    }
    normal.absorb_weighted(
        columns,
        observations.observed(),
        uncertain,
        precision_factor,
    );
    normal
}

/// How much each uncertain row counts, and the normal equations of the base as it is under that.
pub(crate) struct Weighing {
    pub(crate) precision_factor: Vec<f64>,
    untransformed: Normal,
}

impl Weighing {
    pub(crate) fn new(model: &dyn SeparableModel, precision_factor: Vec<f64>) -> Self {
        let (observations, base) = (model.observations(), model.base());
        let untransformed = normal_of(observations, base, &base.columns, &precision_factor);
        Self {
            precision_factor,
            untransformed,
        }
    }
}

/// A solved linear problem.
pub(crate) struct Solution {
    pub(crate) x: Vec<f64>,
    /// -2 log likelihood at it, priors included.
    pub(crate) objective: f64,
    pub(crate) factor: Cholesky,
}

/// Solves for the unknowns of the base and all in proportion, and for small changes along `derivatives`; `precision` is
/// the prior's on what is in proportion, then on those.
pub(crate) fn solve(
    model: &dyn SeparableModel,
    prediction: &Prediction,
    derivatives: &[Column],
    precision: &[f64],
    weighing: &Weighing,
) -> Option<Solution> {
    let (observations, base) = (model.observations(), model.base());
    let factor = &weighing.precision_factor;
    let transformed = prediction.transformed(base, observations);
    let normal = transformed.map(|columns| normal_of(observations, base, columns, factor));
    let normal = normal.as_ref().unwrap_or(&weighing.untransformed);
    let base_columns = transformed.unwrap_or(&base.columns);
    let linear = prediction.linear().map(|(column, _)| column);
    let further: Vec<&Column> = linear.chain(derivatives).collect();
    let (of_base, n) = (base.columns.len(), base.columns.len() + further.len());
    let columns = || base_columns.iter().chain(further.iter().copied());
    let mut matrix = vec![0.0; n * n];
    for i in 0..of_base {
        let row = &normal.matrix[i * of_base..=i * of_base + i];
        matrix[i * n..=i * n + i].copy_from_slice(row);
    }
    let mut x = normal.right.clone();
    for (i, column) in further.iter().enumerate() {
        let row = &mut matrix[(of_base + i) * n..][..=of_base + i];
        for (value, other) in row.iter_mut().zip(columns()) {
            *value = observations.dot(column, other, factor);
        }
        row[of_base + i] += precision[i];
        x.push(observations.dot(column, observations.observed(), factor));
    }
    let mut square = normal.square;
    if let Some(offset) = prediction.offset() {
        for (x, column) in x.iter_mut().zip(columns()) {
            *x -= observations.dot(offset, column, factor);
        }
        square += observations.dot(offset, offset, factor);
        square -= 2.0 * observations.dot(offset, observations.observed(), factor);
    }
    let right = x.clone();
    let factor = Cholesky::new(matrix, n)?;
    factor.solve(&mut x);
    let explained: f64 = x.iter().zip(&right).map(|(x, r)| x * r).sum();
    Some(Solution {
        x,
        objective: square - explained,
        factor,
    })
}

/// The unknowns of the base and all in proportion, at the members' other values.
pub(crate) fn solve_linear(
    model: &dyn SeparableModel,
    members: &[Member],
    prediction: &Prediction,
    weighing: &Weighing,
) -> Option<Solution> {
    solve(
        model,
        prediction,
        &[],
        &linear_precision(model, members),
        weighing,
    )
}
