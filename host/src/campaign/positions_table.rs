//! `positions.csv`: one row per position at rest of a triad.

use std::path::Path;

use shared::triad::attitude::Attitude;
use shared::tumble::ARCSEC_RAD;

use super::marks::EXCLUDE;
use super::ranges;
use super::table::{Row, Table};
use super::{UnknownCells, write_table};
use crate::error::{Error, Problem};

const OUTPUT: [&str; 3] = ["u_x_v", "u_y_v", "u_z_v"];
const SIGMA: [&str; 3] = ["sigma_x_v", "sigma_y_v", "sigma_z_v"];
const FORCE: [&str; 3] = ["a_x_g", "a_y_g", "a_z_g"];
const ATTITUDE_SIGMA: &str = "attitude_sigma_arcsec";
const COLUMNS: [&str; 14] = [
    "order",
    "time_s",
    OUTPUT[0],
    OUTPUT[1],
    OUTPUT[2],
    SIGMA[0],
    SIGMA[1],
    SIGMA[2],
    "temp_c",
    FORCE[0],
    FORCE[1],
    FORCE[2],
    ATTITUDE_SIGMA,
    EXCLUDE,
];

/// One position at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct TriadPosition {
    /// Sequence number, unique within the table.
    pub order: u64,
    /// Line of the file, the header being 1; 0 where it comes from no file.
    pub line: u64,
    /// Time since the campaign's start, s.
    pub time_s: Option<f64>,
    /// Mean output of x, y, z, V.
    pub output_v: [f64; 3],
    /// Standard uncertainty of each mean from noise alone, V; greater than zero.
    pub sigma_v: [f64; 3],
    /// Temperature of the triad, degrees Celsius.
    pub temp_c: Option<f64>,
    /// What is known of the attitude.
    pub attitude: Option<Attitude>,
    /// Columns that mean nothing to us.
    pub unknown: UnknownCells,
}

/// Most positions of a campaign: all are kept, and each is left out once.
const MAX_POSITIONS: usize = 4096;

/// Reads and checks `positions.csv`; rows that are excluded are left out.
pub(super) fn read(file: &Path) -> Result<Vec<TriadPosition>, Error> {
    let required = [&["order"], OUTPUT.as_slice(), SIGMA.as_slice()].concat();
    let attitude = [FORCE.as_slice(), &[ATTITUDE_SIGMA]].concat();
    let mut table = Table::open(file, &required, &[&attitude])?;
    let mut positions: Vec<TriadPosition> = Vec::new();
    while let Some(row) = table.next_row()? {
        let position = position(&row)?;
        let earlier = positions.iter().find(|p| p.order == position.order);
        if let Some(earlier) = earlier {
            let problem = Problem::Repeated {
                number: position.order,
                earlier_row: earlier.line,
            };
            return Err(row.error("order", problem));
        }
        if row.flag(EXCLUDE)? {
            continue;
        }
        if positions.len() == MAX_POSITIONS {
            let problem = format!("is one of more than {MAX_POSITIONS} positions");
            return Err(row.error("order", problem));
        }
        positions.push(position);
    }
    match positions.is_empty() {
        true => Err(Error::input(file, "every position is excluded")),
        false => Ok(positions),
    }
}

fn position(row: &Row<'_>) -> Result<TriadPosition, Error> {
    Ok(TriadPosition {
        order: row.index("order")?,
        line: row.line(),
        time_s: row.optional("time_s", &ranges::TIME)?,
        output_v: row.numbers(OUTPUT, &ranges::OUTPUT)?,
        sigma_v: row.numbers(SIGMA, &ranges::OUTPUT_SIGMA)?,
        temp_c: row.optional("temp_c", &ranges::TEMPERATURE)?,
        attitude: attitude(row)?,
        unknown: row.unknown(&COLUMNS),
    })
}

/// The attitude, if its cells are filled: all of them or none.
fn attitude(row: &Row<'_>) -> Result<Option<Attitude>, Error> {
    let mut cells = FORCE.iter().chain([&ATTITUDE_SIGMA]);
    if cells.all(|column| row.text(column).is_none()) {
        return Ok(None);
    }
    let direction = row.numbers(FORCE, &ranges::SPECIFIC_FORCE)?;
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(0.5..2.0).contains(&length) {
        let unit = if (length - 9.8).abs() < 0.5 {
            "; is it in m/s^2?"
        } else {
            ""
        };
        let problem = format!("the specific force is {length} g long, not about 1 g{unit}");
        return Err(row.error(FORCE[0], problem));
    }
    let sigma_rad = row.number(ATTITUDE_SIGMA, &ranges::ARCSEC_SIGMA)? * ARCSEC_RAD;
    Ok(Some(Attitude {
        direction,
        sigma_rad,
    }))
}

/// Writes `positions.csv`.
pub(crate) fn write(file: &Path, positions: &[TriadPosition]) -> Result<(), Error> {
    let known = positions.iter().any(|p| p.attitude.is_some());
    let columns = &COLUMNS[..if known { 13 } else { 9 }];
    let cells = |p: &TriadPosition| {
        let maybe = |x: Option<f64>| x.map_or(String::new(), |x| x.to_string());
        let mut cells = vec![p.order.to_string(), maybe(p.time_s)];
        cells.extend(p.output_v.iter().chain(&p.sigma_v).map(f64::to_string));
        cells.push(maybe(p.temp_c));
        if known {
            let of = |axis: usize| p.attitude.map(|attitude| attitude.direction[axis]);
            cells.extend([0, 1, 2].map(|axis| maybe(of(axis))));
            cells.push(maybe(p.attitude.map(|a| a.sigma_rad / ARCSEC_RAD)));
        }
        cells
    };
    write_table(file, columns, positions, cells, |p| &p.unknown)
}
