//! What the instrument's inner motion and its servo loop add.

use inference::model::Fidelity;

use super::identity::Stage;
use super::{Action, Effect, even, linear, logarithmic};
use crate::campaign::VibrationKind;
use crate::forward::conditions::{Conditions, Witnesses};
use crate::forward::contribution::{Contribution, Observable};
use crate::forward::rows::RunConditions;

pub(super) const EFFECTS: &[Effect] = &[
    // A loop whose gain falls as 1/f leaves the deflection theta = (i x)/(1 + i x) w_I, x = f/fc, and a pick-off that
    // is not straight adds b theta^2: b m2 x^2/(1 + x^2).
    Effect {
        id: "loop-bandwidth",
        stage: Stage::InstrumentDynamics,
        says: "the servo loop cannot follow fast vibration, and the motion that is left rectifies",
        parameters: &[
            linear("b_per_g", 1e-3),
            logarithmic("fc_hz", 30.0, 6000.0, 16),
        ],
        action: Action::Adds(|p, s, _, _, changes| {
            filtered(s, &mut changes[0], [0, 0], |f| {
                let x2 = (f / p[1]).powi(2);
                x2 / (1.0 + x2)
            });
        }),
        report: None,
    },
    // The arm turned by theta = w_I/(1 + i f/fn) has a component along PA's force: M[theta w_P], of which only the part
    // in phase, 1/(1 + (f/fn)^2), does not average out.
    Effect {
        id: "vibropendulous",
        stage: Stage::InstrumentDynamics,
        says: "the proof mass deflects and picks up vibration along the pendulous axis",
        parameters: &[
            linear("k_per_g", 3e-4),
            logarithmic("fn_hz", 30.0, 6000.0, 16),
        ],
        action: Action::Adds(|p, s, _, _, changes| {
            filtered(s, &mut changes[0], [0, 1], |f| {
                1.0 / (1.0 + (f / p[1]).powi(2))
            });
        }),
        report: None,
    },
    // M[clip(u)] - M[u] with u = a + its nominal error, clip to [-L + c, L + c].
    Effect {
        id: "saturation",
        stage: Stage::InstrumentDynamics,
        says: "the output cannot exceed a limit and is clipped",
        parameters: &[
            logarithmic("limit_g", 1.0, 14.0, 24),
            even("offset_g", -2.0, 2.0, 5),
        ],
        action: Action::Adds(saturate),
        report: None,
    },
];

/// Adds M[w_j w_k] as weighted by a response over frequency.
fn filtered(
    s: &Conditions,
    change: &mut Contribution,
    axes: [usize; 2],
    response: impl Fn(f64) -> f64,
) {
    let means = s.bands.means(response);
    for (row, (run, motion)) in s.runs.iter().zip(&s.motions).enumerate() {
        let square = motion.amplitude_g[axes[0]] * motion.amplitude_g[axes[1]];
        let square = if run.kind == VibrationKind::Sine {
            0.5 * square
        } else {
            square
        };
        if square == 0.0 {
            continue;
        }
        let mean = means[row];
        change.add(Observable::During, row, square * mean.value);
        change.variance_g2[row] += square * square * mean.variance;
    }
}

/// Relative difference of two records' ends below which they are the same, by chance in a few of a hundred campaigns: half
/// of what the peak detector may be off.
fn alike(s: &Conditions) -> f64 {
    0.5 * s.peak_rel_error
}

/// The greatest and the least output of all runs, g, each if two random records or more end there.
fn common_ends(s: &Conditions, seen: &Witnesses) -> [Option<f64>; 2] {
    let end = |sign: f64| {
        let outward = |(run, extremes_g): (&RunConditions, &Option<[f64; 2]>)| {
            let [least, most] = (*extremes_g)?;
            Some((run.kind, sign * if sign > 0.0 { most } else { least }))
        };
        let runs = s.runs.iter().zip(&seen.extremes_g);
        let ends: Vec<(VibrationKind, f64)> = runs.filter_map(outward).collect();
        let end = ends.iter().map(|e| e.1).fold(f64::NEG_INFINITY, f64::max);
        let there = |&&(kind, outward): &&(VibrationKind, f64)| {
            kind == VibrationKind::Random && outward > end - alike(s) * end.abs()
        };
        (ends.iter().filter(there).count() > 1).then_some(sign * end)
    };
    [end(1.0), end(-1.0)]
}

/// By how much the least and the greatest output of a random record must change to be at the limits, g. A limit inside them is
/// none; where several records end alike, it is not outside either.
fn beyond(
    [least, most]: [f64; 2],
    [low, high]: [f64; 2],
    [common_most, common_least]: [Option<f64>; 2],
    alike: f64,
) -> [f64; 2] {
    let there = |end: Option<f64>, extreme: f64| {
        end.is_some_and(|end| (extreme - end).abs() < alike * end.abs())
    };
    let (below, above) = (low - least, high - most);
    [
        match there(common_least, least) {
            true => below,
            false => below.max(0.0),
        },
        match there(common_most, most) {
            true => above,
            false => above.min(0.0),
        },
    ]
}

/// In units of the amplitude, where the output reaches an end: by steps from where the force does, since the model's error is small.
fn reached(
    end_g: f64,
    a0: [f64; 3],
    amplitude_g: [f64; 3],
    output: impl Fn([f64; 3]) -> f64,
) -> f64 {
    let at = |w: f64| std::array::from_fn(|axis| a0[axis] + w * amplitude_g[axis]);
    let linear = (end_g - a0[0]) / amplitude_g[0];
    if !linear.is_finite() || linear.abs() > 8.0 {
        return linear;
    }
    (0..3).fold(linear, |w, _| w + (end_g - output(at(w))) / amplitude_g[0])
}

fn saturate(
    p: &[f64],
    s: &Conditions,
    seen: &Witnesses,
    fidelity: Fidelity,
    changes: &mut [Contribution],
) {
    let change = &mut changes[0];
    let (low, high) = (p[1] - p[0], p[1] + p[0]);
    // What is added is output over the scale factor that outputs are divided by; limits are of what the instrument feels.
    let k1 = s.coefficients.scale_factor_v_per_g;
    // The starts of a search are too far apart for what is known so well.
    let ends = match fidelity {
        Fidelity::Screening => [None; 2],
        Fidelity::Full => common_ends(s, seen),
    };
    let output = |a: [f64; 3]| {
        let force = shared::model::SpecificForce::new(a[0], a[1], a[2]);
        s.coefficients.output_g(force)
    };
    // The model's own error moves the edge of clipping; far from the edges it need not be known.
    let far = |least: f64, most: f64| least > low + 0.2 && most < high - 0.2;
    let lost = |a: [f64; 3]| {
        if far(a[0], a[0]) {
            return 0.0;
        }
        let u = output(a);
        k1 * (u.clamp(low, high) - u)
    };
    for (row, reading) in s.readings.iter().enumerate() {
        let a = reading.specific_force_g;
        change.add(Observable::Static, row, lost([a.i, a.p, a.o]));
    }
    for (row, (run, motion)) in s.runs.iter().zip(&s.motions).enumerate() {
        let a0 = [
            run.specific_force_g.i,
            run.specific_force_g.p,
            run.specific_force_g.o,
        ];
        let rest = lost(a0);
        change.add(Observable::Before, row, rest);
        change.add(Observable::After, row, rest);
        let swing = motion.amplitude_g[0].abs();
        let reach = if run.kind == VibrationKind::Sine {
            swing * (1.0 + motion.second_harmonic.abs())
        } else {
            7.0 * swing
        };
        if let (VibrationKind::Random, Some(extremes_g)) = (run.kind, seen.extremes_g[row]) {
            let [least, most] = beyond(extremes_g, [k1 * low, k1 * high], ends, alike(s));
            change.add(Observable::Maximum, row, most);
            change.add(Observable::Minimum, row, least);
        }
        if far(a0[0] - reach, a0[0] + reach) {
            continue;
        }
        let edge = |end: f64| reached(end, a0, motion.amplitude_g, output);
        let edges = [edge(low), edge(high)];
        let mean = s.averages.mean(run, motion, &edges, fidelity, lost);
        change.add(Observable::During, row, mean.value);
        change.variance_g2[row] += mean.variance;
        if run.kind == VibrationKind::Sine {
            let at = |multiple: f64| {
                lost(std::array::from_fn(|axis| {
                    a0[axis] + multiple * motion.amplitude_g[axis]
                }))
            };
            let [most, least] = motion.extremes();
            change.add(Observable::Maximum, row, at(most));
            change.add(Observable::Minimum, row, at(least));
        }
    }
}
