//! The append-only record of what came in: the bytes of the link exactly as they were received, and between two frames
//! the host's [`Note`]s on what the instrument cannot know.
//!
//! A record has no header and no index. Frames carry their own delimiter, checksum, sequence number and
//! sample index, and the instrument says who it is ([`Event::Hello`]); whatever else a file could state
//! would be a second opinion. So any capture of the link is a record, two records in a row are a record, and
//! a record cut or damaged anywhere is read on from the next delimiter.
//!
//! [`Reader`] hands out all that is sound and counts the rest ([`Tally`]), in constant memory.

mod note;
mod writer;

use std::io::{self, Read};
use std::path::Path;

use memchr::memchr;
use serde::Serialize;
use shared::wire::framing::{DELIMITER, MAX_FRAME};
use shared::wire::{Event, FrameError, Packet};

pub use note::{NOTES, Note, ReadingNote, RunNote, pieces};
pub use writer::Writer;

use crate::error::{Error, Problem};

/// What a sound frame of a record holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Item<'a> {
    /// What the instrument said.
    Event(Event<'a>),
    /// What the host added.
    Note(Note<'a>),
}

/// Bytes read at once.
const CHUNK: usize = 1 << 16;

/// Why a record cannot be read on.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The source failed.
    #[error("{0}")]
    Read(#[from] io::Error),
    /// Two instruments speak in one record.
    #[error(
        "instrument {} speaks in frame {frame} (before byte {byte}), after instrument {}: two instruments in one record",
        hex(found),
        hex(first)
    )]
    TwoInstruments {
        /// Sound frames up to and including that one.
        frame: u64,
        /// Where the frame ends.
        byte: u64,
        /// Who spoke first.
        first: [u8; 12],
        /// Who spoke there.
        found: [u8; 12],
    },
}

impl RecordError {
    /// The error with the name of the record's file, or of its source.
    pub fn in_file(self, file: &Path) -> Error {
        match self {
            Self::Read(source) => Error::read(file)(source),
            other => Error::input(file, Problem::Other(other.to_string())),
        }
    }
}

/// A serial number as people write it.
pub fn hex(serial: &[u8; 12]) -> String {
    serial.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What a record holds and what it lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    /// All bytes: of sound frames, damaged, idle delimiters.
    pub bytes: u64,
    /// Sound frames of the instrument.
    pub frames: u64,
    /// Notes of the host.
    pub notes: u64,
    /// Bytes outside sound frames.
    pub damaged_bytes: u64,
    /// Delimiters with nothing before them: nothing is lost.
    pub idle_delimiters: u64,
    /// Stretches between delimiters that are no sound frame.
    pub damaged_stretches: u64,
    /// Of these, whole frames of a protocol version that is not understood.
    pub foreign_frames: u64,
    /// Frames missing by the sequence number, which counts modulo 65536.
    pub missing_frames: u64,
    /// Times that the sequence or the index of the samples went back: the instrument began anew, or records
    /// were joined.
    pub restarts: u64,
    /// Samples of [`Event::Raw`].
    pub raw: Samples,
    /// Samples of [`Event::Block`].
    pub blocks: Samples,
}

/// Samples by their index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Samples {
    /// Received.
    pub received: u64,
    /// Missing because frames are.
    pub missing: u64,
    /// Never sent: lost at the converter, or sending was off for a while.
    pub not_sent: u64,
}

/// Where a run of samples ought to go on.
#[derive(Clone, Copy, Debug, Default)]
struct Continuity {
    next: Option<u64>,
    /// Frames were lost since the last samples.
    broken: bool,
}

impl Continuity {
    fn goes_back(&self, first: u64) -> bool {
        self.next.is_some_and(|next| first < next)
    }

    fn take(&mut self, samples: &mut Samples, first: u64, received: u64, lost: u64) {
        let gap = self.next.map_or(0, |next| first.saturating_sub(next));
        match self.broken {
            true => samples.missing = samples.missing.saturating_add(gap),
            false => samples.not_sent = samples.not_sent.saturating_add(gap),
        }
        samples.received += received;
        samples.not_sent = samples.not_sent.saturating_add(lost);
        self.next = Some(first.saturating_add(received).saturating_add(lost));
        self.broken = false;
    }
}

/// Reads a record, however it is cut into pieces; never panics, whatever comes in.
#[derive(Debug, Default)]
pub struct Reader {
    tally: Tally,
    /// A frame that has begun: fewer than [`MAX_FRAME`] bytes.
    begun: Vec<u8>,
    /// Bytes of a stretch that is longer than any frame and so is none.
    overlong: u64,
    sequence: Option<u16>,
    serial: Option<[u8; 12]>,
    raw: Continuity,
    blocks: Continuity,
}

impl Reader {
    /// At the beginning of a record.
    pub fn new() -> Self {
        Self::default()
    }

    /// What was read so far; a frame that has begun is not counted yet.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Serial number of the instrument that speaks, once it has said it.
    pub fn serial(&self) -> Option<[u8; 12]> {
        self.serial
    }

    /// Takes the next bytes, which are unpacked in place, and hands each sound event to `sink` with the
    /// tally up to and including it.
    ///
    /// # Errors
    /// [`RecordError::TwoInstruments`], and what `sink` returns.
    pub fn feed<E: From<RecordError>>(
        &mut self,
        bytes: &mut [u8],
        sink: &mut impl FnMut(Event<'_>, &Tally) -> Result<(), E>,
    ) -> Result<(), E> {
        self.feed_items(bytes, &mut |item, tally: &Tally| match item {
            Item::Event(event) => sink(event, tally),
            Item::Note(_) => Ok(()),
        })
    }

    /// The same with the host's notes.
    ///
    /// # Errors
    /// As [`Self::feed`].
    pub fn feed_items<E: From<RecordError>>(
        &mut self,
        mut bytes: &mut [u8],
        sink: &mut impl FnMut(Item<'_>, &Tally) -> Result<(), E>,
    ) -> Result<(), E> {
        while let Some(end) = memchr(DELIMITER, bytes) {
            if end == 0 && self.overlong == 0 && self.begun.is_empty() {
                let idle = bytes.iter().take_while(|&&byte| byte == DELIMITER).count();
                self.tally.bytes += idle as u64;
                self.tally.idle_delimiters += idle as u64;
                bytes = &mut bytes[idle..];
                continue;
            }
            let (stretch, rest) = bytes.split_at_mut(end);
            if self.overlong == 0 && self.begun.is_empty() {
                self.stretch(stretch, sink)?;
            } else {
                self.begin(stretch);
                let mut begun = std::mem::take(&mut self.begun);
                let outcome = match std::mem::take(&mut self.overlong) {
                    0 => self.stretch(&mut begun, sink),
                    length => {
                        self.damaged(length + 1);
                        Ok(())
                    }
                };
                begun.clear();
                self.begun = begun; // Its memory is used again.
                outcome?;
            }
            bytes = &mut rest[1..];
        }
        self.begin(bytes);
        Ok(())
    }

    /// At the end of the record: a frame that has begun will not be completed.
    pub fn finish(mut self) -> Tally {
        let left = self.overlong + self.begun.len() as u64;
        if left > 0 {
            self.damaged(left);
        }
        self.tally
    }

    /// Keeps the beginning of a stretch whose end is not there yet.
    fn begin(&mut self, bytes: &[u8]) {
        if self.overlong > 0 || self.begun.len() + bytes.len() >= MAX_FRAME {
            self.overlong += (self.begun.len() + bytes.len()) as u64;
            self.begun.clear();
        } else {
            self.begun.extend_from_slice(bytes);
        }
    }

    /// What stands between two delimiters.
    fn stretch<E: From<RecordError>>(
        &mut self,
        stretch: &mut [u8],
        sink: &mut impl FnMut(Item<'_>, &Tally) -> Result<(), E>,
    ) -> Result<(), E> {
        let length = stretch.len() as u64 + 1;
        match open(stretch) {
            Ok((sequence, Item::Event(event))) => {
                self.tally.bytes += length;
                self.tally.frames += 1;
                self.follow(sequence);
                self.account(&event)?;
                sink(Item::Event(event), &self.tally)
            }
            Ok((_, note)) => {
                self.tally.bytes += length;
                self.tally.notes += 1;
                sink(note, &self.tally)
            }
            Err(error) => {
                if matches!(error, FrameError::Version(_)) {
                    self.tally.foreign_frames += 1;
                }
                self.damaged(length);
                Ok(())
            }
        }
    }

    fn damaged(&mut self, bytes: u64) {
        self.tally.bytes += bytes;
        self.tally.damaged_bytes += bytes;
        self.tally.damaged_stretches += 1;
    }

    fn follow(&mut self, sequence: u16) {
        let gap = self
            .sequence
            .map_or(0, |last| sequence.wrapping_sub(last).wrapping_sub(1));
        self.sequence = Some(sequence);
        if gap >= 1 << 15 {
            self.restart();
        } else if gap > 0 {
            self.tally.missing_frames += u64::from(gap);
            self.raw.broken = true;
            self.blocks.broken = true;
        }
    }

    fn restart(&mut self) {
        self.tally.restarts += 1;
        self.raw = Continuity::default();
        self.blocks = Continuity::default();
    }

    fn account(&mut self, event: &Event<'_>) -> Result<(), RecordError> {
        match event {
            Event::Hello(identity) => {
                let first = *self.serial.get_or_insert(identity.serial);
                if first != identity.serial {
                    return Err(RecordError::TwoInstruments {
                        frame: self.tally.frames,
                        byte: self.tally.bytes,
                        first,
                        found: identity.serial,
                    });
                }
            }
            Event::Raw(raw) => {
                let received = raw.samples().len() as u64;
                if self.raw.goes_back(raw.first_sample) {
                    self.restart();
                }
                self.raw
                    .take(&mut self.tally.raw, raw.first_sample, received, 0);
            }
            Event::Block(block) => {
                let (received, lost) = (u64::from(block.count), u64::from(block.lost));
                if self.blocks.goes_back(block.first_sample) {
                    self.restart();
                }
                self.blocks
                    .take(&mut self.tally.blocks, block.first_sample, received, lost);
            }
            _ => {}
        }
        Ok(())
    }
}

/// The sequence number and the content of a frame.
fn open(stretch: &mut [u8]) -> Result<(u16, Item<'_>), FrameError> {
    let packet = Packet::open_any(stretch)?;
    let item = match packet.version {
        NOTES => Item::Note(packet.message()?),
        version if version.is_understood() => Item::Event(packet.message()?),
        version => return Err(FrameError::Version(version)),
    };
    Ok((packet.sequence, item))
}

/// Reads a record to its end, in constant memory, and hands each sound event to `sink` with the
/// tally up to and including it.
///
/// # Errors
/// [`RecordError`], and what `sink` returns.
pub fn read<E: From<RecordError>>(
    source: impl Read,
    mut sink: impl FnMut(Event<'_>, &Tally) -> Result<(), E>,
) -> Result<Tally, E> {
    read_items(source, |item, tally| match item {
        Item::Event(event) => sink(event, tally),
        Item::Note(_) => Ok(()),
    })
}

/// The same with the host's notes.
///
/// # Errors
/// As [`read`].
pub fn read_items<E: From<RecordError>>(
    mut source: impl Read,
    mut sink: impl FnMut(Item<'_>, &Tally) -> Result<(), E>,
) -> Result<Tally, E> {
    let mut reader = Reader::new();
    let mut chunk = vec![0; CHUNK];
    loop {
        match source.read(&mut chunk) {
            Ok(0) => return Ok(reader.finish()),
            Ok(length) => reader.feed_items(&mut chunk[..length], &mut sink)?,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(RecordError::Read(error).into()),
        }
    }
}
