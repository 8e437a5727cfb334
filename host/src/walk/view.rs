//! What is shown of a walk, as plain data: the terminal and the page draw it, and neither computes.

use serde::Serialize;
use shared::model::NOMINAL;
use shared::tumble::Position;

use super::machine::{Phase, Walk, number};
use super::stops::StopState;
use crate::bench::plan::Dwell;
use crate::campaign::{Approach, Series};
use crate::quantity::Quantity;
use crate::record::Tally;
use crate::statics::{self, Conditions, DEFAULT_PRIOR_SIGMA, MEANINGS, NAMES, assess};

/// Everything that is shown.
#[derive(Clone, Debug, Serialize)]
pub struct View {
    /// Serial number of the instrument.
    pub serial: String,
    /// What the walk is doing.
    pub phase: Phase,
    /// What the person should know.
    pub message: String,
    /// Index of the stop that is measured now.
    pub at: Option<usize>,
    /// All stops.
    pub stops: Vec<StopView>,
    /// How long the output has been steady and has to be, s.
    pub steady_s: f64,
    /// See `steady_s`.
    pub settle_s: f64,
    /// How much of a reading is there and has to be, s.
    pub read_s: f64,
    /// See `read_s`.
    pub dwell_s: f64,
    /// Output now and its rms noise, g by the scale factor so far.
    pub output_g: Option<f64>,
    /// See `output_g`.
    pub noise_g: Option<f64>,
    /// What is expected at this stop and its standard uncertainty, g.
    pub expected_g: Option<f64>,
    /// See `expected_g`.
    pub expected_sigma_g: Option<f64>,
    /// Time, s, and output, g, of the last half minute.
    pub trace: Vec<[f64; 2]>,
    /// Temperature of the instrument as stated, degrees Celsius.
    pub temp_c: f64,
    /// What was lost.
    pub counts: Counts,
    /// The readings that count.
    pub readings: Vec<ReadingView>,
    /// The coefficients so far.
    pub coefficients: Vec<CoefficientView>,
    /// The vibration error so far.
    pub vre: Option<VreView>,
}

/// What was lost on the way.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    /// Samples missing because frames are.
    pub missing_samples: u64,
    /// Frames missing on the line.
    pub missing_frames: u64,
    /// Samples lost at the converter.
    pub not_sent: u64,
    /// Times that the instrument began anew.
    pub restarts: u64,
    /// Faults of the converter that were told, and the last of them.
    pub faults: u64,
    /// See `faults`.
    pub last_fault: Option<String>,
}

impl Counts {
    /// Of a record, with the faults of the converter that it tells of.
    pub fn of(tally: &Tally, faults: u64, last_fault: Option<String>) -> Self {
        Self {
            missing_samples: tally.blocks.missing,
            missing_frames: tally.missing_frames,
            not_sent: tally.blocks.not_sent,
            restarts: tally.restarts,
            faults,
            last_fault,
        }
    }
}

/// A stop.
#[derive(Clone, Debug, Serialize)]
pub struct StopView {
    /// 1 to 3.
    pub series: u8,
    /// The instrument's axis along the dial's shaft.
    pub along: &'static str,
    /// Angle of the dial, deg.
    pub dial_deg: f64,
    /// Angle of the instrument on the shaft, deg.
    pub mount_deg: f64,
    /// `cw` or `ccw`.
    pub approach: &'static str,
    /// Its nominal specific force along the input axis, g.
    pub a_i_g: f64,
    /// What has become of it.
    pub standing: StopState,
}

/// A reading.
#[derive(Clone, Debug, Serialize)]
pub struct ReadingView {
    /// Its number.
    pub reading: u32,
    /// 1 to 3.
    pub series: u8,
    /// Angle of the dial, deg.
    pub dial_deg: f64,
    /// Angle of the instrument on the shaft, deg.
    pub mount_deg: f64,
    /// `cw` or `ccw`.
    pub approach: &'static str,
    /// Output and its standard uncertainty from noise, V.
    pub output_v: f64,
    /// See `output_v`.
    pub sigma_v: f64,
    /// The same in g by the scale factor so far.
    pub output_g: f64,
    /// See `output_g`.
    pub sigma_g: f64,
    /// Against the readings before it, g.
    pub residual_g: f64,
    /// The same in its standard uncertainties.
    pub sigmas: f64,
    /// Whether it fits them.
    pub sound: bool,
    /// Why.
    pub reason: String,
    /// What the person remarked.
    pub remark: String,
}

/// A coefficient.
#[derive(Clone, Debug, Serialize)]
pub struct CoefficientView {
    /// Its name with the unit.
    pub name: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Estimate and standard uncertainty.
    #[serde(flatten)]
    pub quantity: Quantity,
    /// The same as a person writes it.
    pub text: String,
}

/// The vibration error that the readings predict.
#[derive(Clone, Debug, Serialize)]
pub struct VreView {
    /// The vibration.
    pub environment: String,
    /// In it, g.
    pub value_g: f64,
    /// Standard uncertainty, g.
    pub sigma_g: f64,
    /// As a person writes it, in 1e-6 g.
    pub text: String,
    /// The standard uncertainty that is asked for, as a share of the value.
    pub share: Option<f64>,
    /// Whether it is reached.
    pub enough: Option<bool>,
    /// Readings, value and standard uncertainty, g, as they came.
    pub history: Vec<(usize, f64, f64)>,
}

impl Walk {
    /// What is to be shown at `now_s`.
    pub fn view(&self, now_s: f64, counts: Counts) -> View {
        let k1 = self.estimate.scale_factor_v_per_g();
        let expected = self
            .stops
            .dwell()
            .map(|dwell| self.estimate.expected_v(dwell));
        let last = self.live.last_v();
        let block_s = self.settings.dwell_s / f64::from(self.settings.blocks.max(1));
        let read_s = match self.phase {
            Phase::Read { blocks, .. } => block_s * f64::from(blocks),
            _ => 0.0,
        };
        let steady_s = match self.phase {
            Phase::Settle { .. } => self.live.steady_s(now_s).min(self.settings.settle_s),
            _ => 0.0,
        };
        View {
            serial: self.config.instrument.serial.clone(),
            phase: self.phase.clone(),
            message: self.message.clone(),
            at: self.stops.at(),
            stops: self
                .stops
                .all()
                .iter()
                .map(|(dwell, standing)| self.stop(dwell, *standing))
                .collect(),
            steady_s,
            settle_s: self.settings.settle_s,
            read_s,
            dwell_s: self.settings.dwell_s,
            output_g: last.map(|(mean_v, _)| mean_v / k1),
            noise_g: last.map(|(_, rms_v)| rms_v / k1.abs()),
            expected_g: expected.map(|(value_v, _)| value_v / k1),
            expected_sigma_g: expected.map(|(_, sigma_v)| sigma_v / k1.abs()),
            trace: self.live.points().map(|[t, v]| [t, v / k1]).collect(),
            temp_c: self.temp_c,
            counts,
            readings: self.readings(k1),
            coefficients: self.coefficients(),
            vre: self.vre(),
        }
    }

    fn stop(&self, dwell: &Dwell, standing: StopState) -> StopView {
        let g = self.config.bench.local_gravity_g;
        StopView {
            series: dwell.series.into(),
            along: match dwell.series {
                Series::OutputAxis => "OA",
                Series::PendulousAxis => "PA",
                Series::InputAxis => "IA",
            },
            dial_deg: dwell.dial_deg,
            mount_deg: dwell.mount_deg,
            approach: approach(dwell.approach),
            a_i_g: g * position(dwell).specific_force().i,
            standing,
        }
    }

    fn readings(&self, k1: f64) -> Vec<ReadingView> {
        let each = self.judged.iter().map(|judged| {
            let reading = &judged.reading;
            let judgement = &judged.judgement;
            ReadingView {
                reading: number(reading),
                series: reading.series.into(),
                dial_deg: reading.dial_deg,
                mount_deg: reading.mount_deg,
                approach: approach(reading.approach),
                output_v: reading.output_v,
                sigma_v: reading.sigma_v,
                output_g: reading.output_v / k1,
                sigma_g: reading.sigma_v / k1.abs(),
                residual_g: judgement.residual_g,
                sigmas: judgement.sigmas,
                sound: judgement.sound,
                reason: judgement.reason.clone(),
                remark: judged.remark.clone(),
            }
        });
        each.collect()
    }

    fn coefficients(&self) -> Vec<CoefficientView> {
        let found = self.estimate.coefficients();
        let each = (0..NOMINAL).map(|k| CoefficientView {
            name: NAMES[k],
            meaning: MEANINGS[k],
            quantity: found[k],
            text: found[k].scaled(if k == 0 { 1.0 } else { 1e6 }).to_string(),
        });
        each.collect()
    }

    fn vre(&self) -> Option<VreView> {
        let environment = &self.settings.environment;
        let (value_g, sigma_g) = self.estimate.vre_g(environment)?;
        let enough = |share: f64| sigma_g <= share * value_g.abs();
        Some(VreView {
            environment: environment.name.clone(),
            value_g,
            sigma_g,
            text: Quantity::new(value_g, sigma_g).scaled(1e6).to_string(),
            share: self.settings.enough,
            enough: self.settings.enough.map(enough),
            history: self.history.clone(),
        })
    }
}

/// Standard uncertainty of a reading from noise before there is one, g: that of a 10 s reading of a navigation accelerometer.
const FIRST_NOISE_G: f64 = 1.5e-6;

/// The stop that waits whose reading would leave the least uncertain vibration error.
pub(super) fn best_stop(walk: &Walk) -> Option<usize> {
    let k1 = walk.estimate.scale_factor_v_per_g().abs();
    let noise_g = walk
        .judged
        .last()
        .map_or(FIRST_NOISE_G, |j| j.reading.sigma_v / k1);
    let conditions = Conditions {
        bench: statics::bench(&walk.config.bench),
        noise_g,
        prior_sigma: DEFAULT_PRIOR_SIGMA,
    };
    let environments = [walk.settings.environment.clone()];
    let mut plan: Vec<Position> = walk
        .judged
        .iter()
        .map(|judged| statics::position(&judged.reading))
        .collect();
    let mut best: Option<(f64, usize)> = None;
    for index in walk.stops.indices_waiting() {
        plan.push(position(&walk.stops.all()[index].0));
        // A plan that cannot be judged yet is no better than any other.
        let sigma_g = assess(&plan, &conditions, &environments)
            .map_or(f64::INFINITY, |found| found.environments[0].sigma_g());
        plan.pop();
        if best.is_none_or(|(least, _)| sigma_g < least) {
            best = Some((sigma_g, index));
        }
    }
    best.map(|(_, index)| index)
}

fn position(dwell: &Dwell) -> Position {
    Position {
        series: dwell.series,
        dial_deg: dwell.dial_deg,
        mount_deg: dwell.mount_deg,
    }
}

fn approach(approach: Approach) -> &'static str {
    match approach {
        Approach::Clockwise => "cw",
        Approach::CounterClockwise => "ccw",
    }
}
