//! `vibration.csv`: one row per shaker run, made or still to be predicted.

use std::path::Path;

use shared::model::SpecificForce;

use super::config::CampaignConfig;
use super::marks::{EXCLUDE, Marks, SESSION};
use super::ranges::{self, Range};
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

impl VibrationKind {
    /// Its word in a table.
    pub fn word(self) -> &'static str {
        super::word_of(&KINDS, self)
    }

    /// What a word in a table means, if anything.
    pub fn of_word(word: &str) -> Option<Self> {
        super::meaning(&KINDS, word)
    }
}

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
    /// What the rows of one mounting and power-up at one station share; all of vibration.csv is one session if absent.
    pub session: Option<String>,
    /// Kept, and not used: see [`Campaign::used`](super::Campaign::used).
    pub exclude: bool,
    /// Line of the table that it stands in; the header is line 1.
    pub line: u64,
    /// Columns that mean nothing to us.
    pub unknown: UnknownCells,
}

impl Run {
    /// The same run before it was made, in whatever line: nothing is measured.
    pub fn unmade(&self) -> Self {
        Self {
            measured: None,
            line: 0,
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
    /// Mean output after the vibration, V, if it was waited for.
    pub after_v: Option<f64>,
    /// Standard uncertainty of each of the three means from noise alone, V; greater than zero.
    pub sigma_v: f64,
    /// Drift during the vibration, if it was looked at.
    pub drift: Option<Drift>,
    /// Extremes of the output, if a peak detector was there.
    pub extremes: Option<Extremes>,
}

/// Drift of the output during a vibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// (Level at the end of the vibration - level at its start) / duration, V/s.
    pub v_per_s: f64,
    /// Its standard uncertainty, V/s; greater than zero.
    pub sigma_v_per_s: f64,
}

/// Extremes of the output during a run, from an analogue peak detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremes {
    /// Least output, V.
    pub minimum_v: f64,
    /// Greatest output, V.
    pub maximum_v: f64,
}

impl Extremes {
    /// Least and greatest output over a scale factor of either sign, g.
    pub fn over(&self, scale_v_per_g: f64) -> [f64; 2] {
        let [one, other] = [self.minimum_v, self.maximum_v].map(|v| v / scale_v_per_g);
        if scale_v_per_g < 0.0 {
            [other, one]
        } else {
            [one, other]
        }
    }
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
/// What of [`OUTPUT`] a measured run has.
const MEASURED: [&str; 3] = ["u_before_v", "u_during_v", "sigma_v"];
/// And what it may lack.
const AFTER: [&str; 1] = ["u_after_v"];
const DRIFT: [&str; 2] = ["drift_v_per_s", "drift_sigma_v_per_s"];
const EXTREMES: [&str; 2] = ["u_min_v", "u_max_v"];
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

/// Most runs of a campaign. Measured: a diagnosis takes some 24 kB and 2 ms a run.
pub const MAX_RUNS: usize = 20_000;

/// Reads and checks a table of runs: `vibration.csv` of a campaign, or runs to be predicted.
///
/// # Errors
/// The first thing wrong in the file, with row and column.
pub fn read_runs(file: &Path, config: &CampaignConfig) -> Result<Vec<Run>, Error> {
    let required = [CONDITIONS.as_slice(), &MEASURED].concat();
    let moments = [RMS, SKEWNESS, KURTOSIS].concat();
    let marks = [SESSION, EXCLUDE];
    let known = [
        required.as_slice(),
        &AFTER,
        &DRIFT,
        &EXTREMES,
        &moments,
        &CORRELATION,
        &marks,
    ]
    .concat();
    let together = [
        DRIFT.as_slice(),
        EXTREMES.as_slice(),
        moments.as_slice(),
        CORRELATION.as_slice(),
    ];
    let mut table = Table::open(file, &required, &together)?;
    let mut instrument = OneInstrument::new(config);
    let mut runs: Vec<Run> = Vec::new();
    let mut latest_s: Option<f64> = None;
    while let Some(row) = table.next_row()? {
        let number = instrument.check_row(&row, "run")?;
        if runs.len() == MAX_RUNS {
            return Err(row.error("run", format!("is one of more than {MAX_RUNS} runs")));
        }
        let run = run(&row, number, &known, config.peak_rel_error())?;
        if !run.exclude {
            if let Some(earlier_s) = latest_s.filter(|earlier_s| *earlier_s > run.time_s) {
                let problem = format!("{} is before {earlier_s} of the row above", run.time_s);
                return Err(row.error("time_s", problem));
            }
            latest_s = Some(run.time_s);
            if let Some(measured) = &run.measured {
                instrument.note_output(measured.before_v, run.specific_force_g.i);
            }
        }
        runs.push(run);
    }
    instrument.check_outputs(file, MEASURED[0])?;
    Ok(runs)
}

fn run(row: &Row<'_>, number: u64, known: &[&str], peak_rel_error: f64) -> Result<Run, Error> {
    let [i, p, o] = row.numbers(GRAVITY, &ranges::SPECIFIC_FORCE)?;
    let kind = row.one_of("kind", &KINDS, "a kind: sine or random")?;
    Ok(Run {
        run: number,
        time_s: row.number("time_s", &ranges::TIME)?,
        kind,
        direction: direction(row)?,
        level_g: row.number("level_g", &ranges::LEVEL)?,
        band_hz: band(row, kind)?,
        specific_force_g: SpecificForce::new(i, p, o),
        temp_c: row.number("temp_c", &ranges::TEMPERATURE)?,
        duration_s: row.number("duration_s", &ranges::DURATION)?,
        measured: measured(row, peak_rel_error)?,
        reference: reference(row)?,
        session: row.words(SESSION),
        exclude: row.flag(EXCLUDE)?,
        line: row.line(),
        unknown: row.unknown(known),
    })
}

fn direction(row: &Row<'_>) -> Result<[f64; 3], Error> {
    let direction = row.numbers(DIRECTION, &ranges::COSINE)?;
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
    let low_hz = row.number("f_lo_hz", &ranges::FREQUENCY)?;
    let high_hz = row.number("f_hi_hz", &ranges::FREQUENCY)?;
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
fn measured(row: &Row<'_>, peak_rel_error: f64) -> Result<Option<Measured>, Error> {
    let [before, during, sigma] = MEASURED;
    let unmade = [before, during, AFTER[0]]
        .iter()
        .all(|plateau| row.text(plateau).is_none());
    // Of a run that was not made the uncertainties may be stated already.
    let drift = match row.text(DRIFT[0]) {
        None if unmade => row.optional(DRIFT[1], &ranges::DRIFT_SIGMA)?.and(None),
        _ => pair(row, DRIFT, [&ranges::DRIFT, &ranges::DRIFT_SIGMA])?,
    };
    let further = Further {
        after_v: row.optional(AFTER[0], &ranges::OUTPUT)?,
        drift: drift.map(|[v_per_s, sigma_v_per_s]| Drift {
            v_per_s,
            sigma_v_per_s,
        }),
        extremes: extremes(row, peak_rel_error)?,
    };
    if unmade {
        row.optional(sigma, &ranges::OUTPUT_SIGMA)?;
        return Ok(None);
    }
    Ok(Some(Measured {
        before_v: row.number(before, &ranges::OUTPUT)?,
        during_v: row.number(during, &ranges::OUTPUT)?,
        after_v: further.after_v,
        sigma_v: row.number(sigma, &ranges::OUTPUT_SIGMA)?,
        drift: further.drift,
        extremes: further.extremes,
    }))
}

/// What a laboratory may lack.
struct Further {
    after_v: Option<f64>,
    drift: Option<Drift>,
    extremes: Option<Extremes>,
}

/// Two numbers of which a row has both or none.
fn pair(
    row: &Row<'_>,
    columns: [&str; 2],
    ranges: [&'static Range; 2],
) -> Result<Option<[f64; 2]>, Error> {
    if columns.iter().all(|column| row.text(column).is_none()) {
        return Ok(None);
    }
    Ok(Some([
        row.number(columns[0], ranges[0])?,
        row.number(columns[1], ranges[1])?,
    ]))
}

fn extremes(row: &Row<'_>, peak_rel_error: f64) -> Result<Option<Extremes>, Error> {
    let found = pair(row, EXTREMES, [&ranges::OUTPUT, &ranges::OUTPUT])?;
    let Some([minimum_v, maximum_v]) = found else {
        return Ok(None);
    };
    let extremes = Extremes {
        minimum_v,
        maximum_v,
    };
    // Across the input axis both may lie within what the detector's own error spans.
    let size_v = extremes.maximum_v.abs().max(extremes.minimum_v.abs());
    if extremes.maximum_v < extremes.minimum_v - peak_rel_error * size_v {
        let problem = format!(
            "{} is below u_min_v = {}",
            extremes.maximum_v, extremes.minimum_v
        );
        return Err(row.error(EXTREMES[1], problem));
    }
    Ok(Some(extremes))
}

/// The reference's moments, or `None` where all their cells are empty or the columns are not there.
fn reference(row: &Row<'_>) -> Result<Option<ReferenceMoments>, Error> {
    let filled = |columns: &[&str]| columns.iter().any(|column| row.text(column).is_some());
    let correlation = filled(&CORRELATION).then(|| correlation(row)).transpose()?;
    if !filled(&RMS) && !filled(&SKEWNESS) && !filled(&KURTOSIS) {
        return match correlation {
            None => Ok(None),
            Some(_) => Err(row.error(RMS[0], Problem::Empty)),
        };
    }
    let seen = ReferenceMoments {
        rms_g: row.numbers(RMS, &ranges::RMS)?,
        skewness: row.numbers(SKEWNESS, &ranges::SKEWNESS)?,
        kurtosis: row.numbers(KURTOSIS, &ranges::KURTOSIS)?,
        correlation,
    };
    for axis in 0..3 {
        let (skewness, kurtosis) = (seen.skewness[axis], seen.kurtosis[axis]);
        let least = 1.0 + skewness * skewness;
        let stands_still = skewness == 0.0 && kurtosis == 0.0;
        if !stands_still && kurtosis < least * (1.0 - MOMENT_ROUNDING) {
            let problem = format!(
                "{kurtosis} is below 1 + skewness^2 = {least}, which no record has; is it the excess over 3?"
            );
            return Err(row.error(KURTOSIS[axis], problem));
        }
    }
    Ok(Some(seen))
}

/// What three decimals leave of a moment, and of a correlation: half a unit of the last.
const MOMENT_ROUNDING: f64 = 5e-4;

/// Correlation coefficients that some motion can have: their matrix is positive semidefinite within rounding.
fn correlation(row: &Row<'_>) -> Result<[f64; 3], Error> {
    let found = row.numbers(CORRELATION, &ranges::CORRELATION)?;
    let [ip, io, po] = found;
    let determinant = 1.0 + 2.0 * ip * io * po - ip * ip - io * io - po * po;
    // Its derivative by a coefficient is within 2 (1 + 1), for three of them.
    if determinant >= -12.0 * MOMENT_ROUNDING {
        return Ok(found);
    }
    let problem = format!(
        "{ip} with {io} and {po}: no motion has these three correlations, their matrix is not positive semidefinite"
    );
    Err(row.error(CORRELATION[0], problem))
}

/// Writes a table of runs, made or still to be predicted.
///
/// # Errors
/// What the file system says.
pub fn write_runs(file: &Path, runs: &[Run]) -> Result<(), Error> {
    let mut columns = [CONDITIONS.as_slice(), &OUTPUT].concat();
    let marks = Marks::of(runs.iter().map(|run| (run.session.as_deref(), run.exclude)));
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
    columns.extend(marks.columns());
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
        cells.extend(marks.cells(run.session.as_deref(), run.exclude));
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

/// In the order of [`OUTPUT`].
fn output_cells(measured: Option<&Measured>) -> Vec<String> {
    let drift = measured.and_then(|m| m.drift);
    let extremes = measured.and_then(|m| m.extremes);
    let numbers = [
        measured.map(|m| m.before_v),
        measured.map(|m| m.during_v),
        measured.and_then(|m| m.after_v),
        measured.map(|m| m.sigma_v),
        drift.map(|drift| drift.v_per_s),
        drift.map(|drift| drift.sigma_v_per_s),
        extremes.map(|extremes| extremes.minimum_v),
        extremes.map(|extremes| extremes.maximum_v),
    ];
    numbers
        .iter()
        .map(|number| number.map_or_else(String::new, |number| number.to_string()))
        .collect()
}

/// Numbers as cells, or as many empty ones.
fn filled(numbers: Option<Vec<f64>>, count: usize) -> Vec<String> {
    match numbers {
        Some(numbers) => numbers.iter().map(f64::to_string).collect(),
        None => vec![String::new(); count],
    }
}
