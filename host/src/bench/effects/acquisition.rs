//! Between the instrument's output and the number in the file.

use std::f64::consts::{PI, TAU};

use super::{Effect, Entry, Plateau};
use crate::bench::noise::Stream;

/// Makers of the effects in this file.
pub const ENTRIES: &[Entry] = &[
    Entry {
        id: "adc-inl",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(IntegralNonlinearity {
                amplitude_g: strength * 2e-5,
                cycles: stream.uniform(1.0, 12.0),
                phase_rad: stream.uniform(0.0, TAU),
            })
        },
    },
    Entry {
        id: "aliasing",
        catalogued: true,
        draw: |strength, _| {
            Box::new(Aliasing {
                gain: strength * 3e-5,
            })
        },
    },
    Entry {
        id: "window-leakage",
        catalogued: false,
        draw: |strength, _| {
            Box::new(WindowLeakage {
                gain: strength * 0.1,
            })
        },
    },
];

/// Integral nonlinearity of a folding converter: its code errs periodically over the range.
struct IntegralNonlinearity {
    amplitude_g: f64,
    cycles: f64,
    phase_rad: f64,
}

impl Effect for IntegralNonlinearity {
    fn id(&self) -> &'static str {
        "adc-inl"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("amplitude_g", self.amplitude_g),
            ("cycles", self.cycles),
            ("phase_rad", self.phase_rad),
        ]
    }

    fn convert(&self, output_g: &mut [f64]) {
        let at_zero = self.phase_rad.sin();
        for u in output_g {
            let error = (PI * self.cycles * *u + self.phase_rad).sin() - at_zero;
            *u += self.amplitude_g * error;
        }
    }
}

/// The logger's filter lets a little of the vibration through to its sampler. A sine at a multiple of the
/// rate then stands still, at whatever phase the run happened to start with.
struct Aliasing {
    gain: f64,
}

impl Effect for Aliasing {
    fn id(&self) -> &'static str {
        "aliasing"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("gain", self.gain)]
    }

    fn plateau_error_g(&self, plateau: &Plateau<'_>, stream: &mut Stream) -> f64 {
        let start = stream.uniform(0.0, 1.0);
        let count = (plateau.duration_s * plateau.logger_rate_hz).round() as usize;
        let sampled = (0..count).map(|n| {
            at(
                plateau,
                start + plateau.fundamental_hz * n as f64 / plateau.logger_rate_hz,
            )
        });
        self.gain * sampled.sum::<f64>() / count as f64
    }
}

/// The vibration at a number of periods of the record, to the nearest sample.
fn at(plateau: &Plateau<'_>, periods: f64) -> f64 {
    let samples = plateau.vibration_i_g;
    let index = (periods.rem_euclid(1.0) * samples.len() as f64) as usize;
    samples[index.min(samples.len() - 1)]
}

/// The averaging window is not as long as it is believed to be: its end cuts a period of the vibration in two.
/// The part that is cut off or added, up to half a period, leaves its integral over the window's length.
struct WindowLeakage {
    gain: f64,
}

impl Effect for WindowLeakage {
    fn id(&self) -> &'static str {
        "window-leakage"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("gain", self.gain)]
    }

    fn plateau_error_g(&self, plateau: &Plateau<'_>, stream: &mut Stream) -> f64 {
        let samples = plateau.vibration_i_g;
        let start = stream.index(samples.len());
        // At most half a period of a 25 Hz sine, 20 ms.
        let cut_s = stream.uniform(0.0, 0.02);
        let step_s = 1.0 / (plateau.fundamental_hz * samples.len() as f64);
        let count = (cut_s / step_s) as usize;
        let cut = (0..count).map(|n| samples[(start + n) % samples.len()]);
        self.gain * cut.sum::<f64>() * step_s / plateau.duration_s
    }
}
