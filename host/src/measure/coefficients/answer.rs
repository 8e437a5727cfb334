//! What the waveform tells of the coefficients, as plain types.

use serde::Serialize;

use crate::quantity::Quantity;

/// Coefficients of the output model (1) from the harmonics and the means of one record.
#[derive(Clone, Debug, Serialize)]
pub struct WaveformCoefficients {
    /// k2, 1/g.
    pub k2_per_g: Quantity,
    /// k3, 1/g^2.
    pub k3_per_g2: Quantity,
    /// k4, 1/g^3.
    pub k4_per_g3: Quantity,
    /// Covariance of the three, in their units' products.
    pub covariance: [[f64; 3]; 3],
    /// What the mean alone gives for k2 if k3 and k4 were zero, 1/g; none where no plateau's mean is used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub k2_of_means_alone_per_g: Option<Quantity>,
    /// Column of the reference.
    pub reference: String,
    /// Standard uncertainty of what the reference itself distorts at the largest amplitude, as a share of the fundamental.
    pub reference_distortion: f64,
    /// Gravity on IA that was taken, g.
    pub a0_g: f64,
    /// Stretches of some periods whose harmonics were fitted.
    pub blocks: usize,
    /// Their length, s.
    pub block_s: f64,
    /// Least and largest amplitude of the reference, g.
    pub amplitudes_g: [f64; 2],
    /// Gain and phase of the output over the reference.
    pub dynamics: Vec<Response>,
    /// How the model fits, harmonic by harmonic.
    pub harmonics: Vec<HarmonicFit>,
    /// The vibration error that the harmonics predict, beside the measured one.
    pub tests: Vec<Test>,
    /// What is assumed, in words.
    pub assumptions: Vec<String>,
}

/// The linear dynamics at one frequency.
#[derive(Clone, Debug, Serialize)]
pub struct Response {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Order of the harmonic, 1 for the fundamental.
    pub order: usize,
    /// Output over reference.
    pub gain: Quantity,
    /// Phase of the output against the reference, deg.
    pub phase_deg: Quantity,
}

/// What the model leaves of one harmonic.
#[derive(Clone, Debug, Serialize)]
pub struct HarmonicFit {
    /// Order, 1 for the fundamental.
    pub order: usize,
    /// Root of the mean square of what is left in a block, g: in phase with what the motion's power makes, and in quadrature.
    pub residual_g: [f64; 2],
    /// Variance of what is left over half the mean square of its steps from block to block, likewise: 1 of independent blocks,
    /// more where the model misses something slow.
    pub unsteadiness: [f64; 2],
}

/// A prediction and its test on one plateau.
#[derive(Clone, Debug, Serialize)]
pub struct Test {
    /// From here, s.
    pub from_s: f64,
    /// To here, s.
    pub to_s: f64,
    /// Amplitude of the reference, g.
    pub level_g: f64,
    /// Vibration error by the coefficients from the harmonics alone, no mean seen, g.
    pub predicted_vre_g: Quantity,
    /// The measured shift of the mean, g.
    pub measured_vre_g: Quantity,
    /// Their difference over its standard uncertainty; none where that of the shift is unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigmas_apart: Option<f64>,
    /// What k2, k3 and k4 from harmonics and means make of the vibration error, g.
    pub parts_g: [Quantity; 3],
    /// Whether the mean of this plateau was used for the coefficients: not where something else may have shifted it.
    pub mean_used: bool,
}
