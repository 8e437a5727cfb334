//! What the tables say to each other: (9) from Table 1 against Table 2, `vre-paper/1`.

use nalgebra::{Matrix3, RowVector3, Vector3};
use serde::Serialize;
use shared::identify::closed_form::paper_blind_direction;
use shared::model::{Coefficients, SpecificForce};
use shared::rectification::Sensitivity;
use shared::vibration::Random;

use super::tables::{Published, TABLES};

/// What one instrument's tables say to each other, `vre-paper/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the type.
    pub instrument: &'static str,
    /// (9) from Table 1 at 1 g rms along IA, a0 = 0, g.
    pub equation_9_vre_g: f64,
    /// Table 2, computed by the paper, g.
    pub paper_computed_vre_g: f64,
    /// Table 2, measured, g.
    pub paper_measured_vre_g: f64,
    /// (computed - measured) / measured, as the paper compares them.
    pub paper_mismatch: f64,
    /// What would have to stand in Table 1 for (9) to give the paper's computed value.
    pub implied_by_computed: Implied,
    /// What would have to stand in Table 1 for (9) to give the measured value.
    pub implied_by_measured: Implied,
}

/// Coefficients that would give a vibration error, each alone changed, or all three along the direction that the
/// paper's plan cannot see.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Implied {
    /// k1', all else as published.
    pub k1_prime: f64,
    /// k2, all else as published, 1/g.
    pub k2_per_g: f64,
    /// k4, all else as published, 1/g^3.
    pub k4_per_g3: f64,
    /// (k1', k2, k4) moved along the blind direction only: the paper's 24 voltages would be the same.
    pub along_blind_direction: [f64; 3],
    /// Length of that move.
    pub blind_step: f64,
}

/// Weights of k1', k2 and k4 in the VRE: of (9), and those that Table 2 asks for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Weights {
    /// (9) at 1 g rms, a0 = 0.
    pub equation_9: [f64; 3],
    /// Solved from the paper's computed values of the three instruments.
    pub from_computed: [f64; 3],
    /// Solved from the measured values.
    pub from_measured: [f64; 3],
}

/// Derivatives of (9) by k1', k2, k4 at 1 g rms along IA, a0 = 0.
fn weights_of_9() -> [f64; 3] {
    let s = Sensitivity::new(0.0, Random::along(SpecificForce::new(1.0, 0.0, 0.0)));
    [s.nominal[2], s.nominal[3], s.nominal[5]]
}

fn even(c: &Coefficients<f64>) -> [f64; 3] {
    [c.asymmetry, c.second_order_per_g, c.fourth_order_per_g3]
}

/// Compares the tables with (9).
pub fn compare() -> Vec<Comparison> {
    TABLES.iter().map(comparison).collect()
}

fn comparison(row: &Published) -> Comparison {
    let vibration = Random::along(SpecificForce::new(1.0, 0.0, 0.0));
    let vre_g = Sensitivity::new(0.0, vibration).vre_g(&row.coefficients);
    let [w1, w2, w4] = weights_of_9();
    let blind = paper_blind_direction::<f64>();
    let implied = |target_g: f64| {
        let missing_g = target_g - vre_g;
        let published = even(&row.coefficients);
        let blind_step = missing_g / (w1 * blind[0] + w2 * blind[1] + w4 * blind[2]);
        Implied {
            k1_prime: published[0] + missing_g / w1,
            k2_per_g: published[1] + missing_g / w2,
            k4_per_g3: published[2] + missing_g / w4,
            along_blind_direction: std::array::from_fn(|k| published[k] + blind_step * blind[k]),
            blind_step,
        }
    };
    Comparison {
        instrument: row.instrument,
        equation_9_vre_g: vre_g,
        paper_computed_vre_g: row.computed_vre_g,
        paper_measured_vre_g: row.measured_vre_g,
        paper_mismatch: (row.computed_vre_g - row.measured_vre_g) / row.measured_vre_g,
        implied_by_computed: implied(row.computed_vre_g),
        implied_by_measured: implied(row.measured_vre_g),
    }
}

/// The weights that the three instruments together ask for.
pub fn weights() -> Weights {
    let rows = TABLES.map(|row| RowVector3::from(even(&row.coefficients)));
    let solve = |vre_g: [f64; 3]| {
        let weights = Matrix3::from_rows(&rows).lu().solve(&Vector3::from(vre_g));
        weights
            .expect("the three instruments of Table 1 differ")
            .into()
    };
    Weights {
        equation_9: weights_of_9(),
        from_computed: solve(TABLES.map(|row| row.computed_vre_g)),
        from_measured: solve(TABLES.map(|row| row.measured_vre_g)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn computed_row_asks_for_a_weight_of_k4_that_no_vibration_has() {
        let weights = weights();
        for (ours, known) in weights.from_computed.iter().zip([0.92, 1.38, -2.14]) {
            assert!((ours - known).abs() < 0.005, "{ours} {known}");
        }
    }

    #[test]
    fn implied_coefficients_give_what_they_are_implied_by() {
        for (row, compared) in TABLES.iter().zip(compare()) {
            let implied = compared.implied_by_measured;
            let mut moved = row.coefficients;
            let [k1_prime, k2, k4] = implied.along_blind_direction;
            (
                moved.asymmetry,
                moved.second_order_per_g,
                moved.fourth_order_per_g3,
            ) = (k1_prime, k2, k4);
            // By the time mean of the model over white noise of 1 g rms, by the midpoint rule.
            let n = 200_000;
            let mean = (0..n)
                .map(|k| {
                    let x = -8.0 + 16.0 * (f64::from(k) + 0.5) / f64::from(n);
                    let weight = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt() * 16.0;
                    weight / f64::from(n) * moved.error_g(SpecificForce::new(x, 0.0, 0.0))
                })
                .sum::<f64>();
            let vre_g = mean - moved.bias_g;
            assert!((vre_g - row.measured_vre_g).abs() < 1e-10, "{vre_g}");
        }
    }

    #[test]
    fn papers_own_mismatch_is_36_19_and_26_per_cent() {
        for (compared, known) in compare().iter().zip([0.36, 0.19, 0.26]) {
            assert!((compared.paper_mismatch.abs() - known).abs() < 0.005);
        }
    }
}
