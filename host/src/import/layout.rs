//! What a file says of its columns: which is time, which are accelerations, in what units.

use super::{Channels, Dialect, Unit, seconds};

/// The columns of a table as their names and a row of units tell them.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Names of all columns.
    pub names: Vec<String>,
    /// Units by the row of units; empty without such a row.
    units: Vec<String>,
    /// Column of the time, if one is named so.
    pub time: Option<String>,
    /// Columns of a unit of acceleration.
    pub outputs: Vec<String>,
}

impl Layout {
    /// Of a table of this dialect.
    pub fn of(dialect: &Dialect) -> Self {
        Self::new(dialect.names.clone(), dialect.units.clone())
    }

    /// Of a file of channels.
    pub fn of_channels(channels: &Channels) -> Self {
        let heads = channels.heads.iter();
        let units = heads
            .clone()
            .map(|head| head.unit.clone().unwrap_or_default());
        Self::new(
            heads.map(|head| head.name.clone()).collect(),
            units.collect(),
        )
    }

    fn new(names: Vec<String>, units: Vec<String>) -> Self {
        let mut layout = Self {
            names,
            units,
            time: None,
            outputs: Vec::new(),
        };
        let is_time = |name: &&String| {
            let name = name.to_lowercase();
            let first = name.split(['_', ' ', '(', '[']).next().unwrap_or_default();
            ["t", "time", "timestamp", "zeit", "temps"].contains(&first)
        };
        layout.time = layout.names.iter().find(is_time).cloned();
        let acceleration = |name: &&String| layout.unit(name).and_then(Unit::units_per_g).is_some();
        layout.outputs = layout.names.iter().filter(acceleration).cloned().collect();
        layout
    }

    fn stated(&self, name: &str) -> Option<&str> {
        let index = self.names.iter().position(|known| known == name)?;
        Some(self.units.get(index)?.trim_matches(['(', ')', '[', ']']))
    }

    /// A name that stands in the header twice.
    pub fn twice(&self) -> Option<&str> {
        let mut named = self
            .names
            .iter()
            .enumerate()
            .filter(|(_, name)| !name.is_empty());
        let twice = named.find(|(index, name)| self.names[..*index].contains(name));
        twice.map(|(_, name)| name.as_str())
    }

    /// The unit of a column in the file's own words: of a row of units, or in brackets behind the name.
    pub fn unit_text(&self, name: &str) -> Option<String> {
        let stated = self.stated(name).filter(|unit| !unit.is_empty());
        let bracketed = || {
            let at = name.rfind(['(', '['])?;
            name[at + 1..].trim_end().strip_suffix([')', ']'])
        };
        stated.or_else(bracketed).map(str::to_owned)
    }

    /// Unit of an output.
    pub fn unit(&self, name: &str) -> Option<Unit> {
        let stated = self.stated(name).and_then(Unit::parse);
        stated.or_else(|| Unit::of_name(name))
    }

    /// How many units of the time in this column make a second.
    pub fn seconds(&self, name: &str) -> Option<f64> {
        let bracketed = || {
            let at = name.rfind(['(', '['])?;
            seconds(name[at + 1..].trim_end().strip_suffix([')', ']'])?)
        };
        let suffixed = || seconds(name.rsplit_once(['_', ' '])?.1);
        self.stated(name)
            .and_then(seconds)
            .or_else(bracketed)
            .or_else(suffixed)
    }
}
