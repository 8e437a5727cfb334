//! What makes an instrument compensate, from coefficients that identification or a diagnosis found.

use shared::compensate::{self, Mode, Source};
use shared::wire::configuration::{Calibration, Compensation, Configuration};
use shared::wire::message;

use crate::front_end::FrontEnd;

/// Compensation with these coefficients, in blocks of that many conversions. The instrument counts in volts at the
/// converter, so that K1 (V/g at its output) is taken through the front end. `reference_v_per_g` is the reference's scale
/// at the converter; its zero is taken as 0 V.
/// What cannot be, as K1 <= 0, the instrument refuses.
pub fn configuration(
    known: &compensate::Calibration<f64>,
    front_end: &FrontEnd,
    reference_v_per_g: f64,
    mode: Mode,
    source: Source,
    block_samples: u16,
) -> Configuration {
    let mut nominal = known.coefficients.to_nominal();
    nominal[0] = front_end.converter_v(nominal[0]);
    Configuration {
        compensation: Compensation {
            mode: Some(mode),
            source,
            block_samples,
            nominal_v_per_g: nominal[0] as f32,
            reference_v_per_g: [reference_v_per_g as f32; 3],
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
