//! The shaker's table, its drive and its reference.

use super::identity::Stage;
use super::{Action, Effect, Seen, even, linear};
use crate::campaign::VibrationKind;
use crate::forward::conditions::{Conditions, Witnesses, seen_ratios};
use crate::forward::contribution::Observable;
use crate::forward::motion::{Motion, main_axis};

/// Second harmonic from which on a random record's power is taken as the reference saw it.
const LEAST_HARMONIC: f64 = 1e-3;

pub(super) const EFFECTS: &[Effect] = &[
    // The axis of the drive is the one of its largest component; the other two follow it in the order IA, PA, OA, IA.
    Effect {
        id: "shaker-transverse",
        stage: Stage::Shaker,
        says: "the table moves across its drive as well",
        parameters: &[
            even("ratio_next", -1.0, 1.0, 5),
            even("ratio_previous", -1.0, 1.0, 5),
        ],
        action: Action::TransformsMotion(
            |p, s, _, motions| {
                for (run, motion) in s.runs.iter().zip(motions) {
                    let main = main_axis(&run.direction);
                    motion.amplitude_g[(main + 1) % 3] += p[0] * run.level_g;
                    motion.amplitude_g[(main + 2) % 3] += p[1] * run.level_g;
                }
            },
            Seen::ByReference,
        ),
        report: None,
    },
    // A sin x + h2 A (sin^2 x ...) lifts the positive peak: A (sin x - h2 cos 2x). A random record's moments are those
    // that the reference saw; so is the power that the harmonic adds.
    Effect {
        id: "shaker-distortion",
        stage: Stage::Shaker,
        says: "the drive is distorted: not a pure sine, not symmetric noise",
        parameters: &[even("h2", -0.3, 0.3, 5)],
        action: Action::TransformsMotion(distort, Seen::ByReference),
        report: None,
    },
    // The table swings about a point some way off with a rate in proportion to its velocity, w/(2 pi f); the
    // centripetal term is of one sign.
    Effect {
        id: "shaker-rocking",
        stage: Stage::Shaker,
        says: "the table rocks, and the centripetal acceleration of that does not average out",
        parameters: &[linear("r_per_g_hz2", 0.1)],
        action: Action::Adds(|_, s, _, _, changes| {
            let change = &mut changes[0];
            let means = s.bands.means(|f| 1.0 / (f * f));
            for (row, (run, mean)) in s.runs.iter().zip(means).enumerate() {
                let power = run.mean_square_g2();
                change.add(Observable::During, row, power * mean.value);
                change.variance_g2[row] += power * power * mean.variance;
            }
        }),
        report: None,
    },
    Effect {
        id: "reference-scale",
        stage: Stage::Shaker,
        says: "the vibration is larger or smaller than command and reference say",
        parameters: &[even("eps", -0.3, 0.3, 3)],
        action: Action::TransformsMotion(
            |p, _, _, motions| {
                motions
                    .iter_mut()
                    .for_each(|motion| motion.scale(1.0 + p[0]))
            },
            Seen::ByInstrumentAlone,
        ),
        report: None,
    },
    Effect {
        id: "magnetic-pickup",
        stage: Stage::Shaker,
        says: "the shaker's magnetic field shifts the output in proportion to the drive",
        parameters: &[linear("c_g_per_g", 3e-5)],
        action: Action::Adds(|_, s, _, _, changes| {
            let change = &mut changes[0];
            for (row, run) in s.runs.iter().enumerate() {
                change.add(Observable::During, row, run.mean_square_g2().sqrt());
            }
        }),
        report: None,
    },
];

fn distort(p: &[f64], s: &Conditions, witnesses: &Witnesses, motions: &mut [Motion]) {
    let h2 = p[0];
    let seen = witnesses.reference.iter().zip(&witnesses.level_excess);
    for ((run, motion), (reference, (excess, _))) in s.runs.iter().zip(motions).zip(seen) {
        if run.kind == VibrationKind::Sine {
            motion.second_harmonic = h2;
            // The power that the waveform gains by itself, 1 + h2^2, against what was seen.
            motion.scale(((1.0 + witnesses.power_excess) / (1.0 + h2 * h2)).sqrt());
        } else if let Some(seen) = seen_ratios(run, reference.as_ref()) {
            // The power that a record gains depends on its own skewness: only the reference knows it.
            // Without a harmonic the table follows its command.
            let main = main_axis(&run.direction);
            let share = -(-(h2 / LEAST_HARMONIC).powi(2)).exp_m1();
            motion.scale(1.0 + share * (seen[main] / run.direction[main] / (1.0 + excess) - 1.0));
            motion.power_variance += (2.0 * share * witnesses.reference_rel_sigma).powi(2);
        }
    }
}
