//! The paper's formulas (10)-(17) on the readings of its own 24 positions.

use nalgebra::{DMatrix, DVector};
use shared::identify::blindness::Design;
use shared::identify::closed_form;
use shared::identify::static_test::Fit;
use shared::model::{Coefficients, NOMINAL};
use shared::tumble::{PAPER_ANGLES_DEG, paper_plan, within_a_turn};

use super::covariance::covariance;
use super::readings::bench;
use crate::campaign::{Campaign, Reading};
use crate::error::Error;

/// Positions of the paper's plan.
const POSITIONS: usize = 24;

/// A voltage for each of them, series by series.
type Voltages = [f64; POSITIONS];

/// The closed formulas on the mean of the readings at each of the paper's positions, their uncertainty from that
/// of the voltages, random effects included, through the numerical derivative of the formulas.
pub fn fit(campaign: &Campaign) -> Result<Fit<f64>, Error> {
    let gravity_g = campaign.config.bench.local_gravity_g;
    let mut at: Vec<Vec<&Reading>> = vec![Vec::new(); POSITIONS];
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
    let readings: Vec<Reading> = at.iter().flatten().map(|r| (*r).clone()).collect();
    let mut averaging = DMatrix::zeros(POSITIONS, readings.len());
    let mut first = 0;
    for (k, of_position) in at.iter().enumerate() {
        let weight = 1.0 / of_position.len() as f64;
        averaging
            .view_mut((k, first), (1, of_position.len()))
            .fill(weight);
        first += of_position.len();
    }
    let outputs_v = DVector::from_iterator(readings.len(), readings.iter().map(|r| r.output_v));
    let mean_v: Voltages = std::array::from_fn(|k| (averaging.row(k) * &outputs_v)[0]);
    let found = coefficients(&mean_v);
    let derivative = derivative(&mean_v, found.scale_factor_v_per_g) * averaging;
    let covariance = &derivative * covariance_v2(campaign, &readings) * derivative.transpose();

    let mut design = Design::default();
    paper_plan().for_each(|p| design.absorb(p.specific_force()));
    // The formulas take local gravity as the unit; powers of it turn their coefficients into those of g.
    let power: [i32; NOMINAL] = [-1, 1, 0, -1, -2, -3, 0, 0, -1, -1, -1];
    let factor = power.map(|p| gravity_g.powi(p));
    let mut values = found.to_nominal();
    let covariance: [[f64; NOMINAL]; NOMINAL] = std::array::from_fn(|a| {
        std::array::from_fn(|b| covariance[(a, b)] * factor[a] * factor[b])
    });
    for (value, factor) in values.iter_mut().zip(factor) {
        *value *= factor;
    }
    Ok(Fit {
        coefficients: Coefficients::from_nominal(values),
        covariance,
        visibility: design.visibility(),
        chi2: 0.0,
        readings: NOMINAL - 1,
    })
}

/// The formulas on 24 voltages.
fn coefficients(u_v: &Voltages) -> Coefficients<f64> {
    let series: [[f64; 8]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| u_v[8 * i + j]));
    closed_form::identify(&series).coefficients
}

/// Derivatives of the eleven coefficients (rows) by the 24 voltages (columns), numerically: the formulas are nearly linear.
fn derivative(u_v: &Voltages, scale_v_per_g: f64) -> DMatrix<f64> {
    let step = 1e-4 * scale_v_per_g;
    let mut matrix = DMatrix::zeros(NOMINAL, POSITIONS);
    for k in 0..POSITIONS {
        let [up, down] = [step, -step].map(|by| {
            let mut moved = *u_v;
            moved[k] += by;
            coefficients(&moved).to_nominal()
        });
        for c in 0..NOMINAL {
            matrix[(c, k)] = (up[c] - down[c]) / (2.0 * step);
        }
    }
    matrix
}

/// Covariance of the readings' outputs, V^2.
fn covariance_v2(campaign: &Campaign, readings: &[Reading]) -> DMatrix<f64> {
    let scale = campaign.config.instrument.scale_factor_nominal_v_per_g;
    let known = campaign.config.mark_errors.as_deref();
    let triangle = covariance(readings, &bench(&campaign.config.bench), known, scale);
    DMatrix::from_fn(readings.len(), readings.len(), |i, j| {
        let (i, j) = (i.max(j), i.min(j));
        scale * scale * triangle[i * (i + 1) / 2 + j]
    })
}
