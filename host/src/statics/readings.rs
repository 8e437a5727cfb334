//! A campaign's static readings in the terms of the identification.

use shared::identify::static_test::Bench;
use shared::tumble::{ARCSEC_RAD, Position};

use crate::campaign;

/// The bench of the campaign in radians.
pub fn bench(bench: &campaign::Bench) -> Bench<f64> {
    let arcsec = |angle: f64| angle * ARCSEC_RAD;
    Bench {
        dial_sigma_rad: arcsec(bench.dial_sigma_arcsec),
        dial_repeat_sigma_rad: arcsec(bench.dial_repeat_sigma_arcsec),
        mount_sigma_rad: arcsec(bench.mount_sigma_arcsec),
        level_sigma_rad: arcsec(bench.level_sigma_arcsec),
        local_gravity_g: bench.local_gravity_g,
    }
}

/// Where on the dividing head a reading was taken.
pub fn position(reading: &campaign::Reading) -> Position {
    Position {
        series: reading.series,
        dial_deg: reading.dial_deg,
        mount_deg: reading.mount_deg,
    }
}
