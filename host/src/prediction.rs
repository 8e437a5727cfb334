//! Vibration errors of shaker runs, predicted and measured, `vre-prediction/1`.
//!
//! The table follows the command, so the second moments are the commanded ones. A finite random record is not
//! Gaussian: its own third and fourth moments, which the reference accelerometer reports, shift the expected
//! vibration error by far more than the instrument's noise; what no reference reports is a variance.

use serde::Serialize;
use shared::identify::static_test::Fit;
use shared::model::Coefficients;
use shared::rectification::Sensitivity;

use crate::campaign::{Campaign, Run};
use crate::campaign_model::judge::static_test;
use crate::error::Error;
use crate::forward::finite_record::unseen_variance_g2;
use crate::forward::motion::Motion;
use crate::forward::rows::RunConditions;
use crate::quantity::Quantity;
use crate::refit::predict_refitted;
use crate::statics::{fit_determined, p_value};

/// Predictions for the runs of a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// Always `vre-prediction/1`.
    pub format: &'static str,
    /// Serial number of the instrument.
    pub serial: String,
    /// Prior standard deviation of the coefficients, if one was stated or the static plan needed one. The refit has a wide
    /// one of its own besides.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior_sigma: Option<f64>,
    /// Probability of the static readings' chi-square, if the stated uncertainties hold.
    pub static_chi2_p_value: Option<f64>,
    /// One entry a run, in the order of the table.
    pub runs: Vec<PredictedRun>,
}

/// The vibration error of one run, in g.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PredictedRun {
    /// Run number.
    pub run: u64,
    /// From the coefficients of the static test alone.
    pub vre_g: Quantity,
    /// From the nominal model fitted to all readings and plateaus together; absent without shaker runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refit_vre_g: Option<Quantity>,
    /// From the same fit with diagnosed effects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with_effects_vre_g: Option<Quantity>,
    /// Measured: during less before, over K1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_vre_g: Option<Quantity>,
}

/// Predicts the vibration error of `runs` from the campaign's static readings that belong and, for the refit, from its shaker
/// runs. `prior_sigma` acts if given, and as [`DEFAULT_PRIOR_SIGMA`](crate::statics::DEFAULT_PRIOR_SIGMA) where the static plan is blind.
///
/// # Errors
/// Those of [`fit_determined`].
pub fn predict(
    campaign: &Campaign,
    runs: &[Run],
    prior_sigma: Option<f64>,
) -> Result<Prediction, Error> {
    let judged = static_test(campaign);
    let belonging = judged.map(|judged| judged.assumptions.applied_to_readings(campaign));
    let belonging = belonging.as_ref().unwrap_or(campaign);
    let (from_static, prior_sigma) = fit_determined(belonging, prior_sigma)?;
    let refitted = if campaign.runs.iter().any(|run| run.measured.is_some()) {
        predict_refitted(campaign, [], runs, prior_sigma)?
            .into_iter()
            .map(Some)
            .collect()
    } else {
        vec![None; runs.len()]
    };
    let predicted = runs
        .iter()
        .zip(refitted)
        .map(|(run, refit_vre_g)| PredictedRun {
            run: run.run,
            vre_g: predicted_vre_g(run, &from_static),
            refit_vre_g,
            with_effects_vre_g: None,
            measured_vre_g: measured_vre_g(run, &from_static.coefficients),
        });
    Ok(Prediction {
        static_chi2_p_value: p_value(&from_static),
        format: "vre-prediction/1",
        serial: campaign.config.instrument.serial.clone(),
        prior_sigma,
        runs: predicted.collect(),
    })
}

/// The vibration error that a fit predicts for a run, g, with the uncertainty of the coefficients and of the
/// finite random record.
pub fn predicted_vre_g(run: &Run, fit: &Fit<f64>) -> Quantity {
    let sensitivity = sensitivity(run);
    let variance = sensitivity.variance_g2(&fit.covariance)
        + unseen_variance_g2(&run.into(), &fit.coefficients);
    Quantity::new(
        sensitivity.vre_g(&fit.coefficients),
        variance.max(0.0).sqrt(),
    )
}

/// The measured vibration error of a run, g; K1's uncertainty, some 1e-6 of it, is left out.
pub fn measured_vre_g(run: &Run, coefficients: &Coefficients<f64>) -> Option<Quantity> {
    let measured = run.measured?;
    let k1 = coefficients.scale_factor_v_per_g;
    let value = (measured.during_v - measured.before_v) / k1;
    Some(Quantity::new(
        value,
        std::f64::consts::SQRT_2 * measured.sigma_v / k1.abs(),
    ))
}

/// Derivatives of a run's vibration error by the coefficients: commanded level, and the shape that the reference saw.
pub fn sensitivity(run: &Run) -> Sensitivity<f64> {
    let conditions = RunConditions::from(run);
    Motion::commanded(&conditions, run.reference.as_ref()).sensitivity(&conditions)
}
