//! One imperfection in one campaign: what is drawn of it, and the rows that it touches.

use std::collections::BTreeSet;

use super::{Entry, Imperfection};
use crate::bench::noise::{Seed, Stream};
use crate::bench::simulate::ImperfectionTruth;
use crate::campaign::{Campaign, Run};

/// The tables that a hand writes.
pub(super) struct Tables<'a> {
    /// campaign.toml, static.csv and vibration.csv.
    pub(super) campaign: &'a mut Campaign,
    /// holdout.csv.
    pub(super) holdout: &'a mut [Run],
}

impl Tables<'_> {
    /// Does something to every run, held out or not, that it concerns: `act` tells whether.
    pub(super) fn every_run(
        &mut self,
        occurrence: &mut Occurrence,
        mut act: impl FnMut(&mut Run) -> bool,
    ) {
        for (place, run) in self.campaign.runs.iter_mut().enumerate() {
            if act(run) {
                occurrence.touch(File::Vibration, place);
            }
        }
        for (place, run) in self.holdout.iter_mut().enumerate() {
            if act(run) {
                occurrence.touch(File::Holdout, place);
            }
        }
    }
}

/// A file of a campaign.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum File {
    Config,
    Static,
    Vibration,
    Holdout,
}

impl File {
    fn name(self) -> &'static str {
        match self {
            Self::Config => "campaign.toml",
            Self::Static => "static.csv",
            Self::Vibration => "vibration.csv",
            Self::Holdout => "holdout.csv",
        }
    }

    fn rows(self, tables: &Tables<'_>) -> usize {
        match self {
            Self::Config => 1,
            Self::Static => tables.campaign.readings.len(),
            Self::Vibration => tables.campaign.runs.len(),
            Self::Holdout => tables.holdout.len(),
        }
    }
}

/// One imperfection in one campaign.
pub(super) struct Occurrence {
    pub(super) entry: &'static Entry,
    /// Its size; 0 of what has none.
    pub(super) size: f64,
    /// Where its randomness comes from.
    pub(super) stream: Stream,
    stated: Option<f64>,
    parameters: serde_json::Map<String, serde_json::Value>,
    touched: BTreeSet<(File, usize)>,
}

impl Occurrence {
    /// The one of that imperfection after so many `earlier` ones.
    pub(super) fn new(imperfection: &Imperfection, seed: Seed, earlier: u64) -> Self {
        let entry = imperfection.entry;
        Self {
            entry,
            size: imperfection.size.unwrap_or_default(),
            stream: seed.stream(&format!("imperfection {}", entry.id), earlier),
            stated: imperfection.size,
            parameters: serde_json::Map::new(),
            touched: BTreeSet::new(),
        }
    }

    /// Its size with a sign of chance.
    pub(super) fn signed_size(&mut self) -> f64 {
        self.size * self.stream.sign()
    }

    /// Notes a parameter, its unit at the end of its name.
    pub(super) fn note(&mut self, name: &str, value: impl Into<serde_json::Value>) {
        self.parameters.insert(name.into(), value.into());
    }

    /// Notes the row at a place of a file, counted from 0.
    pub(super) fn touch(&mut self, file: File, place: usize) {
        self.touched.insert((file, place));
    }

    /// Notes all of so many rows of a file.
    pub(super) fn touch_rows(&mut self, file: File, places: std::ops::Range<usize>) {
        self.touched.extend(places.map(|place| (file, place)));
    }

    /// So many different ones of the `candidates`, or all of them, in their order.
    pub(super) fn choose(&mut self, count: usize, mut candidates: Vec<usize>) -> Vec<usize> {
        self.stream.shuffle(&mut candidates);
        candidates.truncate(count);
        candidates.sort_unstable();
        candidates
    }

    /// What is told of it.
    pub(super) fn truth(self, tables: &Tables<'_>) -> ImperfectionTruth {
        let mut rows = Vec::new();
        for file in [File::Config, File::Static, File::Vibration, File::Holdout] {
            let touched = self.touched.iter().filter(|(of, _)| *of == file);
            let places: Vec<usize> = touched.map(|(_, place)| *place).collect();
            if places.len() == file.rows(tables) && !places.is_empty() {
                rows.push(file.name().to_owned());
            } else {
                // The header is line 1.
                rows.extend(
                    places
                        .iter()
                        .map(|place| format!("{}:{}", file.name(), place + 2)),
                );
            }
        }
        ImperfectionTruth {
            id: self.entry.id,
            size: self.stated,
            unit: self.entry.size.map_or("", |size| size.unit),
            parameters: self.parameters,
            rows,
        }
    }
}
