//! A record that is being written.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use memchr::memrchr;
use shared::wire::framing::{DELIMITER, MAX_FRAME};

use super::note::Note;
use crate::error::Error;

/// A record that is being written. A frame that has begun waits for its end, so that the file ends with a whole one and a
/// note can follow at any time.
#[derive(Debug)]
pub struct Writer {
    file: PathBuf,
    out: BufWriter<File>,
    /// A frame that has begun.
    begun: Vec<u8>,
    /// The file does not end with a delimiter.
    open: bool,
}

impl Writer {
    /// Opens a record to append to, making it if it is not there.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn append(file: &Path) -> Result<Self, Error> {
        let open = || -> io::Result<(File, bool)> {
            let mut options = OpenOptions::new();
            let mut out = options.append(true).read(true).create(true).open(file)?;
            let mut last = [DELIMITER];
            if out.metadata()?.len() > 0 {
                out.seek(SeekFrom::End(-1))?;
                out.read_exact(&mut last)?;
            }
            Ok((out, last != [DELIMITER]))
        };
        let (out, open) = open().map_err(Error::write(file))?;
        Ok(Self {
            file: file.into(),
            out: BufWriter::new(out),
            begun: Vec::new(),
            open,
        })
    }

    /// Takes bytes as they came.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let (whole, begun) = match memrchr(DELIMITER, bytes) {
            Some(last) => bytes.split_at(last + 1),
            None => (&[][..], bytes),
        };
        if !whole.is_empty() {
            self.put_begun()?;
            self.put(whole)?;
            self.open = false;
        }
        self.begun.extend_from_slice(begun);
        // Longer than any frame: nothing will come of it.
        if self.begun.len() > MAX_FRAME {
            self.put_begun()?;
            self.open = true;
        }
        Ok(())
    }

    /// Adds a note and hands everything to the disk: what is noted has happened.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn note(&mut self, note: &Note<'_>) -> Result<(), Error> {
        let frame = note.frame().map_err(|_| {
            let problem = io::Error::other("a note is longer than a frame");
            Error::write(&self.file)(problem)
        })?;
        if self.open {
            self.put(&[DELIMITER])?;
            self.open = false;
        }
        self.put(frame.as_bytes())?;
        self.sync()
    }

    /// Hands all whole frames to the operating system, so that they survive the end of this program.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn flush(&mut self) -> Result<(), Error> {
        self.out.flush().map_err(Error::write(&self.file))
    }

    /// Hands everything to the disk and waits for it.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn finish(mut self) -> Result<(), Error> {
        self.put_begun()?;
        self.sync()
    }

    fn sync(&mut self) -> Result<(), Error> {
        self.flush()?;
        let synced = self.out.get_ref().sync_data();
        synced.map_err(Error::write(&self.file))
    }

    fn put_begun(&mut self) -> Result<(), Error> {
        let begun = std::mem::take(&mut self.begun);
        self.put(&begun)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.out.write_all(bytes).map_err(Error::write(&self.file))
    }
}
