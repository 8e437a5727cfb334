//! `vre report`

use std::path::PathBuf;

use super::{Command, Console, read_campaign};
use crate::error::Error;
use crate::report;

/// Write a self-contained page with pictures on a campaign: coefficients, predicted and measured vibration error
#[derive(clap::Args)]
#[command(after_help = "Example:\n  vre report campaigns/S01000 --out report")]
pub struct Report {
    /// Folder of the campaign
    campaign: PathBuf,
    /// Folder for report.html, identification.json and prediction.json, made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Command for Report {
    fn run(self, console: &Console) -> Result<(), Error> {
        let campaign = read_campaign(&self.campaign, &[], console)?;
        let report = report::write(&campaign, &self.out)?;
        console.print(format!(
            "{}\n{}",
            report::text::summary(&report),
            self.out.join("report.html").display()
        ))?;
        console.json(&report.prediction)
    }
}
