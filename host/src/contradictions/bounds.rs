//! Gravity's length against local gravity, and levels against the full scale.

use super::robust::{FEWEST, common_factor, median, near};
use super::{Contradiction, LEVEL, likely, runs};
use crate::campaign::Campaign;

/// Factor by which the length of gravity on the three axes may differ from local gravity: a plumb attitude typed with two
/// decimals is within 1 %.
const GRAVITY_OFF: f64 = 1.05;

/// Full scales up to which a test of an overrange is meant.
const BEYOND: f64 = 1.5;

/// Standard acceleration, m/s^2 (ISO 80000-3).
const STANDARD_GRAVITY: f64 = 9.80665;

const COLUMNS: [&str; 2] = ["a0_*_g", "local_gravity_g"];

/// Runs in whose rows gravity is not as long as it is.
pub(super) fn gravity(campaign: &Campaign) -> Vec<Contradiction> {
    let local_g = campaign.config.bench.local_gravity_g;
    let factors: Vec<(usize, f64)> = runs(campaign)
        .map(|(place, run)| (place, run.specific_force_g.length() / local_g))
        .collect();
    let all: Vec<f64> = factors.iter().map(|(_, factor)| *factor).collect();
    let common = common_factor(&all, GRAVITY_OFF - 1.0).unwrap_or(1.0);
    let mut found = Vec::new();
    if !near(common, 1.0, GRAVITY_OFF - 1.0) {
        found.push(Contradiction::all(COLUMNS, common, "all runs", why(common)));
    }
    for (place, factor) in factors {
        if !near(factor, common, GRAVITY_OFF - 1.0) {
            let places = [place];
            found.push(Contradiction::some(
                campaign,
                COLUMNS,
                factor,
                &places,
                why(factor),
            ));
        }
    }
    found
}

fn why(factor: f64) -> String {
    match near(factor, STANDARD_GRAVITY, 0.01) {
        true => format!("m/s^2 entered for g in {}", COLUMNS[0]),
        false => format!("a component of {} is wrong or in another unit", COLUMNS[0]),
    }
}

/// Levels that are all beyond the full scale.
pub(super) fn full_scale(campaign: &Campaign) -> Option<Contradiction> {
    let full_scale_g = campaign.config.instrument.full_scale_g;
    let over = |run: &crate::campaign::Run| {
        let along_g = (run.direction[0] * run.level_g).abs() + run.specific_force_g.i.abs();
        along_g / full_scale_g
    };
    let factors: Vec<f64> = runs(campaign).map(|(_, run)| over(run)).collect();
    if factors.len() < FEWEST || factors.iter().any(|factor| *factor <= BEYOND) {
        return None;
    }
    let factor = likely::typed(median(factors)?);
    let likely = format!("{LEVEL} or full_scale_g is in another unit");
    Some(Contradiction::all(
        [LEVEL, "full_scale_g"],
        factor,
        "all runs",
        likely,
    ))
}
