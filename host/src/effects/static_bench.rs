//! The dividing head and its base.

use super::identity::Stage;
use super::{Action, Effect, linear, on_dial};
use shared::tumble::ARCSEC_RAD;

pub(super) const EFFECTS: &[Effect] = &[
    // An angle error e(dial) moves a_I by its derivative, the tangent, times e.
    Effect {
        id: "dial-index-error",
        stage: Stage::StaticBench,
        says: "the dial's circle is off centre or out of round",
        parameters: &[
            linear("e1s_arcsec", 40.0),
            linear("e1c_arcsec", 40.0),
            linear("e2s_arcsec", 40.0),
            linear("e2c_arcsec", 40.0),
        ],
        action: Action::Adds(|_, s, _, _, changes| {
            on_dial(s, changes, |reading| {
                let (sin, cos) = reading.dial_deg.to_radians().sin_cos();
                [sin, cos, 2.0 * sin * cos, (cos - sin) * (cos + sin)]
                    .map(|error| ARCSEC_RAD * error * reading.tangent)
            });
        }),
        report: None,
    },
    Effect {
        id: "base-tilt",
        stage: Stage::StaticBench,
        says: "the base of the dividing head is out of level",
        parameters: &[linear("zero_arcsec", 60.0), linear("axis_arcsec", 60.0)],
        action: Action::Adds(|_, s, _, _, changes| {
            on_dial(s, changes, |reading| {
                [reading.tangent, reading.series.lift::<f64>().i].map(|moved| ARCSEC_RAD * moved)
            });
        }),
        report: None,
    },
];
