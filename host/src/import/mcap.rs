//! MCAP: messages of ROS 1, ROS 2 and JSON (mcap.dev, "MCAP Format Specification").

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::Path;

use super::channels::{Channel, Channels, Clock, MAX_BYTES, Wanted};
use super::cursor::{Cursor, Cut, Endian};
use super::ros::{Bad, Definitions, Layer};
use crate::error::Error;
use crate::input::read_at_most;

/// Bytes that a file begins with.
const MAGIC: usize = 8;

/// Nanoseconds of a day.
const DAY_NS: u64 = 86_400_000_000_000;

/// Opens an MCAP file. A channel is named by topic and field, as `/imu.linear_acceleration.x`; its time is that of the
/// message's header, or of the log, in seconds from the midnight before the first message.
///
/// # Errors
/// Unreadable, damaged, or without a message of numbers that can be read.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let bytes = read_at_most(file, MAX_BYTES)?;
    let mut reader = Reader::default();
    let mut cursor = Cursor::new(&bytes, Endian::Little);
    cursor.skip(MAGIC);
    reader
        .records(cursor, true)
        .map_err(|fault| Error::input(file, format!("after message {}: {fault}", reader.count)))?;
    let others: Vec<String> = reader
        .others
        .iter()
        .map(|(topic, what)| format!("{topic} ({what})"))
        .collect();
    let others = others.join(", ");
    let topics = reader.topics.into_iter();
    let channels = topics
        .flat_map(|(name, topic)| topic.channels(&name))
        .collect();
    let nothing = match others.as_str() {
        "" => "holds no message of numbers".to_owned(),
        others => format!("holds no messages of ROS or JSON: {others}"),
    };
    let mut found = Channels::whole(file, channels, wanted, &nothing)?;
    found.remark = (!others.is_empty()).then(|| format!("not read, of another encoding: {others}"));
    Ok(found)
}

/// Why a file cannot be read on.
#[derive(Debug, thiserror::Error)]
enum Fault {
    #[error("the file is cut off, or damaged")]
    Cut,
    #[error("a chunk is damaged: {0}")]
    Chunk(String),
    #[error("the next message, of {0}, is not as its schema says")]
    Message(String),
}

impl From<Cut> for Fault {
    fn from(Cut: Cut) -> Self {
        Self::Cut
    }
}

/// What was read so far.
#[derive(Default)]
struct Reader {
    /// Name, encoding and text.
    schemas: HashMap<u16, (String, String, String)>,
    /// Topic of each channel.
    channels: HashMap<u16, String>,
    topics: BTreeMap<String, Topic>,
    /// Topics that cannot be read, and how they are written.
    others: BTreeMap<String, String>,
    midnight: Option<u64>,
    count: u64,
}

impl Reader {
    /// Records of a file up to the end of its data, or of a chunk.
    fn records(&mut self, mut cursor: Cursor<'_>, of_file: bool) -> Result<(), Fault> {
        while !cursor.is_empty() {
            let kind = cursor.bytes(1)?[0];
            let length = usize::try_from(cursor.u64()?).map_err(|_| Fault::Cut)?;
            let mut record = Cursor::new(cursor.bytes(length)?, Endian::Little);
            match kind {
                3 => self.schema(&mut record)?,
                4 => self.channel(&mut record)?,
                5 => self.message(&mut record)?,
                6 if of_file => {
                    let plain = chunk(&mut record)?;
                    self.records(Cursor::new(&plain, Endian::Little), false)?;
                }
                15 => return Ok(()),
                _ => {} // What helps to search.
            }
        }
        // Without the record of its end the data are cut off.
        if of_file { Err(Fault::Cut) } else { Ok(()) }
    }

    fn schema(&mut self, record: &mut Cursor<'_>) -> Result<(), Fault> {
        let id = record.u16()? as u16;
        let schema = (record.text()?, record.text()?, record.text()?);
        self.schemas.insert(id, schema);
        Ok(())
    }

    fn channel(&mut self, record: &mut Cursor<'_>) -> Result<(), Fault> {
        let (id, schema) = (record.u16()? as u16, record.u16()? as u16);
        let (topic, encoding) = (record.text()?, record.text()?);
        self.topics.entry(topic.clone()).or_insert_with(|| Topic {
            form: Form::of(&encoding, self.schemas.get(&schema)),
            times: Vec::new(),
            fields: HashMap::new(),
        });
        self.channels.insert(id, topic);
        Ok(())
    }

    fn message(&mut self, record: &mut Cursor<'_>) -> Result<(), Fault> {
        let id = record.u16()? as u16;
        record.skip(4);
        let log_time = record.u64()?;
        record.skip(8);
        let data = record.bytes(record.left())?;
        let name = self.channels.get(&id).ok_or(Fault::Cut)?;
        let topic = self.topics.get_mut(name).ok_or(Fault::Cut)?;
        let mut numbers = Numbers::default();
        match topic.form.read(data, &mut numbers) {
            Ok(()) => {}
            Err(Bad::Encoding(what)) => {
                self.others.insert(name.clone(), what);
                return Ok(());
            }
            Err(Bad::Cut) => return Err(Fault::Message(name.clone())),
        }
        let at = numbers.stamp().unwrap_or(log_time);
        let midnight = *self.midnight.get_or_insert(at / DAY_NS * DAY_NS);
        topic.push(
            (i128::from(at) - i128::from(midnight)) as f64 * 1e-9,
            numbers,
        );
        self.count += 1;
        Ok(())
    }
}

/// The records of a chunk, unpacked and checked against its sum.
fn chunk<'a>(record: &mut Cursor<'a>) -> Result<Cow<'a, [u8]>, Fault> {
    record.skip(16);
    let size = record.u64()?;
    let sum = record.u32()?;
    let packing = record.text()?;
    let length = usize::try_from(record.u64()?).map_err(|_| Fault::Cut)?;
    let packed = record.bytes(length)?;
    let bad = |error: std::io::Error| Fault::Chunk(error.to_string());
    let unpacked = |reader: &mut dyn Read| {
        let mut plain = Vec::new();
        reader
            .take(size.min(MAX_BYTES))
            .read_to_end(&mut plain)
            .map_err(bad)?;
        Ok(Cow::Owned(plain))
    };
    let plain = match packing.as_str() {
        "" => Ok(Cow::Borrowed(packed)),
        "zstd" => unpacked(&mut zstd::Decoder::new(packed).map_err(bad)?),
        "lz4" => unpacked(&mut lz4_flex::frame::FrameDecoder::new(packed)),
        other => Err(Fault::Chunk(format!(
            "packed by {other}, which is not known"
        ))),
    }?;
    if plain.len() as u64 != size || (sum != 0 && crc32fast::hash(&plain) != sum) {
        return Err(Fault::Chunk("its sum is another than stated".into()));
    }
    Ok(plain)
}

/// The numbers of one message, by their paths.
#[derive(Default)]
struct Numbers(Vec<(String, f64)>);

impl Numbers {
    /// Time of the header of a message of ROS, ns since 1970.
    fn stamp(&self) -> Option<u64> {
        let number = |names: [&str; 2]| {
            let found = self
                .0
                .iter()
                .find(|(name, _)| names.contains(&name.as_str()));
            found.map(|(_, value)| *value).filter(|value| *value >= 0.0)
        };
        let seconds = number(["header.stamp.sec", "header.stamp.secs"])?;
        let nanoseconds = number(["header.stamp.nanosec", "header.stamp.nsecs"])?;
        (seconds > 0.0 || nanoseconds > 0.0)
            .then_some(seconds as u64 * 1_000_000_000 + nanoseconds as u64)
    }
}

/// How the messages of a topic are written.
enum Form {
    Ros(Definitions),
    Json,
    Other(String),
}

impl Form {
    /// By how the messages are encoded, and their schema: name, language and text.
    fn of(encoding: &str, schema: Option<&(String, String, String)>) -> Self {
        let language = schema.map_or("", |schema| schema.1.as_str());
        let layer = match (encoding, language) {
            ("cdr", "ros2msg") => Some(Layer::Cdr),
            ("ros1", "ros1msg") => Some(Layer::Ros1),
            _ => None,
        };
        match (layer, schema) {
            (Some(layer), Some((name, _, text))) => {
                Self::Ros(Definitions::parse(name, text, layer))
            }
            _ if encoding == "json" => Self::Json,
            _ => Self::Other(format!("{encoding} {language}").trim().to_owned()),
        }
    }

    fn read(&self, data: &[u8], numbers: &mut Numbers) -> Result<(), Bad> {
        let mut keep = |path: &str, value: f64| numbers.0.push((path.to_owned(), value));
        match self {
            Self::Ros(definitions) => definitions.read(data, &mut keep),
            Self::Json => {
                let value = serde_json::from_slice(data).map_err(|_| Bad::Cut)?;
                flatten("", &value, &mut keep);
                Ok(())
            }
            Self::Other(what) => Err(Bad::Encoding(what.clone())),
        }
    }
}

/// Most elements of a list that are channels.
const LIST: usize = 16;

fn flatten(path: &str, value: &serde_json::Value, keep: &mut dyn FnMut(&str, f64)) {
    let inner = |name: &str| match path {
        "" => name.to_owned(),
        path => format!("{path}.{name}"),
    };
    match value {
        serde_json::Value::Number(number) => keep(path, number.as_f64().unwrap_or(f64::NAN)),
        serde_json::Value::Bool(flag) => keep(path, f64::from(u8::from(*flag))),
        serde_json::Value::Object(fields) => {
            fields
                .iter()
                .for_each(|(name, value)| flatten(&inner(name), value, keep));
        }
        serde_json::Value::Array(list) if list.len() <= LIST => {
            let numbered = list.iter().enumerate();
            numbered.for_each(|(n, value)| flatten(&inner(&n.to_string()), value, keep));
        }
        _ => {}
    }
}

/// The messages of a topic.
struct Topic {
    form: Form,
    times: Vec<f64>,
    fields: HashMap<String, Vec<f64>>,
}

impl Topic {
    /// Takes a message; a field that it does not have is NaN.
    fn push(&mut self, seconds: f64, numbers: Numbers) {
        for (path, value) in numbers.0 {
            let list = self.fields.entry(path).or_default();
            list.resize(self.times.len(), f64::NAN);
            list.push(value);
        }
        self.times.push(seconds);
    }

    fn channels(self, topic: &str) -> Vec<Channel> {
        let count = self.times.len();
        let clock = Clock::Times(self.times.into());
        let mut fields: Vec<(String, Vec<f64>)> = self.fields.into_iter().collect();
        fields.sort_by(|a, b| a.0.cmp(&b.0));
        let kept = fields
            .into_iter()
            .filter(|(path, _)| !path.starts_with("header."));
        kept.map(|(path, mut values)| {
            values.resize(count, f64::NAN);
            Channel {
                name: format!("{topic}.{path}"),
                unit: None,
                clock: clock.clone(),
                values,
            }
        })
        .collect()
    }
}
