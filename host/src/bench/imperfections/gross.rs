//! A knock, a door, a loose cable: outputs that do not belong.

use shared::tumble::ARCSEC_RAD;

use super::occurrence::{File, Occurrence, Tables};
use super::{Act, Entry, sized};

/// Standard uncertainties of a gross error, and what they can be.
const SIGMAS: (f64, [f64; 2]) = (30.0, [0.0, 1e5]);

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "gross-reading",
        says: "one reading SIZE off, sigma of noise and dial",
        size: sized(SIGMAS.0, "sigma", SIGMAS.1),
        act: Act::Hand(|tables, occurrence| readings(tables, occurrence, 1)),
    },
    Entry {
        id: "gross-readings",
        says: "three readings SIZE off",
        size: sized(SIGMAS.0, "sigma", SIGMAS.1),
        act: Act::Hand(|tables, occurrence| readings(tables, occurrence, 3)),
    },
    Entry {
        id: "gross-run",
        says: "one plateau of one run SIZE off, sigma of noise",
        size: sized(SIGMAS.0, "sigma", SIGMAS.1),
        act: Act::Hand(|tables, occurrence| runs(tables, occurrence, 1)),
    },
    Entry {
        id: "gross-runs",
        says: "one plateau of each of three runs SIZE off",
        size: sized(SIGMAS.0, "sigma", SIGMAS.1),
        act: Act::Hand(|tables, occurrence| runs(tables, occurrence, 3)),
    },
];

fn readings(tables: &mut Tables<'_>, occurrence: &mut Occurrence, count: usize) {
    let campaign = &mut *tables.campaign;
    let k1_v_per_g = campaign.config.instrument.scale_factor_nominal_v_per_g;
    let dial_rad = campaign.config.bench.dial_sigma_arcsec * ARCSEC_RAD;
    for place in occurrence.choose(count, (0..campaign.readings.len()).collect()) {
        let reading = &mut campaign.readings[place];
        let angle_deg = reading.dial_deg + reading.mount_deg;
        let turned_g = reading.series.tangent(angle_deg.to_radians()).i;
        let sigma_v = reading.sigma_v.hypot(k1_v_per_g * dial_rad * turned_g);
        reading.output_v += occurrence.signed_size() * sigma_v;
        occurrence.touch(File::Static, place);
    }
}

fn runs(tables: &mut Tables<'_>, occurrence: &mut Occurrence, count: usize) {
    let runs = &mut tables.campaign.runs;
    for place in occurrence.choose(count, (0..runs.len()).collect()) {
        let error = occurrence.signed_size();
        let plateau = occurrence.stream.index(3);
        let Some(measured) = &mut runs[place].measured else {
            continue;
        };
        let error_v = error * measured.sigma_v;
        match (plateau, &mut measured.after_v) {
            (0, _) => measured.before_v += error_v,
            (1, Some(after_v)) => *after_v += error_v,
            _ => measured.during_v += error_v,
        }
        occurrence.touch(File::Vibration, place);
    }
}
