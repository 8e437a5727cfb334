//! `vre unseal`

use std::path::PathBuf;

use super::{Command, Console};
use crate::error::Error;
use crate::seal::{Opened, unseal};

/// Open the label of a sealed campaign, after its diagnosis is on disk
#[derive(clap::Args)]
#[command(after_help = "Example:\n  \
    vre simulate --out blind --effect sealed\n  \
    vre diagnose blind --json blind/diagnosis.json\n  \
    vre unseal blind --diagnosis blind/diagnosis.json")]
pub struct Unseal {
    /// Folder of the campaign
    campaign: PathBuf,
    /// The diagnosis, made before
    #[arg(long, value_name = "FILE.json")]
    diagnosis: PathBuf,
}

impl Command for Unseal {
    fn run(self, console: &Console) -> Result<(), Error> {
        let opened = unseal(&self.campaign, &self.diagnosis)?;
        console.answer(text(&opened), &opened)
    }
}

fn text(opened: &Opened) -> String {
    let effects = opened.truth["effects"]
        .as_array()
        .map_or(&[][..], Vec::as_slice);
    let mut text = if effects.is_empty() {
        String::from("The campaign has no effect beyond the nominal model.\n")
    } else {
        String::from("The campaign has these effects beyond the nominal model:\n")
    };
    for effect in effects {
        let id = effect["id"].as_str().unwrap_or("?");
        text += &format!("  {id} {}\n", effect["parameters"]);
    }
    text + &format!(
        "Diagnosis on disk before: SHA-256 {}\n",
        opened.diagnosis_sha256
    )
}
