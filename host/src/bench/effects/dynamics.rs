//! The instrument's inner motion: what the servo loop leaves of it, and where the servo ends.

use realfft::num_complex::Complex64;

use super::{Block, Effect, Entry};

/// Makers of the effects in this file.
pub const ENTRIES: &[Entry] = &[
    Entry {
        id: "loop-bandwidth",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(LoopBandwidth {
                b_per_g: strength * 1e-3 * stream.sign(),
                fc_hz: stream.log_uniform(150.0, 1200.0),
            })
        },
    },
    Entry {
        id: "vibropendulous",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(Vibropendulous {
                k_per_g: strength * 3e-4 * stream.sign(),
                fn_hz: stream.log_uniform(150.0, 1200.0),
            })
        },
    },
    Entry {
        id: "saturation",
        catalogued: true,
        // The stronger, the lower the limit: twice the typical at strength 0, towards 0 g at infinity.
        draw: |strength, stream| {
            let limit_g = 8.0 / (0.5 + strength).max(0.05);
            Box::new(Saturation {
                limit_g,
                offset_g: limit_g * stream.uniform(-0.05, 0.05),
            })
        },
    },
];

/// A loop of finite gain lets the proof mass move. Its gain falls as 1/f, so the deflection that is left is
/// the vibration behind a first-order high-pass at fc,
///
/// ```text
/// theta = (i f/fc) / (1 + i f/fc) w_I,
/// ```
///
/// and the pick-off, which is not quite straight, adds b theta^2.
struct LoopBandwidth {
    b_per_g: f64,
    fc_hz: f64,
}

impl Effect for LoopBandwidth {
    fn id(&self) -> &'static str {
        "loop-bandwidth"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("b_per_g", self.b_per_g), ("fc_hz", self.fc_hz)]
    }

    fn response(&self, frequency_hz: f64) -> Option<Complex64> {
        let ratio = Complex64::I * (frequency_hz / self.fc_hz);
        Some(ratio / (1.0 + ratio))
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        for (out, state) in output_g.iter_mut().zip(block.state) {
            let theta = block.direction[0] * state;
            *out += self.b_per_g * theta * theta;
        }
    }
}

/// A deflected pendulum has a component of its arm along PA's force: an acceleration along PA times the
/// deflection reads as acceleration along IA. The deflection follows w_I through the lag of a damped
/// suspension, theta = w_I / (1 + i f/fn).
struct Vibropendulous {
    k_per_g: f64,
    fn_hz: f64,
}

impl Effect for Vibropendulous {
    fn id(&self) -> &'static str {
        "vibropendulous"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("k_per_g", self.k_per_g), ("fn_hz", self.fn_hz)]
    }

    fn response(&self, frequency_hz: f64) -> Option<Complex64> {
        Some(Complex64::ONE / Complex64::new(1.0, frequency_hz / self.fn_hz))
    }

    fn output(&self, block: &Block<'_>, output_g: &mut [f64]) {
        let [i, p, _] = block.direction;
        for ((out, state), w) in output_g.iter_mut().zip(block.state).zip(block.vibration_g) {
            *out += self.k_per_g * (i * state) * (p * w);
        }
    }
}

/// The torquer's current has a limit on either side.
struct Saturation {
    limit_g: f64,
    offset_g: f64,
}

impl Effect for Saturation {
    fn id(&self) -> &'static str {
        "saturation"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("limit_g", self.limit_g), ("offset_g", self.offset_g)]
    }

    fn limit(&self, output_g: &mut [f64]) {
        for out in output_g {
            *out = out.clamp(self.offset_g - self.limit_g, self.offset_g + self.limit_g);
        }
    }
}
