//! What the readings so far make of the instrument: what the next one should be, and the vibration error that they predict.

use shared::identify::static_test::{self, Fit, StaticTest};
use shared::model::{Coefficients, NOMINAL, SpecificForce, terms};
use shared::rectification::Sensitivity;
use shared::tumble::{ARCSEC_RAD, Position};

use crate::bench::plan::Dwell;
use crate::campaign::{Bench, CampaignConfig, Reading};
use crate::quantity::Quantity;
use crate::statics::least_squares::Workspace;
use crate::statics::{self, DEFAULT_PRIOR_SIGMA, Environment};

/// Standard deviation about zero of every coefficient but K1 for what a reading should be: ten times that of a prediction, so
/// that a badly mounted instrument (some milliradians) is no alarm.
const WIDE_PRIOR_SIGMA: f64 = 10.0 * DEFAULT_PRIOR_SIGMA;
/// Relative standard deviation of a type's scale factor, for the first reading: "some per cent".
const TYPE_REL_SIGMA: f64 = 0.03;

/// A reading so many standard uncertainties off what was expected is red. Chosen: a sound one is in 16 000 cases of Gaussian
/// deviations; an angle wrong by 0.1 deg is some 30.
pub const RED: f64 = 4.0;

/// Whether a reading fits what the readings before it let expect.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// Reading less expectation, g.
    pub residual_g: f64,
    /// The same in its standard uncertainties.
    pub sigmas: f64,
    /// Whether it fits.
    pub sound: bool,
    /// Why, in a sentence.
    pub reason: String,
}

/// The instrument by the readings so far.
#[derive(Clone, Debug)]
pub struct Estimate {
    bench: Bench,
    nominal_v_per_g: f64,
    /// With the wide prior, for what a reading should be.
    wide: Option<Fit<f64>>,
    /// With that of a prediction, where it is needed.
    fit: Option<Fit<f64>>,
    /// Pairs of series and mount that were seen.
    mounts: Vec<(u8, u64)>,
}

impl Estimate {
    /// By these readings; without any, by the type.
    pub fn new(config: &CampaignConfig, readings: &[Reading]) -> Self {
        let mut estimate = Self {
            bench: config.bench.clone(),
            nominal_v_per_g: config.instrument.scale_factor_nominal_v_per_g,
            wide: None,
            fit: None,
            mounts: readings
                .iter()
                .map(|r| mount(r.series, r.mount_deg))
                .collect(),
        };
        let mut workspace = Workspace::of(readings.iter().map(statics::position));
        let mut about = Coefficients {
            scale_factor_v_per_g: estimate.nominal_v_per_g,
            ..Coefficients::default()
        };
        let mut mounts = Vec::new();
        // The second pass is about what the first found.
        for _ in 0..2 {
            let Some(mut test) =
                absorbed(&mut workspace, &estimate.bench, about, &mounts, readings)
            else {
                return estimate;
            };
            let solve = |sigma: f64| test.solve(Some(&[sigma; NOMINAL])).ok();
            estimate.wide = solve(WIDE_PRIOR_SIGMA);
            estimate.fit = solve(DEFAULT_PRIOR_SIGMA);
            if let Some(wide) = &estimate.wide {
                about = wide.coefficients;
                mounts = test.mount_estimates(&about).collect();
            }
        }
        estimate
    }

    /// Scale factor, V/g.
    pub fn scale_factor_v_per_g(&self) -> f64 {
        let fitted = self.wide.as_ref();
        fitted.map_or(self.nominal_v_per_g, |fit| {
            fit.coefficients.scale_factor_v_per_g
        })
    }

    /// What a reading at a position should be and its standard uncertainty, V, before noise.
    pub fn expected_v(&self, dwell: &Dwell) -> (f64, f64) {
        let g = self.bench.local_gravity_g;
        let position = Position {
            series: dwell.series,
            dial_deg: dwell.dial_deg,
            mount_deg: dwell.mount_deg,
        };
        let a = scaled(position.specific_force(), g);
        let tangent = scaled(dwell.series.tangent(position.phi_rad()), g);
        let lift = scaled(dwell.series.lift(), g);
        let (value_v, of_fit_v, model) = match &self.wide {
            Some(fit) => {
                let value_v = fit.coefficients.output_v(a);
                (value_v, fit_sigma_v(fit, a), fit.coefficients)
            }
            None => {
                let about_type = TYPE_REL_SIGMA * a.i;
                let others = WIDE_PRIOR_SIGMA * (NOMINAL as f64 - 1.0).sqrt();
                let sigma_v = self.nominal_v_per_g.abs() * about_type.hypot(others);
                let model = Coefficients {
                    scale_factor_v_per_g: self.nominal_v_per_g,
                    ..Coefficients::default()
                };
                (model.output_v(a), sigma_v, model)
            }
        };
        let slope = model.gradient(a);
        let k1 = model.scale_factor_v_per_g;
        let known_mount = self.mounts.contains(&mount(dwell.series, dwell.mount_deg));
        let mount_arcsec = if known_mount {
            0.0
        } else {
            self.bench.mount_sigma_arcsec
        };
        let angle_arcsec = [
            self.bench.dial_sigma_arcsec,
            self.bench.dial_repeat_sigma_arcsec,
            self.bench.level_sigma_arcsec,
            mount_arcsec,
        ];
        let angle_arcsec = angle_arcsec.into_iter().fold(0.0, f64::hypot);
        let by_angle = k1 * inner(slope, tangent) * ARCSEC_RAD * angle_arcsec;
        let by_lift = k1 * inner(slope, lift) * ARCSEC_RAD * self.bench.level_sigma_arcsec;
        (value_v, of_fit_v.hypot(by_angle).hypot(by_lift))
    }

    /// Judges a reading that did not go into this estimate. `before` is where the dial stood for the reading before it.
    pub fn judge(&self, reading: &Reading, before: Option<&Dwell>) -> Judgement {
        let dwell = Dwell {
            series: reading.series,
            dial_deg: reading.dial_deg,
            mount_deg: reading.mount_deg,
            approach: reading.approach,
        };
        let k1 = self.scale_factor_v_per_g();
        let off = |dwell: &Dwell| {
            let (expected_v, sigma_v) = self.expected_v(dwell);
            let residual_v = reading.output_v - expected_v;
            (residual_v / k1, residual_v / sigma_v.hypot(reading.sigma_v))
        };
        let (residual_g, sigmas) = off(&dwell);
        let sound = sigmas.abs() <= RED;
        let reason = match sound {
            true => format!("fits the readings before it: {sigmas:+.1} standard uncertainties"),
            false => self.reason(reading, &dwell, before, sigmas, &off),
        };
        Judgement {
            residual_g,
            sigmas,
            sound,
            reason,
        }
    }

    fn reason(
        &self,
        reading: &Reading,
        dwell: &Dwell,
        before: Option<&Dwell>,
        sigmas: f64,
        off: &dyn Fn(&Dwell) -> (f64, f64),
    ) -> String {
        let fits = |other: &Dwell| off(other).1.abs() <= RED;
        let not_turned = before.filter(|b| *b != dwell && fits(b));
        if not_turned.is_some() {
            return format!(
                "{sigmas:+.0} standard uncertainties off: the output is that of the position before; was the dial turned?"
            );
        }
        // Marks in steps of 15 deg, then of 1 deg.
        let marks = (1..24)
            .map(|k| 15.0 * f64::from(k))
            .chain((1..360).map(f64::from));
        let mut others = marks.map(|turn| Dwell {
            dial_deg: (dwell.dial_deg + turn) % 360.0,
            ..*dwell
        });
        match others.find(|other| fits(other)) {
            Some(other) => format!(
                "{sigmas:+.0} standard uncertainties off: at {} deg it would fit; does the dial stand at {} deg?",
                other.dial_deg, reading.dial_deg
            ),
            None => {
                format!("{sigmas:+.0} standard uncertainties off: no mark of the dial explains it")
            }
        }
    }

    /// The coefficients so far, in the order of [`statics::NAMES`]; undetermined where only what is assumed beforehand tells
    /// them.
    pub fn coefficients(&self) -> [Quantity; NOMINAL] {
        let Some(fit) = &self.fit else {
            return [Quantity::UNDETERMINED; NOMINAL];
        };
        let values = fit.coefficients.to_nominal();
        std::array::from_fn(|k| {
            let sigma = fit.covariance[k][k].max(0.0).sqrt();
            // Sharper than what was assumed: the readings tell it.
            match k == 0 || sigma < 0.5 * DEFAULT_PRIOR_SIGMA {
                true => Quantity::new(values[k], sigma),
                false => Quantity::UNDETERMINED,
            }
        })
    }

    /// The vibration error in an environment with its standard uncertainty, g: what no reading tells rests on every
    /// coefficient being 0 +- [`DEFAULT_PRIOR_SIGMA`].
    pub fn vre_g(&self, environment: &Environment) -> Option<(f64, f64)> {
        let fit = self.fit.as_ref()?;
        let sensitivity = Sensitivity::new(environment.a0_i_g, environment.moments);
        let variance_g2 = sensitivity.variance_g2(&fit.covariance);
        let value_g = sensitivity.vre_g(&fit.coefficients);
        Some((value_g, variance_g2.max(0.0).sqrt()))
    }
}

/// The static test of these readings, if the first of them can be fitted at all.
fn absorbed<'w>(
    workspace: &'w mut Workspace,
    bench: &Bench,
    about: Coefficients<f64>,
    mounts: &[static_test::MountEstimate<f64>],
    readings: &[Reading],
) -> Option<StaticTest<'w, f64>> {
    let mut test = workspace.test(statics::bench(bench), about).ok()?;
    for mount in mounts {
        test.linearise_mount(mount).ok()?;
    }
    for reading in readings {
        let absorbed = test.absorb(&static_test::Reading {
            position: statics::position(reading),
            output_v: reading.output_v,
            sigma_v: reading.sigma_v,
        });
        absorbed.ok()?;
    }
    (!readings.is_empty()).then_some(test)
}

/// Standard uncertainty of the output that a fit expects, V.
fn fit_sigma_v(fit: &Fit<f64>, a: SpecificForce<f64>) -> f64 {
    let k1 = fit.coefficients.scale_factor_v_per_g;
    let mut row = terms(a).map(|term| k1 * term);
    // U = K1 times the bracket: dU/dK1 is the bracket itself.
    row[0] = fit.coefficients.output_g(a);
    let mut variance = 0.0;
    for (j, by_j) in row.iter().enumerate() {
        for (k, by_k) in row.iter().enumerate() {
            variance += by_j * fit.covariance[j][k] * by_k;
        }
    }
    variance.max(0.0).sqrt()
}

fn mount(series: crate::campaign::Series, mount_deg: f64) -> (u8, u64) {
    (u8::from(series), mount_deg.to_bits())
}

fn scaled(a: SpecificForce<f64>, factor: f64) -> SpecificForce<f64> {
    SpecificForce::new(factor * a.i, factor * a.p, factor * a.o)
}

fn inner(x: SpecificForce<f64>, y: SpecificForce<f64>) -> f64 {
    x.i * y.i + x.p * y.p + x.o * y.o
}
