//! `static.csv`: one row per reading at a dial position.

use std::collections::HashSet;
use std::path::Path;

use shared::model::SpecificForce;
use shared::tumble::{Position, Series, within_a_turn};

use super::config::CampaignConfig;
use super::marks::{EXCLUDE, Marks, SESSION};
use super::ranges;
use super::table::{Row, Table};
use super::{OneInstrument, UnknownCells, write_table};
use crate::error::{Error, Problem};

/// The sense in which the dial came to its mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Approach {
    /// `cw`
    Clockwise,
    /// `ccw`
    CounterClockwise,
}

const APPROACHES: [(&str, Approach); 2] = [
    ("cw", Approach::Clockwise),
    ("ccw", Approach::CounterClockwise),
];

impl Approach {
    /// Its word in a table.
    pub fn word(self) -> &'static str {
        super::word_of(&APPROACHES, self)
    }

    /// What a word in a table means, if anything.
    pub fn of_word(word: &str) -> Option<Self> {
        super::meaning(&APPROACHES, word)
    }
}

const SERIES: [(&str, Series); 3] = [
    ("1", Series::OutputAxis),
    ("2", Series::PendulousAxis),
    ("3", Series::InputAxis),
];

const FORCE: [&str; 3] = ["a_i_g", "a_p_g", "a_o_g"];

const OPTIONAL: [&str; 6] = ["mount_deg", "a_i_g", "a_p_g", "a_o_g", SESSION, EXCLUDE];

const COLUMNS: [&str; 14] = [
    "order",
    "time_s",
    "series",
    "dial_deg",
    "mount_deg",
    "approach",
    "a_i_g",
    "a_p_g",
    "a_o_g",
    "temp_c",
    "u_v",
    "sigma_v",
    SESSION,
    EXCLUDE,
];

/// One reading at a dial position.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Sequence number, unique within the campaign.
    pub order: u64,
    /// Time since the campaign's start, s.
    pub time_s: f64,
    /// Which instrument axis lies along the dial's shaft.
    pub series: Series,
    /// Nominal dial angle, degrees.
    pub dial_deg: f64,
    /// Angle by which the instrument is remounted on the shaft, degrees; it stands at `dial_deg + mount_deg`.
    pub mount_deg: f64,
    /// Sense in which the dial came to the mark.
    pub approach: Approach,
    /// Nominal specific force on the instrument's axes, g; its direction follows from series and angles.
    pub specific_force_g: SpecificForce<f64>,
    /// Temperature of the instrument, degrees Celsius.
    pub temp_c: f64,
    /// Mean output, V.
    #[doc(alias = "U")]
    pub output_v: f64,
    /// Standard uncertainty of the mean from noise alone, V; greater than zero.
    pub sigma_v: f64,
    /// What the rows of one mounting and power-up at one station share; all of static.csv is one session if absent.
    pub session: Option<String>,
    /// Kept, and not used: see [`Campaign::used`](super::Campaign::used).
    pub exclude: bool,
    /// Line of the table that it stands in; the header is line 1.
    pub line: u64,
    /// Columns that mean nothing to us.
    pub unknown: UnknownCells,
}

/// Greatest difference, in any component, between the unit vector along the stated specific force and
/// that of series and angles.
const DIRECTION_TOLERANCE: f64 = 1e-4;

/// Greatest difference between the length of the stated specific force and local gravity, g.
const LENGTH_TOLERANCE_G: f64 = 1e-4;

/// Reads and checks `static.csv`.
pub(super) fn read(file: &Path, config: &CampaignConfig) -> Result<Vec<Reading>, Error> {
    let required: Vec<&str> = COLUMNS
        .into_iter()
        .filter(|column| !OPTIONAL.contains(column))
        .collect();
    let mut table = Table::open(file, &required, &[])?;
    let mut instrument = OneInstrument::new(config);
    let mut readings = Vec::new();
    let mut limits = Limits::default();
    while let Some(row) = table.next_row()? {
        let order = instrument.check_row(&row, "order")?;
        let reading = reading(&row, order, config)?;
        if !reading.exclude {
            instrument.note_output(reading.output_v, reading.specific_force_g.i);
        }
        limits.check(&row, &reading)?;
        readings.push(reading);
    }
    instrument.check_outputs(file, "u_v")?;
    Ok(readings)
}

/// Most dial marks of a campaign: each is an unknown of its own.
const MAX_MARKS: usize = 1024;
/// Most pairs of series and mount, likewise.
const MAX_MOUNTS: usize = 64;

/// Keeps a static test to a size that a bench can produce and a fit can bear.
#[derive(Default)]
struct Limits {
    readings: usize,
    marks: HashSet<u64>,
    mounts: HashSet<(Series, u64)>,
}

impl Limits {
    fn check(&mut self, row: &Row<'_>, reading: &Reading) -> Result<(), Error> {
        self.readings += 1;
        self.marks.insert(within_a_turn(reading.dial_deg).to_bits());
        self.mounts
            .insert((reading.series, reading.mount_deg.to_bits()));
        for (count, most, column, what) in [
            (self.readings, MAX_POSITIONS, "order", "readings"),
            (
                self.marks.len(),
                MAX_MARKS,
                "dial_deg",
                "different dial angles",
            ),
            (
                self.mounts.len(),
                MAX_MOUNTS,
                "mount_deg",
                "pairs of series and mount",
            ),
        ] {
            if count > most {
                return Err(row.error(column, format!("is one of more than {most} {what}")));
            }
        }
        Ok(())
    }
}

/// Most positions of a plan: what is weighed against every candidate stays quick.
const MAX_POSITIONS: usize = 4096;

/// Reads a plan: a table of which only series, dial_deg and, optional, mount_deg count; static.csv is one.
///
/// # Errors
/// The first thing wrong in the table; more than 4096 positions.
pub fn read_plan(file: &Path) -> Result<Vec<Position>, Error> {
    let mut table = Table::open(file, &["series", "dial_deg"], &[])?;
    let mut plan = Vec::new();
    while let Some(row) = table.next_row()? {
        if plan.len() == MAX_POSITIONS {
            let problem = format!("a plan has {MAX_POSITIONS} positions at the most");
            return Err(row.error("series", problem));
        }
        plan.push(position(&row)?);
    }
    Ok(plan)
}

fn position(row: &Row<'_>) -> Result<Position, Error> {
    Ok(Position {
        series: row.one_of("series", &SERIES, "a series: 1, 2 or 3")?,
        dial_deg: row.number("dial_deg", &ranges::ANGLE)?,
        mount_deg: row.optional("mount_deg", &ranges::ANGLE)?.unwrap_or(0.0),
    })
}

fn reading(row: &Row<'_>, order: u64, config: &CampaignConfig) -> Result<Reading, Error> {
    let position = position(row)?;
    let gravity_g = config.bench.local_gravity_g;
    let reading = Reading {
        order,
        time_s: row.number("time_s", &ranges::TIME)?,
        series: position.series,
        dial_deg: position.dial_deg,
        mount_deg: position.mount_deg,
        approach: row.one_of("approach", &APPROACHES, "an approach: cw or ccw")?,
        specific_force_g: specific_force_g(row, &position, gravity_g)?,
        temp_c: row.number("temp_c", &ranges::TEMPERATURE)?,
        output_v: row.number("u_v", &ranges::OUTPUT)?,
        sigma_v: row.number("sigma_v", &ranges::OUTPUT_SIGMA)?,
        session: row.words(SESSION),
        exclude: row.flag(EXCLUDE)?,
        line: row.line(),
        unknown: row.unknown(&COLUMNS),
    };
    if !reading.exclude {
        check_geometry(row, &reading, gravity_g)?;
    }
    Ok(reading)
}

/// The stated specific force; where a cell is empty, what gravity is at this series and angle.
fn specific_force_g(
    row: &Row<'_>,
    position: &Position,
    gravity_g: f64,
) -> Result<SpecificForce<f64>, Error> {
    let instrument_deg = position.dial_deg + position.mount_deg;
    let expected = position.series.specific_force(instrument_deg.to_radians());
    let [i, p, o] = FORCE;
    let component = |column: &str, expected: f64| {
        let stated = row.optional(column, &ranges::SPECIFIC_FORCE)?;
        Ok(stated.unwrap_or(gravity_g * expected))
    };
    Ok(SpecificForce::new(
        component(i, expected.i)?,
        component(p, expected.p)?,
        component(o, expected.o)?,
    ))
}

/// The stated specific force must be what gravity is at this series and angle.
fn check_geometry(row: &Row<'_>, reading: &Reading, local_gravity_g: f64) -> Result<(), Error> {
    let stated = reading.specific_force_g;
    let length_g = stated.length();
    if (length_g - local_gravity_g).abs() > LENGTH_TOLERANCE_G {
        let problem = format!(
            "the specific force is {length_g} g long, local gravity in campaign.toml {local_gravity_g} g"
        );
        return Err(row.error(FORCE[0], problem));
    }
    let instrument_deg = reading.dial_deg + reading.mount_deg;
    let expected = reading.series.specific_force(instrument_deg.to_radians());
    let components = [
        (stated.i, expected.i),
        (stated.p, expected.p),
        (stated.o, expected.o),
    ];
    for (column, (stated_g, expected)) in FORCE.into_iter().zip(components) {
        if (stated_g / length_g - expected).abs() > DIRECTION_TOLERANCE {
            let problem = format!(
                "{stated_g} does not belong to this series at dial + mount = {instrument_deg} deg, \
                 where it is {:.6}",
                expected * length_g
            );
            return Err(row.error(column, Problem::Other(problem)));
        }
    }
    Ok(())
}

/// Writes `static.csv`.
pub(super) fn write(file: &Path, readings: &[Reading]) -> Result<(), Error> {
    let standing = COLUMNS
        .into_iter()
        .filter(|column| ![SESSION, EXCLUDE].contains(column));
    let marks = Marks::of(readings.iter().map(|r| (r.session.as_deref(), r.exclude)));
    let columns: Vec<&str> = standing.chain(marks.columns()).collect();
    let cells = |reading: &Reading| {
        let mut cells = cells(reading);
        cells.extend(marks.cells(reading.session.as_deref(), reading.exclude));
        cells
    };
    write_table(file, &columns, readings, cells, |reading| &reading.unknown)
}

fn cells(reading: &Reading) -> Vec<String> {
    let force = reading.specific_force_g;
    vec![
        reading.order.to_string(),
        reading.time_s.to_string(),
        super::word(&SERIES, reading.series),
        reading.dial_deg.to_string(),
        reading.mount_deg.to_string(),
        super::word(&APPROACHES, reading.approach),
        force.i.to_string(),
        force.p.to_string(),
        force.o.to_string(),
        reading.temp_c.to_string(),
        reading.output_v.to_string(),
        reading.sigma_v.to_string(),
    ]
}
