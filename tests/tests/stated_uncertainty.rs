//! Whether what is stated of coefficients and vibration errors holds, over many campaigns of the virtual bench,
//! which works on waveforms and knows none of the averaged formulas.

use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Simulation, Specification, VirtualBench};
use host::prediction::predict;
use host::quantity::Quantity;
use host::statics::{Method, identify};

/// Campaigns of a static test alone.
const STATIC_CAMPAIGNS: u64 = 300;
/// Campaigns with shaker runs, which take longer.
const CAMPAIGNS: u64 = 40;

fn simulate(plan: Static, dial_arcsec: f64, seed: u64) -> Simulation {
    let specification = Specification::with_dial_sigma(dial_arcsec);
    VirtualBench::new(Seed(seed), plan, specification, Vec::new()).simulate()
}

fn simulate_static(plan: Static, dial_arcsec: f64, seed: u64) -> Simulation {
    let specification = Specification::with_dial_sigma(dial_arcsec);
    let mut bench = VirtualBench::new(Seed(seed), plan, specification, Vec::new());
    bench.plan.runs.clear();
    bench.plan.holdout.clear();
    bench.simulate()
}

/// Mean of squared z over campaigns.
struct MeanSquare {
    sum: f64,
    count: f64,
}

impl MeanSquare {
    fn new() -> Self {
        Self {
            sum: 0.0,
            count: 0.0,
        }
    }

    fn add(&mut self, quantity: Quantity, truth: f64) {
        let (value, sigma) = quantity.known().expect("determined");
        self.sum += ((value - truth) / sigma).powi(2);
        self.count += 1.0;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count
    }

    /// The mean of n squared unit normals is chi-square over n; its quantiles at one in 300 000 on either side, by
    /// Wilson and Hilferty.
    fn assert_near_one(&self, what: &str) {
        let variance = 2.0 / (9.0 * self.count);
        let quantile = |z: f64| (1.0 - variance + z * variance.sqrt()).powi(3);
        let (low, high, mean) = (quantile(-4.5), quantile(4.5), self.mean());
        assert!(
            (low..high).contains(&mean),
            "{what}: mean squared z {mean} is not within {low} to {high}"
        );
    }
}

#[test]
fn coefficients_lie_within_their_uncertainty_as_often_as_it_claims() {
    for (plan, dial_arcsec, determined) in [
        (Static::Default, 1.0, 11),
        (Static::Default, 5.8, 11),
        (Static::Paper, 10.0, 8),
        (Static::Remounted, 5.8, 11),
    ] {
        let mut per_coefficient: Vec<_> = (0..11).map(|_| MeanSquare::new()).collect();
        let (mut chi2, mut dof) = (0.0, 0.0);
        for seed in 0..STATIC_CAMPAIGNS {
            let Simulation {
                campaign, truth, ..
            } = simulate_static(plan, dial_arcsec, seed);
            let found = identify(&campaign, Method::LeastSquares, None).unwrap();
            let known = found
                .coefficients
                .iter()
                .filter(|c| c.value.is_some())
                .count();
            assert_eq!(
                (known, found.rank),
                (determined, determined.min(10).max(found.rank))
            );
            for (k, coefficient) in found.coefficients.iter().enumerate() {
                if coefficient.value.is_some() {
                    per_coefficient[k].add(*coefficient, truth.coefficients[k]);
                }
            }
            chi2 += found.chi2.unwrap();
            dof += found.dof as f64;
        }
        for (k, square) in per_coefficient
            .iter()
            .enumerate()
            .filter(|(_, s)| s.count > 0.0)
        {
            square.assert_near_one(&format!(
                "{plan:?} at {dial_arcsec} arcsec, coefficient {k}"
            ));
        }
        // Its standard deviation is the root of twice its degrees of freedom.
        let spread = 4.5 * (2.0 * dof).sqrt();
        assert!(
            (dof - spread..dof + spread).contains(&chi2),
            "{plan:?}: chi-square {chi2} at {dof} degrees of freedom"
        );
    }
}

#[test]
fn closed_formulas_state_an_uncertainty_that_holds() {
    let mut per_coefficient: Vec<_> = (0..11).map(|_| MeanSquare::new()).collect();
    for seed in 0..STATIC_CAMPAIGNS {
        let Simulation {
            campaign, truth, ..
        } = simulate_static(Static::Paper, 5.8, 1000 + seed);
        let found = identify(&campaign, Method::ClosedForm, None).unwrap();
        for (k, coefficient) in found.coefficients.iter().enumerate() {
            if coefficient.value.is_some() {
                per_coefficient[k].add(*coefficient, truth.coefficients[k]);
            }
        }
    }
    for (k, square) in per_coefficient
        .iter()
        .enumerate()
        .filter(|(_, s)| s.count > 0.0)
    {
        square.assert_near_one(&format!("coefficient {k}"));
    }
}

/// The same runs of many campaigns; runs of one campaign share its coefficients' errors, so each run number is
/// judged by itself.
#[test]
fn vibration_errors_of_runs_never_made_lie_within_the_stated_uncertainty() {
    let runs = 38;
    let mut from_static: Vec<_> = (0..runs).map(|_| MeanSquare::new()).collect();
    let mut refitted: Vec<_> = (0..runs).map(|_| MeanSquare::new()).collect();
    for seed in 0..CAMPAIGNS {
        let simulation = simulate(Static::Remounted, 5.8, 2000 + seed);
        let prediction = predict(&simulation.campaign, &simulation.holdout, None).unwrap();
        assert_eq!(prediction.runs.len(), runs);
        for (k, (run, truth)) in prediction
            .runs
            .iter()
            .zip(&simulation.truth.holdout_vre_g)
            .enumerate()
        {
            from_static[k].add(run.vre_g, *truth);
            refitted[k].add(run.refit_vre_g.unwrap(), *truth);
        }
    }
    for k in 0..runs {
        from_static[k].assert_near_one(&format!("run {k} from the static test"));
        refitted[k].assert_near_one(&format!("run {k} from static test and shaker"));
    }
}
