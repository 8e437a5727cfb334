//! A campaign: all the measurements of one instrument, as a folder of plain files, `vre-campaign/1`.
//!
//! ```text
//! campaign.toml      instrument and bench
//! static.csv         one row per reading at a dial position
//! vibration.csv      one row per shaker run (optional)
//! ```
//!
//! A triad has `positions.csv` instead of `static.csv`: [`TriadCampaign`].
//!
//! Tables are UTF-8 text in any dialect, or a sheet of a workbook; columns are found by name, in any order, with a unit behind it
//! or not; unknown columns are kept and written back. A row marked `exclude` is kept and not used. Whatever is wrong is told with file, row and column.

pub mod columns;
mod config;
pub mod keys;
mod kind;
mod mark_errors;
mod marks;
mod plausibility;
mod positions_table;
pub mod ranges;
mod spectrum_table;
mod static_table;
mod table;
mod toml_file;
mod triad;
mod triad_runs;
mod vibration_table;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

pub use crate::import::MAX_ROW_BYTES;
pub use config::{Acquisition, Bench, CampaignConfig, Instrument, Limits, Record, Shaker};
pub use kind::is_triad;
pub use mark_errors::MarkErrors;
pub use positions_table::TriadPosition;
pub(crate) use positions_table::write as write_positions;
pub use shared::tumble::Series;
pub use spectrum_table::{
    Breakpoint, Density, MissionPoint, SpectrumTable, read_mission, read_spectrum,
};
pub use static_table::{Approach, Reading, read_plan};
pub use table::MAX_ROWS;
pub use triad::{TriadBench, TriadCampaign, TriadConfig, TriadInstrument};
pub use triad_runs::{TriadMeasured, TriadRun, read as read_triad_runs};
pub use vibration_table::{
    BEFORE_TO_AFTER_S, BEFORE_TO_DURING_S, Drift, Extremes, MAX_RUNS, Measured, ReferenceMoments,
    Run, VibrationKind, read_runs, write_runs,
};

use crate::error::{Error, Place, Problem, decimal};
use crate::median::median;
use crate::output::write_csv;
use table::Row;

/// All the measurements of one instrument.
#[derive(Clone, Debug, PartialEq)]
pub struct Campaign {
    /// Instrument and bench.
    pub config: CampaignConfig,
    /// The static readings, in the order of the file; at least one.
    pub readings: Vec<Reading>,
    /// The shaker runs, in the order of time; empty without `vibration.csv`.
    pub runs: Vec<Run>,
}

impl Campaign {
    /// Reads and checks the campaign in `folder`.
    ///
    /// # Errors
    /// The first thing wrong in `campaign.toml`, `static.csv` and `vibration.csv`, in this order.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        if !folder.is_dir() {
            return Err(Error::input(folder, "is not a campaign folder"));
        }
        let config = CampaignConfig::read(&folder.join("campaign.toml"))?;
        let readings = static_table::read(&table_file(folder, "static")?, &config)?;
        let vibration = table_file(folder, "vibration")?;
        let runs = match vibration.exists().then(|| read_runs(&vibration, &config)) {
            // A header without rows is a shaker test that was not made.
            None
            | Some(Err(Error::Input {
                problem: Problem::NoRows,
                ..
            })) => Vec::new(),
            Some(runs) => runs?,
        };
        if readings.iter().all(|reading| reading.exclude) {
            let problem = "every reading is excluded";
            return Err(Error::input(&table_file(folder, "static")?, problem));
        }
        Ok(Self {
            config,
            readings,
            runs,
        })
    }

    /// The campaign without the rows that are excluded: what identification, prediction, diagnosis and plans start from.
    pub fn used(mut self) -> Self {
        self.readings.retain(|reading| !reading.exclude);
        self.runs.retain(|run| !run.exclude);
        self
    }

    /// Number of readings and of runs that are excluded.
    pub fn excluded(&self) -> (usize, usize) {
        let readings = self.readings.iter().filter(|reading| reading.exclude);
        let runs = self.runs.iter().filter(|run| run.exclude);
        (readings.count(), runs.count())
    }

    /// The time from which all times are counted: that of the earliest reading, or of the first run without one, s.
    pub fn start_s(&self) -> f64 {
        let readings_s = self.readings.iter().map(|reading| reading.time_s);
        let run_s = || self.runs.first().map(|run| run.time_s);
        readings_s.reduce(f64::min).or_else(run_s).unwrap_or(0.0)
    }

    /// Checks a campaign that came by another way than its folder: what its tables would not let pass and no fit can bear.
    ///
    /// # Errors
    /// The first number that cannot be, with its table, row and column.
    pub fn check(&self) -> Result<(), Error> {
        self.config.check(Path::new("campaign.toml"))?;
        let fail = |table: &str, row: usize, column: &str, problem: &str| {
            let place = Place {
                file: table.into(),
                row: Some(row as u64 + 2),
                column: Some(column.into()),
            };
            let problem = problem.into();
            Err(Error::Input { place, problem })
        };
        for (row, reading) in self.readings.iter().enumerate() {
            if reading.sigma_v <= 0.0 {
                return fail("static.csv", row, "sigma_v", "is not greater than 0");
            }
        }
        for (row, run) in self.runs.iter().enumerate() {
            let length = run.direction.iter().map(|n| n * n).sum::<f64>().sqrt();
            if (length - 1.0).abs() > 1e-6 {
                return fail(
                    "vibration.csv",
                    row,
                    "dir_i",
                    "the direction is no unit vector",
                );
            }
            if run.duration_s <= 0.0 {
                return fail("vibration.csv", row, "duration_s", "is not greater than 0");
            }
            if run.measured.is_some_and(|measured| measured.sigma_v <= 0.0) {
                return fail("vibration.csv", row, "sigma_v", "is not greater than 0");
            }
        }
        if self.readings.iter().all(|reading| reading.exclude) {
            let problem = "has no reading that is not excluded";
            return Err(Error::input(Path::new("static.csv"), problem));
        }
        Ok(())
    }

    /// Writes the campaign into `folder`, which is made if need be.
    ///
    /// # Errors
    /// What the file system says.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        fs::create_dir_all(folder).map_err(Error::write(folder))?;
        self.config.write(&folder.join("campaign.toml"))?;
        static_table::write(&folder.join("static.csv"), &self.readings)?;
        let vibration = folder.join("vibration.csv");
        if !self.runs.is_empty() {
            write_runs(&vibration, &self.runs)?;
        } else if vibration.exists() {
            // The table of another campaign must not pass for this one's.
            fs::remove_file(&vibration).map_err(Error::write(&vibration))?;
        }
        Ok(())
    }
}

/// Ends of the name of a table's file, in the order in which they are written most.
const ENDS: [&str; 6] = ["csv", "tsv", "txt", "xlsx", "ods", "xls"];

/// The file of a table in a campaign's `folder`: `static.csv`, or one of that name that another program wrote.
///
/// # Errors
/// There are two.
pub(crate) fn table_file(folder: &Path, stem: &str) -> Result<PathBuf, Error> {
    let named = ENDS.map(|end| folder.join(format!("{stem}.{end}")));
    let mut there = named.iter().filter(|file| file.exists());
    match (there.next(), there.next()) {
        (Some(one), Some(other)) => {
            let other = other.file_name().unwrap_or_default().display();
            let problem = format!("stands beside {other}; keep one of them");
            Err(Error::input(one, problem))
        }
        (found, _) => Ok(found.unwrap_or(&named[0]).clone()),
    }
}

/// Cells of columns that mean nothing to us, with their columns' names; kept and written back.
pub type UnknownCells = Vec<(String, String)>;

/// Finds what joining the tables of two instruments leaves behind.
struct OneInstrument<'c> {
    config: &'c CampaignConfig,
    numbers: HashMap<u64, u64>,
    /// Specific force on IA, g, and output, V, of every row at rest.
    outputs: Vec<[f64; 2]>,
}

impl<'c> OneInstrument<'c> {
    /// Relative difference from the nominal scale factor by which no instrument of the type differs.
    const FOREIGN: f64 = 0.25;
    /// Least specific force on IA at which the output tells the scale factor, g.
    const TELLING_G: f64 = 0.25;

    fn new(config: &'c CampaignConfig) -> Self {
        Self {
            config,
            numbers: HashMap::new(),
            outputs: Vec::new(),
        }
    }

    /// `number_column` must not repeat, and a column `serial`, if any, must hold this instrument's.
    fn check_row(&mut self, row: &Row<'_>, number_column: &str) -> Result<u64, Error> {
        let number = row.index(number_column)?;
        if let Some(earlier_row) = self.numbers.insert(number, row.line()) {
            return Err(row.error(
                number_column,
                Problem::Repeated {
                    number,
                    earlier_row,
                },
            ));
        }
        let expected = &self.config.instrument.serial;
        match row.words("serial") {
            Some(found) if found != *expected => {
                let expected = expected.clone();
                Err(row.error("serial", Problem::OtherInstrument { found, expected }))
            }
            _ => Ok(number),
        }
    }

    /// Notes the output at rest of a row.
    fn note_output(&mut self, output_v: f64, input_axis_g: f64) {
        self.outputs.push([input_axis_g, output_v]);
    }

    /// The outputs at rest in `column` must fit the nominal scale factor roughly, by their median: a single one may be a slip,
    /// which is the diagnosis's to tell.
    fn check_outputs(&self, file: &Path, column: &str) -> Result<(), Error> {
        let nominal_v_per_g = self.config.instrument.scale_factor_nominal_v_per_g;
        let telling = |row: &&[f64; 2]| row[0].abs() >= Self::TELLING_G;
        let slopes = self.outputs.iter().filter(telling).map(|[g, v]| v / g);
        let sizes = self.outputs.iter().map(|[_, v]| v.abs());
        let (fits, found) = match (median(slopes.collect()), median(sizes.collect())) {
            (Some(v_per_g), _) => {
                let difference = v_per_g / nominal_v_per_g - 1.0;
                let found = format!("come to {} V/g", rounded(v_per_g));
                (difference.abs() <= Self::FOREIGN, found)
            }
            (None, Some(size_v)) => {
                let found = format!("are about {} V without gravity on IA", rounded(size_v));
                (size_v <= Self::FOREIGN * nominal_v_per_g.abs(), found)
            }
            (None, None) => return Ok(()),
        };
        if fits {
            return Ok(());
        }
        let place = Place {
            column: Some(column.into()),
            ..Place::file(file)
        };
        Err(Error::Input {
            place,
            problem: Problem::Other(format!(
                "the outputs {found}, which does not fit the nominal {nominal_v_per_g} V/g of \
                 campaign.toml; another instrument, or another unit?"
            )),
        })
    }
}

/// With four digits.
fn rounded(value: f64) -> String {
    decimal(format!("{value:.3e}").parse().unwrap_or(value))
}

/// Writes a table: known columns first, then the unknown ones in the order in which they turn up.
fn write_table<'r, R: 'r>(
    file: &Path,
    columns: &[&str],
    rows: &'r [R],
    cells: impl Fn(&'r R) -> Vec<String>,
    unknown: impl Fn(&'r R) -> &'r UnknownCells,
) -> Result<(), Error> {
    let mut extra: Vec<&str> = Vec::new();
    for (name, _) in rows.iter().flat_map(&unknown) {
        if !extra.contains(&name.as_str()) {
            extra.push(name);
        }
    }
    write_csv(file, |writer| {
        writer.write_record(columns.iter().chain(&extra))?;
        for row in rows {
            let further = extra.iter().map(|name| {
                let cell = unknown(row).iter().find(|(column, _)| column == name);
                cell.map_or(String::new(), |(_, text)| text.clone())
            });
            writer.write_record(cells(row).into_iter().chain(further))?;
        }
        Ok(())
    })
}

/// The word that stands for `meaning` in a table.
fn word<T: Copy + PartialEq>(words: &[(&str, T)], meaning: T) -> String {
    word_of(words, meaning).to_owned()
}

fn word_of<'w, T: Copy + PartialEq>(words: &[(&'w str, T)], meaning: T) -> &'w str {
    let found = words.iter().find(|(_, of)| *of == meaning);
    found.map_or("", |(word, _)| word)
}

/// What a word in a table means, if anything.
fn meaning<T: Copy>(words: &[(&str, T)], word: &str) -> Option<T> {
    let found = words.iter().find(|(known, _)| *known == word);
    found.map(|(_, meaning)| *meaning)
}
