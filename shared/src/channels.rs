//! The converter's four simultaneous channels, and a block of their samples as it is told and kept.
//!
//! These are the types that the mathematics and the messages have in common. Their fields are what goes over the
//! line: never moved, changed or removed.

use serde::{Deserialize, Serialize};

/// Simultaneous channels of the converter: 0 the instrument, 1 to 3 the reference's I, P and O.
pub const CHANNELS: usize = 4;

/// One plateau of a shaker run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Run {
    /// Number of the run, the column `run` of `vibration.csv`.
    pub run: u32,
    /// Which plateau.
    pub plateau: Plateau,
}

/// The three plateaus of a shaker run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Plateau {
    /// Standing still, before.
    Before,
    /// Vibrating.
    During,
    /// Standing still, after.
    After,
}

/// What the samples belong to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Segment {
    /// Nothing that anyone asked for.
    #[default]
    Idle,
    /// The reading of that number.
    Reading(u32),
    /// A plateau of a shaker run.
    Run(Run),
}

/// Moments of the samples `first_sample .. first_sample + count + lost`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// What the samples belong to.
    pub segment: Segment,
    /// Index of the block's first sample.
    pub first_sample: u64,
    /// Samples that the moments are of.
    pub count: u32,
    /// Conversions of this stretch that were lost.
    pub lost: u32,
    /// Their moments.
    pub moments: BlockMoments,
}

/// Moments of a block, in codes. The sums are exact, so that blocks merge without any loss in the mean; the
/// central moments divide by the count and are about the block's own mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BlockMoments {
    /// Sum of the codes.
    pub sum: [i64; CHANNELS],
    /// Second central moment, codes^2.
    pub second: [f32; CHANNELS],
    /// Third central moment, codes^3.
    pub third: [f32; CHANNELS],
    /// Fourth central moment, codes^4.
    pub fourth: [f32; CHANNELS],
    /// Central cross-moments, codes^2, of the channels 0-1, 0-2, 0-3, 1-2, 1-3, 2-3.
    pub cross: [f32; 6],
    /// Smallest code.
    pub minimum: [i32; CHANNELS],
    /// Largest code.
    pub maximum: [i32; CHANNELS],
    /// The codes of zero specific force; the coefficients' bias tells that of channel 0.
    pub zero: [i32; CHANNELS],
    /// Sum of the codes' distances from [`Self::zero`].
    pub modulus: [u64; CHANNELS],
}
