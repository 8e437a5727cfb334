//! Channels, as the files of measurement programs hold them: read block by block, and asked for row by row.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Columns, Rows};
use crate::error::{Error, Place, Problem, clip};

/// Most bytes of a file that is read as a whole, and of what is unpacked of it.
pub(super) const MAX_BYTES: u64 = 1 << 32;

/// One channel, or a block of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Name, unique within the file.
    pub name: String,
    /// Unit, if the file tells it.
    pub unit: Option<String>,
    /// When the samples were taken.
    pub clock: Clock,
    /// Samples in the file's own unit; NaN where the file has none.
    pub values: Vec<f64>,
}

/// When samples were taken.
#[derive(Clone, Debug, PartialEq)]
pub enum Clock {
    /// Nothing but their order is known.
    Order,
    /// Evenly, from a time on.
    Rate {
        /// Samples a second.
        hz: f64,
        /// Time of the first sample of the file, s.
        start_s: f64,
    },
    /// The time of each sample of the block, s.
    Times(Arc<[f64]>),
}

/// An open file of channels.
pub struct Channels {
    /// Names and units of all channels that the file holds.
    pub heads: Vec<Head>,
    /// The channels that were asked for, block by block; all blocks hold the same channels.
    pub blocks: Blocks,
    /// What should be known of the file, as that its end is cut off.
    pub remark: Option<String>,
}

/// Blocks of channels.
pub type Blocks = Box<dyn Iterator<Item = Result<Vec<Channel>, Error>>>;

/// What a channel is called, and its unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Head {
    /// Its name.
    pub name: String,
    /// Its unit, if the file tells it.
    pub unit: Option<String>,
}

/// Which channels are read.
#[derive(Clone, Copy, Debug)]
pub enum Wanted<'a> {
    /// All of them.
    All,
    /// Those of these names.
    Named(&'a [&'a str]),
}

impl Wanted<'_> {
    /// Whether the channel of this name is.
    pub fn has(self, name: &str) -> bool {
        match self {
            Self::All => true,
            Self::Named(names) => names.contains(&name),
        }
    }
}

impl Channels {
    /// Of channels that are in memory.
    ///
    /// # Errors
    /// There are none: `nothing` says what is missing.
    pub(super) fn whole(
        file: &Path,
        mut channels: Vec<Channel>,
        wanted: Wanted<'_>,
        nothing: &str,
    ) -> Result<Self, Error> {
        if channels.is_empty() {
            return Err(Error::input(file, nothing));
        }
        let heads = channels.iter().map(|channel| Head {
            name: channel.name.clone(),
            unit: channel.unit.clone(),
        });
        let heads = heads.collect();
        channels.retain(|channel| wanted.has(&channel.name));
        Ok(Self {
            heads,
            blocks: Box::new(std::iter::once(Ok(channels))),
            remark: None,
        })
    }
}

/// Makes names unique: the second of a name becomes `name (2)`.
pub(super) fn unique(names: &mut [String]) {
    for index in 1..names.len() {
        let mut count = 1;
        let name = names[index].clone();
        while names[..index].contains(&names[index]) {
            count += 1;
            names[index] = format!("{name} ({count})");
        }
    }
}

/// A numeric array of a file that names arrays, as those of MATLAB.
pub(super) struct Array {
    pub name: String,
    /// Rows and columns, column after column.
    pub size: [usize; 2],
    pub values: Vec<f64>,
}

/// Most channels of one array.
const MOST: usize = 256;

/// Names of a single number that is the sample rate, Hz.
const RATES: [&str; 7] = [
    "fs",
    "fs_hz",
    "rate",
    "rate_hz",
    "sample_rate",
    "sampling_rate",
    "samplerate",
];

/// The channels of arrays: a vector is one, a matrix has one for each of its columns (or rows, if it has more columns), named
/// `matrix.1` and so on. A single number `fs`, `rate` or `sample_rate` is the rate of all.
pub(super) fn of_arrays(arrays: Vec<Array>) -> Vec<Channel> {
    let rate = arrays.iter().find_map(|array| {
        let last = array.name.rsplit('.').next()?.to_lowercase();
        let single = array.values.len() == 1 && RATES.contains(&last.as_str());
        let hz = *array.values.first()?;
        (single && hz.is_finite() && hz > 0.0).then_some(hz)
    });
    let clock = rate.map_or(Clock::Order, |hz| Clock::Rate { hz, start_s: 0.0 });
    let mut channels = Vec::new();
    for Array { name, size, values } in arrays {
        let [rows, columns] = size;
        if values.len() < 2 || rows.min(columns) > MOST {
            continue;
        }
        let mut push = |name: String, values: Vec<f64>| {
            channels.push(Channel {
                name,
                unit: None,
                clock: clock.clone(),
                values,
            });
        };
        if rows.min(columns) == 1 {
            push(name, values);
        } else if rows >= columns {
            for (column, values) in values.chunks_exact(rows).enumerate() {
                push(format!("{name}.{}", column + 1), values.to_vec());
            }
        } else {
            for row in 0..rows {
                let values = values.iter().skip(row).step_by(rows).copied().collect();
                push(format!("{name}.{}", row + 1), values);
            }
        }
    }
    channels
}

/// Rows of channels that share their clock.
pub(super) struct Sampled {
    file: PathBuf,
    blocks: Blocks,
    remark: Option<String>,
    names: Vec<String>,
    time: Option<(String, f64)>,
    temperature: Option<String>,
    places: Places,
    block: Vec<Channel>,
    length: usize,
    /// Samples of the blocks before.
    passed: u64,
    /// One after the row within the block.
    next: usize,
}

/// Places in a block.
#[derive(Default)]
struct Places {
    outputs: Vec<usize>,
    time: Option<usize>,
    temperature: Option<usize>,
}

impl Sampled {
    /// Of the columns' channels, which `open` reads.
    ///
    /// # Errors
    /// A channel that is not there.
    pub(super) fn open(
        file: &Path,
        columns: &Columns,
        open: impl FnOnce(Wanted<'_>) -> Result<Channels, Error>,
    ) -> Result<Self, Error> {
        let mut names: Vec<&str> = columns.outputs.iter().map(String::as_str).collect();
        names.extend(columns.time.as_ref().map(|time| time.0.as_str()));
        names.extend(columns.temperature.as_deref());
        let found = open(Wanted::Named(&names))?;
        for name in names {
            if !found.heads.iter().any(|head| head.name == name) {
                return Err(missing(file, name, &found.heads));
            }
        }
        Ok(Self {
            file: file.into(),
            blocks: found.blocks,
            remark: found.remark,
            names: columns.outputs.clone(),
            time: columns.time.clone(),
            temperature: columns.temperature.clone(),
            places: Places::default(),
            block: Vec::new(),
            length: 0,
            passed: 0,
            next: 0,
        })
    }

    /// Takes the next block; its channels must be of one clock.
    fn take(&mut self, block: Vec<Channel>) -> Result<(), Error> {
        let find = |name: &String| {
            let place = block.iter().position(|channel| channel.name == *name);
            place.ok_or_else(|| missing(&self.file, name, &[]))
        };
        let outputs = self.names.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        let time = self.time.as_ref().map(|(name, _)| find(name)).transpose()?;
        let temperature = self.temperature.as_ref().map(find).transpose()?;
        let first = &block[outputs[0]];
        for place in outputs.iter().copied().chain(time).chain(temperature) {
            let other = &block[place];
            let alike = first.values.len() == other.values.len();
            if !alike || (time.is_none() && first.clock != other.clock) {
                let problem = format!(
                    "is not sampled as {} is: {} against {} samples, or at other times",
                    clip(&first.name),
                    other.values.len(),
                    first.values.len()
                );
                return Err(self.error(&other.name, problem.into()));
            }
        }
        self.passed += self.length as u64;
        self.length = first.values.len();
        self.places = Places {
            outputs,
            time,
            temperature,
        };
        self.block = block;
        self.next = 0;
        Ok(())
    }

    fn value(&self, place: usize) -> Result<f64, Error> {
        let channel = &self.block[place];
        let value = channel.values[self.next - 1];
        if value.is_finite() {
            return Ok(value);
        }
        let number = self.passed + self.next as u64;
        let problem = format!("sample {number} is not a finite number");
        Err(self.error(&channel.name, problem.into()))
    }

    fn error(&self, name: &str, problem: Problem) -> Error {
        Error::Input {
            place: Place {
                column: Some(name.into()),
                ..Place::file(&self.file)
            },
            problem,
        }
    }
}

/// A channel that the file does not have.
pub(super) fn missing(file: &Path, name: &str, heads: &[Head]) -> Error {
    const TOLD: usize = 12;
    let names = heads.iter().take(TOLD).map(|head| clip(&head.name));
    let mut names: Vec<String> = names.collect();
    if heads.len() > TOLD {
        names.push(format!("and {} more", heads.len() - TOLD));
    }
    Error::Input {
        place: Place {
            column: Some(name.into()),
            ..Place::file(file)
        },
        problem: format!("is no channel of the file, which has {}", names.join(", ")).into(),
    }
}

impl Rows for Sampled {
    fn advance(&mut self) -> Result<bool, Error> {
        while self.next >= self.length {
            match self.blocks.next() {
                Some(block) => self.take(block?)?,
                None => return Ok(false),
            }
        }
        self.next += 1;
        Ok(true)
    }

    fn time_s(&self) -> Result<Option<f64>, Error> {
        if let (Some(place), Some((_, units))) = (self.places.time, &self.time) {
            return Ok(Some(self.value(place)? / units));
        }
        let row = self.next - 1;
        Ok(match &self.block[self.places.outputs[0]].clock {
            Clock::Order => None,
            Clock::Rate { hz, start_s } => Some(start_s + (self.passed as f64 + row as f64) / hz),
            Clock::Times(times) => times.get(row).copied(),
        })
    }

    fn group(&self) -> Result<Option<&str>, Error> {
        Ok(None)
    }

    fn temperature_c(&self) -> Result<Option<f64>, Error> {
        self.places.temperature.map(|at| self.value(at)).transpose()
    }

    fn output(&self, axis: usize) -> Result<f64, Error> {
        self.value(self.places.outputs[axis])
    }

    fn output_error(&self, axis: usize, problem: Problem) -> Error {
        self.error(&self.names[axis], problem)
    }

    fn line(&self) -> Option<u64> {
        None
    }

    fn remark(&self) -> Option<&str> {
        self.remark.as_deref()
    }
}
