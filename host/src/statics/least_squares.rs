//! Weighted least squares on the static readings of a campaign.

use std::collections::BTreeSet;

use inference::dense::Cholesky;
use shared::identify::blindness::{BEFOREHAND, Design};
use shared::identify::square_root::{TriangularFactor, storage_len};
use shared::identify::static_test::{
    Bench, Fit, Information, MountEstimate, Reading, StaticTest, StaticTestError, workspace_len,
};
use shared::model::{Coefficients, NOMINAL, SpecificForce, terms};
use shared::tumble::{Position, Series, within_a_turn};

use super::covariance::{covariance, symmetric};
use super::readings::{bench, position};
use crate::campaign::{Campaign, MarkErrors};
use crate::error::Error;

/// Work space of a static test: room for the marks and mounts of a plan, on the heap.
#[derive(Clone, Debug)]
pub struct Workspace {
    marks: usize,
    mounts: usize,
    numbers: Vec<f64>,
}

impl Workspace {
    /// Room for these positions.
    pub fn of(positions: impl IntoIterator<Item = Position>) -> Self {
        let mut marks: BTreeSet<u64> = BTreeSet::new();
        let mut mounts: BTreeSet<(Series, u64)> = BTreeSet::new();
        for position in positions {
            marks.insert(within_a_turn(position.dial_deg).to_bits());
            mounts.insert((position.series, position.mount_deg.to_bits()));
        }
        let (marks, mounts) = (marks.len(), mounts.len());
        Self {
            marks,
            mounts,
            numbers: vec![0.0; workspace_len(marks, mounts)],
        }
    }

    /// An empty test in this room, linearised about these coefficients.
    ///
    /// # Errors
    /// Those of [`StaticTest::new`].
    pub fn test(
        &mut self,
        bench: Bench<f64>,
        about: Coefficients<f64>,
    ) -> Result<StaticTest<'_, f64>, StaticTestError> {
        StaticTest::new(bench, about, self.marks, self.mounts, &mut self.numbers)
    }
}

/// Fits the nominal model to the static readings in two passes: about the type's nominal scale factor, then about what the
/// first pass found.
///
/// `prior_sigma`: a standard deviation about zero for every coefficient but K1, each in its own unit.
///
/// # Errors
/// Fewer readings than coefficients of the model; readings that do not determine the scale factor.
pub fn fit(campaign: &Campaign, prior_sigma: Option<f64>) -> Result<Fit<f64>, Error> {
    let count = campaign.readings.len();
    if count < NOMINAL {
        return Err(Error::Usage(format!(
            "static.csv has {count} readings, the model {NOMINAL} coefficients"
        )));
    }
    let undetermined = |problem: &dyn std::fmt::Display| {
        Error::Usage(format!(
            "static.csv does not determine the coefficients: {problem}"
        ))
    };
    let fit = match &campaign.config.mark_errors {
        None => two_passes(campaign, prior_sigma),
        Some(known) => with_known_marks(campaign, known, prior_sigma),
    };
    let fit = fit.map_err(|error| undetermined(&error))?;
    let nominal = campaign.config.instrument.scale_factor_nominal_v_per_g;
    let found = fit.coefficients.scale_factor_v_per_g;
    if (found / nominal - 1.0).abs() <= MAX_SCALE_ERROR {
        Ok(fit)
    } else {
        Err(undetermined(&format_args!(
            "they would make K1 {found:.3e} V/g, far from the nominal {nominal} V/g"
        )))
    }
}

/// Standard deviation about zero that a prediction takes for each coefficient but K1 (in its own unit) when the static
/// plan leaves some of them undetermined: about the root mean square of k1', k2, k3 and k4 in the paper's Table 1.
pub const DEFAULT_PRIOR_SIGMA: f64 = 5e-4;

/// The fit that predictions rest on, and the standard deviation that it takes for every coefficient but K1: the one given, or
/// [`DEFAULT_PRIOR_SIGMA`] where the static plan is blind.
///
/// # Errors
/// Those of [`fit`].
pub fn fit_determined(
    campaign: &Campaign,
    prior_sigma: Option<f64>,
) -> Result<(Fit<f64>, Option<f64>), Error> {
    let bare = fit(campaign, prior_sigma)?;
    if bare.visibility.blind_directions().is_empty() {
        return Ok((bare, prior_sigma));
    }
    let prior_sigma = prior_sigma.unwrap_or(DEFAULT_PRIOR_SIGMA);
    Ok((fit(campaign, Some(prior_sigma))?, Some(prior_sigma)))
}

/// Relative error of the type's scale factor beyond which a fit is no measurement: twice what the tables let pass as an
/// output of the instrument.
const MAX_SCALE_ERROR: f64 = 0.5;

fn two_passes(campaign: &Campaign, prior_sigma: Option<f64>) -> Result<Fit<f64>, StaticTestError> {
    let mut workspace = Workspace::of(campaign.readings.iter().map(position));
    let nominal = Coefficients {
        scale_factor_v_per_g: campaign.config.instrument.scale_factor_nominal_v_per_g,
        ..Coefficients::default()
    };
    let (first, mounts) = pass(campaign, prior_sigma, nominal, &[], &mut workspace)?;
    let about = first.coefficients;
    pass(campaign, prior_sigma, about, &mounts, &mut workspace).map(|(second, _)| second)
}

/// One pass: linearised about these coefficients and mounts; the fit, and where it finds the mounts.
fn pass(
    campaign: &Campaign,
    prior_sigma: Option<f64>,
    about: Coefficients<f64>,
    mounts: &[MountEstimate<f64>],
    workspace: &mut Workspace,
) -> Result<(Fit<f64>, Vec<MountEstimate<f64>>), StaticTestError> {
    let mut test = workspace.test(bench(&campaign.config.bench), about)?;
    for mount in mounts {
        test.linearise_mount(mount)?;
    }
    for r in &campaign.readings {
        test.absorb(&Reading {
            position: position(r),
            output_v: r.output_v,
            sigma_v: r.sigma_v,
        })?;
    }
    let fit = test
        .solve(prior_sigma.map(|sigma| [sigma; NOMINAL]).as_ref())
        .map_err(StaticTestError::Workspace)?;
    let found = test.mount_estimates(&fit.coefficients).collect();
    Ok((fit, found))
}

/// The fit beside what is known of the marks: their errors correlate, so that the readings are whitened by their whole
/// covariance (to first order in the angles).
fn with_known_marks(
    campaign: &Campaign,
    known: &MarkErrors,
    prior_sigma: Option<f64>,
) -> Result<Fit<f64>, StaticTestError> {
    let stated = bench(&campaign.config.bench);
    let scale_v_per_g = campaign.config.instrument.scale_factor_nominal_v_per_g;
    let readings = &campaign.readings;
    let triangle = covariance(readings, &stated, Some(known), scale_v_per_g);
    let factor = Cholesky::new(symmetric(&triangle, readings.len()), readings.len())
        .ok_or(StaticTestError::BadReading)?;
    let g = stated.local_gravity_g;
    let place = |reading| {
        let a = position(reading).specific_force();
        terms(SpecificForce::new(g * a.i, g * a.p, g * a.o))
    };
    let places: Vec<_> = readings.iter().map(place).collect();
    let mut columns: Vec<Vec<f64>> = (0..NOMINAL)
        .map(|k| {
            places
                .iter()
                .map(|terms| terms[k] / scale_v_per_g)
                .collect()
        })
        .collect();
    columns.push(
        readings
            .iter()
            .map(|r| r.output_v / scale_v_per_g)
            .collect(),
    );
    columns.iter_mut().for_each(|column| factor.forward(column));
    let mut triangle = TriangularFactor::new(NOMINAL, [0.0; storage_len(NOMINAL)])
        .map_err(StaticTestError::Workspace)?;
    for row in 0..readings.len() {
        let mut row: [f64; NOMINAL + 1] = std::array::from_fn(|k| columns[k][row]);
        triangle.absorb(&mut row);
    }
    let mut design = Design::default();
    for reading in readings {
        design.absorb(position(reading).specific_force());
    }
    let residual_squares = triangle.residual_squares();
    let (triangle, rhs) = triangle.trailing();
    let information = Information {
        triangle,
        rhs,
        residual_squares,
        scale_v_per_g,
        design,
        readings: readings.len(),
    };
    let beforehand = prior_sigma.map_or(BEFOREHAND, |sigma| [sigma; NOMINAL]);
    information
        .solve_beside(&beforehand, prior_sigma.is_some())
        .map_err(StaticTestError::Workspace)
}
