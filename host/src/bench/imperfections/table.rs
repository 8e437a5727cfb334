//! The shaker's table does not do what it is commanded; the reference sees what it does.

use super::occurrence::{File, Occurrence};
use super::{Act, Entry, sized};
use crate::bench::simulate::VirtualBench;

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "table-scatter",
        says: "the table misses its command from run to run, standard deviation SIZE",
        size: sized(0.003, "", [0.0, 0.2]),
        act: Act::Device(|bench, occurrence| {
            bench.devices.table.scatter = occurrence.size;
            touch_all(bench, occurrence);
        }),
    },
    Entry {
        id: "table-gain",
        says: "the table is off its command by SIZE in all runs alike",
        size: sized(0.01, "", [0.0, 0.5]),
        act: Act::Device(|bench, occurrence| {
            let gain_error = occurrence.signed_size();
            occurrence.note("gain_error", gain_error);
            bench.devices.table.gain_error += gain_error;
            touch_all(bench, occurrence);
        }),
    },
];

fn touch_all(bench: &VirtualBench, occurrence: &mut Occurrence) {
    occurrence.touch_rows(File::Vibration, 0..bench.plan.runs.len());
    occurrence.touch_rows(File::Holdout, 0..bench.plan.holdout.len());
}
