//! Coefficients of one instrument from its campaign, `vre-identification/1`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use shared::compensate::Calibration;
use shared::identify::static_test::Fit;
use shared::model::{Coefficients, NOMINAL};
use shared::rectification::Covariance;

use super::closed_form;
use super::coefficients::{NAMES, blind_directions};
use super::goodness::p_value;
use super::least_squares::fit;
use super::readings::position;
use crate::campaign::{self, Campaign};
use crate::error::Error;
use crate::quantity::Quantity;

/// How the coefficients are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Weighted least squares on all readings, dial, mount and level as random effects
    LeastSquares,
    /// The paper's formulas (10)-(17) on the paper's 24 positions
    ClosedForm,
}

/// The coefficients of an instrument with all that is known of their uncertainty.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// Always `vre-identification/1`.
    pub format: &'static str,
    /// Serial number of the instrument.
    pub serial: String,
    /// How they were found.
    pub method: Method,
    /// Each coefficient under its name in [`NAMES`]; null where the readings do not determine it.
    #[serde(serialize_with = "by_name")]
    pub coefficients: [Quantity; NOMINAL],
    /// Covariance in the order of [`NAMES`]; without a prior zero along blind directions.
    pub covariance: [[f64; NOMINAL]; NOMINAL],
    /// Number of directions that the readings determine beside what is known beforehand, 0 to 11.
    pub rank: usize,
    /// Condition number of the plan's design matrix; beyond 1e12 for positions of deficient rank.
    pub condition: f64,
    /// Unit directions in coefficient space that are blind, the components that are not zero.
    pub blind_directions: Vec<BTreeMap<&'static str, f64>>,
    /// Sum of squared whitened residuals; absent with the closed formulas, which have none.
    pub chi2: Option<f64>,
    /// Degrees of freedom of chi2.
    pub dof: usize,
    /// Probability of a chi2 at least as large if the stated uncertainties hold.
    pub chi2_p_value: Option<f64>,
    /// Standard deviation about zero stated beforehand for every coefficient but K1, if one was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior_sigma: Option<f64>,
    /// Output of each reading less that of the coefficients at the nominal angle, g.
    pub residuals_g: Vec<f64>,
    /// The coefficients as a model: of those that the plan does not determine the combination of least norm.
    #[serde(skip)]
    pub model: Coefficients<f64>,
}

fn by_name<S: serde::Serializer>(
    quantities: &[Quantity; NOMINAL],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(NAMES.iter().zip(quantities))
}

/// Identifies the coefficients from the static readings of a campaign.
///
/// `prior_sigma`: a standard deviation about zero, stated beforehand, for every coefficient but K1 (in its own unit);
/// least squares only.
///
/// # Errors
/// Fewer readings than coefficients; for the closed formulas a position of the paper's plan without a reading.
pub fn identify(
    campaign: &Campaign,
    method: Method,
    prior_sigma: Option<f64>,
) -> Result<Identification, Error> {
    match method {
        Method::LeastSquares => {
            let fit = fit(campaign, prior_sigma)?;
            Ok(Identification::new(campaign, method, &fit, prior_sigma))
        }
        Method::ClosedForm if prior_sigma.is_some() => Err(Error::Usage(
            "the closed formulas take no prior; use the method least-squares".into(),
        )),
        Method::ClosedForm => {
            let fit = closed_form::fit(campaign)?;
            let mut identification = Identification::new(campaign, method, &fit, None);
            (identification.chi2, identification.chi2_p_value) = (None, None);
            Ok(identification)
        }
    }
}

impl Identification {
    /// The statement of a fit of this campaign's readings.
    fn new(campaign: &Campaign, method: Method, fit: &Fit<f64>, prior_sigma: Option<f64>) -> Self {
        let values = fit.coefficients.to_nominal();
        let coefficients = std::array::from_fn(|k| {
            if prior_sigma.is_some() || fit.visibility.determines(k) {
                Quantity::new(values[k], fit.covariance[k][k].max(0.0).sqrt())
            } else {
                Quantity::UNDETERMINED
            }
        });
        Self {
            format: "vre-identification/1",
            serial: campaign.config.instrument.serial.clone(),
            method,
            coefficients,
            covariance: fit.covariance,
            rank: fit.visibility.rank,
            // JSON has no infinity.
            condition: fit.visibility.condition.min(f64::MAX),
            blind_directions: blind_directions(&fit.visibility),
            chi2: Some(fit.chi2),
            dof: fit.degrees_of_freedom(),
            chi2_p_value: p_value(fit),
            prior_sigma,
            residuals_g: residuals_g(campaign, &fit.coefficients),
            model: fit.coefficients,
        }
    }

    /// For the instrument.
    pub fn calibration(&self) -> Calibration<f64> {
        Calibration {
            coefficients: self.model,
            covariance: Covariance::from_nominal(&self.covariance),
            rank: self.rank as u8,
        }
    }
}

fn residuals_g(campaign: &Campaign, model: &Coefficients<f64>) -> Vec<f64> {
    let gravity_g = campaign.config.bench.local_gravity_g;
    let residual = |reading: &campaign::Reading| {
        let mut a = position(reading).specific_force();
        (a.i, a.p, a.o) = (gravity_g * a.i, gravity_g * a.p, gravity_g * a.o);
        reading.output_v / model.scale_factor_v_per_g - model.output_g(a)
    };
    campaign.readings.iter().map(residual).collect()
}
