//! What a batch says of its type and of the marks, and of each instrument then.

use inference::dense::Cholesky;
use nalgebra::{DMatrix, DVector};
use shared::model::NOMINAL;

use super::batch::{Batch, TYPE};
use super::reduced::Reduced;
use crate::error::Error;

/// Standard deviation about zero of the type's mean where nothing is known of it, each coefficient in its own unit: wider than
/// any instrument of the kind.
pub const MEAN_SIGMA: [f64; TYPE] = [
    0.02, 0.02, 0.02, 0.02, 0.005, 0.05, 0.05, 0.005, 0.005, 0.005,
];

/// What is known of type and marks beforehand. A mark that it does not name errs as its campaigns state.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// Angles of the marks that it names, deg, within a turn.
    pub marks_deg: Vec<f64>,
    /// Mean of (type's mean, errors of the marks in rad).
    pub mean: DVector<f64>,
    /// Its covariance.
    pub covariance: DMatrix<f64>,
}

impl Default for Prior {
    /// Nothing is known.
    fn default() -> Self {
        Self::of_type(MEAN_SIGMA)
    }
}

impl Prior {
    /// The type's mean is zero with these standard deviations; nothing is known of marks.
    pub fn of_type(sigma: [f64; TYPE]) -> Self {
        Self {
            marks_deg: Vec::new(),
            mean: DVector::zeros(TYPE),
            covariance: DMatrix::from_diagonal(&DVector::from_iterator(TYPE, sigma.map(|s| s * s))),
        }
    }

    /// The same of the type, nothing of the marks.
    pub fn without_marks(&self) -> Self {
        Self {
            marks_deg: Vec::new(),
            mean: self.mean.rows(0, TYPE).into_owned(),
            covariance: self.covariance.view((0, 0), (TYPE, TYPE)).into_owned(),
        }
    }

    /// Mean and covariance with these marks in this order; those of its own that are not among them are left out.
    fn over(&self, marks_deg: &[f64], dial_sigma_rad: f64) -> (DVector<f64>, DMatrix<f64>) {
        let known = |k: usize| match k {
            k if k < TYPE => Some(k),
            k => {
                let place = self
                    .marks_deg
                    .iter()
                    .position(|mark| *mark == marks_deg[k - TYPE]);
                place.map(|place| TYPE + place)
            }
        };
        let order = TYPE + marks_deg.len();
        let places: Vec<Option<usize>> = (0..order).map(known).collect();
        let mean = DVector::from_fn(order, |k, _| {
            places[k].map_or(0.0, |place| self.mean[place])
        });
        let covariance = DMatrix::from_fn(order, order, |i, j| match (places[i], places[j]) {
            (Some(i), Some(j)) => self.covariance[(i, j)],
            (None, None) if i == j => dial_sigma_rad * dial_sigma_rad,
            _ => 0.0,
        });
        (mean, covariance)
    }
}

/// What a batch says.
#[derive(Clone, Debug, PartialEq)]
pub struct Posterior {
    /// Angles of the marks, deg.
    pub marks_deg: Vec<f64>,
    /// Mean of (type's mean, errors of the marks in rad).
    pub mean: DVector<f64>,
    /// Its covariance.
    pub covariance: DMatrix<f64>,
    /// Standard uncertainty of a mark of which nothing is known, rad.
    pub dial_sigma_rad: f64,
    /// Spread of the type's coefficients about their mean.
    pub spread: [f64; TYPE],
    /// Least sum of squares, whitened.
    pub squares: f64,
    /// Logarithm of the evidence, but for a constant a row.
    pub log_evidence: f64,
}

/// The coefficients of one instrument.
#[derive(Clone, Debug, PartialEq)]
pub struct Instrument {
    /// Estimates in the order of the model, K1 in V/g.
    pub values: [f64; NOMINAL],
    /// Covariance of K1 relative to its value, and of the others.
    pub covariance: DMatrix<f64>,
}

impl Posterior {
    /// Of sums and what was known before.
    pub(super) fn of(batch: &Batch, prior: &Prior) -> Result<Self, Error> {
        let Batch {
            marks_deg,
            dial_sigma_rad,
            ..
        } = batch;
        // A dial that is said to be exact still has a thousandth of a second of arc.
        let dial_sigma_rad = dial_sigma_rad.max(1e-3 * shared::tumble::ARCSEC_RAD);
        let (prior_mean, prior_covariance) = prior.over(marks_deg, dial_sigma_rad);
        let form = batch.squares.matrix();
        let found = solve(&form, &prior_mean, &prior_covariance);
        let found = found.filter(|_| batch.campaigns > 0);
        let (mean, covariance, squares, log_determinants) =
            found.ok_or_else(|| Error::Usage("the batch determines nothing".into()))?;
        Ok(Self {
            marks_deg: marks_deg.clone(),
            mean,
            covariance,
            dial_sigma_rad,
            spread: batch.spread,
            squares,
            log_evidence: -0.5 * (squares + log_determinants + batch.log_determinant),
        })
    }

    /// An instrument of the batch, type and marks known as well as all instruments together tell them.
    pub fn instrument(&self, campaign: &Reduced) -> Option<Instrument> {
        let given = Batch::new(self.spread).given(campaign)?;
        let place = |mark: &f64| self.marks_deg.iter().position(|known| known == mark);
        let marks: Option<Vec<usize>> = campaign.marks_deg.iter().map(place).collect();
        let places: Vec<usize> = (0..TYPE)
            .chain(marks?.into_iter().map(|mark| TYPE + mark))
            .collect();
        let mean = DVector::from_iterator(places.len(), places.iter().map(|k| self.mean[*k]));
        let uncertain = DMatrix::from_fn(places.len(), places.len(), |i, j| {
            self.covariance[(places[i], places[j])]
        });
        let by_unknowns = given.gain.columns(1, places.len());
        let x = given.gain.column(0) + by_unknowns * mean;
        let covariance = given.left + by_unknowns * uncertain * by_unknowns.transpose();
        let mut values: [f64; NOMINAL] = std::array::from_fn(|k| x[k]);
        values[0] = campaign.scale_v_per_g * (1.0 + x[0]);
        Some(Instrument { values, covariance })
    }

    /// Standard uncertainty of a mark's error, rad.
    pub fn mark_sigma_rad(&self, mark: usize) -> f64 {
        self.covariance[(TYPE + mark, TYPE + mark)].max(0.0).sqrt()
    }

    /// What is known now, for the next batch.
    pub fn prior(&self) -> Prior {
        Prior {
            marks_deg: self.marks_deg.clone(),
            mean: self.mean.clone(),
            covariance: self.covariance.clone(),
        }
    }
}

/// Least squares of a form beside a Gaussian prior: mean, covariance, least sum of squares, and the logarithm of the
/// determinants of prior and information. Unknowns are scaled by their prior standard deviations.
pub(super) fn solve(
    form: &DMatrix<f64>,
    prior_mean: &DVector<f64>,
    prior_covariance: &DMatrix<f64>,
) -> Option<(DVector<f64>, DMatrix<f64>, f64, f64)> {
    let order = prior_mean.len();
    let scale = DVector::from_fn(order, |k, _| prior_covariance[(k, k)].sqrt());
    let scaled = |matrix: &DMatrix<f64>, power: i32| {
        DMatrix::from_fn(order, order, |i, j| {
            matrix[(i, j)] * scale[i].powi(power) * scale[j].powi(power)
        })
    };
    let factor_of = |matrix: &DMatrix<f64>| Cholesky::new(matrix.as_slice().to_vec(), order);
    let square = |factor: &Cholesky| DMatrix::from_row_slice(order, order, &factor.inverse());
    let prior = factor_of(&scaled(prior_covariance, -1))?;
    let precision = square(&prior);
    let own = form.view((1, 1), (order, order)).into_owned();
    let start = prior_mean.component_div(&scale);
    let information = scaled(&own, 1) + &precision;
    let pull = -form
        .view((1, 0), (order, 1))
        .column(0)
        .component_mul(&scale)
        + &precision * &start;
    let factor = factor_of(&information)?;
    let mut mean = pull.as_slice().to_vec();
    factor.solve(&mut mean);
    let mean = DVector::from_vec(mean);
    let squares = form[(0, 0)] + start.dot(&(&precision * &start)) - mean.dot(&pull);
    let covariance = scaled(&square(&factor), 1);
    Some((
        mean.component_mul(&scale),
        covariance,
        squares,
        prior.log_determinant() + factor.log_determinant(),
    ))
}
