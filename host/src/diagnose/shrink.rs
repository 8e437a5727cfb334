//! How far the gap shrinks, on runs that were not used: cross-validation over blocks of conditions.

use serde::{Deserialize, Serialize};
use shared::model::NOMINAL;

use super::dense::Cholesky;
use super::fit::Fit;
use super::problem::{Block, Column, Problem};
use super::search::Search;
use crate::campaign::{Campaign, Run, VibrationKind};

/// Root mean squares over held-out runs of measured less predicted vibration error, g.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shrink {
    /// Coefficients from the static test alone.
    pub held_out_rms_static_only_g: f64,
    /// The nominal model fitted to everything but the held-out runs.
    pub held_out_rms_refit_g: f64,
    /// The same with the effects.
    pub held_out_rms_with_effects_g: f64,
    /// What the noise of the plateaus and the finite records would leave of a perfect prediction.
    pub noise_floor_rms_g: f64,
    /// What the effects close of what the refit leaves above the floor on runs that nobody has made, 0 to 1; 0 where they
    /// are not used in predictions, which they would make no better.
    pub closed_fraction: f64,
    /// The central 90 % of what it may be.
    #[serde(default)]
    pub closed_fraction_interval_90: [f64; 2],
}

impl Problem<'_> {
    /// Cross-validates a fit against the nominal model; `None` without runs.
    pub(super) fn shrink(&self, campaign: &Campaign, search: &Search, fit: &Fit) -> Option<Shrink> {
        let null = &search.null;
        let measured = |run: &&Run| run.measured.is_some();
        let mut conditions: Vec<(VibrationKind, [f64; 2], f64)> = Vec::new();
        for run in self
            .situation
            .runs
            .iter()
            .copied()
            .filter(|run| measured(run))
        {
            if !conditions.contains(&(run.kind, run.band_hz, run.specific_force_g.i)) {
                conditions.push((run.kind, run.band_hz, run.specific_force_g.i));
            }
        }
        let made = self
            .situation
            .runs
            .iter()
            .filter(|run| measured(run))
            .count();
        if made == 0 {
            return None;
        }
        let from_static = self.static_only()?;
        let (mut statics, mut refit, mut with, mut floor) = (0.0, 0.0, 0.0, 0.0);
        for (kind, band_hz, a0_i_g) in conditions {
            let runs = self.situation.runs.iter().enumerate();
            let fold: Vec<usize> = runs
                .filter(|(_, run)| {
                    measured(run)
                        && run.kind == kind
                        && run.band_hz == band_hz
                        && run.specific_force_g.i == a0_i_g
                })
                .map(|(row, _)| row)
                .collect();
            let nominal = self.held_out(null, &fold)?;
            let effects = self.held_out(fit, &fold)?;
            refit += nominal.iter().map(|error| error * error).sum::<f64>();
            with += effects.iter().map(|error| error * error).sum::<f64>();
            for &row in &fold {
                let [during, before] =
                    [Block::During, Block::Before].map(|block| self.range(block).start + row);
                let predicted = (0..NOMINAL)
                    .map(|k| from_static[k] * self.vre_row(&self.nominal[k], row))
                    .sum::<f64>();
                let observed = self.observed.values[during] / self.weights[during]
                    - self.observed.values[before] / self.weights[before];
                statics += (observed - predicted).powi(2);
                floor +=
                    self.weights[before].powi(-2) + self.weights[during].powi(-2) / fit.trust[row];
            }
        }
        let rms = |sum: f64| (sum / made as f64).sqrt();
        let closing = self.expected_closing(campaign, search, fit);
        Some(Shrink {
            held_out_rms_static_only_g: rms(statics),
            held_out_rms_refit_g: rms(refit),
            held_out_rms_with_effects_g: rms(with),
            noise_floor_rms_g: rms(floor),
            closed_fraction: closing.fraction,
            closed_fraction_interval_90: closing.interval,
        })
    }

    /// A whitened column's part in a run's vibration error, in g.
    fn vre_row(&self, column: &Column, row: usize) -> f64 {
        let [during, before] =
            [Block::During, Block::Before].map(|block| self.range(block).start + row);
        column.values[during] / self.weights[during] - column.values[before] / self.weights[before]
    }

    /// Of each run left out the error of its predicted vibration error, g: the normal equations of the fit less those
    /// runs' rows, linear about the fit.
    fn held_out(&self, fit: &Fit, fold: &[usize]) -> Option<Vec<f64>> {
        let n = fit.columns.len();
        let mut matrix = Cholesky::new(fit.covariance.clone(), n)?.inverse();
        let mut right = vec![0.0; n];
        for &run in fold {
            for block in [
                Block::Before,
                Block::During,
                Block::After,
                Block::Drift,
                Block::Maximum,
                Block::Minimum,
            ] {
                let row = self.range(block).start + run;
                let root = if block == Block::During {
                    fit.trust[run].sqrt()
                } else {
                    1.0
                };
                let x: Vec<f64> = fit.columns.iter().map(|c| c.values[row] * root).collect();
                for i in 0..n {
                    right[i] -= x[i] * fit.residuals[row];
                    for j in 0..n {
                        matrix[i * n + j] -= x[i] * x[j];
                    }
                }
            }
        }
        let factor = Cholesky::new(matrix, n)?;
        factor.solve(&mut right);
        let mut errors = Vec::with_capacity(fold.len());
        for &run in fold {
            let [during, before] =
                [Block::During, Block::Before].map(|block| self.range(block).start + run);
            let x = fit.columns.iter().map(|c| self.vre_row(c, run));
            let residual = fit.residuals[during] / (self.weights[during] * fit.trust[run].sqrt())
                - fit.residuals[before] / self.weights[before];
            errors.push(residual - x.zip(&right).map(|(x, d)| x * d).sum::<f64>());
        }
        Some(errors)
    }

    /// The linear unknowns of the nominal model from the static readings alone.
    pub fn static_only(&self) -> Option<[f64; NOMINAL]> {
        let rows = self.range(Block::Static);
        let mut matrix = vec![0.0; NOMINAL * NOMINAL];
        let mut x = [0.0; NOMINAL];
        for i in 0..NOMINAL {
            let column = &self.nominal[i].values[rows.clone()];
            for j in 0..NOMINAL {
                let other = &self.nominal[j].values[rows.clone()];
                matrix[i * NOMINAL + j] = column.iter().zip(other).map(|(a, b)| a * b).sum();
            }
            matrix[i * NOMINAL + i] += self.prior_precision[i];
            x[i] = column
                .iter()
                .zip(&self.observed.values[rows.clone()])
                .map(|(a, b)| a * b)
                .sum();
        }
        x[0] += self.prior_precision[0];
        Cholesky::new(matrix, NOMINAL)?.solve(&mut x);
        Some(x)
    }
}
