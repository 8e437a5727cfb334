//! Effects that the published catalogue does not name: what a diagnosis must call unexplained.

use realfft::num_complex::Complex64;

use super::statics::term;
use super::{Block, Effect, Entry};
use crate::bench::environment::Moment;

/// Makers of the effects in this file.
pub const ENTRIES: &[Entry] = &[
    Entry {
        id: "cubic-cross",
        catalogued: false,
        draw: |strength, stream| {
            term(
                "cubic-cross",
                "k_iip_per_g2",
                strength * 1e-4,
                stream,
                |a| a[0] * a[0] * a[1],
            )
        },
    },
    Entry {
        id: "gas-damping",
        catalogued: false,
        draw: |strength, stream| {
            Box::new(GasDamping {
                coefficient_per_g2: strength * 1e-3 * stream.sign(),
                corner_hz: stream.log_uniform(200.0, 800.0),
            })
        },
    },
    Entry {
        id: "thermal-k2",
        catalogued: false,
        draw: |strength, stream| {
            Box::new(ThermalK2 {
                per_g_k: strength * 2e-5 * stream.sign(),
            })
        },
    },
    Entry {
        id: "stick-slip",
        catalogued: false,
        draw: |strength, stream| {
            Box::new(StickSlip {
                friction_g: strength * 5e-5 * stream.sign(),
                dither_g: stream.uniform(0.5, 2.0),
            })
        },
    },
    Entry {
        id: "cable-microphony",
        catalogued: false,
        draw: |strength, stream| {
            Box::new(CableMicrophony {
                gain_per_g: strength * 2e-4 * stream.sign(),
                fn_hz: stream.log_uniform(100.0, 700.0),
                q: stream.uniform(3.0, 12.0),
            })
        },
    },
    Entry {
        id: "settling",
        catalogued: false,
        draw: |strength, stream| {
            Box::new(Settling {
                shift_g: strength * 5e-5 * stream.sign(),
                tau_s: stream.log_uniform(1500.0, 6000.0),
            })
        },
    },
];

/// The gas film between proof mass and magnet is compressed as the mass moves, faster than it can escape above a
/// corner frequency: it becomes a spring, and one that stiffens with the cube of the gap's change. Of the force
/// k (x0 + x)^3 with the constant part x0 in proportion to the force on IA, the mixed term x0 x^2 does not average
/// out. The motion x is the vibration behind a second-order high-pass, the film's own.
struct GasDamping {
    coefficient_per_g2: f64,
    corner_hz: f64,
}

impl Effect for GasDamping {
    fn id(&self) -> &'static str {
        "gas-damping"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("coefficient_per_g2", self.coefficient_per_g2),
            ("corner_hz", self.corner_hz),
        ]
    }

    fn response(&self, frequency_hz: f64) -> Option<Complex64> {
        let ratio = frequency_hz / self.corner_hz;
        let damped = Complex64::new(1.0 - ratio * ratio, 1.4 * ratio);
        Some(-Complex64::from(ratio * ratio) / damped)
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        let samples = output_g.iter_mut().zip(block.force_g[0]).zip(block.state);
        for ((out, force), state) in samples {
            let deflection = block.direction[0] * state;
            *out += self.coefficient_per_g2 * force * deflection * deflection;
        }
    }
}

/// The suspension's second-order term follows the temperature.
struct ThermalK2 {
    per_g_k: f64,
}

impl Effect for ThermalK2 {
    fn id(&self) -> &'static str {
        "thermal-k2"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("per_g_k", self.per_g_k)]
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        let coefficient = self.per_g_k * block.excess_k;
        for (out, a) in output_g.iter_mut().zip(block.force_g[0]) {
            *out += coefficient * a * a;
        }
    }
}

/// A dry contact sticks at rest and is shaken free by vibration in any direction: the bias that its friction
/// held falls off as the motion's magnitude passes that of the contact.
struct StickSlip {
    friction_g: f64,
    dither_g: f64,
}

impl Effect for StickSlip {
    fn id(&self) -> &'static str {
        "stick-slip"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("friction_g", self.friction_g), ("dither_g", self.dither_g)]
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        for (out, w) in output_g.iter_mut().zip(block.vibration_g) {
            *out += self.friction_g / (1.0 + (w / self.dither_g).powi(2));
        }
    }
}

/// The cable swings on the table at a resonance of its own, in whatever direction, and its triboelectric charge
/// goes with the square of the swing.
struct CableMicrophony {
    gain_per_g: f64,
    fn_hz: f64,
    q: f64,
}

impl Effect for CableMicrophony {
    fn id(&self) -> &'static str {
        "cable-microphony"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("gain_per_g", self.gain_per_g),
            ("fn_hz", self.fn_hz),
            ("q", self.q),
        ]
    }

    fn response(&self, frequency_hz: f64) -> Option<Complex64> {
        let ratio = frequency_hz / self.fn_hz;
        Some(Complex64::ONE / Complex64::new(1.0 - ratio * ratio, ratio / self.q))
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        for (out, swing) in output_g.iter_mut().zip(block.state) {
            *out += self.gain_per_g * swing * swing;
        }
    }
}

/// The bias settles after switching on, as the electronics come to their temperature.
struct Settling {
    shift_g: f64,
    tau_s: f64,
}

impl Effect for Settling {
    fn id(&self) -> &'static str {
        "settling"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("shift_g", self.shift_g), ("tau_s", self.tau_s)]
    }

    fn shift_g(&self, moment: &Moment<'_>) -> f64 {
        self.shift_g * (-moment.time_s / self.tau_s).exp()
    }
}
