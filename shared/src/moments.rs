//! Streaming, mergeable moments of the converter's four simultaneous channels: what the moment form
//! of (2) asks for, without keeping a sample.
//!
//! A sample is one instant of four channels, `[i32; 4]`: the instrument, then the reference's I, P
//! and O. Codes are raw converter codes of 24 bits; scale factors come later.
//!
//! The integer sum makes the mean exact. Powers are summed over sub-blocks of at most [`SUB_BLOCK`]
//! samples about their first sample. An origin that belongs to the sub-block bounds the
//! cancellation whatever the signal: its own distance from the mean counts among the samples.
//! Sub-blocks are joined by the formulas of Chan, Golub and LeVeque (1983) and Pébay (SAND2008-6212).
//!
//! `f32` is good enough for a block on the instrument: every moment is true to 2e-5 of the absolute
//! moment of its order (1e-4 for a million samples, 1e-3 if impulses of a hundred standard deviations
//! come first in a sub-block), far below what the vibration's own randomness does to a block. The
//! host merges and compares, and takes `f64`, true to 1e-13 (1e-12). `shared/tests/moments.rs` proves
//! it against two passes over the samples.

use core::array::from_fn;

use crate::channels::{Block, BlockMoments};
use crate::scalar::Real;

pub use crate::channels::CHANNELS;

/// Samples gathered about one origin; up to 128 differences of 24-bit codes fit an `i32`.
pub const SUB_BLOCK: usize = 64;

/// Samples that [`Accumulator::extend`] takes at once, channel by channel, so that a channel's sums stay in registers.
const RUN: usize = 16;

/// The most samples that one [`Moments`] holds (12 days at 32 kSPS); integer sums stay below 2^60.
pub const MAX_SAMPLES: u64 = 1 << 35;

/// Pairs of channels in the order of [`Moments::cross`].
pub const PAIRS: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];

/// Why moments cannot be joined or taken over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MomentsError {
    /// Together they would hold more than [`MAX_SAMPLES`].
    TooLong {
        /// The number of samples that was refused.
        count: u64,
    },
    /// Their mean moduli are about different zero codes.
    DifferentZero {
        /// Zero codes of the one.
        left: [i32; CHANNELS],
        /// Zero codes of the other.
        right: [i32; CHANNELS],
    },
    /// A block from the link whose figures no samples can have.
    Impossible {
        /// Index of the block's first sample.
        first_sample: u64,
    },
}

impl core::fmt::Display for MomentsError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TooLong { count } => {
                write!(
                    f,
                    "{count} samples are more than a block holds ({MAX_SAMPLES})"
                )
            }
            Self::DifferentZero { left, right } => {
                write!(f, "zero codes differ: {left:?} and {right:?}")
            }
            Self::Impossible { first_sample } => {
                write!(
                    f,
                    "the block at sample {first_sample} has moments that no samples can have"
                )
            }
        }
    }
}

impl core::error::Error for MomentsError {}

/// Moments of one or more samples, in codes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments<T> {
    count: u64,
    zero: [i32; CHANNELS],
    /// A code near the mean; keeps the mean's fraction when `T` is `f32`.
    origin: [i32; CHANNELS],
    sum: [i64; CHANNELS],
    /// Sums of powers 2, 3, 4 of the differences from the mean.
    central: [[T; CHANNELS]; 3],
    cross: [T; PAIRS.len()],
    min: [i32; CHANNELS],
    max: [i32; CHANNELS],
    modulus: [u64; CHANNELS],
}

impl<T: Real> Moments<T> {
    /// Number of samples, at least 1.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Sum of the codes of each channel, exact.
    pub fn sum(&self) -> [i64; CHANNELS] {
        self.sum
    }

    /// The zero codes of [`Self::mean_modulus`].
    pub fn zero(&self) -> [i32; CHANNELS] {
        self.zero
    }

    /// Mean code of each channel.
    pub fn mean(&self) -> [T; CHANNELS] {
        self.mean_about([0; CHANNELS])
    }

    /// Mean less a given code: a small difference keeps its digits even in `f32`.
    pub fn mean_about(&self, code: [i32; CHANNELS]) -> [T; CHANNELS] {
        let n = self.n();
        let whole = self.count as i64;
        from_fn(|k| T::from_i64(self.sum[k] - i64::from(code[k]) * whole) / n)
    }

    /// Second central moment M[(x - mean)^2], codes^2; divides by the count, not by count - 1.
    #[doc(alias = "variance")]
    pub fn m2(&self) -> [T; CHANNELS] {
        self.central[0].map(|s| s / self.n())
    }

    /// Third central moment, codes^3.
    pub fn m3(&self) -> [T; CHANNELS] {
        self.central[1].map(|s| s / self.n())
    }

    /// Fourth central moment, codes^4.
    pub fn m4(&self) -> [T; CHANNELS] {
        self.central[2].map(|s| s / self.n())
    }

    /// Central cross-moments M[(x - mean)(y - mean)], codes^2, in the order of [`PAIRS`].
    pub fn cross(&self) -> [T; PAIRS.len()] {
        self.cross.map(|s| s / self.n())
    }

    /// Cross-moments of the reference, codes^2: c_IP, c_IO, c_PO.
    #[doc(alias("c_IP", "c_IO", "c_PO"))]
    pub fn reference_cross(&self) -> [T; 3] {
        let cross = self.cross();
        [cross[3], cross[4], cross[5]]
    }

    /// Smallest code of each channel.
    pub fn min(&self) -> [i32; CHANNELS] {
        self.min
    }

    /// Largest code of each channel.
    pub fn max(&self) -> [i32; CHANNELS] {
        self.max
    }

    /// Sum of the distances of the codes from the zero codes, exact.
    pub fn modulus_sum(&self) -> [u64; CHANNELS] {
        self.modulus
    }

    /// M|x - zero|, codes.
    #[doc(alias = "M|a|")]
    pub fn mean_modulus(&self) -> [T; CHANNELS] {
        // At most 2^24 * MAX_SAMPLES = 2^59: fits an i64.
        self.modulus.map(|s| T::from_i64(s as i64) / self.n())
    }

    /// Joins the samples of another set to these (Chan, Golub and LeVeque; Pébay (2.9), (3.1)).
    ///
    /// # Errors
    /// [`MomentsError`], and then nothing has changed.
    pub fn merge(&mut self, other: &Self) -> Result<(), MomentsError> {
        if self.zero != other.zero {
            return Err(MomentsError::DifferentZero {
                left: self.zero,
                right: other.zero,
            });
        }
        let count = self.count + other.count;
        if count > MAX_SAMPLES {
            return Err(MomentsError::TooLong { count });
        }
        let n = T::from_i64(count as i64);
        let (pa, pb) = (self.n() / n, other.n() / n);
        let weight = self.n() * pb;
        let (fa, fb) = (self.mean_about(self.origin), other.mean_about(other.origin));
        let delta: [T; CHANNELS] = from_fn(|k| {
            T::from_i64(i64::from(other.origin[k]) - i64::from(self.origin[k])) + (fb[k] - fa[k])
        });
        let (three, four, six) = (T::lit(3.0), T::lit(4.0), T::lit(6.0));
        let (skew, kurtosis) = (pa - pb, pa * pa - pa * pb + pb * pb);
        for (k, &d) in delta.iter().enumerate() {
            let [a2, a3, a4] = [self.central[0][k], self.central[1][k], self.central[2][k]];
            let [b2, b3, b4] = [
                other.central[0][k],
                other.central[1][k],
                other.central[2][k],
            ];
            let d2 = d * d * weight;
            self.central[0][k] = a2 + b2 + d2;
            self.central[1][k] = a3 + b3 + d * (d2 * skew + three * (pa * b2 - pb * a2));
            self.central[2][k] = a4
                + b4
                + d * (d * (d2 * kurtosis + six * (pa * pa * b2 + pb * pb * a2))
                    + four * (pa * b3 - pb * a3));
            self.sum[k] += other.sum[k];
            self.modulus[k] += other.modulus[k];
            self.min[k] = self.min[k].min(other.min[k]);
            self.max[k] = self.max[k].max(other.max[k]);
        }
        for (p, (i, j)) in PAIRS.into_iter().enumerate() {
            self.cross[p] += other.cross[p] + delta[i] * delta[j] * weight;
        }
        self.count = count;
        Ok(())
    }

    /// The moments that a block from the link carries.
    ///
    /// # Errors
    /// [`MomentsError::Impossible`] for no samples at all, a sum, an extreme or a zero beyond 24-bit codes, a
    /// negative even moment, or what is not finite.
    pub fn from_block(block: &Block) -> Result<Self, MomentsError> {
        let wire = &block.moments;
        let n = u64::from(block.count);
        let whole = |k: usize| {
            let reach = i64::from(block.count) << 23;
            n > 0
                && (-reach..=reach).contains(&wire.sum[k])
                && wire.modulus[k] <= n << 24
                && code24(wire.zero[k]) == wire.zero[k]
                && wire.minimum[k] <= wire.maximum[k]
                && code24(wire.minimum[k]) == wire.minimum[k]
                && code24(wire.maximum[k]) == wire.maximum[k]
                && wire.second[k] >= 0.0
                && wire.fourth[k] >= 0.0
        };
        let central = [wire.second, wire.third, wire.fourth];
        let finite = central
            .iter()
            .flatten()
            .chain(&wire.cross)
            .all(|s| s.is_finite());
        if !(finite && (0..CHANNELS).all(whole)) {
            return Err(MomentsError::Impossible {
                first_sample: block.first_sample,
            });
        }
        let whole = T::from_i64(n as i64);
        let sum_of = |mean: f32| T::lit(f64::from(mean)) * whole;
        Ok(Self {
            count: n,
            zero: wire.zero,
            origin: wire.sum.map(|sum| (sum / n as i64) as i32),
            sum: wire.sum,
            central: central.map(|order| order.map(sum_of)),
            cross: wire.cross.map(sum_of),
            min: wire.minimum,
            max: wire.maximum,
            modulus: wire.modulus,
        })
    }

    /// As a block carries them.
    pub fn to_wire(&self) -> BlockMoments {
        let narrow = |s: T| s.to_f64() as f32;
        BlockMoments {
            sum: self.sum,
            second: self.m2().map(narrow),
            third: self.m3().map(narrow),
            fourth: self.m4().map(narrow),
            cross: self.cross().map(narrow),
            minimum: self.min,
            maximum: self.max,
            zero: self.zero,
            modulus: self.modulus,
        }
    }

    fn n(&self) -> T {
        T::from_i64(self.count as i64)
    }
}

/// Gathers [`Moments`] slice by slice; constant memory, no division per sample.
///
/// Codes are cut to their low 24 bits with sign, as on the converter's bus, so no integer can
/// overflow whatever comes in.
#[derive(Debug, Clone)]
pub struct Accumulator<T> {
    zero: [i32; CHANNELS],
    sums: Sums<T>,
    closed: Option<Moments<T>>,
}

impl<T: Real> Accumulator<T> {
    /// An empty accumulator; `zero` are the codes of zero specific force, for the mean modulus.
    pub fn new(zero: [i32; CHANNELS]) -> Self {
        let zero = zero.map(code24);
        Self {
            zero,
            sums: Sums::new(),
            closed: None,
        }
    }

    /// Number of samples since the block began.
    pub fn count(&self) -> u64 {
        self.closed.map_or(0, |m| m.count) + u64::from(self.sums.count.unsigned_abs())
    }

    /// Takes samples. In how many pieces they come changes not one bit.
    ///
    /// # Errors
    /// [`MomentsError::TooLong`] if the block is full; the last [`SUB_BLOCK`] samples are dropped.
    pub fn extend(&mut self, mut samples: &[[i32; CHANNELS]]) -> Result<(), MomentsError> {
        while !samples.is_empty() {
            let room = SUB_BLOCK - self.sums.count.unsigned_abs() as usize;
            let (now, later) = samples.split_at(room.min(RUN).min(samples.len()));
            self.sums.extend(now, &self.zero);
            samples = later;
            if now.len() == room {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// The moments since the block began, `None` if there was no sample; a new block begins.
    ///
    /// # Errors
    /// As for [`Self::extend`].
    pub fn close(&mut self) -> Result<Option<Moments<T>>, MomentsError> {
        self.flush()?;
        Ok(self.closed.take())
    }

    fn flush(&mut self) -> Result<(), MomentsError> {
        let Some(sub_block) = self.sums.moments(self.zero) else {
            return Ok(());
        };
        self.sums = Sums::new();
        match &mut self.closed {
            Some(closed) => closed.merge(&sub_block),
            None => {
                self.closed = Some(sub_block);
                Ok(())
            }
        }
    }
}

/// The low 24 bits with their sign.
#[inline]
fn code24(code: i32) -> i32 {
    (code << 8) >> 8
}

/// Power sums of at most [`SUB_BLOCK`] samples about an integer origin.
#[derive(Debug, Clone)]
struct Sums<T> {
    count: i32,
    origin: [i32; CHANNELS],
    first: [i32; CHANNELS],
    powers: [[T; CHANNELS]; 3],
    /// Products of the pairs 0-1, 1-2, 2-3, 3-0.
    ring: [T; CHANNELS],
    /// Products of the pairs 0-2, 1-3.
    opposite: [T; 2],
    min: [i32; CHANNELS],
    max: [i32; CHANNELS],
    /// Sums of what the samples are below the zero codes: one instruction less than their distance.
    below: [i32; CHANNELS],
}

impl<T: Real> Sums<T> {
    fn new() -> Self {
        Self {
            count: 0,
            origin: [0; CHANNELS],
            first: [0; CHANNELS],
            powers: [[T::zero(); CHANNELS]; 3],
            ring: [T::zero(); CHANNELS],
            opposite: [T::zero(); 2],
            min: [i32::MAX; CHANNELS],
            max: [i32::MIN; CHANNELS],
            below: [0; CHANNELS],
        }
    }

    /// Takes at most [`RUN`] samples, channel by channel and then pair by pair; the very first becomes the origin.
    fn extend(&mut self, samples: &[[i32; CHANNELS]], zero: &[i32; CHANNELS]) {
        if let (0, Some(first)) = (self.count, samples.first()) {
            self.origin = first.map(code24);
        }
        self.count += samples.len() as i32;
        let mut d = [[T::zero(); RUN]; CHANNELS];
        for k in 0..CHANNELS {
            self.extend_channel(k, samples, zero[k], &mut d[k]);
        }
        let [a, b, c, e] = d.each_ref().map(|d| &d[..samples.len().min(RUN)]);
        for (sum, (x, y)) in self.ring.iter_mut().zip([(a, b), (b, c), (c, e), (e, a)]) {
            add_products(sum, x, y);
        }
        for (sum, (x, y)) in self.opposite.iter_mut().zip([(a, c), (b, e)]) {
            add_products(sum, x, y);
        }
    }

    /// Takes one channel of the samples; gives their differences from the origin.
    #[inline(always)]
    fn extend_channel(
        &mut self,
        k: usize,
        samples: &[[i32; CHANNELS]],
        zero: i32,
        differences: &mut [T; RUN],
    ) {
        let origin = self.origin[k];
        let (mut first, mut below) = (self.first[k], self.below[k]);
        let (mut min, mut max) = (self.min[k], self.max[k]);
        let [mut second, mut third, mut fourth] = self.powers.each_ref().map(|power| power[k]);
        for (sample, d) in samples.iter().zip(differences) {
            let code = code24(sample[k]);
            let difference = code - origin;
            first += difference;
            below += (code - zero).min(0);
            min = min.min(code);
            max = max.max(code);
            *d = T::from_i64(i64::from(difference));
            let square = *d * *d;
            second += square;
            third += square * *d;
            fourth += square * square;
        }
        (self.first[k], self.below[k]) = (first, below);
        (self.min[k], self.max[k]) = (min, max);
        for (power, sum) in self.powers.iter_mut().zip([second, third, fourth]) {
            power[k] = sum;
        }
    }

    /// Central moments of what was gathered, `None` if nothing was.
    fn moments(&self, zero: [i32; CHANNELS]) -> Option<Moments<T>> {
        if self.count == 0 {
            return None;
        }
        let n = T::from_i64(i64::from(self.count));
        let (two, three, four, six) = (T::lit(2.0), T::lit(3.0), T::lit(4.0), T::lit(6.0));
        let mut moments = Moments {
            count: u64::from(self.count.unsigned_abs()),
            zero,
            origin: self.origin,
            sum: [0; CHANNELS],
            central: self.powers,
            cross: [T::zero(); PAIRS.len()],
            min: self.min,
            max: self.max,
            modulus: [0; CHANNELS],
        };
        let offset = self.first.map(|s| T::from_i64(i64::from(s)) / n);
        for (k, &m) in offset.iter().enumerate() {
            let first = i64::from(self.first[k]);
            moments.sum[k] = first + i64::from(self.origin[k]) * i64::from(self.count);
            // |x| is x less twice its negative part.
            let sum = moments.sum[k] - i64::from(zero[k]) * i64::from(self.count);
            moments.modulus[k] = (sum - 2 * i64::from(self.below[k])).unsigned_abs();
            let [s2, s3, s4] = [self.powers[0][k], self.powers[1][k], self.powers[2][k]];
            moments.central[0][k] = s2 - n * m * m;
            moments.central[1][k] = s3 - m * (three * s2 - two * n * m * m);
            moments.central[2][k] = s4 - m * (four * s3 - m * (six * s2 - three * n * m * m));
        }
        let ([ab, bc, cd, da], [ac, bd]) = (self.ring, self.opposite);
        let products = [ab, ac, da, bc, bd, cd];
        for (p, (i, j)) in PAIRS.into_iter().enumerate() {
            moments.cross[p] = products[p] - n * offset[i] * offset[j];
        }
        Some(moments)
    }
}

/// Adds the products of two channels.
#[inline(always)]
fn add_products<T: Real>(sum: &mut T, x: &[T], y: &[T]) {
    let mut all = *sum;
    for (x, y) in x.iter().zip(y) {
        all += *x * *y;
    }
    *sum = all;
}
