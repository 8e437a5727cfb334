//! Levels that were typed in another unit, or wrongly.

use super::occurrence::{File, Occurrence, Tables};
use super::{Act, Entry, sized};
use crate::campaign::VibrationKind;

/// Metres per second squared in 1 g.
const STANDARD_GRAVITY: f64 = 9.80665;

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "level-typed",
        says: "the level of one run typed SIZE times too large",
        size: sized(10.0, "times", [1e-3, 1e3]),
        act: Act::Hand(|tables, occurrence| {
            let runs = &mut tables.campaign.runs;
            for place in occurrence.choose(1, (0..runs.len()).collect()) {
                runs[place].level_g = typed(runs[place].level_g * occurrence.size);
                occurrence.touch(File::Vibration, place);
            }
        }),
    },
    Entry {
        id: "levels-factor",
        says: "all levels entered SIZE times too large",
        size: sized(2.0, "times", [1e-3, 1e3]),
        act: Act::Hand(|tables, occurrence| all(tables, occurrence, occurrence.size, None)),
    },
    Entry {
        id: "levels-rms",
        says: "levels of all sines entered as rms, not as peak",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            let sines = Some(VibrationKind::Sine);
            all(tables, occurrence, std::f64::consts::FRAC_1_SQRT_2, sines);
        }),
    },
    Entry {
        id: "levels-ms2",
        says: "all levels entered in m/s^2",
        size: None,
        act: Act::Hand(|tables, occurrence| all(tables, occurrence, STANDARD_GRAVITY, None)),
    },
];

/// Multiplies the levels of all runs of a kind, or of all.
fn all(
    tables: &mut Tables<'_>,
    occurrence: &mut Occurrence,
    factor: f64,
    kind: Option<VibrationKind>,
) {
    tables.every_run(occurrence, |run| {
        let concerned = kind.is_none_or(|kind| run.kind == kind);
        if concerned {
            run.level_g = typed(run.level_g * factor);
        }
        concerned
    });
}

/// To five digits, as a hand writes it.
fn typed(level_g: f64) -> f64 {
    format!("{level_g:.4e}").parse().unwrap_or(level_g)
}
