//! What a campaign is of: one instrument, or a triad of three on one body.

use std::path::Path;

use super::toml_file::read_toml;
use crate::error::{Error, Place, Problem};

/// The word for a triad in `[instrument] kind`.
pub(super) const TRIAD: &str = "triad";
const SINGLE: &str = "single";

/// Whether the campaign in `folder` is a triad's. A folder without a readable campaign.toml is none: reading it tells why.
pub fn is_triad(folder: &Path) -> bool {
    let table: Result<toml::Table, Error> = read_toml(&folder.join("campaign.toml"), |_| Ok(()));
    table.is_ok_and(|table| word(&table) == Some(TRIAD))
}

/// The kind must be that of one instrument, or absent.
pub(super) fn of_one(file: &Path, table: &toml::Table) -> Result<(), Error> {
    let problem = match word(table) {
        None | Some(SINGLE) => return Ok(()),
        Some(TRIAD) => "is a triad, which this command does not take".into(),
        Some(other) => Problem::NotOneOf {
            value: other.into(),
            expected: "a kind: single or triad",
        },
    };
    let place = Place {
        column: Some("kind".into()),
        ..Place::file(file)
    };
    Err(Error::Input { place, problem })
}

fn word(table: &toml::Table) -> Option<&str> {
    table.get("instrument")?.get("kind")?.as_str()
}
