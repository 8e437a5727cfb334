//! Temperature, time and what the instrument has been through.

use inference::model::Fidelity;

use super::identity::Stage;
use super::{Action, Effect, even, linear, logarithmic, on_dial, stepped};
use crate::campaign::{Approach, BEFORE_TO_AFTER_S, BEFORE_TO_DURING_S, Series, VibrationKind};
use crate::forward::conditions::{Conditions, Witnesses};
use crate::forward::contribution::{Contribution, Observable};

pub(super) const EFFECTS: &[Effect] = &[
    Effect {
        id: "thermal-bias",
        stage: Stage::Environment,
        says: "the bias follows the temperature",
        parameters: &[linear("g_per_k", 1e-5)],
        action: Action::Adds(|_, s, _, _, changes| {
            let change = &mut changes[0];
            for (row, reading) in s.readings.iter().enumerate() {
                change.add(Observable::Static, row, reading.temp_c - s.reference_temp_c);
            }
            for (row, run) in s.runs.iter().enumerate() {
                let excess_k = run.temp_c - s.reference_temp_c;
                for block in [Observable::Before, Observable::During, Observable::After] {
                    change.add(block, row, excess_k);
                }
            }
        }),
        report: None,
    },
    Effect {
        id: "thermal-scale",
        stage: Stage::Environment,
        says: "the scale factor follows the temperature",
        parameters: &[linear("per_k", 1e-5)],
        action: Action::Adds(|_, s, _, _, changes| {
            let change = &mut changes[0];
            for (row, reading) in s.readings.iter().enumerate() {
                let excess_k = reading.temp_c - s.reference_temp_c;
                change.add(
                    Observable::Static,
                    row,
                    excess_k * reading.specific_force_g.i,
                );
            }
            for (row, (run, motion)) in s.runs.iter().zip(&s.motions).enumerate() {
                let excess_k = run.temp_c - s.reference_temp_c;
                let a0 = run.specific_force_g.i;
                for block in [Observable::Before, Observable::During, Observable::After] {
                    change.add(block, row, excess_k * a0);
                }
                if run.kind == VibrationKind::Sine {
                    let [most, least] = motion.extremes().map(|w| w * motion.amplitude_g[0]);
                    change.add(Observable::Maximum, row, excess_k * (a0 + most));
                    change.add(Observable::Minimum, row, excess_k * (a0 + least));
                }
            }
        }),
        report: None,
    },
    Effect {
        id: "drift",
        stage: Stage::Environment,
        says: "the bias drifts with time",
        parameters: &[linear("g_per_s", 5e-9)],
        action: Action::Adds(|_, s, _, _, changes| {
            let change = &mut changes[0];
            for (row, reading) in s.readings.iter().enumerate() {
                change.add(Observable::Static, row, reading.time_s);
            }
            for (row, run) in s.runs.iter().enumerate() {
                change.add(Observable::Before, row, run.time_s);
                change.add(Observable::During, row, run.time_s + BEFORE_TO_DURING_S);
                change.add(Observable::After, row, run.time_s + BEFORE_TO_AFTER_S);
                change.add(Observable::Drift, row, 1.0);
            }
        }),
        report: None,
    },
    // tau x' = c P - x: a run of power P and length T, begun at s, has warmed the instrument by
    // c P (1 - exp(-(t - s)/tau)) at t and by c P (1 - exp(-T/tau)) exp(-(t - s - T)/tau) after it.
    Effect {
        id: "self-heating",
        stage: Stage::Environment,
        says: "vibration warms the instrument, which shifts its bias for a while",
        parameters: &[
            linear("c_per_g", 2e-5),
            logarithmic("tau_s", 0.5, 300.0, 14),
            // Length of the plateaus before and after; campaigns state that of the one during a run alone.
            even("_plateau_s", 0.0, 10.0, 2),
        ],
        action: Action::Adds(self_heating),
        report: None,
    },
    Effect {
        id: "bias-memory",
        stage: Stage::Environment,
        says: "strong runs leave a lasting step in the bias",
        parameters: &[
            linear("step_g", 1e-5),
            // By which factor each step is smaller than the one before it.
            even("_memory", 0.4, 1.05, 6),
            // How much of it the ends of the vibration show.
            even("_within", 0.0, 1.5, 1),
            stepped("threshold_g", 0.2, 8.0, 40),
        ],
        action: Action::Adds(bias_memory),
        report: None,
    },
    // Backlash turns the instrument by +-h behind the approach; none about the input axis.
    Effect {
        id: "hysteresis",
        stage: Stage::Environment,
        says: "the reading depends on the sense in which the dial came to its mark: backlash",
        parameters: &[linear("h_g", 3e-5)],
        action: Action::Adds(|_, s, _, _, changes| {
            on_dial(s, changes, |reading| {
                [match (reading.series, reading.approach) {
                    (Series::InputAxis, _) => 0.0,
                    (_, Approach::CounterClockwise) => reading.tangent,
                    (_, Approach::Clockwise) => -reading.tangent,
                }]
            });
        }),
        report: None,
    },
];

fn self_heating(
    p: &[f64],
    s: &Conditions,
    _: &Witnesses,
    _: Fidelity,
    changes: &mut [Contribution],
) {
    let change = &mut changes[0];
    let tau = p[1];
    // Mean of exp(-t/tau) over a plateau of a given length centred at t.
    let decay = |t: f64, length: f64| {
        let x = 0.5 * length / tau;
        (-t / tau).exp() * if x > 1e-4 { x.sinh() / x } else { 1.0 }
    };
    let mut warmth = 0.0; // at the end of the last run
    let mut end_s = f64::NEG_INFINITY;
    for (row, run) in s.runs.iter().enumerate() {
        let length = run.duration_s;
        let plateau = p[2];
        let left = |t: f64| {
            if warmth == 0.0 {
                0.0
            } else {
                warmth * decay(t - end_s, plateau)
            }
        };
        let during_s = run.time_s + BEFORE_TO_DURING_S;
        change.add(Observable::Before, row, left(run.time_s));
        let full = run.mean_square_g2();
        let risen = full * -(-length / tau).exp_m1();
        let mean = full - risen * tau / length;
        change.add(Observable::During, row, left(during_s) + mean);
        let start_s = during_s - 0.5 * length;
        let (old_start, old_end) = (
            left_at(warmth, start_s - end_s, tau),
            left_at(warmth, start_s + length - end_s, tau),
        );
        change.add(
            Observable::Drift,
            row,
            (risen + old_end - old_start) / length,
        );
        warmth = risen + old_end;
        end_s = start_s + length;
        change.add(
            Observable::After,
            row,
            warmth * decay(run.time_s + BEFORE_TO_AFTER_S - end_s, plateau),
        );
    }
}

fn left_at(warmth: f64, after_s: f64, tau_s: f64) -> f64 {
    if warmth == 0.0 {
        0.0
    } else {
        warmth * (-after_s / tau_s).exp()
    }
}

fn bias_memory(
    p: &[f64],
    s: &Conditions,
    _: &Witnesses,
    _: Fidelity,
    changes: &mut [Contribution],
) {
    let change = &mut changes[0];
    let (mut level, mut step) = (0.0, 1.0);
    for (row, (run, peak_g)) in s.runs.iter().zip(&*s.peaks_g).enumerate() {
        change.add(Observable::Before, row, level);
        let added = if *peak_g > p[3] { step } else { 0.0 };
        change.add(Observable::During, row, level + 0.5 * added);
        change.add(Observable::Drift, row, p[2] * added / run.duration_s);
        level += added;
        change.add(Observable::After, row, level);
        if added > 0.0 {
            step *= p[1];
        }
    }
}
