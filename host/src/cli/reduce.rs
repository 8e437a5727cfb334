//! `vre reduce`

use std::path::PathBuf;

use super::{Command, Console};
use crate::capture::tables_of;
use crate::error::Error;

/// Make the tables of a campaign out of its record, as after a capture that was stopped
#[derive(clap::Args)]
#[command(after_help = "Example:
  vre reduce campaigns/S01000")]
pub struct Reduce {
    /// Folder with record.vre; campaign.toml is taken as it stands there, or out of the record
    folder: PathBuf,
    /// Write over tables that say something else
    #[arg(long)]
    force: bool,
}

impl Command for Reduce {
    fn run(self, console: &Console) -> Result<(), Error> {
        let (campaign, ledger) = tables_of(&self.folder, self.force)?;
        let under_way = match ledger.begun() {
            0 => String::new(),
            1 => "; one more was under way and is not whole".into(),
            count => format!("; {count} more were begun and are not whole"),
        };
        console.print(format!(
            "{}: {} readings, {} shaker runs{under_way}",
            self.folder.display(),
            campaign.readings.len(),
            campaign.runs.len(),
        ))?;
        for remark in ledger.remarks() {
            console.print(format!("remark: {remark}"))?;
        }
        Ok(())
    }
}
