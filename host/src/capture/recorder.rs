//! A record while it is written, with the ledger of what it tells.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use shared::wire::message::Event;

use super::folder::HEAD;
use super::ledger::Ledger;
use crate::campaign::CampaignConfig;
use crate::error::Error;
use crate::record::{Item, Note, Writer, pieces};
use crate::reduction::ReductionError;

/// Writes first, then believes.
#[derive(Debug)]
pub struct Recorder {
    writer: Writer,
    ledger: Ledger,
}

impl Recorder {
    /// Goes on with the record `file`, which tells `ledger` so far.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn append(file: &Path, ledger: Ledger) -> Result<Self, Error> {
        let writer = Writer::append(file)?;
        Ok(Self { writer, ledger })
    }

    /// Notes that a capture begins or goes on, with what campaign.toml says.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn begin(&mut self, config: &CampaignConfig) -> Result<(), Error> {
        let unix_ms = unix_ms();
        self.note(&Note::Began { unix_ms })?;
        let text = head_text(config)?;
        let pieces = pieces(&text);
        let parts = pieces.len() as u16;
        for (part, text) in (0..).zip(pieces) {
            self.note(&Note::Head { part, parts, text })?;
        }
        Ok(())
    }

    /// Takes bytes of the link as they came.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.writer.write(bytes)
    }

    /// Hands what was written to the operating system.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn flush(&mut self) -> Result<(), Error> {
        self.writer.flush()
    }

    /// Hears what the bytes said.
    ///
    /// # Errors
    /// As [`Ledger::absorb`].
    pub fn hear(&mut self, event: &Event<'_>) -> Result<(), ReductionError> {
        self.ledger.absorb(&Item::Event(*event))
    }

    /// Adds a note; when this returns it is on the disk.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn note(&mut self, note: &Note<'_>) -> Result<(), Error> {
        self.writer.note(note)?;
        // A note cannot fail to be understood.
        let _ = self.ledger.absorb(&Item::Note(*note));
        Ok(())
    }

    /// What the record tells so far.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Hands everything to the disk.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn finish(self) -> Result<Ledger, Error> {
        self.writer.finish()?;
        Ok(self.ledger)
    }
}

/// What stands in campaign.toml.
fn head_text(config: &CampaignConfig) -> Result<String, Error> {
    let text = toml::to_string(config);
    text.map_err(|error| Error::write(Path::new(HEAD))(std::io::Error::other(error)))
}

/// Milliseconds since 1970-01-01 UTC.
pub fn unix_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| since.as_millis() as u64)
}
