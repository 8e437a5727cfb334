//! Segments from a CSV table, streamed row by row.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use csv::ByteRecord;

use super::Calibration;
use super::segment::{Role, Segment};
use super::selection::Selection;
use crate::campaign::{RowLimited, read_error};
use crate::error::{Error, Place, Problem, clip};

/// Most groups that can be selected.
const MAX_GROUPS: usize = 10_000;

/// Beyond it a number is no temperature, C.
const MAX_TEMPERATURE_C: f64 = 1e4;

/// Names of the columns and their units.
#[derive(Clone, Debug)]
pub struct Columns {
    /// Output of the instrument, one column an axis.
    pub outputs: Vec<String>,
    /// Time, and how many of its units make a second.
    pub time: Option<(String, f64)>,
    /// Temperature, C.
    pub temperature: Option<String>,
}

/// Reads the segments; `file` is for errors only.
pub(super) fn read(
    file: &Path,
    source: impl Read,
    columns: &Columns,
    selection: &Selection,
    calibration: &Calibration,
) -> Result<Vec<Segment>, Error> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(RowLimited::new(source));
    let header: Vec<String> = reader
        .headers()
        .map_err(|error| read_error(file, &[], error))?
        .iter()
        .map(str::to_owned)
        .collect();
    if header.iter().all(String::is_empty) {
        return Err(Error::input(file, Problem::EmptyFile));
    }
    let place = |row: Option<u64>, column: &str| Place {
        file: file.into(),
        row,
        column: Some(column.into()),
    };
    let find = |name: &str| {
        let missing = || Error::Input {
            place: place(None, name),
            problem: Problem::MissingColumn,
        };
        header
            .iter()
            .position(|column| column == name)
            .ok_or_else(missing)
    };
    let outputs = columns
        .outputs
        .iter()
        .map(|name| find(name))
        .collect::<Result<Vec<_>, _>>()?;
    let time = match &columns.time {
        Some((name, units)) => Some((find(name)?, *units)),
        None => None,
    };
    let temperature = columns.temperature.as_deref().map(find).transpose()?;
    let group = match selection {
        Selection::Groups { column, .. } => Some(find(column)?),
        Selection::Windows { .. } => None,
    };

    let mut segments = Segments::new(columns.outputs.len());
    let mut record = ByteRecord::new();
    let mut rows = 0u64;
    loop {
        reader.get_mut().begin_row();
        let more = reader.read_byte_record(&mut record);
        if !more.map_err(|error| read_error(file, &header, error))? {
            break;
        }
        let row = record.position().map(csv::Position::line);
        let at = |index: usize, problem: Problem| Error::Input {
            place: place(row, header.get(index).map_or("", String::as_str)),
            problem,
        };
        let text = |index: usize| {
            let cell = record.get(index).unwrap_or_default();
            match std::str::from_utf8(cell) {
                Ok("") => Err(at(index, Problem::Empty)),
                Ok(text) => Ok(text),
                Err(_) => Err(at(index, Problem::NotUtf8)),
            }
        };
        let number = |index: usize| {
            let text = text(index)?;
            match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                Ok(_) => Err(at(index, Problem::NotFinite(text.into()))),
                Err(_) => Err(at(index, Problem::NotANumber(text.into()))),
            }
        };
        let time_s = match time {
            Some((index, units)) => Some(number(index)? / units),
            None => None,
        };
        let segment = match group {
            Some(index) => segments.of_group(selection, text(index)?),
            None => segments.of_time(selection, time_s.unwrap_or(rows as f64)),
        };
        rows += 1;
        let Some(segment) = segment.map_err(|problem| Error::input(file, problem))? else {
            continue;
        };
        if let (Some((index, _)), Some(time_s)) = (time, time_s) {
            segment.tick(time_s).map_err(|step| {
                let problem = format!(
                    "time goes on by {step} s within \"{}\"",
                    clip(&segment.name)
                );
                at(index, Problem::Other(problem))
            })?;
        }
        if let Some(index) = temperature {
            let temperature = number(index)?;
            if temperature.abs() > MAX_TEMPERATURE_C {
                let problem = format!("{temperature:e} C is no temperature");
                return Err(at(index, Problem::Other(problem)));
            }
            segment.temperature_c.add(temperature);
        }
        for (channel, &index) in segment.channels.iter_mut().zip(&outputs) {
            let output_g = number(index)? / calibration.units_per_g;
            channel
                .push(output_g, calibration.clip_g())
                .map_err(|problem| at(index, problem))?;
        }
    }
    match rows {
        0 => Err(Error::input(file, Problem::NoRows)),
        _ => Ok(segments.list),
    }
}

/// The segments in the order in which they appear.
struct Segments {
    list: Vec<Segment>,
    by_name: HashMap<String, Option<usize>>,
    columns: usize,
    last: Option<(String, Option<usize>)>,
}

impl Segments {
    fn new(columns: usize) -> Self {
        Self {
            list: Vec::new(),
            by_name: HashMap::new(),
            columns,
            last: None,
        }
    }

    fn of_group(
        &mut self,
        selection: &Selection,
        name: &str,
    ) -> Result<Option<&mut Segment>, Problem> {
        let known = match &self.last {
            Some((last, index)) if last == name => Some(*index),
            _ => self.by_name.get(name).copied(),
        };
        let index = match known {
            Some(index) => index,
            None => {
                let Some(role) = group_role(selection, name) else {
                    return Ok(None);
                };
                if self.list.len() == MAX_GROUPS {
                    return Err(Problem::Other(format!(
                        "more than {MAX_GROUPS} groups are selected"
                    )));
                }
                self.list
                    .push(Segment::new(name.into(), role, self.columns));
                let index = Some(self.list.len() - 1);
                self.by_name.insert(name.into(), index);
                index
            }
        };
        if self.last.as_ref().is_none_or(|(last, _)| last != name) {
            self.last = Some((name.into(), index));
        }
        Ok(index.and_then(|index| self.list.get_mut(index)))
    }

    fn of_time(
        &mut self,
        selection: &Selection,
        time_s: f64,
    ) -> Result<Option<&mut Segment>, Problem> {
        let Selection::Windows { before, during } = selection else {
            return Ok(None);
        };
        let role = match (before.has(time_s), during.has(time_s)) {
            (true, _) => Role::Before,
            (_, true) => Role::During,
            _ => return Ok(None),
        };
        let index = self.list.iter().position(|segment| segment.role == role);
        let index = index.unwrap_or_else(|| {
            self.list
                .push(Segment::new(role.to_string(), role, self.columns));
            self.list.len() - 1
        });
        Ok(self.list.get_mut(index))
    }
}

/// Who is before is not during, whatever pattern matches.
fn group_role(selection: &Selection, name: &str) -> Option<Role> {
    let Selection::Groups {
        before,
        during,
        without,
        ..
    } = selection
    else {
        return None;
    };
    match (without.has(name), before.has(name), during.has(name)) {
        (false, true, _) => Some(Role::Before),
        (false, false, true) => Some(Role::During),
        _ => None,
    }
}
