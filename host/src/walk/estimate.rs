//! What the readings so far make of the instrument: what the next one should be, and the vibration error that they predict.

use shared::identify::static_test::{self, Fit, StaticTest};
use shared::model::{Coefficients, NOMINAL};
use shared::rectification::Sensitivity;
use shared::tumble::Position;

use super::expectation::Expectation;
use crate::bench::plan::Dwell;
use crate::campaign::{Bench, CampaignConfig, Reading};
use crate::quantity::Quantity;
use crate::statics::least_squares::Workspace;
use crate::statics::{self, DEFAULT_PRIOR_SIGMA, Environment};

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
    expectation: Expectation,
    /// With the prior of a prediction, for what the readings predict.
    fit: Option<Fit<f64>>,
}

impl Estimate {
    /// By these readings; without any, by the type.
    pub fn new(config: &CampaignConfig, readings: &[Reading]) -> Self {
        Self {
            expectation: Expectation::new(config, readings),
            fit: fitted(config, readings),
        }
    }

    /// Scale factor, V/g.
    pub fn scale_factor_v_per_g(&self) -> f64 {
        self.expectation.scale_factor_v_per_g()
    }

    /// What a reading at a position should be and its standard uncertainty, V, apart from its noise.
    pub fn expected_v(&self, dwell: &Dwell) -> (f64, f64) {
        self.expectation.of(&position(dwell), 0.0)
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
            let (expected_v, sigma_v) = self.expectation.of(&position(dwell), reading.sigma_v);
            let residual_v = reading.output_v - expected_v;
            (residual_v / k1, residual_v / sigma_v)
        };
        let (residual_g, sigmas) = off(&dwell);
        let sound = sigmas.abs() <= RED;
        let reason = match sound {
            true => {
                // No sign of a zero.
                let rounded = (10.0 * sigmas).round() / 10.0 + 0.0;
                format!("fits the readings before it: {rounded:+.1} standard uncertainties")
            }
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

/// The nominal model fitted to the readings, in two passes; none while they do not tell the scale factor.
fn fitted(config: &CampaignConfig, readings: &[Reading]) -> Option<Fit<f64>> {
    let mut workspace = Workspace::of(readings.iter().map(statics::position));
    let mut about = Coefficients {
        scale_factor_v_per_g: config.instrument.scale_factor_nominal_v_per_g,
        ..Coefficients::default()
    };
    let (mut mounts, mut fit) = (Vec::new(), None);
    for _ in 0..2 {
        let mut test = absorbed(&mut workspace, &config.bench, about, &mounts, readings)?;
        let found = test.solve(Some(&[DEFAULT_PRIOR_SIGMA; NOMINAL])).ok()?;
        about = found.coefficients;
        mounts = test.mount_estimates(&about).collect();
        fit = Some(found);
    }
    fit
}

/// The static test of these readings, if all of them can be fitted.
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
    Some(test)
}

fn position(dwell: &Dwell) -> Position {
    Position {
        series: dwell.series,
        dial_deg: dwell.dial_deg,
        mount_deg: dwell.mount_deg,
    }
}
