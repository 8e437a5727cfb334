//! The reference accelerometer and the peak detector as the instruments that they are.

use super::occurrence::{File, Occurrence};
use super::{Act, Entry, sized};
use crate::bench::simulate::VirtualBench;

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "reference-noise",
        says: "each axis of the reference has a noise of SIZE rms",
        size: sized(0.1, "mg", [0.0, 1e3]),
        act: Act::Device(|bench, occurrence| {
            bench.devices.reference.noise_g = 1e-3 * occurrence.size;
            touch_all(bench, occurrence);
        }),
    },
    Entry {
        id: "reference-cross",
        says: "the reference has cross-sensitivities, standard deviation SIZE",
        size: sized(0.01, "", [0.0, 0.5]),
        act: Act::Device(|bench, occurrence| {
            for (axis, row) in bench.devices.reference.response.iter_mut().enumerate() {
                for (along, element) in row.iter_mut().enumerate() {
                    if axis != along {
                        *element += occurrence.size * occurrence.stream.normal();
                    }
                }
            }
            note_response(bench, occurrence);
        }),
    },
    Entry {
        id: "reference-gain",
        says: "the gains of the reference's axes are off, standard deviation SIZE",
        size: sized(0.005, "", [0.0, 0.5]),
        act: Act::Device(|bench, occurrence| {
            for (axis, row) in bench.devices.reference.response.iter_mut().enumerate() {
                row[axis] *= 1.0 + occurrence.size * occurrence.stream.normal();
            }
            note_response(bench, occurrence);
        }),
    },
    Entry {
        id: "reference-scatter",
        says: "the reference's rms scatters from run to run, standard deviation SIZE",
        size: sized(0.002, "", [0.0, 0.5]),
        act: Act::Device(|bench, occurrence| {
            bench.devices.reference.rms_rel_sigma = Some(occurrence.size);
            touch_all(bench, occurrence);
        }),
    },
    Entry {
        id: "reference-reversed",
        says: "the P channel of the reference reversed",
        size: None,
        act: Act::Device(|bench, occurrence| {
            let [_, along_p, _] = &mut bench.devices.reference.response;
            *along_p = along_p.map(|element| 0.0 - element);
            note_response(bench, occurrence);
        }),
    },
    Entry {
        id: "peak-gain",
        says: "the gain of the peak detector SIZE off",
        size: sized(0.005, "", [0.0, 0.5]),
        act: Act::Device(|bench, occurrence| {
            let gain_error = occurrence.signed_size();
            occurrence.note("gain_error", gain_error);
            bench.devices.peak_gain_error += gain_error;
            let runs = bench.plan.runs.len();
            occurrence.touch_rows(File::Vibration, 0..runs);
        }),
    },
];

fn note_response(bench: &VirtualBench, occurrence: &mut Occurrence) {
    let rows = bench.devices.reference.response.map(|row| row.to_vec());
    occurrence.note("response", rows.to_vec());
    touch_all(bench, occurrence);
}

/// A reference looks at runs to hold out as well.
fn touch_all(bench: &VirtualBench, occurrence: &mut Occurrence) {
    occurrence.touch_rows(File::Vibration, 0..bench.plan.runs.len());
    occurrence.touch_rows(File::Holdout, 0..bench.plan.holdout.len());
}
