//! What a campaign's own columns say against each other, before anything is fitted.
//!
//! ```text
//! command, reference  -> levels      extremes, mean, level -> extremes
//! reference's signs   -> signs       full scale, gravity   -> bounds
//! a reading or run that a fit sets aside -> slip: the one slip of the hand that makes sense of it
//! ```
//!
//! An effect of the instrument, fixture or shaker contradicts nothing here: see the limits of each check. Rows marked
//! `exclude` are not looked at.

mod bounds;
mod cells;
mod extremes;
mod levels;
mod likely;
mod robust;
mod signs;
mod slip;

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

pub use cells::{Impossible, impossible};
pub use slip::{slip, slip_of_run};

use crate::campaign::{Campaign, Run, VibrationKind};
use crate::error::{Error, Place, Problem};

/// The option of the command line that goes on where all rows alike contradict.
pub const ACCEPT_OPTION: &str = "--accept-contradictions";

/// Two columns that cannot both be right.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contradiction {
    /// The columns, or keys of `campaign.toml`.
    pub between: [String; 2],
    /// What the first says over what the second says of the same quantity; -1 for a sign, 1 for a value that repeats.
    pub factor: f64,
    /// Where.
    pub rows: Rows,
    /// What would make sense of it.
    pub likely: String,
}

/// The rows of vibration.csv that contradict.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Rows {
    /// All rows of a kind, in words such as `all sines`.
    All(String),
    /// Some runs, by their numbers.
    Some(Vec<u64>),
}

impl Contradiction {
    /// Of all rows of a kind.
    pub(crate) fn all(
        between: [&str; 2],
        factor: f64,
        rows: impl Into<String>,
        likely: String,
    ) -> Self {
        let rows = Rows::All(rows.into());
        Self::new(between, factor, rows, likely)
    }

    /// Of the runs at these places.
    fn some(
        campaign: &Campaign,
        between: [&str; 2],
        factor: f64,
        places: &[usize],
        likely: String,
    ) -> Self {
        let number = |&place: &usize| campaign.runs[place].run;
        let rows = Rows::Some(places.iter().map(number).collect());
        Self::new(between, factor, rows, likely)
    }

    fn new(between: [&str; 2], factor: f64, rows: Rows, likely: String) -> Self {
        Self {
            between: between.map(str::to_owned),
            factor,
            rows,
            likely,
        }
    }

    /// Whether all rows of a kind are concerned: nothing can be said of the campaign before that is settled.
    pub fn is_of_all(&self) -> bool {
        matches!(self.rows, Rows::All(_))
    }

    /// Places in `runs` of the single runs that contradict; none where all of a kind do.
    pub fn places(&self, runs: &[Run]) -> Vec<usize> {
        let Rows::Some(numbers) = &self.rows else {
            return Vec::new();
        };
        let named = |(_, run): &(usize, &Run)| numbers.contains(&run.run);
        let places = runs.iter().enumerate().filter(named);
        places.map(|(place, _)| place).collect()
    }
}

impl fmt::Display for Contradiction {
    /// `all sines: level_g is 0.707 times what ref_*_rms_g says; rms entered for peak in level_g`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.rows {
            Rows::All(words) => write!(f, "{words}: ")?,
            Rows::Some(numbers) => {
                let numbers: Vec<String> = numbers.iter().map(u64::to_string).collect();
                let runs = if numbers.len() == 1 { "run" } else { "runs" };
                write!(f, "{runs} {}: ", numbers.join(", "))?;
            }
        }
        let [one, other] = &self.between;
        if self.factor < 0.0 {
            write!(f, "the sign of {one} is not that of {other}")?;
        } else if self.factor == 1.0 {
            write!(f, "{one} and {other}")?;
        } else {
            let factor = likely::typed(self.factor);
            write!(f, "{one} is {factor} times what {other} says")?;
        }
        write!(f, "; {}", self.likely)
    }
}

/// All contradictions of a campaign, those of all rows first; none in a sound one, whatever effects act.
pub fn contradictions(campaign: &Campaign) -> Vec<Contradiction> {
    let mut found = cells::repeated(campaign);
    let places = found.iter().flat_map(|one| one.places(&campaign.runs));
    let places: Vec<usize> = places.collect();
    found.extend(levels::contradictions(campaign, &places));
    found.extend(signs::contradictions(campaign));
    found.extend(bounds::gravity(campaign));
    let of_extremes = extremes::contradictions(campaign, &found);
    found.extend(of_extremes);
    if !found.iter().any(Contradiction::is_of_all) {
        found.extend(bounds::full_scale(campaign));
    }
    found.sort_by_key(|contradiction| !contradiction.is_of_all());
    found
}

/// What of the campaign in `folder` contradicts itself and may be gone on with: single runs, and what the user `accepts`.
///
/// # Errors
/// A cell that cannot be; a contradiction of all rows of a kind that the user does not accept.
pub fn check(
    folder: &Path,
    campaign: &Campaign,
    accepts: bool,
) -> Result<Vec<Contradiction>, Error> {
    let file = folder.join("vibration.csv");
    let place = |row: Option<u64>, column: &str| Place {
        row,
        column: Some(column.into()),
        ..Place::file(&file)
    };
    if let Some(cell) = impossible(campaign) {
        return Err(Error::Input {
            place: place(Some(campaign.runs[cell.place].line), cell.column),
            problem: Problem::Other(cell.problem),
        });
    }
    let found = contradictions(campaign);
    let mut of_all = found
        .iter()
        .filter(|contradiction| contradiction.is_of_all());
    match of_all.next() {
        Some(contradiction) if !accepts => {
            let further = match of_all.count() {
                0 => String::new(),
                count => format!(" (and {count} more of this kind)"),
            };
            Err(Error::Input {
                place: place(None, &contradiction.between[0]),
                problem: Problem::Other(format!(
                    "{contradiction}{further}; correct it, or go on with {ACCEPT_OPTION}"
                )),
            })
        }
        _ => Ok(found),
    }
}

/// Least direction cosine of an axis that counts as driven: motion across the drive has no more.
const DRIVEN: f64 = 0.3;

/// Least rms, g, that is compared: below it a reference's own noise of some milli-g tells.
const LEAST_RMS_G: f64 = 0.02;

/// The runs that are looked at, with their places.
fn runs(campaign: &Campaign) -> impl Iterator<Item = (usize, &Run)> {
    let used = |(_, run): &(usize, &Run)| !run.exclude;
    campaign.runs.iter().enumerate().filter(used)
}

/// Rms of a run's command along its direction, g.
fn commanded_rms_g(run: &Run) -> f64 {
    match run.kind {
        VibrationKind::Sine => run.level_g * std::f64::consts::FRAC_1_SQRT_2,
        VibrationKind::Random => run.level_g,
    }
}

/// Axes that a run drives.
fn driven(run: &Run) -> impl Iterator<Item = usize> {
    let direction = run.direction;
    (0..3).filter(move |&axis| direction[axis].abs() > DRIVEN)
}

/// The axis with the largest direction cosine, the first of equals: a table that is not guided straight leaves it alone.
fn main_axis(run: &Run) -> usize {
    let largest = run
        .direction
        .iter()
        .fold(0.0_f64, |most, n| most.max(n.abs()));
    let near = |n: &f64| n.abs() > largest - 1e-6;
    run.direction.iter().position(near).unwrap_or_default()
}

const KINDS: [VibrationKind; 2] = [VibrationKind::Sine, VibrationKind::Random];

/// The kind's runs in words.
fn all_of(kind: VibrationKind) -> &'static str {
    match kind {
        VibrationKind::Sine => "all sines",
        VibrationKind::Random => "all random runs",
    }
}

const AXES: [&str; 3] = ["IA", "PA", "OA"];
const REFERENCE: [&str; 3] = ["ref_i_rms_g", "ref_p_rms_g", "ref_o_rms_g"];
const ANY_REFERENCE: &str = "ref_*_rms_g";
const LEVEL: &str = "level_g";
