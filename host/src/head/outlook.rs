//! What a batch will be able to tell, before a single instrument of it is measured.

use serde::Serialize;
use shared::identify::static_test::Bench;
use shared::model::NOMINAL;
use shared::rectification::Sensitivity;
use shared::tumble::Position;

use super::batch::{Batch, TYPE};
use super::harmonics::{advice, harmonics};
use super::posterior::Prior;
use super::reduced::Reduced;
use crate::error::Error;
use crate::statics::{Environment, NAMES};

/// How the instruments of a batch are mounted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mounting {
    /// All as the plan says.
    Alike,
    /// Every other one turned by 180 deg on the shaft.
    Alternating,
    /// Each once as the plan says and once turned by 180 deg: twice the readings.
    Remounted,
}

/// Standard uncertainties of one instrument of a batch, the others known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outlook {
    /// How they are mounted.
    pub mounting: Mounting,
    /// Readings an instrument.
    pub readings: usize,
    /// Of each coefficient, by its name in the order of the model.
    #[serde(serialize_with = "by_name")]
    pub coefficient_sigma: [f64; NOMINAL],
    /// Of the predicted vibration error in each environment, g.
    pub vre_sigma_g: Vec<f64>,
    /// Whether the first harmonic of the head stays blind.
    pub blind_first_harmonic: bool,
}

fn by_name<S: serde::Serializer>(sigma: &[f64; NOMINAL], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(NAMES.iter().zip(sigma))
}

/// A batch before it is measured.
#[derive(Clone, Debug)]
pub struct PlannedBatch {
    /// Number of instruments, at least 1.
    pub instruments: u64,
    /// Spread of the type.
    pub spread: [f64; TYPE],
    /// What is known of its mean, and of marks.
    pub prior: Prior,
}

/// The outlook of a batch on one head, mounted in each way.
///
/// # Errors
/// The plan has too many marks, or does not determine the scale factor.
pub fn outlook(
    plan: &[Position],
    bench: &Bench<f64>,
    noise_g: f64,
    planned: &PlannedBatch,
    environments: &[Environment],
) -> Result<Vec<Outlook>, Error> {
    let instruments = planned.instruments;
    let turned: Vec<Position> = plan
        .iter()
        .map(|place| Position {
            mount_deg: place.mount_deg + 180.0,
            ..*place
        })
        .collect();
    let both: Vec<Position> = plan.iter().chain(&turned).copied().collect();
    let half = instruments / 2;
    let ways = [
        (Mounting::Alike, vec![(plan, instruments)]),
        (
            Mounting::Alternating,
            vec![(plan, instruments - half), (&turned, half)],
        ),
        (Mounting::Remounted, vec![(&both, instruments)]),
    ];
    let judge = |(mounting, groups): (Mounting, Vec<(&[Position], u64)>)| {
        let mut batch = Batch::new(planned.spread);
        let first = Reduced::of_plan(groups[0].0, bench, noise_g)?;
        for (plan, count) in &groups {
            batch.add_many(&Reduced::of_plan(plan, bench, noise_g)?, *count)?;
        }
        let posterior = batch.posterior(&planned.prior)?;
        let instrument = posterior
            .instrument(&first)
            .ok_or_else(|| Error::Usage("the plan does not determine the scale factor".into()))?;
        let covariance: [[f64; NOMINAL]; NOMINAL] =
            std::array::from_fn(|i| std::array::from_fn(|j| instrument.covariance[(i, j)]));
        let vre_sigma_g = |environment: &Environment| {
            let sensitivity = Sensitivity::new(environment.a0_i_g, environment.moments);
            sensitivity.variance_g2(&covariance).max(0.0).sqrt()
        };
        Ok(Outlook {
            mounting,
            readings: groups[0].0.len(),
            coefficient_sigma: std::array::from_fn(|k| covariance[k][k].max(0.0).sqrt()),
            vre_sigma_g: environments.iter().map(vre_sigma_g).collect(),
            blind_first_harmonic: advice(&harmonics(&posterior)).is_some(),
        })
    };
    ways.into_iter().map(judge).collect()
}
