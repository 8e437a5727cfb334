//! Where the gap lies: in which observable, under which conditions.

use serde::{Deserialize, Serialize};

use super::adequacy::OBSERVABLES;
use super::fit::Fit;
use super::problem::{Block, Problem};
use crate::campaign::{Approach, Run};

/// Permutations that the search over conditions is corrected by.
const PERMUTATIONS: usize = 199;
/// Most distinct values of a factor that regions begin and end at.
const EDGES: usize = 14;
/// Regions with a larger probability of arising by chance are not reported.
const SIGNIFICANT: f64 = 0.05;

/// Share of the excess in one observable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObservableShare {
    /// `static`, `vibration`, `bias`, `recovery` or `in-run-drift`.
    pub name: String,
    /// Share of the squared excess over the stated noise, 0 to 1.
    pub share: f64,
}

/// A region of conditions that holds more of the excess than its size would have it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Condition {
    /// Which condition.
    pub factor: String,
    /// Least value in the region.
    pub low: f64,
    /// Greatest value in the region.
    pub high: f64,
    /// Share of the excess, 0 to 1.
    pub share: f64,
    /// Numbers of the runs in the region; of the readings (`order`) for a factor of the dial.
    pub runs: Vec<u64>,
    /// Probability that a search finds as much by chance.
    pub p_value: f64,
}

/// Excess over the noise of each row: squared gap less 1, in units of the noise.
struct Excess {
    rows: Vec<f64>,
}

impl Problem<'_> {
    /// The gap (observed less nominal part of `fit`, in units of noise) split by observable and by condition.
    pub fn locate(&self, fit: &Fit) -> (Vec<ObservableShare>, Vec<Condition>) {
        let gap = self.gap(fit);
        let excess = Excess {
            rows: gap.iter().map(|z| z * z - 1.0).collect(),
        };
        let of = |block: Block| {
            self.observed_rows(block)
                .map(|row| excess.rows[row])
                .sum::<f64>()
                .max(0.0)
        };
        let total: f64 = OBSERVABLES.iter().map(|(block, _)| of(*block)).sum();
        let shares = OBSERVABLES.iter().map(|(block, name)| ObservableShare {
            name: (*name).into(),
            share: if total > 0.0 { of(*block) / total } else { 0.0 },
        });
        (shares.collect(), self.conditions(&excess))
    }

    /// Observed less nominal part, in units of the noise; `during` of random runs by their whole uncertainty.
    pub fn gap(&self, fit: &Fit) -> Vec<f64> {
        let mut gap = self.observed.values.clone();
        for (column, x) in self.nominal.iter().zip(&fit.theta) {
            for (g, v) in gap.iter_mut().zip(&column.values) {
                *g -= x * v;
            }
        }
        for (g, trust) in gap[self.range(Block::During)].iter_mut().zip(&fit.trust) {
            *g *= trust.sqrt();
        }
        gap
    }

    /// Rows of a block that hold an observation.
    pub fn observed_rows(&self, block: Block) -> impl Iterator<Item = usize> + '_ {
        self.range(block)
            .filter(move |&row| block == Block::Static || self.weights[row] > 0.0)
    }

    fn conditions(&self, excess: &Excess) -> Vec<Condition> {
        let s = &self.situation;
        let made: Vec<(usize, &Run)> = s
            .runs
            .iter()
            .copied()
            .enumerate()
            .filter(|(_, run)| run.measured.is_some())
            .collect();
        let of_run = |row: usize| {
            let blocks = [Block::During, Block::Before, Block::After, Block::Drift];
            blocks
                .iter()
                .map(|block| excess.rows[self.range(*block).start + row])
                .sum::<f64>()
        };
        let runs = Table {
            excess: made.iter().map(|(row, _)| of_run(*row)).collect(),
            numbers: made.iter().map(|(_, run)| run.run).collect(),
            factors: RUN_FACTORS
                .iter()
                .map(|(name, value)| {
                    (
                        *name,
                        made.iter().map(|(row, run)| value(*row, run)).collect(),
                    )
                })
                .collect(),
        };
        let readings = Table {
            excess: self
                .range(Block::Static)
                .map(|row| excess.rows[row])
                .collect(),
            numbers: s.readings.iter().map(|reading| reading.order).collect(),
            factors: vec![
                ("dial_deg", s.readings.iter().map(|r| r.dial_deg).collect()),
                (
                    "series",
                    s.readings
                        .iter()
                        .map(|r| f64::from(u8::from(r.series)))
                        .collect(),
                ),
                (
                    "approach",
                    s.readings
                        .iter()
                        .map(|r| {
                            if r.approach == Approach::Clockwise {
                                1.0
                            } else {
                                0.0
                            }
                        })
                        .collect(),
                ),
            ],
        };
        let mut conditions = runs.regions();
        conditions.extend(readings.regions());
        conditions
    }
}

type Factor = (&'static str, fn(usize, &Run) -> f64);

const RUN_FACTORS: [Factor; 9] = [
    ("frequency_hz", |_, run| {
        (run.band_hz[0] * run.band_hz[1]).sqrt()
    }),
    ("level_g", |_, run| run.level_g),
    ("direction_i", |_, run| run.direction[0].abs()),
    ("direction_p", |_, run| run.direction[1].abs()),
    ("direction_o", |_, run| run.direction[2].abs()),
    ("a0_i_g", |_, run| run.specific_force_g.i),
    ("temp_c", |_, run| run.temp_c),
    ("time_s", |_, run| run.time_s),
    ("order", |row, _| row as f64),
];

/// Rows with their excess and the values of their factors.
struct Table {
    excess: Vec<f64>,
    numbers: Vec<u64>,
    factors: Vec<(&'static str, Vec<f64>)>,
}

impl Table {
    /// The best region of each factor, the most conspicuous first, those that chance explains left out.
    fn regions(&self) -> Vec<Condition> {
        let n = self.excess.len();
        let total: f64 = self.excess.iter().sum();
        // Less than four of its own standard deviations is no excess to be placed.
        if n < 4 || total < 4.0 * (2.0 * n as f64).sqrt() {
            return Vec::new();
        }
        let binned: Vec<Binned> = self
            .factors
            .iter()
            .filter_map(|(name, values)| Binned::new(name, values))
            .collect();
        let mut chance: Vec<f64> = Vec::with_capacity(PERMUTATIONS);
        let mut shuffled = self.excess.clone();
        let mut random = SplitMix(0x9e37_79b9_7f4a_7c15);
        for _ in 0..PERMUTATIONS {
            for last in (1..n).rev() {
                shuffled.swap(last, random.index(last + 1));
            }
            let best = binned.iter().map(|factor| factor.best(&shuffled, total).0);
            chance.push(best.fold(0.0, f64::max));
        }
        let mut found: Vec<(f64, Condition)> = binned
            .iter()
            .filter_map(|factor| {
                let (score, first, last) = factor.best(&self.excess, total);
                let above = chance.iter().filter(|c| **c >= score).count();
                let p_value = (above + 1) as f64 / (PERMUTATIONS + 1) as f64;
                if p_value > SIGNIFICANT {
                    return None;
                }
                let inside = |row: &usize| (first..=last).contains(&factor.bin[*row]);
                let rows: Vec<usize> = (0..n).filter(inside).collect();
                let values = rows.iter().map(|&row| factor.values[row]);
                let condition = Condition {
                    factor: factor.name.into(),
                    low: values.clone().fold(f64::INFINITY, f64::min),
                    high: values.fold(f64::NEG_INFINITY, f64::max),
                    share: (rows.iter().map(|&row| self.excess[row]).sum::<f64>() / total)
                        .clamp(0.0, 1.0),
                    runs: rows.iter().map(|&row| self.numbers[row]).collect(),
                    p_value,
                };
                Some((score, condition))
            })
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.into_iter().map(|(_, condition)| condition).collect()
    }
}

/// A factor's values sorted into at most [`EDGES`] bins.
struct Binned<'v> {
    name: &'static str,
    values: &'v [f64],
    bin: Vec<usize>,
    counts: Vec<f64>,
}

impl<'v> Binned<'v> {
    /// `None` if the factor does not vary.
    fn new(name: &'static str, values: &'v [f64]) -> Option<Self> {
        let mut distinct = values.to_vec();
        distinct.sort_by(f64::total_cmp);
        distinct.dedup();
        if distinct.len() < 2 {
            return None;
        }
        let bins = distinct.len().min(EDGES);
        let bin = |value: &f64| {
            let rank = distinct.partition_point(|d| d < value);
            rank * bins / distinct.len()
        };
        let bin: Vec<usize> = values.iter().map(bin).collect();
        let mut counts = vec![0.0; bins];
        for &b in &bin {
            counts[b] += 1.0;
        }
        Some(Self {
            name,
            values,
            bin,
            counts,
        })
    }

    /// Score, first and last bin of the region whose share of the excess is most above its share of the rows.
    fn best(&self, excess: &[f64], total: f64) -> (f64, usize, usize) {
        let mut sums = vec![0.0; self.counts.len()];
        for (&bin, e) in self.bin.iter().zip(excess) {
            sums[bin] += e;
        }
        let n = excess.len() as f64;
        let mut best = (0.0, 0, sums.len() - 1);
        for first in 0..sums.len() {
            let (mut sum, mut count) = (0.0, 0.0);
            for last in first..sums.len() {
                sum += sums[last];
                count += self.counts[last];
                let size = count / n;
                if size < 1.0 {
                    let score = (sum / total - size) / (size * (1.0 - size)).sqrt();
                    if score > best.0 {
                        best = (score, first, last);
                    }
                }
            }
        }
        best
    }
}

/// Steele, Lea and Flood's SplitMix64: the same numbers for the same campaign.
pub(super) struct SplitMix(pub(super) u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number from 0 to `below` - 1.
    pub(super) fn index(&mut self, below: usize) -> usize {
        (self.next() % below as u64) as usize
    }

    /// A number from 0 to 1.
    pub(super) fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A standard normal number, by Box and Muller.
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}
