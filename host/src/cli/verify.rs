//! `vre verify`

use std::fmt::Write as _;
use std::path::PathBuf;

use super::{Command, Console};
use crate::error::Error;
use crate::statics::NAMES;
use crate::verification;

/// Compare the instrument's own self-check with the same computation on the host, from the record of a campaign
#[derive(clap::Args)]
#[command(
    after_help = "Exit status 1 if they disagree.\n\nExample:\n  vre verify campaigns/emulated"
)]
pub struct Verify {
    /// Folder of the campaign with its record.vre
    campaign: PathBuf,
}

impl Command for Verify {
    fn run(self, console: &Console) -> Result<(), Error> {
        let found = verification::verify(&self.campaign)?;
        let (board, host) = (&found.instrument, &found.host);
        let mut text = format!(
            "{:<12} {:>22} {:>22}\n",
            "coefficient", "instrument", "host"
        );
        for (k, name) in NAMES.iter().enumerate() {
            let (a, b) = (board.coefficients[k], host.coefficients[k]);
            let _ = writeln!(text, "{name:<12} {a:>22.14e} {b:>22.14e}");
        }
        let _ = writeln!(
            text,
            "{:<12} {:>22.8} {:>22.8}",
            "chi-square", board.chi2, host.chi2
        );
        let _ = writeln!(
            text,
            "{:<12} {:>22} {:>22}",
            "readings", board.readings, host.readings
        );
        let names: Vec<_> = board
            .verdicts
            .iter()
            .map(|verdict| verdict.name())
            .collect();
        let verdict = if names.is_empty() {
            "passed".into()
        } else {
            names.join(", ")
        };
        let agreement = if found.agrees() { "agree" } else { "DISAGREE" };
        let _ = write!(
            text,
            "K1 is in volts at the converter. Self-check: {verdict}. Instrument and host {agreement}: {:.1e}",
            found.difference
        );
        console.as_told(text, &found)?;
        if found.agrees() {
            Ok(())
        } else {
            Err(Error::Disagreement(found.difference))
        }
    }
}
