//! Rests in a continuous record: the triad is turned by hand and left alone.
//!
//! The record is cut into short blocks. Two thresholds are found from the record itself: how large the variance within a block
//! of a body at rest is, and how far the means of two such blocks that follow each other differ. A rest is a run of blocks that
//! keep both, less one block at either end, that does not creep from its first third to its last.
//!
//! The standard uncertainty of a mean is that of white noise times a factor of the whole record: how much more the blocks' means
//! scatter within rests than white noise would let them.

use std::path::Path;

use serde::Serialize;

use crate::campaign::TriadPosition;
use crate::error::{Error, Place, Problem};
use crate::import::{Columns, open};
use crate::median::median;

/// Length of a block, s.
const BLOCK_S: f64 = 0.25;
/// Least samples of a block.
const LEAST_SAMPLES: u32 = 8;
/// Gaussian deviates by which a block's variance, and a step of means, may be off at rest: one block in three million is.
const FAR: f64 = 5.0;

/// Variance of a sample of Gaussian noise over the true one that is exceeded as seldom as [`FAR`] standard deviations (Wilson and
/// Hilferty 1931).
fn greatest_ratio(degrees_of_freedom: f64) -> f64 {
    let spread = 2.0 / (9.0 * degrees_of_freedom);
    (1.0 - spread + FAR * spread.sqrt()).powi(3)
}
/// Blocks that set the first guess of the floor: this share of all, the quietest.
const QUIETEST: f64 = 0.1;
/// Passes in which the floor settles.
const PASSES: usize = 6;

/// One rest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rest {
    /// Its first and last second.
    pub from_s: f64,
    /// Its end, s.
    pub to_s: f64,
    /// Samples.
    pub samples: u64,
    /// Mean output of x, y, z, in the record's unit.
    pub mean: [f64; 3],
    /// Standard uncertainty of each, noise that is not white included.
    pub sigma: [f64; 3],
    /// Mean temperature, C.
    pub temp_c: Option<f64>,
}

/// The rests of a record, `vre-rests/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rests {
    /// Always `vre-rests/1`.
    pub format: &'static str,
    /// The rests in the order of time.
    pub rests: Vec<Rest>,
    /// Standard deviation of a sample at rest, x, y, z, in the record's unit.
    pub noise: [f64; 3],
    /// Greatest standard deviation within a block that counts as rest.
    pub greatest_noise: [f64; 3],
    /// Greatest step between the means of two blocks that counts as rest.
    pub greatest_step: [f64; 3],
    /// By how much the means of blocks scatter more than white noise would let them.
    pub noise_factor: [f64; 3],
    /// Length of the record, s.
    pub length_s: f64,
    /// Stretches that are long enough and still, and creep.
    pub creeping: usize,
    /// Stretches that are still and too short.
    pub too_short: usize,
}

#[derive(Clone, Copy, Debug)]
struct Block {
    index: i64,
    count: u32,
    mean: [f64; 3],
    variance: [f64; 3],
    temp_c: Option<f64>,
    from_s: f64,
    to_s: f64,
}

/// Finds the rests in a table of samples; `least_s` is the least length of a rest, s.
///
/// # Errors
/// A table that cannot be read, without time, or in which time goes backwards; one without any rest.
pub fn find(file: &Path, columns: &Columns, least_s: f64) -> Result<Rests, Error> {
    let mut row = open(file, columns, None)?;
    let mut blocks = Blocks::default();
    while row.advance()? {
        let time_s = row.time_s()?.ok_or_else(|| {
            Error::Usage("rests are found by time; name its column with --time".into())
        })?;
        let sample = [row.output(0)?, row.output(1)?, row.output(2)?];
        if blocks.add(time_s, sample, row.temperature_c()?).is_err() {
            let problem = Problem::Other(format!("time goes backwards to {time_s} s"));
            let place = Place {
                row: row.line(),
                column: columns.time.as_ref().map(|(name, _)| name.clone()),
                ..Place::file(file)
            };
            return Err(Error::Input { place, problem });
        }
    }
    let rests = of_blocks(&blocks.finish(), least_s);
    match rests {
        Some(rests) if !rests.rests.is_empty() => Ok(rests),
        Some(rests) => Err(Error::input(
            file,
            format!(
                "has no rest of {least_s} s or more in {:.0} s; leave the triad alone for some seconds in each orientation, or \
                 say a shorter --least",
                rests.length_s
            ),
        )),
        None => Err(Error::input(
            file,
            format!("has too few samples for blocks of {BLOCK_S} s"),
        )),
    }
}

/// Finds the rests among samples, as [`find`] does; `None` where they are too few.
pub fn of_samples(samples: impl Iterator<Item = (f64, [f64; 3])>, least_s: f64) -> Option<Rests> {
    let mut blocks = Blocks::default();
    for (time_s, output) in samples {
        blocks.add(time_s, output, None).ok()?;
    }
    of_blocks(&blocks.finish(), least_s)
}

impl Rests {
    /// As positions of a campaign.
    pub fn positions(&self) -> Vec<TriadPosition> {
        let position = |(k, rest): (usize, &Rest)| TriadPosition {
            order: k as u64 + 1,
            line: 0,
            time_s: Some((rest.from_s + rest.to_s) / 2.0),
            output_v: rest.mean,
            sigma_v: rest.sigma,
            temp_c: rest.temp_c,
            attitude: None,
            unknown: Vec::new(),
        };
        self.rests.iter().enumerate().map(position).collect()
    }
}

/// Blocks as the samples come.
#[derive(Default)]
struct Blocks {
    done: Vec<Block>,
    start_s: Option<f64>,
    last_s: f64,
    open: Option<Block>,
    temperature: (f64, u32),
}

struct Backwards;

impl Blocks {
    fn add(&mut self, time_s: f64, sample: [f64; 3], temp_c: Option<f64>) -> Result<(), Backwards> {
        let start_s = *self.start_s.get_or_insert(time_s);
        if self.open.is_some() && time_s < self.last_s {
            return Err(Backwards);
        }
        self.last_s = time_s;
        let index = ((time_s - start_s) / BLOCK_S).floor() as i64;
        if self.open.is_some_and(|block| block.index != index) {
            self.close();
        }
        let block = self.open.get_or_insert(Block {
            index,
            count: 0,
            mean: [0.0; 3],
            variance: [0.0; 3],
            temp_c: None,
            from_s: time_s,
            to_s: time_s,
        });
        block.count += 1;
        block.to_s = time_s;
        // Welford: `variance` holds the sum of squares until the block is closed.
        for s in 0..3 {
            let off = sample[s] - block.mean[s];
            block.mean[s] += off / f64::from(block.count);
            block.variance[s] += off * (sample[s] - block.mean[s]);
        }
        if let Some(temp_c) = temp_c {
            self.temperature.0 += temp_c;
            self.temperature.1 += 1;
        }
        Ok(())
    }

    fn close(&mut self) {
        let Some(mut block) = self.open.take() else {
            return;
        };
        let (sum, count) = std::mem::take(&mut self.temperature);
        block.temp_c = (count > 0).then(|| sum / f64::from(count));
        if block.count >= LEAST_SAMPLES {
            let freedom = f64::from(block.count - 1);
            block.variance = block.variance.map(|squares| squares / freedom);
            self.done.push(block);
        }
    }

    fn finish(mut self) -> Vec<Block> {
        self.close();
        self.done
    }
}

/// What a body at rest keeps.
struct Thresholds {
    variance: [f64; 3],
    greatest_variance: [f64; 3],
    greatest_step: [f64; 3],
}

fn of_blocks(blocks: &[Block], least_s: f64) -> Option<Rests> {
    let (first, last) = (blocks.first()?, blocks.last()?);
    let length_s = last.to_s - first.from_s;
    let thresholds = thresholds(blocks)?;
    let still: Vec<bool> = blocks
        .iter()
        .map(|block| thresholds.is_quiet(block))
        .collect();
    let mut stretches: Vec<&[Block]> = Vec::new();
    let mut begin = 0;
    for end in 1..=blocks.len() {
        let goes_on = end < blocks.len()
            && still[end - 1]
            && still[end]
            && thresholds.is_steady(&blocks[end - 1], &blocks[end]);
        if goes_on {
            continue;
        }
        // A block at either end may hold the begin of a motion.
        if still[begin] && end - begin > 2 {
            stretches.push(&blocks[begin + 1..end - 1]);
        }
        begin = end;
    }
    let (long, short): (Vec<&[Block]>, Vec<&[Block]>) = stretches
        .into_iter()
        .partition(|stretch| length(stretch) >= least_s - BLOCK_S / 2.0);
    let noise_factor = noise_factor(&long, &thresholds.variance);
    let rests: Vec<Rest> = long
        .iter()
        .filter(|stretch| !creeps(stretch, &thresholds.variance, &noise_factor))
        .map(|stretch| rest(stretch, &thresholds.variance, &noise_factor))
        .collect();
    Some(Rests {
        format: "vre-rests/1",
        creeping: long.len() - rests.len(),
        too_short: short.len(),
        rests,
        noise: thresholds.variance.map(f64::sqrt),
        greatest_noise: thresholds.greatest_variance.map(f64::sqrt),
        greatest_step: thresholds.greatest_step,
        noise_factor,
        length_s,
    })
}

fn length(stretch: &[Block]) -> f64 {
    match (stretch.first(), stretch.last()) {
        (Some(first), Some(last)) => last.to_s - first.from_s,
        _ => 0.0,
    }
}

impl Thresholds {
    fn is_quiet(&self, block: &Block) -> bool {
        (0..3).all(|s| block.variance[s] <= self.greatest_variance[s])
    }

    fn is_steady(&self, before: &Block, after: &Block) -> bool {
        let follow = after.index == before.index + 1;
        follow && (0..3).all(|s| (after.mean[s] - before.mean[s]).abs() <= self.greatest_step[s])
    }
}

/// The floor of the variance: from the quietest blocks on, in passes, the median of all that are within reach of it. Then the steps
/// between such blocks, likewise.
fn thresholds(blocks: &[Block]) -> Option<Thresholds> {
    let count = median(blocks.iter().map(|block| f64::from(block.count)).collect())?;
    let reach = greatest_ratio(count - 1.0);
    let width: [f64; 3] = [0, 1, 2].map(|s| {
        let means: Vec<f64> = blocks.iter().map(|block| block.mean[s].abs()).collect();
        // Codes that do not move at all: rounding of their size.
        (1e-9 * median(means).unwrap_or(0.0)).powi(2)
    });
    // A block is as loud as its loudest axis, in terms of the quietest tenth of each.
    let tenth = [0, 1, 2].map(|s| {
        let mut all: Vec<f64> = blocks.iter().map(|block| block.variance[s]).collect();
        all.sort_by(f64::total_cmp);
        all[((all.len() - 1) as f64 * QUIETEST) as usize].max(width[s])
    });
    let mut variance = tenth;
    for _ in 0..PASSES {
        let quiet = blocks
            .iter()
            .filter(|block| (0..3).all(|s| block.variance[s] <= reach * variance[s]));
        let quiet: Vec<&Block> = quiet.collect();
        variance = [0, 1, 2].map(|s| {
            let all = quiet.iter().map(|block| block.variance[s]).collect();
            median(all).unwrap_or(variance[s]).max(width[s])
        });
    }
    let mut found = Thresholds {
        variance,
        greatest_variance: variance.map(|v| reach * v),
        greatest_step: [0.0; 3],
    };
    let pairs = blocks.windows(2).filter(|pair| {
        pair[1].index == pair[0].index + 1 && pair.iter().all(|block| found.is_quiet(block))
    });
    let pairs: Vec<&[Block]> = pairs.collect();
    found.greatest_step = [0, 1, 2].map(|s| {
        let white = (2.0 * variance[s] / count).sqrt();
        let steps = pairs
            .iter()
            .map(|pair| (pair[1].mean[s] - pair[0].mean[s]).abs());
        // The median of a normal deviate's magnitude is 0.6745 of its standard deviation.
        let scale = median(steps.collect()).unwrap_or(0.0) / 0.6745;
        FAR * scale.max(white)
    });
    Some(found)
}

/// How much more the means of blocks scatter about their rest than white noise would let them: the root of the mean ratio, at
/// least 1.
fn noise_factor(stretches: &[&[Block]], variance: &[f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|s| {
        let (mut squares, mut freedom) = (0.0, 0.0);
        for stretch in stretches.iter().filter(|stretch| stretch.len() > 1) {
            let mean = mean(stretch, s);
            for block in *stretch {
                let off = block.mean[s] - mean;
                squares += f64::from(block.count) * off * off / variance[s];
            }
            freedom += stretch.len() as f64 - 1.0;
        }
        if freedom > 0.0 {
            (squares / freedom).sqrt().max(1.0)
        } else {
            1.0
        }
    })
}

fn mean(blocks: &[Block], s: usize) -> f64 {
    let count: f64 = blocks.iter().map(|block| f64::from(block.count)).sum();
    blocks
        .iter()
        .map(|block| f64::from(block.count) * block.mean[s])
        .sum::<f64>()
        / count
}

fn sigma(blocks: &[Block], s: usize, variance: &[f64; 3], noise_factor: &[f64; 3]) -> f64 {
    let count: f64 = blocks.iter().map(|block| f64::from(block.count)).sum();
    noise_factor[s] * (variance[s] / count).sqrt()
}

/// Whether the last third of a stretch is elsewhere than its first.
fn creeps(stretch: &[Block], variance: &[f64; 3], noise_factor: &[f64; 3]) -> bool {
    let third = stretch.len() / 3;
    if third == 0 {
        return false;
    }
    let (first, last) = (&stretch[..third], &stretch[stretch.len() - third..]);
    (0..3).any(|s| {
        let off = (mean(last, s) - mean(first, s)).abs();
        let sigma_of = |blocks: &[Block]| sigma(blocks, s, variance, noise_factor);
        off > FAR * sigma_of(first).hypot(sigma_of(last))
    })
}

fn rest(stretch: &[Block], variance: &[f64; 3], noise_factor: &[f64; 3]) -> Rest {
    let temperatures: Vec<f64> = stretch.iter().filter_map(|block| block.temp_c).collect();
    let count = temperatures.len();
    Rest {
        from_s: stretch.first().map_or(0.0, |block| block.from_s),
        to_s: stretch.last().map_or(0.0, |block| block.to_s),
        samples: stretch.iter().map(|block| u64::from(block.count)).sum(),
        mean: [0, 1, 2].map(|s| mean(stretch, s)),
        sigma: [0, 1, 2].map(|s| sigma(stretch, s, variance, noise_factor)),
        temp_c: (count > 0).then(|| temperatures.iter().sum::<f64>() / count as f64),
    }
}
