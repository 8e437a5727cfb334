//! What a record tells of a campaign: the host's notes on readings and runs, and the sums of their blocks.
//!
//! One ledger is kept while a record is written and another is made when it is read; both hear the same items in the same
//! order and come to the same.

use std::path::Path;

use shared::tumble::Series;
use shared::wire::message::{self, Event, Plateau, Position, Run, Segment};

use crate::bench::plan::{Dwell, Shake};
use crate::campaign::{Approach, VibrationKind};
use crate::error::Error;
use crate::record::{self, Item, Note, ReadingNote, RecordError, RunNote, Tally};
use crate::reduction::{Reduction, ReductionError, SegmentSums};
use crate::source::FileSource;

/// Why a record cannot be read as that of a campaign.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// Its bytes.
    #[error("{0}")]
    Record(#[from] RecordError),
    /// Its events.
    #[error("{0}")]
    Reduction(#[from] ReductionError),
}

impl LedgerError {
    /// The error with the name of the record's file.
    pub fn in_file(self, file: &Path) -> Error {
        match self {
            Self::Record(error) => error.in_file(file),
            Self::Reduction(error) => Error::input(file, error.to_string()),
        }
    }
}

/// What has become of a reading or a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It was begun; nobody has said that it is whole.
    Begun,
    /// It is whole and counts.
    Whole,
    /// It counts no longer.
    Withdrawn,
}

/// A reading that was begun.
#[derive(Clone, Debug)]
pub struct Taken {
    /// As in the record and in the column `order`.
    pub number: u32,
    /// Where the dial stood.
    pub dwell: Dwell,
    /// Of its centre since the campaign's start, s.
    pub time_s: f64,
    /// Temperature of the instrument, degrees Celsius.
    pub temp_c: f64,
    /// Blocks that it should have.
    pub blocks: u32,
    /// Which power-up of the instrument, from 0.
    pub power_up: u32,
    /// Whether it counts.
    pub standing: Standing,
    /// What the person remarked.
    pub remark: String,
}

/// A shaker run that was begun.
#[derive(Clone, Debug)]
pub struct Shaken {
    /// As in the record and in the column `run`.
    pub number: u32,
    /// The vibration.
    pub shake: Shake,
    /// Of the centre of the plateau before since the campaign's start, s.
    pub time_s: f64,
    /// Temperature of the instrument, degrees Celsius.
    pub temp_c: f64,
    /// Blocks that each plateau should have.
    pub blocks: u32,
    /// Scale of the reference at the converter, V/g.
    pub reference_v_per_g: f64,
    /// Whether it counts.
    pub standing: Standing,
}

/// Everything that a record has told so far.
#[derive(Clone, Debug, Default)]
pub struct Ledger {
    reduction: Reduction,
    readings: Vec<Taken>,
    runs: Vec<Shaken>,
    head: String,
    head_parts: Option<(u16, u16)>,
    began_unix_ms: Option<u64>,
    remarks: Vec<String>,
    power_ups: u32,
    next_sample: u64,
}

impl Ledger {
    /// What the record `file` tells, and what it holds.
    ///
    /// # Errors
    /// [`Error::Read`]; a record of two instruments.
    pub fn read(file: &Path) -> Result<(Self, Tally), Error> {
        let mut ledger = Self::default();
        let source = FileSource::open(file)?;
        let tally = record::read_items(source, |item, _| {
            ledger.absorb(&item).map_err(LedgerError::from)
        });
        match tally {
            Ok(tally) => Ok((ledger, tally)),
            Err(error) => Err(error.in_file(file)),
        }
    }

    /// Takes what stands in the record.
    ///
    /// # Errors
    /// As [`Reduction::absorb`].
    pub fn absorb(&mut self, item: &Item<'_>) -> Result<(), ReductionError> {
        match item {
            Item::Event(event) => {
                if let Event::Block(block) = event {
                    if block.first_sample < self.next_sample {
                        self.power_ups += 1;
                    }
                    self.next_sample = block.first_sample;
                    if let Segment::Reading(reading) = block.segment {
                        let power_up = self.power_ups;
                        if let Some(taken) = self.find(reading) {
                            taken.power_up = power_up;
                        }
                    }
                }
                self.reduction.absorb(event)
            }
            Item::Note(note) => {
                self.note(note);
                Ok(())
            }
        }
    }

    fn note(&mut self, note: &Note<'_>) {
        match *note {
            Note::Began { unix_ms } => {
                self.began_unix_ms.get_or_insert(unix_ms);
            }
            Note::Head { part, parts, text } => self.head_part(part, parts, text),
            Note::Reading(reading) => self.reading_begins(&reading),
            Note::ReadingTaken { reading } => self.set_reading(reading, Standing::Whole),
            Note::ReadingWithdrawn { reading } => self.set_reading(reading, Standing::Withdrawn),
            Note::Run(run) => self.run_begins(&run),
            Note::RunTaken { run } => {
                for known in self.runs.iter_mut().filter(|known| known.number == run) {
                    known.standing = Standing::Whole;
                }
            }
            Note::Remark { reading, text } => match reading.and_then(|n| self.find(n)) {
                Some(taken) if taken.remark.is_empty() => taken.remark = text.into(),
                Some(taken) => taken.remark = format!("{}; {text}", taken.remark),
                None => self.remarks.push(text.into()),
            },
        }
    }

    /// The last head that came whole counts.
    fn head_part(&mut self, part: u16, parts: u16, text: &str) {
        if part == 0 {
            self.head.clear();
        }
        self.head.push_str(text);
        let follows = match self.head_parts {
            Some((last, of)) => part == last + 1 && parts == of,
            None => false,
        };
        self.head_parts = (part == 0 || follows).then_some((part, parts));
    }

    fn reading_begins(&mut self, note: &ReadingNote) {
        let position = &note.position;
        // No host writes another number.
        let Ok(series) = Series::try_from(position.series) else {
            return;
        };
        let segment = Segment::Reading(position.reading);
        self.reduction.expect(segment, u64::from(note.blocks));
        // One of that number before did not come to its end.
        self.readings
            .retain(|taken| taken.number != position.reading);
        self.readings.push(Taken {
            number: position.reading,
            dwell: dwell(position, series),
            time_s: note.time_s,
            temp_c: note.temp_c,
            blocks: note.blocks,
            power_up: 0,
            standing: Standing::Begun,
            remark: String::new(),
        });
    }

    fn run_begins(&mut self, note: &RunNote) {
        for plateau in [Plateau::Before, Plateau::During, Plateau::After] {
            let run = Run {
                run: note.run,
                plateau,
            };
            let blocks = u64::from(note.blocks);
            self.reduction.expect(Segment::Run(run), blocks);
        }
        self.runs.retain(|shaken| shaken.number != note.run);
        self.runs.push(Shaken {
            number: note.run,
            shake: Shake {
                kind: match note.random {
                    true => VibrationKind::Random,
                    false => VibrationKind::Sine,
                },
                direction: note.direction,
                level_g: note.level_g,
                f_lo_hz: note.band_hz[0],
                f_hi_hz: note.band_hz[1],
                a0: note.a0,
            },
            time_s: note.time_s,
            temp_c: note.temp_c,
            blocks: note.blocks,
            reference_v_per_g: note.reference_v_per_g,
            standing: Standing::Begun,
        });
    }

    fn find(&mut self, reading: u32) -> Option<&mut Taken> {
        let mut readings = self.readings.iter_mut().rev();
        readings.find(|taken| taken.number == reading)
    }

    fn set_reading(&mut self, reading: u32, standing: Standing) {
        if let Some(taken) = self.find(reading) {
            taken.standing = standing;
        }
    }

    /// Sums of the blocks.
    pub fn reduction(&self) -> &Reduction {
        &self.reduction
    }

    /// The readings that count, in the order in which they were taken: noted as whole, and not cut short by damage to the
    /// record.
    pub fn readings(&self) -> impl Iterator<Item = &Taken> {
        let sound = |taken: &&Taken| {
            taken.standing == Standing::Whole && is_whole(self.reduction.reading(taken.number))
        };
        self.readings.iter().filter(sound)
    }

    /// The runs that count, likewise, in the order in which they were made.
    pub fn runs(&self) -> impl Iterator<Item = &Shaken> {
        let sound = |shaken: &&Shaken| {
            let plateau = |plateau| is_whole(self.reduction.plateau(shaken.number, plateau));
            shaken.standing == Standing::Whole
                && [Plateau::Before, Plateau::During, Plateau::After]
                    .into_iter()
                    .all(plateau)
        };
        self.runs.iter().filter(sound)
    }

    /// Whether no reading and no run counts.
    pub fn is_empty(&self) -> bool {
        self.readings().next().is_none() && self.runs().next().is_none()
    }

    /// Readings and runs that were begun and are not whole.
    pub fn begun(&self) -> usize {
        let withdrawn = |taken: &&Taken| taken.standing == Standing::Withdrawn;
        let withdrawn = self.readings.iter().filter(withdrawn).count();
        let counted = self.readings().count() + self.runs().count();
        self.readings.len() + self.runs.len() - withdrawn - counted
    }

    /// Number of the next reading: none is used twice.
    pub fn next_reading(&self) -> u32 {
        let last = self.readings.iter().map(|taken| taken.number).max();
        last.map_or(0, |last| last.saturating_add(1))
    }

    /// The reading that was begun last.
    pub fn last_reading(&self) -> Option<&Taken> {
        self.readings.last()
    }

    /// The text of campaign.toml, if the record has it whole.
    pub fn head(&self) -> Option<&str> {
        let whole = self
            .head_parts
            .is_some_and(|(part, parts)| part + 1 == parts);
        whole.then_some(self.head.as_str())
    }

    /// When the capture began, milliseconds since 1970-01-01 UTC.
    pub fn began_unix_ms(&self) -> Option<u64> {
        self.began_unix_ms
    }

    /// What the person remarked on the test as a whole.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// Whether the instrument was switched on anew while readings were taken.
    pub fn was_restarted(&self) -> bool {
        let mut power_ups = self.readings().map(|taken| taken.power_up);
        let first = power_ups.next();
        power_ups.any(|power_up| Some(power_up) != first)
    }
}

/// Whether a segment has something of each of its quarters.
fn is_whole(sums: Option<&SegmentSums>) -> bool {
    sums.is_some_and(|sums| sums.half_difference().is_some())
}

fn dwell(position: &Position, series: Series) -> Dwell {
    Dwell {
        series,
        dial_deg: position.dial_deg,
        mount_deg: position.mount_deg,
        approach: match position.approach {
            message::Approach::Cw => Approach::Clockwise,
            message::Approach::Ccw => Approach::CounterClockwise,
        },
    }
}
