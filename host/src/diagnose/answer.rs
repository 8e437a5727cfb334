//! The answer, `vre-diagnosis/1`.

use std::path::Path;

use serde::{Deserialize, Serialize};
use shared::compensate::Calibration;
use shared::model::Coefficients;
use shared::rectification::{Covariance, RECTIFYING};

use crate::contradictions::Contradiction;
use crate::effects::identity::Stage;
use crate::effects::{self, Effect};
use crate::error::{Error, clip};
use crate::input::read_at_most;

/// Name of the format.
pub const FORMAT: &str = "vre-diagnosis/1";

/// In a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing beyond the stated uncertainty.
    NoGap,
    /// One hypothesis holds.
    Explained,
    /// One class of hypotheses that these data do not split holds.
    Ambiguous,
    /// There is a gap and nothing in the catalogue explains it.
    Unexplained,
    /// Nothing beyond the stated uncertainty, but a gap as large as the vibration error itself could not have shown.
    CannotTell,
}

impl Verdict {
    /// Whether no gap was seen.
    pub fn sees_none(self) -> bool {
        matches!(self, Self::NoGap | Self::CannotTell)
    }
}

/// The least gap that the runs could have shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sight {
    /// As a share of each run's vibration error.
    pub share_of_vre: f64,
    /// Root mean square of that over the runs, g.
    pub rms_g: f64,
}

impl Sight {
    /// Whether a gap as large as the vibration error itself would have shown.
    pub fn suffices(&self) -> bool {
        self.share_of_vre < 1.0
    }
}

/// Size of the gap.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Root mean square over all observations in units of their stated uncertainty; about 1 without a gap.
    pub rms_over_noise: f64,
    /// Probability of so large a misfit of the nominal model by chance.
    pub p_value: f64,
}

/// Where it lies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Where {
    /// By observable.
    pub observables: Vec<ObservableShare>,
    /// By link of the chain, from the hypotheses.
    pub stages: Vec<StageProbability>,
    /// Regions of conditions that hold it.
    pub conditions: Vec<Condition>,
}

/// Probability that an effect of a stage acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageProbability {
    /// Link of the chain.
    pub stage: Stage,
    /// Sum of the probabilities of its hypotheses.
    pub probability: f64,
}

/// One hypothesis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Which {
    /// Effects that act; none is the nominal model.
    pub effects: Vec<String>,
    /// Its probability.
    pub probability: f64,
    /// Their parameters.
    pub parameters: Vec<ParameterEstimate>,
    /// What else these data cannot tell from it: effects, or sets of effects joined by `+`.
    pub indistinguishable_from: Vec<String>,
    /// Parameters as the catalogue has them, effect by effect: where a new fit starts.
    #[serde(default)]
    pub fitted: Vec<Vec<f64>>,
}

/// A parameter with its standard uncertainty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterEstimate {
    /// Effect that it belongs to.
    #[serde(default)]
    pub effect: String,
    /// Name with its unit.
    pub name: String,
    /// Estimate.
    pub value: f64,
    /// Standard uncertainty.
    pub sigma: f64,
}

/// A cause of a bad static prediction that is no effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentificationCause {
    /// `plan-blindness` or `dial-noise`.
    pub cause: String,
    /// Share of the static prediction's squared error beyond the noise that it explains.
    pub share: f64,
}

/// Likeness of the hypotheses' signatures beyond what the nominal model can imitate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Similarity {
    /// Hypotheses, effects joined by `+`.
    pub hypotheses: Vec<String>,
    /// Correlations, -1 to 1.
    pub correlation: Vec<Vec<f64>>,
}

/// A quantity with its standard uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Estimate.
    pub value: f64,
    /// Standard uncertainty.
    pub sigma: f64,
}

/// A row that does not belong.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SuspectRow {
    /// `static.csv` or `vibration.csv`.
    pub file: String,
    /// Line of the file; the header is 1.
    pub row: u64,
    /// `reading` or `run`.
    pub what: String,
    /// Its `order` or `run`.
    pub number: u64,
    /// Distance from what all other rows say of it, standard deviations.
    pub sigma_off: f64,
    /// A slip of the hand that would make sense of it.
    pub would_explain: Option<String>,
    /// Whether the answer was found without it.
    pub set_aside: bool,
}

/// How far a stated noise holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseFactor {
    /// `readings`, `plateaus` or `drift`.
    pub of: String,
    /// What the scatter is in terms of what is stated.
    pub factor: Estimate,
    /// Whether that may be 1.
    pub stated_holds: bool,
}

/// What shaker, reference and peak detector have of their own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShakerEstimate {
    /// Noise of each axis of the reference, g rms.
    pub reference_noise_g: Option<f64>,
    /// Relative scatter of the reference's rms from run to run, its own.
    pub reference_scatter: Option<f64>,
    /// Relative scatter of the table's level about its command.
    pub table_scatter: Option<f64>,
    /// Gain of each of the reference's axes over the command's, where runs tell it.
    pub reference_gain: Vec<AxisEstimate>,
    /// Sensitivity of the reference's axes to motion along another one; motion of the table across its drive looks the same.
    pub reference_cross_sensitivity: Vec<AxisEstimate>,
    /// Level of the table over its command, as the instrument feels it.
    pub table_level: Option<Estimate>,
    /// Gain of the peak detector.
    pub peak_gain: Option<Estimate>,
}

/// What an axis reads of a motion along one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisEstimate {
    /// Axis that reads: i, p or o.
    pub axis: String,
    /// Axis along which the motion is.
    pub along: String,
    /// The value.
    pub value: f64,
    /// Its standard uncertainty.
    pub sigma: f64,
}

/// What a session has of its own, beside the first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionEstimate {
    /// Its name.
    pub session: String,
    /// Bias less that of the first session, g.
    pub bias_g: Option<Estimate>,
    /// Turns about PA and OA against the first session, rad.
    pub alignment_rad: Vec<Estimate>,
    /// Gain over that of the first session.
    pub gain: Option<Estimate>,
}

/// `vre-diagnosis/1`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// Always `vre-diagnosis/1`.
    pub format: String,
    /// Serial number of the instrument.
    pub serial: String,
    /// In a word.
    pub verdict: Verdict,
    /// How large.
    pub gap: Gap,
    /// Where.
    #[serde(rename = "where")]
    pub location: Where,
    /// Which effects, most probable first.
    pub which: Vec<Which>,
    /// How far it shrinks; absent without runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shrink: Option<Shrink>,
    /// What to measure next.
    pub next_tests: Vec<NextTest>,
    /// Why the static prediction is off, if it is, without an effect.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identification: Option<IdentificationCause>,
    /// Which hypotheses look alike.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub similarity: Option<Similarity>,
    /// What the instrument's own compensation can carry of it; absent where no one hypothesis explains the gap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compensation: Option<Compensation>,
    /// Rows that do not belong, set aside.
    #[serde(default)]
    pub suspects: Vec<SuspectRow>,
    /// Columns that contradict each other: runs that are set aside for it, and what the user accepted.
    #[serde(default)]
    pub contradictions: Vec<Contradiction>,
    /// How far the stated noise holds, by kind.
    #[serde(default)]
    pub noise: Vec<NoiseFactor>,
    /// What each session after the first has of its own.
    #[serde(default)]
    pub sessions: Vec<SessionEstimate>,
    /// What shaker, reference and peak detector have of their own; `None` without runs.
    #[serde(default)]
    pub shaker: Option<ShakerEstimate>,
    /// What could not be looked at, and why.
    #[serde(default)]
    pub not_looked_at: Vec<String>,
    /// Where no gap was seen, the least one that could have been; absent without runs, or where none could.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sight: Option<Sight>,
    /// What an unexplained gap is like; absent where no effects make most of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub like: Option<Likeness>,
}

/// Effects that make most of a gap which they do not explain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Likeness {
    /// Effects that act.
    pub effects: Vec<String>,
    /// Share of the gap's squared excess over the stated noise that they make, 0.5 to 1.
    pub share_of_gap: f64,
    /// Root mean square of what their fit leaves in units of the stated uncertainty; about 1 would be right.
    pub leaves_rms_over_noise: f64,
    /// Regions of conditions that hold what it leaves.
    pub leaves_in: Vec<Condition>,
}

/// Share of the excess in one observable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObservableShare {
    /// `static`, `vibration`, `bias`, `recovery` or `in-run-drift`.
    pub name: String,
    /// Share of the squared excess over the stated noise, 0 to 1.
    pub share: f64,
}

/// A region of conditions that holds more of the excess than its size would have it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Condition {
    /// Which condition.
    pub factor: String,
    /// Least value in the region.
    pub low: f64,
    /// Greatest value in the region.
    pub high: f64,
    /// Share of the excess, 0 to 1.
    pub share: f64,
    /// Numbers of the runs in the region; of the readings (`order`) for a factor of the dial.
    pub runs: Vec<u64>,
    /// Probability that a search finds as much by chance.
    pub p_value: f64,
}

impl Condition {
    /// Whether its numbers are those of readings of the dial.
    pub fn of_readings(&self) -> bool {
        DIAL_FACTORS.contains(&self.factor.as_str())
    }
}

/// Conditions of readings; all others are of runs.
pub(super) const DIAL_FACTORS: [&str; 3] = ["dial_deg", "series", "approach"];

/// Root mean squares over held-out runs of measured less predicted vibration error, g.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shrink {
    /// Coefficients from the static test alone.
    pub held_out_rms_static_only_g: f64,
    /// The nominal model fitted to everything but the held-out runs.
    pub held_out_rms_refit_g: f64,
    /// The same with the effects.
    pub held_out_rms_with_effects_g: f64,
    /// What the noise of the plateaus and the finite records would leave of a perfect prediction.
    pub noise_floor_rms_g: f64,
    /// What the effects close of what the refit leaves above the floor on runs that nobody has made, 0 to 1; 0 where they
    /// are not used in predictions, which they would make no better.
    pub closed_fraction: f64,
    /// The central 90 % of what it may be.
    #[serde(default)]
    pub closed_fraction_interval_90: [f64; 2],
}

impl Shrink {
    /// Effects of a gap that stays unexplained are not used in predictions, and close nothing.
    pub(super) fn under(self, verdict: Verdict) -> Self {
        match verdict {
            Verdict::Unexplained => Self {
                closed_fraction: 0.0,
                closed_fraction_interval_90: [0.0; 2],
                ..self
            },
            _ => self,
        }
    }
}

/// A proposed test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NextTest {
    /// What to do.
    pub change: String,
    /// Hypotheses that it separates.
    pub separates: Vec<String>,
    /// Expected information about which of them holds, bits.
    pub expected_bits: f64,
}

/// Coefficients to hand to the instrument, and what they leave out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Compensation {
    /// The coefficients of (1), fitted to all readings and runs together with the effects.
    pub coefficients: Coefficients<f64>,
    /// Covariance of those that rectify: k1', k2, k3, k4, k_IP, k_IO, k_PO, k5, K0', Koq, Kpp, Koo. Zero for a term that was
    /// not diagnosed.
    #[serde(default)]
    pub covariance: [[f64; RECTIFYING]; RECTIFYING],
    /// Diagnosed terms of the characteristic that these hold.
    pub carried: Vec<String>,
    /// Diagnosed terms of the characteristic that stay uncompensated: [`super::WHY_NOT_CARRIED`].
    pub not_carried: Vec<String>,
    /// Nominal coefficients that readings and runs determine, 0 to 11; of the others nothing but the prior is known.
    #[serde(default)]
    pub rank: u8,
}

/// Largest diagnosis that is read: some hundred times the largest that is written.
const MAX_BYTES: u64 = 1 << 24;

impl Diagnosis {
    /// Reads a diagnosis that `vre diagnose --json` wrote.
    ///
    /// # Errors
    /// Unreadable, not JSON of that format, or an effect that the catalogue does not hold.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let bytes = read_at_most(file, MAX_BYTES)?;
        let diagnosis: Self = serde_json::from_slice(&bytes)
            .map_err(|error| Error::input(file, error.to_string().replace('\n', " ")))?;
        if diagnosis.format != FORMAT {
            return Err(Error::input(
                file,
                format!(
                    "its format is \"{}\", not \"{FORMAT}\"",
                    clip(&diagnosis.format)
                ),
            ));
        }
        for id in diagnosis.which.iter().flat_map(|which| &which.effects) {
            if effects::find(id).is_none() {
                return Err(Error::input(
                    file,
                    format!("\"{}\" is no effect of the catalogue", clip(id)),
                ));
            }
        }
        Ok(diagnosis)
    }

    /// Whether the effects that it names serve predictions: they explain the gap, and close something of it.
    pub fn serves(&self) -> bool {
        self.verdict != Verdict::Unexplained
            && self
                .shrink
                .is_none_or(|shrink| shrink.closed_fraction > 0.0)
    }

    /// What of it the instrument may be given.
    pub fn offered(&self) -> Option<&Compensation> {
        self.compensation.as_ref().filter(|_| self.serves())
    }

    /// The most probable effects with their parameters as the catalogue has them, as far as adding them makes predictions
    /// better.
    pub fn serving(&self) -> impl Iterator<Item = (&'static Effect, &[f64])> {
        let best = self.which.first().filter(|_| self.serves());
        let effects = best
            .into_iter()
            .flat_map(|which| which.effects.iter().zip(&which.fitted));
        effects.filter_map(|(id, values)| {
            let effect = effects::find(id)?;
            (values.len() == effect.parameters.len()).then_some((effect, &values[..]))
        })
    }
}

impl Compensation {
    /// For the instrument.
    pub fn calibration(&self) -> Calibration<f64> {
        Calibration {
            coefficients: self.coefficients,
            covariance: Covariance::from_fn(|j, k| self.covariance[j][k]),
            rank: self.rank,
        }
    }
}
