//! What the instrument's inner motion and its servo loop add.

use inference::model::Fidelity;
use shared::model::{Coefficients, SpecificForce};

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

/// Relative difference of two records' ends below which they are the same: what the peak detector may be off between the two. Records
/// that were not clipped come so near each other by chance in some of a hundred campaigns, which tells nothing of a limit.
fn alike(s: &Conditions) -> f64 {
    s.peak_rel_error
}

/// The greatest and the least output of all runs, g, each if two random records or more end there.
fn common_ends(s: &Conditions, seen: &Witnesses) -> [Option<f64>; 2] {
    let end = |sign: f64| {
        let outward = |(run, extremes_g): (&RunConditions, &Option<[f64; 2]>)| {
            Some((run.kind, sign * (*extremes_g)?[usize::from(sign > 0.0)]))
        };
        let runs = s.runs.iter().zip(&seen.extremes_g);
        let ends: Vec<(VibrationKind, f64)> = runs.filter_map(outward).collect();
        let end = ends.iter().map(|e| e.1).fold(f64::NEG_INFINITY, f64::max);
        let there = ends.iter().filter(|&&(kind, outward)| {
            kind == VibrationKind::Random && outward > end - alike(s) * end.abs()
        });
        (there.count() > 1).then_some(sign * end)
    };
    [end(1.0), end(-1.0)]
}

/// Whether a random record ends, below and above, where several records do.
fn at_ends(
    [least, most]: [f64; 2],
    [common_most, common_least]: [Option<f64>; 2],
    alike: f64,
) -> [bool; 2] {
    let there = |end: Option<f64>, extreme: f64| {
        end.is_some_and(|end| (extreme - end).abs() < alike * end.abs())
    };
    [there(common_least, least), there(common_most, most)]
}

/// An output that is clipped.
#[derive(Clone, Copy)]
struct Clip<'s> {
    coefficients: &'s Coefficients<f64>,
    /// Limits of what the instrument feels, g.
    low: f64,
    high: f64,
}

impl Clip<'_> {
    /// Output over the scale factor that outputs are divided by, of what the instrument feels.
    fn scaled(&self, felt_g: f64) -> f64 {
        self.coefficients.scale_factor_v_per_g * felt_g
    }

    fn felt_g(&self, [i, p, o]: [f64; 3]) -> f64 {
        self.coefficients.output_g(SpecificForce::new(i, p, o))
    }

    /// Whether a range of forces is within the limits, whatever the model's own error: that moves the edge of clipping.
    fn is_within(&self, least_g: f64, most_g: f64) -> bool {
        least_g > self.low + 0.2 && most_g < self.high - 0.2
    }

    /// Clipped less whole output.
    fn lost(&self, a: [f64; 3]) -> f64 {
        if self.is_within(a[0], a[0]) {
            return 0.0;
        }
        let u = self.felt_g(a);
        self.scaled(u.clamp(self.low, self.high) - u)
    }

    /// In units of the amplitude, where the output reaches an end: by steps from where the force does, since the model's error is
    /// small.
    fn reached(&self, end_g: f64, a0: [f64; 3], amplitude_g: [f64; 3]) -> f64 {
        let at = |w: f64| std::array::from_fn(|axis| a0[axis] + w * amplitude_g[axis]);
        let linear = (end_g - a0[0]) / amplitude_g[0];
        if !linear.is_finite() || linear.abs() > 8.0 {
            return linear;
        }
        (0..3).fold(linear, |w, _| {
            w + (end_g - self.felt_g(at(w))) / amplitude_g[0]
        })
    }

    /// Of a random record with these extremes: by how much they must change to be at the limits. A limit inside them is none; one
    /// outside them does not show in them, unless the record ends where several do.
    fn moves(&self, extremes_g: [f64; 2], at_ends: [bool; 2]) -> [f64; 2] {
        let least = self.scaled(self.low) - extremes_g[0];
        let most = self.scaled(self.high) - extremes_g[1];
        [
            if at_ends[0] { least } else { least.max(0.0) },
            if at_ends[1] { most } else { most.min(0.0) },
        ]
    }

    /// The limits that a record with these extremes can have met: not those that are further out than `near` of them, relatively.
    fn met(&self, extremes_g: [f64; 2], near: f64) -> Self {
        let [least, most] = extremes_g;
        let mut met = *self;
        if self.scaled(self.low) < least - near * least.abs() {
            met.low = f64::NEG_INFINITY;
        }
        if self.scaled(self.high) > most + near * most.abs() {
            met.high = f64::INFINITY;
        }
        met
    }
}

/// In units of what two extremes may differ by, how far beyond its extremes a limit was certainly not met by a record. More than one,
/// so that a search finds its way from a limit that is a little off.
const NOT_MET: f64 = 50.0;

fn saturate(
    p: &[f64],
    s: &Conditions,
    seen: &Witnesses,
    fidelity: Fidelity,
    changes: &mut [Contribution],
) {
    let change = &mut changes[0];
    let clip = Clip {
        coefficients: &s.coefficients,
        low: p[1] - p[0],
        high: p[1] + p[0],
    };
    // The starts of a search are too far apart for what is known so well.
    let ends = (fidelity == Fidelity::Full).then(|| common_ends(s, seen));
    for (row, reading) in s.readings.iter().enumerate() {
        let a = reading.specific_force_g;
        change.add(Observable::Static, row, clip.lost([a.i, a.p, a.o]));
    }
    for (row, (run, motion)) in s.runs.iter().zip(&s.motions).enumerate() {
        let a0 = run.specific_force_g;
        let a0 = [a0.i, a0.p, a0.o];
        let at = |w: f64| std::array::from_fn(|axis| a0[axis] + w * motion.amplitude_g[axis]);
        let rest = clip.lost(a0);
        change.add(Observable::Before, row, rest);
        change.add(Observable::After, row, rest);
        let mut clip = clip;
        if let (VibrationKind::Random, Some(extremes_g), Some(ends)) =
            (run.kind, seen.extremes_g[row], ends)
        {
            let at_ends = at_ends(extremes_g, ends, alike(s));
            let [least, most] = clip.moves(extremes_g, at_ends);
            change.add(Observable::Minimum, row, least);
            change.add(Observable::Maximum, row, most);
            clip = clip.met(extremes_g, NOT_MET * s.peak_rel_error);
        }
        let swing = motion.amplitude_g[0].abs();
        let reach = match run.kind {
            VibrationKind::Sine => swing * (1.0 + motion.second_harmonic.abs()),
            VibrationKind::Random => 7.0 * swing,
        };
        if clip.is_within(a0[0] - reach, a0[0] + reach) {
            continue;
        }
        let edges = [clip.low, clip.high].map(|end| clip.reached(end, a0, motion.amplitude_g));
        let lost = |a| clip.lost(a);
        let mean = s.averages.mean(run, motion, &edges, fidelity, lost);
        change.add(Observable::During, row, mean.value);
        change.variance_g2[row] += mean.variance;
        if run.kind == VibrationKind::Sine {
            let [most, least] = motion.extremes();
            change.add(Observable::Maximum, row, clip.lost(at(most)));
            change.add(Observable::Minimum, row, clip.lost(at(least)));
        }
    }
}
