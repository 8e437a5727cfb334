//! DataFlash logs of ArduPilot (`.bin`): messages of fixed length, whose form the log states itself
//! (ArduPilot, AP_Logger, LogStructure.h).

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::channels::{Channel, Channels, Clock, MAX_BYTES, Wanted};
use super::cursor::{Cursor, Cut, Endian};
use crate::error::Error;
use crate::input::read_at_most;

/// What every message begins with; its type follows.
const MARK: [u8; 2] = [0xa3, 0x95];
const HEADER: usize = 3;

/// Type of the messages that state the form of others.
const FORM: u8 = 0x80;

/// Opens a DataFlash log. A channel is named by message, instance and field, as `IMU[0].AccX`.
///
/// # Errors
/// Unreadable, or without a message of numbers.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let bytes = read_at_most(file, MAX_BYTES)?;
    let mut log = Log::default();
    let (mut at, mut strange) = (0, 0);
    while at < bytes.len() {
        match log.message(&bytes[at..]) {
            Ok(length) => at += length,
            Err(Cut) => {
                let rest = &bytes[at + 1..];
                let next = memchr::memmem::find(rest, &MARK).unwrap_or(rest.len());
                strange += 1 + next;
                at += 1 + next;
            }
        }
    }
    let mut found = Channels::whole(file, log.channels(), wanted, "holds no message of numbers")?;
    found.remark = (strange > 0).then(|| {
        format!(
            "{strange} of {} bytes are no messages: the log is damaged or cut off",
            bytes.len()
        )
    });
    Ok(found)
}

/// The form of a type of messages.
struct Form {
    length: usize,
    name: String,
    letters: Vec<u8>,
    labels: Vec<String>,
}

/// What was read so far.
#[derive(Default)]
struct Log {
    forms: HashMap<u8, Form>,
    /// By name and instance: numbers of each field.
    series: BTreeMap<(String, Option<u64>), Vec<Vec<f64>>>,
    /// Label and unit of each field, by name of message.
    fields: HashMap<String, Vec<(String, Option<String>)>>,
    /// Letters of the units of each field, by type of message, and what the letters mean.
    units: HashMap<u8, Vec<u8>>,
    meanings: HashMap<u8, String>,
}

/// A field.
enum Value<'a> {
    Number(f64),
    Text(&'a [u8]),
}

impl Log {
    /// Reads the message at the beginning of bytes; returns its length.
    fn message(&mut self, bytes: &[u8]) -> Result<usize, Cut> {
        let [first, second, kind] = bytes.get(..HEADER).ok_or(Cut)? else {
            return Err(Cut);
        };
        if [*first, *second] != MARK {
            return Err(Cut);
        }
        if *kind == FORM {
            let length = HEADER + 86;
            self.form(bytes.get(HEADER..length).ok_or(Cut)?)?;
            return Ok(length);
        }
        let form = self.forms.get(kind).ok_or(Cut)?;
        let length = form.length;
        let mut cursor = Cursor::new(bytes.get(HEADER..length).ok_or(Cut)?, Endian::Little);
        let values = form
            .letters
            .iter()
            .map(|letter| value(&mut cursor, *letter));
        let values = values.collect::<Result<Vec<_>, _>>()?;
        match form.name.as_str() {
            "FMTU" => {
                if let [_, Value::Number(kind), Value::Text(units), ..] = values[..] {
                    self.units.insert(kind as u8, units.to_vec());
                }
            }
            "UNIT" => {
                if let [_, Value::Number(letter), Value::Text(meaning), ..] = values[..] {
                    self.meanings.insert(letter as u8, text(meaning));
                }
            }
            name => {
                let name = name.to_owned();
                let instance = self.instance(*kind, &values);
                self.push(*kind, (name, instance), &values);
            }
        }
        Ok(length)
    }

    fn form(&mut self, bytes: &[u8]) -> Result<(), Cut> {
        let mut cursor = Cursor::new(bytes, Endian::Little);
        let (kind, length) = (cursor.u8()? as u8, cursor.u8()? as usize);
        let name = text(cursor.bytes(4)?);
        let letters = cursor.bytes(16)?;
        let end = letters.iter().position(|letter| *letter == 0);
        let labels = text(cursor.bytes(64)?);
        let form = Form {
            length,
            letters: letters[..end.unwrap_or(letters.len())].to_vec(),
            labels: labels.split(',').map(str::to_owned).collect(),
            name,
        };
        if length < HEADER {
            return Err(Cut);
        }
        self.forms.insert(kind, form);
        Ok(())
    }

    /// The instance of a message: its field `I`, or the one whose unit is `#`.
    fn instance(&self, kind: u8, values: &[Value<'_>]) -> Option<u64> {
        let form = self.forms.get(&kind)?;
        let marked = || self.units.get(&kind)?.iter().position(|unit| *unit == b'#');
        let named = form.labels.iter().position(|label| label == "I");
        match values.get(named.or_else(marked)?)? {
            Value::Number(number) if *number >= 0.0 => Some(*number as u64),
            _ => None,
        }
    }

    fn push(&mut self, kind: u8, key: (String, Option<u64>), values: &[Value<'_>]) {
        let Some(form) = self.forms.get(&kind) else {
            return;
        };
        let name = key.0.clone();
        let series = self
            .series
            .entry(key)
            .or_insert_with(|| vec![Vec::new(); values.len()]);
        for (list, value) in series.iter_mut().zip(values) {
            if let Value::Number(number) = value {
                list.push(*number);
            }
        }
        let units = self.units.get(&kind);
        self.fields.entry(name).or_insert_with(|| {
            let labels = (0..values.len()).map(|n| {
                let label = form.labels.get(n).cloned().unwrap_or_default();
                let unit = units.and_then(|units| self.meanings.get(units.get(n)?));
                (label, unit.filter(|unit| !unit.is_empty()).cloned())
            });
            labels.collect()
        });
    }

    fn channels(self) -> Vec<Channel> {
        let mut channels = Vec::new();
        for ((name, instance), mut series) in self.series {
            let Some(fields) = self.fields.get(&name) else {
                continue;
            };
            let us = fields.iter().position(|(label, _)| label == "TimeUS");
            let clock = us.map_or(Clock::Order, |at| {
                let times = std::mem::take(&mut series[at]);
                Clock::Times(times.iter().map(|us| 1e-6 * us).collect())
            });
            let message = instance.map_or(name.clone(), |number| format!("{name}[{number}]"));
            let all = fields.iter().zip(series);
            channels.extend(all.filter(|(_, values)| !values.is_empty()).map(
                |((label, unit), values)| Channel {
                    name: format!("{message}.{label}"),
                    unit: unit.clone(),
                    clock: clock.clone(),
                    values,
                },
            ));
        }
        channels
    }
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0);
    String::from_utf8_lossy(&bytes[..end.unwrap_or(bytes.len())])
        .trim()
        .to_owned()
}

/// The value of a field by its letter.
fn value<'a>(cursor: &mut Cursor<'a>, letter: u8) -> Result<Value<'a>, Cut> {
    Ok(Value::Number(match letter {
        b'b' => cursor.i8()?,
        b'B' | b'M' => cursor.u8()?,
        b'h' => cursor.i16()?,
        b'H' => cursor.u16()?,
        b'i' => cursor.i32()?,
        b'I' => f64::from(cursor.u32()?),
        b'q' => cursor.i64()?,
        b'Q' => cursor.u64()? as f64,
        b'f' => cursor.f32()?,
        b'd' => cursor.f64()?,
        b'c' => cursor.i16()? / 100.0,
        b'C' => cursor.u16()? / 100.0,
        b'e' => cursor.i32()? / 100.0,
        b'E' => f64::from(cursor.u32()?) / 100.0,
        b'g' => half(cursor.u16()? as u16),
        b'L' => cursor.i32()? / 1e7,
        b'n' => return cursor.bytes(4).map(Value::Text),
        b'N' => return cursor.bytes(16).map(Value::Text),
        b'Z' | b'a' => return cursor.bytes(64).map(Value::Text),
        _ => return Err(Cut),
    }))
}

/// A number of half precision (IEEE 754, binary16).
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (
        i32::from(bits >> 10 & 0x1f),
        f64::from(bits & 0x3ff) / 1024.0,
    );
    sign * match exponent {
        0 => fraction * 2f64.powi(-14),
        0x1f if fraction == 0.0 => f64::INFINITY,
        0x1f => f64::NAN,
        exponent => (1.0 + fraction) * 2f64.powi(exponent - 15),
    }
}
