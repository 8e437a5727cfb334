//! The fit of a triad's campaign: scatter of the positions, what is claimed, and the coefficients.

use nalgebra::{DMatrix, DVector};
use shared::identify::blindness::{BEFOREHAND, LEAST_GAIN};
use shared::identify::square_root::FactorError;
use shared::model::{Coefficients, NOMINAL};
use shared::triad::attitude::Position;
use shared::triad::identification::{Fit, IdentificationError, Prior};
use shared::triad::{body::Axis, identification};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::leave_out::{Claims, GROUPS, LeftOut, group_of, leave_out};
use super::observations::{gravity_g, observations};
use super::start::start;
use crate::campaign::TriadCampaign;
use crate::error::Error;
use crate::statics::{NAMES, SUSPICIOUS};

/// The fit of a campaign.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Coefficients beside the stated prior; [`BEFOREHAND`] stands for terms that positions left out do not bear out.
    pub fit: Fit,
    /// The same beside what is known of any instrument of the kind: for predictions.
    pub bounded: Fit,
    /// The same without the stated prior of the cross-couplings.
    pub unstated: Fit,
    /// The prior that is stated.
    pub stated: Prior,
    /// Scatter of the positions beyond their stated noise, g; 0 where the noise is enough.
    pub scatter_g: f64,
    /// Probability of a chi-square at least as large, were the stated noise all; `None` without degrees of freedom.
    pub p_value: Option<f64>,
    /// What leaving positions out says.
    pub left_out: LeftOut,
}

impl Fitted {
    /// Whether a coefficient (its place) of an instrument is to be stated as a number: the positions determine it, and leaving
    /// positions out bears its term out or, where they do not scatter, they narrow what is known of any instrument to a third.
    pub fn states(&self, instrument: usize, coefficient: usize) -> bool {
        let borne_out = match group_of(coefficient) {
            Some(group) if !self.left_out.claims[group] => {
                let k = instrument * NOMINAL + coefficient;
                let sigma = self.fit.covariance[k][k].sqrt();
                let narrow = LEAST_GAIN * BEFOREHAND[coefficient];
                let beyond_prior = sigma <= NARROWED * self.stated.sigma[coefficient];
                self.scatter_g == 0.0 && sigma <= narrow && beyond_prior
            }
            _ => true,
        };
        borne_out && self.fit.determines(instrument, coefficient)
    }
}

/// Part of a stated standard deviation to which positions must narrow it at least for a number to be theirs: that of
/// [`LEAST_GAIN`].
const NARROWED: f64 = 0.95;

/// The prior that campaign.toml states.
pub fn stated_prior(campaign: &TriadCampaign) -> Prior {
    match campaign.config.instrument.cross_coupling_sigma_per_g {
        Some(sigma) if sigma > 0.0 => Prior::cross_couplings(sigma),
        // Known to be zero.
        Some(_) => Prior::cross_couplings(1e-12),
        None => Prior::default(),
    }
}

/// Fits a campaign.
///
/// # Errors
/// Those of [`start`]; positions that determine no triad, with file and row.
pub fn fit(campaign: &TriadCampaign) -> Result<Fitted, Error> {
    let start = start(campaign)?;
    let gravity_g = gravity_g(campaign);
    let stated = stated_prior(campaign);
    let bounded_prior = stated.beside_beforehand();
    let solve = |scatter_g: f64, prior: &Prior, about: &[Coefficients<f64>; 3]| {
        let positions = observations(campaign, scatter_g);
        identification::identify(&positions, *about, gravity_g, prior)
            .map_err(|error| told(campaign, error))
    };
    let first = solve(0.0, &bounded_prior, &start)?;
    let p_value = p_value(&first);
    let about = first.coefficients;
    let scatter_g = match p_value {
        Some(p) if p < SUSPICIOUS => scatter(|s| solve(s, &bounded_prior, &about), &first)?,
        _ => 0.0,
    };
    let positions = observations(campaign, scatter_g);
    let bounded = solve(scatter_g, &bounded_prior, &about)?;
    let left_out =
        left_out(&positions, &bounded, gravity_g, &stated).map_err(|error| undetermined(&error))?;
    let prior = claimed_prior(&stated, &left_out.claims);
    let relative = campaign.config.bench.local_gravity_sigma_g.unwrap_or(0.0) / gravity_g;
    let final_fit = |prior: &Prior| {
        let mut fit = solve(scatter_g, prior, &about)?;
        fit.add_gravity_uncertainty(relative);
        Ok::<_, Error>(fit)
    };
    Ok(Fitted {
        fit: final_fit(&prior)?,
        bounded: final_fit(&bounded_prior)?,
        unstated: final_fit(&Prior::default().beside_beforehand())?,
        stated,
        scatter_g,
        p_value,
        left_out,
    })
}

/// What leaving positions out says, without groups that do not stand out from zero.
fn left_out(
    positions: &[Position],
    bounded: &Fit,
    gravity_g: f64,
    stated: &Prior,
) -> Result<LeftOut, FactorError> {
    let mut barred = Claims::default();
    loop {
        let about = &bounded.coefficients;
        let found = leave_out(positions, about, gravity_g, stated, &barred)?;
        let claimed = found.claims.iter().enumerate();
        let mut faint =
            claimed.filter(|(group, claimed)| **claimed && !stands_out(bounded, *group));
        match faint.next() {
            Some((group, _)) => barred[group] = true,
            None => return Ok(found),
        }
    }
}

/// What is stated, and what is known of any instrument of the kind for terms that are not claimed.
fn claimed_prior(stated: &Prior, claims: &Claims) -> Prior {
    let (mut prior, bounded) = (*stated, stated.beside_beforehand());
    for k in (2..NOMINAL).filter(|k| group_of(*k).is_some_and(|group| !claims[group])) {
        prior.sigma[k] = bounded.sigma[k];
    }
    prior
}

/// Probability, were all coefficients of a group zero, of coefficients as far from it, below which the group stands out. Chosen: it
/// is asked of groups that positions left out speak for already.
const STANDS_OUT: f64 = 0.01;

/// Whether the coefficients of a group, all together, differ from zero.
fn stands_out(fit: &Fit, group: usize) -> bool {
    let places = GROUPS[group].1;
    let unknowns: Vec<usize> = (0..3)
        .flat_map(|s| places.iter().map(move |k| s * NOMINAL + k))
        .collect();
    let n = unknowns.len();
    let covariance = DMatrix::from_fn(n, n, |i, j| fit.covariance[unknowns[i]][unknowns[j]]);
    let value = |k: usize| fit.coefficients[k / NOMINAL].to_nominal()[k % NOMINAL];
    let values = DVector::from_iterator(n, unknowns.iter().map(|k| value(*k)));
    let Some(factor) = covariance.cholesky() else {
        return false;
    };
    let chi2 = values.dot(&factor.solve(&values));
    ChiSquared::new(n as f64).is_ok_and(|chi| chi.sf(chi2) < STANDS_OUT)
}

/// Probability of a chi-square at least as large as that of a fit.
fn p_value(fit: &Fit) -> Option<f64> {
    let distribution = ChiSquared::new(fit.degrees_of_freedom as f64).ok()?;
    Some(distribution.sf(fit.chi2))
}

/// Halvings of the interval in which the scatter is looked for: from 1e-8 to 1 g to a tenth of a per cent.
const HALVINGS: usize = 14;

/// The scatter, g, that makes chi-square what it is expected to be.
fn scatter(solve: impl Fn(f64) -> Result<Fit, Error>, first: &Fit) -> Result<f64, Error> {
    let (mut low, mut high) = (1e-8f64.ln(), 1f64.ln());
    let expected = first.degrees_of_freedom as f64;
    for _ in 0..HALVINGS {
        let middle = (low + high) / 2.0;
        if solve(middle.exp())?.chi2 > expected {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(((low + high) / 2.0).exp())
}

fn undetermined(problem: &dyn std::fmt::Display) -> Error {
    Error::Usage(format!(
        "positions.csv does not determine the triad: {problem}"
    ))
}

/// Why a fit failed, with the row or the coefficient.
fn told(campaign: &TriadCampaign, error: IdentificationError) -> Error {
    match error {
        IdentificationError::Position(index, problem) => {
            let line = campaign.positions.get(index).map_or(0, |p| p.line);
            Error::Usage(format!("positions.csv, row {line}: {problem}"))
        }
        IdentificationError::Factor(
            FactorError::Undetermined { unknown } | FactorError::NoVariance { unknown },
        ) => {
            let axis = Axis::ALL[(unknown / NOMINAL).min(2)].name();
            let name = NAMES[unknown % NOMINAL];
            undetermined(&format_args!("nothing tells {axis}.{name}"))
        }
        IdentificationError::Factor(error) => undetermined(&error),
        IdentificationError::Unsettled => undetermined(
            &"the fit does not settle; are the positions few, in a plane, or not at rest?",
        ),
    }
}
