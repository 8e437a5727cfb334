//! What the instrument keeps over a loss of power: the coefficients that it compensates with and how, of which
//! instrument they are and where they come from, and the errors that no campaign determines.

use serde::{Deserialize, Serialize};

use super::ranges;
use crate::channels::CHANNELS;
use crate::compensate::{self, Compensator, Mode, Scaling, Source, StatedErrors};
use crate::model::{self, FURTHER, NOMINAL};
use crate::rectification::{Covariance, RECTIFYING};

/// Longest serial number, bytes.
pub const NAME: usize = 24;

/// Samples in the shortest block: fewer have no moments to speak of.
pub const MIN_BLOCK_SAMPLES: u16 = 4;

/// Everything that is kept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Certified {
    /// How to compensate, and with what.
    pub configuration: Configuration,
    /// Whose coefficients these are; `None`: nobody says.
    pub provenance: Option<Provenance>,
    /// Standard uncertainties beside those of the coefficients.
    pub errors: StatedErrors<f32>,
}

/// Where coefficients come from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Serial number of the accelerometer.
    pub serial: Name,
    /// When they were sent.
    pub date: Date,
    /// SHA-256 of the campaign.
    pub campaign: [u8; 32],
    /// Lowest and highest temperature at which they hold, degrees Celsius; `None`: not stated.
    pub temperature_c: Option<[f32; 2]>,
    /// Version of the firmware that accepted them: major, minor, patch; the instrument fills it in.
    pub accepted_by: Option<[u8; 3]>,
}

/// A short text, filled up with zeros.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Name([u8; NAME]);

impl Name {
    /// `None` for a text that is empty, longer than [`NAME`] bytes, or holds what cannot be printed.
    pub fn new(text: &str) -> Option<Self> {
        let mut bytes = [0; NAME];
        bytes
            .get_mut(..text.len())?
            .copy_from_slice(text.as_bytes());
        let name = Self(bytes);
        (name.as_str() == text && name.is_possible()).then_some(name)
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|byte| *byte == 0).unwrap_or(NAME);
        let text = self.0.get(..end).map(core::str::from_utf8);
        text.and_then(Result::ok).unwrap_or("")
    }

    fn is_possible(&self) -> bool {
        let text = self.as_str();
        !text.is_empty() && !text.contains(char::is_control)
    }
}

/// A day.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Date {
    /// Year.
    pub year: u16,
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
}

impl Provenance {
    fn is_possible(&self) -> bool {
        let range = self.temperature_c.unwrap_or([0.0; 2]);
        self.serial.is_possible()
            && (1..=12).contains(&self.date.month)
            && (1..=31).contains(&self.date.day)
            && range.iter().all(|t| ranges::TEMPERATURE_C.has(*t))
            && range[0] <= range[1]
    }
}

impl From<Configuration> for Certified {
    /// Of nobody, without errors that are stated.
    fn from(configuration: Configuration) -> Self {
        Self {
            configuration,
            provenance: None,
            errors: StatedErrors::default(),
        }
    }
}

impl Certified {
    /// True when every figure can be. Errors a kelvin need a range of temperature that they count from.
    pub fn is_possible(&self) -> bool {
        let range = self.provenance.and_then(|known| known.temperature_c);
        self.configuration.is_possible()
            && self.provenance.is_none_or(|known| known.is_possible())
            && errors_are_possible(&self.errors)
            && (range.is_some() || !self.errors.depends_on_temperature())
    }

    /// The compensator that this describes; `v_per_code` of the four channels. `None` when it is switched off.
    pub fn compensator(&self, v_per_code: [f64; CHANNELS]) -> Option<Compensator<f32>> {
        let range = self.provenance.and_then(|known| known.temperature_c);
        let compensator = self.configuration.compensator(v_per_code)?;
        Some(compensator.with_errors(self.errors, range))
    }
}

/// How to compensate, and with what.
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

/// The coefficients of equation (1), plain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coefficients {
    /// K1 (V/g), k0 (g), k1', k2 (1/g), k3 (1/g^2), k4 (1/g^3), d_OA, d_PA (rad), k_IP, k_IO, k_PO (1/g).
    pub nominal: [f64; NOMINAL],
    /// k5 (1/g^4), K0' (g), Koq, Kpp, Koo (1/g).
    pub further: [f64; FURTHER],
}

impl Coefficients {
    /// True when the scale factor is 1e-9 to 1e7 V/g and every other one at most 1000 in magnitude.
    pub fn is_possible(&self) -> bool {
        let [scale_factor_v_per_g, others @ ..] = &self.nominal;
        let mut others = others.iter().chain(&self.further);
        ranges::SCALE_FACTOR_V_PER_G.has(*scale_factor_v_per_g)
            && others.all(|c| ranges::COEFFICIENT.has(*c))
    }
}

/// Coefficients with their uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// The coefficients of (1).
    pub coefficients: Coefficients,
    /// Covariance of those that rectify.
    pub covariance: Covariance<f32>,
    /// Rank of the plan that gave them, 0 to 11.
    pub rank: u8,
}

impl Calibration {
    fn is_possible(&self) -> bool {
        self.coefficients.is_possible()
            && covariance_is_possible(&self.covariance)
            && usize::from(self.rank) <= NOMINAL
    }
}

impl Compensation {
    fn is_possible(&self) -> bool {
        let mut scales = self.reference_v_per_g.iter();
        self.block_samples >= MIN_BLOCK_SAMPLES
            && ranges::SCALE_FACTOR_V_PER_G.has(self.nominal_v_per_g)
            && scales.all(|s| ranges::SCALE_FACTOR_V_PER_G.has(s.abs()))
            && self.reference_zero_v.iter().all(|z| ranges::ZERO_V.has(*z))
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
            covariance: known.covariance,
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

/// Variances within their range, and no covariance beyond what its two variances allow; rounding to `f32` adds some 1e-7.
fn covariance_is_possible(covariance: &Covariance<f32>) -> bool {
    let sigma = |k: usize| num_traits::Float::sqrt(covariance.get(k, k));
    (0..RECTIFYING).all(|row| {
        let allowed = |column: usize| sigma(row) * sigma(column) * (1.0 + 1e-4);
        ranges::VARIANCE.has(covariance.get(row, row))
            && (0..row).all(|column| covariance.get(row, column).abs() <= allowed(column))
    })
}

fn errors_are_possible(errors: &StatedErrors<f32>) -> bool {
    let StatedErrors {
        scale_factor_per_k,
        scale_factor_drift,
        bias_g_per_k,
        bias_drift_g,
        converter_nonlinearity,
    } = *errors;
    let mut relative = [
        scale_factor_per_k,
        scale_factor_drift,
        converter_nonlinearity,
    ]
    .into_iter();
    relative.all(|s| ranges::RELATIVE_SIGMA.has(s))
        && [bias_g_per_k, bias_drift_g]
            .into_iter()
            .all(|s| ranges::BIAS_SIGMA_G.has(s))
}

fn narrow(wide: &Coefficients) -> model::Coefficients<f32> {
    model::Coefficients::from_nominal(wide.nominal.map(|c| c as f32))
        .with_further(wide.further.map(|c| c as f32))
}
