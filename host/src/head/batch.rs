//! A batch of campaigns as normal equations over the type's mean and the marks' errors. They add up: a batch is one pass in
//! any order, in memory that does not grow with the number of instruments.

use inference::dense::Cholesky;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use shared::model::NOMINAL;
use shared::tumble::within_a_turn;

use super::form::Form;
use super::posterior::{Posterior, Prior};
use super::reduced::{MAX_MARKS, Reduced};
use crate::error::Error;
use crate::statics::DEFAULT_PRIOR_SIGMA;

/// Coefficients that a type has a mean of: all but K1.
pub const TYPE: usize = NOMINAL - 1;

/// Standard deviations of a type's coefficients about their mean before anything is known of the type, each in its own unit,
/// in the order of the model from k0 on. Of those that rectify the size that a prediction takes; bias and misalignments
/// come from each mounting anew and are as wide as any instrument of the kind.
pub const DEFAULT_SPREAD: [f64; TYPE] = {
    let s = DEFAULT_PRIOR_SIGMA;
    [0.02, s, s, s, s, 0.02, 0.02, s, s, s]
};

/// Sums over the campaigns of a batch, for one spread of the type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Batch {
    /// Standard deviation of each coefficient from k0 on about the type's mean.
    pub spread: [f64; TYPE],
    /// Angles of the marks so far, deg, within a turn, in the order in which they came.
    pub marks_deg: Vec<f64>,
    /// Largest stated standard uncertainty of a mark, rad.
    pub dial_sigma_rad: f64,
    /// Number of campaigns.
    pub campaigns: u64,
    /// Number of observations.
    pub rows: u64,
    /// Over (1, type's mean, marks): twice the negative logarithm of the likelihood, the coefficients integrated out.
    pub(super) squares: Form,
    /// Sum of the logarithms of determinants that belong to it.
    pub(super) log_determinant: f64,
    /// Of each coefficient of the type, over the same: its expected squared distance from the mean, summed over instruments.
    pub(super) distances: Vec<Form>,
}

/// One campaign given the type's spread: the coefficients are `gain` (1, mean, marks) with the covariance `left`.
pub(super) struct Given {
    pub(super) left: DMatrix<f64>,
    pub(super) gain: DMatrix<f64>,
    squares: DMatrix<f64>,
    log_determinant: f64,
}

impl Batch {
    /// An empty batch of instruments of that spread.
    pub fn new(spread: [f64; TYPE]) -> Self {
        Self {
            spread,
            marks_deg: Vec::new(),
            dial_sigma_rad: 0.0,
            campaigns: 0,
            rows: 0,
            squares: Form::zero(1 + TYPE),
            log_determinant: 0.0,
            distances: vec![Form::zero(1 + TYPE); TYPE],
        }
    }

    /// Adds a campaign.
    ///
    /// # Errors
    /// The head has more than [`MAX_MARKS`] marks by now, or the campaign does not determine its scale factor.
    pub fn add(&mut self, campaign: &Reduced) -> Result<(), Error> {
        self.add_many(campaign, 1)
    }

    /// Adds so many campaigns that tell the same.
    ///
    /// # Errors
    /// Those of [`Self::add`].
    pub fn add_many(&mut self, campaign: &Reduced, count: u64) -> Result<(), Error> {
        self.absorb(campaign, count as f64)?;
        self.campaigns += count;
        self.rows += count * campaign.rows as u64;
        Ok(())
    }

    /// Has these marks among its own, whether or not a campaign visits them.
    ///
    /// # Errors
    /// The head has more than [`MAX_MARKS`] marks by now.
    pub fn visit(&mut self, marks_deg: &[f64]) -> Result<(), Error> {
        self.places(marks_deg).map(|_| ())
    }

    /// Takes a campaign out that was added.
    ///
    /// # Errors
    /// Those of [`Self::add`].
    pub fn remove(&mut self, campaign: &Reduced) -> Result<(), Error> {
        self.absorb(campaign, -1.0)?;
        self.campaigns -= 1;
        self.rows -= campaign.rows as u64;
        Ok(())
    }

    fn absorb(&mut self, campaign: &Reduced, factor: f64) -> Result<(), Error> {
        let given = self
            .given(campaign)
            .ok_or_else(|| Error::Usage("static.csv does not determine the scale factor".into()))?;
        let places = self.places(&campaign.marks_deg)?;
        self.squares.add(&given.squares, &places, factor);
        self.log_determinant += factor * given.log_determinant;
        for (k, distances) in self.distances.iter_mut().enumerate() {
            let mut distance = given.gain.row(k + 1).into_owned();
            distance[1 + k] -= 1.0;
            distances.add(&distance.tr_mul(&distance), &places, factor);
            distances.add_constant(factor * given.left[(k + 1, k + 1)]);
        }
        self.dial_sigma_rad = self.dial_sigma_rad.max(campaign.dial_sigma_rad);
        Ok(())
    }

    /// Adds the sums of another part of the batch.
    ///
    /// # Errors
    /// The spreads differ, or there are more than [`MAX_MARKS`] marks by now.
    pub fn merge(&mut self, other: &Self) -> Result<(), Error> {
        if self.spread != other.spread {
            return Err(Error::Usage(
                "parts of a batch differ in the type's spread".into(),
            ));
        }
        let places = self.places(&other.marks_deg)?;
        self.squares.add(&other.squares.matrix(), &places, 1.0);
        self.log_determinant += other.log_determinant;
        for (own, others) in self.distances.iter_mut().zip(&other.distances) {
            own.add(&others.matrix(), &places, 1.0);
        }
        self.dial_sigma_rad = self.dial_sigma_rad.max(other.dial_sigma_rad);
        self.campaigns += other.campaigns;
        self.rows += other.rows;
        Ok(())
    }

    /// Places of (1, mean, these marks) among the unknowns; new marks are put at the end.
    fn places(&mut self, marks_deg: &[f64]) -> Result<Vec<usize>, Error> {
        let mut places: Vec<usize> = (0..=TYPE).collect();
        for mark in marks_deg.iter().map(|mark| within_a_turn(*mark)) {
            let known = self.marks_deg.iter().position(|known| *known == mark);
            let place = known.unwrap_or_else(|| {
                self.marks_deg.push(mark);
                self.marks_deg.len() - 1
            });
            places.push(1 + TYPE + place);
        }
        if self.marks_deg.len() > MAX_MARKS {
            return Err(Error::Usage(format!(
                "the campaigns have {} different marks; at most {MAX_MARKS} of a head are mapped",
                self.marks_deg.len()
            )));
        }
        let order = 1 + TYPE + self.marks_deg.len();
        for form in self.distances.iter_mut().chain([&mut self.squares]) {
            form.grow(order);
        }
        Ok(places)
    }

    /// A campaign's coefficients integrated out; `None` if it leaves K1 undetermined.
    pub(super) fn given(&self, campaign: &Reduced) -> Option<Given> {
        let marks = campaign.marks_deg.len();
        let mut precision = campaign
            .information
            .view((0, 0), (NOMINAL, NOMINAL))
            .into_owned();
        let weights = self.spread.map(|sigma| sigma.powi(-2));
        for (k, weight) in weights.iter().enumerate() {
            precision[(k + 1, k + 1)] += weight;
        }
        let elements = precision.transpose().as_slice().to_vec();
        let factor = Cholesky::new(elements, NOMINAL)?;
        let left = DMatrix::from_row_slice(NOMINAL, NOMINAL, &factor.inverse());
        // What pulls on the coefficients, by (1, mean, marks).
        let mut pull = DMatrix::zeros(NOMINAL, 1 + TYPE + marks);
        for k in 0..NOMINAL {
            pull[(k, 0)] = campaign.rhs[k];
            if k > 0 {
                pull[(k, k)] = weights[k - 1];
            }
            for mark in 0..marks {
                pull[(k, 1 + TYPE + mark)] = -campaign.information[(k, NOMINAL + mark)];
            }
        }
        let gain = &left * &pull;
        let mut squares = -pull.tr_mul(&gain);
        squares[(0, 0)] += campaign.squares;
        for (k, weight) in weights.iter().enumerate() {
            squares[(1 + k, 1 + k)] += weight;
        }
        for i in 0..marks {
            let (at, of) = (1 + TYPE + i, NOMINAL + i);
            squares[(0, at)] -= campaign.rhs[of];
            squares[(at, 0)] -= campaign.rhs[of];
            for j in 0..marks {
                squares[(at, 1 + TYPE + j)] += campaign.information[(of, NOMINAL + j)];
            }
        }
        let spread: f64 = self.spread.iter().map(|sigma| 2.0 * sigma.ln()).sum();
        Some(Given {
            left,
            gain,
            squares,
            log_determinant: campaign.log_determinant + factor.log_determinant() + spread,
        })
    }

    /// What the batch says of type and marks beside what was known before.
    ///
    /// # Errors
    /// There is no campaign in it.
    pub fn posterior(&self, prior: &Prior) -> Result<Posterior, Error> {
        Posterior::of(self, prior)
    }

    /// The spread that the instruments show, each coefficient's by its expected squared distance from the mean: one step of
    /// expectation and maximisation. The sum is over two instruments less: at its fixed point, where the mean takes one, the
    /// square is then that of n - 1 squares over n - 3, the expectation of a variance of which nothing was known; with the most
    /// probable one the errors of ten instruments would be stated a sixth too small.
    fn shown_spread(&self, posterior: &Posterior) -> [f64; TYPE] {
        let mean = DVector::from_iterator(
            1 + posterior.mean.len(),
            std::iter::once(1.0).chain(posterior.mean.iter().copied()),
        );
        let order = mean.len();
        std::array::from_fn(|k| {
            let form = self.distances[k].matrix();
            let inner = form.view((1, 1), (order - 1, order - 1));
            let spread =
                mean.dot(&(&form * &mean)) + inner.component_mul(&posterior.covariance).sum();
            (spread / (self.campaigns as f64 - 2.0))
                .max(LEAST_SPREAD * LEAST_SPREAD)
                .sqrt()
        })
    }
}

/// Fewest instruments that tell a spread: with four degrees of freedom its relative uncertainty is a third, and an expectation of the
/// variance exists.
pub const FEWEST: usize = 5;
/// Least spread: that of a coefficient which is the same in all instruments to a hundredth of a microg.
const LEAST_SPREAD: f64 = 1e-8;
/// Relative change of every spread at which it has settled: a tenth of what a batch of a thousand tells it to.
const SETTLED: f64 = 2e-3;
/// Most passes over the instruments.
const MOST_PASSES: usize = 60;

/// The batch of all campaigns under the spread that they show themselves, by passes over them; of few campaigns under
/// `spread` as it is. `step` is told the number of the pass.
///
/// # Errors
/// Those of [`Batch::add`] and [`Batch::posterior`].
pub fn settle(
    campaigns: &[Reduced],
    spread: [f64; TYPE],
    prior: &Prior,
    mut step: impl FnMut(usize),
) -> Result<(Batch, Posterior), Error> {
    let mut batch = sum(campaigns, spread)?;
    let mut posterior = batch.posterior(prior)?;
    if campaigns.len() < FEWEST {
        return Ok((batch, posterior));
    }
    for pass in 1..=MOST_PASSES {
        step(pass);
        let shown = batch.shown_spread(&posterior);
        let changes = shown
            .iter()
            .zip(&batch.spread)
            .map(|(new, old)| (new / old).ln().abs());
        let change = changes.fold(0.0, f64::max);
        batch = sum(campaigns, shown)?;
        posterior = batch.posterior(prior)?;
        if change < SETTLED {
            break;
        }
    }
    Ok((batch, posterior))
}

/// Sums over campaigns, on all cores.
///
/// # Errors
/// Those of [`Batch::add`].
pub fn sum(campaigns: &[Reduced], spread: [f64; TYPE]) -> Result<Batch, Error> {
    // Parts of a fixed size: the same sums on any number of threads.
    const PART: usize = 64;
    let parts: Vec<Batch> = campaigns
        .par_chunks(PART)
        .map(|part| {
            let mut batch = Batch::new(spread);
            part.iter().try_for_each(|campaign| batch.add(campaign))?;
            Ok(batch)
        })
        .collect::<Result<_, Error>>()?;
    let mut batch = Batch::new(spread);
    parts.iter().try_for_each(|part| batch.merge(part))?;
    Ok(batch)
}
