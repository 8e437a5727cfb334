//! What the next reading should be, by the readings so far: a linear-Gaussian model of everything that is the same from one
//! reading to another, in units of the type's scale factor.
//!
//! Unknown are the coefficients times the scale factor (1), the base's two tilts, the error of each mounting and of each mark;
//! each has a mean and a standard deviation beforehand. What a reading shares with those before it is known from them, and what
//! it does not share is as uncertain as stated.

use nalgebra::{DMatrix, DVector};
use shared::model::{NOMINAL, terms};
use shared::tumble::{ARCSEC_RAD, Position, within_a_turn};

use crate::campaign::{Bench, CampaignConfig, Reading};
use crate::statics::{self, DEFAULT_PRIOR_SIGMA};

/// Standard deviation about zero of every coefficient but K1: ten times that of a prediction, so that a badly mounted
/// instrument (some milliradians) is no alarm.
const WIDE_PRIOR_SIGMA: f64 = 10.0 * DEFAULT_PRIOR_SIGMA;
/// Relative standard deviation of a type's scale factor: "some per cent".
const TYPE_REL_SIGMA: f64 = 0.03;

/// The base's two tilts.
const TILTS: usize = 2;

/// The state of knowledge after some readings.
#[derive(Clone, Debug)]
pub(super) struct Expectation {
    bench: Bench,
    nominal_v_per_g: f64,
    /// Series and mount, and marks, in the order in which they came.
    mounts: Vec<(u8, u64)>,
    marks: Vec<u64>,
    /// Of coefficients, tilts, mounts, marks.
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Expectation {
    /// After these readings. Where rounding forbids it, as before any.
    pub(super) fn new(config: &CampaignConfig, readings: &[Reading]) -> Self {
        let mut expectation = Self {
            bench: config.bench.clone(),
            nominal_v_per_g: config.instrument.scale_factor_nominal_v_per_g,
            mounts: Vec::new(),
            marks: Vec::new(),
            mean: DVector::zeros(0),
            covariance: DMatrix::zeros(0, 0),
        };
        for position in readings.iter().map(statics::position) {
            let (mount, mark) = keys(&position);
            if !expectation.mounts.contains(&mount) {
                expectation.mounts.push(mount);
            }
            if !expectation.marks.contains(&mark) {
                expectation.marks.push(mark);
            }
        }
        let prior_sigma = expectation.prior_sigma();
        let mut prior_mean = DVector::zeros(prior_sigma.len());
        prior_mean[0] = 1.0;
        expectation.mean = prior_mean.clone();
        expectation.covariance = DMatrix::from_diagonal(&prior_sigma.map(|s| s * s));
        // The angles' effect is in proportion to the scale factor, which the first pass finds.
        for _ in 0..2 {
            let Some((mean, covariance)) = expectation.updated(&prior_mean, &prior_sigma, readings)
            else {
                break;
            };
            (expectation.mean, expectation.covariance) = (mean, covariance);
        }
        expectation
    }

    fn prior_sigma(&self) -> DVector<f64> {
        let arcsec = |angle: f64| angle * ARCSEC_RAD;
        let mut sigma = vec![WIDE_PRIOR_SIGMA; NOMINAL];
        sigma[0] = TYPE_REL_SIGMA;
        sigma.extend([arcsec(self.bench.level_sigma_arcsec); TILTS]);
        sigma.extend(
            self.mounts
                .iter()
                .map(|_| arcsec(self.bench.mount_sigma_arcsec)),
        );
        sigma.extend(
            self.marks
                .iter()
                .map(|_| arcsec(self.bench.dial_sigma_arcsec)),
        );
        DVector::from_vec(sigma)
    }

    /// Mean and covariance by Bayes' rule. Unknowns are counted in their standard deviations, so that one of none is harmless.
    fn updated(
        &self,
        prior_mean: &DVector<f64>,
        prior_sigma: &DVector<f64>,
        readings: &[Reading],
    ) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let count = prior_sigma.len();
        let mut information = DMatrix::identity(count, count);
        let mut weighted = DVector::zeros(count);
        for reading in readings {
            let row = self.row(&statics::position(reading));
            let output = reading.output_v / self.nominal_v_per_g;
            let residual = output - row.dot(prior_mean);
            let row = row.component_mul(prior_sigma);
            let variance = self.own_variance(&statics::position(reading), reading.sigma_v);
            information.ger(1.0 / variance, &row, &row, 1.0);
            weighted.axpy(residual / variance, &row, 1.0);
        }
        let factor = information.cholesky()?;
        let scale = DMatrix::from_diagonal(prior_sigma);
        let mean = prior_mean + factor.solve(&weighted).component_mul(prior_sigma);
        Some((mean, &scale * factor.inverse() * &scale))
    }

    /// The derivatives of a reading at a position by the unknowns.
    fn row(&self, position: &Position) -> DVector<f64> {
        let g = self.bench.local_gravity_g;
        let mut a = position.specific_force();
        (a.i, a.p, a.o) = (g * a.i, g * a.p, g * a.o);
        let (mount, mark) = keys(position);
        let mut row = vec![0.0; self.mean.len()];
        row[..NOMINAL].copy_from_slice(&terms(a));
        let by_angle = self.by_angle(position);
        row[NOMINAL] = by_angle;
        row[NOMINAL + 1] = self.mean[0] * g * position.series.lift::<f64>().i;
        let mounts = NOMINAL + TILTS;
        if let Some(k) = self.mounts.iter().position(|known| *known == mount) {
            row[mounts + k] = by_angle;
        }
        if let Some(k) = self.marks.iter().position(|known| *known == mark) {
            row[mounts + self.mounts.len() + k] = by_angle;
        }
        DVector::from_vec(row)
    }

    /// Derivative of a reading by the instrument's angle, 1/rad.
    fn by_angle(&self, position: &Position) -> f64 {
        let g = self.bench.local_gravity_g;
        self.mean[0] * g * position.series.tangent(position.phi_rad()).i
    }

    /// Variance of what a reading shares with no other, in units of the type's scale factor squared.
    fn own_variance(&self, position: &Position, sigma_v: f64) -> f64 {
        let repeat = self.bench.dial_repeat_sigma_arcsec * ARCSEC_RAD * self.by_angle(position);
        (sigma_v / self.nominal_v_per_g).powi(2) + repeat * repeat
    }

    /// What a reading with this noise should be, and its standard uncertainty, V.
    pub(super) fn of(&self, position: &Position, sigma_v: f64) -> (f64, f64) {
        let row = self.row(position);
        let (mount, mark) = keys(position);
        let by_angle = ARCSEC_RAD * self.by_angle(position);
        let new = |known: bool, arcsec: f64| if known { 0.0 } else { arcsec * by_angle };
        let new_mount = new(self.mounts.contains(&mount), self.bench.mount_sigma_arcsec);
        let new_mark = new(self.marks.contains(&mark), self.bench.dial_sigma_arcsec);
        let known = row.dot(&(&self.covariance * &row)).max(0.0);
        let variance = known
            + new_mount * new_mount
            + new_mark * new_mark
            + self.own_variance(position, sigma_v);
        let k1 = self.nominal_v_per_g;
        (k1 * row.dot(&self.mean), k1.abs() * variance.sqrt())
    }

    /// Scale factor, V/g.
    pub(super) fn scale_factor_v_per_g(&self) -> f64 {
        self.nominal_v_per_g * self.mean[0]
    }
}

/// What tells a mounting and a mark.
fn keys(position: &Position) -> ((u8, u64), u64) {
    let mount = (u8::from(position.series), position.mount_deg.to_bits());
    (mount, within_a_turn(position.dial_deg).to_bits())
}
