//! Vibration error of runs that a diagnosis never saw.

use super::dense::inner_product;
use super::diagnosis::Diagnosis;
use super::fit::{Fit, Member, nominal};
use super::problem::{Block, Problem};
use crate::campaign::{Campaign, Run};
use crate::error::Error;
use crate::quantity::Quantity;

/// Predicts the vibration error of `runs` by the nominal model fitted to all that was measured, static test and shaker runs
/// together. One quantity (g) a run, in their order. `prior_sigma` is a standard deviation about zero of every coefficient
/// but K1, in its own unit.
///
/// # Errors
/// The campaign does not determine the model.
pub fn predict_refitted(
    campaign: &Campaign,
    runs: &[Run],
    prior_sigma: Option<f64>,
) -> Result<Vec<Quantity>, Error> {
    predict(campaign, Vec::new(), runs, prior_sigma)
}

/// The same with the effects that a diagnosis found; their parameters are fitted anew from the diagnosis' values.
///
/// # Errors
/// The campaign does not determine the model.
pub fn predict_with_effects(
    campaign: &Campaign,
    diagnosis: &Diagnosis,
    runs: &[Run],
    prior_sigma: Option<f64>,
) -> Result<Vec<Quantity>, Error> {
    predict(campaign, diagnosis.members(), runs, prior_sigma)
}

fn predict(
    campaign: &Campaign,
    members: Vec<Member>,
    runs: &[Run],
    prior_sigma: Option<f64>,
) -> Result<Vec<Quantity>, Error> {
    // A run of the campaign itself must not act twice; what others gave must not be learned from.
    let asked: Vec<Run> = runs.iter().map(Run::unmade).collect();
    let own: Vec<Run> = campaign.runs.iter().map(Run::unmade).collect();
    let mut new = asked.clone();
    new.retain(|run| !own.contains(run));
    let undetermined = || Error::Usage("the campaign does not determine the nominal model".into());
    let mut problem = Problem::new(campaign, &new);
    if let Some(sigma) = prior_sigma {
        problem.believe(sigma);
    }
    let mut fit = problem.fit_nominal().ok_or_else(undetermined)?;
    if !members.is_empty() {
        for _ in 0..2 {
            problem.suppose(nominal(&fit.theta));
            fit = problem
                .fit(members.clone(), &fit.trust, 3)
                .ok_or_else(undetermined)?;
        }
    }
    let predictor = problem.unweighted();
    let forecast = predictor.forecast(&fit);
    let commanded = &predictor.situation.motions;
    let unseen = predictor.unseen_variance(&nominal(&fit.theta), commanded, &forecast.record);
    let known: Vec<Run> = predictor
        .situation
        .runs
        .iter()
        .map(|r| r.unmade())
        .collect();
    let found = asked.iter().map(|run| {
        let row = known.iter().position(|known| known == run);
        row.map_or(Quantity::UNDETERMINED, |row| {
            let variance = forecast.variance(row, &fit) + unseen[row];
            Quantity::new(forecast.vre_g[row], variance.sqrt())
        })
    });
    Ok(found.collect())
}

/// What a fit says of every run's vibration error.
pub(super) struct Forecast {
    /// Its expectation, g.
    pub(super) vre_g: Vec<f64>,
    /// Its derivatives by the fit's unknowns, run by run.
    pub(super) slopes: Vec<Vec<f64>>,
    /// Its variance from what the effects make of a record that nobody knows, g^2.
    pub(super) record: Vec<f64>,
}

impl Forecast {
    /// Variance of a run's vibration error from coefficients and parameters, g^2.
    fn variance(&self, row: usize, fit: &Fit) -> f64 {
        let slope = &self.slopes[row];
        let rows = fit.covariance.chunks_exact(slope.len()).zip(slope);
        rows.map(|(row, x)| x * inner_product(row, slope))
            .sum::<f64>()
            .max(0.0)
    }
}

impl<'c> Problem<'c> {
    /// The same runs with every row in g, for predictions.
    pub(super) fn unweighted(mut self) -> Self {
        self.weights.fill(1.0);
        self.made.clear();
        self.nominal = self.design(&self.situation.motions);
        self
    }

    /// What `fit` says of every run.
    pub(super) fn forecast(&self, fit: &Fit) -> Forecast {
        let (columns, values, _) = self.tangent(&fit.members, &fit.theta);
        let [before, during] = [Block::Before, Block::During].map(|block| self.range(block).start);
        let vre = |values: &[f64], row: usize| values[during + row] - values[before + row];
        let rows = 0..self.run_count();
        let slope = |row: usize| columns.iter().map(|c| vre(&c.values, row)).collect();
        Forecast {
            vre_g: rows
                .clone()
                .map(|row| vre(&values, row) / fit.theta[0])
                .collect(),
            slopes: rows.map(slope).collect(),
            record: self.prediction(&fit.members, &fit.theta).1,
        }
    }
}
