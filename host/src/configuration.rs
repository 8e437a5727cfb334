//! What makes an instrument compensate, from coefficients that identification or a diagnosis found.

use shared::compensate::{self, Mode, Source};
use shared::wire::configuration::{Calibration, Compensation, Configuration};
use shared::wire::message;

use crate::bench::excitation::FrontEnd;

/// Compensation with these coefficients, in blocks of that many conversions. The instrument counts in volts at the
/// converter: K1 (V/g at the instrument's output) shrinks by the front end's divider. The reference's zero is taken as 0 V.
/// What cannot be, as K1 <= 0, the instrument refuses.
pub fn configuration(
    known: &compensate::Calibration<f64>,
    front_end: &FrontEnd,
    mode: Mode,
    source: Source,
    block_samples: u16,
) -> Configuration {
    let mut nominal = known.coefficients.to_nominal();
    nominal[0] /= front_end.divider;
    Configuration {
        compensation: Compensation {
            mode: Some(mode),
            source,
            block_samples,
            nominal_v_per_g: nominal[0] as f32,
            reference_v_per_g: [front_end.reference_v_per_g as f32; 3],
            reference_zero_v: [0.0; 3],
        },
        calibration: Some(Calibration {
            coefficients: message::Coefficients {
                nominal,
                further: known.coefficients.to_further(),
            },
            covariance: known.covariance.narrow(),
            rank: known.rank,
        }),
    }
}
