//! How a table is written: what parts its cells, where its header stands, whether a comma is the decimal sign, whether a
//! row of units follows, and which lines are comments.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::lines::COMMENT;
use super::workbook::{self, Sheet};
use crate::error::{Error, Problem};

/// Bytes at the beginning by which the dialect is told.
const HEAD: u64 = 1 << 16;

/// Most lines before the header.
const PREAMBLE: usize = 200;

/// The dialect of one table.
#[derive(Clone, Debug, PartialEq)]
pub struct Dialect {
    /// What parts cells.
    pub delimiter: u8,
    /// Bytes before the header.
    pub skipped: u64,
    /// Line of the header, from 1.
    pub header_line: u64,
    /// Whether a comma in a number is the decimal sign.
    pub decimal_comma: bool,
    /// Whether lines that begin with `#` are comments.
    pub comments: bool,
    /// Whether the row under the header holds units.
    pub units_row: bool,
    /// Names of the columns.
    pub names: Vec<String>,
    /// Units of the columns, of a row of units; empty without such a row.
    pub units: Vec<String>,
}

/// A line without its end, and where it begins.
struct Line<'a> {
    from: usize,
    number: u64,
    text: Text<'a>,
}

/// What stands in a line.
#[derive(Clone, Copy)]
enum Text<'a> {
    /// Bytes of a file.
    Bytes(&'a [u8]),
    /// Cells of a sheet.
    Cells(&'a [String]),
}

impl Line<'_> {
    /// Cells, trimmed and without quotes; bytes that are no UTF-8 are taken as Latin-1.
    fn cells(&self, delimiter: u8) -> Vec<String> {
        let line = match self.text {
            Text::Cells(cells) => return cells.to_vec(),
            Text::Bytes(line) => line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line),
        };
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .delimiter(delimiter)
            .trim(csv::Trim::All)
            .from_reader(line);
        let mut record = csv::ByteRecord::new();
        match reader.read_byte_record(&mut record) {
            Ok(true) => record.iter().map(text).collect(),
            _ => Vec::new(),
        }
    }

    fn is_comment(&self) -> bool {
        match self.text {
            Text::Bytes(line) => line.first() == Some(&COMMENT),
            Text::Cells(cells) => cells
                .first()
                .is_some_and(|cell| cell.as_bytes().first() == Some(&COMMENT)),
        }
    }

    /// The delimiter that a line `sep=;` states for a spreadsheet program.
    fn stated_delimiter(&self) -> Option<u8> {
        let Text::Bytes(line) = self.text else {
            return None;
        };
        let line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
        let line = line.trim_ascii_end();
        let line = line.strip_prefix(b"\"").unwrap_or(line);
        let (word, stated) = line.split_at_checked(4)?;
        // A tab was trimmed away.
        let delimiter = stated.first().copied().unwrap_or(b'\t');
        word.eq_ignore_ascii_case(b"sep=").then_some(delimiter)
    }
}

/// Whether a cell of a header is the column of that name.
pub(super) type IsColumn = fn(cell: &str, name: &str) -> bool;

impl Dialect {
    /// Of the table in `file`, delimited text or the sheet of a workbook: the header is the first line that names the most
    /// `wanted` columns; without any, the first line that the next lines follow in number of cells and that is no row of numbers.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of(file: &Path, wanted: &[&str]) -> Result<Self, Error> {
        Ok(Self::find(file, wanted, |cell, name| cell == name)?.0)
    }

    /// And the sheet with the header, of a workbook.
    pub(super) fn find(
        file: &Path,
        wanted: &[&str],
        is_column: IsColumn,
    ) -> Result<(Self, Option<Sheet>), Error> {
        let mut head = Vec::new();
        let source = File::open(file).map_err(Error::read(file))?;
        let mut source = source.take(HEAD);
        source.read_to_end(&mut head).map_err(Error::read(file))?;
        if workbook::is_workbook(&head) {
            let sheets = workbook::sheets(file)?;
            let (dialect, sheet) = Self::of_sheets(sheets, wanted, is_column)
                .ok_or_else(|| Error::input(file, Problem::EmptyFile))?;
            return Ok((dialect, Some(sheet)));
        }
        if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") {
            let problem = "is UTF-16 text; save it as \"CSV UTF-8\"";
            return Err(Error::input(file, problem));
        }
        Ok((Self::of_lines(&lines(&head), wanted, is_column).0, None))
    }

    /// Of the sheet that names the most wanted columns, the first of equals.
    fn of_sheets(
        sheets: Vec<Sheet>,
        wanted: &[&str],
        is_column: IsColumn,
    ) -> Option<(Self, Sheet)> {
        let found = sheets.into_iter().map(|sheet| {
            let lines: Vec<Line<'_>> = sheet
                .rows
                .iter()
                .take(PREAMBLE + 16)
                .map(|(number, cells)| Line {
                    from: 0,
                    number: *number,
                    text: Text::Cells(cells),
                })
                .collect();
            let (dialect, count) = Self::of_lines(&lines, wanted, is_column);
            (dialect, count, sheet)
        });
        let (dialect, _, sheet) = found
            .filter(|(_, _, sheet)| !sheet.rows.is_empty())
            .reduce(|best, next| if next.1 > best.1 { next } else { best })?;
        Some((dialect, sheet))
    }

    /// And how many of the wanted columns the header names.
    fn of_lines(lines: &[Line<'_>], wanted: &[&str], is_column: IsColumn) -> (Self, usize) {
        let stated = lines.first().and_then(Line::stated_delimiter);
        let lines = &lines[usize::from(stated.is_some())..];
        let delimiters: Vec<u8> = stated.map_or(DELIMITERS.to_vec(), |stated| vec![stated]);
        let (index, delimiter, count) = header(lines, &delimiters, wanted, is_column);
        let names = lines
            .get(index)
            .map_or(Vec::new(), |line| line.cells(delimiter));
        let comments = lines.get(index).is_none_or(|line| !line.is_comment());
        let next: Vec<Vec<String>> = lines
            .iter()
            .skip(index + 1)
            .filter(|line| !(comments && line.is_comment()))
            .take(8)
            .map(|line| line.cells(delimiter))
            .collect();
        let units_row = next.first().is_some_and(|row| is_units(row, names.len()));
        let numbers = next.iter().skip(usize::from(units_row)).flatten();
        let decimal_comma = delimiter != b','
            && numbers
                .clone()
                .any(|cell| cell.contains(',') && number(cell, true).is_some())
            && !numbers
                .clone()
                .any(|cell| cell.contains('.') && number(cell, false).is_some());
        let at = lines.get(index);
        let dialect = Self {
            delimiter,
            skipped: at.map_or(0, |line| line.from as u64),
            header_line: at.map_or(1, |line| line.number),
            decimal_comma,
            comments,
            units_row,
            units: if units_row {
                next.into_iter().next().unwrap_or_default()
            } else {
                Vec::new()
            },
            names,
        };
        (dialect, count)
    }

    /// A number as this dialect writes it.
    pub fn number(&self, text: &str) -> Option<f64> {
        number(text, self.decimal_comma)
    }
}

/// Where the header stands, what parts its cells, and how many of the wanted columns it names.
fn header(
    lines: &[Line<'_>],
    delimiters: &[u8],
    wanted: &[&str],
    is_column: IsColumn,
) -> (usize, u8, usize) {
    let mut best = (0, delimiters[0], 0);
    let mut widest = 0;
    let most = wanted.len().max(1);
    let candidates = || lines.iter().take(PREAMBLE).enumerate();
    let plain = candidates().filter(|(_, line)| !line.is_comment());
    // A line of comment is a header only where no other is, as some programs write theirs.
    let comments = candidates().filter(|(_, line)| line.is_comment());
    for (rank, (index, line)) in plain.chain(comments).enumerate() {
        for &delimiter in delimiters {
            let names = line.cells(delimiter);
            let is_named = |name: &&&str| names.iter().any(|cell| is_column(cell, name));
            let count = match wanted {
                [] => usize::from(heads(&names, &lines[index + 1..], delimiter)),
                _ => wanted.iter().filter(is_named).count(),
            };
            // Where nothing is named, what parts the first line into most cells.
            let wider = best.2 == 0 && rank == 0 && !wanted.is_empty() && names.len() > widest;
            if count > best.2 || wider {
                best = (index, delimiter, count);
                widest = names.len();
            }
        }
        if best.2 == most || best.2 > 0 && line.is_comment() {
            break;
        }
    }
    best
}

/// In the order in which they are tried.
const DELIMITERS: [u8; 4] = *b",;\t|";

fn number(text: &str, decimal_comma: bool) -> Option<f64> {
    match decimal_comma && text.contains(',') {
        true => text.replacen(',', ".", 1).parse().ok(),
        false => text.parse().ok(),
    }
}

/// Lines that are not blank.
fn lines(head: &[u8]) -> Vec<Line<'_>> {
    let mut found = Vec::new();
    let (mut from, mut number) = (0, 1);
    while from < head.len() && found.len() < PREAMBLE + 16 {
        let length = memchr::memchr2(b'\n', b'\r', &head[from..]).unwrap_or(head.len() - from);
        let text = &head[from..from + length];
        if !text.trim_ascii().is_empty() {
            found.push(Line {
                from,
                number,
                text: Text::Bytes(text),
            });
        }
        from += length;
        from += if head[from..].starts_with(b"\r\n") {
            2
        } else {
            1
        };
        number += 1;
    }
    found
}

/// Text of a cell, UTF-8 or Latin-1.
pub(super) fn text(cell: &[u8]) -> String {
    match std::str::from_utf8(cell) {
        Ok(text) => text.to_owned(),
        Err(_) => cell.iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// Whether a line of such cells is the header of the lines that follow: rows with numbers, after a row of units perhaps.
fn heads(names: &[String], next: &[Line<'_>], delimiter: u8) -> bool {
    let parsed = |cell: &String| number(cell, false).or(number(cell, true)).is_some();
    let rows: Vec<Vec<String>> = next
        .iter()
        .filter(|line| !line.is_comment())
        .take(4)
        .map(|line| line.cells(delimiter))
        .collect();
    let alike = rows.iter().all(|row| row.len() == names.len());
    let units = rows.first().is_some_and(|row| is_units(row, names.len()));
    let numbers = rows
        .get(usize::from(units))
        .is_some_and(|row| row.iter().any(parsed));
    names.len() > 1 && alike && numbers && !names.iter().any(parsed)
}

/// Whether cells are units: none is a number, and some are a unit of acceleration, time or temperature.
fn is_units(row: &[String], columns: usize) -> bool {
    let bare = |cell: &String| cell.trim_matches(['(', ')', '[', ']']).to_owned();
    let known = |cell: &String| {
        let cell = bare(cell);
        super::Unit::parse(&cell).is_some() || seconds(&cell).is_some()
    };
    row.len() == columns
        && row
            .iter()
            .all(|cell| number(cell, false).is_none() && number(cell, true).is_none())
        && row.iter().any(known)
}

/// How many of a unit of time make a second.
pub fn seconds(unit: &str) -> Option<f64> {
    Some(match unit.to_lowercase().as_str() {
        "s" | "sec" | "secs" | "second" | "seconds" => 1.0,
        "ms" | "msec" | "millis" | "milliseconds" => 1e3,
        "us" | "usec" | "\u{b5}s" | "\u{3bc}s" | "micros" | "microseconds" => 1e6,
        "ns" | "nsec" | "nanos" | "nanoseconds" => 1e9,
        _ => return None,
    })
}

/// Day, and seconds of it, of an ISO 8601 time with its date: `2024-05-01T12:34:56.789Z`, a space for the T, a zone or none.
pub(crate) fn iso_time(text: &str) -> Option<(i64, f64)> {
    let (date, time) = text.split_once(['T', ' '])?;
    let mut date = date.splitn(3, '-').map(|part| part.parse::<i64>());
    let (year, month, day) = (date.next()?.ok()?, date.next()?.ok()?, date.next()?.ok()?);
    let time = time.trim_end_matches('Z');
    let zone = time.rfind(['+', '-']);
    let (time, zone) = zone.map_or((time, ""), |at| time.split_at(at));
    let parts: Vec<f64> = time
        .splitn(3, ':')
        .map(|part| part.replace(',', ".").parse().ok())
        .collect::<Option<_>>()?;
    let [hours, minutes, seconds] = parts[..] else {
        return None;
    };
    let (zone_hours, zone_minutes) = match zone.get(1..) {
        Some(zone) => {
            let digits: String = zone.chars().filter(char::is_ascii_digit).collect();
            let number: f64 = digits.get(..4)?.parse().ok()?;
            ((number / 100.0).floor(), number % 100.0)
        }
        None => (0.0, 0.0),
    };
    let east = if zone.starts_with('-') { -1.0 } else { 1.0 };
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // Days from 0000-03-01, in the proleptic Gregorian calendar: the year begins in March.
    let (year, month) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let days = 365 * year + year.div_euclid(4) - year.div_euclid(100)
        + year.div_euclid(400)
        + (153 * month + 2) / 5
        + day
        - 1;
    let of_day =
        3600.0 * (hours - east * zone_hours) + 60.0 * (minutes - east * zone_minutes) + seconds;
    Some((days, of_day))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iso_times_differ_by_what_lies_between_them() {
        let at = |text: &str| {
            iso_time(text)
                .map(|(day, s)| 86_400.0 * day as f64 + s)
                .unwrap()
        };
        assert_eq!(
            at("2024-03-01T00:00:00Z") - at("2024-02-28T00:00:00Z"),
            2.0 * 86_400.0
        );
        assert_eq!(at("2023-03-01 00:00:00") - at("2023-02-28 23:59:58.5"), 1.5);
        assert_eq!(at("2024-01-01T02:00:00+02:00"), at("2024-01-01T00:00:00Z"));
        assert_eq!(iso_time("12.5"), None);
        assert_eq!(iso_time("2024-13-01T00:00:00"), None);
    }

    #[test]
    fn a_preamble_a_row_of_units_and_a_decimal_comma_are_seen() {
        let table =
            "Logger 7;SN 12\r\n\r\nZeit;x;y\r\ns;m/s\u{b2};g\r\n0,00;9,81;0,1\r\n0,01;9,80;0,2\r\n";
        let of = |wanted: &[&str]| {
            Dialect::of_lines(&lines(table.as_bytes()), wanted, |cell, name| cell == name).0
        };
        let found = of(&["x"]);
        assert_eq!((found.delimiter, found.header_line), (b';', 3));
        assert!(found.decimal_comma && found.units_row);
        assert_eq!(found.units, ["s", "m/s\u{b2}", "g"]);
        assert_eq!(of(&[]).names, ["Zeit", "x", "y"]);
        assert_eq!(found.number("-1,5e-3"), Some(-1.5e-3));
    }
}
