//! What can go wrong, and the exit status that says so: 2 for bad usage or bad input, 1 for the rest.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Any failure of a command. Displays as one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file that was read is not what it should be.
    #[error("{place}: {problem}")]
    Input {
        /// File, row and column of the trouble, as far as known.
        place: Place,
        /// What is wrong there.
        problem: Problem,
    },
    /// A file could not be opened or read.
    #[error("{}: cannot be read: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// A result could not be written.
    #[error("{}: cannot be written: {source}", file.display())]
    Write {
        /// The file or folder.
        file: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// An instrument does not answer as it should, or no longer.
    #[error("{source_name}: {problem}")]
    Link {
        /// The port, as the user named it.
        source_name: String,
        /// What is wrong.
        problem: String,
    },
    /// The instrument's self-check came to something else than the same computation here.
    #[error("instrument and host disagree by {0:.1e} of a coefficient")]
    Disagreement(f64),
    /// A picture of the report could not be drawn.
    #[error("a picture cannot be drawn: {0}")]
    Picture(String),
    /// A number of a result is none, or one that cannot be: a fault of this program.
    #[error(
        "the result's {field} came to {value:e}, which cannot be; nothing was written. Please report it, with the input"
    )]
    Absurd {
        /// Path of the field, as `which[0].probability`.
        field: String,
        /// The number.
        value: f64,
    },
    /// The person or the system ended the command before its end; the sentence says what there is.
    #[error("{0}")]
    Stopped(String),
    /// The command cannot be carried out as it was asked.
    #[error("{0}")]
    Usage(String),
}

impl Error {
    /// Bad content of `file` as a whole.
    pub fn input(file: &Path, problem: impl Into<Problem>) -> Self {
        Self::Input {
            place: Place::file(file),
            problem: problem.into(),
        }
    }

    /// `map_err` argument for failed reads of `file`.
    pub fn read(file: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Read {
            file: file.into(),
            source,
        }
    }

    /// `map_err` argument for failed writes of `file`.
    pub fn write(file: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Write {
            file: file.into(),
            source,
        }
    }

    /// The exit status of the command: 2 for bad usage or bad input, 1 for anything else.
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Input { .. } | Self::Read { .. } | Self::Usage(_) => 2,
            Self::Write { .. }
            | Self::Picture(_)
            | Self::Link { .. }
            | Self::Disagreement(_)
            | Self::Absurd { .. }
            | Self::Stopped(_) => 1,
        }
    }

    /// Whether the reader of standard output went away, which is no failure of ours.
    pub fn is_broken_pipe(&self) -> bool {
        matches!(self, Self::Write { source, .. } if source.kind() == io::ErrorKind::BrokenPipe)
    }
}

/// Where in the input the trouble is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub file: PathBuf,
    /// Line number in the file, from 1; the header is row 1.
    pub row: Option<u64>,
    /// Name of the column, or of the key.
    pub column: Option<String>,
}

impl Place {
    /// The file as a whole.
    pub fn file(file: &Path) -> Self {
        Self {
            file: file.into(),
            row: None,
            column: None,
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(row) = self.row {
            write!(f, ", row {row}")?;
        }
        if let Some(column) = &self.column {
            write!(f, ", column {}", clip(column))?;
        }
        Ok(())
    }
}

/// What is wrong with a piece of input.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// A cell that must be filled is empty.
    #[error("is empty")]
    Empty,
    /// The text does not read as a number.
    #[error("\"{}\" is not a number{}", clip(.0), if is_with_comma(.0) { "; its decimal sign must be a point here" } else { "" })]
    NotANumber(String),
    /// NaN, an infinity, or a number beyond the range of a double.
    #[error("\"{}\" is not a finite number", clip(.0))]
    NotFinite(String),
    /// A number outside of its range, both ends allowed.
    #[error("{} is outside of {} to {}", with_unit(*value, unit), decimal(*low), with_unit(*high, unit))]
    OutOfRange {
        /// The number.
        value: f64,
        /// Least that it can be.
        low: f64,
        /// Most that it can be.
        high: f64,
        /// Unit of all three; empty for a pure number.
        unit: &'static str,
    },
    /// A number nearer to zero than it can be.
    #[error("{} is {}at least {} in magnitude", with_unit(*value, unit), if *zero { "neither 0 nor " } else { "not " }, with_unit(*smallest, unit))]
    TooSmall {
        /// The number.
        value: f64,
        /// Smallest magnitude that it can have.
        smallest: f64,
        /// Whether it could be zero.
        zero: bool,
        /// Unit of both; empty for a pure number.
        unit: &'static str,
    },
    /// A word or number that is not among those allowed.
    #[error("\"{}\" is not {expected}", clip(value))]
    NotOneOf {
        /// The text found.
        value: String,
        /// The allowed ones, as a phrase.
        expected: &'static str,
    },
    /// A required column of a table is not there.
    #[error("is missing from the header")]
    MissingColumn,
    /// Several required columns of a table are not there.
    #[error("columns {} are missing from the header", .0.join(", "))]
    MissingColumns(Vec<String>),
    /// A key that is not known, and too like a known one to be meant otherwise.
    #[error("is not known; is {known} meant?")]
    LikeKnownKey {
        /// The known key, with its table.
        known: String,
    },
    /// A column stands in the header twice.
    #[error("stands in the header twice")]
    DuplicateColumn,
    /// Bytes that are not UTF-8, as from an editor that saves Latin-1.
    #[error("is not UTF-8 text; save the file as UTF-8")]
    NotUtf8,
    /// A row with more or fewer cells than the header.
    #[error("has {found} cells, the header {expected}{}", if *commas { "; where commas are decimal signs, separate cells by semicolons" } else { "" })]
    RaggedRow {
        /// Cells in the row.
        found: u64,
        /// Cells in the header.
        expected: u64,
        /// Whether commas part the cells, and too many do.
        commas: bool,
    },
    /// A table without a single row under its header.
    #[error("has no rows")]
    NoRows,
    /// A file with nothing in it.
    #[error("is an empty file")]
    EmptyFile,
    /// More rows than a campaign can sensibly have.
    #[error("has more than {0} rows")]
    TooManyRows(u64),
    /// The same sequence or run number twice: as after joining the tables of two instruments.
    #[error("{number} stands already in row {earlier_row}; are two tables joined?")]
    Repeated {
        /// The number.
        number: u64,
        /// Where it stood first.
        earlier_row: u64,
    },
    /// A row of another instrument than that of the campaign.
    #[error(
        "\"{}\" is another instrument than \"{}\" of campaign.toml",
        clip(found),
        clip(expected)
    )]
    OtherInstrument {
        /// Serial number in the row.
        found: String,
        /// Serial number of the campaign.
        expected: String,
    },
    /// A sentence of its own, for what happens in one place only.
    #[error("{0}")]
    Other(String),
}

impl From<String> for Problem {
    fn from(sentence: String) -> Self {
        Self::Other(sentence)
    }
}

impl From<&str> for Problem {
    fn from(sentence: &str) -> Self {
        Self::Other(sentence.into())
    }
}

/// Whether a comma alone keeps a text from being a number.
fn is_with_comma(text: &str) -> bool {
    text.contains(',') && text.replacen(',', ".", 1).parse::<f64>().is_ok()
}

/// A number as a person writes it: very large and very small ones with an exponent.
pub fn decimal(value: f64) -> String {
    match value.abs() {
        size if size == 0.0 || (1e-4..1e6).contains(&size) => value.to_string(),
        _ => format!("{value:e}"),
    }
}

fn with_unit(value: f64, unit: &str) -> String {
    match unit {
        "" => decimal(value),
        _ => format!("{} {unit}", decimal(value)),
    }
}

/// Text from a file without the characters that steer a terminal: controls, and those that turn the direction of writing.
pub fn printable(text: &str) -> String {
    let steers = |c: char| {
        c.is_control()
            || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    text.chars().filter(|c| !steers(*c)).collect()
}

/// Text from outside, made safe for one line of a terminal: escaped, and cut after 40 characters.
pub fn clip(text: &str) -> String {
    let mut shown: String = text.chars().take(40).flat_map(char::escape_debug).collect();
    if text.chars().nth(40).is_some() {
        shown.push_str("...");
    }
    shown
}
