//! The campaign states another uncertainty than its devices have. Outputs stay as they are.

use super::occurrence::{File, Occurrence, Tables};
use super::{Act, Entry, sized};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "noise-readings",
        says: "readings scatter SIZE times as much as their sigma states (< 1: less)",
        size: sized(2.0, "times", [0.01, 100.0]),
        act: Act::Hand(readings),
    },
    Entry {
        id: "noise-runs",
        says: "plateaus and drift scatter SIZE times as much as their sigmas state",
        size: sized(2.0, "times", [0.01, 100.0]),
        act: Act::Hand(runs),
    },
    Entry {
        id: "noise-all",
        says: "readings, plateaus and drift scatter SIZE times as much as stated",
        size: sized(2.0, "times", [0.01, 100.0]),
        act: Act::Hand(|tables, occurrence| {
            readings(tables, occurrence);
            runs(tables, occurrence);
        }),
    },
    Entry {
        id: "dial-sigma",
        says: "the dial's marks err SIZE times as much as campaign.toml states",
        size: sized(3.0, "times", [0.01, 100.0]),
        act: Act::Hand(|tables, occurrence| {
            tables.campaign.config.bench.dial_sigma_arcsec /= occurrence.size;
            occurrence.touch(File::Config, 0);
        }),
    },
];

fn readings(tables: &mut Tables<'_>, occurrence: &mut Occurrence) {
    for (place, reading) in tables.campaign.readings.iter_mut().enumerate() {
        reading.sigma_v /= occurrence.size;
        occurrence.touch(File::Static, place);
    }
}

fn runs(tables: &mut Tables<'_>, occurrence: &mut Occurrence) {
    for (place, run) in tables.campaign.runs.iter_mut().enumerate() {
        let Some(measured) = &mut run.measured else {
            continue;
        };
        measured.sigma_v /= occurrence.size;
        if let Some(drift) = &mut measured.drift {
            drift.sigma_v_per_s /= occurrence.size;
        }
        occurrence.touch(File::Vibration, place);
    }
}
