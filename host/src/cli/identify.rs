//! `vre identify`

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use shared::identify::blindness::DEFICIENT_CONDITION;
use shared::model::NOMINAL;

use super::{Command, Console, read_campaign};
use crate::error::Error;
use crate::statics::{Identification, MEANINGS, Method, NAMES, identify, scatter_warning};

/// Identify the coefficients of the IEEE 1293 model from the static readings of a campaign
#[derive(clap::Args)]
#[command(after_help = "Example:\n  vre identify campaigns/S01000 --json coefficients.json")]
pub struct Identify {
    /// Folder of the campaign
    campaign: PathBuf,
    /// How the coefficients are found
    #[arg(long, value_enum, default_value = "least-squares")]
    method: Method,
    /// State a standard deviation about zero for every coefficient but K1, each in its own unit: determines what the
    /// plan leaves blind, by assumption
    #[arg(long, value_name = "SIGMA", value_parser = super::positive)]
    prior_sigma: Option<f64>,
}

impl Command for Identify {
    fn run(self, console: &Console) -> Result<(), Error> {
        let campaign = read_campaign(&self.campaign, console)?;
        let identification = identify(&campaign, self.method, self.prior_sigma)?;
        console.print(text(&identification))?;
        console.json(&identification)
    }
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
    let parts = direction.iter();
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
