//! A table of any maker and dialect: columns are found by name, rows are streamed.

use std::cell::Cell;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

use csv::ByteRecord;

use super::channels::{Channel, Channels, Clock, Head, Wanted};
use super::dialect;
use super::source::Source;
use super::{Columns, Layout, Rows};
use crate::error::{Error, Place, Problem};

/// Beyond it a number is no temperature, C.
const MAX_TEMPERATURE_C: f64 = 1e4;

/// An open table.
pub struct Table {
    file: PathBuf,
    source: Source,
    record: ByteRecord,
    outputs: Vec<usize>,
    time: Option<(usize, f64)>,
    temperature: Option<usize>,
    group: Option<usize>,
    /// Day of the first ISO time: times count from its midnight.
    first_day: Cell<Option<i64>>,
}

impl Table {
    /// Opens `file`; `group` names the column that tells to which group a row belongs.
    ///
    /// # Errors
    /// A header that cannot be read or is empty; a column that is missing.
    pub fn open(file: &Path, columns: &Columns, group: Option<&str>) -> Result<Self, Error> {
        let mut wanted: Vec<&str> = columns.outputs.iter().map(String::as_str).collect();
        wanted.extend(columns.time.as_ref().map(|time| time.0.as_str()));
        wanted.extend(columns.temperature.as_deref());
        wanted.extend(group);
        let source = Source::open(file, &wanted, |cell, name| cell == name)?;
        let header = source.header();
        let place = |name: &str| Place {
            column: Some(name.into()),
            ..Place::file(file)
        };
        let mut seen = HashSet::new();
        let mut named = header.iter().filter(|name| !name.is_empty());
        if let Some(twice) = named.find(|name| !seen.insert(name.as_str())) {
            return Err(Error::Input {
                place: place(twice),
                problem: Problem::DuplicateColumn,
            });
        }
        let find = |name: &str| {
            let missing = || Error::Input {
                place: place(name),
                problem: Problem::MissingColumn,
            };
            header
                .iter()
                .position(|column| column == name)
                .ok_or_else(missing)
        };
        let outputs = columns.outputs.iter().map(|name| find(name));
        let outputs = outputs.collect::<Result<Vec<_>, _>>()?;
        let time = match &columns.time {
            Some((name, units)) => Some((find(name)?, *units)),
            None => None,
        };
        Ok(Self {
            file: file.into(),
            record: ByteRecord::new(),
            first_day: Cell::new(None),
            outputs,
            time,
            temperature: columns.temperature.as_deref().map(find).transpose()?,
            group: group.map(find).transpose()?,
            source,
        })
    }

    fn text(&self, index: usize) -> Result<&str, Error> {
        let cell = self.record.get(index).unwrap_or_default();
        match std::str::from_utf8(cell) {
            Ok("") => Err(self.error(index, Problem::Empty)),
            Ok(text) => Ok(text),
            Err(_) => Err(self.error(index, Problem::NotUtf8)),
        }
    }

    fn number(&self, index: usize) -> Result<f64, Error> {
        let text = self.text(index)?;
        match self.source.dialect().number(text) {
            Some(value) if value.is_finite() => Ok(value),
            Some(_) => Err(self.error(index, Problem::NotFinite(text.into()))),
            None => Err(self.error(index, Problem::NotANumber(text.into()))),
        }
    }

    fn error(&self, index: usize, problem: Problem) -> Error {
        let column = self.source.header().get(index).cloned();
        Error::Input {
            place: self.place(Some(column.unwrap_or_default())),
            problem,
        }
    }

    fn place(&self, column: Option<String>) -> Place {
        Place {
            file: self.file.clone(),
            row: self.line(),
            column,
        }
    }
}

impl Rows for Table {
    fn advance(&mut self) -> Result<bool, Error> {
        self.source.read(&mut self.record)
    }

    fn time_s(&self) -> Result<Option<f64>, Error> {
        let Some((index, units)) = self.time else {
            return Ok(None);
        };
        let number = self.number(index);
        let iso = || dialect::iso_time(self.text(index).ok()?);
        match number {
            Ok(number) => Ok(Some(number / units)),
            Err(error) => {
                let (day, seconds) = iso().ok_or(error)?;
                let first = self.first_day.get().unwrap_or(day);
                self.first_day.set(Some(first));
                Ok(Some(86_400.0 * (day - first) as f64 + seconds))
            }
        }
    }

    fn group(&self) -> Result<Option<&str>, Error> {
        self.group.map(|index| self.text(index)).transpose()
    }

    fn temperature_c(&self) -> Result<Option<f64>, Error> {
        let Some(index) = self.temperature else {
            return Ok(None);
        };
        let temperature = self.number(index)?;
        if temperature.abs() > MAX_TEMPERATURE_C {
            let problem = format!("{temperature:e} C is no temperature");
            return Err(self.error(index, Problem::Other(problem)));
        }
        Ok(Some(temperature))
    }

    fn output(&self, axis: usize) -> Result<f64, Error> {
        self.number(self.outputs[axis])
    }

    fn output_error(&self, axis: usize, problem: Problem) -> Error {
        self.error(self.outputs[axis], problem)
    }

    fn line(&self) -> Option<u64> {
        self.source.line(&self.record)
    }
}

/// Rows of a block.
const BLOCK: usize = 1 << 14;

/// The columns of a table as channels: NaN where a cell is no number.
///
/// # Errors
/// As of [`Table::open`].
pub(super) fn channels(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let layout = Layout::of(&dialect::Dialect::of(file, &[])?);
    let names = layout.names.iter().filter(|name| !name.is_empty());
    let heads: Vec<Head> = names
        .map(|name| Head {
            name: name.clone(),
            unit: layout.unit_text(name),
        })
        .collect();
    let kept: Vec<Head> = heads
        .iter()
        .filter(|head| wanted.has(&head.name))
        .cloned()
        .collect();
    let columns = Columns {
        outputs: kept.iter().map(|head| head.name.clone()).collect(),
        time: layout.time.clone().map(|name| {
            let units = layout.seconds(&name).unwrap_or(1.0);
            (name, units)
        }),
        temperature: None,
    };
    let mut table = Table::open(file, &columns, None)?;
    let mut ended = false;
    let mut next = move || {
        let mut times = Vec::new();
        let mut values = vec![Vec::new(); kept.len()];
        while !ended && times.len() < BLOCK {
            if !table.advance()? {
                ended = true;
                break;
            }
            times.push(table.time_s().ok().flatten());
            for (axis, values) in values.iter_mut().enumerate() {
                values.push(table.output(axis).unwrap_or(f64::NAN));
            }
        }
        if times.is_empty() {
            return Ok(None);
        }
        let times: Option<Vec<f64>> = times.into_iter().collect();
        let clock = times.map_or(Clock::Order, |times| Clock::Times(times.into()));
        let channels = kept.iter().zip(values).map(|(head, values)| Channel {
            name: head.name.clone(),
            unit: head.unit.clone(),
            clock: clock.clone(),
            values,
        });
        Ok(Some(channels.collect()))
    };
    let mut failed = false;
    let blocks = std::iter::from_fn(move || {
        if failed {
            return None;
        }
        let block: Result<Option<Vec<Channel>>, Error> = next();
        failed = block.is_err();
        block.transpose()
    });
    Ok(Channels {
        heads,
        blocks: Box::new(blocks),
        remark: None,
    })
}
