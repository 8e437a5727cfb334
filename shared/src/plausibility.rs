//! Is there a reference accelerometer at the converter's inputs, and does it feel what the instrument feels?
//!
//! An input that nothing is plugged into still has noise: it does not stand still. But it tells neither the specific force
//! along IA, nor a specific force at all, nor the vibration that the instrument tells.

use crate::scalar::Real;

/// By how much the reference's mean along IA may differ from the instrument's, g, and as a part of the specific force:
/// twice what data sheets of MEMS references allow for bias (50 mg), alignment (50 mg at 1 g, 3 deg) and scale (2.5 %).
const MEAN_TOLERANCE_G: f64 = 0.2;
const MEAN_TOLERANCE: f64 = 0.05;

/// Least specific force, g rms over all axes, that the reference tells in the long run. At rest it is 1 g, with vibration
/// more; a carrier that falls freely for long has less, and the reference is then taken for lost. Chosen halfway.
const LEAST_FELT_G: f64 = 0.5;

/// Samples of the long run: at 4 kSPS a second, twenty periods of the slowest vibration that is compensated. One block may
/// well tell nothing: vibration takes gravity away for a moment.
const LONG_RUN: f64 = 4096.0;

/// Instrument's vibration, g rms, from which on the reference must tell some too: far above the noise of either.
const VIBRATION_G: f64 = 0.02;

/// Least part of the instrument's variance that the reference tells. Both see the same axis; a quarter of the amplitude is
/// less than any difference of their bands makes in the claimed band. Chosen.
const LEAST_VARIANCE: f64 = 1.0 / 16.0;

/// One block as both tell it, g.
#[derive(Clone, Copy, Debug)]
pub struct Both<T> {
    /// False while the instrument is at the end of its range, and tells neither mean nor vibration.
    pub comparable: bool,
    /// The instrument's mean along IA.
    pub instrument_g: T,
    /// The instrument's variance, g^2.
    pub instrument_g2: T,
    /// The reference's mean along IA.
    pub reference_g: T,
    /// The reference's variance along IA, g^2.
    pub reference_g2: T,
    /// The reference's mean square over all axes in the long run, g^2.
    pub felt_g2: T,
}

/// What the reference feels in the long run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Felt<T>(Option<T>);

impl<T: Real> Felt<T> {
    /// Takes the mean square of a block, g^2, of so many samples; gives that of the long run, g^2.
    pub fn absorb(&mut self, mean_square_g2: T, samples: u64) -> T {
        let before = self.0.unwrap_or(mean_square_g2);
        let weight = (T::from_i64(samples as i64) / T::lit(LONG_RUN)).min(T::one());
        let felt = before + (mean_square_g2 - before) * weight;
        self.0 = Some(felt);
        felt
    }
}

impl<T: Real> Both<T> {
    /// True when the reference tells what the instrument tells.
    pub fn agree(&self) -> bool {
        let i = self.reference_g;
        let allowed = T::lit(MEAN_TOLERANCE_G) + T::lit(MEAN_TOLERANCE) * self.instrument_g.abs();
        let same_mean = (i - self.instrument_g).abs() <= allowed;
        let senses = self.felt_g2 >= T::lit(LEAST_FELT_G * LEAST_FELT_G);
        let quiet = self.instrument_g2 < T::lit(VIBRATION_G * VIBRATION_G);
        let shakes = self.reference_g2 >= T::lit(LEAST_VARIANCE) * self.instrument_g2;
        senses && (!self.comparable || same_mean && (quiet || shakes))
    }
}
