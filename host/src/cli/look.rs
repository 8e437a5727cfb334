//! `vre look`

use std::fmt::Write as _;
use std::path::PathBuf;

use super::sparkline::sparkline;
use super::{Command, Console};
use crate::error::{Error, clip, decimal};
use crate::measure::{ChannelOverview, Drawn, Overview, look};

/// Look at a record of whatever maker: its channels, their rates, units and lengths, and a picture of each
#[derive(clap::Args)]
#[command(after_help = "\
Example: what a logger wrote, and then what of it is measured:
    vre look shaker.tdms
    vre measure shaker.tdms --column x")]
pub struct Look {
    /// A table (CSV, XLSX, ODS), or a record (WAV, Parquet, MAT, HDF5, UFF 58, TDMS, ULog, DataFlash, MCAP)
    file: PathBuf,
}

impl Command for Look {
    fn run(self, console: &Console) -> Result<(), Error> {
        let found = look(&self.file)?;
        console.print(text(&found))?;
        console.json(&found)
    }
}

fn text(found: &Overview) -> String {
    let mut text = format!("{}: {}\n", found.input, found.file_format);
    for channel in &found.channels {
        write_channel(&mut text, channel);
    }
    if let Some(remark) = &found.remark {
        let _ = writeln!(text, "\nnote: {remark}");
    }
    text
}

/// Columns of the picture.
const COLUMNS: usize = 64;

fn write_channel(text: &mut String, channel: &ChannelOverview) {
    let unit = channel
        .unit
        .as_ref()
        .map_or(String::new(), |unit| format!(" {unit}"));
    let name = clip(&channel.name);
    let _ = write!(
        text,
        "\n{name}{}  {} samples",
        bracketed(&unit),
        channel.samples
    );
    if channel.missing > 0 {
        let _ = write!(text, ", {} of them no number", channel.missing);
    }
    if let Some(rate) = channel.rate_hz {
        let _ = write!(text, "  {} Hz", short(rate));
    }
    if let Some([from, to]) = channel.extent_s {
        let _ = write!(text, "  {} to {} s", short(from), short(to));
    }
    text.push('\n');
    let (Some(mean), Some(deviation), Some([low, high])) =
        (channel.mean, channel.standard_deviation, channel.range)
    else {
        return;
    };
    let _ = writeln!(
        text,
        "  mean {}{unit}, standard deviation {}, from {} to {}",
        short(mean),
        short(deviation),
        short(low),
        short(high)
    );
    let profile = narrowed(&channel.profile);
    let (low, high) = profile
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &value| {
            (low.min(value), high.max(value))
        });
    if profile.len() < 2 {
        return;
    }
    let (what, base) = match channel.drawn {
        Drawn::Mean => ("mean", low),
        Drawn::StandardDeviation => ("standard deviation", 0.0),
    };
    let shares = profile.iter().map(|value| match high > base {
        true => (value - base) / (high - base),
        false => 0.0,
    });
    let _ = writeln!(
        text,
        "  {}  {what} of a piece, {} to {}",
        sparkline(shares),
        short(low),
        short(high)
    );
}

fn bracketed(unit: &str) -> String {
    match unit.trim() {
        "" => String::new(),
        unit => format!(" [{}]", clip(unit)),
    }
}

/// The mean of as many pieces as make the picture's columns.
fn narrowed(profile: &[f64]) -> Vec<f64> {
    let by = profile.len().div_ceil(COLUMNS).max(1);
    let groups = profile.chunks(by);
    groups
        .map(|group| group.iter().sum::<f64>() / group.len() as f64)
        .collect()
}

/// Six significant digits.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = 5 - value.abs().log10().floor() as i32;
    let step = 10f64.powi(digits.clamp(-300, 300));
    let rounded = (value * step).round() / step;
    decimal(if rounded.is_finite() { rounded } else { value })
}
