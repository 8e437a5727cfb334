//! The coefficients of a triad with all that is known of their uncertainty, `vre-identification/1`.

use std::collections::BTreeMap;

use serde::Serialize;
use shared::model::{Coefficients, NOMINAL};
use shared::triad::attitude::UNKNOWNS;
use shared::triad::body::{Axis, specific_force_g};
use shared::triad::identification::Fit;
use shared::triad::vibration::{BodyMoments, vre_covariance_g2, vre_g};

use super::fit::{Fitted, fit};
use super::leave_out::GROUPS;
use crate::campaign::TriadCampaign;
use crate::error::Error;
use crate::quantity::Quantity;
use crate::statics::NAMES;

/// What is known of a triad.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TriadIdentification {
    /// Always `vre-identification/1`.
    pub format: &'static str,
    /// Serial number of the triad.
    pub serial: String,
    /// Always `triad`.
    pub kind: &'static str,
    /// Always `least-squares`.
    pub method: &'static str,
    /// Each instrument.
    pub instruments: BTreeMap<&'static str, InstrumentAnswer>,
    /// Covariance of the 33, x first, each in the order of [`NAMES`].
    pub covariance: Vec<Vec<f64>>,
    /// Directions of 33 that the positions tell by themselves.
    pub rank: usize,
    /// The same with the frame and the prior.
    pub rank_with_prior: usize,
    /// Ratio of the largest to the smallest gain of the positions over what was known beforehand; no JSON has infinity.
    pub condition: f64,
    /// Unit directions that the positions do not tell, by names such as `x.k2_per_g`.
    pub blind_directions: Vec<BTreeMap<String, f64>>,
    /// `chosen` where no attitude is known (IA of x is x, IA of y lies in the plane of x and y), else `body`.
    pub frame: &'static str,
    /// Standard deviation of k_IP, k_IO, k_PO about zero that campaign.toml states, 1/g; null if none.
    pub cross_coupling_sigma_per_g: Option<f64>,
    /// Sum of the squared whitened residuals, the scatter included.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub dof: usize,
    /// Probability of a chi-square at least as large with the stated noise alone.
    pub chi2_p_value: Option<f64>,
    /// Scatter of the positions beyond their stated noise, g; it is in every uncertainty.
    pub scatter_g: f64,
    /// Vibration error at 1 g rms of white noise along each instrument's IA, a0 = 0, g.
    pub vre_at_1_g_rms_g: VreAnswer,
    /// |a| - g of each position by the coefficients, in the order of the file, g.
    pub residuals_g: Vec<f64>,
    /// What leaving positions out says.
    pub leave_one_out: LeftOutAnswer,
    /// Coefficients as a model, beside what is known of any instrument of the kind.
    #[serde(skip)]
    pub fitted: Fitted,
}

impl PartialEq for Fitted {
    fn eq(&self, other: &Self) -> bool {
        self.fit == other.fit
    }
}

/// One instrument.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InstrumentAnswer {
    /// Each coefficient under its name; null where it is not determined or not borne out.
    pub coefficients: BTreeMap<&'static str, Quantity>,
    /// Covariance in the order of [`NAMES`].
    pub covariance: [[f64; NOMINAL]; NOMINAL],
    /// Names of the coefficients that the positions do not determine.
    pub undetermined: Vec<&'static str>,
}

/// A vibration error of each instrument.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VreAnswer {
    /// With the stated prior of the cross-couplings; every other term 0 +- what is known of any instrument of the kind.
    pub with_prior: BTreeMap<&'static str, Quantity>,
    /// Without the stated prior.
    pub without_prior: BTreeMap<&'static str, Quantity>,
}

/// Root mean squares of |a| - g of positions left out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOutAnswer {
    /// By scale factors, biases and misalignments alone, g.
    pub nine_parameters_rms_g: f64,
    /// With the terms that are claimed, g.
    pub rms_g: f64,
    /// Those terms.
    pub claimed: Vec<&'static str>,
}

/// Identifies the triad of a campaign.
///
/// # Errors
/// Those of [`fit`].
pub fn identify(campaign: &TriadCampaign) -> Result<TriadIdentification, Error> {
    let fitted = fit(campaign)?;
    let found = &fitted.fit;
    let white = BodyMoments::random([1.0; 3], [0.0; 3]);
    let vre = |fit: &Fit| vre_quantities(fit, &white, [0.0; 3]);
    let vre_at_1_g_rms_g = VreAnswer {
        with_prior: vre(&fitted.bounded),
        without_prior: vre(&fitted.unstated),
    };
    let left_out = &fitted.left_out;
    let claimed = GROUPS
        .iter()
        .zip(left_out.claims)
        .filter(|(_, claimed)| *claimed);
    Ok(TriadIdentification {
        format: "vre-identification/1",
        serial: campaign.config.instrument.serial.clone(),
        kind: "triad",
        method: "least-squares",
        instruments: Axis::ALL
            .map(|axis| (axis.name(), instrument(&fitted, axis)))
            .into(),
        covariance: found.covariance.iter().map(|row| row.to_vec()).collect(),
        rank: found.by_positions.rank,
        rank_with_prior: found.with_prior.rank,
        condition: found.by_positions.condition.min(f64::MAX),
        blind_directions: blind_directions(found),
        frame: if found.frame_is_chosen {
            "chosen"
        } else {
            "body"
        },
        cross_coupling_sigma_per_g: campaign.config.instrument.cross_coupling_sigma_per_g,
        chi2: found.chi2,
        dof: found.degrees_of_freedom,
        chi2_p_value: fitted.p_value,
        scatter_g: fitted.scatter_g,
        vre_at_1_g_rms_g,
        residuals_g: residuals_g(campaign, &fitted.bounded.coefficients),
        leave_one_out: LeftOutAnswer {
            nine_parameters_rms_g: left_out.linear_rms_g,
            rms_g: left_out.rms_g,
            claimed: claimed.map(|((name, _), _)| *name).collect(),
        },
        fitted,
    })
}

/// Vibration error of each instrument in a vibration of these moments at a systematic specific force, g.
pub fn vre_quantities(
    fit: &Fit,
    moments: &BodyMoments<f64>,
    a0_g: [f64; 3],
) -> BTreeMap<&'static str, Quantity> {
    let sensitivities = moments.sensitivities(a0_g);
    let value = vre_g(&sensitivities, &fit.coefficients);
    let covariance = vre_covariance_g2(&sensitivities, &fit.covariance);
    let quantity = |axis: Axis| {
        let s = axis.index();
        Quantity::new(value[s], covariance[s][s].max(0.0).sqrt())
    };
    Axis::ALL.map(|axis| (axis.name(), quantity(axis))).into()
}

fn instrument(fitted: &Fitted, axis: Axis) -> InstrumentAnswer {
    let (fit, s) = (&fitted.fit, axis.index());
    let covariance = fit.instrument_covariance(s);
    let values = fit.coefficients[s].to_nominal();
    let quantity = |k: usize| match fitted.states(s, k) {
        true => Quantity::new(values[k], covariance[k][k].max(0.0).sqrt()),
        false => Quantity::UNDETERMINED,
    };
    let undetermined = (0..NOMINAL).filter(|k| !fitted.states(s, *k));
    InstrumentAnswer {
        coefficients: (0..NOMINAL).map(|k| (NAMES[k], quantity(k))).collect(),
        covariance,
        undetermined: undetermined.map(|k| NAMES[k]).collect(),
    }
}

/// Components of a unit vector up to this are rounding.
const ROUNDING: f64 = 1e-9;

fn blind_directions(fit: &Fit) -> Vec<BTreeMap<String, f64>> {
    let name = |k: usize| format!("{}.{}", Axis::ALL[k / NOMINAL].name(), NAMES[k % NOMINAL]);
    let by_name = |direction: &[f64; UNKNOWNS]| {
        let parts = direction
            .iter()
            .enumerate()
            .filter(|(_, c)| c.abs() > ROUNDING);
        parts.map(|(k, c)| (name(k), *c)).collect()
    };
    fit.by_positions
        .blind_directions()
        .iter()
        .map(by_name)
        .collect()
}

fn residuals_g(campaign: &TriadCampaign, triad: &[Coefficients<f64>; 3]) -> Vec<f64> {
    let gravity_g = campaign.config.bench.local_gravity_g;
    let residual = |output_v: [f64; 3]| {
        let body = specific_force_g(triad, output_v)?;
        Some(body.iter().map(|x| x * x).sum::<f64>().sqrt() - gravity_g)
    };
    let outputs = campaign.positions.iter().map(|p| p.output_v);
    outputs
        .map(|output_v| residual(output_v).unwrap_or(f64::NAN))
        .collect()
}
