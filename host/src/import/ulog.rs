//! ULog of PX4: messages of a topic, whose form the log states itself (PX4 Guide, "ULog File Format").

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::channels::{Channel, Channels, Clock, MAX_BYTES, Wanted};
use super::cursor::{Cursor, Cut, Endian};
use crate::error::Error;
use crate::input::read_at_most;

/// Bytes before the first message.
const HEADER: usize = 16;

/// Deepest type within types, and most fields of a message.
const DEEPEST: usize = 16;
const MOST: usize = 4096;

/// Opens a ULog file. A channel is named by topic, instance and field, as `sensor_accel_0.x`.
///
/// # Errors
/// Unreadable, of a later kind, or without a topic that was logged.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let bytes = read_at_most(file, MAX_BYTES)?;
    let mut log = Log::default();
    let mut from = HEADER.min(bytes.len());
    // Behind a crash more is appended, wherever the messages before end.
    loop {
        let to = log.appended.iter().copied().filter(|at| *at > from).min();
        let to = to.unwrap_or(bytes.len()).min(bytes.len());
        let known = log.appended.len();
        from = log.section(&bytes, from, to);
        if log.appended.len() == known && from >= bytes.len() {
            break;
        }
    }
    if log.unknown {
        return Err(Error::input(
            file,
            "is a ULog file of a later kind, which is not read",
        ));
    }
    let remark = log.remark();
    let mut found = Channels::whole(file, log.channels(), wanted, "holds no logged topic")?;
    found.remark = remark;
    Ok(found)
}

/// A field of a type, as it is stated.
#[derive(Clone, Debug)]
struct Field {
    kind: String,
    count: Option<usize>,
    name: String,
}

/// A number of a message: where it stands, and what it is.
#[derive(Clone, Debug)]
struct Number {
    name: String,
    kind: Kind,
    offset: usize,
}

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "int8_t" => Self::I8,
            "uint8_t" | "bool" | "char" => Self::U8,
            "int16_t" => Self::I16,
            "uint16_t" => Self::U16,
            "int32_t" => Self::I32,
            "uint32_t" => Self::U32,
            "int64_t" => Self::I64,
            "uint64_t" => Self::U64,
            "float" => Self::F32,
            "double" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    fn read(self, cursor: &mut Cursor<'_>) -> Result<f64, Cut> {
        match self {
            Self::I8 => cursor.i8(),
            Self::U8 => cursor.u8(),
            Self::I16 => cursor.i16(),
            Self::U16 => cursor.u16(),
            Self::I32 => cursor.i32(),
            Self::U32 => cursor.u32().map(f64::from),
            Self::I64 => cursor.i64(),
            Self::U64 => cursor.u64().map(|n| n as f64),
            Self::F32 => cursor.f32(),
            Self::F64 => cursor.f64(),
        }
    }
}

/// The messages of one topic and instance.
struct Series {
    name: String,
    numbers: Vec<Number>,
    values: Vec<Vec<f64>>,
}

/// What was read so far.
#[derive(Default)]
struct Log {
    types: HashMap<String, Vec<Field>>,
    series: BTreeMap<u16, Series>,
    appended: Vec<usize>,
    unknown: bool,
    strange: u64,
    is_cut: bool,
}

impl Log {
    /// Reads messages; returns where the next section begins, also where the last message before it is cut off.
    fn section(&mut self, bytes: &[u8], from: usize, to: usize) -> usize {
        let mut cursor = Cursor::new(&bytes[from..to], Endian::Little);
        while !cursor.is_empty() {
            let known = self.appended.len();
            let at = from + cursor.position();
            let Ok((kind, content)) = message(&mut cursor) else {
                self.is_cut = true;
                return to;
            };
            if self.take(kind, content).is_err() {
                self.strange += 1;
            }
            // What is appended is known from here on.
            if self.appended.len() > known {
                return at + 3 + content.len();
            }
        }
        to
    }

    fn take(&mut self, kind: u8, content: &[u8]) -> Result<(), Cut> {
        let mut cursor = Cursor::new(content, Endian::Little);
        match kind {
            b'B' => {
                cursor.bytes(8)?;
                let flags = cursor.bytes(8)?;
                self.unknown |= flags[0] > 1 || flags[1..].iter().any(|flag| *flag != 0);
                for _ in 0..3 {
                    let at = usize::try_from(cursor.u64()?).map_err(|_| Cut)?;
                    if at > 0 {
                        self.appended.push(at);
                    }
                }
                Ok(())
            }
            b'F' => {
                let text = String::from_utf8_lossy(content);
                let (name, fields) = text.split_once(':').ok_or(Cut)?;
                let fields = fields.split(';').filter(|field| !field.is_empty());
                let fields = fields.map(|text| field(text).ok_or(Cut));
                self.types
                    .insert(name.into(), fields.collect::<Result<_, _>>()?);
                Ok(())
            }
            b'A' => {
                let (instance, id) = (cursor.u8()?, cursor.u16()? as u16);
                let name = String::from_utf8_lossy(cursor.bytes(cursor.left())?);
                let mut numbers = Vec::new();
                self.flatten(&name, "", &mut 0, 0, &mut numbers)?;
                let series = Series {
                    name: format!("{name}_{instance}"),
                    values: vec![Vec::new(); numbers.len()],
                    numbers,
                };
                self.series.insert(id, series);
                Ok(())
            }
            b'D' => {
                let id = cursor.u16()? as u16;
                let data = cursor.bytes(cursor.left())?;
                self.series.get_mut(&id).ok_or(Cut)?.push(data)
            }
            _ => Ok(()), // Texts, parameters and the like.
        }
    }

    /// The numbers of a type, types within it included, one after the other.
    fn flatten(
        &self,
        kind: &str,
        path: &str,
        offset: &mut usize,
        depth: usize,
        numbers: &mut Vec<Number>,
    ) -> Result<(), Cut> {
        for field in self.types.get(kind).ok_or(Cut)? {
            for index in 0..field.count.unwrap_or(1) {
                let name = match field.count {
                    Some(_) => format!("{path}{}[{index}]", field.name),
                    None => format!("{path}{}", field.name),
                };
                if numbers.len() >= MOST || depth >= DEEPEST {
                    return Err(Cut);
                }
                match Kind::of(&field.kind) {
                    Some(kind) => {
                        numbers.push(Number {
                            name,
                            kind,
                            offset: *offset,
                        });
                        *offset += kind.size();
                    }
                    None => {
                        self.flatten(&field.kind, &format!("{name}."), offset, depth + 1, numbers)?
                    }
                }
            }
        }
        Ok(())
    }

    fn remark(&self) -> Option<String> {
        match (self.is_cut, self.strange) {
            (false, 0) => None,
            (true, 0) => Some("the log is cut off; what was whole before is read".into()),
            (_, strange) => Some(format!(
                "the log is damaged: {strange} messages are not sound and left out"
            )),
        }
    }

    fn channels(self) -> Vec<Channel> {
        let mut channels = Vec::new();
        for mut series in self.series.into_values() {
            let at = series
                .numbers
                .iter()
                .position(|number| number.name == "timestamp");
            let clock = at.map_or(Clock::Order, |at| {
                let times = std::mem::take(&mut series.values[at]);
                Clock::Times(times.iter().map(|us| 1e-6 * us).collect())
            });
            let all = series.numbers.into_iter().zip(series.values);
            let kept = all.filter(|(number, values)| {
                let padding = number
                    .name
                    .rsplit('.')
                    .next()
                    .is_some_and(|n| n.starts_with("_padding"));
                !padding && !values.is_empty()
            });
            channels.extend(kept.map(|(number, values)| Channel {
                name: format!("{}.{}", series.name, number.name),
                unit: None,
                clock: clock.clone(),
                values,
            }));
        }
        channels
    }
}

impl Series {
    /// Takes a message; padding at its end may be left out.
    fn push(&mut self, data: &[u8]) -> Result<(), Cut> {
        let mut values = Vec::with_capacity(self.numbers.len());
        for number in &self.numbers {
            let mut cursor = Cursor::new(data, Endian::Little);
            cursor.skip(number.offset);
            values.push(match number.kind.read(&mut cursor) {
                Err(Cut) if number.name.starts_with("_padding") => 0.0,
                value => value?,
            });
        }
        self.values
            .iter_mut()
            .zip(values)
            .for_each(|(list, value)| list.push(value));
        Ok(())
    }
}

/// Type and content of the next message.
fn message<'a>(cursor: &mut Cursor<'a>) -> Result<(u8, &'a [u8]), Cut> {
    let size = cursor.u16()? as usize;
    let kind = cursor.bytes(1)?[0];
    Ok((kind, cursor.bytes(size)?))
}

/// A field `type name` or `type[count] name`.
fn field(text: &str) -> Option<Field> {
    let (kind, name) = text.trim().split_once(' ')?;
    let (kind, count) = match kind.split_once('[') {
        Some((kind, count)) => (kind, Some(count.strip_suffix(']')?.parse().ok()?)),
        None => (kind, None),
    };
    Some(Field {
        kind: kind.into(),
        count,
        name: name.into(),
    })
}
