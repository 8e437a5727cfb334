//! `vre report`

use std::path::PathBuf;

use super::{Command, Console, read_campaign, triad};
use crate::campaign::is_triad;
use crate::diagnose::diagnose;
use crate::error::Error;
use crate::report::{self, Supplement};

/// Write a self-contained page with pictures on a campaign: coefficients, predicted and measured vibration error
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  vre report campaigns/S01000 --out report\n  vre report campaigns/S01000 --out report --diagnose"
)]
pub struct Report {
    /// Folder of the campaign
    campaign: PathBuf,
    /// Folder for report.html, identification.json and prediction.json, made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Diagnose too, and show where the gap lies and what causes it on the same page
    #[arg(long)]
    diagnose: bool,
}

impl Command for Report {
    fn run(self, console: &Console) -> Result<(), Error> {
        if is_triad(&self.campaign) {
            if self.diagnose {
                return Err(Error::Usage(
                    "a triad is diagnosed by `vre diagnose`".into(),
                ));
            }
            return triad::report(&self.campaign, &self.out, console);
        }
        let campaign = read_campaign(&self.campaign, &[], console)?;
        let study = match self.diagnose {
            true => Some(diagnose(&campaign, &[])?),
            false => None,
        };
        let supplement = Supplement {
            folder: Some(&self.campaign),
            study: study.as_ref(),
        };
        let report = report::write(&campaign, supplement, &self.out)?;
        console.answer(
            format!(
                "{}\n{}",
                report::text::summary(&report),
                self.out.join("report.html").display()
            ),
            &report.prediction,
        )
    }
}
