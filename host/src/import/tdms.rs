//! TDMS, as LabVIEW and nptdms write it: segments, each with what has changed of its objects and with raw samples
//! (National Instruments, "TDMS File Format Internal Structure").

use std::collections::HashMap;
use std::path::Path;

use super::channels::{Channel, Channels, Clock, MAX_BYTES, Wanted};
use super::cursor::{Cursor, Cut, Endian};
use super::tdms_scale::Scaling;
use crate::error::Error;
use crate::input::read_at_most;

/// Bytes that every segment begins with.
const LEAD_IN: usize = 28;

// What a segment holds, by bit.
const META_DATA: u32 = 1 << 1;
const NEW_LIST: u32 = 1 << 2;
const RAW_DATA: u32 = 1 << 3;
const INTERLEAVED: u32 = 1 << 5;
const BIG_ENDIAN: u32 = 1 << 6;

/// Opens a TDMS file. A channel is named `group/channel`, or `channel` if there is one group.
///
/// # Errors
/// Unreadable, a segment that is cut off, a scaling that is not known, or no channel of numbers.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let bytes = read_at_most(file, MAX_BYTES)?;
    let mut contents = Contents::default();
    let mut at = 0;
    let mut number = 0;
    while at < bytes.len() {
        number += 1;
        let failed = |fault: Fault| Error::input(file, format!("segment {number}: {fault}"));
        at = contents.segment(&bytes, at).map_err(failed)?;
    }
    let channels = contents
        .channels()
        .map_err(|(name, fault)| Error::input(file, format!("channel {name}: {fault}")))?;
    Channels::whole(file, channels, wanted, "holds no channel of numbers")
}

/// Why a segment or a channel cannot be read.
#[derive(Debug, thiserror::Error)]
pub(super) enum Fault {
    /// Bytes are missing.
    #[error("is cut off, or damaged")]
    Cut,
    /// Raw data of a DAQmx task, unscaled.
    #[error("holds raw data of DAQmx, which are not read; save scaled values")]
    DaqMx,
    /// A scaling that is not known.
    #[error("is scaled by {0}, which is not known; save scaled values")]
    Scale(String),
    /// A type of samples that takes no known number of bytes.
    #[error("holds samples of the unknown type {0:#x}")]
    Kind(u32),
}

impl From<Cut> for Fault {
    fn from(Cut: Cut) -> Self {
        Self::Cut
    }
}

/// A property, as far as it is used.
#[derive(Clone, Debug)]
pub(super) enum Property {
    /// A number.
    Number(f64),
    /// Text.
    Text(String),
}

/// How the raw samples of an object stand in a segment.
#[derive(Clone, Copy, Debug)]
struct Index {
    kind: u32,
    /// Values in each chunk.
    count: usize,
    /// Bytes in each chunk, of text.
    bytes: usize,
}

/// An object of the file: the file itself, a group, or a channel.
#[derive(Default)]
struct Object {
    path: String,
    properties: HashMap<String, Property>,
    index: Option<Index>,
    values: Vec<f64>,
    is_number: bool,
}

/// All objects, and which of them the last segment listed.
#[derive(Default)]
struct Contents {
    objects: Vec<Object>,
    by_path: HashMap<String, usize>,
    listed: Vec<usize>,
}

impl Contents {
    /// Reads a segment; returns where the next begins.
    fn segment(&mut self, bytes: &[u8], from: usize) -> Result<usize, Fault> {
        let lead = bytes.get(from..from + LEAD_IN).ok_or(Fault::Cut)?;
        let mut cursor = Cursor::new(lead, Endian::Little);
        if cursor.bytes(4)? != b"TDSm" {
            return Err(Fault::Cut);
        }
        let holds = cursor.u32()?;
        cursor.skip(4);
        let (next, raw) = (cursor.u64()?, cursor.u64()?);
        let content = &bytes[from + LEAD_IN..];
        // A program that was stopped has not written the length: the segment goes to the end of the file.
        let length = if next == u64::MAX {
            content.len()
        } else {
            usize::try_from(next).map_err(|_| Fault::Cut)?
        };
        let content = content.get(..length).ok_or(Fault::Cut)?;
        let raw = usize::try_from(raw).map_err(|_| Fault::Cut)?;
        let (meta, raw) = content.split_at_checked(raw).ok_or(Fault::Cut)?;
        let order = match holds & BIG_ENDIAN {
            0 => Endian::Little,
            _ => Endian::Big,
        };
        if holds & META_DATA != 0 {
            self.meta_data(Cursor::new(meta, order), holds & NEW_LIST != 0)?;
        }
        if holds & RAW_DATA != 0 {
            self.raw_data(raw, order, holds & INTERLEAVED != 0)?;
        }
        Ok(from + LEAD_IN + length)
    }

    fn meta_data(&mut self, mut cursor: Cursor<'_>, new_list: bool) -> Result<(), Fault> {
        if new_list {
            self.listed.clear();
        }
        for _ in 0..cursor.u32()? {
            let path = cursor.text()?;
            let place = match self.by_path.get(&path) {
                Some(place) => *place,
                None => {
                    self.objects.push(Object {
                        path: path.clone(),
                        ..Object::default()
                    });
                    self.by_path.insert(path, self.objects.len() - 1);
                    self.objects.len() - 1
                }
            };
            let object = &mut self.objects[place];
            let has_data = match cursor.u32()? {
                u32::MAX => false,
                0 => true, // As before.
                0x1269 | 0x1369 => return Err(Fault::DaqMx),
                _ => {
                    object.index = Some(index(&mut cursor)?);
                    true
                }
            };
            for _ in 0..cursor.u32()? {
                let name = cursor.text()?;
                if let Some(value) = property(&mut cursor)? {
                    object.properties.insert(name, value);
                }
            }
            let listed = self.listed.contains(&place);
            if has_data && !listed {
                self.listed.push(place);
            } else if !has_data && listed {
                self.listed.retain(|known| *known != place);
            }
        }
        Ok(())
    }

    fn raw_data(&mut self, raw: &[u8], order: Endian, interleaved: bool) -> Result<(), Fault> {
        let indices = self.listed.iter();
        let indices = indices.map(|&place| self.objects[place].index.ok_or(Fault::Cut));
        let indices = indices.collect::<Result<Vec<_>, _>>()?;
        let sizes = indices.iter().map(|index| index.size());
        let sizes = sizes.collect::<Result<Vec<usize>, _>>()?;
        let chunk: usize = sizes.iter().sum();
        let mut cursor = Cursor::new(raw, order);
        if chunk == 0 {
            return Ok(());
        }
        while !cursor.is_empty() {
            if interleaved {
                let count = indices.first().map_or(0, |index| index.count);
                for _ in 0..count {
                    for (&place, index) in self.listed.iter().zip(&indices) {
                        self.objects[place].take(&mut cursor, index, 1)?;
                    }
                }
                continue;
            }
            for ((&place, index), size) in self.listed.iter().zip(&indices).zip(&sizes) {
                match index.width() {
                    Some(_) => self.objects[place].take(&mut cursor, index, index.count)?,
                    None => drop(cursor.bytes(*size)?),
                }
            }
        }
        Ok(())
    }

    /// Channels with numbers, scaled.
    fn channels(self) -> Result<Vec<Channel>, (String, Fault)> {
        let numeric = |object: &&Object| object.is_number && !object.values.is_empty();
        let names: Vec<(String, String)> = self
            .objects
            .iter()
            .filter(numeric)
            .map(|o| parts(&o.path))
            .collect();
        let one_group = names.windows(2).all(|pair| pair[0].0 == pair[1].0);
        let objects = self.objects.into_iter().filter(|object| numeric(&object));
        let channels = objects.zip(names).map(|(object, (group, name))| {
            let name = match one_group || group.is_empty() {
                true => name,
                false => format!("{group}/{name}"),
            };
            object.channel(name.clone()).map_err(|fault| (name, fault))
        });
        channels.collect()
    }
}

/// Group and channel of a path `/'group'/'channel'`, in which a quote is doubled.
fn parts(path: &str) -> (String, String) {
    let inner = path
        .trim_start_matches('/')
        .trim_start_matches('\'')
        .trim_end_matches('\'');
    let (group, channel) = inner.split_once("'/'").unwrap_or(("", inner));
    (group.replace("''", "'"), channel.replace("''", "'"))
}

impl Index {
    /// Bytes of a sample; none of text.
    fn width(&self) -> Option<usize> {
        Some(match self.kind {
            1 | 5 | 0x21 => 1,
            2 | 6 => 2,
            3 | 7 | 9 | 0x19 => 4,
            4 | 8 | 10 | 0x1a | 0x0008_000c => 8,
            0x44 | 0x0010_000d => 16,
            _ => return None,
        })
    }

    /// Bytes of a chunk.
    fn size(&self) -> Result<usize, Fault> {
        match (self.width(), self.kind) {
            (Some(width), _) => self.count.checked_mul(width).ok_or(Fault::Cut),
            (None, 0x20) => Ok(self.bytes),
            (None, kind) => Err(Fault::Kind(kind)),
        }
    }
}

fn index(cursor: &mut Cursor<'_>) -> Result<Index, Fault> {
    let kind = cursor.u32()?;
    cursor.skip(4); // The dimension, which is 1.
    let count = usize::try_from(cursor.u64()?).map_err(|_| Fault::Cut)?;
    let bytes = match kind {
        0x20 => usize::try_from(cursor.u64()?).map_err(|_| Fault::Cut)?,
        _ => 0,
    };
    Ok(Index { kind, count, bytes })
}

fn property(cursor: &mut Cursor<'_>) -> Result<Option<Property>, Fault> {
    let kind = cursor.u32()?;
    if kind == 0x20 {
        return Ok(Some(Property::Text(cursor.text()?)));
    }
    Ok(number(cursor, kind)?.map(Property::Number))
}

/// A number of a type; none of a type that is no real number.
fn number(cursor: &mut Cursor<'_>, kind: u32) -> Result<Option<f64>, Fault> {
    Ok(Some(match kind {
        1 => cursor.i8()?,
        2 => cursor.i16()?,
        3 => cursor.i32()?,
        4 => cursor.i64()?,
        5 | 0x21 => cursor.u8()?,
        6 => cursor.u16()?,
        7 => f64::from(cursor.u32()?),
        8 => cursor.u64()? as f64,
        9 | 0x19 => cursor.f32()?,
        10 | 0x1a => cursor.f64()?,
        0x0008_000c => {
            cursor.bytes(8)?;
            return Ok(None);
        }
        0x44 | 0x0010_000d => {
            cursor.bytes(16)?;
            return Ok(None);
        }
        kind => return Err(Fault::Kind(kind)),
    }))
}

impl Object {
    fn take(&mut self, cursor: &mut Cursor<'_>, index: &Index, count: usize) -> Result<(), Fault> {
        for _ in 0..count {
            if let Some(value) = number(cursor, index.kind)? {
                self.is_number = true;
                self.values.push(value);
            }
        }
        Ok(())
    }

    fn channel(mut self, name: String) -> Result<Channel, Fault> {
        Scaling::of(&self.properties)?.apply(&mut self.values);
        let told = |key: &str| match self.properties.get(key) {
            Some(Property::Number(number)) if number.is_finite() => Some(*number),
            _ => None,
        };
        let clock = match told("wf_increment") {
            Some(step) if step > 0.0 => Clock::Rate {
                hz: 1.0 / step,
                start_s: told("wf_start_offset").unwrap_or(0.0),
            },
            _ => Clock::Order,
        };
        let unit = match self.properties.get("unit_string") {
            Some(Property::Text(unit)) if !unit.is_empty() => Some(unit.clone()),
            _ => None,
        };
        Ok(Channel {
            name,
            unit,
            clock,
            values: self.values,
        })
    }
}
