//! Options that know a dividing head by its `head.toml`.

use std::path::Path;

use super::Console;
use crate::campaign::Campaign;
use crate::diagnose::static_test;
use crate::error::Error;
use crate::head::teaching::{summary, taught, with_runs_that_fit};
use crate::head::{HeadFile, Reduced, known};

/// The campaign beside what is known of its head, if a file of one is named. A head that is no longer the same is told, and
/// not used.
pub(super) fn beside(
    campaign: Campaign,
    head: Option<&Path>,
    console: &Console,
) -> Result<Campaign, Error> {
    let Some(file) = head else {
        return Ok(campaign);
    };
    let head = HeadFile::read(file)?;
    let known = known(&campaign, &head)?;
    if !known.holds() {
        console.warn(format!(
            "the readings contradict {} (logarithm of the odds {:.1}): the head was re-zeroed, or a mark moved; it is not used",
            file.display(),
            known.log_odds
        ))?;
    }
    Ok(known.campaign)
}

/// Lets a campaign teach the head in `file`, which is made if it is not there.
pub(super) fn teach(campaign: &Campaign, file: &Path, console: &Console) -> Result<(), Error> {
    let before = file.exists().then(|| HeadFile::read(file)).transpose()?;
    if let Some(head) = &before
        && !known(campaign, head)?.holds()
    {
        return Err(Error::Usage(format!(
            "the readings contradict {}: the head was re-zeroed, or a mark moved; begin a new file",
            file.display()
        )));
    }
    let belonging = static_test(campaign).belonging;
    let (told, runs_used) = with_runs_that_fit(&belonging, Reduced::of(&belonging)?)?;
    if !runs_used && !campaign.runs.is_empty() {
        console.warn("the shaker runs do not fit the nominal model and teach the head nothing")?;
    }
    let record = campaign.config.record.as_ref();
    let station = record
        .and_then(|record| record.station.as_deref())
        .unwrap_or("head");
    let (head, posterior) = taught(before.as_ref(), station, campaign, &told)?;
    head.write(file)?;
    console.print(format!(
        "{}: {}\n",
        file.display(),
        summary(&head, &posterior)
    ))
}
