//! Middles that a few wrong rows do not move.

use crate::campaign::Campaign;
pub(super) use crate::median::median;

/// Fewest values of which a few may be wrong.
pub(super) const FEWEST: usize = 3;

/// Share of values that must be alike to speak for all.
const ALIKE: f64 = 0.8;

/// The median of positive factors if [`ALIKE`] of them are within the relative `tolerance` of it, and there are
/// [`FEWEST`].
pub(super) fn common_factor(factors: &[f64], tolerance: f64) -> Option<f64> {
    let middle = median(factors.to_vec()).filter(|_| factors.len() >= FEWEST)?;
    let alike = factors
        .iter()
        .filter(|factor| near(**factor, middle, tolerance));
    (alike.count() as f64 >= ALIKE * factors.len() as f64).then_some(middle)
}

/// Whether two positive factors differ by no more than the relative `tolerance`.
pub(super) fn near(one: f64, other: f64, tolerance: f64) -> bool {
    distance(one, other) <= tolerance.ln_1p()
}

/// |ln(one / other)|.
pub(super) fn distance(one: f64, other: f64) -> f64 {
    (one / other).ln().abs()
}

/// Least specific force on IA at which output over force is the scale factor within a bias of some milli-g, g.
const FORCE_G: f64 = 0.5;

/// Scale factor of the runs, V/g: the median of output over specific force, of the plateaus before the runs where gravity is
/// on IA, else of the static readings, else the nominal one.
pub(super) fn scale_v_per_g(campaign: &Campaign) -> f64 {
    let over =
        |force_g: f64, output_v: f64| (force_g.abs() >= FORCE_G).then_some(output_v / force_g);
    let runs = campaign.runs.iter().filter(|run| !run.exclude);
    let of_runs = runs.filter_map(|run| over(run.specific_force_g.i, run.measured?.before_v));
    let readings = campaign.readings.iter().filter(|reading| !reading.exclude);
    let of_readings =
        readings.filter_map(|reading| over(reading.specific_force_g.i, reading.output_v));
    median(of_runs.collect())
        .or_else(|| median(of_readings.collect()))
        .unwrap_or(campaign.config.instrument.scale_factor_nominal_v_per_g)
}
