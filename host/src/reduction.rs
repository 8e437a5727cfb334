//! From the instrument's events to the figures of a campaign's rows: for each dial reading and each plateau of a
//! shaker run the mean output with its uncertainty, and the moments that the reference saw.
//!
//! Blocks arrive every few milliseconds; their sums are exact and merge without loss. What is kept of a segment is
//! constant however long it lasts.

use std::collections::BTreeMap;

use shared::moments::{Moments, MomentsError};
use shared::slope::{SlopeError, Trace};
use shared::wire::message::{Block, Event, Identity, Plateau, Segment};

/// Why a record's events do not make a campaign.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ReductionError {
    /// A block's moments cannot be.
    #[error("{0}")]
    Moments(#[from] MomentsError),
    /// A segment is too short for an uncertainty.
    #[error("{0}")]
    Slope(#[from] SlopeError),
    /// The instrument never said who it is: its codes have no unit.
    #[error("the instrument never says who it is, so that its codes have no unit")]
    NoIdentity,
    /// Two instruments speak in one record.
    #[error("the events are of two different instruments")]
    TwoInstruments,
}

/// A number for each segment that has one, in the order in which a campaign lists them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Reading(u32),
    Run(u32, u8),
}

impl Key {
    fn new(segment: Segment) -> Option<Self> {
        match segment {
            Segment::Idle => None,
            Segment::Reading(reading) => Some(Self::Reading(reading)),
            Segment::Run(run) => Some(Self::Run(run.run, run.plateau as u8)),
        }
    }
}

/// What all blocks of one segment come to.
#[derive(Clone, Debug)]
pub struct SegmentSums {
    /// Moments of its samples, codes.
    pub moments: Moments<f64>,
    /// Blocks that had samples.
    blocks: u64,
    /// Blocks that it is going to have; 0 if nobody has said.
    expected: u64,
    /// Mean code of the instrument's channel block by block, by quarters of the blocks expected.
    quarters: [Trace; 4],
}

/// Everything that events have told so far.
#[derive(Clone, Debug, Default)]
pub struct Reduction {
    identity: Option<Identity>,
    segments: BTreeMap<Key, SegmentSums>,
    /// Blocks that segments are going to have, so that quarters are known while they last.
    expected: BTreeMap<Key, u64>,
}

impl Reduction {
    /// A segment begins, also once more, and is going to have so many blocks: quarters, and with them noise and drift, are
    /// known only of segments that were announced before their first block.
    pub fn expect(&mut self, segment: Segment, blocks: u64) {
        if let Some(key) = Key::new(segment) {
            self.segments.remove(&key);
            self.expected.insert(key, blocks);
        }
    }

    /// Takes an event; other than blocks and identities they change nothing.
    ///
    /// # Errors
    /// [`ReductionError`]; what came before stays.
    pub fn absorb(&mut self, event: &Event<'_>) -> Result<(), ReductionError> {
        match event {
            Event::Hello(identity) => match &self.identity {
                Some(known) if known.serial != identity.serial => {
                    Err(ReductionError::TwoInstruments)
                }
                _ => {
                    self.identity = Some(*identity);
                    Ok(())
                }
            },
            Event::Block(block) => self.absorb_block(block),
            _ => Ok(()),
        }
    }

    fn absorb_block(&mut self, block: &Block) -> Result<(), ReductionError> {
        let Some(key) = Key::new(block.segment) else {
            return Ok(());
        };
        if block.count == 0 {
            return Ok(());
        }
        let moments = Moments::<f64>::from_block(block)?;
        let mean = moments.mean()[0];
        let segment = match self.segments.entry(key) {
            std::collections::btree_map::Entry::Occupied(known) => {
                let segment = known.into_mut();
                segment.moments.merge(&moments)?;
                segment
            }
            std::collections::btree_map::Entry::Vacant(new) => new.insert(SegmentSums {
                moments,
                blocks: 0,
                expected: self.expected.get(&key).copied().unwrap_or(0),
                quarters: std::array::from_fn(|_| Trace::new()),
            }),
        };
        let quarter = (4 * segment.blocks).checked_div(segment.expected);
        if let Some(trace) = quarter.and_then(|q| segment.quarters.get_mut(q as usize)) {
            trace.push(mean)?;
        }
        segment.blocks += 1;
        Ok(())
    }

    /// Who the instrument is, if it has said so.
    pub fn identity(&self) -> Option<&Identity> {
        self.identity.as_ref()
    }

    /// Volts per code of a channel.
    ///
    /// # Errors
    /// [`ReductionError::NoIdentity`].
    pub fn volts_per_code(&self, channel: usize) -> Result<f64, ReductionError> {
        let identity = self.identity.as_ref().ok_or(ReductionError::NoIdentity)?;
        let gain = f64::from(identity.gains[channel]);
        Ok(identity.reference_v / gain / f64::from(1 << 23))
    }

    /// Whether anything was heard of a reading or a run.
    pub fn has_segments(&self) -> bool {
        !self.segments.is_empty()
    }

    /// The sums of a dial reading.
    pub fn reading(&self, number: u32) -> Option<&SegmentSums> {
        self.segments.get(&Key::Reading(number))
    }

    /// The sums of a plateau of a shaker run.
    pub fn plateau(&self, run: u32, plateau: Plateau) -> Option<&SegmentSums> {
        self.segments.get(&Key::Run(run, plateau as u8))
    }
}

impl SegmentSums {
    /// Blocks that had samples.
    pub fn blocks(&self) -> u64 {
        self.blocks
    }

    /// Mean code of the instrument's channel in the second half less that in the first; its variance over segments at rest is four times that
    /// of a segment's mean, whatever is slower than white noise included. `None` of a segment that ended too early.
    pub fn half_difference(&self) -> Option<f64> {
        let [a, b, c, d] = &self.quarters;
        Some(0.5 * (c.mean()? + d.mean()? - a.mean()? - b.mean()?))
    }

    /// (Level at the end - level at the start) / duration, and its standard uncertainty, codes/s: from the lines fitted to the
    /// integrals of the first and the last quarter, which keep the vibration out. `duration_s` is that of the segment.
    ///
    /// # Errors
    /// [`SlopeError::TooShort`].
    pub fn drift_per_s(&self, duration_s: f64) -> Result<(f64, f64), SlopeError> {
        let [first, .., last] = &self.quarters;
        let (first, last) = (
            first.line_fit_estimate(first.count())?,
            last.line_fit_estimate(last.count())?,
        );
        // The quarters' centres are three quarters of the duration apart.
        let apart_s = 0.75 * duration_s;
        Ok((
            (last.value - first.value) / apart_s,
            first.sigma.hypot(last.sigma) / apart_s,
        ))
    }

    /// Root mean square (codes), third and fourth standardized moments of a channel; the moments are 0 where it stands
    /// still.
    pub fn shape(&self, channel: usize) -> (f64, f64, f64) {
        let (m2, m3, m4) = (
            self.moments.m2()[channel],
            self.moments.m3()[channel],
            self.moments.m4()[channel],
        );
        if m2 > 0.0 {
            (m2.sqrt(), m3 / m2.powf(1.5), m4 / (m2 * m2))
        } else {
            (0.0, 0.0, 0.0)
        }
    }

    /// Correlation coefficients of the reference: I-P, I-O, P-O.
    pub fn reference_correlation(&self) -> [f64; 3] {
        let (m2, cross) = (self.moments.m2(), self.moments.reference_cross());
        let pairs = [(1, 2), (1, 3), (2, 3)];
        std::array::from_fn(|k| {
            let (i, j) = pairs[k];
            let product = m2[i] * m2[j];
            if product > 0.0 {
                cross[k] / product.sqrt()
            } else {
                0.0
            }
        })
    }
}
