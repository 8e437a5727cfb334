//! Files that are written whole or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use atomic_write_file::AtomicWriteFile;
use serde::Serialize;

use crate::error::Error;
use crate::gate;

/// Writes `content` to `file` in one step, so that whoever looks sees the old file or the new one. What is
/// there and is no regular file (a pipe, a terminal) is written to as it is.
///
/// # Errors
/// What the file system says.
pub fn write_file(file: &Path, content: &[u8]) -> Result<(), Error> {
    let write = || match fs::metadata(file) {
        Ok(there) if !there.is_file() => fs::OpenOptions::new()
            .write(true)
            .open(file)?
            .write_all(content),
        _ => {
            let mut new = AtomicWriteFile::open(file)?;
            new.write_all(content)?;
            new.commit()
        }
    };
    write().map_err(Error::write(file))
}

/// Writes a table of comma separated values to `file`, in one step.
///
/// # Errors
/// The file cannot be written.
pub(crate) fn write_csv(
    file: &Path,
    fill: impl FnOnce(&mut csv::Writer<Vec<u8>>) -> csv::Result<()>,
) -> Result<(), Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    fill(&mut writer).map_err(|error| Error::write(file)(error.into()))?;
    let table = writer.into_inner();
    write_file(
        file,
        &table.map_err(|error| Error::write(file)(error.into_error()))?,
    )
}

/// Writes `result` as JSON to `file`, in one step.
///
/// # Errors
/// The file cannot be written; a number that cannot be ([`gate`]).
pub fn write_json(file: &Path, result: &impl Serialize) -> Result<(), Error> {
    gate::check(result)?;
    write_file(file, json_text(file, result)?.as_bytes())
}

/// `result` as indented JSON; `file` is named if it cannot be.
pub(crate) fn json_text(file: &Path, result: &impl Serialize) -> Result<String, Error> {
    let text = serde_json::to_string_pretty(result)
        .map_err(|error| Error::write(file)(io::Error::other(error)))?;
    Ok(text + "\n")
}
