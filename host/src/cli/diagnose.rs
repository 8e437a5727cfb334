//! `vre diagnose`

use std::path::PathBuf;

use super::{Command, Console, read_campaign};
use crate::diagnose::diagnose;
use crate::error::Error;
use crate::output::write_file;
use crate::report::{diagnosis_page, diagnosis_text};

/// Find where the gap between prediction and shaker lies, which effect causes it and how far it shrinks
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  vre diagnose campaigns/S01000 --json diagnosis.json\n  vre predict campaigns/S01000 --runs new-runs.csv --diagnosis diagnosis.json"
)]
pub struct Diagnose {
    /// Folder of the campaign
    campaign: PathBuf,
    /// Take an effect out of the catalogue (repeatable)
    #[arg(long, value_name = "ID")]
    without: Vec<String>,
    /// Write a page with pictures
    #[arg(long, value_name = "FILE.html")]
    html: Option<PathBuf>,
}

impl Command for Diagnose {
    fn run(self, console: &Console) -> Result<(), Error> {
        let campaign = read_campaign(&self.campaign, console)?;
        let study = diagnose(&campaign, &self.without)?;
        if let Some(file) = &self.html {
            write_file(file, diagnosis_page(&study)?.as_bytes())?;
        }
        console.print(diagnosis_text(&study.diagnosis))?;
        console.json(&study.diagnosis)
    }
}
