//! Between the shaker's table and the instrument.

use super::identity::Stage;
use super::{Action, Effect, Seen, logarithmic};
use crate::campaign::VibrationKind;
use crate::forward::conditions::{Conditions, Witnesses};
use crate::forward::motion::Motion;

pub(super) const EFFECTS: &[Effect] = &[
    // m x'' = k (y - x) + c (y' - x'): H = (1 + i r/Q)/(1 - r^2 + i r/Q), r = f/fn.
    Effect {
        id: "fixture-resonance",
        stage: Stage::Mounting,
        says: "the fixture resonates: the instrument moves more than the table",
        parameters: &[
            logarithmic("fn_hz", 150.0, 60_000.0, 40),
            logarithmic("q", 1.5, 80.0, 5),
        ],
        action: Action::TransformsMotion(resonate, Seen::ByInstrumentAlone),
        report: None,
    },
];

fn resonate(p: &[f64], s: &Conditions, _: &Witnesses, motions: &mut [Motion]) {
    let power = |f: f64| {
        let r = f / p[0];
        let damping = (r / p[1]).powi(2);
        (1.0 + damping) / ((1.0 - r * r).powi(2) + damping)
    };
    let means = s.bands.several(|f| {
        let power = power(f);
        [power, power.sqrt()]
    });
    for ((run, motion), [mean, amplitude]) in s.runs.iter().zip(motions).zip(means) {
        motion.scale(mean.value.sqrt());
        if run.kind == VibrationKind::Random {
            motion.power_variance += mean.variance / mean.value.powi(2);
            // What is left of the record's own shape: its correlation with the filtered record, to the moment's order.
            let correlation = (amplitude.value.powi(2) / mean.value).min(1.0).sqrt();
            motion.shape[0] *= correlation.powi(3);
            motion.shape[1] = 3.0 + (motion.shape[1] - 3.0) * correlation.powi(4);
        }
    }
}
