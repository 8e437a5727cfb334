//! A campaign's head as a file of TOML, whatever it holds.

use std::path::Path;

use serde::de::DeserializeOwned;

use super::keys;
use crate::error::{Error, Place, Problem};
use crate::input::read_at_most;

const MAX_BYTES: u64 = 1 << 20;

/// Reads `file` into a campaign's head; `accept` sees its tables before anything is asked of them.
pub(super) fn read_toml<T: DeserializeOwned>(
    file: &Path,
    accept: impl FnOnce(&toml::Table) -> Result<(), Error>,
) -> Result<T, Error> {
    let bytes = read_at_most(file, MAX_BYTES)?;
    let at = |offset: usize| Place {
        row: Some(
            1 + bytes[..offset]
                .iter()
                .filter(|&&byte| byte == b'\n')
                .count() as u64,
        ),
        ..Place::file(file)
    };
    let text = std::str::from_utf8(&bytes).map_err(|error| Error::Input {
        place: at(error.valid_up_to()),
        problem: Problem::NotUtf8,
    })?;
    if text.trim_start_matches('\u{feff}').trim().is_empty() {
        return Err(Error::input(file, Problem::EmptyFile));
    }
    let bad_toml = |error: toml::de::Error| {
        let place = match error.span() {
            Some(span) => at(span.start.min(bytes.len())),
            None => Place::file(file),
        };
        let problem = Problem::Other(error.message().replace('\n', " "));
        Error::Input { place, problem }
    };
    let table = toml::from_str(text).map_err(bad_toml)?;
    keys::check(file, &table)?;
    accept(&table)?;
    toml::from_str(text).map_err(bad_toml)
}
