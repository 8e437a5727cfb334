//! `vre demo`

use std::fmt::Write as _;
use std::path::PathBuf;

use shared::model::NOMINAL;

use super::triad::{self, Made};
use super::{Command, Console, refuse_campaign, within};
use crate::bench::noise::Seed;
use crate::bench::plan::Static;
use crate::bench::simulate::{Specification, VirtualBench};
use crate::campaign::ranges;
use crate::capture::{self, Captured};
use crate::error::Error;
use crate::output::write_json;
use crate::report::{self, Report};
use crate::statics::NAMES;

/// Runs of the demonstration: what the converter passes whole at 4 kSPS.
const HIGHEST_HZ: f64 = 480.0;

/// Measure an accelerometer on the virtual bench through the firmware itself, and report: no hardware needed
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  vre demo --out vre-demo --seed 7\n  vre demo --triad --out vre-demo-triad"
)]
pub struct Demo {
    /// Folder for the campaign with its record, the results as JSON and report.html
    #[arg(long, value_name = "DIR", default_value = "vre-demo")]
    out: PathBuf,
    /// Fixes everything that is random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The static test
    #[arg(long, value_enum, default_value = "remounted")]
    plan: Static,
    /// Standard uncertainty of a dial mark and of the base's level, arcsec
    #[arg(long, value_name = "ARCSEC", default_value_t = 5.8, value_parser = within(&ranges::ARCSEC_SIGMA))]
    dial_sigma: f64,
    #[command(flatten)]
    made: Made,
}

impl Command for Demo {
    fn run(self, console: &Console) -> Result<(), Error> {
        if self.made.triad {
            return triad::demo(&self.out, &self.made.session(self.seed), console);
        }
        let specification = Specification::with_dial_sigma(self.dial_sigma);
        let mut bench = VirtualBench::new(Seed(self.seed), self.plan, specification, Vec::new());
        bench.plan.runs.retain(|run| run.f_hi_hz <= HIGHEST_HZ);
        let bar = console.progress(capture::steps(&bench), "measuring");
        let campaign_folder = self.out.join("campaign");
        let truth_file = self.out.join("truth.json");
        let record = campaign_folder.join(capture::RECORD);
        if !truth_file.exists() {
            refuse_campaign(&campaign_folder, "")?;
        } else if record.exists() {
            // That of a demonstration before.
            std::fs::remove_file(&record).map_err(Error::write(&record))?;
        }
        let truth = bench.accelerometer.coefficients.to_nominal();
        std::fs::create_dir_all(&self.out).map_err(Error::write(&self.out))?;
        write_json(&truth_file, &truth_by_name(&truth))?;
        let captured = capture::capture_virtual(&bench, &campaign_folder, || bar.inc(1))?;
        bar.finish_and_clear();

        let supplement = report::Supplement {
            folder: Some(&campaign_folder),
            study: None,
        };
        let report = report::write(&captured.campaign, supplement, &self.out)?;
        console.answer(self.text(&captured, &report, &truth), &report.prediction)
    }
}

fn truth_by_name(truth: &[f64; NOMINAL]) -> serde_json::Map<String, serde_json::Value> {
    NAMES
        .iter()
        .zip(truth)
        .map(|(name, value)| ((*name).into(), (*value).into()))
        .collect()
}

impl Demo {
    fn text(&self, captured: &Captured, report: &Report, truth: &[f64; NOMINAL]) -> String {
        let tally = &captured.tally;
        let mut text = format!(
            "Recorded {} frames in {:.1} MB, {} samples in blocks, {} missing.\n\n",
            tally.frames,
            tally.bytes as f64 / 1e6,
            tally.blocks.received,
            tally.blocks.missing,
        );
        let _ = writeln!(
            text,
            "{:<12} {:>20} {:>16} {:>8}",
            "coefficient", "identified", "true", "z"
        );
        for ((name, found), truth) in NAMES
            .iter()
            .zip(&report.identification.coefficients)
            .zip(truth)
        {
            // Everything but K1 in 1e-6 of its unit.
            let factor = if *name == NAMES[0] { 1.0 } else { 1e6 };
            let z = found.known().map_or("-".into(), |(value, sigma)| {
                format!("{:.1}", (value - truth) / sigma)
            });
            let _ = writeln!(
                text,
                "{name:<12} {:>20} {:>16.6} {z:>8}",
                found.scaled(factor).to_string(),
                truth * factor,
            );
        }
        let _ = writeln!(
            text,
            "(1e-6 of the unit, K1 in V/g; z: the miss in standard uncertainties)\n"
        );
        let _ = writeln!(text, "{}", report::text::summary(report));
        let _ = write!(text, "{}", self.out.join("report.html").display());
        text
    }
}
