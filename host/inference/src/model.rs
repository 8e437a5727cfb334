//! What a model predicts: a base that is linear in its unknowns, and components that may act beside it.

use std::sync::{Arc, OnceLock};

use crate::normal::Normal;
use crate::observations::{Column, Observations};
use crate::prior::{Parameter, Prior, grid};

/// How a component acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Adds to the observations.
    Adds,
    /// Transforms the base's own columns.
    TransformsBase,
    /// Adds variance to uncertain rows: the square of its one parameter, a size, times what a unit adds.
    AddsVariance,
}

/// Something that may act beside the base. Parameters in proportion come first.
#[derive(Clone, Copy, Debug)]
pub struct Component {
    /// Its parameters.
    pub parameters: &'static [Parameter],
    /// How it acts.
    pub kind: Kind,
    /// Whether its parameters may fit with other signs as well, which has to be tried.
    pub signs_alike: bool,
}

impl Component {
    /// Number of parameters in proportion.
    pub fn linear(&self) -> usize {
        let linear = |p: &&Parameter| matches!(p.prior, Prior::Linear { .. });
        self.parameters.iter().take_while(linear).count()
    }

    /// Whether a transformation begins at none: its parameters can then be refined from there.
    pub(crate) fn begins_at_nothing(&self) -> bool {
        let even = |p: &Parameter| {
            matches!(
                p.prior,
                Prior::Nonlinear {
                    logarithmic: false,
                    ..
                }
            )
        };
        self.kind == Kind::TransformsBase && self.parameters.iter().all(even)
    }

    /// Every combination of its parameters' starts.
    pub fn grid(&self) -> Vec<Vec<f64>> {
        grid(self.parameters)
    }
}

/// A component with values of its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Its number among the model's components.
    pub component: usize,
    /// Its parameters in their order.
    pub values: Vec<f64>,
}

/// How exactly a prediction is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fidelity {
    /// For a first look at many starts.
    Screening,
    /// For a fit.
    Full,
}

/// What a component adds for a unit of each parameter in proportion (or at all, without one): the whitened column, and the
/// variance of each uncertain row in the observations' unit.
pub type Columns = Vec<(Column, Vec<f64>)>;

/// What a transformation makes of the base's columns.
#[derive(Debug)]
pub struct Transformed {
    /// Row after row of the observables that transform: the whitened value of each unknown of the base.
    values: Vec<f64>,
    unknowns: usize,
    columns: OnceLock<Vec<Column>>,
}

impl Transformed {
    /// `values` are whitened: row after row of the observables that transform, in their order, one number for each of so many
    /// `unknowns` of the base.
    pub fn new(values: Vec<f64>, unknowns: usize) -> Self {
        Self {
            values,
            unknowns,
            columns: OnceLock::new(),
        }
    }

    /// Number of a row among all, with the values of each unknown there.
    pub(crate) fn rows<'a>(
        &'a self,
        observations: &'a Observations,
    ) -> impl Iterator<Item = (usize, &'a [f64])> {
        let rows = observations.transforming().flat_map(|o| o.rows.clone());
        rows.zip(self.values.chunks_exact(self.unknowns))
    }

    fn columns(&self, base: &Base, observations: &Observations) -> &[Column] {
        self.columns.get_or_init(|| {
            let mut columns: Vec<Vec<f64>> = base.columns.iter().map(Column::to_vec).collect();
            for (row, values) in self.rows(observations) {
                for (column, value) in columns.iter_mut().zip(values) {
                    column[row] = *value;
                }
            }
            columns
                .into_iter()
                .map(|c| observations.column(c))
                .collect()
        })
    }
}

/// The prediction of a hypothesis at given values of what is not in proportion.
#[derive(Debug, Default)]
pub struct Prediction {
    transformed: Option<Arc<Transformed>>,
    linear: Vec<Arc<Columns>>,
    offset: Option<Column>,
    variance: Vec<f64>,
}

impl Prediction {
    /// Of the base as it is, with so many uncertain rows.
    pub fn of_base(uncertain: usize) -> Self {
        Self {
            variance: vec![0.0; uncertain],
            ..Self::default()
        }
    }

    /// The base's columns are transformed.
    pub fn transform(&mut self, transformed: Arc<Transformed>) {
        self.transformed = Some(transformed);
    }

    /// Columns of parameters in proportion.
    pub fn add_linear(&mut self, columns: Arc<Columns>) {
        self.linear.push(columns);
    }

    /// Adds what is added as it is.
    pub fn add_offset(&mut self, column: &Column) {
        match &mut self.offset {
            Some(offset) => offset.add(column),
            none => *none = Some(column.clone()),
        }
    }

    /// Adds to the variance of the uncertain rows, in the observations' unit.
    pub fn add_variance(&mut self, variance: impl IntoIterator<Item = f64>) {
        for (sum, added) in self.variance.iter_mut().zip(variance) {
            *sum += added;
        }
    }

    /// The base's columns, if they are transformed.
    pub(crate) fn transformed<'a>(
        &'a self,
        base: &Base,
        observations: &Observations,
    ) -> Option<&'a [Column]> {
        let transformed = self.transformed.as_ref()?;
        Some(transformed.columns(base, observations))
    }

    /// What the base's columns are transformed to, row by row.
    pub(crate) fn transformed_rows(&self) -> Option<&Transformed> {
        self.transformed.as_deref()
    }

    /// Columns of the parameters in proportion, and the variance that a unit of each adds.
    pub(crate) fn linear(&self) -> impl Iterator<Item = &(Column, Vec<f64>)> {
        self.linear.iter().flat_map(|columns| columns.iter())
    }

    /// What is added without a parameter in proportion.
    pub(crate) fn offset(&self) -> Option<&Column> {
        self.offset.as_ref()
    }

    /// The variance of each uncertain row, in the observations' unit, with these values of what is in proportion.
    pub fn added_variance(&self, in_proportion: &[f64]) -> Vec<f64> {
        let mut added = self.variance.clone();
        for ((_, unit), x) in self.linear().zip(in_proportion) {
            for (sum, unit) in added.iter_mut().zip(unit) {
                *sum += x * x * unit;
            }
        }
        added
    }
}

/// The part of a model that is always there: linear in its unknowns, which have Gaussian priors.
#[derive(Clone, Debug)]
pub struct Base {
    /// What each unknown does, whitened.
    pub columns: Vec<Column>,
    /// Squares of the reciprocal prior standard deviations.
    pub prior_precision: Vec<f64>,
    /// Prior means.
    pub prior_mean: Vec<f64>,
    /// Normal equations of the rows that no transformation touches.
    pub(crate) still: Normal,
}

impl Base {
    /// Of these columns and priors, for these observations.
    pub fn new(
        observations: &Observations,
        columns: Vec<Column>,
        prior_precision: Vec<f64>,
        prior_mean: Vec<f64>,
    ) -> Self {
        let mut still = Normal::prior(&prior_precision, &prior_mean);
        for observable in observations.observables().iter().filter(|o| !o.transforms) {
            still.absorb(&columns, observations.observed(), observable.rows.clone());
        }
        Self {
            columns,
            prior_precision,
            prior_mean,
            still,
        }
    }

    /// Another prior precision of one unknown.
    pub fn set_prior_precision(&mut self, unknown: usize, precision: f64) {
        let n = self.columns.len();
        self.still.matrix[unknown * n + unknown] += precision - self.prior_precision[unknown];
        self.prior_precision[unknown] = precision;
    }
}

/// A base and components that may act beside it, alone or together.
pub trait SeparableModel: Sync {
    /// What was observed.
    fn observations(&self) -> &Observations;

    /// The part that is always there.
    fn base(&self) -> &Base;

    /// What may act beside it.
    fn components(&self) -> &[Component];

    /// What `members` predict at the values that they have. Values of what is in proportion do not matter, but for components
    /// that add variance.
    fn predict(&self, members: &[Member], fidelity: Fidelity) -> Prediction;

    /// Variance of each uncertain row beside its stated one, in units of that, at the unknowns `x`: those of the base, then
    /// what is in proportion. `prediction` is that of the members.
    fn variance(&self, members: &[Member], prediction: &Prediction, x: &[f64]) -> Vec<f64>;

    /// Variance (in units of the stated one) that a unit of a component that adds variance gives each uncertain row.
    fn unit_variance(&self, component: usize) -> Vec<f64>;

    /// The ranges of a threshold between `from` and `to` over which it makes no difference.
    fn threshold_steps(&self, from: f64, to: f64) -> Vec<(f64, f64)>;

    /// Lets components that depend on the base's unknowns take these.
    fn linearise_about(&mut self, base_values: &[f64]);

    /// Columns of smooth functions of the conditions, by family: what "something else" might look like.
    fn smooth_families(&self) -> Vec<Vec<Column>>;
}

/// Precision on the parameters in proportion: the Cauchy prior is counted by the evidence; this keeps what no observation
/// sees from running away.
pub(crate) fn linear_precision(model: &dyn SeparableModel, members: &[Member]) -> Vec<f64> {
    let parameters = members
        .iter()
        .flat_map(|m| model.components()[m.component].parameters);
    let precision = parameters.filter_map(|p| match p.prior {
        Prior::Linear { width } => Some((100.0 * width).powi(-2)),
        _ => None,
    });
    precision.collect()
}
