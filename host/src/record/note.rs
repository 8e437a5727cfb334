//! What the host adds to a record: what the person at the bench knows and the instrument does not.
//!
//! A note stands in a frame like an event, under a version of its own that no instrument speaks. A reader that does not
//! know notes counts them as foreign frames and reads on. Append-only, as the messages of the line: variants are never
//! moved, changed or removed, since postcard numbers them by their order, and no field is ever added; what is new is a new
//! variant at the end.

use serde::{Deserialize, Serialize};
use shared::wire::framing::{EncodeError, Frame};
use shared::wire::message::{Message, Position};
use shared::wire::version::Version;

/// The version under which notes stand; the line's versions stay below.
pub const NOTES: Version = Version(0x80);

/// Most bytes of text in one note: what is longer goes into several.
pub const MAX_TEXT: usize = 600;

/// One note.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Note<'a> {
    /// A capture begins, or goes on after it was stopped.
    Began {
        /// Milliseconds since 1970-01-01 UTC by the host's clock.
        unix_ms: u64,
    },
    /// A piece of campaign.toml as it was then; the pieces follow each other, the first is number 0.
    Head {
        /// Number of the piece.
        part: u16,
        /// How many there are.
        parts: u16,
        /// The piece.
        text: &'a str,
    },
    /// A reading begins: the blocks of its number are taken under these conditions.
    Reading(ReadingNote),
    /// The reading of that number is whole: it counts.
    ReadingTaken {
        /// Its number.
        reading: u32,
    },
    /// The reading of that number counts no longer: it was taken once more, or is known to be wrong.
    ReadingWithdrawn {
        /// Its number.
        reading: u32,
    },
    /// A shaker run begins: the blocks of its number are taken under these conditions.
    Run(RunNote),
    /// The run of that number is whole: it counts.
    RunTaken {
        /// Its number.
        run: u32,
    },
    /// What the person remarks.
    Remark {
        /// The reading that it is about, or the test as a whole.
        reading: Option<u32>,
        /// In the person's words.
        text: &'a str,
    },
}

/// Conditions of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReadingNote {
    /// Number of the reading, and where the dial stands.
    pub position: Position,
    /// Time of its centre since the campaign's start, s.
    pub time_s: f64,
    /// Temperature of the instrument, degrees Celsius.
    pub temp_c: f64,
    /// Blocks that it is going to have.
    pub blocks: u32,
}

/// Conditions of a shaker run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunNote {
    /// Number of the run.
    pub run: u32,
    /// Gaussian and flat over the band, or a sine.
    pub random: bool,
    /// Unit vector of the motion on IA, PA, OA.
    pub direction: [f64; 3],
    /// Peak (sine) or rms (random), g.
    pub level_g: f64,
    /// Edges of the band, or the sine's frequency twice, Hz.
    pub band_hz: [f64; 2],
    /// Gravity on IA, PA, OA, in units of local gravity.
    pub a0: [f64; 3],
    /// Time of the centre of the plateau before since the campaign's start, s.
    pub time_s: f64,
    /// Temperature of the instrument, degrees Celsius.
    pub temp_c: f64,
    /// Blocks that each plateau is going to have.
    pub blocks: u32,
    /// Sensitivity of the reference at the converter, V/g.
    pub reference_v_per_g: f64,
}

impl Message for Note<'_> {
    fn version(&self) -> Version {
        NOTES
    }
}

impl Note<'_> {
    /// The note as it stands in a record, delimiter included.
    ///
    /// # Errors
    /// A text longer than a frame takes.
    pub fn frame(&self) -> Result<Frame, EncodeError> {
        let mut frame = Frame::new();
        frame.encode(self, 0)?;
        Ok(frame)
    }
}

/// A text in pieces of at most `MAX_TEXT` bytes, cut between characters; at least one.
pub fn pieces(text: &str) -> Vec<&str> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while rest.len() > MAX_TEXT {
        let (piece, more) = rest.split_at(rest.floor_char_boundary(MAX_TEXT));
        pieces.push(piece);
        rest = more;
    }
    pieces.push(rest);
    pieces
}
