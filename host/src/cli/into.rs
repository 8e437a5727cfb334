//! `vre measure --into`: plateaus of a record become runs of a campaign.

use std::path::{Path, PathBuf};

use super::within;
use crate::campaign::ranges;
use crate::campaign::{CampaignConfig, Run, is_triad, read_runs, table_file, write_runs};
use crate::error::{Error, Place, clip};
use crate::import::{self, Conversion};
use crate::measure::{self, APART_S, Measurement, MotionSource, Request, Station, Unit};
use crate::output::write_file;

/// Where runs go, and which column is what.
#[derive(clap::Args)]
pub(super) struct Into {
    /// Append the plateaus as runs to vibration.csv of this campaign
    #[arg(
        long = "into",
        value_name = "CAMPAIGN",
        requires = "axes",
        conflicts_with = "before"
    )]
    folder: Option<PathBuf>,
    /// Which column is what: `u` the instrument's output; `ref_i`, `ref_p`, `ref_o` the reference on its axes, in a unit of
    /// acceleration; an axis without reference is taken to stand still
    #[arg(long, value_name = "u=NAME,ref_i=NAME", value_delimiter = ',', value_parser = axis)]
    axes: Vec<(String, String)>,
    /// Gravity on IA, PA and OA during the runs, g; without it, what three axes of the reference show at rest
    #[arg(long, value_name = "I,P,O", value_parser = three, allow_hyphen_values = true, requires = "axes")]
    gravity: Option<Three>,
    /// Direction of the motion on IA, PA and OA; without it, what the reference shows
    #[arg(long, value_name = "I,P,O", value_parser = three, allow_hyphen_values = true, requires = "folder")]
    direction: Option<Three>,
    /// Standard uncertainty of what the reference itself distorts at the largest amplitude, as a share of it, for the
    /// coefficients; by default a hundredth of 1 %: linear within 1 % over its range, of which it uses a hundredth
    #[arg(long, value_name = "SHARE", value_parser = within(&ranges::DISTORTION), requires = "axes")]
    reference_distortion: Option<f64>,
}

/// Distortion of a reference of which nothing is told. Chosen: data sheets tell 1 % at the end of the range, in proportion to the
/// level; the use is a hundredth of the range.
const REFERENCE_DISTORTION: f64 = 1e-4;

/// Three numbers.
type Three = [f64; 3];

/// What a column can be.
const AXES: [&str; 4] = ["u", "ref_i", "ref_p", "ref_o"];

fn axis(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((axis, name)) if AXES.contains(&axis) && !name.is_empty() => {
            Ok((axis.into(), name.into()))
        }
        _ => Err("is none of u=NAME, ref_i=NAME, ref_p=NAME, ref_o=NAME".into()),
    }
}

fn three(text: &str) -> Result<Three, String> {
    let numbers = text.split(',').map(|part| part.trim().parse::<f64>().ok());
    let numbers: Option<Vec<f64>> = numbers.map(|n| n.filter(|n| n.is_finite())).collect();
    numbers
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| "is not three numbers I,P,O".into())
}

/// The campaign that runs are appended to.
pub(super) struct Target {
    table: PathBuf,
    config: CampaignConfig,
    runs: Vec<Run>,
}

impl Into {
    /// The column of the output, if axes are named.
    pub(super) fn output(&self) -> Option<&str> {
        self.column("u")
    }

    fn column(&self, axis: &str) -> Option<&str> {
        let named = self.axes.iter().find(|(known, _)| known == axis);
        named.map(|(_, name)| name.as_str())
    }

    /// The campaign, read before anything is measured.
    ///
    /// # Errors
    /// It is none, or of a triad; its table is a workbook.
    pub(super) fn campaign(&self) -> Result<Option<Target>, Error> {
        if !self.axes.is_empty() && self.output().is_none() {
            return Err(Error::Usage(
                "--axes names no column of the output: u=NAME".into(),
            ));
        }
        let twice = AXES
            .iter()
            .find(|axis| self.axes.iter().filter(|(known, _)| known == *axis).count() > 1);
        if let Some(twice) = twice {
            return Err(Error::Usage(format!("--axes names {twice} twice")));
        }
        let Some(folder) = &self.folder else {
            return Ok(None);
        };
        if is_triad(folder) {
            let line = "--into takes the campaign of one instrument, not of a triad";
            return Err(Error::Usage(line.into()));
        }
        let config = CampaignConfig::read(&folder.join("campaign.toml"))?;
        let table = table_file(folder, "vibration")?;
        if table.extension().is_none_or(|end| end != "csv") {
            let problem = "is a workbook, to which no run is appended; save it as vibration.csv";
            return Err(Error::input(&table, problem));
        }
        let runs = match table.exists() {
            true => read_runs(&table, &config)?,
            false => Vec::new(),
        };
        Ok(Some(Target {
            table,
            config,
            runs,
        }))
    }

    fn direction(&self) -> Result<Option<Three>, Error> {
        let Some(direction) = self.direction else {
            return Ok(None);
        };
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length <= 0.0 {
            return Err(Error::Usage("--direction has no length".into()));
        }
        Ok(Some(direction.map(|x| x / length)))
    }

    /// Where the motion is seen, for coefficients from the waveform; none without a reference on IA.
    ///
    /// # Errors
    /// A reference that is no column of a unit of acceleration.
    pub(super) fn motion(
        &self,
        file: &Path,
        output_units_per_g: f64,
    ) -> Result<Option<MotionSource>, Error> {
        let [along, p, o] = self.reference(file)?;
        Ok(along.map(|(column, units_per_g)| MotionSource {
            column,
            units_per_g,
            output_units_per_g,
            across: [p, o].into_iter().flatten().collect(),
            distortion: self.reference_distortion.unwrap_or(REFERENCE_DISTORTION),
            gravity_g: self.gravity.map(|[along, ..]| along),
        }))
    }

    /// Columns and units of the reference.
    fn reference(&self, file: &Path) -> Result<[Option<(String, f64)>; 3], Error> {
        let names = ["ref_i", "ref_p", "ref_o"].map(|axis| self.column(axis));
        let wanted: Vec<&str> = names.iter().flatten().copied().collect();
        let layout = import::layout(file, &wanted)?;
        let mut found = [None, None, None];
        for (place, name) in found.iter_mut().zip(names) {
            let Some(name) = name else { continue };
            let units = layout.unit(name).and_then(Unit::units_per_g).ok_or_else(|| Error::Input {
                place: Place {
                    column: Some(name.into()),
                    ..Place::file(file)
                },
                problem: "is no column of a unit of acceleration, as a reference must be: name_g, name (m/s2)".into(),
            })?;
            *place = Some((name.to_owned(), units));
        }
        Ok(found)
    }
}

/// Volts of one unit of a column, by its unit or the end of its name; 1 of counts, and where nothing is told.
fn volts(file: &Path, column: &str) -> Result<f64, Error> {
    let told = import::layout(file, &[column])?.unit_text(column);
    let unit = told
        .as_deref()
        .or(column.rsplit_once('_').map(|(_, end)| end));
    let unit = match unit.unwrap_or_default() {
        "mv" => "mV",
        "uv" => "uV",
        unit => unit,
    };
    Ok(Conversion::between(unit, "V").map_or(1.0, |conversion| conversion.of(1.0)))
}

impl Target {
    /// Scale factor of the instrument's type, V/g.
    fn scale_v_per_g(&self) -> f64 {
        self.config.instrument.scale_factor_nominal_v_per_g
    }

    /// The same in units of a column of volts, millivolts or counts.
    pub(super) fn units_per_g(&self, file: &Path, column: &str) -> Result<f64, Error> {
        Ok(self.scale_v_per_g() / volts(file, column)?)
    }

    /// Appends the plateaus as runs; tells how many. An output of `electrical` unit is written in its volts, one of a unit of
    /// acceleration by the scale factor of the instrument's type.
    ///
    /// # Errors
    /// No plateau was looked for; a run that no campaign can have; the table cannot be written.
    pub(super) fn append(
        mut self,
        file: &Path,
        into: &Into,
        request: &Request,
        found: &Measurement,
        electrical: bool,
    ) -> Result<String, Error> {
        let station = Station {
            reference: into.reference(file)?,
            gravity_g: into.gravity,
            direction: into.direction()?,
            volts_per_g: match into.output() {
                Some(column) if electrical => {
                    request.calibration.units_per_g * volts(file, column)?
                }
                _ => self.scale_v_per_g(),
            },
            temperature_c: self.config.bench.reference_temp_c,
        };
        let number = self.runs.iter().map(|run| run.run + 1).max().unwrap_or(0);
        let last = self
            .runs
            .iter()
            .map(|run| run.time_s)
            .fold(f64::NEG_INFINITY, f64::max);
        let from_s = if last.is_finite() {
            last + APART_S
        } else {
            APART_S
        };
        let new = measure::runs(file, &request.columns, found, &station, number, from_s)?;
        let count = new.len();
        let excluded = new.iter().filter(|run| run.exclude).count();
        self.runs.extend(new);
        self.write()?;
        let left_out = match excluded {
            0 => String::new(),
            excluded => format!("; {excluded} excluded, whose shift is not the vibration's"),
        };
        let table = clip(&self.table.display().to_string());
        Ok(format!("{count} runs appended to {table}{left_out}\n"))
    }

    /// Writes the table; where it does not read back, what was there before stands again.
    fn write(&self) -> Result<(), Error> {
        let before = std::fs::read(&self.table).ok();
        write_runs(&self.table, &self.runs)?;
        let Err(error) = read_runs(&self.table, &self.config) else {
            return Ok(());
        };
        match before {
            Some(before) => write_file(&self.table, &before)?,
            None => std::fs::remove_file(&self.table).map_err(Error::write(&self.table))?,
        }
        Err(error)
    }
}
