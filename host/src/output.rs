//! Files that are written whole or not at all.

use std::fs;
use std::io::Write;
use std::path::Path;

use atomic_write_file::AtomicWriteFile;

use crate::error::Error;

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
