//! What persons and devices of a laboratory do that a campaign does not state.
//!
//! ```text
//! bench as stated -> device acts (sessions, table, reference) -> campaign -> acts of a hand (slips, units, blanks) -> campaign, truth
//! ```
//!
//! An imperfection acts where it does in a laboratory: a device of the bench does something else than the campaign states,
//! or a hand writes something else than was measured. None knows what an answer will make of it. Adding one is an
//! [`Entry`] in the file of its subject.

mod angles;
mod blanks;
mod gross;
mod instrument;
mod levels;
mod occurrence;
mod reference;
mod sessions;
mod signs;
mod stated;
mod table;

use std::collections::BTreeMap;
use std::str::FromStr;

use super::simulate::{Simulation, VirtualBench};
use occurrence::{Occurrence, Tables};

/// The size of an imperfection.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Without another word.
    pub usual: f64,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// Both ends of what it can be, neither allowed.
    pub between: [f64; 2],
}

/// How an imperfection comes about.
enum Act {
    /// A device of the bench does it.
    Device(fn(&mut VirtualBench, &mut Occurrence)),
    /// A hand does it in the tables.
    Hand(fn(&mut Tables<'_>, &mut Occurrence)),
    /// Others at once, by identifier and size.
    Several(&'static [(&'static str, f64)]),
}

/// One imperfection that the bench can have.
pub struct Entry {
    /// Identifier.
    pub id: &'static str,
    /// What it says, with SIZE where its size stands.
    pub says: &'static str,
    /// Its size; `None` if it has none.
    pub size: Option<Size>,
    act: Act,
}

/// The imperfection of a typical size, between the ends.
const fn sized(usual: f64, unit: &'static str, between: [f64; 2]) -> Option<Size> {
    Some(Size {
        usual,
        unit,
        between,
    })
}

/// Several small ones at once.
const TOGETHER: &[Entry] = &[Entry {
    id: "plausible",
    says: "several small ones: noise 1.3, cross 1 %, gain 0.3 %, 2 mg, table 0.3 %",
    size: None,
    act: Act::Several(&[
        ("noise-all", 1.3),
        ("reference-cross", 0.01),
        ("reference-gain", 0.003),
        ("reference-noise", 2.0),
        ("table-scatter", 0.003),
    ]),
}];

/// Every imperfection that the bench can have.
pub fn catalogue() -> impl Iterator<Item = &'static Entry> {
    [
        sessions::ENTRIES,
        stated::ENTRIES,
        gross::ENTRIES,
        angles::ENTRIES,
        levels::ENTRIES,
        signs::ENTRIES,
        reference::ENTRIES,
        table::ENTRIES,
        blanks::ENTRIES,
        instrument::ENTRIES,
        TOGETHER,
    ]
    .into_iter()
    .flatten()
}

/// The entry of that identifier.
pub fn find(id: &str) -> Option<&'static Entry> {
    catalogue().find(|entry| entry.id == id)
}

impl Entry {
    /// The single acts that it comes to, each with its size.
    fn acts(&'static self, size: f64) -> Vec<(&'static Act, f64)> {
        let Act::Several(parts) = &self.act else {
            return vec![(&self.act, size)];
        };
        let part = |&(id, size): &(&str, f64)| Some((&find(id)?.act, size));
        parts.iter().filter_map(part).collect()
    }
}

/// An imperfection of a certain size, `ID` or `ID:SIZE`.
#[derive(Clone, Copy)]
pub struct Imperfection {
    /// What.
    pub entry: &'static Entry,
    /// Its size; `None` of what either happens or not.
    pub size: Option<f64>,
}

impl From<&'static Entry> for Imperfection {
    /// Of its usual size.
    fn from(entry: &'static Entry) -> Self {
        let size = entry.size.map(|size| size.usual);
        Self { entry, size }
    }
}

impl FromStr for Imperfection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (id, size) = match text.split_once(':') {
            Some((id, size)) => (id, Some(size)),
            None => (text, None),
        };
        let entry = find(id).ok_or_else(|| {
            let known: Vec<&str> = catalogue().map(|entry| entry.id).collect();
            format!("none of the bench's imperfections: {}", known.join(", "))
        })?;
        match (size, entry.size) {
            (None, _) => Ok(entry.into()),
            (Some(_), None) => Err(format!("{id} has no size")),
            (Some(text), Some(size)) => {
                let [low, high] = size.between;
                let number = text.parse::<f64>().ok();
                let number = number.filter(|number| *number > low && *number < high);
                let size = number.ok_or_else(|| {
                    let of = format!("{} {}", size.usual, size.unit);
                    format!(
                        "the size of {id} is a number between {low} and {high}, as {}",
                        of.trim_end()
                    )
                })?;
                Ok(Self {
                    entry,
                    size: Some(size),
                })
            }
        }
    }
}

/// A campaign of the bench with these imperfections; without one it is [`VirtualBench::simulate`]. One that is given twice
/// happens twice, each time by draws of its own.
pub fn simulate(mut bench: VirtualBench, imperfections: &[Imperfection]) -> Simulation {
    let mut times: BTreeMap<&str, u64> = BTreeMap::new();
    let begin = |imperfection: &Imperfection| {
        let earlier = times.entry(imperfection.entry.id).or_default();
        let occurrence = Occurrence::new(imperfection, bench.seed, *earlier);
        *earlier += 1;
        occurrence
    };
    let mut occurrences: Vec<Occurrence> = imperfections.iter().map(begin).collect();
    for occurrence in &mut occurrences {
        for (act, size) in occurrence.entry.acts(occurrence.size) {
            if let Act::Device(act) = act {
                occurrence.size = size;
                act(&mut bench, occurrence);
            }
        }
    }
    let mut simulation = bench.simulate();
    for mut occurrence in occurrences {
        let mut tables = Tables {
            campaign: &mut simulation.campaign,
            holdout: &mut simulation.holdout,
        };
        for (act, size) in occurrence.entry.acts(occurrence.size) {
            if let Act::Hand(act) = act {
                occurrence.size = size;
                act(&mut tables, &mut occurrence);
            }
        }
        let truth = occurrence.truth(&tables);
        simulation.truth.imperfections.push(truth);
    }
    simulation
}

/// All imperfections for a terminal of 80 columns: identifier with its usual size, and below it what it says.
pub fn listed() -> String {
    let row = |entry: &Entry| {
        let size = entry.size.map(|size| {
            let of = format!("{} {}", size.usual, size.unit);
            format!("[:{}]", of.trim_end())
        });
        format!(
            "  {}{}\n      {}\n",
            entry.id,
            size.unwrap_or_default(),
            entry.says
        )
    };
    catalogue().map(row).collect()
}
