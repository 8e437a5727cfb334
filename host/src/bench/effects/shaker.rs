//! The shaker's table, its reference accelerometer and its magnet.

use realfft::num_complex::Complex64;

use super::{Effect, Entry};
use crate::bench::environment::Moment;

/// Makers of the effects in this file.
pub const ENTRIES: &[Entry] = &[
    Entry {
        id: "shaker-transverse",
        catalogued: true,
        draw: |strength, stream| {
            let mut ratio = || strength * 0.1 * stream.sign() * stream.uniform(0.4, 1.0);
            Box::new(Transverse {
                ratio_next: ratio(),
                ratio_previous: ratio(),
            })
        },
    },
    Entry {
        id: "shaker-distortion",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(Distortion {
                h2: strength * 0.03 * stream.sign(),
            })
        },
    },
    Entry {
        id: "shaker-rocking",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(Rocking {
                r_per_g_hz2: strength * 0.1 * stream.sign(),
            })
        },
    },
    Entry {
        id: "reference-scale",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(ReferenceScale {
                eps: strength * 0.02 * stream.sign(),
            })
        },
    },
    Entry {
        id: "magnetic-pickup",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(MagneticPickup {
                c_g_per_g: strength * 3e-5 * stream.sign(),
            })
        },
    },
];

/// A table that is not guided straight: motion in phase with the drive on the two other axes, in proportion
/// to the level. The axis of the drive is the one with its largest component (the first of equals); the other
/// two follow it in the order IA, PA, OA, IA.
struct Transverse {
    ratio_next: f64,
    ratio_previous: f64,
}

impl Effect for Transverse {
    fn id(&self) -> &'static str {
        "shaker-transverse"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("ratio_next", self.ratio_next),
            ("ratio_previous", self.ratio_previous),
        ]
    }

    fn direction(&self, direction: [f64; 3]) -> [f64; 3] {
        let largest = direction.iter().fold(0.0_f64, |most, n| most.max(n.abs()));
        let along = direction
            .iter()
            .position(|n| n.abs() > largest - 1e-9)
            .unwrap_or_default();
        let mut turned = direction;
        turned[(along + 1) % 3] += self.ratio_next;
        turned[(along + 2) % 3] += self.ratio_previous;
        turned
    }
}

/// A suspension that is stiffer one way: the table's motion gains a square of itself,
///
/// ```text
/// w + (sqrt2 h2 / rms) (w^2 - M[w^2]),
/// ```
///
/// which for a sine is a second harmonic of the relative amplitude h2 and makes noise skewed.
struct Distortion {
    h2: f64,
}

impl Effect for Distortion {
    fn id(&self) -> &'static str {
        "shaker-distortion"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("h2", self.h2)]
    }

    fn drive(&self, samples_g: &mut [f64], rms_g: f64) {
        let square = std::f64::consts::SQRT_2 * self.h2 / rms_g;
        for w in samples_g {
            *w += square * (*w * *w - rms_g * rms_g);
        }
    }
}

/// The table turns to and fro about a point some way off, with an angular rate in proportion to its velocity.
/// Motion on a circle has a centripetal acceleration, rate^2 x radius, of one sign. With v the integral of the
/// vibration in units of g/(2 pi) s, whose phasor is w/(i f), the force on IA gains r v^2.
struct Rocking {
    r_per_g_hz2: f64,
}

impl Effect for Rocking {
    fn id(&self) -> &'static str {
        "shaker-rocking"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("r_per_g_hz2", self.r_per_g_hz2)]
    }

    fn response(&self, frequency_hz: f64) -> Option<Complex64> {
        if frequency_hz > 0.0 {
            Some(-Complex64::I / frequency_hz)
        } else {
            Some(Complex64::ZERO)
        }
    }

    fn force_i(&self, state: &[f64], force_i_g: &mut [f64]) {
        for (force, v) in force_i_g.iter_mut().zip(state) {
            *force += self.r_per_g_hz2 * v * v;
        }
    }
}

/// The reference reads low, so the controller drives the table higher than it knows.
struct ReferenceScale {
    eps: f64,
}

impl Effect for ReferenceScale {
    fn id(&self) -> &'static str {
        "reference-scale"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("eps", self.eps)]
    }

    fn motion_scale(&self) -> f64 {
        1.0 + self.eps
    }
}

/// The stray field of the shaker's coil magnetises the instrument's magnet circuit in proportion to the drive's
/// rms current while it flows.
struct MagneticPickup {
    c_g_per_g: f64,
}

impl Effect for MagneticPickup {
    fn id(&self) -> &'static str {
        "magnetic-pickup"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("c_g_per_g", self.c_g_per_g)]
    }

    fn shift_g(&self, moment: &Moment<'_>) -> f64 {
        match moment.exposures.last() {
            Some(run) if (run.start_s..=run.end_s).contains(&moment.time_s) => {
                self.c_g_per_g * run.drive_rms_g
            }
            _ => 0.0,
        }
    }
}
