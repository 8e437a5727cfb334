//! `vibration.csv` of a triad: one row per shaker run, with the outputs of the three instruments.

use std::path::Path;

use super::marks::EXCLUDE;
use super::ranges;
use super::table::{Row, Table};
use super::{UnknownCells, VibrationKind, word, write_table};
use crate::error::{Error, Problem};

/// One shaker run of a triad.
#[derive(Clone, Debug, PartialEq)]
pub struct TriadRun {
    /// Run number, unique within the table.
    pub run: u64,
    /// Kind of the vibration.
    pub kind: VibrationKind,
    /// Unit vector of the motion on the body axes.
    pub direction: [f64; 3],
    /// Level along the direction, g: peak of a sine, rms of a random vibration.
    pub level_g: f64,
    /// Gravity on the body axes during the run, g.
    pub a0_g: [f64; 3],
    /// What the three instruments gave; `None` in a run that is to be predicted.
    pub measured: Option<TriadMeasured>,
    /// Columns that mean nothing to us.
    pub unknown: UnknownCells,
}

/// Mean outputs of x, y, z in one run, V.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriadMeasured {
    /// Before the vibration.
    pub before_v: [f64; 3],
    /// During the vibration.
    pub during_v: [f64; 3],
    /// Standard uncertainty of each of the means from noise alone; greater than zero.
    pub sigma_v: [f64; 3],
}

const KINDS: [(&str, VibrationKind); 2] = [
    ("sine", VibrationKind::Sine),
    ("random", VibrationKind::Random),
];
const DIRECTION: [&str; 3] = ["dir_x", "dir_y", "dir_z"];
const GRAVITY: [&str; 3] = ["a0_x_g", "a0_y_g", "a0_z_g"];
/// The names of a single instrument's table; on a triad they are body axes too.
const DIRECTION_OF_ONE: [&str; 3] = ["dir_i", "dir_p", "dir_o"];
const GRAVITY_OF_ONE: [&str; 3] = ["a0_i_g", "a0_p_g", "a0_o_g"];
const BEFORE: [&str; 3] = ["u_before_x_v", "u_before_y_v", "u_before_z_v"];
const DURING: [&str; 3] = ["u_during_x_v", "u_during_y_v", "u_during_z_v"];
const SIGMA: [&str; 3] = ["sigma_x_v", "sigma_y_v", "sigma_z_v"];
const UNIT_TOLERANCE: f64 = 1e-6;

/// Reads and checks a table of runs; rows that are excluded are left out.
///
/// # Errors
/// The first thing wrong in the file, with row and column.
pub fn read(file: &Path) -> Result<Vec<TriadRun>, Error> {
    let outputs = [BEFORE, DURING, SIGMA].concat();
    let mut table = Table::open(file, &["run", "kind", "level_g"], &[&outputs])?;
    let mut runs: Vec<(u64, TriadRun)> = Vec::new();
    while let Some(row) = table.next_row()? {
        let run = run(&row)?;
        if let Some((earlier_row, _)) = runs.iter().find(|(_, other)| other.run == run.run) {
            let problem = Problem::Repeated {
                number: run.run,
                earlier_row: *earlier_row,
            };
            return Err(row.error("run", problem));
        }
        if !row.flag(EXCLUDE)? {
            runs.push((row.line(), run));
        }
    }
    Ok(runs.into_iter().map(|(_, run)| run).collect())
}

fn run(row: &Row<'_>) -> Result<TriadRun, Error> {
    let known = [
        ["run", "kind", "level_g"],
        DIRECTION,
        GRAVITY,
        BEFORE,
        DURING,
        SIGMA,
    ]
    .concat();
    Ok(TriadRun {
        run: row.index("run")?,
        kind: row.one_of("kind", &KINDS, "a kind: sine or random")?,
        direction: direction(row)?,
        level_g: row.number("level_g", &ranges::LEVEL)?,
        a0_g: row.numbers(
            either(row, GRAVITY, GRAVITY_OF_ONE),
            &ranges::SPECIFIC_FORCE,
        )?,
        measured: measured(row)?,
        unknown: row.unknown(&known),
    })
}

/// The columns by the names of body axes, or of a single instrument's table.
fn either<'n>(row: &Row<'_>, body: [&'n str; 3], of_one: [&'n str; 3]) -> [&'n str; 3] {
    match row.text(body[0]).is_none() && row.text(of_one[0]).is_some() {
        true => of_one,
        false => body,
    }
}

fn direction(row: &Row<'_>) -> Result<[f64; 3], Error> {
    let columns = either(row, DIRECTION, DIRECTION_OF_ONE);
    let direction = row.numbers(columns, &ranges::COSINE)?;
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (length - 1.0).abs() <= UNIT_TOLERANCE {
        return Ok(direction);
    }
    let problem = format!("the direction is {length} long, not a unit vector");
    Err(row.error(columns[0], problem))
}

fn measured(row: &Row<'_>) -> Result<Option<TriadMeasured>, Error> {
    let mut plateaus = BEFORE.iter().chain(&DURING);
    if plateaus.all(|column| row.text(column).is_none()) {
        return Ok(None);
    }
    Ok(Some(TriadMeasured {
        before_v: row.numbers(BEFORE, &ranges::OUTPUT)?,
        during_v: row.numbers(DURING, &ranges::OUTPUT)?,
        sigma_v: row.numbers(SIGMA, &ranges::OUTPUT_SIGMA)?,
    }))
}

/// Writes a table of runs.
pub(crate) fn write(file: &Path, runs: &[TriadRun]) -> Result<(), Error> {
    let columns = [
        ["run", "kind", "level_g"],
        DIRECTION,
        GRAVITY,
        BEFORE,
        DURING,
        SIGMA,
    ]
    .concat();
    let cells = |run: &TriadRun| {
        let mut cells = vec![run.run.to_string(), word(&KINDS, run.kind)];
        cells.push(run.level_g.to_string());
        cells.extend(run.direction.iter().chain(&run.a0_g).map(f64::to_string));
        match &run.measured {
            Some(m) => {
                let all = m.before_v.iter().chain(&m.during_v).chain(&m.sigma_v);
                cells.extend(all.map(f64::to_string));
            }
            None => cells.extend(std::iter::repeat_n(String::new(), 9)),
        }
        cells
    };
    write_table(file, &columns, runs, cells, |run| &run.unknown)
}
