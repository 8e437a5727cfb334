//! `vre identify`

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use shared::identify::blindness::DEFICIENT_CONDITION;
use shared::model::NOMINAL;

use super::{Command, Console, RowName, head, read_campaign, triad, within};
use crate::campaign::{is_triad, ranges};
use crate::diagnose::{Identified, StaticTest, static_test};
use crate::error::Error;
use crate::gate;
use crate::report;
use crate::statics::{Identification, MEANINGS, Method, NAMES, identify, scatter_warning};

/// Identify the coefficients of the IEEE 1293 model from the static readings of a campaign
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  vre identify campaigns/S01000 --json coefficients.json\n  vre identify campaigns/S01000 --exclude 12\n  vre identify campaigns/S01000 --teach head.toml\n  vre identify campaigns/S01001 --head head.toml"
)]
pub struct Identify {
    /// Folder of the campaign
    campaign: PathBuf,
    /// How the coefficients are found
    #[arg(long, value_enum, default_value = "least-squares")]
    method: Method,
    /// State a standard deviation about zero for every coefficient but K1, each in its own unit: determines what the
    /// plan leaves blind, by assumption
    #[arg(long, value_name = "SIGMA", value_parser = within(&ranges::PRIOR_SIGMA))]
    prior_sigma: Option<f64>,
    /// Leave a row of static.csv out, by its line in the file (repeatable)
    #[arg(long, value_name = "ROW")]
    exclude: Vec<RowName>,
    /// Take every reading, and its uncertainty as it is stated, whatever the other readings say of it
    #[arg(long)]
    as_stated: bool,
    /// Know the errors of the dividing head's marks as other campaigns told them
    #[arg(long, value_name = "HEAD.toml")]
    head: Option<PathBuf>,
    /// Let this campaign teach a head, which is made if it is not there: best one whose instrument was remounted by 180 deg, or
    /// shaken. What the file knew before serves as --head
    #[arg(long, value_name = "HEAD.toml", conflicts_with = "head")]
    teach: Option<PathBuf>,
}

impl Command for Identify {
    fn run(self, console: &Console) -> Result<(), Error> {
        if is_triad(&self.campaign) {
            if self.head.is_some() || self.teach.is_some() {
                return Err(Error::Usage(
                    "a triad takes neither --head nor --teach".into(),
                ));
            }
            if self.prior_sigma.is_some()
                || self.method != Method::LeastSquares
                || !self.exclude.is_empty()
            {
                return Err(Error::Usage(
                    "a triad takes neither --prior-sigma nor --exclude nor another --method; state cross_coupling_sigma_per_g in campaign.toml"
                        .into(),
                ));
            }
            return triad::identify(&self.campaign, console);
        }
        let as_measured = read_campaign(&self.campaign, &self.exclude, console)?;
        let head = self.head.as_deref();
        let head = head.or(self.teach.as_deref().filter(|file| file.exists()));
        let campaign = head::beside(as_measured.clone(), head, console)?;
        let mut judged = static_test(&campaign);
        // The closed formulas need every reading of the plan, and know no uncertainty of one.
        if self.as_stated || self.method == Method::ClosedForm {
            judged.belonging = campaign;
            for suspect in &mut judged.suspects {
                suspect.set_aside = false;
            }
        }
        let identification = identify(&judged.belonging, self.method, self.prior_sigma)?;
        let identified = Identified::new(&identification, &judged);
        gate::check(&identified)?;
        console.print(belonging(&judged))?;
        console.print(text(&identification))?;
        if let Some(file) = &self.teach {
            head::teach(&as_measured, file, console)?;
        }
        console.json(&identified)
    }
}

/// What the readings say of each other, a line each.
fn belonging(judged: &StaticTest) -> String {
    let mut text = report::belonging(&judged.suspects, &judged.noise);
    if !text.is_empty() {
        text.push('\n');
    }
    text
}

fn text(found: &Identification) -> String {
    let mut text = format!("instrument {}\n\n", found.serial);
    for ((name, meaning), quantity) in NAMES.iter().zip(MEANINGS).zip(&found.coefficients) {
        let _ = match *name {
            "K1_v_per_g" => writeln!(text, "{name:<12} {quantity:>16}        {meaning}"),
            _ => writeln!(
                text,
                "{name:<12} {:>16} e-6    {meaning}",
                quantity.scaled(1e6)
            ),
        };
    }
    let _ = writeln!(
        text,
        "\nStandard uncertainties in units of the last digits."
    );
    let _ = writeln!(
        text,
        "rank {} of {NOMINAL}, {}",
        found.rank,
        condition(found.condition)
    );
    if let Some(chi2) = found.chi2 {
        let _ = writeln!(
            text,
            "chi-square {chi2:.1} at {} degrees of freedom",
            found.dof
        );
        if let Some(warning) = scatter_warning(found.chi2_p_value) {
            let _ = writeln!(text, "{warning}");
        }
    }
    for direction in &found.blind_directions {
        let _ = writeln!(
            text,
            "BLIND: the readings do not determine the direction {} beside what is known beforehand. Predicted vibration \
             errors along it rest on an assumption; `vre plan` tells which positions to add.",
            sum(direction)
        );
    }
    if let Some(sigma) = found.prior_sigma {
        let _ = writeln!(
            text,
            "Prior: every coefficient but K1 was taken as 0 +- {sigma} before the first reading."
        );
    }
    text
}

/// A direction of the coefficients for people: a sum of them.
pub fn sum(direction: &BTreeMap<&str, f64>) -> String {
    // A part that shows as zero is none.
    let parts = direction.iter().filter(|(_, c)| c.abs() >= 5e-5);
    let parts: Vec<_> = parts.map(|(name, c)| format!("{c:+.4} {name}")).collect();
    parts.join("  ")
}

/// A condition number for people.
pub fn condition(condition: f64) -> String {
    if condition < DEFICIENT_CONDITION {
        format!("condition number {condition:.1}")
    } else {
        "condition number infinite within rounding".into()
    }
}
