//! Compensation on board: the specific force from a block of samples, freed of vibration error.
//!
//! ```text
//! u(a) + VRE(a, w) = M[U] / K1,   solved for a by Newton's method; VRE in the moment form of (2)
//! ```
//!
//! Within one block this is no approximation: the mean of (1) over any finite set of samples *is* (1) at their mean
//! plus the moment form with their central moments. What remains is what the moments do not see: the converter's
//! sinc3 filter, whose droop is corrected by the mean-square frequency of the block, and the noise of the reference.
//! The second mode inverts (1) sample by sample and is for an instrument that is fast enough to follow the vibration;
//! there each sample is sharpened against the droop before.
//!
//! Both are claimed from 20 Hz to [`CLAIMED_BAND`] of the sample rate. What is above is excluded, and flagged
//! ([`Quality::OUT_OF_BAND`]): the correction of the droop is short of it by more and more. The frequency is that of the
//! vibration along IA; while IA is quiet, vibration across it is neither corrected for the droop nor flagged.
//!
//! [`Compensator`] is what does not change from sample to sample, [`CompensatorState`] what does. `f32` is enough:
//! the correction is small, and the mean comes from an integer sum.

use core::array::from_fn;
use core::mem::replace;

use serde::{Deserialize, Serialize};

use crate::model::{Coefficients, NOMINAL, SpecificForce};
use crate::moments::{CHANNELS, Moments};
use crate::plausibility::{Both, Felt};
use crate::rectification::{Covariance, Sensitivity};
use crate::scalar::Real;
use crate::vibration::{self, Kinked, KinkedMeans};

pub use crate::stated_errors::StatedErrors;

/// Where the vibration's moments come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Source {
    /// The triaxial reference accelerometer, channels 1 to 3. It must sense gravity too: the means of functions with a kink,
    /// such as M|a|, are taken about its zero.
    #[default]
    Reference,
    /// The instrument's own signal on IA; cross-couplings and the squares across are left out. For an instrument that follows
    /// the vibration. Its moments hold its nonlinearity too: at a0 = 0 a square is off by 2 k2 m3/m2 + 2 k3 m4/m2 of itself.
    Instrument,
}

/// How the block's mean is freed of vibration error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// By the block's moments.
    #[default]
    Block,
    /// By inverting (1) for each sample, with the reference's P and O of the same instant; by the block's moments while
    /// the reference is lost.
    Pointwise,
}

/// What a compensated block is worth, as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Quality(pub u8);

impl Quality {
    /// A code reached the end of the converter's range.
    pub const SATURATED: u8 = 1 << 0;
    /// The reference's channels stand still, are saturated or do not tell what the instrument tells: the instrument's own
    /// signal was taken.
    pub const REFERENCE_LOST: u8 = 1 << 1;
    /// No coefficients: the output is the mean over the nominal scale factor.
    pub const COEFFICIENTS_MISSING: u8 = 1 << 2;
    /// The coefficients' plan left a direction undetermined, which the uncertainty does not cover.
    pub const PLAN_BLIND: u8 = 1 << 3;
    /// The vibration's mean-square frequency is above the band for which the compensation is claimed. Two or three periods
    /// in a block tell that frequency to some 5 %.
    pub const OUT_OF_BAND: u8 = 1 << 4;
    /// No specific force gives this output: Newton's method did not settle, or a figure is beyond all numbers. The output is
    /// then the mean over the scale factor, of unknown uncertainty.
    pub const NO_SOLUTION: u8 = 1 << 5;
    /// It is colder or warmer than the coefficients were determined for.
    pub const TEMPERATURE: u8 = 1 << 6;
    /// The sample rate is that of the board's internal oscillator: frequencies and times are unsure by per cents.
    pub const TIME_BASE: u8 = 1 << 7;

    /// True when the block has none of these.
    pub const fn is_sound(self) -> bool {
        self.0 == 0
    }

    /// True when the block has this one.
    pub const fn has(self, flag: u8) -> bool {
        self.0 & flag != 0
    }
}

/// What identification says of an instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration<T> {
    /// The coefficients of (1).
    pub coefficients: Coefficients<T>,
    /// Covariance of those that rectify.
    pub covariance: Covariance<T>,
    /// Rank of the plan that gave them, 0 to 11; below 11 it is blind to something.
    pub rank: u8,
}

/// How codes become volts and g.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scaling<T> {
    /// Volts of one code of the instrument's channel.
    pub instrument_v_per_code: T,
    /// Scale factor of an instrument without coefficients, V/g, > 0.
    pub nominal_v_per_g: T,
    /// Specific force of one code of the reference's channels I, P and O, g.
    pub reference_g_per_code: [T; 3],
    /// Codes of zero specific force of the reference's channels I, P and O.
    pub reference_zero: [i32; 3],
}

/// Everything that stays the same from block to block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensator<T> {
    calibration: Option<Calibration<T>>,
    errors: StatedErrors<T>,
    /// Temperatures for which the coefficients hold, degrees Celsius.
    temperature_c: Option<[T; 2]>,
    source: Source,
    mode: Mode,
    /// Of the instrument's channel; wider than the hot path, since it scales the whole of the output.
    g_per_code: f64,
    /// g of one code of each channel.
    to_g: [T; CHANNELS],
    zero: [i32; CHANNELS],
}

/// A compensated block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensated<T> {
    /// Mean specific force on IA, g; wider than the hot path, since only the small corrections need no more.
    pub specific_force_g: f64,
    /// The vibration error that was taken out, g.
    pub vre_g: T,
    /// Its standard uncertainty from the coefficients' covariance, g.
    pub vre_sigma_g: T,
    /// Standard uncertainty of the specific force: the same and the stated errors, g. The block's noise is not in it.
    pub sigma_g: T,
    /// What this is worth.
    pub quality: Quality,
}

impl<T: Real> Compensated<T> {
    /// With nothing taken out of the output, of unknown uncertainty.
    fn plain(output_g: f64, quality: u8) -> Self {
        Self {
            specific_force_g: output_g,
            vre_g: T::zero(),
            vre_sigma_g: T::infinity(),
            sigma_g: T::infinity(),
            quality: Quality(quality),
        }
    }
}

/// What a block is measured under, as far as somebody knows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Temperature of the instrument, or of the board next to it, degrees Celsius.
    pub temperature_c: Option<f32>,
    /// The board's clock is its internal oscillator.
    pub time_base_unsure: bool,
}

/// The highest frequency for which compensation is claimed, as a part of the sample rate: 250 Hz at 4 kSPS, 1 kHz at
/// 16 kSPS, 2 kHz at 32 kSPS.
pub const CLAIMED_BAND: f64 = 1.0 / 16.0;

/// sin^2(pi [`CLAIMED_BAND`]): the mean square of half the step from sample to sample over the variance, for a sine at
/// the band's upper end.
const HALF_STEP_LIMIT: f64 = 0.038_060_233_744_356_62;

/// h of y[n] = x[n] + h (2 x[n-1] - x[n] - x[n-2]), which sharpens the samples before they are inverted one by one.
///
/// With x = pi f / rate and s = sin x its response is 1 + 4 h s^2 exp(-2 i x), the square of its gain
/// 1 + 8 h s^2 (1 - 2 s^2) + 16 h^2 s^4, and the converter's sinc3 filter keeps (s / x)^6 of a square. h = 1/8 would undo
/// that to the order s^2; this one leaves -0.07 % to +0.07 % of a square from 0 to [`CLAIMED_BAND`]. White noise from
/// sample to sample does not grow.
///
/// It looks back only, and still moves no wave of the band by more than 0.02 samples, so that a block's samples remain
/// the block's. The first two after a gap have no two before and stay as they are.
const SHARPENING: f64 = 0.136;

/// The same as a power of two: an eighth, which costs one instruction and leaves -0.4 % of a square at the band's end. It is
/// for the means of sign(x) and x|x|: how the droop changes these, no moment tells.
const SHARPENING_SHIFT: u32 = 3;

/// Vibration of a smaller rms than this, g, rectifies nothing that matters, and may have any frequency.
const QUIET_RMS_G: f64 = 1e-3;

/// Largest magnitude of a code that counts as within range.
const FULL_SCALE: i32 = (1 << 23) - 1;

/// Newton steps at the most; the error shrinks at least a hundredfold with each.
const STEPS: usize = 4;

impl<T: Real> Compensator<T> {
    /// A compensator; without a calibration it gives the plain mean and says so.
    pub fn new(
        calibration: Option<Calibration<T>>,
        scaling: Scaling<T>,
        source: Source,
        mode: Mode,
    ) -> Self {
        let k1 = match &calibration {
            Some(known) => known.coefficients.scale_factor_v_per_g,
            None => scaling.nominal_v_per_g,
        };
        let g_per_code = scaling.instrument_v_per_code.to_f64() / k1.to_f64();
        let bias_g = match &calibration {
            Some(known) => known.coefficients.bias_g.to_f64(),
            None => 0.0,
        };
        let [i, p, o] = scaling.reference_g_per_code;
        let [zero_i, zero_p, zero_o] = scaling.reference_zero;
        Self {
            calibration,
            errors: StatedErrors::default(),
            temperature_c: None,
            source,
            mode,
            g_per_code,
            to_g: [T::lit(g_per_code), i, p, o],
            // The conversion saturates, as the channel does.
            zero: [(bias_g / g_per_code) as i32, zero_i, zero_p, zero_o],
        }
    }

    /// The same with errors that are stated, and the temperatures for which the coefficients hold.
    pub fn with_errors(self, errors: StatedErrors<T>, temperature_c: Option<[T; 2]>) -> Self {
        Self {
            errors,
            temperature_c,
            ..self
        }
    }

    /// Kelvin from the middle of the calibrated range, and whether that is outside. Where nobody measures, it may be
    /// anywhere inside.
    fn away_k(&self, temperature_c: Option<f32>) -> (T, bool) {
        let Some([low, high]) = self.temperature_c else {
            return (T::zero(), false);
        };
        let two = T::lit(2.0);
        let half = (high - low) / two;
        match temperature_c {
            Some(t) => {
                let away = (T::lit(f64::from(t)) - (low + high) / two).abs();
                (away, away > half)
            }
            None => (half, false),
        }
    }

    /// The codes that the moments' mean modulus is to be taken about: zero specific force on every channel.
    pub fn zero(&self) -> [i32; CHANNELS] {
        self.zero
    }

    /// The specific force on IA, g, that gives the output `u_g` = U/K1 with these on PA and OA: (1) inverted.
    #[inline]
    pub fn invert_g(&self, u_g: T, p_g: T, o_g: T) -> T {
        let Some(c) = &self.calibration else {
            return u_g;
        };
        // Two steps from U/K1 leave the square of the square of the nonlinearity.
        let step = |i: T| {
            let a = SpecificForce::new(i, p_g, o_g);
            i - (c.coefficients.error_g(a) + (i - u_g)) / c.coefficients.gradient(a).i
        };
        step(step(u_g))
    }

    /// What the inversion of (1) takes from the instrument's output of this sample, g; `bend` is by how much the step to it
    /// is less than the step before.
    #[inline]
    fn removed_g(&self, codes: [i32; CHANNELS], bend: [i32; CHANNELS]) -> T {
        // Codes have 24 bits: nothing wraps.
        let sharpened_g = |k: usize, zero: i32| {
            let x = T::from_i64(i64::from(codes[k].wrapping_sub(zero)));
            (x + T::lit(SHARPENING) * T::from_i64(i64::from(bend[k]))) * self.to_g[k]
        };
        let u_g = sharpened_g(0, 0);
        u_g - self.invert_g(
            u_g,
            sharpened_g(2, self.zero[2]),
            sharpened_g(3, self.zero[3]),
        )
    }

    /// How far the temperature is from that of the static test, K, and what surroundings, samples and reference say against the block.
    fn quality(&self, moments: &Moments<T>, state: &CompensatorState<T>) -> (T, u8) {
        let Surroundings {
            temperature_c,
            time_base_unsure,
        } = state.surroundings;
        let (away_k, outside) = self.away_k(temperature_c);
        let (min, max) = (moments.min(), moments.max());
        let reaches_end = |k: usize| min[k] < -FULL_SCALE || max[k] >= FULL_SCALE;
        let reference_clips = reaches_end(1) || reaches_end(2) || reaches_end(3);
        let lost = reference_clips || !self.compare(moments, state, !reaches_end(0)).agree();
        let said = [
            (outside, Quality::TEMPERATURE),
            (time_base_unsure, Quality::TIME_BASE),
            (reaches_end(0) || reference_clips, Quality::SATURATED),
            (lost, Quality::REFERENCE_LOST),
        ];
        let said = said.into_iter().filter(|(so, _)| *so);
        (away_k, said.fold(0, |all, (_, bit)| all | bit))
    }

    /// The block whose samples went into `moments` and `state`.
    fn block(&self, moments: &Moments<T>, state: &CompensatorState<T>) -> Compensated<T> {
        let (away_k, mut quality) = self.quality(moments, state);
        let lost = quality & Quality::REFERENCE_LOST != 0;
        let output_g = moments.sum()[0] as f64 / moments.count() as f64 * self.g_per_code;
        let mean_g = T::lit(output_g);
        let Some(calibration) = &self.calibration else {
            return Compensated::plain(output_g, quality | Quality::COEFFICIENTS_MISSING);
        };
        if usize::from(calibration.rank) < NOMINAL {
            quality |= Quality::PLAN_BLIND;
        }
        let own = lost || self.source == Source::Instrument;
        let channel = usize::from(!own);
        let droop = state.droop(channel, moments, self.to_g[channel]);
        let vibration = self.vibration(moments, state, channel, droop.gain);
        if droop.half_step > T::lit(HALF_STEP_LIMIT) {
            quality |= Quality::OUT_OF_BAND;
        }
        let transverse = if lost {
            [T::zero(); 2]
        } else {
            let about = moments.mean_about(self.zero);
            [about[2] * self.to_g[2], about[3] * self.to_g[3]]
        };
        let c = &calibration.coefficients;
        let mut a = SpecificForce::new(mean_g, transverse[0], transverse[1]);
        // What is to be taken from the output, so that a.i = mean_g - removed_g.
        let mut removed_g = T::zero();
        let settled = |correction: T, a: T| {
            correction.abs() <= T::epsilon() * T::lit(16.0) * (T::one() + a.abs())
        };
        let mut sensitivity = Sensitivity::new(a.i, vibration);
        let mut steps = 0;
        let vre_g = loop {
            let vre_g = sensitivity.vre_g(c);
            let correction = (c.error_g(a) + vre_g - removed_g) / c.gradient(a).i;
            removed_g += correction;
            a.i = mean_g - removed_g;
            if settled(correction, a.i) {
                break vre_g;
            }
            steps += 1;
            if steps == STEPS {
                quality |= Quality::NO_SOLUTION;
                break vre_g;
            }
            sensitivity = Sensitivity::new(a.i, vibration);
        };
        if self.mode == Mode::Pointwise && !lost {
            removed_g = state.removed_g / T::from_i64(moments.count() as i64);
        }
        let variance_g2 = sensitivity.variance_with_further_g2(&calibration.covariance);
        // Rounding makes a small one negative; what is no number stays so.
        let variance_g2 = if variance_g2 < T::zero() {
            T::zero()
        } else {
            variance_g2
        };
        let full_scale_g = T::lit(self.g_per_code * f64::from(FULL_SCALE));
        let stated_g2 = self.errors.variance_g2(a.i, away_k, full_scale_g);
        let sigma_g = (variance_g2 + stated_g2).sqrt();
        if !(removed_g.is_finite() && vre_g.is_finite() && sigma_g.is_finite()) {
            quality |= Quality::NO_SOLUTION;
        }
        if quality & Quality::NO_SOLUTION != 0 {
            return Compensated::plain(output_g, quality);
        }
        Compensated {
            specific_force_g: output_g - removed_g.to_f64(),
            vre_g,
            vre_sigma_g: variance_g2.sqrt(),
            sigma_g,
            quality: Quality(quality),
        }
    }

    /// What instrument and reference tell of the block.
    fn compare(
        &self,
        moments: &Moments<T>,
        state: &CompensatorState<T>,
        comparable: bool,
    ) -> Both<T> {
        let [to_g, reference_to_g, ..] = self.to_g;
        let [m2, reference_m2, ..] = moments.m2();
        let [instrument, reference, ..] = moments.mean_about(self.zero);
        Both {
            comparable,
            instrument_g: instrument * to_g,
            instrument_g2: m2 * to_g * to_g,
            reference_g: reference * reference_to_g,
            reference_g2: reference_m2 * reference_to_g * reference_to_g,
            felt_g2: state.felt_g2,
        }
    }

    /// Mean square of the reference over all axes, g^2.
    fn reference_mean_square_g2(&self, moments: &Moments<T>) -> T {
        let (about, m2) = (moments.mean_about(self.zero), moments.m2());
        let axis = |k: usize| (about[k] * about[k] + m2[k]) * self.to_g[k] * self.to_g[k];
        axis(1) + axis(2) + axis(3)
    }

    /// The vibration of a block in g, its droop corrected by `gain` (of squares).
    fn vibration(
        &self,
        moments: &Moments<T>,
        state: &CompensatorState<T>,
        channel: usize,
        gain: T,
    ) -> vibration::Moments<T> {
        let to_g = self.to_g[channel];
        let square = to_g * to_g * gain;
        let g = gain.sqrt();
        let m3_g3 = moments.m3()[channel] * square * to_g * g;
        let m2_g2 = moments.m2()[channel] * square;
        // M|x| - |M[x]| keeps its digits, both being about the same zero code; and M[x sign x - x0 sign x] is its
        // derivative by the vibration's amplitude, which the droop makes too small.
        let modulus = moments.mean_modulus()[channel];
        let offset = moments.mean_about(moments.zero())[channel];
        let (sign, signed_square) = state.kinked(channel, moments.count());
        let by_amplitude = modulus - offset * sign;
        let absolute = modulus - offset.abs() + (g - T::one()) * by_amplitude;
        let excess = KinkedMeans {
            sign,
            absolute_g: absolute * to_g,
            signed_square_g2: (signed_square - offset * offset.abs()) * to_g * to_g,
        };
        let [_, _, p, o] = self.to_g;
        let ([ip, io, po], [m2_p, m2_o]) = if channel == 0 {
            ([T::zero(); 3], [T::zero(); 2])
        } else {
            let [_, _, m2 @ ..] = moments.m2();
            (moments.reference_cross(), m2)
        };
        let m4_g4 = moments.m4()[channel] * square * square;
        // Nobody measures the fifth moment. This is that of a sine with a little second harmonic, and of a skewed Gaussian:
        // m5 / (m3 m2) is 10/3 for the first (m4 = 3/2 m2^2) and 10 for the second (m4 = 3 m2^2).
        let per_m3 = T::lit(40.0 / 9.0) * m4_g4 / m2_g2.max(T::min_positive_value())
            - T::lit(10.0 / 3.0) * m2_g2;
        vibration::Moments {
            m2_g2,
            m3_g3,
            m4_g4,
            m5_g5: m3_g3 * per_m3,
            cross_ip_g2: ip * to_g * p * gain,
            cross_io_g2: io * to_g * o * gain,
            cross_po_g2: po * p * o * gain,
            m2_p_g2: m2_p * p * p * gain,
            m2_o_g2: m2_o * o * o * gain,
            kinked: Kinked::Measured(excess),
        }
    }
}

/// What a block gathers beside its moments.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CompensatorState<T> {
    /// Of the instrument and the reference's I.
    gathered: [Gathered; 2],
    /// False before the first sample after a gap, to which no step leads.
    continues: bool,
    /// How many such samples there were.
    first: u32,
    /// Point by point only.
    course: Course,
    /// What point-wise inversion took out, summed over the block, g.
    removed_g: T,
    surroundings: Surroundings,
    felt: Felt<T>,
    felt_g2: T,
}

/// How the codes went until the last sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Course {
    /// The last sample.
    last: [i32; CHANNELS],
    /// The step to it.
    step: [i32; CHANNELS],
    /// Samples since a gap, up to two: without two before it, a sample has no bend.
    samples: u8,
}

impl Course {
    /// Goes on to this sample: by how much the step to it is less than the step before.
    #[inline]
    fn bend(&mut self, codes: [i32; CHANNELS]) -> [i32; CHANNELS] {
        let step = from_fn(|k| codes[k].wrapping_sub(self.last[k]));
        let before = replace(&mut self.step, step);
        self.last = codes;
        if self.samples == 2 {
            return from_fn(|k| before[k].wrapping_sub(step[k]));
        }
        self.samples += 1;
        [0; CHANNELS]
    }
}

/// What a block gathers of one channel. The codes have 24 bits and a block less than 2^16 samples: no sum overflows, but of
/// codes that are all at one end of the range with their zero at the other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Gathered {
    /// The last code.
    last: i32,
    /// The step to it.
    step: i32,
    /// Sum of the squared steps, codes^2.
    squared_steps: u64,
    /// Sum of x|x|, x being the sharpened distance from the zero code, codes^2.
    signed_squares: i64,
    /// How often it is negative.
    below: u32,
}

impl Gathered {
    #[inline(always)]
    fn push(&mut self, code: i32, zero: i32) {
        let product = |x: i32, y: i32| i64::from(x).wrapping_mul(i64::from(y));
        let step = code.wrapping_sub(self.last);
        let x = code.wrapping_sub(zero);
        let sharpened = x.wrapping_add(self.step.wrapping_sub(step) >> SHARPENING_SHIFT);
        (self.last, self.step) = (code, step);
        self.squared_steps = self.squared_steps.wrapping_add(product(step, step) as u64);
        let signed_square = product(sharpened, sharpened.wrapping_abs());
        self.signed_squares = self.signed_squares.wrapping_add(signed_square);
        self.below += u32::from(sharpened < 0);
    }

    /// Takes codes one after the other, the sums in registers.
    #[inline]
    fn extend(&mut self, codes: impl Iterator<Item = i32>, zero: i32) {
        let mut gathered = *self;
        codes.for_each(|code| gathered.push(code, zero));
        *self = gathered;
    }

    fn next_block(&mut self) {
        *self = Self {
            last: self.last,
            step: self.step,
            ..Self::default()
        };
    }
}

/// The converter's droop over a block.
struct Droop<T> {
    /// What squares of the vibration are to be multiplied with.
    gain: T,
    /// Mean square of half the step from sample to sample over the variance: sin^2(pi f / rate) of a sine.
    half_step: T,
}

impl<T: Real> CompensatorState<T> {
    /// Before the first sample.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes samples of four codes, one after the other.
    pub fn extend(&mut self, compensator: &Compensator<T>, samples: &[[i32; CHANNELS]]) {
        let Some(first) = samples.first() else {
            return;
        };
        if !self.continues {
            self.continues = true;
            self.first += 1;
            // As if it had stood still.
            for (gathered, code) in self.gathered.iter_mut().zip(first) {
                (gathered.last, gathered.step) = (*code, 0);
            }
        }
        if compensator.mode == Mode::Pointwise {
            for sample in samples {
                let bend = self.course.bend(*sample);
                self.removed_g += compensator.removed_g(*sample, bend);
            }
        }
        let [instrument, reference] = &mut self.gathered;
        instrument.extend(samples.iter().map(|s| s[0]), compensator.zero[0]);
        reference.extend(samples.iter().map(|s| s[1]), compensator.zero[1]);
    }

    /// Forgets the last samples: what follows comes after a gap.
    pub fn interrupt(&mut self) {
        self.continues = false;
        self.course.samples = 0;
    }

    /// What the blocks from here on are measured under.
    pub fn set_surroundings(&mut self, surroundings: Surroundings) {
        self.surroundings = surroundings;
    }

    /// Ends the block whose samples went into `moments`, and begins the next.
    pub fn close(&mut self, compensator: &Compensator<T>, moments: &Moments<T>) -> Compensated<T> {
        let felt_g2 = compensator.reference_mean_square_g2(moments);
        self.felt_g2 = self.felt.absorb(felt_g2, moments.count());
        let block = compensator.block(moments, self);
        self.gathered.iter_mut().for_each(Gathered::next_block);
        self.first = 0;
        self.removed_g = T::zero();
        block
    }

    /// Means of the sign of a channel's sharpened distance from its zero code, and of its square with that sign, codes^2.
    fn kinked(&self, channel: usize, count: u64) -> (T, T) {
        let count = count as i64;
        let gathered = &self.gathered[channel];
        let signs = count - 2 * i64::from(gathered.below);
        let mean = |sum: i64| T::from_i64(sum) / T::from_i64(count);
        (mean(signs), mean(gathered.signed_squares))
    }

    /// A sine of frequency f passes the sinc3 filter as (sin x / x)^3, x = pi f / rate, and sin^2 x is `half_step`.
    /// 1 / sinc^2 = (asin s / s)^2 = 1 + s^2/3 + 8 s^4/45 + 4 s^6/35 + ..., which is exact for a sine, and for a wider
    /// spectrum to the first order in its mean square frequency.
    ///
    /// An axis that is quiet tells no frequency, and the noise of its codes would be taken for one: no correction then.
    fn droop(&self, channel: usize, moments: &Moments<T>, to_g: T) -> Droop<T> {
        let variance = moments.m2()[channel];
        if variance * to_g * to_g < T::lit(QUIET_RMS_G * QUIET_RMS_G) {
            return Droop {
                gain: T::one(),
                half_step: T::zero(),
            };
        }
        let steps = moments.count().saturating_sub(u64::from(self.first)).max(1);
        let squared_steps = self.gathered[channel].squared_steps.min(i64::MAX as u64);
        let mean_square_step = T::from_i64(squared_steps as i64) / T::from_i64(steps as i64);
        let half_step = (mean_square_step / (T::lit(4.0) * variance)).min(T::one());
        let s2 = half_step.min(T::lit(0.5));
        let gain = T::one()
            + s2 * (T::lit(1.0 / 3.0) + s2 * (T::lit(8.0 / 45.0) + s2 * T::lit(4.0 / 35.0)));
        Droop {
            gain: gain * gain * gain,
            half_step,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sharpening_undoes_the_droop_in_the_claimed_band_and_moves_no_wave() {
        let top = core::f64::consts::PI * CLAIMED_BAND;
        let eighth = 0.5f64.powi(SHARPENING_SHIFT as i32);
        for (part, (h, most)) in
            (1..=100).flat_map(|part| [(part, (SHARPENING, 7e-4)), (part, (eighth, 4e-3))])
        {
            let x = top * f64::from(part) / 100.0;
            let (sin, cos) = (2.0 * x).sin_cos();
            let bend = 4.0 * h * x.sin().powi(2);
            let (re, im) = (1.0 + bend * cos, -bend * sin);
            let left = (x.sin() / x).powi(6) * (re * re + im * im) - 1.0;
            assert!(left.abs() < most, "{h}, {part} %: {left:e}");
            let samples = im.atan2(re) / (2.0 * x);
            assert!(samples.abs() < 0.02, "{part} %: {samples}");
        }
        assert!((HALF_STEP_LIMIT / top.sin().powi(2) - 1.0).abs() < 1e-15);
    }
}
