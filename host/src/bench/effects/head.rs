//! The dividing head and its base.

use shared::tumble::ARCSEC_RAD;

use super::{Effect, Entry};
use crate::bench::plan::Dwell;
use crate::campaign::{Approach, Series};

/// Makers of the effects in this file.
pub const ENTRIES: &[Entry] = &[
    Entry {
        id: "dial-index-error",
        catalogued: true,
        draw: |strength, stream| {
            let mut wave = |size: f64| {
                let phase = stream.uniform(0.0, std::f64::consts::TAU);
                [strength * size * phase.cos(), strength * size * phase.sin()]
            };
            let ([e1s, e1c], [e2s, e2c]) = (wave(40.0), wave(20.0));
            Box::new(DialIndexError {
                arcsec: [e1s, e1c, e2s, e2c],
            })
        },
    },
    Entry {
        id: "base-tilt",
        catalogued: true,
        draw: |strength, stream| {
            let mut size = || strength * 60.0 * stream.sign() * stream.uniform(0.4, 1.0);
            Box::new(BaseTilt {
                arcsec: [size(), size()],
            })
        },
    },
    Entry {
        id: "hysteresis",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(Hysteresis {
                h_g: strength * 2e-5 * stream.sign(),
            })
        },
    },
];

/// A divided circle mounted off its centre errs once a turn; one that is out of round, twice.
struct DialIndexError {
    arcsec: [f64; 4],
}

impl Effect for DialIndexError {
    fn id(&self) -> &'static str {
        "dial-index-error"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        let names = ["e1s_arcsec", "e1c_arcsec", "e2s_arcsec", "e2c_arcsec"];
        names.into_iter().zip(self.arcsec).collect()
    }

    fn dial_error_rad(&self, dwell: &Dwell) -> f64 {
        let (sin, cos) = dwell.dial_deg.to_radians().sin_cos();
        let (sin2, cos2) = (2.0 * dwell.dial_deg).to_radians().sin_cos();
        let [e1s, e1c, e2s, e2c] = self.arcsec;
        ARCSEC_RAD * (e1s * sin + e1c * cos + e2s * sin2 + e2c * cos2)
    }
}

/// A base knocked out of level far beyond its stated uncertainty.
struct BaseTilt {
    arcsec: [f64; 2],
}

impl Effect for BaseTilt {
    fn id(&self) -> &'static str {
        "base-tilt"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        ["zero_arcsec", "axis_arcsec"]
            .into_iter()
            .zip(self.arcsec)
            .collect()
    }

    fn base_tilt_rad(&self) -> [f64; 2] {
        self.arcsec.map(|tilt| tilt * ARCSEC_RAD)
    }
}

/// Backlash: the pendulum's suspension hangs back by an angle of h (1 g turns rad into g) behind the sense in
/// which the mark was approached. About the input axis it does not matter.
struct Hysteresis {
    h_g: f64,
}

impl Effect for Hysteresis {
    fn id(&self) -> &'static str {
        "hysteresis"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("h_g", self.h_g)]
    }

    fn dial_error_rad(&self, dwell: &Dwell) -> f64 {
        match (dwell.series, dwell.approach) {
            (Series::InputAxis, _) => 0.0,
            (_, Approach::CounterClockwise) => self.h_g,
            (_, Approach::Clockwise) => -self.h_g,
        }
    }
}
