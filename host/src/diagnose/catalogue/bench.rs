//! The dividing head and its base.

use super::{Action, Effect, Stage, add_each, linear};
use crate::campaign::{Approach, Reading, Series};
use crate::diagnose::problem::{ARCSEC_RAD, Block, Change, Situation};
use crate::identification::position;

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
        action: Action::Adds(|_, s, changes| {
            on_dial(s, changes, |reading| {
                let (sin, cos) = reading.dial_deg.to_radians().sin_cos();
                [sin, cos, 2.0 * sin * cos, (cos - sin) * (cos + sin)]
                    .map(|error| ARCSEC_RAD * error * tangent(reading))
            });
        }),
        report: None,
    },
    Effect {
        id: "base-tilt",
        stage: Stage::StaticBench,
        says: "the base of the dividing head is out of level",
        parameters: &[linear("zero_arcsec", 60.0), linear("axis_arcsec", 60.0)],
        action: Action::Adds(|_, s, changes| {
            on_dial(s, changes, |reading| {
                [tangent(reading), reading.series.lift::<f64>().i].map(|moved| ARCSEC_RAD * moved)
            });
        }),
        report: None,
    },
    // Backlash turns the instrument by +-h behind the approach; none about the input axis.
    Effect {
        id: "hysteresis",
        stage: Stage::Environment,
        says: "the reading depends on the sense in which the dial came to its mark",
        parameters: &[linear("h_g", 3e-5)],
        action: Action::Adds(|_, s, changes| {
            on_dial(s, changes, |reading| {
                [match (reading.series, reading.approach) {
                    (Series::InputAxis, _) => 0.0,
                    (_, Approach::CounterClockwise) => tangent(reading),
                    (_, Approach::Clockwise) => -tangent(reading),
                }]
            });
        }),
        report: None,
    },
];

fn on_dial<const N: usize>(
    s: &Situation<'_>,
    changes: &mut [Change],
    values: impl Fn(&Reading) -> [f64; N],
) {
    for (row, reading) in s.readings.iter().enumerate() {
        let values = values(reading).map(|value| s.gravity_g * value);
        add_each(changes, Block::Static, row, values);
    }
}

/// Derivative of a_I by the dial's angle, in units of gravity.
fn tangent(reading: &Reading) -> f64 {
    reading.series.tangent(position(reading).phi_rad()).i
}
