//! `vre capture`

use std::path::PathBuf;

use super::{Command, Console, positive};
use crate::bench::noise::Seed;
use crate::bench::plan::Static;
use crate::bench::simulate::{Specification, VirtualBench};
use crate::capture::{self, Captured};
use crate::error::Error;

/// Measure a campaign on the virtual bench through the instrument's firmware, with its record
#[derive(clap::Args)]
#[command(after_help = "Example:\n  vre capture --emulated --runs 0 --out campaigns/emulated")]
pub struct Capture {
    /// Folder for campaign.toml, static.csv, vibration.csv and record.vre
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Run the image for the board in the emulator, instead of the firmware's library on the host
    #[arg(long)]
    emulated: bool,
    /// Fixes everything that is random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The static test
    #[arg(long, value_enum, default_value = "remounted")]
    plan: Static,
    /// Standard uncertainty of a dial mark and of the base's level, arcsec
    #[arg(long, value_name = "ARCSEC", default_value_t = 5.8, value_parser = positive)]
    dial_sigma: f64,
    /// Shaker runs at the most
    #[arg(long, default_value_t = 4)]
    runs: usize,
}

impl Command for Capture {
    fn run(self, console: &Console) -> Result<(), Error> {
        let specification = Specification::with_dial_sigma(self.dial_sigma);
        let mut bench = VirtualBench::new(Seed(self.seed), self.plan, specification, Vec::new());
        bench.plan.runs.truncate(self.runs);
        let bar = console.progress(capture::steps(&bench), "measuring");
        let captured = if self.emulated {
            emulated(&bench, &self.out, || bar.inc(1))?
        } else {
            capture::capture_virtual(&bench, &self.out, || bar.inc(1))?
        };
        bar.finish_and_clear();
        let (tally, campaign) = (&captured.tally, &captured.campaign);
        console.print(format!(
            "{}: {} readings, {} shaker runs; {} samples in blocks, {} missing",
            self.out.display(),
            campaign.readings.len(),
            campaign.runs.len(),
            tally.blocks.received,
            tally.blocks.missing,
        ))?;
        console.json(tally)
    }
}

#[cfg(feature = "emulated")]
fn emulated(
    bench: &VirtualBench,
    out: &std::path::Path,
    step: impl FnMut(),
) -> Result<Captured, Error> {
    let board = crate::bench::emulated::EmulatedBoard::start().map_err(Error::Usage)?;
    capture::capture(bench, &mut { board }, out, step)
}

#[cfg(not(feature = "emulated"))]
fn emulated(
    _: &VirtualBench,
    _: &std::path::Path,
    _: impl FnMut(),
) -> Result<Captured, Error> {
    let line = "--emulated: this vre was built without the emulator; build it with --features emulated";
    Err(Error::Usage(line.into()))
}
