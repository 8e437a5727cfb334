//! The rows of a table, whoever wrote it: delimited text in any dialect, or a sheet of a workbook.

use std::fs::File;
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};

use csv::ByteRecord;

use super::dialect::{self, Dialect, IsColumn};
use super::lines::{Lines, read_error};
use super::workbook::Sheet;
use crate::error::{Error, Place, Problem};

/// An open table, its header read.
pub struct Source {
    file: PathBuf,
    dialect: Dialect,
    header: Vec<String>,
    header_is_utf8: bool,
    rows: Rows,
}

enum Rows {
    Text(Box<csv::Reader<Lines<File>>>),
    Sheet(std::vec::IntoIter<(u64, Vec<String>)>),
}

impl Source {
    /// Opens `file` behind the header that names the most `wanted` columns.
    ///
    /// # Errors
    /// Unreadable, without a header, or a column that stands in it twice.
    pub(crate) fn open(file: &Path, wanted: &[&str], is_column: IsColumn) -> Result<Self, Error> {
        let (dialect, sheet) = Dialect::find(file, wanted, is_column)?;
        let (header, rows) = match sheet {
            Some(sheet) => of_sheet(&dialect, sheet),
            None => of_text(file, &dialect)?,
        };
        let header_is_utf8 = header.iter().all(|cell| std::str::from_utf8(cell).is_ok());
        let header: Vec<String> = header.iter().map(dialect::text).collect();
        if header.iter().all(String::is_empty) {
            return Err(Error::input(file, Problem::EmptyFile));
        }
        let mut source = Self {
            file: file.into(),
            dialect,
            header,
            header_is_utf8,
            rows,
        };
        if source.dialect.units_row {
            source.read(&mut ByteRecord::new())?;
        }
        Ok(source)
    }

    /// How the table is written.
    pub(crate) fn dialect(&self) -> &Dialect {
        &self.dialect
    }

    /// Names of the columns, as they are written.
    pub(crate) fn header(&self) -> &[String] {
        &self.header
    }

    /// Whether they are UTF-8; they were taken as Latin-1 otherwise.
    pub(crate) fn header_is_utf8(&self) -> bool {
        self.header_is_utf8
    }

    /// The next row into `record`; false after the last. Every row has the header's cells: further ones must be empty, and
    /// those that are not there belong to columns without a name.
    pub(crate) fn read(&mut self, record: &mut ByteRecord) -> Result<bool, Error> {
        let more = match &mut self.rows {
            Rows::Sheet(rows) => {
                record.clear();
                let next = rows.next();
                if let Some((number, cells)) = &next {
                    cells
                        .iter()
                        .for_each(|cell| record.push_field(cell.as_bytes()));
                    let mut position = csv::Position::new();
                    position.set_line(*number);
                    record.set_position(Some(position));
                }
                Ok(next.is_some())
            }
            Rows::Text(reader) => {
                let byte = reader.position().byte();
                reader.get_mut().begin_row(byte);
                reader.read_byte_record(record)
            }
        };
        let more = more.map_err(|error| {
            let line = error.position().and_then(|at| self.line_at(at));
            read_error(&self.file, &self.header, error, line)
        })?;
        if more && record.len() != self.header.len() {
            self.check_length(record)?;
        }
        Ok(more)
    }

    fn check_length(&self, record: &ByteRecord) -> Result<(), Error> {
        let (found, expected) = (record.len(), self.header.len());
        let further = record.iter().skip(expected).all(<[u8]>::is_empty);
        let nameless = self.header.iter().skip(found).all(String::is_empty);
        if further && nameless {
            return Ok(());
        }
        let place = Place {
            row: self.line(record),
            ..Place::file(&self.file)
        };
        let problem = Problem::RaggedRow {
            found: found as u64,
            expected: expected as u64,
            commas: self.dialect.delimiter == b',' && found > expected,
        };
        Err(Error::Input { place, problem })
    }

    /// Line of a row in the file, from 1.
    pub(crate) fn line(&self, record: &ByteRecord) -> Option<u64> {
        self.line_at(record.position()?)
    }

    fn line_at(&self, position: &csv::Position) -> Option<u64> {
        match &self.rows {
            Rows::Text(reader) => reader.get_ref().line(position),
            Rows::Sheet(_) => Some(position.line()),
        }
    }
}

fn of_sheet(dialect: &Dialect, sheet: Sheet) -> (ByteRecord, Rows) {
    let mut rows = sheet.rows;
    rows.retain(|(number, cells)| {
        *number > dialect.header_line
            && !(dialect.comments && cells.first().is_some_and(|cell| cell.starts_with('#')))
    });
    let header = ByteRecord::from(dialect.names.clone());
    (header, Rows::Sheet(rows.into_iter()))
}

fn of_text(file: &Path, dialect: &Dialect) -> Result<(ByteRecord, Rows), Error> {
    let mut source = File::open(file).map_err(Error::read(file))?;
    let start = SeekFrom::Start(dialect.skipped);
    source.seek(start).map_err(Error::read(file))?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .flexible(true)
        .delimiter(dialect.delimiter)
        .comment(dialect.comments.then_some(super::lines::COMMENT))
        .from_reader(Lines::new(source, dialect.header_line, dialect.comments));
    let header = reader
        .byte_headers()
        .map_err(|error| read_error(file, &[], error, Some(dialect.header_line)))?;
    Ok((header.clone(), Rows::Text(Box::new(reader))))
}
