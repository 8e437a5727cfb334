//! What is no fault at all, or that of the instrument alone: leads, clock, kind of noise.

use super::occurrence::{File, Occurrence};
use super::{Act, Entry, sized};
use crate::bench::simulate::VirtualBench;

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "inverted",
        says: "the output's leads swapped: a negative scale factor, stated so",
        size: None,
        act: Act::Device(|bench, occurrence| {
            let accelerometer = &mut bench.accelerometer;
            accelerometer.scale_factor_nominal_v_per_g *= -1.0;
            accelerometer.coefficients.scale_factor_v_per_g *= -1.0;
            occurrence.touch(File::Config, 0);
            touch_outputs(bench, occurrence);
        }),
    },
    Entry {
        id: "times-of-day",
        says: "all times counted from SIZE before the campaign's start",
        size: sized(1e6, "s", [0.0, 1e10]),
        act: Act::Hand(|tables, occurrence| {
            let offset_s = occurrence.size;
            for (place, reading) in tables.campaign.readings.iter_mut().enumerate() {
                reading.time_s += offset_s;
                occurrence.touch(File::Static, place);
            }
            tables.every_run(occurrence, |run| {
                run.time_s += offset_s;
                true
            });
        }),
    },
    Entry {
        id: "heavy-tails",
        says: "noise of Student's t with SIZE degrees of freedom, of the stated sigma",
        size: sized(3.0, "dof", [2.0, 1e3]),
        act: Act::Device(|bench, occurrence| {
            bench.devices.tail_dof = Some(occurrence.size);
            touch_outputs(bench, occurrence);
        }),
    },
];

fn touch_outputs(bench: &VirtualBench, occurrence: &mut Occurrence) {
    occurrence.touch_rows(File::Static, 0..bench.plan.dwells.len());
    occurrence.touch_rows(File::Vibration, 0..bench.plan.runs.len());
}
