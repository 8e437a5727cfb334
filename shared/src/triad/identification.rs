//! Coefficients of three instruments from positions at rest, one position at a time, in constant memory.
//!
//! Positions go into the triangular factor of the 33 coefficients ([`square_root`](crate::identify::square_root)) and are
//! forgotten. The equations are linearised about instruments that are nearly the true ones: the error that this leaves is the
//! square of theirs. A second and third pass about what the first found, from the kept positions, remove it; [`identify`]
//! does so.

use num_traits::Float;

use super::attitude::{Position, PositionError, Rows, UNKNOWNS};
use super::blind::{FRAME, untold};
use super::body::INSTRUMENTS;
use crate::identify::blindness::{BEFOREHAND, LEAST_GAIN, Visibility};
use crate::identify::square_root::{
    FactorError, TriangularFactor, inverse_square, leave_out, storage_len,
};
use crate::model::{Coefficients, NOMINAL};

/// Square matrix over the 33 coefficients.
pub type Matrix = [[f64; UNKNOWNS]; UNKNOWNS];

/// What is known of the coefficients beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Of each instrument, in the order of [`Coefficients::to_nominal`]; the first, K1, is not used.
    pub mean: [[f64; NOMINAL]; INSTRUMENTS],
    /// Standard deviation about the mean, the same for the three instruments; infinite where nothing is known.
    pub sigma: [f64; NOMINAL],
}

impl Default for Prior {
    /// Nothing is known.
    fn default() -> Self {
        Self {
            mean: [[0.0; NOMINAL]; INSTRUMENTS],
            sigma: [f64::INFINITY; NOMINAL],
        }
    }
}

impl Prior {
    /// Of the cross-couplings k_IP, k_IO and k_PO alone: this standard deviation about zero, 1/g.
    pub fn cross_couplings(sigma_per_g: f64) -> Self {
        let mut prior = Self::default();
        prior.sigma[8..].fill(sigma_per_g);
        prior
    }

    /// Of all that rectifies and of the misalignments: [`BEFOREHAND`] about zero where nothing narrower is stated.
    pub fn beside_beforehand(mut self) -> Self {
        for (sigma, wide) in self.sigma.iter_mut().zip(BEFOREHAND).skip(2) {
            *sigma = sigma.min(wide);
        }
        self
    }
}

/// The positions so far, as a factor.
#[derive(Clone, Debug)]
pub struct Identification {
    about: [Coefficients<f64>; INSTRUMENTS],
    gravity_g: f64,
    factor: Factor,
    positions: usize,
    /// Positions of which the attitude is known.
    attitudes: usize,
    rows: usize,
}

/// Coefficients of the three instruments with all that is known of their uncertainty.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The coefficients of x, y and z.
    pub coefficients: [Coefficients<f64>; INSTRUMENTS],
    /// Covariance of the 33, instrument by instrument in the order of [`Coefficients::to_nominal`]; zero along what is
    /// still blind beside the prior, and of what the choice of the frame makes zero.
    pub covariance: Matrix,
    /// What the positions determine by themselves: rank of 33, and what is blind, that of [`untold`] first.
    pub by_positions: Visibility<f64, UNKNOWNS>,
    /// What is determined with the frame and the prior.
    pub with_prior: Visibility<f64, UNKNOWNS>,
    /// Whether the frame is chosen, no attitude being known: then the three misalignments of [`FRAME`] are zero.
    pub frame_is_chosen: bool,
    /// Sum of the squared whitened residuals, those of the prior included.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Number of positions.
    pub positions: usize,
}

impl Fit {
    /// Covariance of one instrument's eleven coefficients.
    pub fn instrument_covariance(&self, instrument: usize) -> [[f64; NOMINAL]; NOMINAL] {
        let first = instrument * NOMINAL;
        core::array::from_fn(|i| core::array::from_fn(|j| self.covariance[first + i][first + j]))
    }

    /// Whether a coefficient (its place) of an instrument is determined.
    pub fn determines(&self, instrument: usize, coefficient: usize) -> bool {
        self.with_prior
            .determines(instrument * NOMINAL + coefficient)
    }

    /// Adds the uncertainty of local gravity, relative: a scale factor common to all three cannot be told from it.
    pub fn add_gravity_uncertainty(&mut self, relative_sigma: f64) {
        for i in 0..INSTRUMENTS {
            for j in 0..INSTRUMENTS {
                let scale = |s: usize| self.coefficients[s].scale_factor_v_per_g * relative_sigma;
                self.covariance[i * NOMINAL][j * NOMINAL] += scale(i) * scale(j);
            }
        }
    }
}

impl Identification {
    /// No positions yet; linearised about these instruments, `gravity_g` local gravity, g.
    ///
    /// # Errors
    /// [`FactorError`] if the storage did not fit, which its type rules out.
    pub fn new(
        about: [Coefficients<f64>; INSTRUMENTS],
        gravity_g: f64,
    ) -> Result<Self, FactorError> {
        Ok(Self {
            about,
            gravity_g,
            factor: TriangularFactor::new(UNKNOWNS, [0.0; storage_len(UNKNOWNS)])?,
            positions: 0,
            attitudes: 0,
            rows: 0,
        })
    }

    /// Forgets all positions and begins anew about these instruments.
    pub fn restart(&mut self, about: [Coefficients<f64>; INSTRUMENTS]) {
        self.factor.clear();
        self.about = about;
        (self.positions, self.attitudes, self.rows) = (0, 0, 0);
    }

    /// Absorbs a position.
    ///
    /// # Errors
    /// [`PositionError`]; all is as before.
    pub fn absorb(&mut self, position: &Position) -> Result<(), PositionError> {
        let mut rows = Rows::of(position, &self.about, self.gravity_g)?;
        self.rows += rows.count();
        rows.iter_mut().for_each(|row| self.factor.absorb(row));
        self.positions += 1;
        self.attitudes += usize::from(position.attitude.is_some());
        Ok(())
    }

    /// Number of positions so far.
    pub fn positions(&self) -> usize {
        self.positions
    }

    fn absorb_all(&mut self, positions: &[Position]) -> Result<(), IdentificationError> {
        positions
            .iter()
            .enumerate()
            .try_for_each(|(index, position)| {
                let error = |error| IdentificationError::Position(index, error);
                self.absorb(position).map_err(error)
            })
    }

    /// Where to linearise next: the coefficients beside the prior and [`BEFOREHAND`], which bounds what positions leave blind. Scale
    /// factors and biases, if nothing tells them, stay where they are.
    ///
    /// # Errors
    /// None that its types do not rule out.
    pub fn estimate(&self, prior: &Prior) -> Result<[Coefficients<f64>; INSTRUMENTS], FactorError> {
        let mut total = framed(&self.factor, self.attitudes == 0)?;
        add_prior(&mut total, &prior.beside_beforehand());
        for s in 0..INSTRUMENTS {
            for (k, stays) in [1.0, self.about[s].bias_g].into_iter().enumerate() {
                let mut row = [0.0; UNKNOWNS + 1];
                row[s * NOMINAL + k] = STAYS.recip();
                row[UNKNOWNS] = stays / STAYS;
                total.absorb(&mut row);
            }
        }
        let mut x = [0.0; UNKNOWNS];
        total.solve(0, &mut x)?;
        Ok(self.divided(&x).map(Coefficients::from_nominal))
    }

    /// Solves for the coefficients beside a prior.
    ///
    /// # Errors
    /// [`FactorError::Undetermined`] where a scale factor is not determined, [`FactorError::NoVariance`] where rounding has
    /// eaten an answer.
    pub fn solve(&self, prior: &Prior) -> Result<Fit, FactorError> {
        let (unit, untold) = (units(), untold());
        let (triangle, _) = self.factor.trailing::<UNKNOWNS>();
        let by_positions = Visibility::beside(&triangle, &unit, &untold, None);
        let frame_is_chosen = self.attitudes == 0;
        let mut total = framed(&self.factor, frame_is_chosen)?;
        let mut added = add_prior(&mut total, prior);
        added += if frame_is_chosen { FRAME.len() } else { 0 };
        let with_prior = if added == 0 {
            by_positions.clone()
        } else {
            beside_prior(&total, &unit, &untold)
        };
        for direction in with_prior.blind_directions() {
            hold(&mut total, direction, &unit);
        }
        added += with_prior.blind_directions().len();
        for s in 0..INSTRUMENTS {
            if !with_prior.determines(s * NOMINAL) {
                return Err(FactorError::Undetermined {
                    unknown: s * NOMINAL,
                });
            }
        }
        let chi2 = self.factor.residual_squares() + total.residual_squares();
        let degrees_of_freedom = (self.rows + added).saturating_sub(UNKNOWNS);
        let (coefficients, covariance) = self.answer(&total, &with_prior, frame_is_chosen)?;
        Ok(Fit {
            coefficients,
            covariance,
            by_positions,
            with_prior,
            frame_is_chosen,
            chi2,
            degrees_of_freedom,
            positions: self.positions,
        })
    }

    fn answer(
        &self,
        total: &Factor,
        seen: &Visibility<f64, UNKNOWNS>,
        frame_is_chosen: bool,
    ) -> Result<([Coefficients<f64>; INSTRUMENTS], Matrix), FactorError> {
        let mut x = [0.0; UNKNOWNS];
        total.solve(0, &mut x)?;
        let mut covariance = inverse_square(&total.trailing::<UNKNOWNS>().0);
        if frame_is_chosen {
            for k in FRAME {
                covariance[k][k] = 0.0;
            }
        }
        for direction in seen.blind_directions() {
            leave_out(&mut covariance, direction);
        }
        let nominal = self.divide_by_scale_factors(&x, &mut covariance);
        for unknown in 0..UNKNOWNS {
            let chosen = frame_is_chosen && FRAME.contains(&unknown);
            let variance = covariance[unknown][unknown];
            if seen.determines(unknown) && !chosen && !(variance > 0.0 && variance.is_finite()) {
                return Err(FactorError::NoVariance { unknown });
            }
        }
        Ok((nominal.map(Coefficients::from_nominal), covariance))
    }

    /// From K1_s (1, coefficients) in terms of the K1_s about which they are linearised to the coefficients of each
    /// instrument.
    fn divided(&self, x: &[f64; UNKNOWNS]) -> [[f64; NOMINAL]; INSTRUMENTS] {
        core::array::from_fn(|s| {
            let scale = x[s * NOMINAL];
            core::array::from_fn(|k| match k {
                0 => self.about[s].scale_factor_v_per_g * scale,
                _ => x[s * NOMINAL + k] / scale,
            })
        })
    }

    /// The same, and the covariance alike.
    fn divide_by_scale_factors(
        &self,
        x: &[f64; UNKNOWNS],
        covariance: &mut Matrix,
    ) -> [[f64; NOMINAL]; INSTRUMENTS] {
        let nominal = self.divided(x);
        // d c_k = (d x_k - c_k d x_0) / x_0: columns of each row first, then the rows.
        let change = |values: &mut [f64; UNKNOWNS]| {
            for s in 0..INSTRUMENTS {
                let own = &mut values[s * NOMINAL..(s + 1) * NOMINAL];
                for k in 1..NOMINAL {
                    own[k] = (own[k] - nominal[s][k] * own[0]) / x[s * NOMINAL];
                }
                own[0] *= self.about[s].scale_factor_v_per_g;
            }
        };
        covariance.iter_mut().for_each(change);
        for column in 0..UNKNOWNS {
            let mut values = core::array::from_fn(|row| covariance[row][column]);
            change(&mut values);
            for (row, value) in covariance.iter_mut().zip(values) {
                row[column] = value;
            }
        }
        nominal
    }
}

type Factor = TriangularFactor<f64, [f64; storage_len(UNKNOWNS)]>;

/// The information of the factor without its residual, with the frame chosen if need be: the misalignments that are zero then
/// have no part in it.
fn framed(factor: &Factor, frame_is_chosen: bool) -> Result<Factor, FactorError> {
    let mut total = TriangularFactor::new(UNKNOWNS, [0.0; storage_len(UNKNOWNS)])?;
    let mut row = [0.0; UNKNOWNS + 1];
    for k in 0..UNKNOWNS {
        row.fill(0.0);
        row[k..].copy_from_slice(factor.row(k));
        if frame_is_chosen {
            FRAME.into_iter().for_each(|k| row[k] = 0.0);
        }
        total.absorb(&mut row);
    }
    for k in FRAME.into_iter().filter(|_| frame_is_chosen) {
        row.fill(0.0);
        row[k] = FIRM / BEFOREHAND[k % NOMINAL];
        total.absorb(&mut row);
    }
    Ok(total)
}

/// Absorbs the rows of the prior; how many.
fn add_prior(total: &mut Factor, prior: &Prior) -> usize {
    let mut added = 0;
    for (s, mean) in prior.mean.iter().enumerate() {
        for k in (1..NOMINAL).filter(|k| prior.sigma[*k].is_finite()) {
            let mut row = [0.0; UNKNOWNS + 1];
            row[s * NOMINAL + k] = prior.sigma[k].recip();
            row[UNKNOWNS] = mean[k] / prior.sigma[k];
            total.absorb(&mut row);
            added += 1;
        }
    }
    added
}

/// How firmly the choice of a frame is held: in terms of the standard deviation beforehand. It stands in rows that no reading
/// has a part in.
const FIRM: f64 = 1e3;

/// Standard deviations beforehand of the unknowns.
fn units() -> [f64; UNKNOWNS] {
    core::array::from_fn(|k| BEFOREHAND[k % NOMINAL])
}

/// What is determined with frame and prior.
fn beside_prior(
    total: &Factor,
    unit: &[f64; UNKNOWNS],
    untold: &[[f64; UNKNOWNS]],
) -> Visibility<f64, UNKNOWNS> {
    let (triangle, _) = total.trailing::<UNKNOWNS>();
    // No gain is below 1 / sqrt(sum of variances in units of those beforehand): most often that spares the singular values.
    let covariance = inverse_square(&triangle);
    let variance = (0..UNKNOWNS).map(|k| covariance[k][k] / (unit[k] * unit[k]));
    if variance.sum::<f64>() <= (LEAST_GAIN * LEAST_GAIN).recip() {
        return Visibility::full(f64::NAN);
    }
    Visibility::beside(&triangle, unit, untold, None)
}

/// Along a blind direction what is known beforehand takes the place of readings.
fn hold(total: &mut Factor, direction: &[f64; UNKNOWNS], unit: &[f64; UNKNOWNS]) {
    let squares = direction.iter().zip(unit).map(|(d, sigma)| d / sigma);
    let weight = Float::sqrt(squares.map(|x| x * x).sum::<f64>());
    let mut row = [0.0; UNKNOWNS + 1];
    for (r, d) in row.iter_mut().zip(direction) {
        *r = d * weight;
    }
    total.absorb(&mut row);
}

/// How far a scale factor (relative) and a bias (g) go in one pass if hardly anything tells them. Chosen: any length far above
/// what positions tell, and far below what ruins the next pass.
const STAYS: f64 = 1.0;

/// Passes at the most.
const PASSES: usize = 12;
/// A pass that moves no coefficient by more than this (K1 relative, the others in their units) is the last but one: each pass
/// leaves a thousandth of the move before it, which is 1e-8 then.
const SETTLED: f64 = 1e-5;

/// Why positions give no coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum IdentificationError {
    /// The position of this index cannot be used.
    Position(usize, PositionError),
    /// The positions do not determine the coefficients.
    Factor(FactorError),
    /// The passes do not settle: the outputs are not those of a triad near the one that they started from.
    Unsettled,
}

impl core::fmt::Display for IdentificationError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Position(index, error) => write!(f, "position {index}: {error}"),
            Self::Factor(error) => error.fmt(f),
            Self::Unsettled => f.write_str("the passes do not settle"),
        }
    }
}

impl core::error::Error for IdentificationError {}

/// Identifies a triad in passes, the first about `start`: passes beside what is known beforehand until they settle, then the
/// answer beside `prior`.
///
/// # Errors
/// [`IdentificationError`].
pub fn identify(
    positions: &[Position],
    start: [Coefficients<f64>; INSTRUMENTS],
    gravity_g: f64,
    prior: &Prior,
) -> Result<Fit, IdentificationError> {
    let mut test = Identification::new(start, gravity_g).map_err(IdentificationError::Factor)?;
    let mut about = start;
    for _ in 0..PASSES {
        test.absorb_all(positions)?;
        let found = test.estimate(prior).map_err(IdentificationError::Factor)?;
        let settled = (0..INSTRUMENTS).all(|s| moved(&found[s], &about[s]) <= SETTLED);
        about = found;
        test.restart(about);
        if settled {
            test.absorb_all(positions)?;
            return test.solve(prior).map_err(IdentificationError::Factor);
        }
    }
    Err(IdentificationError::Unsettled)
}

/// By how much coefficients differ at the most, K1 relative. Not a number stays not a number.
fn moved(new: &Coefficients<f64>, old: &Coefficients<f64>) -> f64 {
    let (new, old) = (new.to_nominal(), old.to_nominal());
    (1..NOMINAL).fold((new[0] / old[0] - 1.0).abs(), |most, k| {
        let by = (new[k] - old[k]).abs();
        if by <= most { most } else { by }
    })
}
