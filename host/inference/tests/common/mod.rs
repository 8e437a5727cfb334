//! Plain numbers: a parabola in `u` with additions of every kind, and the same observations as one dense Gaussian, by which
//! what the package says is checked without its own arithmetic.

#![allow(dead_code)] // Each test uses a part.

use std::ops::Range;
use std::sync::Arc;

use inference::model::{
    Base, Component, Fidelity, Kind, Member, Prediction, SeparableModel, Transformed,
};
use inference::observations::{Column, Observable, Observations};
use inference::prior::{Parameter, even, linear, logarithmic, stepped};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Rows of the three observables: correlated ones, plain ones, and uncertain ones, which a transformation changes.
pub const CORRELATED: Range<usize> = 0..8;
pub const PLAIN: Range<usize> = 8..20;
pub const UNCERTAIN: Range<usize> = 20..52;
pub const ROWS: usize = 52;
pub const UNKNOWNS: usize = 3;
const PRIOR_SIGMA: [f64; UNKNOWNS] = [3.0, 2.0, 2.0];
const PRIOR_MEAN: [f64; UNKNOWNS] = [1.0, 0.0, 0.0];

/// Components by their number.
pub const WAVE: usize = 0;
pub const BUMP: usize = 1;
pub const MEMORY: usize = 2;
pub const STRETCH: usize = 3;
pub const SCATTER: usize = 4;
pub const TWO_WAVES: usize = 5;

pub const WIDTH: f64 = 0.5;
pub const CENTRE: (f64, f64) = (-1.0, 1.0);
pub const KEPT: (f64, f64) = (0.4, 1.0);
pub const THRESHOLD: (f64, f64) = (0.0, 10.0);
pub const STRETCHED: (f64, f64) = (-0.5, 0.5);
pub const SIZE: (f64, f64) = (1e-3, 1e1);

const fn component(parameters: &'static [Parameter], kind: Kind) -> Component {
    Component {
        parameters,
        kind,
        signs_alike: false,
    }
}

static COMPONENTS: [Component; 6] = [
    component(&[linear("height", WIDTH)], Kind::Adds),
    component(
        &[
            linear("height", WIDTH),
            even("centre", CENTRE.0, CENTRE.1, 24),
        ],
        Kind::Adds,
    ),
    component(
        &[
            linear("step", WIDTH),
            even("kept", KEPT.0, KEPT.1, 6),
            stepped("threshold", THRESHOLD.0, THRESHOLD.1, 40),
        ],
        Kind::Adds,
    ),
    component(
        &[even("stretch", STRETCHED.0, STRETCHED.1, 9)],
        Kind::TransformsBase,
    ),
    component(
        &[logarithmic("size", SIZE.0, SIZE.1, 24)],
        Kind::AddsVariance,
    ),
    component(&[linear("one", WIDTH), linear("other", WIDTH)], Kind::Adds),
];

/// A parabola in `u`, what was observed of it, and what may act beside it.
pub struct Synthetic {
    pub u: Vec<f64>,
    /// Of each uncertain row what a threshold is compared with.
    pub peak: Vec<f64>,
    /// Stated covariance of all rows.
    pub covariance: DMatrix<f64>,
    pub observed: DVector<f64>,
    /// Uncertain rows that [`SCATTER`] touches.
    pub scattered: Range<usize>,
    observations: Observations,
    base: Base,
}

impl Synthetic {
    /// With `acting` at its values, and noise, all drawn by `random`; each of the base's unknowns from its prior.
    pub fn draw(random: &mut Random, acting: &[Member]) -> Self {
        let u: Vec<f64> = (0..ROWS).map(|_| random.uniform(-1.0, 1.0)).collect();
        let peak = UNCERTAIN.map(|_| random.uniform(0.5, 9.5)).collect();
        let mut covariance = DMatrix::identity(ROWS, ROWS) * 0.04;
        for i in CORRELATED {
            for j in CORRELATED {
                covariance[(i, j)] += 0.02;
            }
        }
        let mut synthetic = Self::observing(u, peak, covariance, DVector::zeros(ROWS));
        let base = DVector::from_fn(UNKNOWNS, |k, _| {
            PRIOR_MEAN[k] + PRIOR_SIGMA[k] * random.normal()
        });
        let mut observed = synthetic.says(acting, &base);
        let factor = synthetic.whole_covariance(acting).cholesky().unwrap().l();
        observed += factor * DVector::from_fn(ROWS, |_, _| random.normal());
        let Self {
            u,
            peak,
            covariance,
            ..
        } = synthetic;
        synthetic = Self::observing(u, peak, covariance, observed);
        synthetic
    }

    /// With these rows.
    pub fn observing(
        u: Vec<f64>,
        peak: Vec<f64>,
        covariance: DMatrix<f64>,
        observed: DVector<f64>,
    ) -> Self {
        let observable = |name, rows, transforms| Observable {
            name,
            rows,
            transforms,
        };
        let corner = covariance.view((0, 0), (CORRELATED.end, CORRELATED.end));
        let lower = corner.into_owned().cholesky().unwrap().l();
        let packed = CORRELATED.flat_map(|i| (0..=i).map(move |j| (i, j)));
        let weights = (0..ROWS).map(|row| covariance[(row, row)].sqrt().recip());
        let observations = Observations::new(
            vec![
                observable("correlated", CORRELATED, false),
                observable("plain", PLAIN, false),
                observable("uncertain", UNCERTAIN, true),
            ],
            vec![0, 1, 2],
            2,
            packed.map(|place| lower[place]).collect(),
            weights.collect(),
            observed.iter().copied().collect(),
        );
        let columns = (0..UNKNOWNS).map(|k| whole(&observations, |row| u[row].powi(k as i32)));
        let columns = columns.collect();
        let precision = PRIOR_SIGMA.map(|sigma| sigma.powi(-2));
        let base = Base::new(
            &observations,
            columns,
            precision.to_vec(),
            PRIOR_MEAN.to_vec(),
        );
        Self {
            u,
            peak,
            covariance,
            observed,
            scattered: 0..12,
            observations,
            base,
        }
    }

    /// What the base's unknowns do, not whitened, with a transformation that acts.
    pub fn design(&self, acting: &[Member]) -> DMatrix<f64> {
        let stretch = acting.iter().find(|m| m.component == STRETCH);
        let stretch = stretch.map_or(0.0, |m| m.values[0]);
        DMatrix::from_fn(ROWS, UNKNOWNS, |row, k| {
            let touched = UNCERTAIN.contains(&row);
            let u = self.u[row] * if touched { 1.0 + stretch } else { 1.0 };
            u.powi(k as i32)
        })
    }

    /// What a member adds for a unit of each parameter in proportion, not whitened.
    pub fn units(&self, member: &Member) -> Vec<DVector<f64>> {
        let of = |value: &dyn Fn(usize) -> f64| DVector::from_fn(ROWS, |row, _| value(row));
        match member.component {
            WAVE => vec![of(&|row| (3.0 * self.u[row]).sin())],
            BUMP => {
                let centre = member.values[1];
                vec![of(&|row| {
                    (-0.5 * ((self.u[row] - centre) / 0.2).powi(2)).exp()
                })]
            }
            MEMORY => vec![self.memory(member.values[1], member.values[2])],
            TWO_WAVES => vec![
                of(&|row| (3.0 * self.u[row]).sin()),
                of(&|row| (4.0 * self.u[row]).sin()),
            ],
            _ => Vec::new(),
        }
    }

    /// Each uncertain row over the threshold leaves a step, each step smaller than the one before.
    fn memory(&self, kept: f64, threshold: f64) -> DVector<f64> {
        let mut column = DVector::zeros(ROWS);
        let (mut sum, mut step) = (0.0, 1.0);
        for (row, peak) in UNCERTAIN.zip(&self.peak) {
            if *peak > threshold {
                sum += step;
                step *= kept;
            }
            column[row] = sum;
        }
        column
    }

    /// The observations without noise.
    pub fn says(&self, acting: &[Member], base: &DVector<f64>) -> DVector<f64> {
        let mut sum = self.design(acting) * base;
        for member in acting {
            for (unit, x) in self.units(member).iter().zip(&member.values) {
                sum += unit * *x;
            }
        }
        sum
    }

    /// Stated covariance with the variance that acts.
    pub fn whole_covariance(&self, acting: &[Member]) -> DMatrix<f64> {
        let mut covariance = self.covariance.clone();
        for member in acting.iter().filter(|m| m.component == SCATTER) {
            for n in self.scattered.clone() {
                let row = UNCERTAIN.start + n;
                covariance[(row, row)] += member.values[0].powi(2);
            }
        }
        covariance
    }

    /// The observations with the base integrated out, all parameters known: by one dense Gaussian.
    pub fn dense(&self, acting: &[Member]) -> Dense {
        let design = self.design(acting);
        let prior = DMatrix::from_diagonal(&DVector::from_row_slice(&PRIOR_SIGMA.map(|s| s * s)));
        let covariance = self.whole_covariance(acting) + &design * prior * design.transpose();
        let mean = &design * DVector::from_row_slice(&PRIOR_MEAN);
        let lower = covariance.cholesky().unwrap().l();
        let log_determinant = 2.0 * lower.diagonal().map(f64::ln).sum();
        Dense {
            left: lower
                .solve_lower_triangular(&(&self.observed - mean))
                .unwrap(),
            lower,
            log_determinant,
        }
    }
}

/// A dense Gaussian: what is observed less its mean, in units of noise.
pub struct Dense {
    pub lower: DMatrix<f64>,
    pub left: DVector<f64>,
    pub log_determinant: f64,
}

impl Dense {
    /// -2 ln density of what was observed, up to a constant that all share.
    pub fn objective(&self) -> f64 {
        self.left.norm_squared() + self.log_determinant
    }

    /// Estimate and standard deviation of a proportion of `unit`, without a prior.
    pub fn estimate(&self, unit: &DVector<f64>) -> (f64, f64) {
        let unit = self.lower.solve_lower_triangular(unit).unwrap();
        let information = unit.norm_squared();
        if information == 0.0 {
            return (0.0, f64::INFINITY);
        }
        (
            unit.dot(&self.left) / information,
            information.sqrt().recip(),
        )
    }
}

fn whole(observations: &Observations, value: impl Fn(usize) -> f64) -> Column {
    let mut column = Column::zero(ROWS);
    for rows in [CORRELATED, PLAIN, UNCERTAIN] {
        for row in rows.clone() {
            column.add_at(rows.clone(), row - rows.start, value(row));
        }
    }
    observations.whiten(column)
}

impl SeparableModel for Synthetic {
    fn observations(&self) -> &Observations {
        &self.observations
    }

    fn base(&self) -> &Base {
        &self.base
    }

    fn components(&self) -> &[Component] {
        &COMPONENTS
    }

    fn predict(&self, members: &[Member], _: Fidelity) -> Prediction {
        let mut prediction = Prediction::of_base(UNCERTAIN.len());
        for member in members {
            let units = self.units(member).into_iter();
            let columns = units.map(|unit| {
                let column = whole(&self.observations, |row| unit[row]);
                (column, vec![0.0; UNCERTAIN.len()])
            });
            prediction.add_linear(Arc::new(columns.collect()));
            match member.component {
                STRETCH => {
                    let design = self.design(members);
                    let rows = UNCERTAIN.flat_map(|row| {
                        let weight = self.observations.weight(row);
                        let values = design.row(row).into_owned() * weight;
                        values.iter().copied().collect::<Vec<_>>()
                    });
                    let transformed = Transformed::new(rows.collect(), UNKNOWNS);
                    prediction.transform(Arc::new(transformed));
                }
                SCATTER => {
                    let size = member.values[0];
                    let added = (0..UNCERTAIN.len()).map(|n| {
                        let touched = self.scattered.contains(&n);
                        if touched { size * size } else { 0.0 }
                    });
                    prediction.add_variance(added);
                }
                _ => {}
            }
        }
        prediction
    }

    fn variance(&self, _: &[Member], prediction: &Prediction, x: &[f64]) -> Vec<f64> {
        let added = prediction.added_variance(&x[UNKNOWNS..]).into_iter();
        let weights = UNCERTAIN.map(|row| self.observations.weight(row).powi(2));
        added.zip(weights).map(|(v, w)| v * w).collect()
    }

    fn unit_variance(&self, component: usize) -> Vec<f64> {
        let touched = |n: usize| component == SCATTER && self.scattered.contains(&n);
        let rows = UNCERTAIN.enumerate();
        rows.map(|(n, row)| match touched(n) {
            true => self.observations.weight(row).powi(2),
            false => 0.0,
        })
        .collect()
    }

    fn threshold_steps(&self, from: f64, to: f64) -> Vec<(f64, f64)> {
        let mut edges = self.peak.clone();
        edges.retain(|peak| (from..to).contains(peak));
        edges.extend([from, to]);
        edges.sort_by(f64::total_cmp);
        edges.windows(2).map(|edge| (edge[0], edge[1])).collect()
    }

    fn linearise_about(&mut self, _: &[f64]) {}

    fn smooth_families(&self) -> Vec<Vec<Column>> {
        let column = |degree: i32| whole(&self.observations, |row| self.u[row].powi(degree));
        vec![vec![column(3), column(4)]]
    }
}

/// Random numbers, the same for the same seed.
pub struct Random(ChaCha8Rng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub fn normal(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }
}

/// A member of that component.
pub fn member(component: usize, values: &[f64]) -> Member {
    Member {
        component,
        values: values.to_vec(),
    }
}

/// The fit of one component from all of its grid's starts, with the greatest evidence.
pub fn best_fit(model: &Synthetic, component: usize) -> inference::fit::Fit {
    let starts = COMPONENTS[component].grid().into_iter();
    let fits = starts.filter_map(|values| {
        inference::variance::fit_with_size(
            model,
            vec![Member { component, values }],
            &[1.0; UNCERTAIN.end - UNCERTAIN.start],
        )
    });
    fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
        .unwrap()
}
