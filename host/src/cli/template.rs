//! `vre template`

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::ValueEnum;

use super::{Command, Console, refuse_campaign};
use crate::bench::plan::{Static, dwells};
use crate::campaign::read_plan;
use crate::error::Error;
use crate::template::{self, Row};

/// Write a campaign to fill in: a commented campaign.toml, and tables with the positions of a plan
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  vre template S01000\n  vre template S01000 --plan remounted --xlsx\n  vre template S01000 --plan my-angles.csv"
)]
pub struct Template {
    /// Folder of the campaign
    folder: PathBuf,
    /// Positions of static.csv: `default`, `paper` or `remounted`, as `vre simulate --plan` has them, or a table with the columns
    /// series, dial_deg and mount_deg (optional)
    #[arg(long, value_name = "PLAN|FILE", default_value = "default")]
    plan: PlanName,
    /// Workbooks, each with a second sheet that explains its columns, in the place of CSV
    #[arg(long)]
    xlsx: bool,
}

#[derive(Clone, Debug)]
enum PlanName {
    Known(Static),
    File(PathBuf),
}

impl FromStr for PlanName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match Static::from_str(text, true) {
            Ok(known) => Ok(Self::Known(known)),
            Err(_) if Path::new(text).is_file() => Ok(Self::File(text.into())),
            Err(_) => Err("is none of default, paper, remounted, and no file".into()),
        }
    }
}

impl Command for Template {
    fn run(self, console: &Console) -> Result<(), Error> {
        refuse_campaign(&self.folder, "")?;
        let rows: Vec<Row> = match &self.plan {
            PlanName::Known(plan) => dwells(*plan).into_iter().map(Row::from).collect(),
            PlanName::File(file) => read_plan(file)?.into_iter().map(Row::from).collect(),
        };
        let files = template::write(&self.folder, &rows, self.xlsx)?;
        console.print(format!(
            "{}: {} to fill in, {} positions. Take the # off the keys of campaign.toml that you know; `vre help columns` explains \
             the tables; then `vre identify {0}`.",
            self.folder.display(),
            files.join(", "),
            rows.len(),
        ))
    }
}
