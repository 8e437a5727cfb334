//! `vibration.csv`: one row per shaker run, made or still to be predicted.

use std::path::Path;

use shared::model::SpecificForce;

use super::config::CampaignConfig;
use super::table::{Row, Table};
use super::{OneInstrument, UnknownCells, word, write_table};
use crate::error::{Error, Problem};

/// The kind of a commanded vibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VibrationKind {
    /// One frequency; the level is the peak amplitude.
    Sine,
    /// Gaussian noise, flat over the band; the level is the rms.
    Random,
}

const KINDS: [(&str, VibrationKind); 2] = [
    ("sine", VibrationKind::Sine),
    ("random", VibrationKind::Random),
];

/// One shaker run.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Run number, unique within the table.
    pub run: u64,
    /// Time from the campaign's start to the centre of the plateau before the vibration, s. The plateau
    /// during it is centred 20 s later, that after it 40 s later.
    pub time_s: f64,
    /// Kind of the vibration.
    pub kind: VibrationKind,
    /// Unit vector of the commanded motion on IA, PA and OA.
    pub direction: [f64; 3],
    /// Commanded level along the direction, g: peak of a sine, rms of a random vibration; not negative.
    pub level_g: f64,
    /// Lower and upper edge of the band, Hz; a sine's frequency twice.
    pub band_hz: [f64; 2],
    /// Gravity on the instrument's axes during the run, g.
    #[doc(alias = "a0")]
    pub specific_force_g: SpecificForce<f64>,
    /// Temperature of the instrument, degrees Celsius.
    pub temp_c: f64,
    /// Length of the vibration, s; also the averaging time of the plateau during it and of the
    /// reference's moments.
    pub duration_s: f64,
    /// What was measured; `None` in a run that is to be predicted.
    pub measured: Option<Measured>,
    /// What the reference accelerometer on the table saw.
    pub reference: Option<ReferenceMoments>,
    /// Columns that mean nothing to us.
    pub unknown: UnknownCells,
}

impl Run {
    /// The same run before it was made: nothing is measured.
    pub fn unmade(&self) -> Self {
        Self {
            measured: None,
            ..self.clone()
        }
    }
}

/// The instrument's output in one run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Mean output before the vibration, V.
    pub before_v: f64,
    /// Mean output during the vibration, V.
    pub during_v: f64,
    /// Mean output after the vibration, V.
    pub after_v: f64,
    /// Standard uncertainty of each of the three means from noise alone, V; greater than zero.
    pub sigma_v: f64,
    /// (Level at the end of the vibration - level at its start) / duration, V/s.
    pub drift_v_per_s: f64,
    /// Standard uncertainty of the drift, V/s; greater than zero.
    pub drift_sigma_v_per_s: f64,
    /// Extremes of the output, if a peak detector was there.
    pub extremes: Option<Extremes>,
}

/// Extremes of the output during a run, from an analogue peak detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremes {
    /// Least output, V.
    pub minimum_v: f64,
    /// Greatest output, V.
    pub maximum_v: f64,
}

/// Moments of the table's motion, each on IA, PA and OA.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceMoments {
    /// Root mean square, g.
    pub rms_g: [f64; 3],
    /// Third standardized moment; 0 on an axis that stands still.
    pub skewness: [f64; 3],
    /// Fourth standardized moment (3 for Gaussian noise); 0 on an axis that stands still.
    pub kurtosis: [f64; 3],
    /// Correlation coefficients IA-PA, IA-OA, PA-OA; 0 where an axis stands still. `None` if the table has
    /// no such columns.
    pub correlation: Option<[f64; 3]>,
}

/// From the centre of the plateau before a vibration to the centre of the vibration, s.
pub const BEFORE_TO_DURING_S: f64 = 20.0;
/// From the centre of the plateau before a vibration to that of the plateau after it, s.
pub const BEFORE_TO_AFTER_S: f64 = 40.0;

/// Largest skewness or kurtosis that is taken for a record's.
const MAX_SHAPE: f64 = 1e4;

const DIRECTION: [&str; 3] = ["dir_i", "dir_p", "dir_o"];
const GRAVITY: [&str; 3] = ["a0_i_g", "a0_p_g", "a0_o_g"];
const OUTPUT: [&str; 8] = [
    "u_before_v",
    "u_during_v",
    "u_after_v",
    "sigma_v",
    "drift_v_per_s",
    "drift_sigma_v_per_s",
    "u_min_v",
    "u_max_v",
];
const RMS: [&str; 3] = ["ref_i_rms_g", "ref_p_rms_g", "ref_o_rms_g"];
const SKEWNESS: [&str; 3] = ["ref_i_skew", "ref_p_skew", "ref_o_skew"];
const KURTOSIS: [&str; 3] = ["ref_i_kurt", "ref_p_kurt", "ref_o_kurt"];
const CORRELATION: [&str; 3] = ["ref_ip_corr", "ref_io_corr", "ref_po_corr"];

const CONDITIONS: [&str; 14] = [
    "run",
    "time_s",
    "kind",
    "dir_i",
    "dir_p",
    "dir_o",
    "level_g",
    "f_lo_hz",
    "f_hi_hz",
    "a0_i_g",
    "a0_p_g",
    "a0_o_g",
    "temp_c",
    "duration_s",
];

/// Greatest departure of a direction's length from 1.
const UNIT_TOLERANCE: f64 = 1e-6;

/// Reads and checks a table of runs: `vibration.csv` of a campaign, or runs to be predicted.
///
/// # Errors
/// The first thing wrong in the file, with row and column.
pub fn read_runs(file: &Path, config: &CampaignConfig) -> Result<Vec<Run>, Error> {
    let required = [CONDITIONS.as_slice(), &OUTPUT].concat();
    let moments = [RMS, SKEWNESS, KURTOSIS].concat();
    let known = [required.as_slice(), &moments, &CORRELATION].concat();
    let mut table = Table::open(file, &required)?;
    table.require_all_or_none(&moments)?;
    table.require_all_or_none(&CORRELATION)?;
    let mut instrument = OneInstrument::new(config);
    let mut runs: Vec<Run> = Vec::new();
    while let Some(row) = table.next_row()? {
        let number = instrument.check_row(&row, "run")?;
        let run = run(&row, number, &known)?;
        if let Some(earlier) = runs.last().filter(|earlier| earlier.time_s > run.time_s) {
            let problem = format!(
                "{} is before {} of the row above",
                run.time_s, earlier.time_s
            );
            return Err(row.error("time_s", problem));
        }
        if let Some(measured) = &run.measured {
            let input_axis_g = run.specific_force_g.i;
            instrument.check_output(&row, "u_before_v", measured.before_v, input_axis_g)?;
        }
        runs.push(run);
    }
    Ok(runs)
}

fn run(row: &Row<'_>, number: u64, known: &[&str]) -> Result<Run, Error> {
    let [i, p, o] = row.numbers(GRAVITY)?;
    let kind = row.one_of("kind", &KINDS, "a kind: sine or random")?;
    Ok(Run {
        run: number,
        time_s: row.number("time_s")?,
        kind,
        direction: direction(row)?,
        level_g: row.within("level_g", 0.0, 1e6)?,
        band_hz: band(row, kind)?,
        specific_force_g: SpecificForce::new(i, p, o),
        temp_c: row.within("temp_c", -273.15, 1000.0)?,
        duration_s: row.positive("duration_s")?,
        measured: measured(row)?,
        reference: reference(row)?,
        unknown: row.unknown(known),
    })
}

fn direction(row: &Row<'_>) -> Result<[f64; 3], Error> {
    let direction = row.numbers(DIRECTION)?;
    let length = direction
        .iter()
        .map(|cosine| cosine * cosine)
        .sum::<f64>()
        .sqrt();
    if (length - 1.0).abs() <= UNIT_TOLERANCE {
        return Ok(direction);
    }
    let problem = format!("the direction is {length} long, not a unit vector");
    Err(row.error(DIRECTION[0], problem))
}

fn band(row: &Row<'_>, kind: VibrationKind) -> Result<[f64; 2], Error> {
    let low_hz = row.within("f_lo_hz", 0.0, 1e9)?;
    let high_hz = row.positive("f_hi_hz")?;
    let problem = match kind {
        _ if high_hz < low_hz => format!("{high_hz} is below f_lo_hz = {low_hz}"),
        VibrationKind::Sine if high_hz > low_hz => {
            format!("{high_hz} is not f_lo_hz = {low_hz}, but a sine has one frequency")
        }
        VibrationKind::Random if high_hz == low_hz => {
            format!("{high_hz} is f_lo_hz too, which leaves a random vibration no band")
        }
        _ => return Ok([low_hz, high_hz]),
    };
    Err(row.error("f_hi_hz", problem))
}

/// The measured output, or `None` where all three plateaus are empty. In a row without output the
/// further cells of it (sigma, drift, extremes) may be filled, must be sound, and are not kept.
fn measured(row: &Row<'_>) -> Result<Option<Measured>, Error> {
    let [
        before,
        during,
        after,
        sigma,
        drift,
        drift_sigma,
        minimum,
        maximum,
    ] = OUTPUT;
    if [before, during, after]
        .iter()
        .all(|plateau| row.text(plateau).is_none())
    {
        for column in [sigma, drift_sigma] {
            row.text(column).map(|_| row.positive(column)).transpose()?;
        }
        for column in [drift, minimum, maximum] {
            row.text(column).map(|_| row.number(column)).transpose()?;
        }
        return Ok(None);
    }
    Ok(Some(Measured {
        before_v: row.voltage(before)?,
        during_v: row.voltage(during)?,
        after_v: row.voltage(after)?,
        sigma_v: row.sigma(sigma)?,
        drift_v_per_s: row.number(drift)?,
        drift_sigma_v_per_s: row.positive(drift_sigma)?,
        extremes: extremes(row, minimum, maximum)?,
    }))
}

/// Relative error of the peak detector, a few parts in 1e4, several times over: extremes that differ by less may be alike.
pub const DETECTOR_REL_ERROR: f64 = 2e-3;

fn extremes(row: &Row<'_>, minimum: &str, maximum: &str) -> Result<Option<Extremes>, Error> {
    if row.text(minimum).is_none() && row.text(maximum).is_none() {
        return Ok(None);
    }
    let extremes = Extremes {
        minimum_v: row.voltage(minimum)?,
        maximum_v: row.voltage(maximum)?,
    };
    // Across the input axis both may lie within what the detector's own error spans.
    let size_v = extremes.maximum_v.abs().max(extremes.minimum_v.abs());
    if extremes.maximum_v < extremes.minimum_v - DETECTOR_REL_ERROR * size_v {
        let problem = format!(
            "{} is below u_min_v = {}",
            extremes.maximum_v, extremes.minimum_v
        );
        return Err(row.error(maximum, problem));
    }
    Ok(Some(extremes))
}

/// The reference's moments, or `None` where all their cells are empty or the columns are not there.
fn reference(row: &Row<'_>) -> Result<Option<ReferenceMoments>, Error> {
    let filled = |columns: &[&str]| columns.iter().any(|column| row.text(column).is_some());
    let correlation = match filled(&CORRELATION) {
        true => Some(each_within(
            row,
            CORRELATION,
            -1.0 - UNIT_TOLERANCE,
            1.0 + UNIT_TOLERANCE,
        )?),
        false => None,
    };
    if !filled(&RMS) && !filled(&SKEWNESS) && !filled(&KURTOSIS) {
        return match correlation {
            None => Ok(None),
            Some(_) => Err(row.error(RMS[0], Problem::Empty)),
        };
    }
    Ok(Some(ReferenceMoments {
        rms_g: each_within(row, RMS, 0.0, 1e6)?,
        skewness: each_within(row, SKEWNESS, -MAX_SHAPE, MAX_SHAPE)?,
        kurtosis: each_within(row, KURTOSIS, 0.0, MAX_SHAPE)?,
        correlation,
    }))
}

fn each_within(row: &Row<'_>, columns: [&str; 3], low: f64, high: f64) -> Result<[f64; 3], Error> {
    let [i, p, o] = columns;
    Ok([
        row.within(i, low, high)?,
        row.within(p, low, high)?,
        row.within(o, low, high)?,
    ])
}

/// Writes a table of runs, made or still to be predicted.
///
/// # Errors
/// What the file system says.
pub fn write_runs(file: &Path, runs: &[Run]) -> Result<(), Error> {
    let mut columns = [CONDITIONS.as_slice(), &OUTPUT].concat();
    let with_moments = runs.iter().any(|run| run.reference.is_some());
    let with_correlation = runs
        .iter()
        .filter_map(|run| run.reference.as_ref())
        .any(|seen| seen.correlation.is_some());
    if with_moments {
        columns.extend([RMS, SKEWNESS, KURTOSIS].concat());
    }
    if with_correlation {
        columns.extend(CORRELATION);
    }
    let cells = |run: &Run| {
        let mut cells = condition_cells(run);
        cells.extend(output_cells(run.measured.as_ref()));
        if with_moments {
            let seen = run.reference.as_ref();
            cells.extend(filled(
                seen.map(|seen| [seen.rms_g, seen.skewness, seen.kurtosis].concat()),
                9,
            ));
        }
        if with_correlation {
            let seen = run.reference.as_ref().and_then(|seen| seen.correlation);
            cells.extend(filled(seen.map(Vec::from), 3));
        }
        cells
    };
    write_table(file, &columns, runs, cells, |run| &run.unknown)
}

fn condition_cells(run: &Run) -> Vec<String> {
    let mut cells = vec![
        run.run.to_string(),
        run.time_s.to_string(),
        word(&KINDS, run.kind),
    ];
    let force = run.specific_force_g;
    let numbers = [
        run.direction.as_slice(),
        &[run.level_g],
        &run.band_hz,
        &[force.i, force.p, force.o],
    ];
    cells.extend(numbers.concat().iter().map(f64::to_string));
    cells.extend([run.temp_c.to_string(), run.duration_s.to_string()]);
    cells
}

fn output_cells(measured: Option<&Measured>) -> Vec<String> {
    let mut cells = filled(
        measured.map(|m| {
            vec![
                m.before_v,
                m.during_v,
                m.after_v,
                m.sigma_v,
                m.drift_v_per_s,
                m.drift_sigma_v_per_s,
            ]
        }),
        6,
    );
    let extremes = measured.and_then(|m| m.extremes);
    cells.extend(filled(extremes.map(|e| vec![e.minimum_v, e.maximum_v]), 2));
    cells
}

/// Numbers as cells, or as many empty ones.
fn filled(numbers: Option<Vec<f64>>, count: usize) -> Vec<String> {
    match numbers {
        Some(numbers) => numbers.iter().map(f64::to_string).collect(),
        None => vec![String::new(); count],
    }
}
