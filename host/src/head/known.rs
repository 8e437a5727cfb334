//! A campaign beside what is known of the head that it was made on.

use std::sync::Arc;

use nalgebra::DMatrix;
use shared::tumble::within_a_turn;

use super::batch::{Batch, TYPE};
use super::file::HeadFile;
use super::posterior::Prior;
use super::reduced::Reduced;
use crate::campaign::{Campaign, MarkErrors};
use crate::error::Error;
use crate::statics::position;

/// Logarithm of the odds against a head at which it is no longer the same: a thousand to one.
const CHANGED: f64 = -6.9;

/// A campaign, and whether the head was as it is known.
#[derive(Clone, Debug)]
pub struct Known {
    /// The campaign with the known errors of the marks taken off its outputs, and what is left of them as their covariance; as
    /// it is where the head is not the same.
    pub campaign: Campaign,
    /// Logarithm of the odds of the readings on the head as it is known to those on marks of which nothing is known.
    pub log_odds: f64,
}

impl Known {
    /// Whether the head was as it is known.
    pub fn holds(&self) -> bool {
        self.log_odds >= CHANGED
    }
}

/// Takes what is known of the marks into a campaign.
///
/// # Errors
/// The readings do not determine the scale factor.
pub fn known(campaign: &Campaign, head: &HeadFile) -> Result<Known, Error> {
    let reduced = Reduced::of(campaign)?;
    let prior = head.prior();
    let mut batch = Batch::new(head.spread());
    batch.add(&reduced)?;
    let evidence = |prior: &Prior| Ok::<_, Error>(batch.posterior(prior)?.log_evidence);
    let log_odds = evidence(&prior)? - evidence(&prior.without_marks())?;
    let mut known = Known {
        campaign: campaign.clone(),
        log_odds,
    };
    if !known.holds() {
        return Ok(known);
    }
    let visited = reduced.marks_deg.iter();
    let place = |mark: &f64| prior.marks_deg.iter().position(|known| known == mark);
    let places: Vec<usize> = visited.filter_map(place).map(|mark| TYPE + mark).collect();
    let covariance = DMatrix::from_fn(places.len(), places.len(), |i, j| {
        prior.covariance[(places[i], places[j])]
    });
    let gravity_g = campaign.config.bench.local_gravity_g;
    for reading in &mut known.campaign.readings {
        let Some(mark) = place(&within_a_turn(reading.dial_deg)) else {
            continue;
        };
        let place = position(reading);
        let by_angle_g = gravity_g * place.series.tangent(place.phi_rad()).i;
        reading.output_v -= reduced.scale_v_per_g * by_angle_g * prior.mean[TYPE + mark];
    }
    known.campaign.config.mark_errors = Some(Arc::new(MarkErrors {
        marks_deg: places
            .iter()
            .map(|place| prior.marks_deg[place - TYPE])
            .collect(),
        // Symmetric: rows are columns.
        covariance_rad2: covariance.as_slice().to_vec(),
    }));
    Ok(known)
}
