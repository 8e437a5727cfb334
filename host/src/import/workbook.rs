//! A sheet of a workbook, XLSX, XLS or ODS, as rows of text.

use std::io::Cursor;
use std::path::Path;

use calamine::{Data, Reader, open_workbook_auto_from_rs};

use crate::error::Error;
use crate::input::read_at_most;

/// Most bytes of a workbook.
const MAX_BYTES: u64 = 1 << 26;

/// Bytes by which a workbook begins: a ZIP archive (XLSX, ODS), a compound file (XLS).
const BEGINNINGS: [&[u8]; 2] = [b"PK\x03\x04", b"\xd0\xcf\x11\xe0"];

/// Whether a file that begins with `head` is a workbook.
pub(crate) fn is_workbook(head: &[u8]) -> bool {
    BEGINNINGS
        .iter()
        .any(|beginning| head.starts_with(beginning))
}

/// One sheet.
#[derive(Clone, Debug)]
pub(super) struct Sheet {
    /// Rows that hold something, each with its number in the sheet, from 1.
    pub rows: Vec<(u64, Vec<String>)>,
}

/// The sheets of a workbook, in its order.
///
/// # Errors
/// Unreadable, or no workbook.
pub(super) fn sheets(file: &Path) -> Result<Vec<Sheet>, Error> {
    let bytes = read_at_most(file, MAX_BYTES)?;
    let bad = |error: calamine::Error| {
        let problem = format!("is no XLSX, XLS or ODS that can be read: {error}");
        Error::input(file, problem)
    };
    let mut workbook = open_workbook_auto_from_rs(Cursor::new(bytes)).map_err(bad)?;
    let names = workbook.sheet_names();
    let sheet = |name: String| {
        let range = workbook.worksheet_range(&name).map_err(bad)?;
        let first = range.start().map_or(0, |(row, _)| u64::from(row));
        let numbered = range.rows().zip(first + 1..);
        let rows = numbered.map(|(cells, number)| (number, cells.iter().map(text).collect()));
        let filled = |row: &(u64, Vec<String>)| row.1.iter().any(|cell| !cell.is_empty());
        Ok(Sheet {
            rows: rows.filter(filled).collect(),
        })
    };
    names.into_iter().map(sheet).collect()
}

/// What a cell says.
fn text(cell: &Data) -> String {
    match cell {
        Data::Empty => String::new(),
        Data::Bool(true) => "yes".into(),
        Data::Bool(false) => "no".into(),
        Data::Float(number) => number.to_string(),
        Data::String(text) => text.trim().to_owned(),
        Data::DateTime(time) => iso(time),
        other => other.to_string(),
    }
}

/// A point in time as ISO 8601, a duration in days.
fn iso(time: &calamine::ExcelDateTime) -> String {
    if !time.is_datetime() {
        return time.as_f64().to_string();
    }
    let (year, month, day, hours, minutes, seconds, milliseconds) = time.to_ymd_hms_milli();
    format!("{year:04}-{month:02}-{day:02}T{hours:02}:{minutes:02}:{seconds:02}.{milliseconds:03}")
}
