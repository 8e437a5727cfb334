//! Between the shaker's table and the instrument.

use realfft::num_complex::Complex64;

use super::{Effect, Entry};

/// Makers of the effects in this file.
pub const ENTRIES: &[Entry] = &[Entry {
    id: "fixture-resonance",
    catalogued: true,
    // The stronger, the nearer the resonance comes to the frequencies of the test.
    draw: |strength, stream| {
        Box::new(FixtureResonance {
            fn_hz: 2500.0 / strength.max(1e-6).sqrt(),
            q: stream.log_uniform(5.0, 40.0),
        })
    },
}];

/// The instrument (mass m) stands on a fixture of stiffness k and damping c. From m x'' = k (y - x) + c (y' - x')
/// with the table's motion y,
///
/// ```text
/// H = (1 + i r/Q) / (1 - r^2 + i r/Q),   r = f/fn,   fn = sqrt(k/m)/(2 pi),   Q = sqrt(k m)/c.
/// ```
pub struct FixtureResonance {
    fn_hz: f64,
    q: f64,
}

impl Effect for FixtureResonance {
    fn id(&self) -> &'static str {
        "fixture-resonance"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("fn_hz", self.fn_hz), ("q", self.q)]
    }

    fn fixture(&self, frequency_hz: f64) -> Option<Complex64> {
        let ratio = frequency_hz / self.fn_hz;
        let damper = Complex64::I * (ratio / self.q);
        Some((1.0 + damper) / (1.0 - ratio * ratio + damper))
    }
}
