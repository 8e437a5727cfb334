//! Converter and logger.

use std::f64::consts::PI;

use shared::model::SpecificForce;

use super::{Action, Effect, Stage, even, linear, logarithmic};
use crate::campaign::{Run, VibrationKind};
use crate::diagnose::problem::{Block, Change, Situation};

pub(super) const EFFECTS: &[Effect] = &[
    // A [sin(pi m u + p) - sin p] = A cos p sin(pi m u) + A sin p (cos(pi m u) - 1); its mean over a sine of
    // amplitude w is damped by J0(pi m w), over Gaussian noise by exp(-(pi m sigma)^2/2).
    Effect {
        id: "adc-inl",
        stage: Stage::Acquisition,
        says: "the converter's error repeats over its range",
        parameters: &[
            linear("_in_phase_g", 2e-5),
            linear("_quadrature_g", 2e-5),
            even("_cycles", 0.6, 16.0, 220),
        ],
        action: Action::Adds(inl),
        report: Some((&["amplitude_g", "cycles", "phase_rad"], |p| {
            vec![p[0].hypot(p[1]), p[2], p[1].atan2(p[0])]
        })),
    },
    // At a multiple of the logger's rate every sample falls on the same phase: a constant gain w sin(phase), its
    // phase anew in every run.
    Effect {
        id: "aliasing",
        stage: Stage::Acquisition,
        says: "a sine at a multiple of the logger's rate stands still in its samples",
        parameters: &[logarithmic("gain", 1e-7, 1e-2, 48)],
        action: Action::Scatters(|p, run, s| {
            let cycle = run.band_hz[0] / s.logger_rate_hz;
            if run.kind == VibrationKind::Random || (cycle - cycle.round()).abs() > 1e-6 {
                return 0.0;
            }
            0.5 * (p[0] * run.direction[0] * run.level_g).powi(2)
        }),
        report: None,
    },
];

fn inl(p: &[f64], k: usize, s: &Situation<'_>, change: &mut Change) {
    let rate = PI * p[2];
    let error = |u: f64, damping: f64| {
        let (sin, cos) = (rate * u).sin_cos();
        if k == 0 {
            damping * sin
        } else {
            damping * cos - 1.0
        }
    };
    for (row, reading) in s.readings.iter().enumerate() {
        change.add(
            Block::Static,
            row,
            error(s.coefficients.output_g(reading.specific_force_g), 1.0),
        );
    }
    let mut last: Option<(SpecificForce<f64>, f64)> = None;
    for (row, (run, motion)) in s.runs.iter().zip(&s.motions).enumerate() {
        let u = s.coefficients.output_g(run.specific_force_g);
        let rest = match last {
            Some((force, value)) if force == run.specific_force_g => value,
            _ => error(u, 1.0),
        };
        last = Some((run.specific_force_g, rest));
        change.add(Block::Before, row, rest);
        change.add(Block::After, row, rest);
        let x = rate * motion.amplitude_g[0].abs();
        change.add(Block::During, row, error(u, damping(run, x)));
        if run.kind == VibrationKind::Random {
            // sin of a phase spread far over a turn: half of it is scatter, over the independent values of the record.
            let independent = (run.band_hz[1] - run.band_hz[0]).max(1.0) * run.duration_s;
            change.variance[row] +=
                0.3 * (1.0 - (-x * x).exp()).powi(2) * (1.0 - (-0.25 * x * x).exp()) / independent;
        }
    }
}

fn damping(run: &Run, x: f64) -> f64 {
    if x == 0.0 {
        1.0
    } else if run.kind == VibrationKind::Sine {
        libm::j0(x)
    } else {
        (-0.5 * x * x).exp()
    }
}
