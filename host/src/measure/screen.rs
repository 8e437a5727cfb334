//! Samples that are not of the motion: at the ends of the range, stuck, or gross. Seen in the data, without being told of a
//! range.

use crate::median::{MEDIAN_TO_SIGMA, median};

/// Values that are counted at either end.
const VALUES: usize = 4;

/// The greatest and the least values of a stretch, each with how often it came.
#[derive(Clone, Debug, Default)]
pub(super) struct Ends {
    upper: Vec<(f64, u64)>,
    lower: Vec<(f64, u64)>,
}

impl Ends {
    /// Takes a sample.
    pub(super) fn add(&mut self, value: f64) {
        count(&mut self.upper, value, |a, b| a > b);
        count(&mut self.lower, value, |a, b| a < b);
    }

    /// Samples that pile up at the upper and at the lower end, and the values there.
    ///
    /// The counts of neighbouring values tell: at the crest of a sine, which is the worst, the last value comes three times
    /// as often as the mean of the next three (sqrt(1) against (sqrt(4) - sqrt(1)) / 3 of the arcsine's distribution). Four
    /// times as often, beyond four times the Poisson scatter, is no motion.
    pub(super) fn pile_up(&self) -> [Option<(f64, u64)>; 2] {
        [&self.upper, &self.lower].map(|end| {
            let [last, next @ ..] = end.as_slice() else {
                return None;
            };
            if next.len() + 1 < VALUES {
                return None; // Too few values to tell.
            }
            let mean = next.iter().map(|value| value.1 as f64).sum::<f64>() / next.len() as f64;
            (last.1 as f64 > 4.0 * mean + 4.0 * mean.sqrt()).then_some(*last)
        })
    }

    /// Whether there are enough values to tell.
    pub(super) fn tells(&self) -> bool {
        self.upper.len() == VALUES && self.lower.len() == VALUES
    }
}

/// Counts a value among the first few in an order.
fn count(list: &mut Vec<(f64, u64)>, value: f64, before: impl Fn(f64, f64) -> bool) {
    if list.len() == VALUES && list.last().is_some_and(|last| before(last.0, value)) {
        return;
    }
    match list.iter().position(|known| !before(known.0, value)) {
        Some(place) if list[place].0 == value => list[place].1 += 1,
        Some(place) => {
            list.insert(place, (value, 1));
            list.truncate(VALUES);
        }
        None if list.len() < VALUES => list.push((value, 1)),
        None => {}
    }
}

/// The longest runs of equal samples.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Repeats {
    last: Option<f64>,
    length: u64,
    from_row: u64,
    longest: (u64, u64),
    second: u64,
}

/// Fewest equal samples that count as stuck.
const STUCK: u64 = 16;

impl Repeats {
    /// Takes the sample of a row.
    pub(super) fn add(&mut self, value: f64, row: u64) {
        if self.last == Some(value) {
            self.length += 1;
        } else {
            self.close();
            (self.length, self.from_row) = (1, row);
        }
        self.last = Some(value);
    }

    fn close(&mut self) {
        if self.length > self.longest.0 {
            self.second = self.longest.0;
            self.longest = (self.length, self.from_row);
        } else {
            self.second = self.second.max(self.length);
        }
    }

    /// A run of equal samples four times as long as any other: how long, and the row that it begins with. Samples that a
    /// logger repeats, or the crests of a slow sine, come in runs of like length.
    pub(super) fn stuck(mut self) -> Option<(u64, u64)> {
        self.close();
        let (length, row) = self.longest;
        (length >= STUCK && length > 4 * self.second).then_some((length, row))
    }
}

/// Samples far from those about them.
#[derive(Clone, Debug, Default)]
pub(super) struct Gross {
    /// How many.
    pub(super) count: u64,
    /// Row, value and median about it, of the first.
    pub(super) first: Vec<(u64, f64, f64)>,
}

/// Deviation from the median that no motion has, in standard deviations by the median of moduli: of Gaussian noise one
/// sample in 10^15; a sine does not pass 1.
const GROSS: f64 = 8.0;

/// Most neighbours of one kind: more are a shock.
const TOGETHER: usize = 2;

/// Most that are told of.
const TOLD: usize = 5;

impl Gross {
    /// The gross samples of a chunk of samples and rows, by place, with the median instead. `step` is the least difference of
    /// samples.
    pub(super) fn find(&mut self, chunk: &[(f64, u64)], step: f64) -> Vec<(usize, f64)> {
        let values: Vec<f64> = chunk.iter().map(|sample| sample.0).collect();
        let Some(middle) = median(values.clone()) else {
            return Vec::new();
        };
        if values.len() < STUCK as usize {
            return Vec::new();
        }
        let moduli = values.iter().map(|value| (value - middle).abs()).collect();
        let sigma = (MEDIAN_TO_SIGMA * median(moduli).unwrap_or(0.0)).max(step);
        let far = |value: f64| sigma > 0.0 && (value - middle).abs() > GROSS * sigma;
        let places: Vec<usize> = (0..values.len()).filter(|&n| far(values[n])).collect();
        let together = places.chunk_by(|a, b| a + 1 == *b);
        let alone = together.filter(|run| run.len() <= TOGETHER).flatten();
        let found: Vec<(usize, f64)> = alone.map(|&place| (place, middle)).collect();
        self.count += found.len() as u64;
        for &(place, _) in found.iter().take(TOLD - self.first.len().min(TOLD)) {
            self.first.push((chunk[place].1, values[place], middle));
        }
        found
    }
}
