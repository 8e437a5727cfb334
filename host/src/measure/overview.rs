//! What a record of another maker holds, at a glance: channels, rates, units, lengths, and how each goes.

use std::path::Path;

use serde::Serialize;

use super::spread::Spread;
use crate::error::Error;
use crate::import::{self, Channel, Clock, Wanted};
use crate::median::median;

/// Samples of the shortest pieces.
const SHORTEST: u64 = 8;

/// Most pieces; beyond, they are joined in pairs.
const MOST: usize = 512;

/// What a file holds, `vre-look/1`.
#[derive(Clone, Debug, Serialize)]
pub struct Overview {
    /// `vre-look/1`.
    pub format: &'static str,
    /// The file.
    pub input: String,
    /// The format of the file, as `WAV`, or `table`.
    pub file_format: &'static str,
    /// Its channels.
    pub channels: Vec<ChannelOverview>,
    /// What should be known of the file, as that its end is cut off.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remark: Option<String>,
}

/// One channel, in the file's own unit.
#[derive(Clone, Debug, Serialize)]
pub struct ChannelOverview {
    /// Its name.
    pub name: String,
    /// Its unit, if the file tells it.
    pub unit: Option<String>,
    /// Samples a second, if the file tells rate or times: the mean between the first time and the last.
    pub rate_hz: Option<f64>,
    /// First and last time, s.
    pub extent_s: Option<[f64; 2]>,
    /// Samples.
    pub samples: u64,
    /// Samples that are no number.
    pub missing: u64,
    /// Mean; none without a sample.
    pub mean: Option<f64>,
    /// Standard deviation.
    pub standard_deviation: Option<f64>,
    /// Least and greatest sample.
    pub range: Option<[f64; 2]>,
    /// What `profile` holds: `mean` of each piece where that says more, or its `standard-deviation`.
    pub drawn: Drawn,
    /// Of pieces of equal length.
    pub profile: Vec<f64>,
}

/// What of a piece is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Drawn {
    /// The channel moves slowly.
    Mean,
    /// The channel shakes about a level that hardly moves.
    StandardDeviation,
}

/// Looks at all channels of a file.
///
/// # Errors
/// It cannot be read, or is damaged.
pub fn look(file: &Path) -> Result<Overview, Error> {
    let file_format = import::format(file)?.map_or("table", import::Format::name);
    let found = import::channels(file, Wanted::All)?;
    let mut tallies: Vec<Tally> = Vec::new();
    for block in found.blocks {
        let block = block?;
        if tallies.is_empty() {
            tallies = block.iter().map(Tally::new).collect();
        }
        for (tally, channel) in tallies.iter_mut().zip(&block) {
            tally.take(channel);
        }
    }
    Ok(Overview {
        format: "vre-look/1",
        input: file.display().to_string(),
        file_format,
        channels: tallies.into_iter().map(Tally::overview).collect(),
        remark: found.remark,
    })
}

/// What is kept of a channel while it is read.
struct Tally {
    name: String,
    unit: Option<String>,
    samples: u64,
    missing: u64,
    all: Spread,
    rate_hz: Option<f64>,
    extent_s: Option<[f64; 2]>,
    length: u64,
    pieces: Vec<Spread>,
    filling: Spread,
}

impl Tally {
    fn new(channel: &Channel) -> Self {
        Self {
            name: channel.name.clone(),
            unit: channel.unit.clone(),
            samples: 0,
            missing: 0,
            all: Spread::default(),
            rate_hz: None,
            extent_s: None,
            length: SHORTEST,
            pieces: Vec::new(),
            filling: Spread::default(),
        }
    }

    fn take(&mut self, channel: &Channel) {
        for &value in &channel.values {
            self.samples += 1;
            match value.is_finite() {
                true => {
                    self.all.add(value);
                    self.filling.add(value);
                }
                false => self.missing += 1,
            }
            if self.samples.is_multiple_of(self.length) {
                self.pieces.push(std::mem::take(&mut self.filling));
            }
            if self.pieces.len() == MOST {
                self.pieces = joined(&self.pieces, 2);
                self.length *= 2;
            }
        }
        let extent = match &channel.clock {
            Clock::Order => None,
            Clock::Rate { hz, start_s } => {
                self.rate_hz = Some(*hz);
                let last = self.samples.saturating_sub(1) as f64;
                Some([*start_s, start_s + last / hz])
            }
            Clock::Times(times) => {
                let first = self.extent_s.map(|extent| extent[0]);
                let first = first.or(times.first().copied());
                first.zip(times.last().copied()).map(|(a, b)| [a, b])
            }
        };
        self.extent_s = extent.or(self.extent_s);
    }

    fn overview(mut self) -> ChannelOverview {
        // What is left over is a piece of its own in a short record alone.
        if self.pieces.len() < 8 && self.filling.count > 1 {
            self.pieces.push(self.filling);
        }
        let (drawn, profile) = profile(&self.pieces);
        let some = self.all.count > 0;
        let mean_rate = || {
            let [from, to] = self.extent_s?;
            (to > from).then(|| (self.samples - 1) as f64 / (to - from))
        };
        ChannelOverview {
            rate_hz: self.rate_hz.or_else(mean_rate),
            extent_s: self.extent_s,
            samples: self.samples,
            missing: self.missing,
            mean: some.then_some(self.all.mean),
            standard_deviation: some.then(|| self.all.standard_deviation()),
            range: some.then_some([self.all.min, self.all.max]),
            name: self.name,
            unit: self.unit,
            drawn,
            profile,
        }
    }
}

/// Means are drawn where they scatter more than the samples of a piece do.
fn profile(pieces: &[Spread]) -> (Drawn, Vec<f64>) {
    let means: Vec<f64> = pieces.iter().map(|piece| piece.mean).collect();
    let within: Vec<f64> = pieces.iter().map(Spread::standard_deviation).collect();
    let between = means
        .iter()
        .copied()
        .collect::<Spread>()
        .standard_deviation();
    match between > median(within.clone()).unwrap_or(0.0) {
        true => (Drawn::Mean, means),
        false => (Drawn::StandardDeviation, within),
    }
}

/// The pieces joined by so many.
fn joined(pieces: &[Spread], by: usize) -> Vec<Spread> {
    let all = pieces.chunks(by);
    all.map(|group| {
        let mut sum = group[0];
        group[1..].iter().for_each(|piece| sum.join(piece));
        sum
    })
    .collect()
}
