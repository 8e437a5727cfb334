//! ULog of PX4, by PX4's own crate.

use std::path::Path;
use std::sync::Arc;

use px4_ulog::full_parser::{SomeVec, read_file};
use px4_ulog::stream_parser::model::Completeness;

use super::channels::{Channel, Channels, Clock, Wanted};
use crate::error::Error;

/// Opens a ULog file. A channel is named by topic, instance and field, as `sensor_accel_0.x`.
///
/// # Errors
/// Unreadable, no ULog, or without a topic that was logged.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    std::fs::File::open(file).map_err(Error::read(file))?;
    let Some(name) = file.to_str() else {
        return Err(Error::input(file, "has a name that is not UTF-8"));
    };
    let log = read_file(name)
        .map_err(|error| Error::input(file, format!("is a damaged ULog file: {error}")))?;
    let mut channels = Vec::new();
    for (topic, instances) in log.messages {
        for (instance, mut fields) in instances {
            let times = fields.remove("timestamp").map(numbers);
            let clock = times.map_or(Clock::Order, |times| {
                Clock::Times(Arc::from_iter(times.iter().map(|us| 1e-6 * us)))
            });
            let stored = fields.into_iter();
            channels.extend(
                stored
                    .filter(|(field, _)| !field.starts_with("_padding"))
                    .map(|(field, values)| Channel {
                        name: format!("{topic}_{}.{field}", instance.value()),
                        unit: None,
                        clock: clock.clone(),
                        values: numbers(values),
                    }),
            );
        }
    }
    channels.sort_by(|a, b| a.name.cmp(&b.name));
    let mut found = Channels::whole(file, channels, wanted, "holds no logged topic")?;
    found.remark = match log.completeness {
        Completeness::Complete => None,
        Completeness::Truncated => Some("the log is cut off; what was whole before is read".into()),
        Completeness::MalformedRecord(what) => Some(format!(
            "the log is damaged; what was sound before is read: {what}"
        )),
    };
    Ok(found)
}

fn numbers(values: SomeVec) -> Vec<f64> {
    match values {
        SomeVec::Int8(all) => all.into_iter().map(f64::from).collect(),
        SomeVec::UInt8(all) => all.into_iter().map(f64::from).collect(),
        SomeVec::Int16(all) => all.into_iter().map(f64::from).collect(),
        SomeVec::UInt16(all) => all.into_iter().map(f64::from).collect(),
        SomeVec::Int32(all) => all.into_iter().map(f64::from).collect(),
        SomeVec::UInt32(all) => all.into_iter().map(f64::from).collect(),
        SomeVec::Int64(all) => all.into_iter().map(|n| n as f64).collect(),
        SomeVec::UInt64(all) => all.into_iter().map(|n| n as f64).collect(),
        SomeVec::Float(all) => all.into_iter().map(f64::from).collect(),
        SomeVec::Double(all) => all,
        SomeVec::Bool(all) => all.into_iter().map(|b| f64::from(u8::from(b))).collect(),
        SomeVec::Char(all) => all.into_iter().map(|c| f64::from(u32::from(c))).collect(),
    }
}
