//! The noise of a mean, at the time scale on which means are compared.
//!
//! Noise is white, flicker and random walk, as inertial sensors are described (IEEE Std 952, annex C), and a drift: a rate
//! that stays for as long as the record. The four densities are known as well as the record shows them. Each stretch is cut
//! into some tens of batches; the discrete cosine transform of their means makes terms that hardly know of each other,
//! each with a variance that is linear in the densities. The densities stand on a grid, their prior flat in the logarithm.
//! A contrast of means is then a mixture of Gaussian deviates, one a point of the grid. What a record cannot exclude, a
//! random walk too slow for its windows say, so makes the interval as wide as it has to be.
//!
//! All lengths are in samples, variances in g^2.

use std::f64::consts::{LN_2, PI};

use shared::slope::Batch;
use statrs::distribution::{ContinuousCDF, FisherSnedecor, Normal, StudentsT};

/// Most batches of a stretch; beyond, they are joined in pairs.
const MOST: usize = 64;

/// A stretch of samples cut into batches of equal length.
#[derive(Clone, Debug)]
pub(super) struct Batches {
    list: Vec<Batch>,
    /// A batch that waits for its right neighbour, to make one of this length.
    waiting: Vec<Option<Batch>>,
    filling: Batch,
    place: u64,
    length: u64,
}

impl Default for Batches {
    fn default() -> Self {
        Self {
            list: Vec::new(),
            waiting: Vec::new(),
            filling: Batch::default(),
            place: 0,
            length: Batch::SHORTEST,
        }
    }
}

impl Batches {
    /// Takes the next sample.
    pub(super) fn push(&mut self, value: f64) {
        self.filling.add(value, self.place);
        self.place += 1;
        if self.place < Batch::SHORTEST {
            return;
        }
        self.place = 0;
        let mut batch = std::mem::take(&mut self.filling);
        for waiting in &mut self.waiting {
            match waiting.take() {
                Some(left) => batch = Batch::join(&left, &batch),
                None => {
                    *waiting = Some(batch);
                    return;
                }
            }
        }
        self.list.push(batch);
        if self.list.len() == MOST {
            self.list = joined(&self.list);
            self.waiting.push(None);
            self.length *= 2;
        }
    }
}

impl Batches {
    /// Change along the stretch by a straight line through its batches, with its standard uncertainty by what is left about
    /// the line; `None` of fewer than eight.
    pub(super) fn trend(&self) -> Option<(f64, f64)> {
        let n = self.list.len() as f64;
        if self.list.len() < FEWEST {
            return None;
        }
        let half = 0.5 * (n - 1.0);
        let means: Vec<f64> = self.list.iter().map(Batch::bell_mean).collect();
        let mean = means.iter().sum::<f64>() / n;
        let squares = n * (n * n - 1.0) / 12.0;
        let at = |k: usize| k as f64 - half;
        let moment: f64 = means
            .iter()
            .enumerate()
            .map(|(k, m)| at(k) * (m - mean))
            .sum();
        let slope = moment / squares;
        let left = means
            .iter()
            .enumerate()
            .map(|(k, m)| (m - mean - slope * at(k)).powi(2));
        let sigma = (left.sum::<f64>() / (n - 2.0) / squares).sqrt();
        Some((slope * n, sigma * n))
    }

    /// Density of the noise at the lowest eighth of the frequencies of the batches over that of the upper half, and whether
    /// so small a ratio has a probability below 1 in 1000 for white noise; `None` of fewer than 32 batches.
    pub(super) fn whiteness(&self) -> Option<(f64, bool)> {
        let count = self.list.len();
        if count < MOST / 2 {
            return None;
        }
        let power = |order: usize| {
            let wave = cosine(order, count);
            let terms = wave
                .iter()
                .zip(&self.list)
                .map(|(w, batch)| w * batch.bell_mean());
            terms.sum::<f64>().powi(2)
        };
        let mean = |orders: std::ops::Range<usize>| {
            let count = orders.len() as f64;
            orders.map(power).sum::<f64>() / count
        };
        let (low, high) = (1..count / 8 + 1, count / 2..count);
        let freedoms = [low.len() as f64, high.len() as f64];
        let ratio = mean(low) / mean(high);
        if !ratio.is_finite() {
            return None;
        }
        let chance = FisherSnedecor::new(freedoms[0], freedoms[1]).map(|f| f.cdf(ratio));
        Some((ratio, chance.is_ok_and(|chance| chance < 1e-3)))
    }
}

fn joined(list: &[Batch]) -> Vec<Batch> {
    let (pairs, _) = list.as_chunks::<2>();
    let joined = |[one, other]: &[Batch; 2]| Batch::join(one, other);
    pairs.iter().map(joined).collect()
}

/// How a mean weighs its samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// All alike.
    Box,
    /// 1 - s^2, the line fit to the integrated output.
    Parabola,
    /// (1 - s^2)^3, that of a batch.
    Bell,
}

impl Shape {
    fn at(self, s: f64) -> f64 {
        match self {
            Self::Box => 1.0,
            Self::Parabola => 1.0 - s * s,
            Self::Bell => (1.0 - s * s).powi(3),
        }
    }

    /// Of a batch: plain, or under the bell.
    fn mean(self, batch: &Batch) -> f64 {
        match self {
            Self::Bell => batch.bell_mean(),
            _ => batch.mean(),
        }
    }
}

/// Whether an output is at rest or shaken: white noise differs, what is slower is the instrument's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    /// At rest.
    Rest = 0,
    /// Under vibration.
    Shaken = 1,
}

/// One mean of a contrast.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// First sample.
    pub from: f64,
    /// The one after the last.
    pub to: f64,
    /// Weights of the samples.
    pub shape: Shape,
    /// Its factor; those of a contrast add up to zero.
    pub weight: f64,
    /// Whose white noise it has.
    pub state: State,
}

/// Densities: white at rest and under vibration, flicker, walk, square of the drift's rate; or what each of them as 1
/// makes of the variance of a contrast.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Densities([f64; 5]);

impl Densities {
    fn times(&self, other: &Self) -> f64 {
        self.0.iter().zip(other.0).map(|(a, b)| a * b).sum()
    }
}

/// A piece of a mean: centre, width, weight.
type Cell = (f64, f64, f64);

/// The variance of a contrast of `parts`, of `cells` pieces each: white noise of unit variance a sample; flicker noise of
/// covariance -ln|t|; a walk of structure function |t|; a rate of 1. For weights w that add up to zero the variance is
/// -1/2 sum w w' D(t - t'), D being the structure function.
pub(super) fn response(parts: &[Part], cells: usize) -> Densities {
    let mut white = [0.0; 2];
    let mut all: Vec<Cell> = Vec::with_capacity(parts.len() * cells);
    for part in parts {
        let width = (part.to - part.from) / cells as f64;
        let weight = |cell: usize| part.shape.at((2 * cell + 1) as f64 / cells as f64 - 1.0);
        let sum: f64 = (0..cells).map(weight).sum();
        for cell in 0..cells {
            let weight = part.weight * weight(cell) / sum;
            white[part.state as usize] += weight * weight / width;
            all.push((part.from + (cell as f64 + 0.5) * width, width, weight));
        }
    }
    let (mut flicker, mut walk) = (0.0, 0.0);
    for (index, &(a, width, weight)) in all.iter().enumerate() {
        // The mean over a cell of its own distances.
        flicker -= weight * weight * (width.ln() - 1.5);
        walk -= 0.5 * weight * weight * width / 3.0;
        for &(b, _, other) in &all[..index] {
            let distance = (a - b).abs();
            flicker -= 2.0 * weight * other * distance.ln();
            walk -= weight * other * distance;
        }
    }
    let rate: f64 = all.iter().map(|(at, _, weight)| at * weight).sum();
    Densities([
        white[0],
        white[1],
        flicker.max(0.0),
        walk.max(0.0),
        rate * rate,
    ])
}

/// A figure that would be zero but for the noise.
#[derive(Clone, Copy, Debug)]
struct Term {
    square: f64,
    response: Densities,
}

/// What a record shows of its noise.
#[derive(Clone, Debug)]
pub(super) struct Evidence {
    /// Of stretches at rest, and of those under vibration.
    terms: [Vec<Term>; 2],
    contrasts: Vec<Term>,
    /// The longest stretch whose noise was seen, in samples.
    pub longest: f64,
    /// The shortest batch.
    shortest: f64,
}

impl Default for Evidence {
    fn default() -> Self {
        Self {
            terms: Default::default(),
            contrasts: Vec::new(),
            longest: 0.0,
            shortest: f64::INFINITY,
        }
    }
}

/// Fewest batches whose scatter tells of noise.
const FEWEST: usize = 8;

impl Evidence {
    /// Adds a stretch. Batches so short that they still see the vibration are joined; plain means, which know the slow
    /// noise better, are taken where nothing vibrates.
    pub(super) fn add(&mut self, state: State, batches: &Batches) {
        let (mut list, mut length) = (batches.list.clone(), batches.length as f64);
        let still = state == State::Rest && !leaks(&list);
        let shape = if still { Shape::Box } else { Shape::Bell };
        loop {
            let longer = joined(&list);
            if longer.len() < FEWEST || !sees_vibration(&list, &longer, shape) {
                break;
            }
            (list, length) = (longer, 2.0 * length);
        }
        let count = list.len();
        if count < 2 {
            return;
        }
        self.longest = self.longest.max(length * count as f64);
        self.shortest = self.shortest.min(length);
        for order in 1..count {
            let wave = cosine(order, count);
            let means = list.iter().map(|batch| shape.mean(batch));
            let sum: f64 = wave.iter().zip(means).map(|(a, b)| a * b).sum();
            self.terms[state as usize].push(Term {
                square: sum * sum,
                response: of_cosine(&wave, length, state, shape),
            });
        }
    }

    /// Adds a contrast that would be zero but for the noise.
    pub(super) fn add_contrast(&mut self, value: f64, response: Densities) {
        let square = value * value;
        self.contrasts.push(Term { square, response });
    }
}

/// The discrete cosine transform's row, of unit length.
fn cosine(order: usize, count: usize) -> Vec<f64> {
    let scale = (2.0 / count as f64).sqrt();
    let phase = PI * order as f64 / count as f64;
    (0..count)
        .map(|k| scale * (phase * (k as f64 + 0.5)).cos())
        .collect()
}

/// What the densities make of the variance of a sum of batches.
fn of_cosine(wave: &[f64], length: f64, state: State, shape: Shape) -> Densities {
    let of = BatchNoise::of(shape);
    let (mut flicker, mut walk, mut rate) = (0.0, 0.0, 0.0);
    for (a, &x) in wave.iter().enumerate() {
        flicker -= x * x * of.own_log;
        walk -= 0.5 * x * x * of.own_distance;
        rate += x * a as f64 * length;
        for (b, &y) in wave[..a].iter().enumerate() {
            let distance = (a - b) as f64;
            let log = if a - b == 1 {
                of.next_log
            } else {
                distance.ln()
            };
            flicker -= 2.0 * x * y * log;
            walk -= x * y * distance;
        }
    }
    let mut densities = [0.0; 5];
    densities[state as usize] = of.white / length;
    densities[2] = flicker.max(0.0);
    densities[3] = length * walk.max(0.0);
    densities[4] = rate * rate;
    Densities(densities)
}

/// Of a batch of length 1: the variance of white noise, and the means over two of its samples of the logarithm of their
/// distance and of the distance; the first also for two samples of neighbours. Exact, or by quadrature.
struct BatchNoise {
    white: f64,
    own_log: f64,
    own_distance: f64,
    next_log: f64,
}

impl BatchNoise {
    fn of(shape: Shape) -> Self {
        match shape {
            Shape::Bell => Self {
                white: 700.0 / 429.0,
                own_log: -2.055_8,
                own_distance: 0.190_4,
                next_log: -0.030_3,
            },
            _ => Self {
                white: 1.0,
                own_log: -1.5,
                own_distance: 1.0 / 3.0,
                next_log: 2.0 * LN_2 - 1.5,
            },
        }
    }
}

/// Half the mean square of the differences of neighbours.
fn allan_variance(list: &[Batch], shape: Shape) -> f64 {
    let means = list.iter().map(|batch| shape.mean(batch));
    let pairs = means.clone().zip(means.skip(1));
    let squares: f64 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
    0.5 * squares / (list.len().max(2) - 1) as f64
}

/// Whether plain means of batches hold what a bell keeps out: their variance is then more than twice what any noise makes
/// it (white noise 1, a random walk 1.3 times).
fn leaks(list: &[Batch]) -> bool {
    let [plain, bell] = [Shape::Box, Shape::Bell]
        .map(|shape| allan_variance(list, shape) / BatchNoise::of(shape).white);
    plain > 2.0 * bell
}

/// Whether the variance of the shorter batches is more than white noise makes it, beyond its own scatter.
fn sees_vibration(short: &[Batch], long: &[Batch], shape: Shape) -> bool {
    if long.len() < 2 {
        return false;
    }
    let (one, two) = (allan_variance(short, shape), allan_variance(long, shape));
    let scatter = (2.0 / short.len() as f64 + 2.0 / long.len() as f64).sqrt();
    (one / (2.0 * two).max(f64::MIN_POSITIVE)).ln() > 3.0 * scatter * 1.2
}

/// Logarithm of the weight, from the top, below which a point of the grid is not counted.
const NEGLIGIBLE: f64 = 20.0;

/// Prior probability that a slow noise is negligible. Chosen: with one half the intervals of white noise are wider, with nine
/// tenths those of a walk that the record barely shows are short.
const NONE: f64 = 0.7;

/// Densities on a grid, two octaves apart, with the logarithm of their prior probability: from a quarter of what equals white
/// noise over the span, to `most` octaves above.
fn grid(unit: f64, most: f64) -> impl Iterator<Item = (f64, f64)> {
    let count = 2 + (0.5 * most).ceil() as i32;
    let each = ((1.0 - NONE) / f64::from(count)).ln();
    let some = (0..count).map(move |step| (unit * (LN_2 * f64::from(2 * step - 2)).exp(), each));
    std::iter::once((0.0, NONE.ln())).chain(some)
}

impl Evidence {
    /// The scatter of a contrast, given all that was seen; `span` is the distance over which it reaches. `None` if there is
    /// no noise to see.
    pub(super) fn scatter(&self, contrast: &Densities, span: f64) -> Option<Scatter> {
        let pilots = [0, 1].map(|state| pilot(&self.terms[state], state));
        let least = pilots
            .iter()
            .flatten()
            .copied()
            .filter(|&p| p > 0.0)
            .reduce(f64::min)?;
        // Even where slow noise hides all white noise in the shortest batch, the grid holds it.
        let octaves = (span / self.shortest).log2().max(0.0);
        let mut points: Vec<(f64, f64)> = Vec::new();
        let mut top = f64::NEG_INFINITY;
        // The likelihood has one hill along each density: beyond it, what is too small to count ends the search.
        let over = |best: f64, last: f64, top: f64| best < last && best < top - NEGLIGIBLE;
        for (flicker, flicker_prior) in grid(least / span, octaves + 4.0) {
            let mut last_walk = f64::NEG_INFINITY;
            for (walk, walk_prior) in grid(least / span.powi(2), 2.0 * octaves + 4.0) {
                let [mut best_walk, mut last] = [f64::NEG_INFINITY; 2];
                for (drift, drift_prior) in grid(least / span.powi(3), 3.0 * octaves) {
                    let slow = [flicker, walk, drift];
                    let prior = flicker_prior + walk_prior + drift_prior;
                    let from = points.len();
                    self.point(pilots, slow, contrast, prior, &mut points);
                    let best = points[from..]
                        .iter()
                        .map(|p| p.0)
                        .fold(f64::NEG_INFINITY, f64::max);
                    top = top.max(best);
                    best_walk = best_walk.max(best);
                    if over(best, last, top) {
                        break;
                    }
                    last = best;
                }
                if over(best_walk, last_walk, top) {
                    break;
                }
                last_walk = best_walk;
            }
        }
        Some(Scatter::new(points))
    }

    /// The mixture's terms (logarithm of the weight, standard deviation) at one point of the grid.
    fn point(
        &self,
        pilots: [Option<f64>; 2],
        [flicker, walk, drift]: [f64; 3],
        contrast: &Densities,
        log_prior: f64,
        points: &mut Vec<(f64, f64)>,
    ) {
        let slow = Densities([0.0, 0.0, flicker, walk, drift]);
        let [rest, shaken] =
            [0, 1].map(|state| white(&self.terms[state], state, pilots[state], &slow));
        for (white_rest, rest_log) in rest {
            for &(white_shaken, shaken_log) in &shaken {
                let densities = Densities([white_rest, white_shaken, flicker, walk, drift]);
                let mut log = log_prior + rest_log + shaken_log;
                for term in &self.contrasts {
                    let variance = term.response.times(&densities);
                    log -= 0.5 * (variance.ln() + term.square / variance);
                }
                points.push((log, contrast.times(&densities).sqrt()));
            }
        }
    }
}

/// White density that the upper half of the terms shows.
fn pilot(terms: &[Term], state: usize) -> Option<f64> {
    let upper = &terms[terms.len() / 2..];
    let ratios: f64 = upper
        .iter()
        .map(|term| term.square / term.response.0[state])
        .sum();
    (!upper.is_empty()).then(|| ratios / upper.len() as f64)
}

/// White density of a state, given the slow ones: three points with the mean and variance of what the terms leave
/// possible, each with the logarithm of its weight.
fn white(terms: &[Term], state: usize, pilot: Option<f64>, slow: &Densities) -> [(f64, f64); 3] {
    let Some(pilot) = pilot.filter(|&pilot| pilot > 0.0) else {
        let none = f64::NEG_INFINITY;
        return [(0.0, 0.0), (0.0, none), (0.0, none)];
    };
    let known: Vec<(f64, f64, f64)> = terms
        .iter()
        .map(|term| {
            (
                term.square,
                term.response.times(slow),
                term.response.0[state],
            )
        })
        .collect();
    let likelihood = |white: f64| -> f64 {
        let mut product = 1.0f64;
        let mut sum = 0.0;
        let mut logs = 0.0;
        for (index, (square, slow, unit)) in known.iter().enumerate() {
            let variance = (slow + unit * white) / (pilot * unit);
            sum += square / (variance * pilot * unit);
            product *= variance;
            if index % 8 == 7 {
                logs += product.ln();
                product = 1.0;
            }
        }
        -0.5 * (sum + logs + product.ln())
    };
    let fine = (-8..=6).map(|step| (0.15 * f64::from(step), 0.15f64));
    let coarse = (1..=10).map(|step| (-1.2 - 0.6 * f64::from(step), 0.6));
    let points: Vec<(f64, f64)> = fine
        .chain(coarse)
        .map(|(log, width)| {
            (
                pilot * log.exp(),
                likelihood(pilot * log.exp()) + width.ln(),
            )
        })
        .collect();
    let top = points
        .iter()
        .map(|point| point.1)
        .fold(f64::NEG_INFINITY, f64::max);
    let [mut sum, mut mean, mut square] = [0.0; 3];
    for (white, log) in points {
        let weight = (log - top).exp();
        sum += weight;
        mean += weight * white;
        square += weight * white * white;
    }
    mean /= sum;
    let deviation = (square / sum - mean * mean).max(0.0).sqrt();
    let log = top + sum.ln();
    // Gauss-Hermite of three points.
    let reach = (3f64.sqrt() * deviation).min(0.95 * mean);
    [
        (mean - reach, log - 6f64.ln()),
        (mean, log + (2.0 / 3f64).ln()),
        (mean + reach, log - 6f64.ln()),
    ]
}

/// A mixture of Gaussian deviates about zero.
#[derive(Clone, Debug)]
pub(super) struct Scatter {
    mixture: Vec<(f64, f64)>,
}

impl Scatter {
    fn new(points: Vec<(f64, f64)>) -> Self {
        let top = points
            .iter()
            .map(|point| point.0)
            .fold(f64::NEG_INFINITY, f64::max);
        let weights = points
            .into_iter()
            .map(|(log, sigma)| ((log - top).exp(), sigma));
        let mut mixture: Vec<(f64, f64)> = weights.filter(|point| point.0 > 1e-6).collect();
        let total: f64 = mixture.iter().map(|point| point.0).sum();
        mixture.iter_mut().for_each(|point| point.0 /= total);
        Self { mixture }
    }

    /// Probability of a deviate of this size or more, of either sign.
    pub(super) fn p_value(&self, size: f64) -> f64 {
        let normal = Normal::standard();
        let beyond = |&(weight, sigma): &(f64, f64)| match sigma {
            sigma if sigma > 0.0 => 2.0 * weight * normal.sf(size.abs() / sigma),
            _ => 0.0,
        };
        self.mixture.iter().map(beyond).sum::<f64>().min(1.0)
    }

    /// The size that is passed with a probability.
    pub(super) fn half_width(&self, risk: f64) -> f64 {
        let largest = self.mixture.iter().map(|point| point.1).fold(0.0, f64::max);
        let (mut low, mut high) = (0.0, 10.0 * largest);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.p_value(middle) > risk {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }
}

/// Degrees of freedom of Student's t whose quantiles for two risks have this ratio, at most `most`.
pub(super) fn degrees_of_freedom(ratio: f64, risks: [f64; 2], most: f64) -> f64 {
    let ratio_of = |freedom: f64| match StudentsT::new(0.0, 1.0, freedom) {
        Ok(t) => t.inverse_cdf(1.0 - risks[0] / 2.0) / t.inverse_cdf(1.0 - risks[1] / 2.0),
        Err(_) => f64::NAN,
    };
    let (mut low, mut high) = (0.5f64.ln(), most.ln());
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if ratio_of(middle.exp()) > ratio {
            low = middle;
        } else {
            high = middle;
        }
    }
    (0.5 * (low + high)).exp()
}
