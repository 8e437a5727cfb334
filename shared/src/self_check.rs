//! Self-check after calibration: on the instrument itself, from the dial readings as they come.
//!
//! [`ReadingSums`] makes one reading of the blocks at a dial position; [`SelfCheck`] absorbs it into the triangular
//! factor of [`identify`](crate::identify), in constant memory, solves, and compares with the stored coefficients and
//! with limits. The host runs this same code on the same frames; `f64` on both sides, since coefficients of 1e-7 g are
//! told apart from readings of 1 g.

use serde::{Deserialize, Serialize};

use crate::channels::{Block, CHANNELS};
use crate::identify::square_root::FactorError;
use crate::identify::static_test::{Bench, Reading, StaticTest, StaticTestError};
use crate::model::{Coefficients, FURTHER, NOMINAL};
use crate::tumble::Position;

/// Dial marks for which the instrument has room: the 24 of a full-rank plan, and their remounted ones.
pub const MARKS: usize = 24;

/// Pairs of series and mount for which the instrument has room.
pub const MOUNTS: usize = 6;

/// What the blocks of one dial position come to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReadingSums {
    sums: [i64; CHANNELS],
    count: u64,
    lost: u64,
    /// Mean code and number of samples of the last block.
    last: Option<(f64, f64)>,
    steps: u32,
    /// Sum of squares about the blocks' means.
    within: f64,
    /// Sum over successive blocks of the squared step of their means, over its variance for noise of variance 1.
    noise: f64,
}

impl ReadingSums {
    /// Takes the next block of the position.
    pub fn absorb(&mut self, block: &Block) {
        self.lost = self.lost.saturating_add(u64::from(block.lost));
        if block.count == 0 {
            return;
        }
        for (sum, part) in self.sums.iter_mut().zip(block.moments.sum) {
            *sum = sum.saturating_add(part);
        }
        self.count = self.count.saturating_add(u64::from(block.count));
        let count = f64::from(block.count);
        self.within += count * f64::from(block.moments.second[0]);
        let mean = block.moments.sum[0] as f64 / count;
        if let Some((before, samples)) = self.last.replace((mean, count)) {
            let step = mean - before;
            self.noise += step * step * (samples * count / (samples + count));
            self.steps += 1;
        }
    }

    /// Mean code of a channel, `None` without samples.
    pub fn mean(&self, channel: usize) -> Option<f64> {
        let sum = *self.sums.get(channel)?;
        (self.count > 0).then(|| sum as f64 / self.count as f64)
    }

    /// Standard uncertainty of the mean code of channel 0, from the larger of two variances: of white noise within the
    /// blocks, and of the steps between successive blocks, which noise of low frequency raises and a drift does not
    /// upset; and the code's width. `None` with fewer than two blocks.
    pub fn sigma(&self) -> Option<f64> {
        let steps = self.noise / f64::from(self.steps);
        let variance = steps.max(self.within / self.count as f64);
        let width = 1.0 / 12.0;
        (self.steps > 0).then(|| num_traits::Float::sqrt((variance + width) / self.count as f64))
    }

    /// Conversions that were lost at this position.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

/// What the self-check has to know beside the readings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetUp {
    /// Standard uncertainties of the bench.
    pub bench: Bench<f64>,
    /// The type's scale factor, V/g, > 0.
    pub nominal_v_per_g: f64,
    /// Scale of the reference's channels I, P and O, V/g; `None` if the reference does not see gravity.
    pub reference_v_per_g: Option<[f64; 3]>,
}

impl Default for SetUp {
    /// An exact bench, an instrument of 1 V/g, a reference that does not see gravity.
    fn default() -> Self {
        Self {
            bench: Bench {
                dial_sigma_rad: 0.0,
                dial_repeat_sigma_rad: 0.0,
                mount_sigma_rad: 0.0,
                level_sigma_rad: 0.0,
                local_gravity_g: 1.0,
            },
            nominal_v_per_g: 1.0,
            reference_v_per_g: None,
        }
    }
}

impl SetUp {
    /// True when every figure can be: uncertainties not negative, scales positive, all finite.
    pub fn is_possible(&self) -> bool {
        let b = &self.bench;
        let sigmas = [
            b.dial_sigma_rad,
            b.dial_repeat_sigma_rad,
            b.mount_sigma_rad,
            b.level_sigma_rad,
        ];
        let scales = self.reference_v_per_g.unwrap_or([1.0; 3]);
        let scales = scales
            .iter()
            .chain([&b.local_gravity_g, &self.nominal_v_per_g]);
        sigmas.iter().all(|s| s.is_finite() && *s >= 0.0)
            && scales.into_iter().all(|s| s.is_finite() && *s > 0.0)
    }
}

/// Limits beyond which the instrument is not what it should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Deviation of the scale factor from the type's, relative.
    pub scale: f64,
    /// Bias, g.
    pub bias_g: f64,
    /// Standard uncertainty of one reading from noise, g.
    pub noise_g: f64,
    /// Deviation of the reference from the dial's specific force, g.
    pub reference_g: f64,
    /// Deviation of a coefficient from the stored one, in standard uncertainties of the new one.
    pub change_sigmas: f64,
    /// Deviation of chi-square from its expectation, in its own standard deviations.
    pub residual_sigmas: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            scale: 0.1,
            bias_g: 0.01,
            noise_g: 1e-4,
            reference_g: 0.02,
            change_sigmas: 5.0,
            residual_sigmas: 5.0,
        }
    }
}

/// What is wrong, as bits of [`Verdicts`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Verdict {
    /// Residuals are larger than the stated uncertainties allow.
    Residuals = 1 << 0,
    /// The scale factor is off the type's.
    Scale = 1 << 1,
    /// The bias is too large.
    Bias = 1 << 2,
    /// The plan does not determine every coefficient.
    Blind = 1 << 3,
    /// The output is too noisy.
    Noise = 1 << 4,
    /// Conversions were lost, or the converter reported a fault.
    Converter = 1 << 5,
    /// The reference does not see the specific force of the dial's position.
    Reference = 1 << 6,
    /// Coefficients differ from the stored ones; not told where further coefficients are stored beside the nominal ones, which
    /// a static test alone does not find apart from them.
    Changed = 1 << 7,
}

impl Verdict {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Residuals,
        Self::Scale,
        Self::Bias,
        Self::Blind,
        Self::Noise,
        Self::Converter,
        Self::Reference,
        Self::Changed,
    ];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Residuals => "residuals",
            Self::Scale => "scale factor",
            Self::Bias => "bias",
            Self::Blind => "blind plan",
            Self::Noise => "noise",
            Self::Converter => "converter",
            Self::Reference => "reference",
            Self::Changed => "coefficients changed",
        }
    }
}

/// A set of [`Verdict`]s; none means passed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdicts(pub u16);

impl Verdicts {
    /// True when there are none.
    pub const fn passed(self) -> bool {
        self.0 == 0
    }

    /// The verdicts.
    pub fn iter(self) -> impl Iterator<Item = Verdict> {
        let has = move |verdict: &Verdict| self.0 & *verdict as u16 != 0;
        Verdict::ALL.into_iter().filter(has)
    }

    fn add_if(&mut self, verdict: Verdict, wrong: bool) {
        self.0 |= if wrong { verdict as u16 } else { 0 };
    }
}

/// The answer of a self-check, figures and verdicts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Readings that went in.
    pub readings: u32,
    /// Rank of the plan, 0 to 11.
    pub rank: u8,
    /// The coefficients, in the order of [`Coefficients::to_nominal`].
    pub coefficients: [f64; NOMINAL],
    /// Their standard uncertainties; zero along what the plan does not determine.
    pub sigma: [f64; NOMINAL],
    /// Sum of the squared whitened residuals.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: u32,
    /// Largest standard uncertainty of a reading from noise, g.
    pub noise_g: f64,
    /// Largest deviation of the reference from the dial's specific force, g.
    pub reference_g: f64,
    /// Conversions lost within readings.
    pub lost: u64,
    /// What is wrong.
    pub verdicts: Verdicts,
}

/// Why a position does not become a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CheckError {
    /// Fewer than two blocks: no uncertainty.
    TooShort,
    /// The static test refuses it.
    Test(StaticTestError),
}

/// The self-check so far.
#[derive(Debug)]
pub struct SelfCheck<'a> {
    test: StaticTest<'a, f64>,
    set_up: SetUp,
    noise_v: f64,
    reference_g: f64,
    lost: u64,
}

impl<'a> SelfCheck<'a> {
    /// Begins, with room for [`MARKS`] and [`MOUNTS`] in `workspace`
    /// ([`workspace_len`](crate::identify::static_test::workspace_len) numbers).
    ///
    /// # Errors
    /// [`StaticTestError::Workspace`].
    pub fn new(set_up: SetUp, workspace: &'a mut [f64]) -> Result<Self, StaticTestError> {
        let about = about(&set_up);
        Ok(Self {
            test: StaticTest::new(set_up.bench, about, MARKS, MOUNTS, workspace)?,
            set_up,
            noise_v: 0.0,
            reference_g: 0.0,
            lost: 0,
        })
    }

    /// Forgets all readings and begins anew, in the same work space.
    pub fn restart(&mut self, set_up: SetUp) {
        self.test.restart(set_up.bench, about(&set_up));
        self.set_up = set_up;
        self.noise_v = 0.0;
        self.reference_g = 0.0;
        self.lost = 0;
    }

    /// Absorbs the blocks of one dial position; `v_per_code` of the four channels.
    ///
    /// # Errors
    /// [`CheckError`]; the check is as before.
    pub fn absorb(
        &mut self,
        position: Position,
        sums: &ReadingSums,
        v_per_code: [f64; CHANNELS],
    ) -> Result<(), CheckError> {
        let (Some(mean), Some(sigma)) = (sums.mean(0), sums.sigma()) else {
            return Err(CheckError::TooShort);
        };
        let sigma_v = sigma * v_per_code[0];
        let reading = Reading {
            position,
            output_v: mean * v_per_code[0],
            sigma_v,
        };
        self.test.absorb(&reading).map_err(CheckError::Test)?;
        self.noise_v = self.noise_v.max(sigma_v);
        self.lost = self.lost.saturating_add(sums.lost());
        let a = position.specific_force();
        for (axis, scale) in self.set_up.reference_v_per_g.iter().flatten().enumerate() {
            let expected_g = [a.i, a.p, a.o][axis] * self.set_up.bench.local_gravity_g;
            let code = sums.mean(axis + 1).unwrap_or(f64::NAN);
            let off_g = (code * v_per_code[axis + 1] / scale - expected_g).abs();
            // A reference that is no number stays infinitely far off.
            let off_g = if off_g.is_nan() { f64::INFINITY } else { off_g };
            self.reference_g = self.reference_g.max(off_g);
        }
        Ok(())
    }

    /// Readings so far.
    pub fn readings(&self) -> usize {
        self.test.readings()
    }

    /// Solves, and judges against the limits and the coefficients that are stored; `converter_faults` counts what the
    /// converter reported meanwhile.
    ///
    /// # Errors
    /// [`FactorError::Undetermined`] with too few readings.
    pub fn conclude(
        &self,
        limits: &Limits,
        stored: Option<&Coefficients<f64>>,
        converter_faults: u32,
    ) -> Result<Outcome, FactorError> {
        let fit = self.test.solve(None)?;
        let coefficients = fit.coefficients.to_nominal();
        let sigma: [f64; NOMINAL] =
            core::array::from_fn(|k| num_traits::Float::sqrt(fit.covariance[k][k].max(0.0)));
        let freedom = fit.degrees_of_freedom();
        let k1 = fit.coefficients.scale_factor_v_per_g;
        let noise_g = self.noise_v / k1.abs();

        let mut verdicts = Verdicts::default();
        let excess = fit.chi2 - freedom as f64;
        let spread = num_traits::Float::sqrt(2.0 * freedom.max(1) as f64);
        verdicts.add_if(Verdict::Residuals, excess > limits.residual_sigmas * spread);
        let off = (k1 / self.set_up.nominal_v_per_g - 1.0).abs();
        verdicts.add_if(Verdict::Scale, off.is_nan() || off > limits.scale);
        let bias_g = fit.coefficients.bias_g.abs();
        verdicts.add_if(Verdict::Bias, bias_g.is_nan() || bias_g > limits.bias_g);
        verdicts.add_if(Verdict::Blind, fit.visibility.rank < NOMINAL);
        verdicts.add_if(Verdict::Noise, noise_g > limits.noise_g);
        verdicts.add_if(Verdict::Converter, self.lost > 0 || converter_faults > 0);
        verdicts.add_if(Verdict::Reference, self.reference_g > limits.reference_g);
        let nominal = |c: &&Coefficients<f64>| c.to_further() == [0.0; FURTHER];
        if let Some(stored) = stored.filter(nominal) {
            let changed = stored.to_nominal().into_iter().enumerate().any(|(k, was)| {
                let determined = fit.visibility.determines(k);
                determined && (coefficients[k] - was).abs() > limits.change_sigmas * sigma[k]
            });
            verdicts.add_if(Verdict::Changed, changed);
        }
        Ok(Outcome {
            readings: fit.readings as u32,
            rank: fit.visibility.rank as u8,
            coefficients,
            sigma,
            chi2: fit.chi2,
            degrees_of_freedom: freedom as u32,
            noise_g,
            reference_g: self.reference_g,
            lost: self.lost,
            verdicts,
        })
    }
}

/// Where the model is linearised: the type's instrument.
fn about(set_up: &SetUp) -> Coefficients<f64> {
    Coefficients {
        scale_factor_v_per_g: set_up.nominal_v_per_g,
        ..Coefficients::default()
    }
}
