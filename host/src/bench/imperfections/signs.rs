//! An axis taken for the other way round in the columns of the direction.

use super::occurrence::{Occurrence, Tables};
use super::{Act, Entry};

const AXES: [&str; 3] = ["i", "p", "o"];

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "sign-direction",
        says: "a sign of one inclined direction wrong in all its runs",
        size: None,
        act: Act::Hand(one_direction),
    },
    Entry {
        id: "sign-axis",
        says: "the sign of one axis wrong in all directions",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            let axis = occurrence.stream.index(3);
            occurrence.note("axis", AXES[axis]);
            tables.every_run(occurrence, |run| turn_over(&mut run.direction, axis));
        }),
    },
];

/// A direction across one axis alone: the later of its two others changes its sign.
fn one_direction(tables: &mut Tables<'_>, occurrence: &mut Occurrence) {
    let plane = |direction: &[f64; 3]| direction.map(|cosine| cosine != 0.0);
    let mut planes: Vec<[bool; 3]> = Vec::new();
    for run in &tables.campaign.runs {
        let plane = plane(&run.direction);
        if plane.iter().filter(|moved| **moved).count() == 2 && !planes.contains(&plane) {
            planes.push(plane);
        }
    }
    if planes.is_empty() {
        return;
    }
    planes.sort_unstable();
    let chosen = planes[occurrence.stream.index(planes.len())];
    let axis = chosen.iter().rposition(|moved| *moved).unwrap_or_default();
    occurrence.note("axis", AXES[axis]);
    tables.every_run(occurrence, |run| {
        plane(&run.direction) == chosen && turn_over(&mut run.direction, axis)
    });
}

/// Whether there was a sign to change.
fn turn_over(direction: &mut [f64; 3], axis: usize) -> bool {
    let moved = direction[axis] != 0.0;
    if moved {
        direction[axis] = -direction[axis];
    }
    moved
}
