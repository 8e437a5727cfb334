//! `vre blind-check`

use super::{Command, Console};
use crate::bench::imperfections::{self, Imperfection};
use crate::error::Error;
use crate::study::{ImperfectStudy, blind_check};

/// Diagnose many simulated campaigns whose effect is withheld, and print how often it is found
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  vre blind-check --campaigns 250 --seed 1 --json scoreboard.json\n  vre blind-check --runs 12\n  vre blind-check --imperfect --count 4 --json imperfect.json\n  vre blind-check --imperfect --count 20 --imperfection session-bias:10"
)]
pub struct BlindCheck {
    /// How many campaigns; a whole round of effects and strengths is some 130
    #[arg(long, default_value_t = 260, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    campaigns: u64,
    /// Shaker runs of each campaign, the first of the plan's 96 in their random order
    #[arg(long, default_value_t = 96, value_name = "N", value_parser = clap::value_parser!(u64).range(3..=96))]
    runs: u64,
    /// Fixes everything that is random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Take an effect out of the catalogue and out of the study (repeatable)
    #[arg(long, value_name = "ID")]
    without: Vec<String>,
    /// Laboratories as they are: the imperfections of `vre simulate`, each with no effect, with one of visibility 300 and with one
    /// of 30; shares with 95 % intervals
    #[arg(long, conflicts_with_all = ["campaigns", "runs"])]
    imperfect: bool,
    /// Campaigns of each imperfection with no effect, and with one of either visibility
    #[arg(long, default_value_t = 1, requires = "imperfect", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    count: u64,
    /// This imperfection alone (repeatable) [default: all, of their usual sizes]
    #[arg(long, value_name = "ID[:SIZE]", requires = "imperfect")]
    imperfection: Vec<Imperfection>,
}

impl Command for BlindCheck {
    fn run(self, console: &Console) -> Result<(), Error> {
        if self.imperfect {
            return self.imperfect(console);
        }
        let bar = console.progress(self.campaigns, "diagnosing");
        let board = blind_check(
            self.campaigns,
            self.runs as usize,
            self.seed,
            &self.without,
            || bar.inc(1),
        )?;
        bar.finish_and_clear();
        console.answer(board.text(), &board)
    }
}

impl BlindCheck {
    fn imperfect(self, console: &Console) -> Result<(), Error> {
        let imperfections = match self.imperfection.is_empty() {
            true => imperfections::catalogue().map(Into::into).collect(),
            false => self.imperfection,
        };
        let study = ImperfectStudy {
            imperfections,
            rounds: self.count,
            seed: self.seed,
            without: self.without,
        };
        let bar = console.progress(study.campaigns(), "diagnosing");
        let board = study.run(|| bar.inc(1))?;
        bar.finish_and_clear();
        console.answer(board.text(), &board)
    }
}
