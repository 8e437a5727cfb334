//! `vre blind-check`

use super::{Command, Console};
use crate::error::Error;
use crate::study::blind_check;

/// Diagnose many simulated campaigns whose effect is withheld, and print how often it is found
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  vre blind-check --campaigns 250 --seed 1 --json scoreboard.json"
)]
pub struct BlindCheck {
    /// How many campaigns; a whole round of effects and strengths is some 130
    #[arg(long, default_value_t = 260)]
    campaigns: u64,
    /// Fixes everything that is random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Take an effect out of the catalogue and out of the study (repeatable)
    #[arg(long, value_name = "ID")]
    without: Vec<String>,
}

impl Command for BlindCheck {
    fn run(self, console: &Console) -> Result<(), Error> {
        let bar = console.progress(self.campaigns, "diagnosing");
        let board = blind_check(self.campaigns, self.seed, &self.without, || bar.inc(1))?;
        bar.finish_and_clear();
        console.print(board.text())?;
        console.json(&board)
    }
}
