//! A whole campaign on the virtual bench, and the truth behind it.

use serde::Serialize;
use shared::model::SpecificForce;

use super::accelerometer::Accelerometer;
use super::chain::{Chain, Constant, Motion};
use super::devices::Devices;
use super::dial::{self, Head, HeadSpecification};
use super::effects::{Effect, Plateau};
use super::environment::{Exposure, Moment, Room};
use super::noise::Seed;
use super::plan::{
    CHANGEOVER_S, DURATION_S, Plan, READING_INTERVAL_S, RUN_INTERVAL_S, Shake, Static,
};
use super::reference;
use super::shaker::Shaker;
use crate::campaign::{
    Acquisition, BEFORE_TO_AFTER_S, BEFORE_TO_DURING_S, Bench, Campaign, CampaignConfig, Drift,
    Extremes, Instrument, Measured, Reading, ReferenceMoments, Run, VibrationKind,
};

/// Steps of a recorded voltage in 1 V. The last bits of a computed number differ from one processor to another; what
/// is recorded must not.
const VOLTAGE_STEPS: f64 = 1e10;
/// Steps of a recorded drift in 1 V/s.
const DRIFT_STEPS: f64 = 1e13;
/// Steps of the reference's rms values in 1 g, and of its moments in 1.
const REFERENCE_STEPS: f64 = 1e9;

/// How good the parts of a bench are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Specification {
    /// The dividing head and its base.
    pub head: HeadSpecification,
    /// Standard deviation of a plateau's mean from the instrument's noise, g.
    pub noise_g: f64,
    /// Standard deviation of a run's drift, g/s. The logger measures it beside the mean, with noise of its own.
    pub drift_noise_g_per_s: f64,
    /// Relative standard deviation of the reference's rms value, per run and axis.
    pub reference_rms_rel_sigma: f64,
    /// Relative standard deviation of the peak detector, of the excursion.
    pub peak_rel_sigma: f64,
    /// The logger's rate, Hz.
    pub logger_rate_hz: f64,
    /// Local gravity over the unit g.
    pub local_gravity_g: f64,
    /// Temperature that the coefficients belong to, degrees Celsius.
    pub reference_temp_c: f64,
}

impl Specification {
    /// A laboratory's bench around a head with marks, and a base, of that standard uncertainty, arcsec.
    pub fn with_dial_sigma(dial_sigma_arcsec: f64) -> Self {
        Self {
            head: HeadSpecification {
                dial_sigma_arcsec,
                repeat_sigma_arcsec: 0.2,
                mount_sigma_arcsec: 60.0,
                level_sigma_arcsec: dial_sigma_arcsec,
            },
            noise_g: 1.5e-6,
            drift_noise_g_per_s: 4e-7,
            reference_rms_rel_sigma: 2e-4,
            peak_rel_sigma: 2e-4,
            logger_rate_hz: 400.0,
            local_gravity_g: 1.0,
            reference_temp_c: 22.0,
        }
    }
}

/// The instrument's output over one run, without the errors of logger and peak detector.
struct Levels {
    before_g: f64,
    during_g: f64,
    after_g: f64,
    minimum_g: f64,
    maximum_g: f64,
    drift_g_per_s: f64,
}

/// A bench with an instrument on it and a plan to follow; all of it fixed by the seed and the effects.
pub struct VirtualBench {
    /// Where all its randomness comes from.
    pub seed: Seed,
    /// How good its parts are.
    pub specification: Specification,
    /// What is measured.
    pub plan: Plan,
    /// The instrument.
    pub accelerometer: Accelerometer,
    /// What the nominal model does not know.
    pub effects: Vec<Box<dyn Effect>>,
    /// What its devices do that the campaign does not state.
    pub devices: Devices,
    head: Head,
    room: Room,
}

/// What a campaign came to.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// What a laboratory gets to see.
    pub campaign: Campaign,
    /// Runs made after the campaign: conditions and reference, without the instrument's output.
    pub holdout: Vec<Run>,
    /// What a laboratory never sees.
    pub truth: Truth,
}

/// The truth behind a simulated campaign, `vre-truth/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    /// Always `vre-truth/1`.
    pub format: &'static str,
    /// Serial number of the instrument.
    pub serial: String,
    /// The bench's seed.
    pub seed: u64,
    /// The effects, with their parameters by name.
    pub effects: Vec<EffectTruth>,
    /// K1 (V/g), k0, k1', k2, k3, k4, d_OA, d_PA, k_IP, k_IO, k_PO.
    pub coefficients: [f64; shared::model::NOMINAL],
    /// Vibration error of each campaign run without noise, g.
    pub vre_g: Vec<f64>,
    /// Vibration error of each hold-out run without noise, g.
    pub holdout_vre_g: Vec<f64>,
    /// What persons and devices did that the campaign does not state; absent if nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub imperfections: Vec<ImperfectionTruth>,
}

/// One imperfection of a simulated campaign.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImperfectionTruth {
    /// Its identifier.
    pub id: &'static str,
    /// Its size; none of what either happens or not.
    pub size: Option<f64>,
    /// Unit of the size; empty for a pure number.
    pub unit: &'static str,
    /// What was drawn, by name with the unit at its end.
    pub parameters: serde_json::Map<String, serde_json::Value>,
    /// The rows that it touches, `static.csv:12` by their line; a file's name alone where it touches all of them.
    pub rows: Vec<String>,
}

/// One effect of a simulated campaign.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EffectTruth {
    /// Its identifier.
    pub id: &'static str,
    /// Its parameters by name.
    pub parameters: serde_json::Map<String, serde_json::Value>,
}

impl VirtualBench {
    /// A bench of that seed.
    pub fn new(
        seed: Seed,
        statics: Static,
        specification: Specification,
        effects: Vec<Box<dyn Effect>>,
    ) -> Self {
        Self {
            seed,
            plan: Plan::new(statics, &mut seed.stream("order of runs", 0)),
            accelerometer: Accelerometer::draw(seed),
            head: Head::new(specification.head, seed),
            room: Room::draw(specification.reference_temp_c, seed),
            specification,
            effects,
            devices: Devices::default(),
        }
    }

    /// The same on the head whose marks belong to that seed.
    pub fn on_head(mut self, marks: Seed) -> Self {
        self.head = self.head.with_marks(marks);
        self
    }

    /// Serial number of the instrument, from the seed.
    pub fn serial(&self) -> String {
        format!("V{:05}", self.seed.0 % 100_000)
    }

    /// Makes every reading and every run of the plan, and the runs to hold out.
    pub fn simulate(&self) -> Simulation {
        let readings = (0..self.plan.dwells.len()).map(|order| self.reading(order));
        let readings: Vec<_> = readings.collect();
        let last_reading_s = self.plan.dwells.len() as f64 * READING_INTERVAL_S;
        let mut shaker = Shaker::default();
        let mut exposures = Vec::new();
        let (mut runs, mut vre_g) = (Vec::new(), Vec::new());
        for (number, shake) in self.plan.runs.iter().chain(&self.plan.holdout).enumerate() {
            let time_s = last_reading_s + CHANGEOVER_S + number as f64 * RUN_INTERVAL_S;
            let (run, error_g) = self.run(number, shake, time_s, &mut shaker, &mut exposures);
            runs.push(run);
            vre_g.push(error_g);
        }
        let mut holdout = runs.split_off(self.plan.runs.len());
        for run in &mut holdout {
            run.measured = None;
        }
        let holdout_vre_g = vre_g.split_off(self.plan.runs.len());
        Simulation {
            campaign: Campaign {
                config: self.config(),
                readings,
                runs,
            },
            holdout,
            truth: Truth {
                format: "vre-truth/1",
                serial: self.serial(),
                seed: self.seed.0,
                effects: self
                    .effects
                    .iter()
                    .map(|effect| effect.as_ref().into())
                    .collect(),
                coefficients: self.accelerometer.coefficients.to_nominal(),
                vre_g,
                holdout_vre_g,
                imperfections: Vec::new(),
            },
        }
    }

    /// What stands in `campaign.toml`.
    pub fn config(&self) -> CampaignConfig {
        let Specification { head, .. } = self.specification;
        CampaignConfig::new(
            Instrument {
                serial: self.serial(),
                scale_factor_nominal_v_per_g: self.accelerometer.scale_factor_nominal_v_per_g,
                full_scale_g: 10.0,
                unknown: Default::default(),
            },
            Bench {
                dial_sigma_arcsec: head.dial_sigma_arcsec,
                dial_repeat_sigma_arcsec: head.repeat_sigma_arcsec,
                mount_sigma_arcsec: head.mount_sigma_arcsec,
                level_sigma_arcsec: head.level_sigma_arcsec,
                local_gravity_g: self.specification.local_gravity_g,
                reference_temp_c: self.specification.reference_temp_c,
                session_bias_sigma_g: None,
                session_alignment_sigma_arcsec: None,
                session_gain_rel_sigma: None,
                unknown: Default::default(),
            },
            Acquisition {
                sample_rate_hz: self.specification.logger_rate_hz,
                divider: None,
                gain: None,
                sigma_dof: None,
                unknown: Default::default(),
            },
            Some(crate::campaign::Shaker {
                reference_rms_rel_sigma: self.specification.reference_rms_rel_sigma,
                reference_cross_sensitivity: None,
                reference_noise_g: None,
                reference_gain_rel_sigma: None,
                peak_rel_sigma: Some(self.specification.peak_rel_sigma),
                peak_gain_rel_sigma: None,
                unknown: Default::default(),
            }),
        )
    }

    /// The chain from motion to converter.
    pub fn chain(&self) -> Chain<'_> {
        Chain {
            coefficients: &self.accelerometer.coefficients,
            effects: &self.effects,
        }
    }

    /// What shakes the instrument in run `number` of the plan, hold-out runs counted on.
    pub fn motion(&self, number: usize, shake: &Shake, shaker: &mut Shaker) -> Motion {
        let mut stream = self.seed.stream("drive", number as u64);
        let drive = shaker.drive(shake, DURATION_S, &mut stream);
        Motion::new(shaker, shake, drive, &self.effects)
    }

    /// The specific force, g, that the instrument feels at dwell `order` of the plan.
    pub fn dwell_force_g(&self, order: usize) -> [f64; 3] {
        let dwell = &self.plan.dwells[order];
        let mut setting = self.head.setting(dwell, order as u64);
        for effect in &self.effects {
            setting.error_rad += effect.dial_error_rad(dwell);
            for (tilt, more) in setting.tilts_rad.iter_mut().zip(effect.base_tilt_rad()) {
                *tilt += more;
            }
        }
        let force = setting.specific_force(dwell);
        force.map(|a| a * self.specification.local_gravity_g)
    }

    /// What is constant at a moment: slow shift, scale and temperature.
    pub fn constant(&self, a0_g: [f64; 3], time_s: f64, exposures: &[Exposure]) -> Constant {
        let excess_k = self.room.temp_c(time_s) - self.specification.reference_temp_c;
        let moment = Moment {
            time_s,
            excess_k,
            exposures,
        };
        Constant {
            a0_g,
            shift_g: self
                .effects
                .iter()
                .map(|effect| effect.shift_g(&moment))
                .sum(),
            scale_error: self
                .effects
                .iter()
                .map(|effect| effect.scale_error(&moment))
                .sum(),
            excess_k,
        }
    }

    fn reading(&self, order: usize) -> Reading {
        let dwell = &self.plan.dwells[order];
        let time_s = (order + 1) as f64 * READING_INTERVAL_S;
        let constant = self.constant(self.dwell_force_g(order), time_s, &[]);
        let [i, p, o] = dial::nominal(dwell).map(|a| a * self.specification.local_gravity_g);
        let scale_v_per_g = self.accelerometer.coefficients.scale_factor_v_per_g;
        let mut stream = self.seed.stream("reading", order as u64);
        let noise = self.devices.deviate(&mut stream);
        let output_g = self
            .chain()
            .summary(&Motion::rest(&self.effects), &constant)
            .mean_g
            + self.specification.noise_g * noise;
        Reading {
            order: order as u64,
            time_s,
            series: dwell.series,
            dial_deg: dwell.dial_deg,
            mount_deg: dwell.mount_deg,
            approach: dwell.approach,
            specific_force_g: SpecificForce::new(i, p, o),
            temp_c: self.room.temp_c(time_s),
            output_v: recorded(scale_v_per_g * output_g, VOLTAGE_STEPS),
            sigma_v: scale_v_per_g.abs() * self.specification.noise_g,
            session: None,
            exclude: false,
            line: order as u64 + 2,
            unknown: Vec::new(),
        }
    }

    /// One run, as measured, and its vibration error without noise, g.
    fn run(
        &self,
        number: usize,
        shake: &Shake,
        time_s: f64,
        shaker: &mut Shaker,
        exposures: &mut Vec<Exposure>,
    ) -> (Run, f64) {
        let a0_g = shake.a0.map(|a| a * self.specification.local_gravity_g);
        let moved = self.devices.moved(number, shake, self.seed);
        let mut motion = self.motion(number, &moved, shaker);
        let reference = self.reference_moments(number, &motion);
        let session = self.devices.session(number);
        motion.direction = session.turned(motion.direction);
        exposures.push(exposure(&moved, &motion, time_s + BEFORE_TO_DURING_S));
        let levels = self.levels(number, a0_g, time_s, &motion, exposures);
        let run = Run {
            run: number as u64,
            time_s,
            kind: shake.kind,
            direction: shake.direction,
            level_g: shake.level_g,
            band_hz: [shake.f_lo_hz, shake.f_hi_hz],
            specific_force_g: SpecificForce::new(a0_g[0], a0_g[1], a0_g[2]),
            temp_c: self.room.temp_c(time_s),
            duration_s: DURATION_S,
            measured: Some(self.measured(number, &levels)),
            reference: Some(reference),
            session: session.name.map(str::to_owned),
            exclude: false,
            line: number as u64 + 2,
            unknown: Vec::new(),
        };
        (run, levels.during_g - levels.before_g)
    }

    /// What the output really comes to in run number `number` that begins at `time_s`.
    fn levels(
        &self,
        number: usize,
        a0_g: [f64; 3],
        time_s: f64,
        motion: &Motion,
        exposures: &[Exposure],
    ) -> Levels {
        let session = self.devices.session(number);
        let a0_g = session.turned(a0_g);
        // The room is taken to stand still within a run.
        let at = |moment_s: f64| {
            let mut constant = self.constant(a0_g, time_s, exposures);
            let moment = Moment {
                time_s: moment_s,
                excess_k: constant.excess_k,
                exposures,
            };
            let shifts = self.effects.iter().map(|effect| effect.shift_g(&moment));
            constant.shift_g = session.bias_g + shifts.sum::<f64>();
            constant
        };
        let plateau = |centre_s: f64| {
            let points = if self.effects.is_empty() { 1 } else { 64 };
            let step_s = DURATION_S / f64::from(points);
            let first_s = centre_s + 0.5 * (step_s - DURATION_S);
            let shift = |n| at(first_s + f64::from(n) * step_s).shift_g;
            let shift_g = (0..points).map(shift).sum::<f64>() / f64::from(points);
            Constant {
                shift_g,
                ..at(centre_s)
            }
        };
        let chain = self.chain();
        let rest = Motion::rest(&self.effects);
        let at_rest = |centre_s| chain.summary(&rest, &plateau(centre_s)).mean_g;
        let during_s = time_s + BEFORE_TO_DURING_S;
        let during = chain.summary(motion, &plateau(during_s));
        let (start, end) = (
            at(during_s - DURATION_S / 2.0),
            at(during_s + DURATION_S / 2.0),
        );
        Levels {
            before_g: at_rest(time_s),
            during_g: during.mean_g + self.plateau_error_g(number, motion),
            after_g: at_rest(time_s + BEFORE_TO_AFTER_S),
            minimum_g: during.minimum_g,
            maximum_g: during.maximum_g,
            drift_g_per_s: (end.shift_g - start.shift_g) / DURATION_S,
        }
    }

    /// What logger and peak detector make of the levels of run number `number`.
    fn measured(&self, number: usize, levels: &Levels) -> Measured {
        let specification = &self.specification;
        let mut noise = self.seed.stream("run", number as u64);
        let detector_v_per_g = self.accelerometer.coefficients.scale_factor_v_per_g;
        let scale_v_per_g = detector_v_per_g * (1.0 + self.devices.session(number).gain_error);
        let mut noisy = |scale_v_per_g: f64, value_g: f64, sigma_g: f64| {
            scale_v_per_g * (value_g + sigma_g * self.devices.deviate(&mut noise))
        };
        let mut plateau_v = |value_g| {
            recorded(
                noisy(scale_v_per_g, value_g, specification.noise_g),
                VOLTAGE_STEPS,
            )
        };
        let before_v = plateau_v(levels.before_g);
        let during_v = plateau_v(levels.during_g);
        let after_v = plateau_v(levels.after_g);
        let mut peak_v = |peak_g: f64| {
            let sigma_g = specification.peak_rel_sigma * (peak_g - levels.before_g).abs();
            let peak_v = noisy(detector_v_per_g, peak_g, sigma_g);
            recorded((1.0 + self.devices.peak_gain_error) * peak_v, VOLTAGE_STEPS)
        };
        let peaks_v = [peak_v(levels.minimum_g), peak_v(levels.maximum_g)];
        // An inverted output has its least voltage at the greatest output in g.
        let [minimum_v, maximum_v] = match detector_v_per_g < 0.0 {
            true => [peaks_v[1], peaks_v[0]],
            false => peaks_v,
        };
        let drift_sigma_g_per_s = specification.drift_noise_g_per_s;
        let drift_v_per_s = noisy(scale_v_per_g, levels.drift_g_per_s, drift_sigma_g_per_s);
        Measured {
            before_v,
            during_v,
            after_v: Some(after_v),
            sigma_v: detector_v_per_g.abs() * specification.noise_g,
            drift: Some(Drift {
                v_per_s: recorded(drift_v_per_s, DRIFT_STEPS),
                sigma_v_per_s: detector_v_per_g.abs() * drift_sigma_g_per_s,
            }),
            extremes: Some(Extremes {
                minimum_v,
                maximum_v,
            }),
        }
    }

    /// What the reference reports of run number `number`.
    fn reference_moments(&self, number: usize, motion: &Motion) -> ReferenceMoments {
        let mut stream = self.seed.stream("reference", number as u64);
        let device = &self.devices.reference;
        let stated = self.specification.reference_rms_rel_sigma;
        let rel_sigma = device.rms_rel_sigma.unwrap_or(stated);
        let seen = reference::look(motion, device, rel_sigma, &mut stream);
        let report = |values: [f64; 3]| values.map(|value| recorded(value, REFERENCE_STEPS));
        ReferenceMoments {
            rms_g: report(seen.rms_g),
            skewness: report(seen.skewness),
            kurtosis: report(seen.kurtosis),
            correlation: Some(seen.correlation),
        }
    }

    fn plateau_error_g(&self, number: usize, motion: &Motion) -> f64 {
        if self.effects.is_empty() {
            return 0.0;
        }
        let along_i = |w: &f64| motion.direction[0] * w;
        let vibration_i_g: Vec<_> = motion.instrument.samples.iter().map(along_i).collect();
        let plateau = Plateau {
            vibration_i_g: &vibration_i_g,
            fundamental_hz: motion.instrument.fundamental_hz,
            duration_s: DURATION_S,
            logger_rate_hz: self.specification.logger_rate_hz,
        };
        let mut stream = self.seed.stream("logger", number as u64);
        self.effects
            .iter()
            .map(|effect| effect.plateau_error_g(&plateau, &mut stream))
            .sum()
    }
}

/// The nearest of so many `steps` in 1; zero has no sign.
fn recorded(value: f64, steps: f64) -> f64 {
    (value * steps).round() / steps + 0.0
}

/// What a run does to the instrument.
fn exposure(shake: &Shake, motion: &Motion, centre_s: f64) -> Exposure {
    let axes: f64 = motion.direction.iter().map(|n| n * n).sum();
    let largest = motion
        .instrument
        .samples
        .iter()
        .fold(0.0_f64, |most, w| most.max(w.abs()));
    Exposure {
        start_s: centre_s - DURATION_S / 2.0,
        end_s: centre_s + DURATION_S / 2.0,
        power_g2: axes * motion.instrument.moment(2),
        peak_i_g: motion.direction[0].abs() * largest,
        drive_rms_g: match shake.kind {
            VibrationKind::Sine => shake.level_g * std::f64::consts::FRAC_1_SQRT_2,
            VibrationKind::Random => shake.level_g,
        },
    }
}

impl From<&dyn Effect> for EffectTruth {
    fn from(effect: &dyn Effect) -> Self {
        let named = |(name, value): (&str, f64)| (name.to_owned(), value.into());
        Self {
            id: effect.id(),
            parameters: effect.parameters().into_iter().map(named).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::effects;

    fn bench(seed: u64, effects: Vec<Box<dyn Effect>>) -> VirtualBench {
        let specification = Specification::with_dial_sigma(1.0);
        VirtualBench::new(Seed(seed), Static::Default, specification, effects)
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes() {
        let write = |seed| {
            let folder = tempfile::tempdir().unwrap();
            bench(seed, Vec::new())
                .simulate()
                .campaign
                .write(folder.path())
                .unwrap();
            ["campaign.toml", "static.csv", "vibration.csv"]
                .map(|file| std::fs::read(folder.path().join(file)).unwrap())
        };
        assert_eq!(write(11), write(11));
        assert_ne!(write(11)[1], write(12)[1]);
    }

    #[test]
    fn what_is_recorded_carries_no_last_bits_of_the_processor() {
        for (shake, run, _) in errors(&bench(4, Vec::new())) {
            let seen = run.reference.unwrap();
            if shake.kind == VibrationKind::Sine {
                assert_eq!(seen.skewness, [0.0; 3]);
                let kurtosis = shake.direction.map(|n| if n == 0.0 { 0.0 } else { 1.5 });
                assert_eq!(seen.kurtosis, kurtosis);
            }
            if let Some(before_v) = run.measured.map(|measured| measured.before_v) {
                let digits = format!("{before_v:.10}").parse();
                assert_eq!(digits, Ok(before_v));
            }
        }
    }

    #[test]
    fn a_campaign_is_read_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let campaign = bench(3, Vec::new()).simulate().campaign;
        campaign.write(folder.path()).unwrap();
        let read = Campaign::read(folder.path()).unwrap();
        assert_eq!((read.readings.len(), read.runs.len()), (80, 96));
    }

    /// A bench without noise whose instrument has one coefficient alone.
    fn pure(set: impl Fn(&mut shared::model::Coefficients<f64>)) -> VirtualBench {
        let mut bench = bench(1, Vec::new());
        bench.accelerometer.coefficients = Default::default();
        set(&mut bench.accelerometer.coefficients);
        bench
    }

    /// Each run of the plan, the held-out included, with its true vibration error.
    fn errors(bench: &VirtualBench) -> Vec<(Shake, Run, f64)> {
        let Simulation {
            campaign,
            holdout,
            truth,
        } = bench.simulate();
        let shakes = bench.plan.runs.iter().chain(&bench.plan.holdout).copied();
        let runs = campaign.runs.into_iter().chain(holdout);
        let errors = truth.vre_g.into_iter().chain(truth.holdout_vre_g);
        shakes
            .zip(runs)
            .zip(errors)
            .map(|((shake, run), error)| (shake, run, error))
            .collect()
    }

    #[test]
    fn second_order_rectifies_half_the_square_of_a_sine_and_the_square_of_an_rms() {
        let k2 = 4e-4;
        for (shake, _, error_g) in errors(&pure(|c| c.second_order_per_g = k2)) {
            let along_i = shake.direction[0] * shake.level_g;
            let expected = match shake.kind {
                VibrationKind::Sine => k2 * along_i * along_i / 2.0,
                VibrationKind::Random => k2 * along_i * along_i,
            };
            assert!(
                (error_g - expected).abs() < 1e-12,
                "{shake:?} {error_g} {expected}"
            );
        }
    }

    #[test]
    fn asymmetry_rectifies_two_over_pi_of_a_sine_about_zero_and_nothing_far_from_it() {
        let k1 = 6e-4;
        for (shake, _, error_g) in errors(&pure(|c| c.asymmetry = k1)) {
            let along_i = (shake.direction[0] * shake.level_g).abs();
            if shake.kind == VibrationKind::Sine && shake.a0[0] == 0.0 {
                let expected = k1 * 2.0 / std::f64::consts::PI * along_i;
                assert!((error_g - expected).abs() < 1e-6 * expected + 1e-12);
            } else if shake.kind == VibrationKind::Sine && along_i < shake.a0[0].abs() {
                assert!(error_g.abs() < 1e-12);
            }
        }
    }

    #[test]
    fn misalignment_rectifies_nothing_and_cross_coupling_the_product_of_the_axes() {
        for (_, _, error_g) in errors(&pure(|c| c.misalignment_oa_rad = 1e-3)) {
            assert!(error_g.abs() < 1e-12);
        }
        for (shake, _, error_g) in errors(&pure(|c| c.cross_ip_per_g = 1e-4)) {
            let square = shake.level_g * shake.level_g * shake.direction[0] * shake.direction[1];
            let mean = if shake.kind == VibrationKind::Sine {
                square / 2.0
            } else {
                square
            };
            assert!((error_g - 1e-4 * mean).abs() < 1e-12);
        }
    }

    #[test]
    fn the_reference_sees_a_sines_moments_and_a_random_records_own() {
        for (shake, run, _) in errors(&bench(5, Vec::new())) {
            let seen = run.reference.unwrap();
            for axis in 0..3 {
                let component = shake.direction[axis];
                if component == 0.0 {
                    assert_eq!((seen.rms_g[axis], seen.kurtosis[axis]), (0.0, 0.0));
                    continue;
                }
                match shake.kind {
                    VibrationKind::Sine => {
                        assert!(seen.skewness[axis].abs() < 1e-9);
                        assert!((seen.kurtosis[axis] - 1.5).abs() < 1e-9);
                    }
                    VibrationKind::Random => {
                        assert!(seen.skewness[axis] != 0.0 && seen.skewness[axis].abs() < 0.3);
                        assert!((seen.kurtosis[axis] - 3.0).abs() < 0.6);
                    }
                }
            }
        }
    }

    #[test]
    fn plateaus_drifts_and_reference_scatter_as_campaign_toml_states() {
        let (mut plateaus, mut drifts, mut scales, mut readings) = (vec![], vec![], vec![], vec![]);
        for seed in 0..6 {
            let bench = bench(seed, Vec::new());
            let Simulation {
                campaign, truth, ..
            } = bench.simulate();
            let scale_v_per_g = truth.coefficients[0];
            for (run, (shake, vre_g)) in campaign
                .runs
                .iter()
                .zip(bench.plan.runs.iter().zip(truth.vre_g))
            {
                let measured = run.measured.unwrap();
                let noise_v = measured.during_v - measured.before_v - scale_v_per_g * vre_g;
                plateaus.push(noise_v / (measured.sigma_v * 2.0_f64.sqrt()));
                let drift = measured.drift.unwrap();
                drifts.push(drift.v_per_s / drift.sigma_v_per_s);
                let rms_g = match shake.kind {
                    VibrationKind::Sine => shake.level_g / 2.0_f64.sqrt(),
                    VibrationKind::Random => shake.level_g,
                };
                let sigma = campaign
                    .config
                    .shaker
                    .as_ref()
                    .unwrap()
                    .reference_rms_rel_sigma;
                for (seen, n) in run.reference.unwrap().rms_g.iter().zip(shake.direction) {
                    if n != 0.0 {
                        scales.push((seen / (n * rms_g) - 1.0) / sigma);
                    }
                }
            }
            for (order, reading) in campaign.readings.iter().enumerate() {
                let [i, p, o] = bench.dwell_force_g(order);
                let force = SpecificForce::new(i, p, o);
                let noise_v = reading.output_v - bench.accelerometer.coefficients.output_v(force);
                readings.push(noise_v / reading.sigma_v);
            }
        }
        for normalised in [plateaus, drifts, scales, readings] {
            let count = normalised.len() as f64;
            let mean_square = normalised.iter().map(|z| z * z).sum::<f64>() / count;
            // Chi-square per degree of freedom, within four of its standard deviations.
            assert!(
                (mean_square - 1.0).abs() < 4.0 * (2.0 / count).sqrt(),
                "{mean_square} {count}"
            );
        }
    }

    #[test]
    fn an_effect_changes_its_own_part_of_the_campaign_alone() {
        let nominal = bench(2, Vec::new()).simulate();
        let draw = |id: &str| {
            let mut stream = Seed(2).stream("effect", 0);
            let effect = (effects::find(id).unwrap().draw)(1.0, &mut stream);
            bench(2, vec![effect]).simulate()
        };
        let dial = draw("dial-index-error");
        assert_ne!(dial.campaign.readings, nominal.campaign.readings);
        assert_eq!(dial.campaign.runs, nominal.campaign.runs);
        let fixture = draw("fixture-resonance");
        assert_eq!(fixture.campaign.readings, nominal.campaign.readings);
        for (with, without) in fixture.campaign.runs.iter().zip(&nominal.campaign.runs) {
            assert_eq!(with.reference, without.reference);
        }
        assert_ne!(fixture.truth.holdout_vre_g, nominal.truth.holdout_vre_g);
    }
}
