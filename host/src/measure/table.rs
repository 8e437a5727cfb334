//! Segments from the rows of a table.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use super::Calibration;
use super::segment::{Role, Segment};
use super::selection::Selection;
use crate::error::{Error, Problem, clip};
use crate::import::delimited::{Columns, Row, Table};

/// Most groups that can be selected.
const MAX_GROUPS: usize = 10_000;

/// Reads the segments; `file` is for errors only.
pub(super) fn read(
    file: &Path,
    source: impl Read,
    columns: &Columns,
    selection: &Selection,
    calibration: &Calibration,
) -> Result<Vec<Segment>, Error> {
    let group = match selection {
        Selection::Groups { column, .. } => Some(column.as_str()),
        Selection::Windows { .. } => None,
    };
    let mut table = Table::open(file, source, columns, group)?;
    let mut segments = Segments::new(columns.outputs.len());
    let mut rows = 0u64;
    while let Some(row) = table.next_row()? {
        let time_s = row.time_s()?;
        let segment = match row.group()? {
            Some(name) => segments.of_group(selection, name),
            None => segments.of_time(selection, time_s.unwrap_or(rows as f64)),
        };
        rows += 1;
        let segment = segment.map_err(|problem| Error::input(file, problem))?;
        if let Some(segment) = segment {
            absorb(segment, &row, time_s, calibration)?;
        }
    }
    match rows {
        0 => Err(Error::input(file, Problem::NoRows)),
        _ => Ok(segments.list),
    }
}

/// Adds a row to its segment.
fn absorb<R: Read>(
    segment: &mut Segment,
    row: &Row<'_, R>,
    time_s: Option<f64>,
    calibration: &Calibration,
) -> Result<(), Error> {
    if let Some(time_s) = time_s {
        segment.tick(time_s).map_err(|step| {
            let name = clip(&segment.name);
            let problem = format!("time goes on by {step} s within \"{name}\"");
            row.time_error(Problem::Other(problem))
        })?;
    }
    if let Some(temperature_c) = row.temperature_c()? {
        segment.temperature_c.add(temperature_c);
    }
    for (axis, channel) in segment.channels.iter_mut().enumerate() {
        let output_g = row.output(axis)? / calibration.units_per_g;
        channel
            .push(output_g, calibration.clip_g())
            .map_err(|problem| row.output_error(axis, problem))?;
    }
    Ok(())
}

/// The segments in the order in which they appear.
struct Segments {
    list: Vec<Segment>,
    by_name: HashMap<String, Option<usize>>,
    columns: usize,
    last: Option<(String, Option<usize>)>,
}

impl Segments {
    fn new(columns: usize) -> Self {
        Self {
            list: Vec::new(),
            by_name: HashMap::new(),
            columns,
            last: None,
        }
    }

    fn of_group(
        &mut self,
        selection: &Selection,
        name: &str,
    ) -> Result<Option<&mut Segment>, Problem> {
        let known = match &self.last {
            Some((last, index)) if last == name => Some(*index),
            _ => self.by_name.get(name).copied(),
        };
        let index = match known {
            Some(index) => index,
            None => {
                let Some(role) = group_role(selection, name) else {
                    return Ok(None);
                };
                if self.list.len() == MAX_GROUPS {
                    return Err(Problem::Other(format!(
                        "more than {MAX_GROUPS} groups are selected"
                    )));
                }
                self.list
                    .push(Segment::new(name.into(), role, self.columns));
                let index = Some(self.list.len() - 1);
                self.by_name.insert(name.into(), index);
                index
            }
        };
        if self.last.as_ref().is_none_or(|(last, _)| last != name) {
            self.last = Some((name.into(), index));
        }
        Ok(index.and_then(|index| self.list.get_mut(index)))
    }

    fn of_time(
        &mut self,
        selection: &Selection,
        time_s: f64,
    ) -> Result<Option<&mut Segment>, Problem> {
        let Selection::Windows { before, during } = selection else {
            return Ok(None);
        };
        let role = match (before.has(time_s), during.has(time_s)) {
            (true, _) => Role::Before,
            (_, true) => Role::During,
            _ => return Ok(None),
        };
        let index = self.list.iter().position(|segment| segment.role == role);
        let index = index.unwrap_or_else(|| {
            self.list
                .push(Segment::new(role.to_string(), role, self.columns));
            self.list.len() - 1
        });
        Ok(self.list.get_mut(index))
    }
}

/// Who is before is not during, whatever pattern matches.
fn group_role(selection: &Selection, name: &str) -> Option<Role> {
    let Selection::Groups {
        before,
        during,
        without,
        ..
    } = selection
    else {
        return None;
    };
    match (without.has(name), before.has(name), during.has(name)) {
        (false, true, _) => Some(Role::Before),
        (false, false, true) => Some(Role::During),
        _ => None,
    }
}
