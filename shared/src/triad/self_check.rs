//! The triad judges its own calibration, on a cushion: some twenty orientations by hand, held by nothing but |a| = g.
//!
//! [`RestSums`] makes one position of the blocks of a rest; [`SelfCheck`] keeps the positions, identifies the triad by
//! [`identify`], and compares with the stored coefficients and with limits. The host runs
//! this same code on the same frames.
//!
//! Twenty orientations do not tell 33 coefficients. What is stored stands beside them as a prior: scale factors and biases are
//! found anew, everything else about what it was, as wide as any instrument of the kind.

use super::attitude::{Position, UNKNOWNS};
use super::body::INSTRUMENTS;
use super::identification::{IdentificationError, Prior, identify};
use crate::channels::{Block, CHANNELS};
use crate::model::{Coefficients, NOMINAL};
use crate::self_check::{ChannelNoise, Limits, Verdict, Verdicts};

/// Positions for which a self-check has room.
pub const POSITIONS: usize = 48;

/// Least number of positions that a verdict rests on: three scale factors, three biases, and as many to spare.
pub const LEAST_POSITIONS: usize = 12;

/// What the blocks of one rest come to. Channels 0, 1, 2 are the instruments x, y, z.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RestSums {
    sums: [i64; INSTRUMENTS],
    noise: [ChannelNoise; INSTRUMENTS],
    count: u64,
    lost: u64,
}

impl RestSums {
    /// Takes the next block of the rest.
    pub fn absorb(&mut self, block: &Block) {
        self.lost = self.lost.saturating_add(u64::from(block.lost));
        if block.count == 0 {
            return;
        }
        self.count = self.count.saturating_add(u64::from(block.count));
        for s in 0..INSTRUMENTS {
            self.sums[s] = self.sums[s].saturating_add(block.moments.sum[s]);
            self.noise[s].absorb(block, s);
        }
    }

    /// The rest as a position; `None` with fewer than two blocks.
    pub fn position(&self, v_per_code: [f64; CHANNELS]) -> Option<Position> {
        let mut position = Position {
            output_v: [0.0; INSTRUMENTS],
            sigma_v: [0.0; INSTRUMENTS],
            attitude: None,
        };
        for s in 0..INSTRUMENTS {
            position.output_v[s] = self.sums[s] as f64 / self.count as f64 * v_per_code[s];
            position.sigma_v[s] = self.noise[s].sigma(self.count)? * v_per_code[s];
        }
        Some(position)
    }
}

/// What the self-check has to know beside the positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetUp {
    /// The type's scale factors, V/g.
    pub nominal_v_per_g: [f64; INSTRUMENTS],
    /// Local gravity, g.
    pub gravity_g: f64,
    /// What is known of the type's cross-couplings, 1/g: standard deviation about zero.
    pub cross_coupling_sigma_per_g: Option<f64>,
    /// The coefficients that are stored, if any.
    pub stored: Option<[Coefficients<f64>; INSTRUMENTS]>,
}

/// The answer of a self-check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Positions that went in.
    pub positions: u32,
    /// Rank of the positions by themselves, 0 to 33.
    pub rank: u8,
    /// The coefficients of x, y, z beside what is stored.
    pub coefficients: [Coefficients<f64>; INSTRUMENTS],
    /// Standard uncertainties of the bias of each, g.
    pub bias_sigma_g: [f64; INSTRUMENTS],
    /// Relative standard uncertainties of the scale factor of each.
    pub scale_sigma: [f64; INSTRUMENTS],
    /// Sum of the squared whitened residuals, and its degrees of freedom.
    pub chi2: f64,
    /// Degrees of freedom of chi2.
    pub degrees_of_freedom: u32,
    /// Largest standard uncertainty of a mean from noise, g.
    pub noise_g: f64,
    /// Conversions lost within rests.
    pub lost: u64,
    /// What is wrong.
    pub verdicts: Verdicts,
}

/// Why there is no position, or no answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CheckError {
    /// Fewer than two blocks: no uncertainty.
    TooShort,
    /// More than [`POSITIONS`].
    TooMany,
    /// Fewer than [`LEAST_POSITIONS`].
    TooFew,
    /// The positions give no coefficients.
    Identification(IdentificationError),
}

/// The self-check so far.
#[derive(Clone, Debug)]
pub struct SelfCheck {
    set_up: SetUp,
    positions: [Position; POSITIONS],
    count: usize,
    lost: u64,
}

impl SelfCheck {
    /// No positions yet.
    pub fn new(set_up: SetUp) -> Self {
        let empty = Position {
            output_v: [0.0; INSTRUMENTS],
            sigma_v: [1.0; INSTRUMENTS],
            attitude: None,
        };
        Self {
            set_up,
            positions: [empty; POSITIONS],
            count: 0,
            lost: 0,
        }
    }

    /// Takes a rest; `v_per_code` of the four channels.
    ///
    /// # Errors
    /// [`CheckError::TooShort`], [`CheckError::TooMany`]; the check is as before.
    pub fn absorb(
        &mut self,
        sums: &RestSums,
        v_per_code: [f64; CHANNELS],
    ) -> Result<(), CheckError> {
        let position = sums.position(v_per_code).ok_or(CheckError::TooShort)?;
        let free = self
            .positions
            .get_mut(self.count)
            .ok_or(CheckError::TooMany)?;
        *free = position;
        self.count += 1;
        self.lost = self.lost.saturating_add(sums.lost);
        Ok(())
    }

    /// Identifies the triad beside what is stored, and judges it.
    ///
    /// # Errors
    /// [`CheckError::TooFew`], [`CheckError::Identification`].
    pub fn conclude(&self, limits: &Limits) -> Result<Outcome, CheckError> {
        if self.count < LEAST_POSITIONS {
            return Err(CheckError::TooFew);
        }
        let positions = &self.positions[..self.count];
        let (start, prior) = self.beforehand();
        let fit = identify(positions, start, self.set_up.gravity_g, &prior)
            .map_err(CheckError::Identification)?;
        let sigma = |k: usize| num_traits::Float::sqrt(fit.covariance[k][k].max(0.0));
        let k1 = |s: usize| fit.coefficients[s].scale_factor_v_per_g;
        let noise_g = positions.iter().fold(0.0f64, |most, position| {
            (0..INSTRUMENTS).fold(most, |most, s| most.max(position.sigma_v[s] / k1(s).abs()))
        });
        let mut outcome = Outcome {
            positions: self.count as u32,
            rank: fit.by_positions.rank as u8,
            coefficients: fit.coefficients,
            bias_sigma_g: core::array::from_fn(|s| sigma(s * NOMINAL + 1)),
            scale_sigma: core::array::from_fn(|s| sigma(s * NOMINAL) / k1(s).abs()),
            chi2: fit.chi2,
            degrees_of_freedom: fit.degrees_of_freedom as u32,
            noise_g,
            lost: self.lost,
            verdicts: Verdicts::default(),
        };
        let blind = fit.with_prior.rank < UNKNOWNS;
        outcome.verdicts.add_if(Verdict::Blind, blind);
        self.judge(&mut outcome, limits);
        Ok(outcome)
    }

    /// Where to linearise, and what is known beforehand.
    fn beforehand(&self) -> ([Coefficients<f64>; INSTRUMENTS], Prior) {
        let mut prior = Prior::default();
        if let Some(sigma_per_g) = self.set_up.cross_coupling_sigma_per_g {
            prior = Prior::cross_couplings(sigma_per_g);
        }
        prior = prior.beside_beforehand();
        match self.set_up.stored {
            Some(stored) => {
                prior.mean = stored.map(|c| c.to_nominal());
                (stored, prior)
            }
            None => {
                let ideal = |scale_factor_v_per_g| Coefficients {
                    scale_factor_v_per_g,
                    ..Coefficients::default()
                };
                (self.set_up.nominal_v_per_g.map(ideal), prior)
            }
        }
    }

    fn judge(&self, outcome: &mut Outcome, limits: &Limits) {
        let excess = outcome.chi2 - f64::from(outcome.degrees_of_freedom);
        let freedom = f64::from(outcome.degrees_of_freedom.max(1));
        let spread = num_traits::Float::sqrt(2.0 * freedom);
        let beyond = |x: f64, limit: f64| x.is_nan() || x.abs() > limit;
        let any = |of: &dyn Fn(usize) -> bool| (0..INSTRUMENTS).any(of);
        let found = outcome.coefficients;
        let verdicts = &mut outcome.verdicts;
        verdicts.add_if(Verdict::Residuals, excess > limits.residual_sigmas * spread);
        let scale = |s: usize| {
            let nominal = self.set_up.nominal_v_per_g[s];
            beyond(found[s].scale_factor_v_per_g / nominal - 1.0, limits.scale)
        };
        verdicts.add_if(Verdict::Scale, any(&scale));
        verdicts.add_if(
            Verdict::Bias,
            any(&|s| beyond(found[s].bias_g, limits.bias_g)),
        );
        verdicts.add_if(Verdict::Noise, outcome.noise_g > limits.noise_g);
        verdicts.add_if(Verdict::Converter, outcome.lost > 0);
        if let Some(stored) = &self.set_up.stored {
            let changed = |s: usize| {
                let was = &stored[s];
                let scale = found[s].scale_factor_v_per_g / was.scale_factor_v_per_g - 1.0;
                let bias_g = found[s].bias_g - was.bias_g;
                beyond(scale, limits.change_sigmas * outcome.scale_sigma[s])
                    || beyond(bias_g, limits.change_sigmas * outcome.bias_sigma_g[s])
            };
            verdicts.add_if(Verdict::Changed, any(&changed));
        }
    }
}
