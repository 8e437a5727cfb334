//! Every column of a campaign's tables: its name, unit, range, sign, meaning and an example. Headers are matched with it,
//! templates, help and the guide are made of it.

use super::ranges::{self, Range};
use crate::error::{Problem, clip};
use crate::import::Conversion;

/// What a column holds.
#[derive(Clone, Copy, Debug)]
pub enum Content {
    /// A number within its range.
    Number(&'static Range),
    /// A whole number from 0 on.
    Index,
    /// One of these words.
    Word(&'static [&'static str]),
    /// Any text.
    Text,
}

/// Whether a table must have a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Every row needs it.
    Required,
    /// Every row that was measured needs it.
    Measured,
    /// It may be absent, as a column or in single rows.
    Optional,
}

/// One column.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Its name in the header; ends with its unit where it has one.
    pub name: &'static str,
    /// What it holds.
    pub content: Content,
    /// Whether it must be there.
    pub need: Need,
    /// What it means, with its sign where it has one.
    pub meaning: &'static str,
    /// A cell of it.
    pub example: &'static str,
}

impl Column {
    /// Unit; empty for a pure number and for words.
    pub fn unit(&self) -> &'static str {
        match self.content {
            Content::Number(range) => range.unit,
            _ => "",
        }
    }

    /// What its cells can be, for people.
    pub fn values(&self) -> String {
        match self.content {
            Content::Number(range) => {
                let text = range.to_string();
                text.split_once(": ")
                    .map_or(text.clone(), |(_, values)| values.into())
            }
            Content::Index => "0, 1, 2 ...".into(),
            Content::Word(words) => words.join(", "),
            Content::Text => "any text".into(),
        }
    }

    /// The name without its unit.
    fn stem(&self) -> &'static str {
        let suffix = match self.unit() {
            "V" => "_v",
            "V/s" => "_v_per_s",
            "g" => "_g",
            "s" => "_s",
            "deg" => "_deg",
            "arcsec" => "_arcsec",
            "Hz" => "_hz",
            "C" => "_c",
            "g^2/Hz" => "_g2_per_hz",
            _ => "",
        };
        self.name.strip_suffix(suffix).unwrap_or(self.name)
    }
}

/// The columns of one file.
#[derive(Clone, Copy, Debug)]
pub struct Columns {
    /// Name of the file.
    pub file: &'static str,
    /// What one row of it is.
    pub row: &'static str,
    /// Its columns, in the order in which they are written.
    pub columns: &'static [Column],
}

/// The tables of a campaign of one instrument, those of a triad, then those of an environment.
pub static TABLES: [Columns; 6] = [
    Columns {
        file: "static.csv",
        row: "one reading at a dial position",
        columns: STATIC,
    },
    Columns {
        file: "vibration.csv",
        row: "one shaker run",
        columns: VIBRATION,
    },
    Columns {
        file: "positions.csv",
        row: "one position at rest of a triad",
        columns: POSITIONS,
    },
    Columns {
        file: "vibration.csv of a triad",
        row: "one shaker run of a triad",
        columns: TRIAD_RUNS,
    },
    Columns {
        file: "a spectrum, psd:FILE",
        row: "one breakpoint or sine",
        columns: SPECTRUM,
    },
    Columns {
        file: "a mission, --mission FILE",
        row: "one point of the profile",
        columns: MISSION,
    },
];

/// A header's cell: a name, and perhaps a unit behind it.
pub(super) struct Heading {
    name: String,
    unit: Option<String>,
}

impl Heading {
    /// `u_v`, `U [mV]`, `Dial deg`, `u / mV`: small letters, `_` for what parts words, and the unit apart.
    pub(super) fn parse(cell: &str) -> Self {
        let cell = cell.trim_start_matches(['#', '\u{feff}']).trim();
        let bracketed = || {
            let at = cell.rfind(['[', '('])?;
            let unit = cell[at + 1..].strip_suffix([']', ')'])?;
            Some((&cell[..at], unit))
        };
        let (name, unit) = match bracketed().or_else(|| cell.split_once('/')) {
            Some((name, unit)) => (name, Some(unit.trim().to_owned())),
            None => (cell, None),
        };
        let words = name.split(|c: char| c.is_whitespace() || matches!(c, '_' | '-' | '.'));
        let words: Vec<String> = words
            .filter(|word| !word.is_empty())
            .map(str::to_lowercase)
            .collect();
        Self {
            name: words.join("_"),
            unit: unit.filter(|unit| !unit.is_empty()),
        }
    }

    /// With the unit of a row of units, if it has none.
    pub(super) fn with_unit(self, unit: &str) -> Self {
        let unit = unit.trim_matches(['[', ']', '(', ')', ' ']);
        let unit = (!matches!(unit, "" | "-")).then(|| unit.to_owned());
        Self {
            unit: self.unit.or(unit),
            ..self
        }
    }

    /// Whether it may be the column of that name.
    pub(super) fn is(&self, name: &str) -> bool {
        let stem = || known().find(|column| column.name == name).map(Column::stem);
        self.name == name || stem() == Some(&self.name)
    }

    /// The column that it is, if any is known, and the way from its unit.
    ///
    /// # Errors
    /// A unit that is none of that column.
    pub(super) fn resolve(&self) -> Result<(Option<&'static str>, Conversion), Problem> {
        let whole = known().find(|column| column.name == self.name);
        let Some(unit) = &self.unit else {
            return Ok((whole.map(|column| column.name), Conversion::NONE));
        };
        let stem = || known().find(|column| column.stem() == self.name);
        let Some(column) = whole.or_else(stem) else {
            return Ok((None, Conversion::NONE));
        };
        let conversion = Conversion::between(unit, column.unit());
        match conversion {
            Some(conversion) if whole.is_none() || conversion == Conversion::NONE => {
                Ok((Some(column.name), conversion))
            }
            Some(_) => Err(Problem::Other(format!(
                "names two units; write {} [{}]",
                column.stem(),
                clip(unit)
            ))),
            None => Err(Problem::Other(format!(
                "\"{}\" is no unit of {}{}",
                clip(unit),
                column.name,
                match column.unit() {
                    "" => ", a pure number".into(),
                    known => format!("; write {} [{known}] or one like it", column.stem()),
                }
            ))),
        }
    }
}

fn known() -> impl Iterator<Item = &'static Column> {
    TABLES.iter().flat_map(|table| table.columns)
}

/// A column, or a key, of numbers.
pub(super) const fn number(
    name: &'static str,
    range: &'static Range,
    need: Need,
    example: &'static str,
    meaning: &'static str,
) -> Column {
    Column {
        name,
        content: Content::Number(range),
        need,
        meaning,
        example,
    }
}

const KIND: Column = Column {
    name: "kind",
    content: Content::Word(&["sine", "random"]),
    need: Need::Required,
    meaning: "sine: one frequency; random: Gaussian noise, flat over the band",
    example: "random",
};
const EXCLUDE: Column = Column {
    name: "exclude",
    content: Content::Word(&["yes", "no"]),
    need: Need::Optional,
    meaning: "yes: the row is kept and not used",
    example: "",
};
const SESSION: Column = Column {
    name: "session",
    content: Content::Text,
    need: Need::Optional,
    meaning: "rows with the same word share one mounting and one power-up; without the column the readings are one session, the runs another",
    example: "",
};

use Need::{Measured, Optional, Required};

static STATIC: &[Column] = &[
    Column {
        name: "order",
        content: Content::Index,
        need: Required,
        meaning: "number of the reading; none stands twice",
        example: "0",
    },
    number(
        "time_s",
        &ranges::TIME,
        Required,
        "0",
        "time of the reading since the campaign's start; a date with time is taken too",
    ),
    Column {
        name: "series",
        content: Content::Word(&["1", "2", "3"]),
        need: Required,
        meaning: "which instrument axis lies along the dial's shaft: 1 the output axis, 2 the pendulous axis, 3 the input axis",
        example: "1",
    },
    number(
        "dial_deg",
        &ranges::ANGLE,
        Required,
        "45",
        "angle at which the dial stands; at 0 the input axis (series 3: the pendulous axis) points down and feels -1 g",
    ),
    number(
        "mount_deg",
        &ranges::ANGLE,
        Optional,
        "0",
        "angle by which the instrument is remounted on the shaft: it stands at dial + mount; 0 if absent",
    ),
    Column {
        name: "approach",
        content: Content::Word(&["cw", "ccw"]),
        need: Required,
        meaning: "sense in which the dial came to the mark: ccw from smaller angles, cw from larger ones",
        example: "cw",
    },
    number(
        "a_i_g",
        &ranges::SPECIFIC_FORCE,
        Optional,
        "-0.70710678",
        "specific force on the input axis, positive where its output is; computed from series and angle if absent",
    ),
    number(
        "a_p_g",
        &ranges::SPECIFIC_FORCE,
        Optional,
        "0.70710678",
        "specific force on the pendulous axis, likewise",
    ),
    number(
        "a_o_g",
        &ranges::SPECIFIC_FORCE,
        Optional,
        "0",
        "specific force on the output axis, likewise",
    ),
    number(
        "temp_c",
        &ranges::TEMPERATURE,
        Required,
        "22.1",
        "temperature of the instrument",
    ),
    number(
        "u_v",
        &ranges::OUTPUT,
        Required,
        "-0.848291",
        "mean output of the reading, with its sign",
    ),
    number(
        "sigma_v",
        &ranges::OUTPUT_SIGMA,
        Required,
        "2.4e-6",
        "standard uncertainty of that mean from noise alone, not of a single sample",
    ),
    SESSION,
    EXCLUDE,
];

static VIBRATION: &[Column] = &[
    Column {
        name: "run",
        content: Content::Index,
        need: Required,
        meaning: "number of the run; none stands twice",
        example: "0",
    },
    number(
        "time_s",
        &ranges::TIME,
        Required,
        "7200",
        "time of the centre of the plateau before the vibration; rows are in the order of time",
    ),
    KIND,
    number(
        "dir_i",
        &ranges::COSINE,
        Required,
        "1",
        "direction of the motion, a unit vector: component along the input axis",
    ),
    number(
        "dir_p",
        &ranges::COSINE,
        Required,
        "0",
        "component along the pendulous axis",
    ),
    number(
        "dir_o",
        &ranges::COSINE,
        Required,
        "0",
        "component along the output axis",
    ),
    number(
        "level_g",
        &ranges::LEVEL,
        Required,
        "2",
        "commanded level along the direction: peak of a sine, rms of a random vibration",
    ),
    number(
        "f_lo_hz",
        &ranges::FREQUENCY,
        Required,
        "20",
        "lower edge of the band; a sine's frequency",
    ),
    number(
        "f_hi_hz",
        &ranges::FREQUENCY,
        Required,
        "2000",
        "upper edge of the band; a sine's frequency again",
    ),
    number(
        "a0_i_g",
        &ranges::SPECIFIC_FORCE,
        Required,
        "1",
        "gravity on the input axis during the run, positive where the output is",
    ),
    number(
        "a0_p_g",
        &ranges::SPECIFIC_FORCE,
        Required,
        "0",
        "gravity on the pendulous axis",
    ),
    number(
        "a0_o_g",
        &ranges::SPECIFIC_FORCE,
        Required,
        "0",
        "gravity on the output axis",
    ),
    number(
        "temp_c",
        &ranges::TEMPERATURE,
        Required,
        "22.4",
        "temperature of the instrument during the run",
    ),
    number(
        "duration_s",
        &ranges::DURATION,
        Required,
        "30",
        "length of the vibration, over which the mean during it is taken",
    ),
    number(
        "u_before_v",
        &ranges::OUTPUT,
        Measured,
        "1.1998713",
        "mean output before the vibration",
    ),
    number(
        "u_during_v",
        &ranges::OUTPUT,
        Measured,
        "1.2004127",
        "mean output during the vibration",
    ),
    number(
        "u_after_v",
        &ranges::OUTPUT,
        Optional,
        "1.1998751",
        "mean output after the vibration",
    ),
    number(
        "sigma_v",
        &ranges::OUTPUT_SIGMA,
        Measured,
        "2.1e-6",
        "standard uncertainty of each of the three means from noise alone",
    ),
    number(
        "drift_v_per_s",
        &ranges::DRIFT,
        Optional,
        "1e-8",
        "level at the end of the vibration less that at its start, over the duration",
    ),
    number(
        "drift_sigma_v_per_s",
        &ranges::DRIFT_SIGMA,
        Optional,
        "2e-8",
        "standard uncertainty of the drift",
    ),
    number(
        "u_min_v",
        &ranges::OUTPUT,
        Optional,
        "-8.1",
        "least output during the run, of a peak detector",
    ),
    number(
        "u_max_v",
        &ranges::OUTPUT,
        Optional,
        "10.6",
        "greatest output during the run, likewise",
    ),
    number(
        "ref_i_rms_g",
        &ranges::RMS,
        Optional,
        "2.001",
        "rms that the reference accelerometer saw along the input axis",
    ),
    number(
        "ref_p_rms_g",
        &ranges::RMS,
        Optional,
        "0.004",
        "along the pendulous axis",
    ),
    number(
        "ref_o_rms_g",
        &ranges::RMS,
        Optional,
        "0.003",
        "along the output axis",
    ),
    number(
        "ref_i_skew",
        &ranges::SKEWNESS,
        Optional,
        "0.004",
        "third standardized moment of the reference along the input axis: 0 of a sine, near 0 of noise",
    ),
    number(
        "ref_p_skew",
        &ranges::SKEWNESS,
        Optional,
        "0",
        "along the pendulous axis; 0 where it stands still",
    ),
    number(
        "ref_o_skew",
        &ranges::SKEWNESS,
        Optional,
        "0",
        "along the output axis",
    ),
    number(
        "ref_i_kurt",
        &ranges::KURTOSIS,
        Optional,
        "2.98",
        "fourth standardized moment, not the excess over 3: 1.5 of a sine, near 3 of noise",
    ),
    number(
        "ref_p_kurt",
        &ranges::KURTOSIS,
        Optional,
        "0",
        "along the pendulous axis; 0 where it stands still",
    ),
    number(
        "ref_o_kurt",
        &ranges::KURTOSIS,
        Optional,
        "0",
        "along the output axis",
    ),
    number(
        "ref_ip_corr",
        &ranges::CORRELATION,
        Optional,
        "0",
        "correlation of the reference's input and pendulous axes, with its sign",
    ),
    number(
        "ref_io_corr",
        &ranges::CORRELATION,
        Optional,
        "0",
        "of input and output axes",
    ),
    number(
        "ref_po_corr",
        &ranges::CORRELATION,
        Optional,
        "0",
        "of pendulous and output axes",
    ),
    SESSION,
    EXCLUDE,
];

static POSITIONS: &[Column] = &[
    Column {
        name: "order",
        content: Content::Index,
        need: Required,
        meaning: "number of the position; none stands twice",
        example: "0",
    },
    number(
        "time_s",
        &ranges::TIME,
        Optional,
        "0",
        "time since the campaign's start",
    ),
    number(
        "u_x_v",
        &ranges::OUTPUT,
        Required,
        "0.0123",
        "mean output of x",
    ),
    number(
        "u_y_v",
        &ranges::OUTPUT,
        Required,
        "-0.0044",
        "mean output of y",
    ),
    number(
        "u_z_v",
        &ranges::OUTPUT,
        Required,
        "1.1998",
        "mean output of z",
    ),
    number(
        "sigma_x_v",
        &ranges::OUTPUT_SIGMA,
        Required,
        "2e-6",
        "standard uncertainty of the mean of x from noise alone",
    ),
    number("sigma_y_v", &ranges::OUTPUT_SIGMA, Required, "2e-6", "of y"),
    number("sigma_z_v", &ranges::OUTPUT_SIGMA, Required, "2e-6", "of z"),
    number(
        "temp_c",
        &ranges::TEMPERATURE,
        Optional,
        "22.1",
        "temperature of the triad",
    ),
    number(
        "a_x_g",
        &ranges::SPECIFIC_FORCE,
        Optional,
        "0",
        "nominal specific force along the body's x, where the attitude is known",
    ),
    number("a_y_g", &ranges::SPECIFIC_FORCE, Optional, "0", "along y"),
    number("a_z_g", &ranges::SPECIFIC_FORCE, Optional, "1", "along z"),
    number(
        "attitude_sigma_arcsec",
        &ranges::ARCSEC_SIGMA,
        Optional,
        "60",
        "standard uncertainty of the attitude; 0: exact",
    ),
    EXCLUDE,
];

static TRIAD_RUNS: &[Column] = &[
    Column {
        name: "run",
        content: Content::Index,
        need: Required,
        meaning: "number of the run; none stands twice",
        example: "0",
    },
    KIND,
    number(
        "level_g",
        &ranges::LEVEL,
        Required,
        "1",
        "level along the direction: peak of a sine, rms of a random vibration",
    ),
    number(
        "dir_x",
        &ranges::COSINE,
        Required,
        "1",
        "direction of the motion, a unit vector: component along the body's x",
    ),
    number("dir_y", &ranges::COSINE, Required, "0", "along y"),
    number("dir_z", &ranges::COSINE, Required, "0", "along z"),
    number(
        "a0_x_g",
        &ranges::SPECIFIC_FORCE,
        Required,
        "0",
        "gravity along the body's x during the run",
    ),
    number("a0_y_g", &ranges::SPECIFIC_FORCE, Required, "0", "along y"),
    number("a0_z_g", &ranges::SPECIFIC_FORCE, Required, "1", "along z"),
    number(
        "u_before_x_v",
        &ranges::OUTPUT,
        Measured,
        "0.0123",
        "mean output of x before the vibration",
    ),
    number("u_before_y_v", &ranges::OUTPUT, Measured, "-0.0044", "of y"),
    number("u_before_z_v", &ranges::OUTPUT, Measured, "1.1998", "of z"),
    number(
        "u_during_x_v",
        &ranges::OUTPUT,
        Measured,
        "0.0126",
        "mean output of x during the vibration",
    ),
    number("u_during_y_v", &ranges::OUTPUT, Measured, "-0.0043", "of y"),
    number("u_during_z_v", &ranges::OUTPUT, Measured, "1.1999", "of z"),
    number(
        "sigma_x_v",
        &ranges::OUTPUT_SIGMA,
        Measured,
        "2e-6",
        "standard uncertainty of either mean of x from noise alone",
    ),
    number("sigma_y_v", &ranges::OUTPUT_SIGMA, Measured, "2e-6", "of y"),
    number("sigma_z_v", &ranges::OUTPUT_SIGMA, Measured, "2e-6", "of z"),
    EXCLUDE,
];

static SPECTRUM: &[Column] = &[
    number(
        "f_hz",
        &ranges::FREQUENCY,
        Required,
        "20",
        "frequency of the breakpoint, rising from row to row, or of the sine",
    ),
    number(
        "psd_g2_per_hz",
        &ranges::DENSITY,
        Optional,
        "0.04",
        "one-sided density along --direction; straight between breakpoints on logarithmic axes",
    ),
    number(
        "psd_i_g2_per_hz",
        &ranges::DENSITY,
        Optional,
        "0.04",
        "in the place of psd_g2_per_hz: density along the input axis, the same way",
    ),
    number(
        "psd_p_g2_per_hz",
        &ranges::DENSITY,
        Optional,
        "0.02",
        "along the pendulous axis",
    ),
    number(
        "psd_o_g2_per_hz",
        &ranges::DENSITY,
        Optional,
        "0.02",
        "along the output axis",
    ),
    number(
        "corr_ip",
        &ranges::CORRELATION,
        Optional,
        "0",
        "real part of the coherence of input and pendulous axes, with its sign; 0 if absent",
    ),
    number(
        "corr_io",
        &ranges::CORRELATION,
        Optional,
        "0",
        "of input and output axes",
    ),
    number(
        "corr_po",
        &ranges::CORRELATION,
        Optional,
        "0",
        "of pendulous and output axes",
    ),
    number(
        "sine_g",
        &ranges::LEVEL,
        Optional,
        "",
        "peak of a sine along --direction, in a row without densities",
    ),
];

static MISSION: &[Column] = &[
    number(
        "time_s",
        &ranges::TIME,
        Required,
        "0",
        "time of the point, rising from row to row",
    ),
    number(
        "level_g",
        &ranges::MISSION_LEVEL,
        Required,
        "2",
        "rms of the vibration then, all axes together; straight between points",
    ),
];
