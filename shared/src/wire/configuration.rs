//! What the instrument keeps over a loss of power: the coefficients that it compensates with, and how.

use serde::{Deserialize, Serialize};

use super::message::{CHANNELS, Coefficients};
use crate::compensate::{self, Compensator, Mode, Scaling, Source};
use crate::model;
use crate::model::NOMINAL;

/// Samples in the shortest block: fewer have no moments to speak of.
pub const MIN_BLOCK_SAMPLES: u16 = 4;

/// Everything that is kept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// How to compensate.
    pub compensation: Compensation,
    /// What identification found; without it compensated blocks hold the plain mean and say so.
    pub calibration: Option<Calibration>,
}

/// How the instrument compensates. Volts are those at the converter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Compensation {
    /// By which method; `None`: not at all.
    pub mode: Option<Mode>,
    /// Where the vibration's moments come from.
    pub source: Source,
    /// Conversions in a block, at least [`MIN_BLOCK_SAMPLES`].
    pub block_samples: u16,
    /// Scale factor of an instrument without a calibration, V/g, > 0.
    pub nominal_v_per_g: f32,
    /// Scale of the reference's channels I, P and O, V/g, not zero.
    pub reference_v_per_g: [f32; 3],
    /// Output of the reference's channels at zero specific force, V.
    pub reference_zero_v: [f32; 3],
}

/// Coefficients with their uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// The coefficients of (1).
    pub coefficients: Coefficients,
    /// Lower triangle, row by row, of the covariance of the eleven nominal coefficients.
    pub covariance: [[f32; NOMINAL]; 6],
    /// Rank of the plan that gave them, 0 to 11.
    pub rank: u8,
}

impl Calibration {
    /// With a covariance of the nominal coefficients, of which the lower triangle is taken.
    pub fn new(
        coefficients: Coefficients,
        covariance: &[[f64; NOMINAL]; NOMINAL],
        rank: u8,
    ) -> Self {
        let mut packed = [0.0; 6 * NOMINAL];
        let triangle = (0..NOMINAL).flat_map(|row| (0..=row).map(move |column| (row, column)));
        for (to, (row, column)) in packed.iter_mut().zip(triangle) {
            *to = covariance[row][column] as f32;
        }
        let (rows, _) = packed.as_chunks::<NOMINAL>();
        Self {
            coefficients,
            covariance: core::array::from_fn(|k| rows[k]),
            rank,
        }
    }

    /// The whole covariance.
    pub fn covariance(&self) -> [[f32; NOMINAL]; NOMINAL] {
        let packed = self.covariance.as_flattened();
        core::array::from_fn(|row| {
            core::array::from_fn(|column| {
                let (low, high) = (row.min(column), row.max(column));
                packed[high * (high + 1) / 2 + low]
            })
        })
    }

    fn is_possible(&self) -> bool {
        let variances = (0..NOMINAL).map(|k| self.covariance()[k][k]);
        let finite = self.covariance.as_flattened().iter().all(|c| c.is_finite());
        self.coefficients.is_possible()
            && finite
            && variances.into_iter().all(|v| v >= 0.0)
            && usize::from(self.rank) <= NOMINAL
    }
}

impl Compensation {
    fn is_possible(&self) -> bool {
        let mut scales = self.reference_v_per_g.iter();
        self.block_samples >= MIN_BLOCK_SAMPLES
            && self.nominal_v_per_g.is_finite()
            && self.nominal_v_per_g > 0.0
            && scales.all(|s| s.is_finite() && *s != 0.0)
            && self.reference_zero_v.iter().all(|z| z.is_finite())
    }
}

impl Configuration {
    /// True when every figure can be.
    pub fn is_possible(&self) -> bool {
        self.compensation.is_possible() && self.calibration.is_none_or(|c| c.is_possible())
    }

    /// The compensator that this describes; `v_per_code` of the four channels. `None` when it is switched off.
    pub fn compensator(&self, v_per_code: [f64; CHANNELS]) -> Option<Compensator<f32>> {
        let how = &self.compensation;
        let mode = how.mode?;
        let [instrument, reference @ ..] = v_per_code;
        let calibration = self.calibration.map(|known| compensate::Calibration {
            coefficients: narrow(&known.coefficients),
            covariance: known.covariance(),
            rank: known.rank,
        });
        let scaling = Scaling {
            instrument_v_per_code: instrument as f32,
            nominal_v_per_g: how.nominal_v_per_g,
            reference_g_per_code: core::array::from_fn(|k| {
                (reference[k] / f64::from(how.reference_v_per_g[k])) as f32
            }),
            reference_zero: core::array::from_fn(|k| {
                (f64::from(how.reference_zero_v[k]) / reference[k]) as i32
            }),
        };
        Some(Compensator::new(calibration, scaling, how.source, mode))
    }
}

fn narrow(wide: &Coefficients) -> model::Coefficients<f32> {
    let mut narrow = model::Coefficients::from_nominal(wide.nominal.map(|c| c as f32));
    narrow.fifth_order_per_g4 = wide.fifth_order_per_g4 as f32;
    narrow
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covariance_survives_its_triangle() {
        let full: [[f64; NOMINAL]; NOMINAL] = core::array::from_fn(|row| {
            core::array::from_fn(|column| (1 + row.min(column) + 16 * row.max(column)) as f64)
        });
        let coefficients = Coefficients {
            nominal: [1.0; NOMINAL],
            fifth_order_per_g4: 0.0,
        };
        let kept = Calibration::new(coefficients, &full, 11);
        assert_eq!(kept.covariance().map(|row| row.map(f64::from)), full);
    }
}
