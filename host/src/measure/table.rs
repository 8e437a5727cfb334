//! Segments from the rows of a file.

use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;

use super::Calibration;
use super::segment::{Role, Segment};
use super::selection::Selection;
use super::survey::Survey;
use crate::error::{Error, Problem};
use crate::import::{self, Columns, Rows};

/// Most groups that can be selected.
const MAX_GROUPS: usize = 10_000;

/// Surveys all rows; cells that cannot be read are an error only where the row is `needed` at its time. Also what should be
/// known of the file.
pub(super) fn survey(
    file: &Path,
    columns: &Columns,
    calibration: &Calibration,
    needed: impl Fn(f64) -> bool,
) -> Result<(Survey, Option<String>), Error> {
    let mut rows = import::open(file, columns, None)?;
    let mut survey = Survey::new(columns.outputs.len());
    let mut outputs = vec![0.0; columns.outputs.len()];
    let mut count = 0u64;
    while rows.advance()? {
        let time_s = rows.time_s()?;
        let at = time_s.unwrap_or(count as f64);
        count += 1;
        for (axis, output) in outputs.iter_mut().enumerate() {
            match rows.output(axis) {
                Ok(value) => *output = value / calibration.units_per_g,
                Err(error) if needed(at) => return Err(error),
                Err(_) => {} // The value before stays; nobody takes it for a sample.
            }
        }
        survey.push(&outputs, time_s);
    }
    match count {
        0 => Err(Error::input(file, Problem::NoRows)),
        _ => Ok((survey, rows.remark().map(str::to_owned))),
    }
}

/// Reads the segments of groups.
pub(super) fn read_groups(
    file: &Path,
    columns: &Columns,
    selection: &Selection,
    calibration: &Calibration,
) -> Result<Vec<Segment>, Error> {
    let Selection::Groups { column, .. } = selection else {
        return Ok(Vec::new());
    };
    let mut rows = import::open(file, columns, Some(column))?;
    let mut groups = Groups::new(columns.outputs.len());
    let mut count = 0u64;
    while rows.advance()? {
        let name = rows.group()?.unwrap_or_default();
        let segment = groups.of(selection, name);
        if let Some(segment) = segment.map_err(|problem| Error::input(file, problem))? {
            absorb(segment, rows.as_ref(), count, calibration)?;
        }
        count += 1;
    }
    match count {
        0 => Err(Error::input(file, Problem::NoRows)),
        _ => Ok(finished(groups.list)),
    }
}

/// A stretch to read: rows, or a window of time where a selection has it.
#[derive(Clone, Debug)]
pub(super) struct Wanted {
    pub name: String,
    pub role: Role,
    pub rows: Option<Range<u64>>,
}

/// Reads the stretches, and the windows of a selection before them.
pub(super) fn read_stretches(
    file: &Path,
    columns: &Columns,
    selection: Option<&Selection>,
    wanted: &[Wanted],
    calibration: &Calibration,
) -> Result<Vec<Segment>, Error> {
    let mut rows = import::open(file, columns, None)?;
    let new = |name: &str, role| Segment::new(name.into(), role, columns.outputs.len());
    let mut windows = [new("before", Role::Before), new("during", Role::During)];
    let mut stretches: Vec<Segment> = wanted.iter().map(|w| new(&w.name, w.role)).collect();
    let mut count = 0u64;
    while rows.advance()? {
        let at = rows.time_s()?.unwrap_or(count as f64);
        if let Some(Selection::Windows { before, during }) = selection {
            let window = match (before.has(at), during.has(at)) {
                (true, _) => windows.first_mut(),
                (_, true) => windows.last_mut(),
                _ => None,
            };
            if let Some(segment) = window {
                absorb(segment, rows.as_ref(), count, calibration)?;
            }
        }
        for (segment, wanted) in stretches.iter_mut().zip(wanted) {
            if wanted
                .rows
                .as_ref()
                .is_some_and(|rows| rows.contains(&count))
            {
                absorb(segment, rows.as_ref(), count, calibration)?;
            }
        }
        count += 1;
    }
    let all = windows.into_iter().chain(stretches);
    Ok(finished(
        all.filter(|segment| segment.count() > 0).collect(),
    ))
}

fn finished(mut segments: Vec<Segment>) -> Vec<Segment> {
    segments.iter_mut().for_each(Segment::finish);
    segments
}

/// Adds a row to its segment.
fn absorb(
    segment: &mut Segment,
    rows: &dyn Rows,
    row: u64,
    calibration: &Calibration,
) -> Result<(), Error> {
    match rows.time_s()? {
        Some(time_s) => segment.tick(time_s, row),
        None => segment.reach(row as f64),
    }
    if let Some(temperature_c) = rows.temperature_c()? {
        segment.temperature_c.add(temperature_c);
    }
    for (axis, channel) in segment.channels.iter_mut().enumerate() {
        let output_g = rows.output(axis)? / calibration.units_per_g;
        channel
            .push(output_g, calibration.clip_g(), row)
            .map_err(|problem| rows.output_error(axis, problem))?;
    }
    Ok(())
}

/// Lines of the rows with these numbers, in the same order; none if the format has no lines.
pub(super) fn lines(
    file: &Path,
    columns: &Columns,
    wanted: &[u64],
) -> Result<HashMap<u64, u64>, Error> {
    let mut found = HashMap::new();
    let mut rows = import::open(file, columns, None)?;
    let last = wanted.iter().copied().max().unwrap_or(0);
    let mut count = 0u64;
    while count <= last && rows.advance()? {
        if wanted.contains(&count)
            && let Some(line) = rows.line()
        {
            found.insert(count, line);
        }
        count += 1;
    }
    Ok(found)
}

/// The groups in the order in which they appear.
struct Groups {
    list: Vec<Segment>,
    by_name: HashMap<String, Option<usize>>,
    columns: usize,
    last: Option<(String, Option<usize>)>,
}

impl Groups {
    fn new(columns: usize) -> Self {
        Self {
            list: Vec::new(),
            by_name: HashMap::new(),
            columns,
            last: None,
        }
    }

    fn of(&mut self, selection: &Selection, name: &str) -> Result<Option<&mut Segment>, Problem> {
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
