//! A CSV table with columns found by name, read row by row, whose errors name file, row and column.

use std::collections::{HashSet, VecDeque};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use csv::StringRecord;

use super::ranges::Range;
use crate::error::{Error, Place, Problem, printable};

/// Most rows that a table may have. A campaign has some hundreds; a file of millions is not one.
pub const MAX_ROWS: u64 = 100_000;

/// Most bytes that one row may have, so that a file without line ends does not fill the memory.
pub const MAX_ROW_BYTES: usize = 1 << 20;

/// An open table.
pub(super) struct Table {
    file: PathBuf,
    columns: Vec<String>,
    reader: csv::Reader<RowSource<File>>,
    rows: u64,
}

impl Table {
    /// Opens `file` and reads its header, which must hold the `required` columns, of the groups that come `together` all
    /// or none, and none twice.
    pub(super) fn open(
        file: &Path,
        required: &[&str],
        together: &[&[&str]],
    ) -> Result<Self, Error> {
        let source = File::open(file).map_err(Error::read(file))?;
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_reader(RowSource::new(source));
        let header = reader
            .headers()
            .map_err(|error| read_error(file, &[], error, Some(1)))?;
        let columns: Vec<String> = header.iter().map(str::to_owned).collect();
        if columns.iter().all(|name| name.is_empty()) {
            return Err(Error::input(file, Problem::EmptyFile));
        }
        let place = |column: &str| Place {
            column: Some(column.into()),
            ..Place::file(file)
        };
        let mut seen = HashSet::new();
        if let Some(twice) = columns.iter().find(|name| !seen.insert(name.as_str())) {
            return Err(Error::Input {
                place: place(twice),
                problem: Problem::DuplicateColumn,
            });
        }
        let missing = required.iter().copied().chain(
            together
                .iter()
                .filter(|group| group.iter().any(|name| seen.contains(name)))
                .flat_map(|group| group.iter().copied()),
        );
        let missing: Vec<&str> = missing.filter(|name| !seen.contains(name)).collect();
        match missing.as_slice() {
            [] => {}
            [only] => {
                return Err(Error::Input {
                    place: place(only),
                    problem: Problem::MissingColumn,
                });
            }
            several => {
                let names = several.iter().map(|name| (*name).to_owned());
                return Err(Error::input(file, Problem::MissingColumns(names.collect())));
            }
        }
        Ok(Self {
            file: file.into(),
            columns,
            reader,
            rows: 0,
        })
    }

    /// The next row, or none after the last. A table without rows, or with more than [`MAX_ROWS`], is an
    /// error.
    pub(super) fn next_row(&mut self) -> Result<Option<Row<'_>>, Error> {
        let byte = self.reader.position().byte();
        self.reader.get_mut().begin_row(byte);
        let mut record = StringRecord::new();
        let more = self.reader.read_record(&mut record).map_err(|error| {
            let line = error
                .position()
                .and_then(|at| self.reader.get_ref().line(at));
            read_error(&self.file, &self.columns, error, line)
        })?;
        if !more {
            return match self.rows {
                0 => Err(Error::input(&self.file, Problem::NoRows)),
                _ => Ok(None),
            };
        }
        self.rows += 1;
        if self.rows > MAX_ROWS {
            return Err(Error::input(&self.file, Problem::TooManyRows(MAX_ROWS)));
        }
        Ok(Some(Row {
            table: self,
            record,
        }))
    }
}

/// One row of a table.
pub(super) struct Row<'t> {
    table: &'t Table,
    record: StringRecord,
}

impl Row<'_> {
    /// Line number in the file; the header is line 1.
    pub(super) fn line(&self) -> u64 {
        let source = self.table.reader.get_ref();
        let position = self.record.position();
        position.and_then(|at| source.line(at)).unwrap_or(0)
    }

    /// An error at `column` of this row.
    pub(super) fn error(&self, column: &str, problem: impl Into<Problem>) -> Error {
        let place = Place {
            file: self.table.file.clone(),
            row: Some(self.line()),
            column: Some(column.into()),
        };
        Error::Input {
            place,
            problem: problem.into(),
        }
    }

    /// The cell's text; `None` if it is empty or the table has no such column.
    pub(super) fn text(&self, column: &str) -> Option<&str> {
        let index = self.table.columns.iter().position(|name| name == column)?;
        self.record.get(index).filter(|cell| !cell.is_empty())
    }

    /// The text of a cell that must not be empty.
    pub(super) fn required(&self, column: &str) -> Result<&str, Error> {
        self.text(column)
            .ok_or_else(|| self.error(column, Problem::Empty))
    }

    /// A number within its range.
    pub(super) fn number(&self, column: &str, range: &'static Range) -> Result<f64, Error> {
        let text = self.required(column)?;
        let value: f64 = text
            .parse()
            .map_err(|_| self.error(column, Problem::NotANumber(text.into())))?;
        if !value.is_finite() {
            return Err(self.error(column, Problem::NotFinite(text.into())));
        }
        range
            .check(value)
            .map_err(|problem| self.error(column, problem))
    }

    /// A number within its range; `None` if the cell is empty or the table has no such column.
    pub(super) fn optional(
        &self,
        column: &str,
        range: &'static Range,
    ) -> Result<Option<f64>, Error> {
        let filled = self.text(column).is_some();
        filled.then(|| self.number(column, range)).transpose()
    }

    /// Three numbers within one range.
    pub(super) fn numbers(
        &self,
        columns: [&str; 3],
        range: &'static Range,
    ) -> Result<[f64; 3], Error> {
        let [i, p, o] = columns;
        Ok([
            self.number(i, range)?,
            self.number(p, range)?,
            self.number(o, range)?,
        ])
    }

    /// Text that people see; `None` if the cell is empty or the table has no such column.
    pub(super) fn words(&self, column: &str) -> Option<String> {
        self.text(column)
            .map(printable)
            .filter(|text| !text.is_empty())
    }

    /// `yes`, or `no` which an empty cell means too.
    pub(super) fn flag(&self, column: &str) -> Result<bool, Error> {
        match self.text(column) {
            Some(_) => self.one_of(column, &[("yes", true), ("no", false)], "yes or no"),
            None => Ok(false),
        }
    }

    /// A whole number, not negative.
    pub(super) fn index(&self, column: &str) -> Result<u64, Error> {
        let text = self.required(column)?;
        text.parse().map_err(|_| {
            let expected = "a whole number from 0 on";
            self.error(
                column,
                Problem::NotOneOf {
                    value: text.into(),
                    expected,
                },
            )
        })
    }

    /// One of a few words in capitals or not, given with what they stand for; `expected` lists them for the error.
    pub(super) fn one_of<T: Copy>(
        &self,
        column: &str,
        words: &[(&str, T)],
        expected: &'static str,
    ) -> Result<T, Error> {
        let text = self.required(column)?;
        words
            .iter()
            .find(|(word, _)| word.eq_ignore_ascii_case(text))
            .map(|&(_, meaning)| meaning)
            .ok_or_else(|| {
                self.error(
                    column,
                    Problem::NotOneOf {
                        value: text.into(),
                        expected,
                    },
                )
            })
    }

    /// Names and cells of the columns that are not among the `known`.
    pub(super) fn unknown(&self, known: &[&str]) -> Vec<(String, String)> {
        std::iter::zip(&self.table.columns, &self.record)
            .filter(|(name, _)| !known.contains(&name.as_str()))
            .map(|(name, cell)| (name.clone(), cell.to_owned()))
            .collect()
    }
}

/// `line` is where the row stands, [`RowSource::line`] of the error's position.
pub(crate) fn read_error(
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
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => Error::Input {
            place: place(None),
            problem: Problem::RaggedRow {
                found: *len,
                expected: *expected_len,
            },
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
/// is wrong after CR LF and after blank lines.
pub(crate) struct RowSource<R> {
    source: R,
    since_row: usize,
    /// What was read and may still be asked for, in order.
    chunks: VecDeque<Vec<u8>>,
    /// Offset of the first chunk in the file.
    start: u64,
    /// Line at that offset, from 1.
    line: u64,
    /// The byte before it.
    before: u8,
}

impl<R> RowSource<R> {
    pub(crate) fn new(source: R) -> Self {
        Self::from_line(source, 1)
    }

    /// Of a source that begins with a later line of its file.
    pub(crate) fn from_line(source: R, line: u64) -> Self {
        Self {
            source,
            since_row: 0,
            chunks: VecDeque::new(),
            start: 0,
            line,
            before: 0,
        }
    }

    /// To be called before each row; `byte` is where the CSV reader stands.
    pub(crate) fn begin_row(&mut self, byte: u64) {
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

    /// Line of the row that the CSV reader found at `position`, from 1: blank lines before it are not of it. `None` of a row
    /// that was left behind.
    pub(crate) fn line(&self, position: &csv::Position) -> Option<u64> {
        let until = position.byte().checked_sub(self.start)?;
        let (mut line, mut before) = (self.line, self.before);
        for (offset, &next) in self.chunks.iter().flatten().enumerate() {
            if offset as u64 >= until && !matches!(next, b'\r' | b'\n') {
                break;
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

impl<R: Read> Read for RowSource<R> {
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
