//! The positions of a static test as a file: what a person walks through, on paper too.

use std::path::Path;

use serde::Deserialize;
use shared::tumble::Position;

use super::ledger::Taken;
use crate::bench::plan::{self, Dwell, Static};
use crate::campaign::{self, Approach};
use crate::error::Error;
use crate::output::write_csv;

/// The plan's name in the folder of a capture.
pub const PLAN: &str = "plan.csv";

const COLUMNS: [&str; 5] = ["order", "series", "mount_deg", "dial_deg", "approach"];
/// What a person fills in.
const TO_FILL_IN: [&str; 4] = ["time", "temp_c", "u_v", "remark"];

/// The positions that `name` means: `default`, `paper` or `remounted`, or a file, see [`read_plan`].
///
/// # Errors
/// As [`read_plan`].
pub fn plan_of(name: &str) -> Result<Vec<Dwell>, Error> {
    match <Static as clap::ValueEnum>::from_str(name, false) {
        Ok(known) => Ok(plan::dwells(known)),
        Err(_) => read_plan(Path::new(name)),
    }
}

/// Reads a plan: a table with the columns series, dial_deg and, optional, mount_deg and approach (`cw` or `ccw`), or what
/// `vre plan --best N --json FILE` wrote. Where no approach is given, each position is approached from the one before it.
///
/// # Errors
/// The first thing wrong in the file.
pub fn read_plan(file: &Path) -> Result<Vec<Dwell>, Error> {
    let text = std::fs::read(file).map_err(Error::read(file))?;
    if text.trim_ascii_start().starts_with(b"{") {
        return best_of(file, &text);
    }
    let positions = campaign::read_plan(file)?;
    let approaches = approaches(file)?;
    if approaches.iter().all(Option::is_none) {
        return Ok(from_the_one_before(&positions));
    }
    let rows = positions.iter().zip(&approaches).zip(2..);
    let dwells = rows.map(|((position, approach), row)| {
        let missing = || Error::input(file, format!("row {row}, column approach: is empty"));
        Ok(dwell(position, approach.ok_or_else(missing)?))
    });
    dwells.collect()
}

#[derive(Deserialize)]
struct Advice {
    best: Option<Best>,
}

#[derive(Deserialize)]
struct Best {
    positions: Vec<Position>,
}

fn best_of(file: &Path, text: &[u8]) -> Result<Vec<Dwell>, Error> {
    let advice: Advice =
        serde_json::from_slice(text).map_err(|error| Error::input(file, error.to_string()))?;
    let best = advice.best.ok_or_else(|| {
        let problem = "holds no best plan; vre plan writes one with --best N --json FILE";
        Error::input(file, problem)
    })?;
    let finite = |p: &Position| p.dial_deg.is_finite() && p.mount_deg.is_finite();
    if best.positions.is_empty() || !best.positions.iter().all(finite) {
        return Err(Error::input(
            file,
            "its best plan has no positions, or angles that cannot be",
        ));
    }
    Ok(from_the_one_before(&best.positions))
}

/// The column approach, a cell a row; nothing where it is empty or not there.
fn approaches(file: &Path) -> Result<Vec<Option<Approach>>, Error> {
    let bad = |error: csv::Error| Error::input(file, error.to_string());
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .flexible(true)
        .from_path(file)
        .map_err(bad)?;
    let mut header = reader.headers().map_err(bad)?.iter();
    let column = header.position(|name| name == "approach");
    let mut approaches = Vec::new();
    for (record, row) in reader.records().zip(2..) {
        let record = record.map_err(bad)?;
        approaches.push(match column.and_then(|at| record.get(at)) {
            None | Some("") => None,
            Some("cw") => Some(Approach::Clockwise),
            Some("ccw") => Some(Approach::CounterClockwise),
            Some(other) => {
                let shown = crate::error::clip(other);
                let problem =
                    format!("row {row}, column approach: \"{shown}\" is neither cw nor ccw");
                return Err(Error::input(file, problem));
            }
        });
    }
    Ok(approaches)
}

/// Counter-clockwise to a greater angle, clockwise to a smaller one; the first of a series and mount from below.
fn from_the_one_before(positions: &[Position]) -> Vec<Dwell> {
    let mut last: Option<&Position> = None;
    let each = positions.iter().map(|position| {
        let before = last.replace(position);
        let same =
            before.filter(|b| (b.series, b.mount_deg) == (position.series, position.mount_deg));
        let falls = same.is_some_and(|b| b.dial_deg > position.dial_deg);
        dwell(
            position,
            if falls {
                Approach::Clockwise
            } else {
                Approach::CounterClockwise
            },
        )
    });
    each.collect()
}

fn dwell(position: &Position, approach: Approach) -> Dwell {
    Dwell {
        series: position.series,
        dial_deg: position.dial_deg,
        mount_deg: position.mount_deg,
        approach,
    }
}

/// Writes the plan as a table.
///
/// # Errors
/// What the file system says.
pub fn write_plan(file: &Path, dwells: &[Dwell]) -> Result<(), Error> {
    write_table(file, &COLUMNS, dwells)
}

/// Writes the plan as a run sheet: the plan with columns to be filled in by hand.
///
/// # Errors
/// What the file system says.
pub fn write_sheet(file: &Path, dwells: &[Dwell]) -> Result<(), Error> {
    let columns: Vec<&str> = COLUMNS.into_iter().chain(TO_FILL_IN).collect();
    write_table(file, &columns, dwells)
}

fn write_table(file: &Path, columns: &[&str], dwells: &[Dwell]) -> Result<(), Error> {
    write_csv(file, |writer| {
        writer.write_record(columns)?;
        for (order, dwell) in dwells.iter().enumerate() {
            let mut cells = vec![
                order.to_string(),
                u8::from(dwell.series).to_string(),
                dwell.mount_deg.to_string(),
                dwell.dial_deg.to_string(),
                match dwell.approach {
                    Approach::Clockwise => "cw".into(),
                    Approach::CounterClockwise => "ccw".into(),
                },
            ];
            cells.resize(columns.len(), String::new());
            writer.write_record(cells)?;
        }
        Ok(())
    })
}

/// The positions of the plan that no reading was taken at yet, in order.
pub fn remaining<'t>(plan: &[Dwell], taken: impl Iterator<Item = &'t Taken>) -> Vec<Dwell> {
    let mut left = plan.to_vec();
    for taken in taken {
        if let Some(at) = left.iter().position(|dwell| *dwell == taken.dwell) {
            left.remove(at);
        }
    }
    left
}
