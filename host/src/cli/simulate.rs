//! `vre simulate`

use std::path::PathBuf;

use clap::builder::PossibleValuesParser;

use super::triad::{self, Made};
use super::{Command, Console, refuse_campaign, within};
use crate::bench::effects;
use crate::bench::imperfections::{self, Imperfection};
use crate::bench::noise::Seed;
use crate::bench::plan::Static;
use crate::bench::simulate::{Specification, VirtualBench};
use crate::campaign::{ranges, write_runs};
use crate::error::Error;
use crate::seal;
use crate::study::visibility::strength_for;

const TRUTH: &str = "truth.json";
const NONE: &str = "none";
const SEALED: &str = "sealed";

const EXAMPLES: &str = "Examples:
  vre simulate --out campaigns/V00007 --seed 7
  vre simulate --out campaigns/shaky --effect fixture-resonance --strength 3
  vre simulate --out campaigns/faint --effect sextic --visibility 30
  vre simulate --out campaigns/hasty --imperfection session-bias:40 --imperfection gross-run
  vre simulate --out campaigns/T00007 --triad --seed 7";

/// The examples and every imperfection.
fn long_help() -> String {
    let listed = imperfections::listed();
    format!("{EXAMPLES}\n\nImperfections, with their usual SIZE:\n{listed}")
}

/// Write a campaign from the virtual bench, with runs to predict and the truth behind it
#[derive(clap::Args)]
#[command(after_help = EXAMPLES, after_long_help = long_help())]
pub struct Simulate {
    /// Folder for campaign.toml, static.csv, vibration.csv, holdout.csv and truth.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write into a folder that holds a campaign already, over it
    #[arg(long)]
    force: bool,
    /// Fixes everything that is random [default: 1; a sealed campaign's comes from the operating system]
    #[arg(long)]
    seed: Option<u64>,
    /// The static test
    #[arg(long, value_enum, default_value = "default")]
    plan: Static,
    /// Standard uncertainty of a dial mark and of the base's level, arcsec
    #[arg(long, value_name = "ARCSEC", default_value_t = 1.0, value_parser = within(&ranges::ARCSEC_SIGMA))]
    dial_sigma: f64,
    /// Something that the nominal model does not know, repeatable; `none`; or `sealed`: one or none of them, drawn
    /// by the operating system's entropy, its label encrypted until `vre unseal`
    #[arg(long, value_name = "ID", value_parser = PossibleValuesParser::new(
        [NONE, SEALED].into_iter().chain(effects::catalogue().map(|entry| entry.id))))]
    effect: Vec<String>,
    /// Size of the effects in terms of a typical one [default: 1; a sealed effect's is drawn]
    #[arg(long, value_parser = within(&ranges::STRENGTH))]
    strength: Option<f64>,
    /// Size of the effects by how well each alone can be seen in this campaign: the length of the difference that it makes,
    /// in units of everything else that is uncertain (below 3 nobody can see it)
    #[arg(long, value_name = "V", value_parser = within(&ranges::VISIBILITY), conflicts_with = "strength")]
    visibility: Option<f64>,
    #[command(flatten)]
    made: Made,
    /// Something that persons or devices of a laboratory do and a campaign does not state, repeatable; `--help` lists them
    #[arg(long, value_name = "ID[:SIZE]")]
    imperfection: Vec<Imperfection>,
}

impl Command for Simulate {
    fn run(self, console: &Console) -> Result<(), Error> {
        self.refuse_contrary()?;
        if !self.force {
            refuse_campaign(&self.out, ", or say --force")?;
        }
        if self.made.triad {
            let session = self.made.session(self.seed.unwrap_or(1));
            return triad::simulate(&self.out, &session, console);
        }
        let sealed = self.sealed();
        let (seed, ids, strength) = if sealed {
            sealed_draw()?
        } else {
            (
                Seed(self.seed.unwrap_or(1)),
                self.acting(),
                self.strength.unwrap_or(1.0),
            )
        };
        let bench = self.bench(seed, &ids, strength)?;
        let simulation = imperfections::simulate(bench, &self.imperfection);
        let stale = self.out.join(TRUTH);
        if stale.exists() {
            std::fs::remove_file(&stale).map_err(Error::write(&stale))?;
        }
        simulation.campaign.write(&self.out)?;
        write_runs(&self.out.join("holdout.csv"), &simulation.holdout)?;
        let truth = if sealed {
            seal::seal(&self.out, &simulation.truth)?;
            "the sealed truth in label.sealed"
        } else {
            crate::output::write_json(&self.out.join(TRUTH), &simulation.truth)?;
            "the truth in truth.json"
        };
        console.print(format!(
            "{}: {} readings, {} shaker runs, {} runs to predict in holdout.csv, {truth}",
            self.out.display(),
            simulation.campaign.readings.len(),
            simulation.campaign.runs.len(),
            simulation.holdout.len(),
        ))?;
        if sealed {
            Ok(())
        } else {
            console.json(&simulation.truth)
        }
    }
}

impl Simulate {
    fn sealed(&self) -> bool {
        self.effect.iter().any(|id| id == SEALED)
    }

    /// Effects that act, `none` left out.
    fn acting(&self) -> Vec<&str> {
        let ids = self.effect.iter().map(String::as_str);
        ids.filter(|id| *id != NONE).collect()
    }

    fn refuse_contrary(&self) -> Result<(), Error> {
        let refuse = |words: &str| Err(Error::Usage(words.into()));
        if self.made.triad && !(self.effect.is_empty() && self.imperfection.is_empty()) {
            return refuse("a triad is simulated without an --effect or an --imperfection");
        }
        let alone = self.effect.len() == 1 && self.seed.is_none() && self.strength.is_none();
        if self.sealed() && !alone {
            return refuse("--effect sealed goes without another effect, --seed and --strength");
        }
        let nothing_acts = !self.sealed() && self.acting().is_empty();
        if self.visibility.is_some() && nothing_acts {
            return refuse("--visibility needs an --effect other than none");
        }
        if self.strength.is_some() && nothing_acts {
            return refuse("--strength needs an --effect other than none");
        }
        Ok(())
    }

    /// The bench with its effects as strong as they are to be.
    fn bench(&self, seed: Seed, ids: &[&str], strength: f64) -> Result<VirtualBench, Error> {
        let specification = Specification::with_dial_sigma(self.dial_sigma);
        let draw = |index: usize, id: &str, strength: f64| {
            let mut stream = seed.stream("effect", index as u64);
            effects::find(id).map(|entry| (entry.draw)(strength, &mut stream))
        };
        let bench = |drawn| VirtualBench::new(seed, self.plan, specification, drawn);
        let mut drawn = Vec::new();
        for (index, id) in ids.iter().enumerate() {
            let strength = match self.visibility {
                None => strength,
                Some(wanted) => {
                    let with = |strength| {
                        bench(Vec::from_iter(draw(index, id, strength)))
                            .simulate()
                            .campaign
                    };
                    // What can be seen on the bench as stated.
                    let bare = bench(Vec::new()).simulate().campaign;
                    strength_for(wanted, &bare, with).ok_or_else(|| {
                        let id = match self.sealed() {
                            true => "the sealed effect",
                            false => id,
                        };
                        Error::Usage(format!(
                            "no strength of {id} has visibility {wanted} in this campaign"
                        ))
                    })?
                }
            };
            drawn.extend(draw(index, id, strength));
        }
        Ok(bench(drawn))
    }
}

/// Seed, effect and strength of a sealed campaign, from the operating system's entropy: no effect once in six, else
/// any that the bench can make, a tenth to three times a typical one.
fn sealed_draw() -> Result<(Seed, Vec<&'static str>, f64), Error> {
    let seed = Seed(u64::from_le_bytes(seal::entropy()?));
    let mut stream = Seed(u64::from_le_bytes(seal::entropy()?)).stream("label", 0);
    let ids: Vec<_> = effects::catalogue().map(|entry| entry.id).collect();
    let drawn = if stream.index(6) == 0 {
        Vec::new()
    } else {
        vec![ids[stream.index(ids.len())]]
    };
    Ok((seed, drawn, stream.log_uniform(0.1, 3.0)))
}
