//! Vibration error of runs that a diagnosis never saw.

use super::diagnosis::Diagnosis;
use super::fit::{Fit, Member};
use super::problem::{Block, Problem};
use crate::campaign::{Campaign, Run};
use crate::error::Error;
use crate::quantity::Quantity;

/// Predicts the vibration error of `runs` from the campaign, the nominal model and the effects that a diagnosis found
/// in it; their parameters are fitted anew from the diagnosis' values. One quantity (g) a run, in their order.
///
/// # Errors
/// The campaign does not determine the model.
pub fn predict_with_effects(
    campaign: &Campaign,
    diagnosis: &Diagnosis,
    runs: &[Run],
) -> Result<Vec<Quantity>, Error> {
    // A run of the campaign itself must not act twice.
    let new: Vec<Run> = runs
        .iter()
        .filter(|run| !campaign.runs.iter().any(|own| same(own, run)))
        .cloned()
        .collect();
    let undetermined = || Error::Usage("the campaign does not determine the nominal model".into());
    let mut problem = Problem::new(campaign, &new);
    let null = problem.fit_nominal().ok_or_else(undetermined)?;
    let mut fit = null;
    for _ in 0..2 {
        problem.situation.coefficients = super::fit::nominal(&fit.theta);
        fit = problem
            .fit(diagnosis.members(), &fit.trust, 3)
            .ok_or_else(undetermined)?;
    }
    let predictor = problem.unweighted();
    let errors = predictor.vibration_errors(&fit);
    let found = runs.iter().map(|run| {
        let row = predictor
            .situation
            .runs
            .iter()
            .position(|known| same(known, run));
        row.map_or(Quantity::UNDETERMINED, |row| errors[row])
    });
    Ok(found.collect())
}

fn same(a: &Run, b: &Run) -> bool {
    a.run == b.run && a.time_s == b.time_s
}

impl<'c> Problem<'c> {
    /// The same runs with every row in g, for predictions.
    fn unweighted(mut self) -> Self {
        self.weights.fill(1.0);
        self.nominal = self.design(&self.situation.motions);
        self
    }

    /// Vibration error of every run under a fit, g.
    fn vibration_errors(&self, fit: &Fit) -> Vec<Quantity> {
        let members: &[Member] = &fit.members;
        let (columns, values, added) = self.tangent(members, &fit.theta);
        let n = columns.len();
        let unseen = self.unseen_variance(&super::fit::nominal(&fit.theta), &fit.motions, &added);
        let [before, during] = [Block::Before, Block::During].map(|block| self.range(block).start);
        (0..self.run_count())
            .map(|row| {
                let value = (values[during + row] - values[before + row]) / fit.theta[0];
                let x: Vec<f64> = columns
                    .iter()
                    .map(|c| c.values[during + row] - c.values[before + row])
                    .collect();
                let mut variance = unseen[row];
                if fit.covariance.len() == n * n {
                    for i in 0..n {
                        let row = &fit.covariance[i * n..(i + 1) * n];
                        variance += x[i] * row.iter().zip(&x).map(|(c, x)| c * x).sum::<f64>();
                    }
                }
                Quantity::new(value, variance.max(0.0).sqrt())
            })
            .collect()
    }
}
