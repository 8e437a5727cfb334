//! What one campaign tells of its instrument and of the marks of the head, mounts, level and noise integrated out.

use inference::dense::Cholesky;
use nalgebra::{DMatrix, DVector};
use shared::identify::static_test::Bench;
use shared::model::{Coefficients, NOMINAL, SpecificForce, terms};
use shared::tumble::{Position, within_a_turn};

use crate::campaign::{Approach, Campaign, Reading, Run};
use crate::error::Error;
use crate::forward::finite_record::unseen_variance_g2;
use crate::prediction::{measured_vre_g, sensitivity};
use crate::statics::covariance::{covariance, symmetric};
use crate::statics::{bench, fit, position};

/// Most marks of a head that are mapped: every degree.
pub const MAX_MARKS: usize = 360;

/// Relative standard uncertainty of the shaker's level, the same in all runs, where the campaign states none.
const LEVEL_REL_SIGMA: f64 = 0.005;

/// Information on the coefficients and the marks' errors: the negative half of x' `information` x - 2 `rhs`' x + `squares`
/// is the logarithm of the likelihood, up to `log_determinant`.
#[derive(Clone, Debug, PartialEq)]
pub struct Reduced {
    /// Angles of its marks, deg, within a turn.
    pub marks_deg: Vec<f64>,
    /// Information matrix over K1 / `scale_v_per_g` - 1, k0 and so on in the order of the model (11, each in its own unit), then
    /// the marks' errors (rad).
    pub information: DMatrix<f64>,
    /// Right-hand side.
    pub rhs: DVector<f64>,
    /// Sum of squared whitened observations.
    pub squares: f64,
    /// Logarithm of the determinant of the observations' covariance, g^2.
    pub log_determinant: f64,
    /// Number of observations.
    pub rows: usize,
    /// The scale factor about which it is linear, V/g.
    pub scale_v_per_g: f64,
    /// Standard uncertainty of a mark as the campaign states it, rad.
    pub dial_sigma_rad: f64,
}

impl Reduced {
    /// Of the readings of a campaign.
    ///
    /// # Errors
    /// Those of [`fit`]; more marks than [`MAX_MARKS`].
    pub fn of(campaign: &Campaign) -> Result<Self, Error> {
        let scale_v_per_g = fit(campaign, None)?.coefficients.scale_factor_v_per_g;
        let outputs = campaign.readings.iter().map(|r| r.output_v).collect();
        let stated = bench(&campaign.config.bench);
        Self::of_readings(&campaign.readings, outputs, &stated, scale_v_per_g)
    }

    /// What readings at these positions would tell, each of noise `noise_g`, whatever their outputs.
    ///
    /// # Errors
    /// More marks than [`MAX_MARKS`].
    pub fn of_plan(plan: &[Position], stated: &Bench<f64>, noise_g: f64) -> Result<Self, Error> {
        let reading = |place: &Position| Reading {
            order: 0,
            time_s: 0.0,
            series: place.series,
            dial_deg: place.dial_deg,
            mount_deg: place.mount_deg,
            approach: Approach::CounterClockwise,
            specific_force_g: place.specific_force(),
            temp_c: 0.0,
            output_v: 0.0,
            sigma_v: noise_g,
            session: None,
            exclude: false,
            line: 0,
            unknown: Vec::new(),
        };
        let readings: Vec<Reading> = plan.iter().map(reading).collect();
        let forces = plan.iter().map(|place| place.specific_force().i);
        Self::of_readings(&readings, forces.collect(), stated, 1.0)
    }

    fn of_readings(
        readings: &[Reading],
        outputs_v: Vec<f64>,
        stated: &Bench<f64>,
        scale_v_per_g: f64,
    ) -> Result<Self, Error> {
        let mut marks_deg: Vec<f64> = readings.iter().map(|r| within_a_turn(r.dial_deg)).collect();
        marks_deg.sort_by(f64::total_cmp);
        marks_deg.dedup();
        if marks_deg.len() > MAX_MARKS {
            return Err(Error::Usage(format!(
                "static.csv has {} marks; at most {MAX_MARKS} of a head are mapped",
                marks_deg.len()
            )));
        }
        let (rows, order) = (readings.len(), NOMINAL + marks_deg.len());
        let g = stated.local_gravity_g;
        // The last column holds the output less that of an ideal instrument.
        let mut columns = vec![vec![0.0; rows]; order + 1];
        for (row, reading) in readings.iter().enumerate() {
            let place = position(reading);
            let a = place.specific_force();
            for (k, term) in terms(SpecificForce::new(g * a.i, g * a.p, g * a.o))
                .into_iter()
                .enumerate()
            {
                columns[k][row] = term;
            }
            let dial_deg = within_a_turn(place.dial_deg);
            let mark = marks_deg.iter().position(|mark| *mark == dial_deg);
            if let Some(mark) = mark {
                columns[NOMINAL + mark][row] = g * place.series.tangent(place.phi_rad()).i;
            }
            columns[order][row] = outputs_v[row] / scale_v_per_g - g * a.i;
        }
        let exact_dial = Bench {
            dial_sigma_rad: 0.0,
            ..*stated
        };
        let triangle = covariance(readings, &exact_dial, None, scale_v_per_g);
        let mut reduced = Self {
            information: DMatrix::zeros(order, order),
            rhs: DVector::zeros(order),
            squares: 0.0,
            log_determinant: 0.0,
            rows: 0,
            scale_v_per_g,
            dial_sigma_rad: stated.dial_sigma_rad,
            marks_deg,
        };
        reduced.absorb(columns, symmetric(&triangle, rows))?;
        Ok(reduced)
    }

    /// Adds the vibration errors that were measured on a shaker: runs of [`Campaign::used`] in which nothing but the nominal
    /// model acts. The level of the table is uncertain by one factor for all runs.
    ///
    /// # Errors
    /// None of the runs has an output.
    pub fn with_runs(mut self, campaign: &Campaign) -> Result<Self, Error> {
        let about = fit(campaign, Some(crate::statics::DEFAULT_PRIOR_SIGMA))?.coefficients;
        let measured = |run| Some((run, measured_vre_g(run, &about)?.known()?));
        let runs: Vec<(&Run, (f64, f64))> = campaign.runs.iter().filter_map(measured).collect();
        if runs.is_empty() {
            return Err(Error::Usage(
                "vibration.csv has no run with an output".into(),
            ));
        }
        let order = self.rhs.len();
        let mut columns = vec![vec![0.0; runs.len()]; order + 1];
        let level = campaign
            .config
            .shaker
            .as_ref()
            .and_then(|s| s.reference_gain_rel_sigma);
        let level = level.unwrap_or(LEVEL_REL_SIGMA);
        let mut matrix = vec![0.0; runs.len() * runs.len()];
        for (row, (run, (vre_g, sigma_g))) in runs.iter().enumerate() {
            let slopes = sensitivity(run).nominal;
            for k in 1..NOMINAL {
                columns[k][row] = slopes[k];
            }
            columns[order][row] = *vre_g;
            for (column, (_, (other_g, _))) in runs.iter().enumerate() {
                matrix[row * runs.len() + column] = level * level * vre_g * other_g;
            }
            matrix[row * (runs.len() + 1)] +=
                sigma_g * sigma_g + unseen_variance_g2(&(*run).into(), &about);
        }
        self.absorb(columns, matrix)?;
        Ok(self)
    }

    /// Adds observations, column by column with the observed values last, of this covariance (row by row, g^2).
    fn absorb(&mut self, mut columns: Vec<Vec<f64>>, covariance_g2: Vec<f64>) -> Result<(), Error> {
        let (rows, order) = (columns[0].len(), self.rhs.len());
        let factor = Cholesky::new(covariance_g2, rows).ok_or_else(|| {
            Error::Usage("static.csv: the stated uncertainties leave no noise".into())
        })?;
        columns.iter_mut().for_each(|column| factor.forward(column));
        let observed = columns.pop().unwrap_or_default();
        let design = DMatrix::from_fn(rows, order, |i, j| columns[j][i]);
        let observed = DVector::from_vec(observed);
        self.information += design.tr_mul(&design);
        self.rhs += design.tr_mul(&observed);
        self.squares += observed.norm_squared();
        self.log_determinant += factor.log_determinant();
        self.rows += rows;
        Ok(())
    }

    /// Coefficients in the order of the model from the unknowns of an estimate.
    pub fn coefficients(&self, x: &[f64; NOMINAL]) -> Coefficients<f64> {
        let mut values = *x;
        values[0] = self.scale_v_per_g * (1.0 + x[0]);
        Coefficients::from_nominal(values)
    }
}
