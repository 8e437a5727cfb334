//! A campaign as a row: `campaign.toml` as text and, of what queries ask, as structs; readings and runs as lists of structs
//! with the names and units of their tables.

use std::path::Path;
use std::sync::Arc;

use arrow::array::{Array, ArrayRef, AsArray};
use arrow::datatypes::{DataType, Field, FieldRef, Schema};
use arrow::error::ArrowError;
use arrow::json::ReaderBuilder;
use host::campaign::{
    Approach, Campaign, CampaignConfig, Drift, Extremes, Measured, Reading, ReferenceMoments, Run,
    Series, VibrationKind,
};
use host::error::{Error, Place};
use serde::Serialize;
use shared::model::SpecificForce;

use crate::cell::Cell;
use crate::row;

row! {
    /// A campaign.
    pub struct CampaignRow {
        /// `campaign.toml`, every key of it.
        toml: String,
        /// Serial number of the instrument.
        serial: String,
        /// The instrument as its type is stated.
        instrument: InstrumentRow,
        /// The static bench.
        bench: BenchRow,
        /// The rows of static.csv.
        readings: Vec<ReadingRow>,
        /// The rows of vibration.csv.
        runs: Vec<RunRow>,
    }
}

row! {
    /// `[instrument]`.
    pub struct InstrumentRow {
        /// Scale factor of the type, V/g.
        scale_factor_nominal_v_per_g: f64,
        /// Range, g.
        full_scale_g: f64,
    }
}

row! {
    /// `[bench]` and where it stands.
    pub struct BenchRow {
        /// `station` of `[record]`.
        station: Option<String>,
        /// `fixture` of `[record]`.
        fixture: Option<String>,
        /// Standard uncertainty of a mark, arcsec.
        dial_sigma_arcsec: f64,
        /// Repeatability of a setting, arcsec.
        dial_repeat_sigma_arcsec: f64,
        /// Standard uncertainty of a remounting angle, arcsec.
        mount_sigma_arcsec: f64,
        /// Standard uncertainty of the level, arcsec.
        level_sigma_arcsec: f64,
        /// Local gravity over g.
        local_gravity_g: f64,
        /// Temperature to which the coefficients belong, degrees Celsius.
        reference_temp_c: f64,
    }
}

row! {
    /// A row of static.csv.
    pub struct ReadingRow {
        /// Sequence number.
        order: u64,
        /// Time since the campaign's start, s.
        time_s: f64,
        /// 1, 2 or 3.
        series: u64,
        /// Dial angle, deg.
        dial_deg: f64,
        /// Remounting angle, deg.
        mount_deg: f64,
        /// `cw` or `ccw`.
        approach: String,
        /// Nominal specific force on IA, g.
        a_i_g: f64,
        /// On PA, g.
        a_p_g: f64,
        /// On OA, g.
        a_o_g: f64,
        /// Temperature, degrees Celsius.
        temp_c: f64,
        /// Mean output, V.
        u_v: f64,
        /// Its standard uncertainty, V.
        sigma_v: f64,
        /// Session.
        session: Option<String>,
        /// Whether it is kept and not used.
        #[serde(default)]
        exclude: bool,
        /// Line of the table.
        #[serde(default)]
        line: u64,
        /// Columns that mean nothing to us.
        #[serde(default)]
        further: Vec<FurtherCell>,
    }
}

row! {
    /// A cell of a column that means nothing to us.
    pub struct FurtherCell {
        /// The column.
        column: String,
        /// The cell.
        text: String,
    }
}

row! {
    /// A row of vibration.csv.
    pub struct RunRow {
        /// Run number.
        run: u64,
        /// Time of the plateau before the vibration, s.
        time_s: f64,
        /// `sine` or `random`.
        kind: String,
        /// Direction on IA.
        dir_i: f64,
        /// On PA.
        dir_p: f64,
        /// On OA.
        dir_o: f64,
        /// Commanded level, g: peak of a sine, rms of random vibration.
        level_g: f64,
        /// Lower edge of the band, Hz.
        f_lo_hz: f64,
        /// Upper edge, Hz.
        f_hi_hz: f64,
        /// Gravity on IA, g.
        a0_i_g: f64,
        /// On PA, g.
        a0_p_g: f64,
        /// On OA, g.
        a0_o_g: f64,
        /// Temperature, degrees Celsius.
        temp_c: f64,
        /// Length of the vibration, s.
        duration_s: f64,
        /// Mean output before, V; with the following absent in a run that is to be predicted.
        u_before_v: Option<f64>,
        /// During, V.
        u_during_v: Option<f64>,
        /// After, V.
        u_after_v: Option<f64>,
        /// Standard uncertainty of each mean, V.
        sigma_v: Option<f64>,
        /// Drift within the vibration, V/s.
        drift_v_per_s: Option<f64>,
        /// Its standard uncertainty, V/s.
        drift_sigma_v_per_s: Option<f64>,
        /// Least output, V.
        u_min_v: Option<f64>,
        /// Greatest output, V.
        u_max_v: Option<f64>,
        /// What the reference saw: rms (g), skewness and kurtosis, each on IA, PA and OA.
        reference: Option<Vec<f64>>,
        /// Its correlations IA-PA, IA-OA, PA-OA.
        reference_correlation: Option<Vec<f64>>,
        /// Session.
        session: Option<String>,
        /// Whether it is kept and not used.
        #[serde(default)]
        exclude: bool,
        /// Line of the table.
        #[serde(default)]
        line: u64,
        /// Columns that mean nothing to us.
        #[serde(default)]
        further: Vec<FurtherCell>,
    }
}

/// The word for its fixture that a campaign has in `[record]`.
pub fn fixture_of(campaign: &Campaign) -> Option<String> {
    let fixture = campaign.config.record.as_ref()?.unknown.get("fixture")?;
    Some(
        fixture
            .as_str()
            .map_or_else(|| fixture.to_string(), str::to_owned),
    )
}

/// The column of campaigns.
pub fn campaign_field() -> FieldRef {
    CampaignRow::field("campaign")
}

fn further(cells: &[(String, String)]) -> Vec<FurtherCell> {
    let cell = |(column, text): &(String, String)| FurtherCell {
        column: column.clone(),
        text: text.clone(),
    };
    cells.iter().map(cell).collect()
}

fn unknown(cells: Vec<FurtherCell>) -> Vec<(String, String)> {
    cells
        .into_iter()
        .map(|cell| (cell.column, cell.text))
        .collect()
}

impl CampaignRow {
    /// The row of a campaign.
    ///
    /// # Errors
    /// Its `campaign.toml` cannot be written as text.
    pub fn new(campaign: &Campaign) -> Result<Self, String> {
        let config = &campaign.config;
        let bench = &config.bench;
        Ok(Self {
            toml: toml::to_string(config).map_err(|error| error.to_string())?,
            serial: config.instrument.serial.clone(),
            instrument: InstrumentRow {
                scale_factor_nominal_v_per_g: config.instrument.scale_factor_nominal_v_per_g,
                full_scale_g: config.instrument.full_scale_g,
            },
            bench: BenchRow {
                station: config
                    .record
                    .as_ref()
                    .and_then(|record| record.station.clone()),
                fixture: fixture_of(campaign),
                dial_sigma_arcsec: bench.dial_sigma_arcsec,
                dial_repeat_sigma_arcsec: bench.dial_repeat_sigma_arcsec,
                mount_sigma_arcsec: bench.mount_sigma_arcsec,
                level_sigma_arcsec: bench.level_sigma_arcsec,
                local_gravity_g: bench.local_gravity_g,
                reference_temp_c: bench.reference_temp_c,
            },
            readings: campaign.readings.iter().map(ReadingRow::from).collect(),
            runs: campaign.runs.iter().map(RunRow::from).collect(),
        })
    }

    /// The campaign of a row. `campaign.toml` as text is what holds.
    ///
    /// # Errors
    /// Those of [`campaign_of`].
    pub fn campaign(self) -> Result<Campaign, Error> {
        campaign_of(&self.toml, self.readings, self.runs)
    }
}

/// The campaign of `campaign.toml` as text and the rows of its tables.
///
/// # Errors
/// Table, row and column with what is wrong there.
pub fn campaign_of(
    toml: &str,
    readings: Vec<ReadingRow>,
    runs: Vec<RunRow>,
) -> Result<Campaign, Error> {
    let config: CampaignConfig = toml::from_str(toml).map_err(|error| {
        let problem = error.message().replace('\n', " ");
        Error::input(Path::new("campaign.toml"), problem)
    })?;
    let readings = readings.into_iter().enumerate();
    let readings = readings.map(|(row, reading)| {
        let at = |(column, problem)| misplaced("static.csv", row, column, problem);
        reading.reading().map_err(at)
    });
    let runs = runs.into_iter().enumerate();
    let runs = runs.map(|(row, run)| {
        let at = |(column, problem)| misplaced("vibration.csv", row, column, problem);
        run.run().map_err(at)
    });
    let campaign = Campaign {
        config,
        readings: readings.collect::<Result<_, _>>()?,
        runs: runs.collect::<Result<_, _>>()?,
    };
    campaign.check()?;
    Ok(campaign)
}

/// What is wrong in a column.
type Misplaced = (&'static str, String);

/// The error of a row, counted from 0, in a table whose header is row 1.
fn misplaced(table: &str, row: usize, column: &str, problem: String) -> Error {
    let place = Place {
        file: table.into(),
        row: Some(row as u64 + 2),
        column: Some(column.into()),
    };
    let problem = problem.into();
    Error::Input { place, problem }
}

impl From<&Reading> for ReadingRow {
    fn from(reading: &Reading) -> Self {
        let a = reading.specific_force_g;
        Self {
            order: reading.order,
            time_s: reading.time_s,
            series: u8::from(reading.series).into(),
            dial_deg: reading.dial_deg,
            mount_deg: reading.mount_deg,
            approach: reading.approach.word().into(),
            a_i_g: a.i,
            a_p_g: a.p,
            a_o_g: a.o,
            temp_c: reading.temp_c,
            u_v: reading.output_v,
            sigma_v: reading.sigma_v,
            session: reading.session.clone(),
            exclude: reading.exclude,
            line: reading.line,
            further: further(&reading.unknown),
        }
    }
}

impl ReadingRow {
    fn reading(self) -> Result<Reading, Misplaced> {
        let series = u8::try_from(self.series)
            .ok()
            .and_then(|number| Series::try_from(number).ok());
        let approach = Approach::of_word(&self.approach);
        Ok(Reading {
            order: self.order,
            time_s: self.time_s,
            series: series
                .ok_or_else(|| ("series", format!("{} is none of 1, 2, 3", self.series)))?,
            dial_deg: self.dial_deg,
            mount_deg: self.mount_deg,
            approach: approach.ok_or_else(|| ("approach", "is neither cw nor ccw".into()))?,
            specific_force_g: SpecificForce::new(self.a_i_g, self.a_p_g, self.a_o_g),
            temp_c: self.temp_c,
            output_v: self.u_v,
            sigma_v: self.sigma_v,
            session: self.session,
            exclude: self.exclude,
            line: self.line,
            unknown: unknown(self.further),
        })
    }
}

impl From<&Run> for RunRow {
    fn from(run: &Run) -> Self {
        let (a, measured) = (run.specific_force_g, run.measured.as_ref());
        let drift = measured.and_then(|m| m.drift);
        let extremes = measured.and_then(|m| m.extremes);
        let reference = run.reference.as_ref();
        Self {
            run: run.run,
            time_s: run.time_s,
            kind: run.kind.word().into(),
            dir_i: run.direction[0],
            dir_p: run.direction[1],
            dir_o: run.direction[2],
            level_g: run.level_g,
            f_lo_hz: run.band_hz[0],
            f_hi_hz: run.band_hz[1],
            a0_i_g: a.i,
            a0_p_g: a.p,
            a0_o_g: a.o,
            temp_c: run.temp_c,
            duration_s: run.duration_s,
            u_before_v: measured.map(|m| m.before_v),
            u_during_v: measured.map(|m| m.during_v),
            u_after_v: measured.and_then(|m| m.after_v),
            sigma_v: measured.map(|m| m.sigma_v),
            drift_v_per_s: drift.map(|drift| drift.v_per_s),
            drift_sigma_v_per_s: drift.map(|drift| drift.sigma_v_per_s),
            u_min_v: extremes.map(|extremes| extremes.minimum_v),
            u_max_v: extremes.map(|extremes| extremes.maximum_v),
            reference: reference.map(|seen| [seen.rms_g, seen.skewness, seen.kurtosis].concat()),
            reference_correlation: reference.and_then(|seen| seen.correlation).map(Vec::from),
            session: run.session.clone(),
            exclude: run.exclude,
            line: run.line,
            further: further(&run.unknown),
        }
    }
}

impl RunRow {
    fn run(self) -> Result<Run, Misplaced> {
        let measured = match (self.u_before_v, self.u_during_v, self.sigma_v) {
            (Some(before_v), Some(during_v), Some(sigma_v)) => Some(Measured {
                before_v,
                during_v,
                after_v: self.u_after_v,
                sigma_v,
                drift: self.drift_v_per_s.zip(self.drift_sigma_v_per_s).map(
                    |(v_per_s, sigma_v_per_s)| Drift {
                        v_per_s,
                        sigma_v_per_s,
                    },
                ),
                extremes: self
                    .u_min_v
                    .zip(self.u_max_v)
                    .map(|(minimum_v, maximum_v)| Extremes {
                        minimum_v,
                        maximum_v,
                    }),
            }),
            (None, None, None) => None,
            _ => {
                let problem = "some of u_before_v, u_during_v and sigma_v are empty";
                return Err(("u_before_v", problem.into()));
            }
        };
        let three = |numbers: &[f64]| <[f64; 3]>::try_from(numbers).ok();
        let correlation = self.reference_correlation.as_deref().map(|numbers| {
            three(numbers).ok_or_else(|| ("reference_correlation", "has not 3 numbers".into()))
        });
        let correlation = correlation.transpose()?;
        let reference = self.reference.map(|numbers| {
            let mut axes = numbers.chunks(3).map(three);
            let mut next = || {
                axes.next()
                    .flatten()
                    .ok_or_else(|| ("reference", "has not 9 numbers".to_owned()))
            };
            Ok::<_, Misplaced>(ReferenceMoments {
                rms_g: next()?,
                skewness: next()?,
                kurtosis: next()?,
                correlation,
            })
        });
        Ok(Run {
            run: self.run,
            time_s: self.time_s,
            kind: VibrationKind::of_word(&self.kind)
                .ok_or_else(|| ("kind", "is neither sine nor random".into()))?,
            direction: [self.dir_i, self.dir_p, self.dir_o],
            level_g: self.level_g,
            band_hz: [self.f_lo_hz, self.f_hi_hz],
            specific_force_g: SpecificForce::new(self.a0_i_g, self.a0_p_g, self.a0_o_g),
            temp_c: self.temp_c,
            duration_s: self.duration_s,
            measured,
            reference: reference.transpose()?,
            session: self.session,
            exclude: self.exclude,
            line: self.line,
            unknown: unknown(self.further),
        })
    }
}

/// Anything that serde writes as a column of structs of that type.
///
/// # Errors
/// A value does not fit its type.
pub fn to_array(rows: &[impl Serialize], data_type: &DataType) -> Result<ArrayRef, ArrowError> {
    let field = Arc::new(Field::new("row", data_type.clone(), true));
    #[derive(Serialize)]
    struct Outer<'r, R> {
        row: &'r R,
    }
    let rows: Vec<_> = rows.iter().map(|row| Outer { row }).collect();
    let mut decoder = ReaderBuilder::new(Arc::new(Schema::new(vec![field.clone()])))
        .with_batch_size(rows.len().max(1))
        .build_decoder()?;
    decoder.serialize(&rows)?;
    match decoder.flush()? {
        Some(batch) => Ok(Arc::clone(batch.column(0))),
        None => Ok(arrow::array::new_empty_array(data_type)),
    }
}

/// Campaigns as a column.
///
/// # Errors
/// A `campaign.toml` that cannot be written.
pub fn encode(rows: &[CampaignRow]) -> Result<ArrayRef, ArrowError> {
    to_array(rows, &CampaignRow::data_type())
}

/// The campaign in a row of a column.
///
/// # Errors
/// A column that is not there, or does not hold what it should.
pub fn decode(column: &dyn Array, row: usize) -> Result<Campaign, String> {
    if column.as_struct_opt().is_none() {
        return Err(format!("is no campaign but {}", column.data_type()));
    }
    let campaign = CampaignRow::read(column, row)?.campaign();
    campaign.map_err(|error| error.to_string())
}
