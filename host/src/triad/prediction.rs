//! Vibration error of each instrument of a triad in the runs of a table, `vre-prediction/1`.

use std::collections::BTreeMap;

use serde::Serialize;
use shared::triad::body::Axis;
use shared::triad::identification::Fit;
use shared::triad::vibration::{BodyMoments, vre_covariance_g2};

use super::answer::vre_quantities;
use super::fit::fit;
use crate::campaign::{TriadCampaign, TriadRun, VibrationKind};
use crate::error::Error;
use crate::quantity::Quantity;

/// Predictions for the runs of a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TriadPrediction {
    /// Always `vre-prediction/1`.
    pub format: &'static str,
    /// Serial number of the triad.
    pub serial: String,
    /// Always `triad`.
    pub kind: &'static str,
    /// Standard deviation of the cross-couplings about zero that campaign.toml states, 1/g; null if none. Every other term that
    /// rectifies is 0 +- 5e-4 in its unit beforehand.
    pub cross_coupling_sigma_per_g: Option<f64>,
    /// One entry a run, in the order of the table.
    pub runs: Vec<PredictedTriadRun>,
}

/// One run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PredictedTriadRun {
    /// Run number.
    pub run: u64,
    /// Each instrument.
    pub instruments: BTreeMap<&'static str, PredictedInstrument>,
    /// Covariance of the three predictions with the stated prior, g^2.
    pub covariance_g2: [[f64; 3]; 3],
}

/// The vibration error of one instrument in one run, g.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PredictedInstrument {
    /// With the stated prior of the cross-couplings.
    pub vre_g: Quantity,
    /// Without it.
    pub without_prior_vre_g: Quantity,
    /// Measured: during less before, over K1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_vre_g: Option<Quantity>,
}

/// Predicts the vibration error of `runs` from the positions of the campaign.
///
/// # Errors
/// Those of [`fit`].
pub fn predict(campaign: &TriadCampaign, runs: &[TriadRun]) -> Result<TriadPrediction, Error> {
    let fitted = fit(campaign)?;
    let run = |run: &TriadRun| predicted(run, &fitted.bounded, &fitted.unstated);
    Ok(TriadPrediction {
        format: "vre-prediction/1",
        serial: campaign.config.instrument.serial.clone(),
        kind: "triad",
        cross_coupling_sigma_per_g: campaign.config.instrument.cross_coupling_sigma_per_g,
        runs: runs.iter().map(run).collect(),
    })
}

fn predicted(run: &TriadRun, with_prior: &Fit, without: &Fit) -> PredictedTriadRun {
    let moments = moments(run);
    let stated = vre_quantities(with_prior, &moments, run.a0_g);
    let unstated = vre_quantities(without, &moments, run.a0_g);
    let instrument = |axis: Axis| {
        let k1 = with_prior.coefficients[axis.index()].scale_factor_v_per_g;
        let measured = run.measured.map(|m| {
            let s = axis.index();
            Quantity::new(
                (m.during_v[s] - m.before_v[s]) / k1,
                std::f64::consts::SQRT_2 * m.sigma_v[s] / k1.abs(),
            )
        });
        PredictedInstrument {
            vre_g: stated[axis.name()],
            without_prior_vre_g: unstated[axis.name()],
            measured_vre_g: measured,
        }
    };
    let sensitivities = moments.sensitivities(run.a0_g);
    PredictedTriadRun {
        run: run.run,
        instruments: Axis::ALL.map(|axis| (axis.name(), instrument(axis))).into(),
        covariance_g2: vre_covariance_g2(&sensitivities, &with_prior.covariance),
    }
}

/// Moments of a run's vibration on the body axes, as commanded.
pub fn moments(run: &TriadRun) -> BodyMoments<f64> {
    let along = run.direction.map(|cosine| cosine * run.level_g);
    match run.kind {
        VibrationKind::Sine => BodyMoments::harmonic(along),
        VibrationKind::Random => {
            let sign = |j: usize, k: usize| match along[j] * along[k] {
                0.0 => 0.0,
                product => product.signum(),
            };
            let rms_g = along.map(f64::abs);
            BodyMoments::random(rms_g, [sign(0, 1), sign(1, 2), sign(2, 0)])
        }
    }
}
