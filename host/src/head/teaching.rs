//! What one campaign teaches a head.

use sha2::{Digest, Sha256};
use shared::tumble::ARCSEC_RAD;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::batch::{Batch, DEFAULT_SPREAD};
use super::file::HeadFile;
use super::harmonics::{advice, harmonics};
use super::posterior::{Posterior, Prior};
use super::reduced::Reduced;
use crate::campaign::Campaign;
use crate::error::Error;

/// Probability of a chi-square at least as large below which shaker runs do not fit the nominal model.
const UNFIT: f64 = 1e-3;

/// What readings and, where the nominal model fits them, shaker runs of a campaign tell; and whether runs are in it.
///
/// # Errors
/// The campaign does not determine the scale factor.
pub fn with_runs_that_fit(
    campaign: &Campaign,
    readings: Reduced,
) -> Result<(Reduced, bool), Error> {
    let Ok(together) = readings.clone().with_runs(campaign) else {
        return Ok((readings, false));
    };
    let squares = |reduced: &Reduced| {
        let mut batch = Batch::new(DEFAULT_SPREAD);
        batch.add(reduced)?;
        Ok::<_, Error>(batch.posterior(&Prior::default())?.squares)
    };
    let added = squares(&together)? - squares(&readings)?;
    let distribution = ChiSquared::new((together.rows - readings.rows) as f64);
    let fits = distribution.is_ok_and(|distribution| distribution.sf(added) > UNFIT);
    Ok(if fits {
        (together, true)
    } else {
        (readings, false)
    })
}

/// What one more campaign makes of a head: of `before`, or of one of that name of which nothing is known. `reduced` is what
/// the campaign tells.
///
/// # Errors
/// The campaign taught the head before, or does not fit into a batch.
pub fn taught(
    before: Option<&HeadFile>,
    id: &str,
    campaign: &Campaign,
    reduced: &Reduced,
) -> Result<(HeadFile, Posterior), Error> {
    let key = key(campaign);
    let mut campaigns = before.map_or(Vec::new(), |head| head.campaigns.clone());
    if campaigns.contains(&key) {
        return Err(Error::Usage(format!(
            "{} taught this head already; twice it would pass for two instruments",
            campaign.config.instrument.serial
        )));
    }
    let mut batch = Batch::new(before.map_or(DEFAULT_SPREAD, HeadFile::spread));
    batch.add(reduced)?;
    let prior = before.map_or_else(Prior::default, HeadFile::prior);
    // Marks that this campaign did not visit stay known.
    batch.visit(&prior.marks_deg)?;
    let posterior = batch.posterior(&prior)?;
    campaigns.push(key);
    let head = HeadFile::new(before.map_or(id, |head| &head.id), &posterior, campaigns);
    Ok((head, posterior))
}

/// By what a campaign is known again: its serial number, and its readings.
pub fn key(campaign: &Campaign) -> String {
    let mut hash = Sha256::new();
    for reading in &campaign.readings {
        for number in [reading.dial_deg, reading.mount_deg, reading.output_v] {
            hash.update(number.to_le_bytes());
        }
    }
    let digits: String = hash.finalize()[..8]
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    format!("{} {digits}", campaign.config.instrument.serial)
}

/// What is known of a head, in a line or two.
pub fn summary(head: &HeadFile, posterior: &Posterior) -> String {
    let marks = posterior.marks_deg.len();
    let mut sigma: Vec<f64> = (0..marks)
        .map(|mark| posterior.mark_sigma_rad(mark) / ARCSEC_RAD)
        .collect();
    sigma.sort_by(f64::total_cmp);
    let campaigns = head.campaigns.len();
    let told = if campaigns == 1 {
        "campaign"
    } else {
        "campaigns"
    };
    let mut text = format!(
        "head {}, {campaigns} {told}, {marks} marks, each known to {:.2} arcsec or better",
        head.id,
        sigma.last().copied().unwrap_or(0.0)
    );
    if let Some(advice) = advice(&harmonics(posterior)) {
        text += &format!("\nBLIND: {advice}");
    }
    text
}
