//! `vre diagnose`

use std::path::PathBuf;

use super::{Command, Console, RowName, head, read_campaign, triad};
use crate::campaign::is_triad;
use crate::contradictions::{self, Contradiction};
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
    /// Leave a row out, by its line in a table, as static.csv:12 or vibration.csv:30 (repeatable)
    #[arg(long, value_name = "TABLE:ROW")]
    exclude: Vec<RowName>,
    /// Go on although columns contradict each other in all rows of a kind, as level_g and ref_*_rms_g by a unit
    #[arg(long)]
    accept_contradictions: bool,
    /// Know the errors of the dividing head's marks as other campaigns told them (`vre identify --teach`)
    #[arg(long, value_name = "HEAD.toml")]
    head: Option<PathBuf>,
}

impl Command for Diagnose {
    fn run(self, console: &Console) -> Result<(), Error> {
        if is_triad(&self.campaign) {
            if self.head.is_some() {
                return Err(Error::Usage("a triad takes no --head".into()));
            }
            if !self.without.is_empty() || !self.exclude.is_empty() || self.html.is_some() {
                return Err(Error::Usage("a triad is diagnosed without --without, --exclude and --html; `vre report` writes its page".into()));
            }
            return triad::diagnose(&self.campaign, console);
        }
        let campaign = read_campaign(&self.campaign, &self.exclude, console)?;
        let accepted = self.accept_contradictions;
        let found = contradictions::check(&self.campaign, &campaign, accepted)?;
        for contradiction in &found {
            console.print(format!("vibration.csv, {contradiction}"))?;
        }
        let campaign = head::beside(campaign, self.head.as_deref(), console)?;
        let study = diagnose(&campaign, &self.without)?;
        if let Some(file) = &self.html {
            write_file(file, diagnosis_page(&study)?.as_bytes())?;
        }
        let told = |one: &&Contradiction| !found.contains(one);
        for contradiction in study.diagnosis.contradictions.iter().filter(told) {
            console.print(contradiction)?;
        }
        console.print(diagnosis_text(&study.diagnosis))?;
        console.json(&study.diagnosis)
    }
}
