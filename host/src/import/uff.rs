//! Universal files: time records of data set 58, as text and binary (58b), as vibration analysers export them.
//!
//! A data set stands between lines of -1. Its number, eleven lines of what it is, and its numbers follow. Lines of a fixed form
//! are read by column (University of Cincinnati, Structural Dynamics Research Laboratory, "Universal File Formats").

use std::path::Path;

use super::channels::{Channel, Channels, Clock, MAX_BYTES, Wanted, unique};
use super::cursor::{Cursor, Endian};
use crate::error::Error;
use crate::input::read_at_most;

/// Lines of a set that say what it is.
const LINES: usize = 11;

/// Opens a universal file.
///
/// # Errors
/// Unreadable, a set that is cut off, or no time record.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let bytes = read_at_most(file, MAX_BYTES)?;
    let mut reader = Reader {
        bytes: &bytes,
        at: 0,
        line: 0,
    };
    let mut channels = Vec::new();
    let mut others = 0;
    while let Some(line) = reader.next() {
        if line.trim() != "-1" {
            continue;
        }
        let from = reader.line + 1;
        let set = any_set(&mut reader);
        let set = set
            .map_err(|problem| Error::input(file, format!("data set at line {from}: {problem}")))?;
        match set {
            Set::Time(channel) => channels.push(*channel),
            Set::Function => others += 1,
            Set::Other => {}
        }
    }
    let mut names: Vec<String> = channels.iter().map(|c: &Channel| c.name.clone()).collect();
    unique(&mut names);
    channels
        .iter_mut()
        .zip(names)
        .for_each(|(channel, name)| channel.name = name);
    let nothing = "holds no time record: no data set 58 of real numbers over time";
    let mut found = Channels::whole(file, channels, wanted, nothing)?;
    found.remark =
        (others > 0).then(|| format!("{others} data sets are no time records and are left out"));
    Ok(found)
}

/// A data set.
enum Set {
    /// A time record.
    Time(Box<Channel>),
    /// A function of something else than time.
    Function,
    /// Of another number than 58.
    Other,
}

fn any_set(reader: &mut Reader<'_>) -> Result<Set, Bad> {
    let head = reader.next().ok_or("is cut off")?;
    let binary = match head.split_whitespace().next() {
        Some("58") => false,
        Some("58b") => true,
        _ => return reader.skip_set().map(|()| Set::Other),
    };
    let found = set(reader, binary, &head)?;
    Ok(found.map_or(Set::Function, |channel| Set::Time(Box::new(channel))))
}

/// Lines, and where one is.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u64,
}

impl Reader<'_> {
    fn next(&mut self) -> Option<String> {
        let rest = self.bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        let length = memchr::memchr(b'\n', rest).unwrap_or(rest.len());
        self.at += length + 1;
        self.line += 1;
        let text = rest[..length]
            .strip_suffix(b"\r")
            .unwrap_or(&rest[..length]);
        Some(super::dialect::text(text))
    }

    /// Goes behind the end of a set.
    fn skip_set(&mut self) -> Result<(), Bad> {
        while let Some(line) = self.next() {
            if line.trim() == "-1" {
                return Ok(());
            }
        }
        Err("is cut off".into())
    }
}

/// Characters of a line from a column on, trimmed.
fn field(line: &str, from: usize, length: usize) -> String {
    let characters: String = line.chars().skip(from).take(length).collect();
    characters.trim().to_owned()
}

/// What a set says of itself.
struct Form {
    name: String,
    unit: Option<String>,
    /// 2 of single, 4 of double precision.
    precision: u32,
    count: usize,
    even: bool,
    start: f64,
    step: f64,
}

/// Why a set cannot be read, in words.
type Bad = String;

/// A time record of real numbers; `None` of another set, which is skipped.
fn set(reader: &mut Reader<'_>, binary: bool, head: &str) -> Result<Option<Channel>, Bad> {
    let cut = || "is cut off".to_owned();
    let mut lines = Vec::new();
    for _ in 0..LINES {
        lines.push(reader.next().ok_or_else(cut)?);
    }
    let order: u32 = number(&field(head, 7, 6)).unwrap_or(1);
    let format: u32 = number(&field(head, 13, 6)).unwrap_or(2);
    let length: Option<usize> = number(&field(head, 31, 12));
    let form = form(&lines)?;
    let content = match (binary, length) {
        (true, Some(length)) => {
            let end = reader.at.checked_add(length);
            let content = end.and_then(|end| reader.bytes.get(reader.at..end));
            let content = content.ok_or_else(cut)?;
            reader.at += length;
            Some(content)
        }
        (true, None) => return Err("does not say how many bytes it has".into()),
        _ => None,
    };
    let Some(form) = form else {
        reader.skip_set()?;
        return Ok(None);
    };
    let numbers = match content {
        Some(_) if format != 2 => {
            return Err("holds floating point numbers of another kind than IEEE's".into());
        }
        Some(content) => binary_numbers(content, order, &form)?,
        None => text_numbers(reader, &form)?,
    };
    let each = if form.even { 1 } else { 2 };
    if numbers.len() < each * form.count {
        return Err(format!(
            "ends after {} of {} samples",
            numbers.len() / each,
            form.count
        ));
    }
    if content.is_some() {
        reader.skip_set()?;
    }
    Ok(Some(channel(form, numbers)))
}

fn channel(form: Form, numbers: Vec<f64>) -> Channel {
    let (clock, values) = if form.even {
        let clock = match form.step > 0.0 && form.step.is_finite() {
            true => Clock::Rate {
                hz: 1.0 / form.step,
                start_s: form.start,
            },
            false => Clock::Order,
        };
        (clock, numbers[..form.count].to_vec())
    } else {
        let pairs = || numbers.as_chunks::<2>().0.iter().take(form.count);
        let times: Vec<f64> = pairs().map(|pair| pair[0]).collect();
        (
            Clock::Times(times.into()),
            pairs().map(|pair| pair[1]).collect(),
        )
    };
    Channel {
        name: form.name,
        unit: form.unit,
        clock,
        values,
    }
}

fn number<T: std::str::FromStr>(text: &str) -> Option<T> {
    text.parse().ok()
}

/// What the lines of a set say; `None` if it is no record over time of real numbers.
fn form(lines: &[String]) -> Result<Option<Form>, Bad> {
    let text = |line: usize, from: usize, length: usize| field(&lines[line], from, length);
    let bad = |what: &str| format!("states no {what} that can be read");
    // 0 general or unknown, 1 time response.
    let function: u32 = number(&text(5, 0, 5)).ok_or_else(|| bad("kind of function"))?;
    let precision: u32 = number(&text(6, 0, 10)).ok_or_else(|| bad("type of numbers"))?;
    let count: usize = number(&text(6, 10, 10)).ok_or_else(|| bad("number of samples"))?;
    let even = text(6, 20, 10) == "1";
    let start = number(&text(6, 30, 13)).ok_or_else(|| bad("beginning"))?;
    let step = number(&text(6, 43, 13)).ok_or_else(|| bad("distance of samples"))?;
    // 17 time, 0 unknown.
    let abscissa: u32 = number(&text(7, 0, 10)).unwrap_or(0);
    let over_time = function <= 1 && matches!(abscissa, 0 | 17);
    if !over_time || !matches!(precision, 2 | 4) {
        return Ok(None);
    }
    let told = |text: String| (!text.is_empty() && text != "NONE").then_some(text);
    let point = || {
        let direction = match text(5, 51, 4).as_str() {
            "1" => "+X",
            "2" => "+Y",
            "3" => "+Z",
            "-1" => "-X",
            "-2" => "-Y",
            "-3" => "-Z",
            _ => "",
        };
        let entity = told(text(5, 31, 10)).unwrap_or_default();
        format!("{entity}:{}{direction}", text(5, 41, 10))
    };
    Ok(Some(Form {
        name: told(lines[0].trim().to_owned()).unwrap_or_else(point),
        unit: told(text(8, 47, 20)),
        precision,
        count,
        even,
        start,
        step,
    }))
}

fn binary_numbers(content: &[u8], order: u32, form: &Form) -> Result<Vec<f64>, Bad> {
    let order = if order == 2 {
        Endian::Big
    } else {
        Endian::Little
    };
    let cursor = Cursor::new(content, order);
    let numbers = match (form.precision, form.even) {
        (2, _) => cursor.all(Cursor::f32),
        // The abscissa is of single precision by the specification; programs write both alike.
        (_, false) if content.len() == 12 * form.count => {
            let mut cursor = cursor;
            let pair = |c: &mut Cursor<'_>| Ok([c.f32()?, c.f64()?]);
            let pairs = (0..form.count).map(|_| pair(&mut cursor));
            pairs.collect::<Result<Vec<_>, _>>().map(|all| all.concat())
        }
        _ => cursor.all(Cursor::f64),
    };
    numbers.map_err(|_| "is cut off within a number".into())
}

/// The numbers of the lines up to that of -1.
fn text_numbers(reader: &mut Reader<'_>, form: &Form) -> Result<Vec<f64>, Bad> {
    let widths: &[usize] = match (form.precision, form.even) {
        (2, _) => &[13],
        (_, true) => &[20],
        _ => &[13, 20],
    };
    let mut numbers = Vec::new();
    while let Some(line) = reader.next() {
        if line.trim() == "-1" {
            return Ok(numbers);
        }
        let parsed: Option<Vec<f64>> = line.split_whitespace().map(real).collect();
        let row = parsed.or_else(|| by_width(&line, widths));
        let row = row.ok_or_else(|| format!("line {} holds no numbers", reader.line))?;
        numbers.extend(row);
    }
    Err("is cut off".into())
}

/// Numbers that touch each other are parted by their width.
fn by_width(line: &str, widths: &[usize]) -> Option<Vec<f64>> {
    let mut numbers = Vec::new();
    let mut from = 0;
    for width in widths.iter().cycle() {
        let text = field(line, from, *width);
        if text.is_empty() {
            break;
        }
        numbers.push(real(&text)?);
        from += width;
    }
    Some(numbers)
}

/// A number as Fortran writes it, with D or E.
fn real(text: &str) -> Option<f64> {
    text.replace(['D', 'd'], "e").parse().ok()
}
