//! The instrument is mounted and powered up anew between head and shaker, or between two days of the shaker.

use super::occurrence::{File, Occurrence};
use super::{Act, Entry, sized};
use crate::bench::devices::Session;
use crate::bench::simulate::VirtualBench;

const MICRO: f64 = 1e-6;

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "session-bias",
        says: "a power cycle before the shaker: bias SIZE off",
        size: sized(100.0, "microg", [0.0, 1e5]),
        act: Act::Device(|bench, occurrence| {
            let bias_g = MICRO * occurrence.signed_size();
            occurrence.note("bias_g", bias_g);
            begin(bench, occurrence, 0, |session| session.bias_g = bias_g);
        }),
    },
    Entry {
        id: "session-alignment",
        says: "remounted on the shaker: turned by SIZE about an axis of chance",
        size: sized(50.0, "microrad", [0.0, 1e5]),
        act: Act::Device(|bench, occurrence| {
            let axis = [(); 3].map(|()| occurrence.stream.normal());
            let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
            let turn_rad = axis.map(|x| MICRO * occurrence.size * x / length);
            occurrence.note("turn_rad", turn_rad.to_vec());
            begin(bench, occurrence, 0, |session| session.turn_rad = turn_rad);
        }),
    },
    Entry {
        id: "session-gain",
        says: "another logger on the shaker: gain SIZE off; the same peak detector",
        size: sized(0.01, "", [0.0, 0.5]),
        act: Act::Device(|bench, occurrence| {
            let gain_error = occurrence.signed_size();
            occurrence.note("gain_error", gain_error);
            begin(bench, occurrence, 0, |session| {
                session.gain_error = gain_error
            });
        }),
    },
    Entry {
        id: "session-day",
        says: "half of the runs on another day: bias SIZE off; column session tells",
        size: sized(30.0, "microg", [0.0, 1e5]),
        act: Act::Device(|bench, occurrence| {
            let second = bench.plan.runs.len() / 2;
            begin(bench, occurrence, 0, |session| {
                session.name = Some("shaker-1")
            });
            another_day(bench, occurrence, second, Some("shaker-2"));
            occurrence.touch_rows(File::Holdout, 0..bench.plan.holdout.len());
        }),
    },
    Entry {
        id: "session-day-unmarked",
        says: "the same without the column",
        size: sized(30.0, "microg", [0.0, 1e5]),
        act: Act::Device(|bench, occurrence| {
            let second = bench.plan.runs.len() / 2;
            another_day(bench, occurrence, second, None);
        }),
    },
];

fn another_day(
    bench: &mut VirtualBench,
    occurrence: &mut Occurrence,
    first_run: usize,
    name: Option<&'static str>,
) {
    let bias_g = MICRO * occurrence.signed_size();
    occurrence.note("bias_g", bias_g);
    let before = bench.devices.session(first_run).bias_g;
    begin(bench, occurrence, first_run, |session| {
        session.bias_g = before + bias_g;
        session.name = name.or(session.name);
    });
}

/// Changes the session that begins with a run; what else the runs have of their own stays.
fn begin(
    bench: &mut VirtualBench,
    occurrence: &mut Occurrence,
    first_run: usize,
    change: impl Fn(&mut Session),
) {
    let devices = &mut bench.devices;
    if devices.sessions.iter().all(|s| s.first_run != first_run) {
        let session = Session {
            first_run,
            ..devices.session(first_run)
        };
        devices.sessions.push(session);
        devices.sessions.sort_by_key(|session| session.first_run);
    }
    let later = devices.sessions.iter_mut();
    later.filter(|s| s.first_run >= first_run).for_each(change);
    occurrence.touch_rows(File::Vibration, first_run..bench.plan.runs.len());
}
