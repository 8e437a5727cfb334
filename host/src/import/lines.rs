//! The lines of a file behind the CSV reader, and what it says when it cannot go on.

use std::collections::VecDeque;
use std::io::{self, Read};
use std::path::Path;

use crate::error::{Error, Place, Problem};

/// Most bytes that one row may have, so that a file without line ends does not fill the memory.
pub const MAX_ROW_BYTES: usize = 1 << 20;

/// Begins a line that is a comment.
pub(super) const COMMENT: u8 = b'#';

/// `line` is where the row stands, [`Lines::line`] of the error's position.
pub(super) fn read_error(
    file: &Path,
    columns: &[String],
    error: csv::Error,
    line: Option<u64>,
) -> Error {
    let place = |column: Option<usize>| Place {
        file: file.into(),
        row: line,
        column: column.and_then(|index| columns.get(index)).cloned(),
    };
    match error.kind() {
        csv::ErrorKind::Utf8 { err, .. } => Error::Input {
            place: place(Some(err.field())),
            problem: Problem::NotUtf8,
        },
        _ => match error.into_kind() {
            csv::ErrorKind::Io(source) => Error::Read {
                file: file.into(),
                source,
            },
            other => Error::input(file, format!("{other:?}")),
        },
    }
}

/// A source of rows that gives up when a row does not end, and knows the file's lines. The CSV reader's own count of lines
/// is wrong after CR LF, blank lines and comments.
pub(super) struct Lines<R> {
    source: R,
    since_row: usize,
    /// Whether the CSV reader passes over lines of comment.
    comments: bool,
    /// What was read and may still be asked for, in order.
    chunks: VecDeque<Vec<u8>>,
    /// Offset of the first chunk in the file.
    start: u64,
    /// Line at that offset, from 1.
    line: u64,
    /// The byte before it.
    before: u8,
}

impl<R> Lines<R> {
    /// Of a source that begins with the `line` of its file.
    pub(super) fn new(source: R, line: u64, comments: bool) -> Self {
        Self {
            source,
            since_row: 0,
            comments,
            chunks: VecDeque::new(),
            start: 0,
            line,
            before: 0,
        }
    }

    /// To be called before each row; `byte` is where the CSV reader stands.
    pub(super) fn begin_row(&mut self, byte: u64) {
        self.since_row = 0;
        while let Some(chunk) = self.chunks.front()
            && self.start + chunk.len() as u64 <= byte
        {
            for &next in chunk {
                self.line += u64::from(ends_line(self.before, next));
                self.before = next;
            }
            self.start += chunk.len() as u64;
            self.chunks.pop_front();
        }
    }

    /// Line of the row that the CSV reader found at `position`, from 1: blank lines and comments before it are not of it.
    /// `None` of a row that was left behind.
    pub(super) fn line(&self, position: &csv::Position) -> Option<u64> {
        let until = position.byte().checked_sub(self.start)?;
        let (mut line, mut before) = (self.line, self.before);
        let mut comment = false;
        for (offset, &next) in self.chunks.iter().flatten().enumerate() {
            let line_end = matches!(next, b'\r' | b'\n');
            if offset as u64 >= until {
                comment = !line_end && (comment || (self.comments && next == COMMENT));
                if !line_end && !comment {
                    break;
                }
            }
            line += u64::from(ends_line(before, next));
            before = next;
        }
        Some(line)
    }
}

/// Whether `next` ends a line: a line feed, or a carriage return which a line feed may follow.
fn ends_line(before: u8, next: u8) -> bool {
    next == b'\r' || (next == b'\n' && before != b'\r')
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.since_row > MAX_ROW_BYTES {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                format!("a row has more than {MAX_ROW_BYTES} bytes"),
            ));
        }
        let count = self.source.read(buffer)?;
        self.since_row += count;
        self.chunks
            .extend((count > 0).then(|| buffer[..count].to_vec()));
        Ok(count)
    }
}
