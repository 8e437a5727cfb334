//! Files that are read as a whole, to a limit.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::Error;

/// The bytes of `file`, of which it must not have more than `most`.
///
/// # Errors
/// It cannot be read, or is larger.
pub fn read_at_most(file: &Path, most: u64) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    File::open(file)
        .and_then(|source| source.take(most + 1).read_to_end(&mut bytes))
        .map_err(Error::read(file))?;
    if bytes.len() as u64 > most {
        return Err(Error::input(file, format!("has more than {most} bytes")));
    }
    Ok(bytes)
}
