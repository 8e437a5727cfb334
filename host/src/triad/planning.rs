//! What orientations tell of the vibration error, and which one tells most next.

use serde::Serialize;
use shared::model::Coefficients;
use shared::triad::attitude::{Attitude, Position};
use shared::triad::body::outputs_v;
use shared::triad::identification::{Identification, Prior};
use shared::triad::vibration::{BodyMoments, vre_covariance_g2};

use super::coverage::{largest_hole, spiral};
use crate::error::Error;

/// What a plan is judged by.
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// Standard uncertainty of each mean output from noise, g.
    pub noise_g: f64,
    /// Standard uncertainty of each attitude, rad; `None` by hand.
    pub attitude_sigma_rad: Option<f64>,
    /// What is known of the cross-couplings, 1/g: standard deviation about zero.
    pub cross_coupling_sigma_per_g: Option<f64>,
}

/// What a plan of orientations tells, `vre-plan/1`.
#[derive(Clone, Debug, Serialize)]
pub struct TriadPlan {
    /// Always `vre-plan/1`.
    pub format: &'static str,
    /// Always `triad`.
    pub kind: &'static str,
    /// Number of positions.
    pub positions: usize,
    /// Directions of 33 that they tell by themselves.
    pub rank: usize,
    /// Farthest that a direction is from every position, deg.
    pub largest_hole_deg: f64,
    /// Each environment.
    pub environments: Vec<EnvironmentSigma>,
    /// Orientations worth adding, each the best after those before it: gravity's direction on the body axes.
    pub add: Vec<Addition>,
}

/// Standard uncertainty of the vibration error of x, y, z in an environment, g.
#[derive(Clone, Debug, Serialize)]
pub struct EnvironmentSigma {
    /// Its name.
    pub name: String,
    /// With the cross-couplings known as stated.
    pub vre_sigma_g: [f64; 3],
    /// Without.
    pub without_prior_sigma_g: [f64; 3],
}

/// One more orientation.
#[derive(Clone, Debug, Serialize)]
pub struct Addition {
    /// Specific force on the body axes, g.
    pub direction: [f64; 3],
    /// Root mean square over instruments and environments of the standard uncertainty then, g.
    pub vre_sigma_g: f64,
}

/// A vibration with its name, moments, and a systematic specific force on the body axes, g.
pub type Environment = (String, BodyMoments<f64>, [f64; 3]);

/// Orientations that are thought of as the next one: 11 deg apart.
const CANDIDATES: usize = 150;

/// Judges orientations, and looks for `most` to add.
///
/// # Errors
/// Orientations that tell no triad.
pub fn assess(
    directions: &[[f64; 3]],
    conditions: &Conditions,
    environments: &[Environment],
    most: usize,
) -> Result<TriadPlan, Error> {
    let fail = |problem: &dyn std::fmt::Display| {
        Error::Usage(format!("the orientations tell no triad: {problem}"))
    };
    let prior = match conditions.cross_coupling_sigma_per_g {
        Some(sigma) => Prior::cross_couplings(sigma),
        None => Prior::default(),
    }
    .beside_beforehand();
    let mut so_far = absorbed(directions, conditions).map_err(|e| fail(&e))?;
    let sigma_g = |test: &Identification, prior: &Prior| {
        let fit = test.solve(prior).map_err(|e| fail(&e))?;
        let of = |(_, moments, a0_g): &Environment| {
            let covariance = vre_covariance_g2(&moments.sensitivities(*a0_g), &fit.covariance);
            [0, 1, 2].map(|s| covariance[s][s].max(0.0).sqrt())
        };
        Ok::<_, Error>((
            environments.iter().map(of).collect::<Vec<_>>(),
            fit.by_positions.rank,
        ))
    };
    let (with_prior, rank) = sigma_g(&so_far, &prior)?;
    let (without, _) = sigma_g(&so_far, &Prior::default().beside_beforehand())?;
    let each = environments.iter().zip(with_prior).zip(without);
    let environments_told = each.map(|(((name, ..), stated), unstated)| EnvironmentSigma {
        name: name.clone(),
        vre_sigma_g: stated,
        without_prior_sigma_g: unstated,
    });
    let mut add = Vec::new();
    for _ in 0..most {
        let mut best: Option<(Addition, Identification)> = None;
        for direction in spiral(CANDIDATES) {
            let mut tried = so_far.clone();
            tried
                .absorb(&position(direction, conditions))
                .map_err(|e| fail(&e))?;
            let (sigmas, _) = sigma_g(&tried, &prior)?;
            let squares = sigmas.as_flattened().iter().map(|s| s * s).sum::<f64>();
            let vre_sigma_g = (squares / sigmas.as_flattened().len() as f64).sqrt();
            if best
                .as_ref()
                .is_none_or(|(b, _)| vre_sigma_g < b.vre_sigma_g)
            {
                let addition = Addition {
                    direction,
                    vre_sigma_g,
                };
                best = Some((addition, tried));
            }
        }
        let Some((addition, tried)) = best else { break };
        add.push(addition);
        so_far = tried;
    }
    Ok(TriadPlan {
        format: "vre-plan/1",
        kind: "triad",
        positions: directions.len(),
        rank,
        largest_hole_deg: largest_hole(directions).1.to_degrees(),
        environments: environments_told.collect(),
        add,
    })
}

fn absorbed(
    directions: &[[f64; 3]],
    conditions: &Conditions,
) -> Result<Identification, Box<dyn std::error::Error>> {
    let mut test = Identification::new([Coefficients::default(); 3], 1.0)?;
    for direction in directions {
        test.absorb(&position(*direction, conditions))?;
    }
    Ok(test)
}

/// An ideal triad of 1 V/g there.
fn position(direction: [f64; 3], conditions: &Conditions) -> Position {
    Position {
        output_v: outputs_v(&[Coefficients::default(); 3], direction),
        sigma_v: [conditions.noise_g; 3],
        attitude: conditions.attitude_sigma_rad.map(|sigma_rad| Attitude {
            direction,
            sigma_rad,
        }),
    }
}
