//! Converter and logger.

use std::f64::consts::PI;

use shared::model::{Coefficients, SpecificForce};

use inference::model::Fidelity;

use super::identity::Stage;
use super::{Action, Effect, even, linear, logarithmic};
use crate::campaign::VibrationKind;
use crate::forward::conditions::{Conditions, Witnesses};
use crate::forward::contribution::{Contribution, Observable, add_each};
use crate::forward::motion::Motion;
use crate::forward::rows::RunConditions;

pub(super) const EFFECTS: &[Effect] = &[
    // A [sin(pi m u + p) - sin p] = A cos p sin(pi m u) + A sin p (cos(pi m u) - 1); its mean over a sine of
    // amplitude w is damped by about J0(pi m w), over Gaussian noise by exp(-(pi m sigma)^2/2).
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
    // phase anew in every run. What noise leaves is far less, and a scatter of all random runs would stand in for anything.
    Effect {
        id: "aliasing",
        stage: Stage::Acquisition,
        says: "a sine at a multiple of the logger's rate stands still in its samples",
        parameters: &[logarithmic("gain", 1e-7, 1e-2, 48)],
        action: Action::AddsVariance(|run, s| {
            let cycle = run.band_hz[0] / s.logger_rate_hz;
            if run.kind == VibrationKind::Random || (cycle - cycle.round()).abs() > 1e-6 {
                return 0.0;
            }
            0.5 * (run.direction[0] * run.level_g).powi(2)
        }),
        report: None,
    },
];

fn inl(p: &[f64], s: &Conditions, _: &Witnesses, fidelity: Fidelity, changes: &mut [Contribution]) {
    let rate = PI * p[2];
    let error = |u: f64| {
        let (sin, cos) = (rate * u).sin_cos();
        [sin, cos - 1.0]
    };
    for (row, reading) in s.readings.iter().enumerate() {
        let u = s.coefficients.output_g(reading.specific_force_g);
        add_each(changes, Observable::Static, row, error(u));
    }
    // Runs differ in frequency more often than in attitude and level.
    let mut known: Vec<(SpecificForce<f64>, Motion, [[f64; 2]; 2])> = Vec::new();
    for (row, (run, motion)) in s.runs.iter().zip(&s.motions).enumerate() {
        let a0 = run.specific_force_g;
        let same = known
            .iter()
            .find(|known| (known.0, known.1) == (a0, *motion));
        let same = same
            .filter(|_| run.kind == VibrationKind::Sine)
            .map(|known| known.2);
        let [rest, during] = same.unwrap_or_else(|| {
            let u = s.coefficients.output_g(a0);
            let coefficients = &s.coefficients;
            let shaken = match fidelity {
                Fidelity::Screening => shaken_roughly(error, rate, run, motion, coefficients),
                Fidelity::Full => shaken(error, rate, run, motion, coefficients),
            };
            [error(u), shaken]
        });
        if run.kind == VibrationKind::Sine && same.is_none() {
            known.push((a0, *motion, [rest, during]));
        }
        add_each(changes, Observable::Before, row, rest);
        add_each(changes, Observable::After, row, rest);
        add_each(changes, Observable::During, row, during);
        if run.kind == VibrationKind::Random {
            // sin of a phase spread far over a turn: half of it is scatter, over the independent values of the record.
            let independent = (run.band_hz[1] - run.band_hz[0]).max(1.0) * run.duration_s;
            let x = rate * motion.amplitude_g[0].abs();
            let scatter =
                0.3 * (1.0 - (-x * x).exp()).powi(2) * (1.0 - (-0.25 * x * x).exp()) / independent;
            changes
                .iter_mut()
                .for_each(|change| change.variance_g2[row] += scatter);
        }
    }
}

/// The time means of sin(rate u) and cos(rate u) - 1, `rate` in radians a g, as if the output were the specific force but for
/// a constant.
fn shaken_roughly(
    error: impl Fn(f64) -> [f64; 2],
    rate: f64,
    run: &RunConditions,
    motion: &Motion,
    coefficients: &Coefficients<f64>,
) -> [f64; 2] {
    let x = rate * motion.amplitude_g[0].abs();
    let damping = match run.kind {
        VibrationKind::Sine => libm::j0(x),
        VibrationKind::Random => (-0.5 * x * x).exp(),
    };
    let [sin, cos] = error(coefficients.output_g(run.specific_force_g));
    // What is damped is the cosine; the constant is not.
    [damping * sin, damping * (cos + 1.0) - 1.0]
}

/// The same with the instrument's own nonlinearity.
fn shaken(
    error: impl Fn(f64) -> [f64; 2],
    rate: f64,
    run: &RunConditions,
    motion: &Motion,
    coefficients: &Coefficients<f64>,
) -> [f64; 2] {
    if run.kind == VibrationKind::Random {
        return shaken_roughly(error, rate, run, motion, coefficients);
    }
    let (a0, h) = (run.specific_force_g, motion.second_harmonic);
    let x = rate * motion.amplitude_g[0].abs();
    // The instrument's own nonlinearity bends the sine by a good part of the error's period. An even number of phases
    // of a whole period is exact once it exceeds the phase's excursion (Bessel functions of that order vanish).
    let phases = (0.5 * x * (1.0 + 2.0 * h.abs())) as usize + 16;
    let mut sums = [0.0; 2];
    for n in 0..phases {
        let w = motion.at_phase(PI * ((n as f64 + 0.5) / phases as f64 - 0.5));
        let [i, p, o] = motion.amplitude_g.map(|amplitude| amplitude * w);
        let force = SpecificForce::new(a0.i + i, a0.p + p, a0.o + o);
        for (sum, value) in sums.iter_mut().zip(error(coefficients.output_g(force))) {
            *sum += value;
        }
    }
    sums.map(|sum| sum / phases as f64)
}
