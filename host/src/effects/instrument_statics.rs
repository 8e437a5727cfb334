//! Terms of the instrument's characteristic that (1) lacks: functions of the present specific force.

use inference::model::Fidelity;

use super::identity::Stage;
use super::{Action, Effect, linear};
use crate::campaign::VibrationKind;
use crate::forward::conditions::Conditions;
use crate::forward::contribution::{Contribution, Observable};

/// Specific force on IA below which the dial cannot tell its sign, g.
const DEAD_BAND_G: f64 = 1e-3;

pub(super) const EFFECTS: &[Effect] = &[
    Effect {
        id: "bias-asymmetry",
        stage: Stage::InstrumentStatics,
        says: "the bias changes with the sign of the acceleration",
        parameters: &[linear("K0_prime_g", 2e-4)],
        action: Action::Adds(|_, s, _, fidelity, c| {
            term(s, fidelity, &mut c[0], true, |a| {
                if a[0].abs() < DEAD_BAND_G {
                    0.0
                } else {
                    a[0].signum()
                }
            });
        }),
        report: None,
    },
    Effect {
        id: "odd-quadratic",
        stage: Stage::InstrumentStatics,
        says: "a second-order term that keeps the sign, a|a|",
        parameters: &[linear("Koq_per_g", 3e-4)],
        action: Action::Adds(|_, s, _, fidelity, c| {
            term(s, fidelity, &mut c[0], true, |a| a[0] * a[0].abs())
        }),
        report: None,
    },
    Effect {
        id: "quintic",
        stage: Stage::InstrumentStatics,
        says: "a nonlinearity of the fifth order",
        parameters: &[linear("k5_per_g4", 1e-5)],
        action: Action::Adds(|_, s, _, fidelity, c| {
            term(s, fidelity, &mut c[0], false, |a| a[0].powi(5))
        }),
        report: None,
    },
    Effect {
        id: "sextic",
        stage: Stage::InstrumentStatics,
        says: "a nonlinearity of the sixth order",
        parameters: &[linear("k6_per_g5", 2e-6)],
        action: Action::Adds(|_, s, _, fidelity, c| {
            term(s, fidelity, &mut c[0], false, |a| a[0].powi(6))
        }),
        report: None,
    },
    Effect {
        id: "cross-axis-squares",
        stage: Stage::InstrumentStatics,
        says: "the output answers to the square of acceleration across the input axis",
        parameters: &[linear("Kpp_per_g", 2e-4), linear("Koo_per_g", 2e-4)],
        action: Action::Adds(|_, s, _, fidelity, c| {
            for (axis, change) in c.iter_mut().enumerate() {
                term(s, fidelity, change, false, |a| a[1 + axis] * a[1 + axis]);
            }
        }),
        report: None,
    },
];

/// Adds a function of the specific force: at each dial position, at rest before and after a run, its time mean during
/// the run, and its value at the extremes of a sine.
/// `kinked` if it, or its slope, jumps where IA feels nothing.
fn term(
    s: &Conditions,
    fidelity: Fidelity,
    change: &mut Contribution,
    kinked: bool,
    function: impl Fn([f64; 3]) -> f64,
) {
    for (row, reading) in s.readings.iter().enumerate() {
        let a = reading.specific_force_g;
        change.add(Observable::Static, row, function([a.i, a.p, a.o]));
    }
    for (row, (run, motion)) in s.runs.iter().zip(&s.motions).enumerate() {
        let a0 = run.specific_force_g;
        let a0 = [a0.i, a0.p, a0.o];
        let at_rest = function(a0);
        change.add(Observable::Before, row, at_rest);
        change.add(Observable::After, row, at_rest);
        let kinks = [motion.zero(a0[0])];
        let kinks = if kinked { &kinks[..] } else { &[] };
        let mean = s.averages.mean(run, motion, kinks, fidelity, &function);
        change.add(Observable::During, row, mean.value);
        change.variance_g2[row] += mean.variance;
        if run.kind == VibrationKind::Sine {
            let at = |multiple: f64| {
                function(std::array::from_fn(|axis| {
                    a0[axis] + multiple * motion.amplitude_g[axis]
                }))
            };
            let [most, least] = motion.extremes();
            change.add(Observable::Maximum, row, at(most));
            change.add(Observable::Minimum, row, at(least));
        }
    }
}
