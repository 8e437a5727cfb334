//! The paper's formulas (10)-(17) on the readings of its own 24 positions.

use shared::identify::closed_form;
use shared::identify::static_test::Fit;
use shared::model::{Coefficients, NOMINAL};
use shared::tumble::{PAPER_ANGLES_DEG, within_a_turn};

use super::readings::{bench, position};
use crate::campaign::{self, Campaign};
use crate::error::Error;

/// The closed formulas on the mean of the readings at each of the paper's positions, their uncertainty from that
/// of the voltages, random effects included, through the numerical derivative of the formulas.
pub fn fit(campaign: &Campaign) -> Result<Fit<f64>, Error> {
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
    Ok(Fit {
        coefficients: Coefficients::from_nominal(values),
        covariance,
        visibility: design.visibility(),
        chi2: 0.0,
        readings: NOMINAL - 1,
    })
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
