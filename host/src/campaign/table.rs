//! A table with columns found by name, read row by row, whose errors name file, row and column.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use csv::{ByteRecord, StringRecord};

use super::columns::Heading;
use super::ranges::Range;
use crate::error::{Error, Place, Problem, printable};
use crate::import::{Conversion, Source, iso_time};

/// Most rows that a table may have. A campaign has some hundreds; a file of millions is not one.
pub const MAX_ROWS: u64 = 100_000;

/// An open table.
pub(super) struct Table {
    file: PathBuf,
    columns: Vec<Column>,
    source: Source,
    rows: u64,
}

/// A column as it is written, and what it is.
struct Column {
    /// As the header writes it, for errors.
    written: String,
    /// The name of the campaign's format; as written where that knows none.
    name: String,
    /// From the unit that is written to that of the name.
    conversion: Conversion,
}

impl Table {
    /// Opens `file` and reads its header, which must hold the `required` columns, of the groups that come `together` all
    /// or none, and none twice.
    pub(super) fn open(
        file: &Path,
        required: &[&str],
        together: &[&[&str]],
    ) -> Result<Self, Error> {
        let is_column = |cell: &str, name: &str| Heading::parse(cell).is(name);
        let source = Source::open(file, required, is_column)?;
        let columns = columns(file, &source)?;
        let place = |column: &str| Place {
            column: Some(column.into()),
            ..Place::file(file)
        };
        let mut seen = HashSet::new();
        let mut named = columns.iter().filter(|column| !column.name.is_empty());
        if let Some(twice) = named.find(|column| !seen.insert(column.name.as_str())) {
            return Err(Error::Input {
                place: place(&twice.name),
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
            source,
            rows: 0,
        })
    }

    /// The next row that is not blank, or none after the last. A table without rows, or with more than [`MAX_ROWS`], is an
    /// error.
    pub(super) fn next_row(&mut self) -> Result<Option<Row<'_>>, Error> {
        let mut record = ByteRecord::new();
        loop {
            if !self.source.read(&mut record)? {
                return match self.rows {
                    0 => Err(Error::input(&self.file, Problem::NoRows)),
                    _ => Ok(None),
                };
            }
            if record.iter().any(|cell| !cell.is_empty()) {
                break;
            }
        }
        self.rows += 1;
        if self.rows > MAX_ROWS {
            return Err(Error::input(&self.file, Problem::TooManyRows(MAX_ROWS)));
        }
        let line = self.source.line(&record);
        let record = StringRecord::from_byte_record(record).map_err(|error| {
            let column = self.columns.get(error.utf8_error().field());
            let place = Place {
                file: self.file.clone(),
                row: line,
                column: column.map(|column| column.written.clone()),
            };
            let problem = Problem::NotUtf8;
            Error::Input { place, problem }
        })?;
        Ok(Some(Row {
            table: self,
            record,
            line: line.unwrap_or(0),
        }))
    }
}

/// The columns of a header, each with its unit where the header or a row under it states one.
fn columns(file: &Path, source: &Source) -> Result<Vec<Column>, Error> {
    let dialect = source.dialect();
    let place = |column: Option<&str>| Place {
        file: file.into(),
        row: Some(dialect.header_line),
        column: column.map(str::to_owned),
    };
    if !source.header_is_utf8() {
        return Err(Error::Input {
            place: place(None),
            problem: Problem::NotUtf8,
        });
    }
    let column = |(index, written): (usize, &String)| {
        let mut heading = Heading::parse(written);
        if let Some(unit) = dialect.units.get(index) {
            heading = heading.with_unit(unit);
        }
        let (name, conversion) = heading.resolve().map_err(|problem| Error::Input {
            place: place(Some(written)),
            problem,
        })?;
        Ok(Column {
            name: name.map_or_else(|| written.clone(), str::to_owned),
            written: written.clone(),
            conversion,
        })
    };
    source.header().iter().enumerate().map(column).collect()
}

/// One row of a table.
pub(super) struct Row<'t> {
    table: &'t Table,
    record: StringRecord,
    line: u64,
}

impl Row<'_> {
    /// Line number in the file, or row of the sheet; the header is line 1 where nothing stands before it.
    pub(super) fn line(&self) -> u64 {
        self.line
    }

    /// An error at `column` of this row.
    pub(super) fn error(&self, column: &str, problem: impl Into<Problem>) -> Error {
        let written = self.table.columns.iter().find(|known| known.name == column);
        let place = Place {
            file: self.table.file.clone(),
            row: Some(self.line()),
            column: Some(written.map_or(column, |known| &known.written).into()),
        };
        Error::Input {
            place,
            problem: problem.into(),
        }
    }

    fn index_of(&self, column: &str) -> Option<usize> {
        let mut columns = self.table.columns.iter();
        columns.position(|known| known.name == column)
    }

    /// The cell's text; `None` if it is empty or the table has no such column.
    pub(super) fn text(&self, column: &str) -> Option<&str> {
        let index = self.index_of(column)?;
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
        let number = self.table.source.dialect().number(text);
        let time_s = || match range.unit {
            "s" => iso_time(text).map(|(day, seconds)| 86_400.0 * day as f64 + seconds),
            _ => None,
        };
        let value = match number {
            Some(number) if number.is_finite() => self.converted(column, number),
            Some(_) => return Err(self.error(column, Problem::NotFinite(text.into()))),
            None => time_s().ok_or_else(|| self.error(column, Problem::NotANumber(text.into())))?,
        };
        range
            .check(value)
            .map_err(|problem| self.error(column, problem))
    }

    fn converted(&self, column: &str, number: f64) -> f64 {
        let column = self
            .index_of(column)
            .map(|index| &self.table.columns[index]);
        column.map_or(number, |column| column.conversion.of(number))
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

    /// Names and cells of the columns that are not among the `known`, but for cells of no name that are empty.
    pub(super) fn unknown(&self, known: &[&str]) -> Vec<(String, String)> {
        std::iter::zip(&self.table.columns, &self.record)
            .filter(|(column, cell)| !(column.name.is_empty() && cell.is_empty()))
            .filter(|(column, _)| !known.contains(&column.name.as_str()))
            .map(|(column, cell)| (column.name.clone(), cell.to_owned()))
            .collect()
    }
}
