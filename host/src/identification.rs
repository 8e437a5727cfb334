//! Coefficients of one instrument from its campaign, `vre-identification/1`.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use shared::compensate::Calibration;
use shared::identify::closed_form;
use shared::identify::static_test::{Bench, Fit, Reading, StaticTest, workspace_len};
use shared::model::{Coefficients, NOMINAL};
use shared::rectification::Covariance;
use shared::tumble::{PAPER_ANGLES_DEG, Position, Series, within_a_turn};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::campaign::{self, Campaign};
use crate::error::Error;
use crate::quantity::Quantity;

/// Names of the coefficients with their units, in the order of [`Coefficients::to_nominal`].
pub const NAMES: [&str; NOMINAL] = [
    "K1_v_per_g",
    "k0_g",
    "k1_prime",
    "k2_per_g",
    "k3_per_g2",
    "k4_per_g3",
    "d_oa_rad",
    "d_pa_rad",
    "k_ip_per_g",
    "k_io_per_g",
    "k_po_per_g",
];

/// What each coefficient is, for people, in the order of [`NAMES`].
pub const MEANINGS: [&str; NOMINAL] = [
    "scale factor",
    "bias",
    "scale-factor asymmetry",
    "second-order nonlinearity",
    "third-order nonlinearity",
    "fourth-order nonlinearity",
    "misalignment of OA",
    "misalignment of PA",
    "cross-coupling IA-PA",
    "cross-coupling IA-OA",
    "cross-coupling PA-OA",
];

/// How the coefficients are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Weighted least squares on all readings, dial, mount and level as random effects
    LeastSquares,
    /// The paper's formulas (10)-(17) on the paper's 24 positions
    ClosedForm,
}

/// The coefficients of an instrument with all that is known of their uncertainty.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// Always `vre-identification/1`.
    pub format: &'static str,
    /// Serial number of the instrument.
    pub serial: String,
    /// How they were found.
    pub method: Method,
    /// Each coefficient under its name in [`NAMES`]; null where the plan does not determine it.
    #[serde(serialize_with = "by_name")]
    pub coefficients: [Quantity; NOMINAL],
    /// Covariance in the order of [`NAMES`]; zero along blind directions.
    pub covariance: [[f64; NOMINAL]; NOMINAL],
    /// Rank of the plan's design matrix.
    pub rank: usize,
    /// Its condition number; beyond 1e12 for a plan of deficient rank.
    pub condition: f64,
    /// Unit directions in coefficient space that no reading sees, the components that are not zero.
    pub blind_directions: Vec<BTreeMap<&'static str, f64>>,
    /// Sum of squared whitened residuals; absent with the closed formulas, which have none.
    pub chi2: Option<f64>,
    /// Degrees of freedom of chi2.
    pub dof: usize,
    /// Probability of a chi2 at least as large if the stated uncertainties hold.
    pub chi2_p_value: Option<f64>,
    /// Standard deviation about zero stated beforehand for every coefficient but K1, if one was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior_sigma: Option<f64>,
    /// Output of each reading less that of the coefficients at the nominal angle, g.
    pub residuals_g: Vec<f64>,
    /// The coefficients as a model: of those that the plan does not determine the combination of least norm.
    #[serde(skip)]
    pub model: Coefficients<f64>,
}

fn by_name<S: serde::Serializer>(
    quantities: &[Quantity; NOMINAL],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(NAMES.iter().zip(quantities))
}

/// Identifies the coefficients from the static readings of a campaign.
///
/// `prior_sigma`: a standard deviation about zero, stated beforehand, for every coefficient but K1 (in its own unit);
/// least squares only.
///
/// # Errors
/// Fewer readings than coefficients; for the closed formulas a position of the paper's plan without a reading.
pub fn identify(
    campaign: &Campaign,
    method: Method,
    prior_sigma: Option<f64>,
) -> Result<Identification, Error> {
    match method {
        Method::LeastSquares => {
            let fit = fit(campaign, prior_sigma)?;
            Ok(Identification::new(campaign, method, &fit, prior_sigma))
        }
        Method::ClosedForm if prior_sigma.is_some() => Err(Error::Usage(
            "the closed formulas take no prior; use the method least-squares".into(),
        )),
        Method::ClosedForm => closed_form_identification(campaign),
    }
}

impl Identification {
    /// The statement of a fit of this campaign's readings.
    fn new(campaign: &Campaign, method: Method, fit: &Fit<f64>, prior_sigma: Option<f64>) -> Self {
        let values = fit.coefficients.to_nominal();
        let coefficients = std::array::from_fn(|k| {
            if prior_sigma.is_some() || fit.visibility.determines(k) {
                Quantity::new(values[k], fit.covariance[k][k].max(0.0).sqrt())
            } else {
                Quantity::UNDETERMINED
            }
        });
        let blind_directions = fit.visibility.blind_directions().iter().map(|direction| {
            NAMES
                .into_iter()
                .zip(*direction)
                .filter(|(_, c)| c.abs() > 1e-6)
                .collect()
        });
        Self {
            format: "vre-identification/1",
            serial: campaign.config.instrument.serial.clone(),
            method,
            coefficients,
            covariance: fit.covariance,
            rank: fit.visibility.rank,
            // JSON has no infinity.
            condition: fit.visibility.condition.min(f64::MAX),
            blind_directions: blind_directions.collect(),
            chi2: Some(fit.chi2),
            dof: fit.degrees_of_freedom(),
            chi2_p_value: p_value(fit),
            prior_sigma,
            residuals_g: residuals_g(campaign, &fit.coefficients),
            model: fit.coefficients,
        }
    }

    /// For the instrument.
    pub fn calibration(&self) -> Calibration<f64> {
        Calibration {
            coefficients: self.model,
            covariance: Covariance::from_nominal(&self.covariance),
            rank: self.rank as u8,
        }
    }
}

/// Fits the nominal model to the static readings in two passes: about the type's nominal scale factor, then about what the
/// first pass found.
///
/// # Errors
/// Fewer readings than coefficients of the model.
pub fn fit(campaign: &Campaign, prior_sigma: Option<f64>) -> Result<Fit<f64>, Error> {
    let readings = &campaign.readings;
    if readings.len() < NOMINAL {
        return Err(Error::Usage(format!(
            "static.csv has {} readings, the model {NOMINAL} coefficients",
            readings.len()
        )));
    }
    let bench = bench(&campaign.config.bench);
    let marks: BTreeSet<u64> = readings
        .iter()
        .map(|r| within_a_turn(r.dial_deg).to_bits())
        .collect();
    let mounts: BTreeSet<(Series, u64)> = readings
        .iter()
        .map(|r| (r.series, r.mount_deg.to_bits()))
        .collect();
    let mut workspace = vec![0.0; workspace_len(marks.len(), mounts.len())];
    let prior_sigma = prior_sigma.map(|sigma| [sigma; NOMINAL]);
    let mut about = Coefficients {
        scale_factor_v_per_g: campaign.config.instrument.scale_factor_nominal_v_per_g,
        ..Coefficients::default()
    };
    let mut pass = |about, found: &[_]| {
        let mut test = StaticTest::new(bench, about, marks.len(), mounts.len(), &mut workspace)?;
        for mount in found {
            test.linearise_mount(mount)?;
        }
        for r in readings {
            test.absorb(&Reading {
                position: position(r),
                output_v: r.output_v,
                sigma_v: r.sigma_v,
            })?;
        }
        let fit = test
            .solve(prior_sigma.as_ref())
            .map_err(shared::identify::static_test::StaticTestError::Workspace)?;
        let found: Vec<_> = test.mount_estimates(&fit.coefficients).collect();
        Ok((fit, found))
    };
    let mut both_passes = || {
        let (first, found) = pass(about, &[])?;
        about = first.coefficients;
        pass(about, &found).map(|(second, _)| second)
    };
    both_passes().map_err(|error: shared::identify::static_test::StaticTestError| {
        Error::Usage(format!(
            "static.csv does not determine the coefficients: {error}"
        ))
    })
}

/// Probability of a chi-square at least as large as that of a fit, if the stated uncertainties hold; none without degrees
/// of freedom.
pub fn p_value(fit: &Fit<f64>) -> Option<f64> {
    let distribution = ChiSquared::new(fit.degrees_of_freedom() as f64).ok()?;
    Some(distribution.sf(fit.chi2))
}

/// A chi-square less likely than this, on either side, is told.
pub const SUSPICIOUS: f64 = 1e-3;

/// What an improbable chi-square of static readings means, if it is improbable.
pub fn scatter_warning(p_value: Option<f64>) -> Option<&'static str> {
    match p_value? {
        p if p < SUSPICIOUS => Some(
            "WARNING: the static readings scatter more than the uncertainties stated in campaign.toml allow; those of the \
             coefficients, and of what they predict, are too small.",
        ),
        p if p > 1.0 - SUSPICIOUS => Some(
            "WARNING: the static readings scatter less than stated in campaign.toml; the uncertainties are too large.",
        ),
        _ => None,
    }
}

/// The bench of the campaign in radians.
pub fn bench(bench: &campaign::Bench) -> Bench<f64> {
    let arcsec = |angle: f64| (angle / 3600.0).to_radians();
    Bench {
        dial_sigma_rad: arcsec(bench.dial_sigma_arcsec),
        dial_repeat_sigma_rad: arcsec(bench.dial_repeat_sigma_arcsec),
        mount_sigma_rad: arcsec(bench.mount_sigma_arcsec),
        level_sigma_rad: arcsec(bench.level_sigma_arcsec),
        local_gravity_g: bench.local_gravity_g,
    }
}

/// Where on the dividing head a reading was taken.
pub fn position(reading: &campaign::Reading) -> Position {
    Position {
        series: reading.series,
        dial_deg: reading.dial_deg,
        mount_deg: reading.mount_deg,
    }
}

fn residuals_g(campaign: &Campaign, model: &Coefficients<f64>) -> Vec<f64> {
    let gravity_g = campaign.config.bench.local_gravity_g;
    let residual = |reading: &campaign::Reading| {
        let mut a = position(reading).specific_force();
        (a.i, a.p, a.o) = (gravity_g * a.i, gravity_g * a.p, gravity_g * a.o);
        reading.output_v / model.scale_factor_v_per_g - model.output_g(a)
    };
    campaign.readings.iter().map(residual).collect()
}

/// The closed formulas on the mean of the readings at each of the paper's positions, their uncertainty from that
/// of the voltages, random effects included, through the numerical derivative of the formulas.
fn closed_form_identification(campaign: &Campaign) -> Result<Identification, Error> {
    let gravity_g = campaign.config.bench.local_gravity_g;
    let mut at: Vec<Vec<&campaign::Reading>> = vec![Vec::new(); 24];
    for reading in campaign
        .readings
        .iter()
        .filter(|r| within_a_turn(r.mount_deg) == 0.0)
    {
        let dial_deg = within_a_turn(reading.dial_deg);
        if let Some(j) = PAPER_ANGLES_DEG.iter().position(|angle| *angle == dial_deg) {
            at[8 * (usize::from(u8::from(reading.series)) - 1) + j].push(reading);
        }
    }
    if let Some(missing) = at.iter().position(Vec::is_empty) {
        return Err(Error::Usage(format!(
            "static.csv has no reading at series {}, dial {} deg, mount 0, which the closed formulas need",
            missing / 8 + 1,
            PAPER_ANGLES_DEG[missing % 8]
        )));
    }
    let mean: [f64; 24] =
        std::array::from_fn(|k| at[k].iter().map(|r| r.output_v).sum::<f64>() / at[k].len() as f64);
    let voltage_covariance = voltage_covariance(campaign, &at);

    let coefficients = |u: &[f64; 24]| {
        let series: [[f64; 8]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| u[8 * i + j]));
        closed_form::identify(&series).coefficients
    };
    let found = coefficients(&mean);
    let k1 = found.scale_factor_v_per_g;
    let step = 1e-4 * k1;
    let derivative: Vec<[f64; NOMINAL]> = (0..24)
        .map(|k| {
            let moved = |by: f64| {
                let mut u = mean;
                u[k] += by;
                coefficients(&u).to_nominal()
            };
            let (up, down) = (moved(step), moved(-step));
            std::array::from_fn(|c| (up[c] - down[c]) / (2.0 * step))
        })
        .collect();
    let covariance = std::array::from_fn(|a| {
        std::array::from_fn(|b| {
            let row = |j: usize| {
                (0..24)
                    .map(|k| voltage_covariance[j][k] * derivative[k][b])
                    .sum::<f64>()
            };
            (0..24).map(|j| derivative[j][a] * row(j)).sum()
        })
    });
    let mut design = shared::identify::blindness::Design::default();
    shared::tumble::paper_plan().for_each(|p| design.absorb(p.specific_force()));
    // The formulas take local gravity as the unit; powers of it turn their coefficients into those of g.
    let power: [i32; NOMINAL] = [-1, 1, 0, -1, -2, -3, 0, 0, -1, -1, -1];
    let factor = power.map(|p| gravity_g.powi(p));
    let mut values = found.to_nominal();
    let mut covariance: [[f64; NOMINAL]; NOMINAL] = covariance;
    for a in 0..NOMINAL {
        values[a] *= factor[a];
        for b in 0..NOMINAL {
            covariance[a][b] *= factor[a] * factor[b];
        }
    }
    let fit = Fit {
        coefficients: Coefficients::from_nominal(values),
        covariance,
        visibility: design.visibility(),
        chi2: 0.0,
        readings: NOMINAL - 1,
    };
    let mut identification = Identification::new(campaign, Method::ClosedForm, &fit, None);
    (identification.chi2, identification.chi2_p_value) = (None, None);
    Ok(identification)
}

/// Covariance of the 24 mean voltages: noise and repeatability of each, marks and tilts in common, V^2. These readings
/// are not remounted: the misalignments count from the mount as it is.
fn voltage_covariance(campaign: &Campaign, at: &[Vec<&campaign::Reading>]) -> Vec<[f64; 24]> {
    let bench = bench(&campaign.config.bench);
    let k1 = campaign.config.instrument.scale_factor_nominal_v_per_g * bench.local_gravity_g;
    let place = |k: usize| position(at[k][0]);
    let by_angle: Vec<f64> = (0..24)
        .map(|k| k1 * place(k).series.tangent(place(k).phi_rad()).i)
        .collect();
    let by_lift: Vec<f64> = (0..24)
        .map(|k| k1 * place(k).series.lift::<f64>().i)
        .collect();
    let square = |x: f64| x * x;
    (0..24)
        .map(|j| {
            std::array::from_fn(|k| {
                let mut shared_angle = square(bench.level_sigma_rad);
                if j % 8 == k % 8 {
                    shared_angle += square(bench.dial_sigma_rad);
                }
                let mut sum = by_angle[j] * by_angle[k] * shared_angle
                    + by_lift[j] * by_lift[k] * square(bench.level_sigma_rad);
                if j == k {
                    let n = at[k].len() as f64;
                    let noise: f64 = at[k].iter().map(|r| square(r.sigma_v)).sum::<f64>() / n;
                    sum += (noise + square(bench.dial_repeat_sigma_rad * by_angle[k])) / n;
                }
                sum
            })
        })
        .collect()
}
