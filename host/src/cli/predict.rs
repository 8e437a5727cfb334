//! `vre predict`

use std::fmt::Write as _;
use std::path::PathBuf;

use super::environment::EnvironmentOptions;
use super::{Command, Console, RowName, head, read_campaign, triad, within};
use crate::campaign::{Run, is_triad, ranges, read_runs};
use crate::contradictions;
use crate::diagnose::{Diagnosis, static_test};
use crate::error::Error;
use crate::prediction::{Prediction, predict};
use crate::refit::predict_refitted;
use crate::report;
use crate::statics::{DEFAULT_PRIOR_SIGMA, scatter_warning};

/// Predict the vibration error of shaker runs from the static test, and from static test and shaker together
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  vre predict campaigns/S01000 --runs new-runs.csv --json prediction.json\n  vre predict campaigns/S01000 --vibration psd:vehicle.csv --limit 50e-6\n  vre predict campaigns/S01000 --vibration psd+sine:rotor.csv --mission flight.csv --a0 1"
)]
pub struct Predict {
    /// Folder of the campaign
    campaign: PathBuf,
    /// Runs to predict, a table like vibration.csv in which the columns of measured output may be empty; the
    /// campaign's own runs if absent
    #[arg(long, value_name = "FILE.csv")]
    runs: Option<PathBuf>,
    /// Standard deviation about zero of every coefficient but K1, each in its own unit, stated beforehand; 5e-4 is
    /// taken where the static plan leaves a direction undetermined
    #[arg(long, value_name = "SIGMA", value_parser = within(&ranges::PRIOR_SIGMA))]
    prior_sigma: Option<f64>,
    /// Add the effects that `vre diagnose --json` found in the campaign
    #[arg(long, value_name = "FILE.json")]
    diagnosis: Option<PathBuf>,
    /// Leave a row out, by its line in a table, as static.csv:12 or vibration.csv:30 (repeatable)
    #[arg(long, value_name = "TABLE:ROW")]
    exclude: Vec<RowName>,
    /// Go on although columns contradict each other in all rows of a kind, as level_g and ref_*_rms_g by a unit
    #[arg(long)]
    accept_contradictions: bool,
    #[command(flatten)]
    environment: EnvironmentOptions,
    /// Know the errors of the dividing head's marks as other campaigns told them (`vre identify --teach`)
    #[arg(long, value_name = "HEAD.toml")]
    head: Option<PathBuf>,
}

impl Command for Predict {
    fn run(self, console: &Console) -> Result<(), Error> {
        if is_triad(&self.campaign) {
            if self.head.is_some() {
                return Err(Error::Usage("a triad takes no --head".into()));
            }
            if self.prior_sigma.is_some() || self.diagnosis.is_some() || !self.exclude.is_empty() {
                return Err(Error::Usage(
                    "a triad takes neither --prior-sigma nor --diagnosis nor --exclude; state cross_coupling_sigma_per_g in campaign.toml".into(),
                ));
            }
            if self.environment.vibration.is_some() {
                return Err(Error::Usage(
                    "--vibration is for one instrument; of a triad name --runs".into(),
                ));
            }
            return triad::predict(&self.campaign, self.runs.as_deref(), console);
        }
        let campaign = read_campaign(&self.campaign, &self.exclude, console)?;
        let accepted = self.accept_contradictions;
        for contradiction in contradictions::check(&self.campaign, &campaign, accepted)? {
            console.print(format!("vibration.csv, {contradiction}"))?;
        }
        let campaign = head::beside(campaign, self.head.as_deref(), console)?;
        if let Some(name) = &self.environment.vibration {
            if self.diagnosis.is_some() {
                return Err(Error::Usage(
                    "--vibration is predicted by the static test alone, without --diagnosis".into(),
                ));
            }
            let belonging = static_test(&campaign).belonging;
            return self
                .environment
                .predict(name, &belonging, self.prior_sigma, console);
        }
        let mut own;
        let runs = match &self.runs {
            Some(file) => {
                own = read_runs(file, &campaign.config)?;
                own.retain(|run| !run.exclude);
                &own
            }
            None => &campaign.runs,
        };
        if runs.is_empty() {
            return Err(Error::Usage(format!(
                "{}: has no runs to predict; name a table of some with --runs",
                self.runs.as_ref().unwrap_or(&self.campaign).display()
            )));
        }
        let mut prediction = predict(&campaign, runs, self.prior_sigma)?;
        if let Some(file) = &self.diagnosis {
            let diagnosis = Diagnosis::read(file)?;
            let effects = diagnosis.serving();
            let with_effects = predict_refitted(&campaign, effects, runs, prediction.prior_sigma)?;
            for (run, quantity) in prediction.runs.iter_mut().zip(with_effects) {
                run.with_effects_vre_g = Some(quantity);
            }
        }
        let stated = self.prior_sigma.is_some();
        console.answer(text(&prediction, runs, stated), &prediction)
    }
}

fn text(prediction: &Prediction, runs: &[Run], stated: bool) -> String {
    let mut text = report::text::runs(prediction, runs);
    if let Some(warning) = scatter_warning(prediction.static_chi2_p_value) {
        let _ = writeln!(text, "\n{warning}");
    }
    if let (Some(sigma), false) = (prediction.prior_sigma, stated) {
        let _ = writeln!(
            text,
            "\nBLIND: the static plan leaves a direction of the coefficients undetermined. Along it every coefficient \
             is taken as 0 +- {sigma:e} (about the size in the paper's Table 1, {DEFAULT_PRIOR_SIGMA:e}); change it \
             with --prior-sigma."
        );
    }
    text
}
