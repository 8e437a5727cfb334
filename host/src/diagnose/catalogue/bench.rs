//! The dividing head and its base.

use super::{Action, Effect, Stage, linear};
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
        action: Action::Adds(|_, k, s, change| {
            on_dial(s, change, |reading| {
                let angle = reading.dial_deg.to_radians();
                let error = [
                    angle.sin(),
                    angle.cos(),
                    (2.0 * angle).sin(),
                    (2.0 * angle).cos(),
                ][k];
                ARCSEC_RAD * error * tangent(reading)
            });
        }),
        report: None,
    },
    Effect {
        id: "base-tilt",
        stage: Stage::StaticBench,
        says: "the base of the dividing head is out of level",
        parameters: &[linear("zero_arcsec", 60.0), linear("axis_arcsec", 60.0)],
        action: Action::Adds(|_, k, s, change| {
            on_dial(s, change, |reading| {
                ARCSEC_RAD
                    * if k == 0 {
                        tangent(reading)
                    } else {
                        reading.series.lift::<f64>().i
                    }
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
        action: Action::Adds(|_, _, s, change| {
            on_dial(s, change, |reading| {
                match (reading.series, reading.approach) {
                    (Series::InputAxis, _) => 0.0,
                    (_, Approach::CounterClockwise) => tangent(reading),
                    (_, Approach::Clockwise) => -tangent(reading),
                }
            });
        }),
        report: None,
    },
];

fn on_dial(s: &Situation<'_>, change: &mut Change, value: impl Fn(&Reading) -> f64) {
    for (row, reading) in s.readings.iter().enumerate() {
        change.add(Block::Static, row, s.gravity_g * value(reading));
    }
}

/// Derivative of a_I by the dial's angle, in units of gravity.
fn tangent(reading: &Reading) -> f64 {
    reading.series.tangent(position(reading).phi_rad()).i
}
