//! All observations of a campaign as one whitened vector, and the nominal model's design in the same rows.
//!
//! Everything is divided by one scale factor, so that outputs are in g. Static readings are whitened by the Cholesky
//! factor of their covariance: noise and repeatability of each, one error a mark, two tilts of the base, one error a
//! remounting. The plateaus of a run stand for themselves, at the run's nominal attitude.

use std::ops::Range;
use std::rc::Rc;

use shared::model::{Coefficients, NOMINAL, SpecificForce, terms};
use shared::tumble::within_a_turn;

use super::dense::inner_product;
use super::motion::{Averages, Bands, Motion, main_axis};
use super::parts::Made;
use crate::campaign::{Campaign, Reading, Run, VibrationKind};
use crate::finite_record::unseen_variance_g2;
use crate::identification::position;

/// Radians in one second of arc.
pub const ARCSEC_RAD: f64 = std::f64::consts::PI / 648_000.0;
/// Relative standard uncertainty of the peak detector's excursion, and of what small motions inside the instrument
/// add to it.
const EXTREME_REL_SIGMA: f64 = 5e-4;
/// Least excursion at which an extreme is used, g.
const EXTREME_LEAST_G: f64 = 0.1;
/// Uncertainty of a ratio of the reference's axes, and of the moments of a sine, beside the stated one.
const REFERENCE_SIGMA: f64 = 1e-5;
const SHAPE_SIGMA: f64 = 1e-4;
/// Prior standard deviations of the coefficients in the order of (1): wider than any instrument of the kind.
const PRIOR_SIGMA: [f64; NOMINAL] = [
    0.3, 0.02, 0.02, 0.02, 0.02, 0.005, 0.05, 0.05, 0.005, 0.005, 0.005,
];

/// One kind of observation. Reference rows hold three numbers a run, shape rows two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Block {
    /// Dial readings.
    Static,
    /// Plateau before a run.
    Before,
    /// Plateau during a run.
    During,
    /// Plateau after a run.
    After,
    /// Drift within a run.
    Drift,
    /// Greatest output of a sine run.
    Maximum,
    /// Least output of a sine run.
    Minimum,
    /// Rms of the reference over the commanded level, with sign, on IA, PA, OA.
    Reference,
    /// Third standardized moment of a sine, and the fourth less 1.5.
    Shape,
}

/// All kinds of observation in the order of the vector.
pub const BLOCKS: [Block; 9] = [
    Block::Static,
    Block::Before,
    Block::During,
    Block::After,
    Block::Drift,
    Block::Maximum,
    Block::Minimum,
    Block::Reference,
    Block::Shape,
];

/// A vector over all observations; what lies outside its span is zero and costs nothing.
#[derive(Clone, Debug)]
pub struct Column {
    /// One number a row.
    pub values: Vec<f64>,
    /// Rows of the blocks from the first to the last that may differ from zero.
    span: Range<usize>,
}

impl Column {
    /// Adds another one.
    pub(super) fn add(&mut self, other: &Self) {
        self.widen(other.span.clone());
        for (sum, value) in self.values.iter_mut().zip(&other.values) {
            *sum += value;
        }
    }

    fn widen(&mut self, rows: Range<usize>) {
        self.span = if self.span.is_empty() {
            rows
        } else {
            self.span.start.min(rows.start)..self.span.end.max(rows.end)
        };
    }

    /// Inner product.
    pub(super) fn dot(&self, other: &Self) -> f64 {
        self.dot_within(other, 0..usize::MAX)
    }

    fn dot_within(&self, other: &Self, rows: Range<usize>) -> f64 {
        let start = self.span.start.max(other.span.start).max(rows.start);
        let end = self.span.end.min(other.span.end).min(rows.end);
        if start < end {
            inner_product(&self.values[start..end], &other.values[start..end])
        } else {
            0.0
        }
    }
}

/// What an effect adds to the observations, in g, not yet whitened.
#[derive(Clone, Debug)]
pub struct Change {
    column: Column,
    starts: [usize; BLOCKS.len() + 1],
    /// What it adds to the variance of each run's `during`, g^2.
    pub variance: Vec<f64>,
}

impl Change {
    /// Adds to row `row` of a block.
    pub fn add(&mut self, block: Block, row: usize, value_g: f64) {
        if value_g != 0.0 {
            let (start, end) = (self.starts[block as usize], self.starts[block as usize + 1]);
            self.column.widen(start..end);
            self.column.values[start + row] += value_g;
        }
    }
}

/// What effects may look at.
#[derive(Clone, Debug)]
pub struct Situation<'c> {
    /// Dial readings.
    pub readings: &'c [Reading],
    /// Runs, those to be predicted included, in the order of time.
    pub runs: Vec<&'c Run>,
    /// Their motion: as commanded, or as another effect of the hypothesis has changed it.
    pub motions: Vec<Motion>,
    /// Tables for time means.
    pub averages: Rc<Averages>,
    /// Their bands.
    pub bands: Rc<Bands>,
    /// Coefficients that the nominal model is believed to have.
    pub coefficients: Coefficients<f64>,
    /// Largest magnitude of each run's vibration along IA, g.
    pub peaks_g: Vec<f64>,
    /// Relative excess of a sine's mean square that the reference saw over the command's.
    pub power_excess: f64,
    /// Relative standard uncertainty of the reference's rms.
    pub reference_rel_sigma: f64,
    /// Scale factor by which outputs are divided, V/g.
    pub scale_v_per_g: f64,
    /// Local gravity, g.
    pub gravity_g: f64,
    /// Reference temperature, degrees Celsius.
    pub reference_temp_c: f64,
    /// The logger's rate, Hz.
    pub logger_rate_hz: f64,
}

impl Situation<'_> {
    /// Believes these coefficients, and the peaks that follow from them.
    fn suppose(&mut self, coefficients: Coefficients<f64>) {
        self.coefficients = coefficients;
        let peak_g = |run: &&Run| peak_g(run, self.scale_v_per_g, &coefficients);
        self.peaks_g = self.runs.iter().map(peak_g).collect();
    }
}

/// Normal equations of the coefficients, prior included.
#[derive(Clone, Debug)]
pub(super) struct Normal {
    /// Matrix, row by row, lower triangle.
    pub(super) matrix: [f64; NOMINAL * NOMINAL],
    pub(super) right: [f64; NOMINAL],
    /// Sum of squares of the observations.
    pub(super) square: f64,
}

/// The whitened problem.
#[derive(Debug)]
pub struct Problem<'c> {
    /// What effects may look at.
    pub situation: Situation<'c>,
    /// Scale factor by which all outputs are divided, V/g.
    pub scale_v_per_g: f64,
    /// The observations, whitened.
    pub observed: Column,
    /// Nominal design at the commanded motion, whitened.
    pub nominal: Vec<Column>,
    /// First row of each block, and the end.
    pub starts: [usize; BLOCKS.len() + 1],
    /// Reciprocal standard deviation of each row but the static ones; zero where nothing was observed.
    pub weights: Vec<f64>,
    /// Lower triangle of the static covariance's Cholesky factor, row by row.
    static_factor: Vec<f64>,
    /// Normal equations of all rows that no motion touches.
    pub(super) still: Normal,
    /// Of each run the variance of M|a0 + w| over records of the moments that the reference saw, g^2.
    kink_variance: Vec<f64>,
    /// Squares of the reciprocal prior standard deviations of the coefficients.
    pub prior_precision: [f64; NOMINAL],
    /// What effects did last.
    pub(super) made: Made,
    /// First run that another reference, beside the instrument, sees: all that the instrument itself feels.
    pub(super) seen_beside_instrument: usize,
}

impl<'c> Problem<'c> {
    /// The campaign's observations; `further` runs are there for their predictions alone.
    pub fn new(campaign: &'c Campaign, further: &'c [Run]) -> Self {
        Self::with_scale(campaign, further, scale_factor(campaign))
    }

    /// The same with outputs divided by a given scale factor, V/g.
    pub fn with_scale(campaign: &'c Campaign, further: &'c [Run], scale_v_per_g: f64) -> Self {
        let readings = &campaign.readings[..];
        let mut runs: Vec<&Run> = campaign.runs.iter().chain(further).collect();
        runs.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let bench = &campaign.config.bench;
        let mut situation = Situation {
            motions: runs.iter().map(|run| Motion::commanded(run)).collect(),
            averages: Rc::new(Averages::new(runs.iter().copied())),
            bands: Rc::new(Bands::new(runs.iter().copied())),
            coefficients: Coefficients {
                scale_factor_v_per_g: scale_v_per_g,
                ..Coefficients::default()
            },
            peaks_g: Vec::new(),
            power_excess: power_excess(&runs, campaign),
            reference_rel_sigma: campaign
                .config
                .shaker
                .as_ref()
                .map_or(0.0, |s| s.reference_rms_rel_sigma),
            readings,
            runs,
            scale_v_per_g,
            gravity_g: bench.local_gravity_g,
            reference_temp_c: bench.reference_temp_c,
            logger_rate_hz: campaign.config.acquisition.sample_rate_hz,
        };
        situation.suppose(situation.coefficients);
        let (s, r) = (situation.readings.len(), situation.runs.len());
        let lengths = [s, r, r, r, r, r, r, 3 * r, 2 * r];
        let mut starts = [0; BLOCKS.len() + 1];
        for (block, length) in lengths.into_iter().enumerate() {
            starts[block + 1] = starts[block] + length;
        }
        let mut problem = Self {
            static_factor: static_factor(campaign, scale_v_per_g),
            still: Normal {
                matrix: [0.0; NOMINAL * NOMINAL],
                right: [0.0; NOMINAL],
                square: 0.0,
            },
            kink_variance: {
                let runs = situation.runs.iter().zip(&situation.motions);
                runs.map(|(run, motion)| match run.kind {
                    VibrationKind::Sine => 0.0,
                    VibrationKind::Random => {
                        let zero = motion.zero(run.specific_force_g.i);
                        let mean = situation
                            .averages
                            .mean(run, motion, &[zero], |a| a[0].abs());
                        mean.variance
                    }
                })
                .collect()
            },
            weights: vec![0.0; starts[BLOCKS.len()]],
            observed: Column {
                values: vec![0.0; starts[BLOCKS.len()]],
                span: 0..starts[BLOCKS.len()],
            },
            nominal: Vec::new(),
            prior_precision: PRIOR_SIGMA.map(|sigma| sigma.powi(-2)),
            made: Made::default(),
            seen_beside_instrument: usize::MAX,
            situation,
            scale_v_per_g,
            starts,
        };
        problem.observe(campaign);
        problem.nominal = problem.design(&problem.situation.motions);
        let mut still = problem.prior();
        for block in [
            Block::Static,
            Block::Before,
            Block::After,
            Block::Drift,
            Block::Reference,
            Block::Shape,
        ] {
            problem.absorb(&mut still, &problem.nominal, block);
        }
        problem.still = still;
        problem
    }

    /// Lets effects believe these coefficients.
    pub fn suppose(&mut self, coefficients: Coefficients<f64>) {
        self.situation.suppose(coefficients);
        self.made.clear();
    }

    /// Takes every coefficient but K1 as zero with this standard deviation, in its own unit.
    pub(super) fn believe(&mut self, sigma: f64) {
        for k in 1..NOMINAL {
            let precision = sigma.powi(-2);
            self.still.matrix[k * NOMINAL + k] += precision - self.prior_precision[k];
            self.prior_precision[k] = precision;
        }
    }

    /// Normal equations of the prior alone; K1's is about 1, in units of the scale factor.
    fn prior(&self) -> Normal {
        let mut prior = Normal {
            matrix: [0.0; NOMINAL * NOMINAL],
            right: [0.0; NOMINAL],
            square: self.prior_precision[0],
        };
        for i in 0..NOMINAL {
            prior.matrix[i * NOMINAL + i] = self.prior_precision[i];
        }
        prior.right[0] = self.prior_precision[0];
        prior
    }

    /// Adds the rows of a block, which count alike; `nominal` are the model's columns at the motion supposed.
    fn absorb(&self, normal: &mut Normal, nominal: &[Column], block: Block) {
        let (rows, observed) = (self.range(block), &self.observed);
        for (i, column) in nominal.iter().enumerate() {
            normal.right[i] += column.dot_within(observed, rows.clone());
            for (j, other) in nominal[..=i].iter().enumerate() {
                normal.matrix[i * NOMINAL + j] += column.dot_within(other, rows.clone());
            }
        }
        normal.square += observed.dot_within(observed, rows);
    }

    /// Normal equations of the coefficients when each run's `during` counts by its trust.
    pub(super) fn normal(&self, nominal: &[Column], trust: &[f64]) -> Normal {
        let mut normal = self.still.clone();
        for block in [Block::Maximum, Block::Minimum] {
            self.absorb(&mut normal, nominal, block);
        }
        let rows = self.range(Block::During);
        let trusted = |column: &Column| -> Vec<f64> {
            let values = column.values[rows.clone()].iter().zip(trust);
            values.map(|(value, trust)| value * trust).collect()
        };
        for (i, column) in nominal.iter().enumerate() {
            let trusted = trusted(column);
            normal.right[i] += inner_product(&trusted, &self.observed.values[rows.clone()]);
            for (j, other) in nominal[..=i].iter().enumerate() {
                normal.matrix[i * NOMINAL + j] +=
                    inner_product(&trusted, &other.values[rows.clone()]);
            }
        }
        let observed = trusted(&self.observed);
        normal.square += inner_product(&observed, &self.observed.values[rows.clone()]);
        normal
    }

    /// Inner product with each run's `during` weighted by the trust in it.
    pub(super) fn dot(&self, a: &Column, b: &Column, trust: &[f64]) -> f64 {
        let during = self.range(Block::During);
        let trusted = a.span.start.max(b.span.start) < during.end
            && a.span.end.min(b.span.end) > during.start;
        let weighted = if trusted {
            let rows = a.values[during.clone()]
                .iter()
                .zip(&b.values[during.clone()]);
            rows.zip(trust).map(|((a, b), t)| a * b * t).sum()
        } else {
            0.0
        };
        a.dot_within(b, 0..during.start) + weighted + a.dot_within(b, during.end..usize::MAX)
    }

    /// Columns with each run's `during` times its weight.
    pub(super) fn weighted<'a>(
        &self,
        columns: impl IntoIterator<Item = &'a Column>,
        weight: &[f64],
    ) -> Vec<Column> {
        let during = self.range(Block::During);
        let weighted = columns.into_iter().cloned().map(|mut column| {
            for (value, weight) in column.values[during.clone()].iter_mut().zip(weight) {
                *value *= weight;
            }
            column
        });
        weighted.collect()
    }

    /// Rows of a block.
    pub fn range(&self, block: Block) -> Range<usize> {
        self.starts[block as usize]..self.starts[block as usize + 1]
    }

    /// Number of runs, those to be predicted included.
    pub fn run_count(&self) -> usize {
        self.situation.runs.len()
    }

    /// A change of nothing.
    pub fn no_change(&self) -> Change {
        Change {
            column: Column {
                values: vec![0.0; self.weights.len()],
                span: 0..0,
            },
            starts: self.starts,
            variance: vec![0.0; self.run_count()],
        }
    }

    /// A column of whitened values.
    pub fn column(&self, values: Vec<f64>) -> Column {
        let mut column = Column { values, span: 0..0 };
        for rows in BLOCKS.map(|block| self.range(block)) {
            if column.values[rows.clone()].iter().any(|&v| v != 0.0) {
                column.widen(rows);
            }
        }
        column
    }

    /// The change divided by the observations' uncertainty, and the variance that it adds.
    pub fn whiten(&self, change: Change) -> (Column, Vec<f64>) {
        let mut column = change.column;
        self.whiten_column(&mut column);
        (column, change.variance)
    }

    fn whiten_column(&self, column: &mut Column) {
        let first = self.starts[1];
        if column.span.start < first {
            let (head, _) = column.values.split_at_mut(first);
            let mut row = &self.static_factor[..];
            for i in 0..first {
                let (coefficients, rest) = row.split_at(i + 1);
                let known: f64 = coefficients[..i]
                    .iter()
                    .zip(&*head)
                    .map(|(l, x)| l * x)
                    .sum();
                head[i] = (head[i] - known) / coefficients[i];
                row = rest;
            }
        }
        for (value, weight) in column.values[first..]
            .iter_mut()
            .zip(&self.weights[first..])
        {
            *value *= weight;
        }
    }

    /// The nominal model's columns, whitened, for runs with these motions.
    pub fn design(&self, motions: &[Motion]) -> Vec<Column> {
        let still: Vec<_> = self
            .situation
            .readings
            .iter()
            .map(|r| terms(r.specific_force_g))
            .collect();
        let rest: Vec<_> = self
            .situation
            .runs
            .iter()
            .map(|r| terms(r.specific_force_g))
            .collect();
        let moving: Vec<_> = self.moving(motions);
        (0..NOMINAL)
            .map(|k| {
                let mut change = self.no_change();
                for (row, terms) in still.iter().enumerate() {
                    change.add(Block::Static, row, terms[k]);
                }
                for (row, (terms, [during, maximum, minimum])) in
                    rest.iter().zip(&moving).enumerate()
                {
                    change.add(Block::Before, row, terms[k]);
                    change.add(Block::After, row, terms[k]);
                    change.add(Block::During, row, terms[k] + during[k]);
                    change.add(Block::Maximum, row, maximum[k]);
                    change.add(Block::Minimum, row, minimum[k]);
                }
                self.whiten(change).0
            })
            .collect()
    }

    /// The nominal columns with the rows that depend on motion exchanged.
    pub fn redesign(&self, motions: &[Motion]) -> Vec<Column> {
        let mut columns = self.nominal.clone();
        let rows = [Block::Before, Block::During, Block::Maximum, Block::Minimum]
            .map(|block| self.starts[block as usize]);
        for (row, ([during, maximum, minimum], run)) in self
            .moving(motions)
            .iter()
            .zip(&self.situation.runs)
            .enumerate()
        {
            let rest = terms(run.specific_force_g);
            for (k, column) in columns.iter_mut().enumerate() {
                for (start, value) in
                    rows[1..]
                        .iter()
                        .zip([rest[k] + during[k], maximum[k], minimum[k]])
                {
                    column.values[start + row] = value * self.weights[start + row];
                }
            }
        }
        columns
    }

    /// Of each run the derivatives of vibration error, greatest and least output by the coefficients.
    pub(super) fn moving(&self, motions: &[Motion]) -> Vec<[[f64; NOMINAL]; 3]> {
        let runs = self.situation.runs.iter().zip(motions);
        runs.map(|(run, motion)| {
            let at = |multiple: f64| {
                let [i, p, o] = motion.amplitude_g.map(|w| w * multiple);
                let a0 = run.specific_force_g;
                terms(SpecificForce::new(a0.i + i, a0.p + p, a0.o + o))
            };
            if run.kind == VibrationKind::Random {
                return [motion.sensitivity(run), [0.0; NOMINAL], [0.0; NOMINAL]];
            }
            let [most, least] = motion.extremes();
            [motion.sensitivity(run), at(most), at(least)]
        })
        .collect()
    }

    fn observe(&mut self, campaign: &Campaign) {
        let scale = self.scale_v_per_g;
        let mut y = self.no_change();
        let mut sigma = vec![f64::INFINITY; self.weights.len()];
        for (row, reading) in self.situation.readings.iter().enumerate() {
            y.add(Block::Static, row, reading.output_v / scale);
        }
        let relative = campaign
            .config
            .shaker
            .as_ref()
            .map(|shaker| shaker.reference_rms_rel_sigma);
        let start = self.starts;
        for (row, run) in self.situation.runs.iter().enumerate() {
            let Some(measured) = run.measured else {
                continue;
            };
            let noise = measured.sigma_v / scale;
            let mut put = |block: Block, row: usize, value: f64, uncertainty: f64| {
                y.add(block, row, value);
                sigma[start[block as usize] + row] = uncertainty;
            };
            put(Block::Before, row, measured.before_v / scale, noise);
            put(Block::During, row, measured.during_v / scale, noise);
            put(Block::After, row, measured.after_v / scale, noise);
            put(
                Block::Drift,
                row,
                measured.drift_v_per_s / scale,
                measured.drift_sigma_v_per_s / scale,
            );
            let excursion = (run.direction[0] * run.level_g).abs();
            if let (Some(extremes), true) = (measured.extremes, excursion > EXTREME_LEAST_G) {
                // Nobody knows a random record's peaks beforehand: what is observed is by how much they pass a limit,
                // nothing.
                let (uncertainty, seen) = match run.kind {
                    VibrationKind::Sine => (EXTREME_REL_SIGMA * excursion, 1.0),
                    VibrationKind::Random => (4.0 * EXTREME_REL_SIGMA * excursion, 0.0),
                };
                put(
                    Block::Maximum,
                    row,
                    seen * extremes.maximum_v / scale,
                    uncertainty,
                );
                put(
                    Block::Minimum,
                    row,
                    seen * extremes.minimum_v / scale,
                    uncertainty,
                );
            }
            let (Some(seen), Some(relative)) = (&run.reference, relative) else {
                continue;
            };
            let Some(ratios) = seen_ratios(run) else {
                continue;
            };
            for axis in 0..3 {
                let uncertainty = (relative * ratios[axis]).hypot(REFERENCE_SIGMA);
                put(
                    Block::Reference,
                    3 * row + axis,
                    ratios[axis] - run.direction[axis],
                    uncertainty,
                );
            }
            if run.kind == VibrationKind::Sine {
                let axis = main_axis(&run.direction);
                put(
                    Block::Shape,
                    2 * row,
                    seen.skewness[axis] * run.direction[axis].signum(),
                    SHAPE_SIGMA,
                );
                put(
                    Block::Shape,
                    2 * row + 1,
                    seen.kurtosis[axis] - 1.5,
                    SHAPE_SIGMA,
                );
            }
        }
        self.weights = sigma.iter().map(|sigma| sigma.recip()).collect();
        let (mut column, _) = (y.column, y.variance);
        column.span = 0..column.values.len();
        self.whiten_column(&mut column);
        self.observed = column;
    }

    /// Variance of a run's vibration error from a spectrum that nobody measured, g^2.
    pub(super) fn spectral_variance(
        &self,
        run: &Run,
        motion: &Motion,
        coefficients: &Coefficients<f64>,
    ) -> f64 {
        match motion.power_variance {
            0.0 => 0.0,
            variance => variance * power_slope(run, motion, coefficients).powi(2),
        }
    }

    /// Variance of each run's `during` beside its noise, in units of the noise's: what of a random record nobody saw.
    pub fn unseen_variance(
        &self,
        coefficients: &Coefficients<f64>,
        motions: &[Motion],
        added: &[f64],
    ) -> Vec<f64> {
        let start = self.starts[Block::During as usize];
        let runs = self
            .situation
            .runs
            .iter()
            .zip(motions)
            .zip(added)
            .enumerate();
        runs.map(|(row, ((run, motion), added))| {
            let spectral = self.spectral_variance(run, motion, coefficients);
            let unseen = if run.reference.is_some() {
                coefficients.asymmetry.powi(2) * self.kink_variance[row]
            } else {
                unseen_variance_g2(run, coefficients)
            };
            (unseen + added + spectral) * self.weights[start + row].powi(2)
        })
        .collect()
    }
}

/// Derivative of the vibration error by the logarithm of the mean square, g.
fn power_slope(run: &Run, motion: &Motion, coefficients: &Coefficients<f64>) -> f64 {
    let at = |factor: f64| {
        let mut motion = *motion;
        motion.scale(factor);
        let c = coefficients.to_nominal();
        motion
            .sensitivity(run)
            .iter()
            .zip(c)
            .map(|(s, c)| s * c)
            .sum::<f64>()
    };
    (at(1.01) - at(0.99)) / 0.04
}

/// The reference's rms over the commanded level on each axis, with the sign of the motion.
pub fn seen_ratios(run: &Run) -> Option<[f64; 3]> {
    let seen = run.reference.as_ref()?;
    let level = match run.kind {
        VibrationKind::Sine => run.level_g * std::f64::consts::FRAC_1_SQRT_2,
        VibrationKind::Random => run.level_g,
    };
    if level <= 0.0 {
        return None;
    }
    let main = main_axis(&run.direction);
    // Which correlation ties an axis to the main one.
    let pair = [[3, 0, 1], [0, 3, 2], [1, 2, 3]][main];
    let sign = run.direction[main].signum();
    let mut ratios = [0.0; 3];
    for axis in 0..3 {
        let with_main = match (axis == main, &seen.correlation) {
            (true, _) => 1.0,
            (false, Some(correlation)) => correlation[pair[axis]],
            (false, None) => (run.direction[axis] * run.direction[main]).signum(),
        };
        ratios[axis] = sign * with_main.signum() * seen.rms_g[axis] / level;
    }
    Some(ratios)
}

/// Mean square that the reference saw along the main axis over the command's, less 1; zero within four of its sigmas.
fn power_excess(runs: &[&Run], campaign: &Campaign) -> f64 {
    let relative = campaign
        .config
        .shaker
        .as_ref()
        .map_or(0.0, |s| s.reference_rms_rel_sigma);
    let of_kind = runs.iter().filter(|run| run.kind == VibrationKind::Sine);
    let excess: Vec<f64> = of_kind
        .filter_map(|run| {
            let main = main_axis(&run.direction);
            Some((seen_ratios(run)?[main] / run.direction[main]).powi(2) - 1.0)
        })
        .collect();
    let mean = excess.iter().sum::<f64>() / excess.len().max(1) as f64;
    let sigma = 2.0 * relative / (excess.len().max(1) as f64).sqrt();
    if mean.abs() > 4.0 * sigma { mean } else { 0.0 }
}

/// Cosine of the angle between motion and IA below which the output's extremes do not tell the motion.
const LEAST_COSINE: f64 = 0.05;

/// Largest magnitude of a run's vibration along IA, g: the excursion that gives the output's extremes.
fn peak_g(run: &Run, scale_v_per_g: f64, coefficients: &Coefficients<f64>) -> f64 {
    let extremes = run.measured.and_then(|m| m.extremes);
    let Some(extremes) = extremes.filter(|_| run.direction[0].abs() >= LEAST_COSINE) else {
        let commanded = (run.direction[0] * run.level_g).abs();
        return match run.kind {
            VibrationKind::Sine => commanded,
            // The expected maximum of some 1e4 independent values.
            VibrationKind::Random => 4.0 * commanded,
        };
    };
    let rest = run.specific_force_g;
    let [i, p, o] = run.direction.map(|cosine| cosine / run.direction[0]);
    let excursion = |extreme_v: f64| {
        (0..4).fold(0.0, |w: f64, _| {
            let force = SpecificForce::new(rest.i + i * w, rest.p + p * w, rest.o + o * w);
            w + extreme_v / scale_v_per_g - coefficients.output_g(force)
        })
    };
    let [most, least] = [extremes.maximum_v, extremes.minimum_v].map(excursion);
    most.abs().max(least.abs())
}

/// K1 to some 1e-4 from all that stands still: enough to turn volts into g.
fn scale_factor(campaign: &Campaign) -> f64 {
    let readings = campaign
        .readings
        .iter()
        .map(|r| (r.specific_force_g.i, r.output_v));
    let runs = campaign
        .runs
        .iter()
        .filter_map(|r| Some((r.specific_force_g.i, r.measured?.before_v)));
    let (mut n, mut a, mut u, mut aa, mut au) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (force, output) in readings.chain(runs) {
        n += 1.0;
        a += force;
        u += output;
        aa += force * force;
        au += force * output;
    }
    let slope = (n * au - a * u) / (n * aa - a * a);
    if slope.is_finite() && slope > 0.0 {
        slope
    } else {
        campaign.config.instrument.scale_factor_nominal_v_per_g
    }
}

/// Cholesky factor of the covariance of the static readings in g^2.
fn static_factor(campaign: &Campaign, scale_v_per_g: f64) -> Vec<f64> {
    let bench = &campaign.config.bench;
    let radians = |arcsec: f64| (arcsec * ARCSEC_RAD * bench.local_gravity_g).powi(2);
    let (mark, repeat) = (
        radians(bench.dial_sigma_arcsec),
        radians(bench.dial_repeat_sigma_arcsec),
    );
    let (mount, level) = (
        radians(bench.mount_sigma_arcsec),
        radians(bench.level_sigma_arcsec),
    );
    let rows: Vec<_> = campaign
        .readings
        .iter()
        .map(|reading| {
            let tangent = reading.series.tangent(position(reading).phi_rad()).i;
            let lift = reading.series.lift::<f64>().i;
            (
                tangent,
                lift,
                within_a_turn(reading.dial_deg),
                within_a_turn(reading.mount_deg),
                reading.series,
            )
        })
        .collect();
    let mut factor: Vec<f64> = Vec::with_capacity(rows.len() * (rows.len() + 1) / 2);
    for (i, a) in rows.iter().enumerate() {
        let start = factor.len();
        for (j, b) in rows[..=i].iter().enumerate() {
            let mut covariance = level * (a.0 * b.0 + a.1 * b.1);
            if a.2 == b.2 {
                covariance += mark * a.0 * b.0;
            }
            // As first mounted the instrument defines its own angle.
            if a.3 != 0.0 && a.3 == b.3 && a.4 == b.4 {
                covariance += mount * a.0 * b.0;
            }
            if i == j {
                covariance +=
                    (campaign.readings[i].sigma_v / scale_v_per_g).powi(2) + repeat * a.0 * a.0;
            }
            let row_j = j * (j + 1) / 2;
            let dot: f64 = factor[start..start + j]
                .iter()
                .zip(&factor[row_j..row_j + j])
                .map(|(x, y)| x * y)
                .sum();
            let left = covariance - dot;
            let value = if i == j {
                left.max(1e-24).sqrt()
            } else {
                left / factor[row_j + j]
            };
            factor.push(value);
        }
    }
    factor
}
