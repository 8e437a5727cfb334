//! The instrument under test: a pendulous accelerometer that obeys the output model (1), point by point.

use shared::model::{Coefficients, NOMINAL};

use super::noise::Seed;

/// Half-widths of the uniform distributions that the coefficients of a bench's instrument are drawn from, in
/// the order of [`Coefficients::from_nominal`]: K1 relative to its nominal value, then g, 1, 1/g, 1/g^2,
/// 1/g^3, rad, rad, 1/g, 1/g, 1/g. Sizes of the paper's Table 1.
pub const SPREAD: [f64; NOMINAL] = [
    0.05, 3e-4, 9e-4, 5e-4, 6e-4, 5e-5, 9e-4, 9e-4, 5e-5, 5e-5, 5e-5,
];

/// An instrument as it left the works: what its data sheet says and what it really is.
#[derive(Clone, Debug, PartialEq)]
pub struct Accelerometer {
    /// Scale factor of the type, V/g.
    pub scale_factor_nominal_v_per_g: f64,
    /// Its own coefficients, the truth of a simulated campaign.
    pub coefficients: Coefficients<f64>,
}

impl Accelerometer {
    /// The instrument that belongs to a seed.
    pub fn draw(seed: Seed) -> Self {
        let mut stream = seed.stream("accelerometer", 0);
        let scale_factor_nominal_v_per_g = 0.8 + 0.1 * stream.index(9) as f64;
        let mut drawn = SPREAD.map(|half_width| stream.uniform(-half_width, half_width));
        drawn[0] = scale_factor_nominal_v_per_g * (1.0 + drawn[0]);
        Self {
            scale_factor_nominal_v_per_g,
            coefficients: Coefficients::from_nominal(drawn),
        }
    }
}
