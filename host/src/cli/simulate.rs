//! `vre simulate`

use std::path::PathBuf;

use clap::builder::PossibleValuesParser;

use super::{Command, Console, positive};
use crate::bench::effects;
use crate::bench::noise::Seed;
use crate::bench::plan::Static;
use crate::bench::simulate::{Specification, VirtualBench};
use crate::campaign::write_runs;
use crate::error::Error;

/// Write a campaign from the virtual bench, with runs to predict and the truth behind it
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    vre simulate --out campaigns/V00007 --seed 7\n  \
    vre simulate --out campaigns/shaky --effect fixture-resonance --strength 3")]
pub struct Simulate {
    /// Folder for campaign.toml, static.csv, vibration.csv, holdout.csv and truth.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Fixes everything that is random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The static test
    #[arg(long, value_enum, default_value = "default")]
    plan: Static,
    /// Standard uncertainty of a dial mark and of the base's level, arcsec
    #[arg(long, value_name = "ARCSEC", default_value_t = 1.0, value_parser = positive)]
    dial_sigma: f64,
    /// Something that the nominal model does not know; repeatable
    #[arg(long, value_name = "ID", value_parser = PossibleValuesParser::new(effects::catalogue().map(|entry| entry.id)))]
    effect: Vec<String>,
    /// Size of the effects in terms of a typical one
    #[arg(long, default_value_t = 1.0, value_parser = positive)]
    strength: f64,
}

impl Command for Simulate {
    fn run(self, console: &Console) -> Result<(), Error> {
        let seed = Seed(self.seed);
        let draw = |(index, id): (usize, &String)| {
            let mut stream = seed.stream("effect", index as u64);
            effects::find(id).map(|entry| (entry.draw)(self.strength, &mut stream))
        };
        let drawn = self.effect.iter().enumerate().filter_map(draw).collect();
        let specification = Specification::with_dial_sigma(self.dial_sigma);
        let simulation = VirtualBench::new(seed, self.plan, specification, drawn).simulate();
        simulation.campaign.write(&self.out)?;
        write_runs(&self.out.join("holdout.csv"), &simulation.holdout)?;
        super::console::write_json(&self.out.join("truth.json"), &simulation.truth)?;
        console.print(format!(
            "{}: {} readings, {} shaker runs, {} runs to predict in holdout.csv, the truth in truth.json",
            self.out.display(),
            simulation.campaign.readings.len(),
            simulation.campaign.runs.len(),
            simulation.holdout.len(),
        ))?;
        console.json(&simulation.truth)
    }
}
