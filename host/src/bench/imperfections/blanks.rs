//! What was not measured: absent, or filled with something.

use super::occurrence::{File, Occurrence, Tables};
use super::{Act, Entry};
use crate::campaign::{Extremes, Measured, ReferenceMoments};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "reference-zeros",
        says: "zeros in the reference's columns, which nobody measured",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            let zeros = ReferenceMoments {
                rms_g: [0.0; 3],
                skewness: [0.0; 3],
                kurtosis: [0.0; 3],
                correlation: Some([0.0; 3]),
            };
            tables.every_run(occurrence, |run| {
                run.reference = Some(zeros);
                true
            });
        }),
    },
    Entry {
        id: "reference-mean",
        says: "means of the reference's columns in three runs, where nobody measured",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            let runs = &mut tables.campaign.runs;
            let seen: Vec<ReferenceMoments> = runs.iter().filter_map(|run| run.reference).collect();
            let mean = |of: &dyn Fn(&ReferenceMoments) -> [f64; 3]| {
                let sum = |axis: usize| seen.iter().map(|seen| of(seen)[axis]).sum::<f64>();
                [0, 1, 2].map(|axis| sum(axis) / seen.len().max(1) as f64)
            };
            let mean = ReferenceMoments {
                rms_g: mean(&|seen| seen.rms_g),
                skewness: mean(&|seen| seen.skewness),
                kurtosis: mean(&|seen| seen.kurtosis),
                correlation: Some(mean(&|seen| seen.correlation.unwrap_or_default())),
            };
            for place in occurrence.choose(3, (0..runs.len()).collect()) {
                runs[place].reference = Some(mean);
                occurrence.touch(File::Vibration, place);
            }
        }),
    },
    Entry {
        id: "extremes-mean",
        says: "the mean output as both extremes, which no peak detector measured",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            each(tables, occurrence, |measured| {
                measured.extremes = Some(Extremes {
                    minimum_v: measured.during_v,
                    maximum_v: measured.during_v,
                });
            });
        }),
    },
    Entry {
        id: "no-before",
        says: "no output before a run: NaN, as a logger writes what it did not wait for",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            each(tables, occurrence, |measured| measured.before_v = f64::NAN);
        }),
    },
    Entry {
        id: "no-recovery",
        says: "no output after a run",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            each(tables, occurrence, |measured| measured.after_v = None);
        }),
    },
    Entry {
        id: "no-drift",
        says: "no drift during a run",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            each(tables, occurrence, |measured| measured.drift = None);
        }),
    },
    Entry {
        id: "no-extremes",
        says: "no extremes of the output",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            each(tables, occurrence, |measured| measured.extremes = None);
        }),
    },
    Entry {
        id: "no-reference",
        says: "no reference accelerometer",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            tables.every_run(occurrence, |run| run.reference.take().is_some());
        }),
    },
];

/// Does something to what was measured in each run.
fn each(tables: &mut Tables<'_>, occurrence: &mut Occurrence, act: impl Fn(&mut Measured)) {
    for (place, run) in tables.campaign.runs.iter_mut().enumerate() {
        if let Some(measured) = &mut run.measured {
            act(measured);
            occurrence.touch(File::Vibration, place);
        }
    }
}
