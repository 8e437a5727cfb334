//! What a vibration whose level changes with time adds to the velocity.

use serde::Serialize;
use shared::identify::static_test::Fit;
use shared::model::NOMINAL;

use super::{G_M_S2, Vibration};
use crate::campaign::MissionPoint;
use crate::quantity::Quantity;

/// Of a whole mission.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MissionError {
    /// Length, s.
    pub duration_s: f64,
    /// Highest level, g rms of all axes together.
    pub highest_level_g: f64,
    /// Vibration error at the highest level, g.
    pub vre_at_highest_g: Quantity,
    /// Mean vibration error over the mission, g.
    pub mean_vre_g: Quantity,
    /// What it adds to the velocity, m/s.
    pub velocity_m_per_s: Quantity,
}

/// Steps of a stretch between two points.
const STEPS: usize = 16;

/// The errors of a mission: the vibration is scaled to the level at each time. The velocity's uncertainty is that of the
/// coefficients, which are the same all the time, and what k2 makes of the scatter of a finite stretch's mean square on IA: over a
/// time T its variance is the integral of the squared density over T.
pub fn mission(
    vibration: &Vibration,
    points: &[MissionPoint],
    a0_i_g: f64,
    fit: &Fit<f64>,
) -> MissionError {
    let rms_g = vibration.total_rms_g();
    let at = |level_g: f64| vibration.scaled(level_g / rms_g);
    // The error is linear in the coefficients: so is its integral, with the integrals of its derivatives.
    let mut integral = [0.0; NOMINAL];
    let mut fluctuation = 0.0;
    for pair in points.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let step_s = (to.time_s - from.time_s) / STEPS as f64;
        for step in 0..=STEPS {
            let share = step as f64 / STEPS as f64;
            let level_g = from.level_g + share * (to.level_g - from.level_g);
            if level_g == 0.0 {
                continue;
            }
            let weight_s = step_s / 3.0 * simpson(step);
            let scaled = at(level_g);
            let sensitivity = scaled.sensitivity(a0_i_g);
            for (sum, part) in integral.iter_mut().zip(sensitivity.nominal) {
                *sum += weight_s * part;
            }
            let slope = fit.coefficients.second_order_per_g;
            fluctuation += weight_s * slope * slope * scaled.density_square_g4_per_hz;
        }
    }
    let duration_s = points
        .first()
        .zip(points.last())
        .map_or(0.0, |(first, last)| last.time_s - first.time_s);
    let coefficients = fit.coefficients.to_nominal();
    let velocity: f64 = integral.iter().zip(coefficients).map(|(s, c)| s * c).sum();
    let quadratic = |row: usize| -> f64 {
        let columns = integral.iter().zip(fit.covariance[row]);
        integral[row] * columns.map(|(s, c)| s * c).sum::<f64>()
    };
    let variance = (0..NOMINAL).map(quadratic).sum::<f64>().max(0.0) + fluctuation;
    let total = Quantity::new(velocity, variance.sqrt());
    let highest_level_g = points.iter().map(|point| point.level_g).fold(0.0, f64::max);
    MissionError {
        duration_s,
        highest_level_g,
        vre_at_highest_g: super::vre_g(&at(highest_level_g), a0_i_g, fit),
        mean_vre_g: total.scaled(duration_s.recip()),
        velocity_m_per_s: total.scaled(G_M_S2),
    }
}

fn simpson(step: usize) -> f64 {
    match step {
        0 | STEPS => 1.0,
        odd if odd % 2 == 1 => 4.0,
        _ => 2.0,
    }
}
