//! What leaving positions out says of the terms of the model: rms of |a| - g of positions that were not used.
//!
//! The linear triad (three scale factors, three biases, three misalignments: the method of imu_tk) stands at the beginning. A group
//! of terms is claimed if |a| - g of positions that were left out comes nearer to zero with it.

use shared::identify::square_root::FactorError;
use shared::model::{Coefficients, NOMINAL};
use shared::triad::attitude::Position;
use shared::triad::body::specific_force_g;
use shared::triad::identification::{Identification, Prior};

/// Groups of terms that are claimed together, each of every instrument, with their places among the coefficients.
pub const GROUPS: [(&str, &[usize]); 5] = [
    ("k1_prime", &[2]),
    ("k2_per_g", &[3]),
    ("k3_per_g2", &[4]),
    ("k4_per_g3", &[5]),
    ("cross_couplings_per_g", &[8, 9, 10]),
];

/// Which groups are claimed.
pub type Claims = [bool; GROUPS.len()];

/// What leaving positions out says.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// Groups that are claimed.
    pub claims: Claims,
    /// Root mean square of |a| - g of positions left out, by the linear triad, g.
    pub linear_rms_g: f64,
    /// The same with the claimed groups.
    pub rms_g: f64,
}

/// Most positions that are left out one by one; of more, blocks of neighbours in turn.
const MOST_FOLDS: usize = 100;

/// Standard errors by which the mean square must fall for a group to be claimed. Chosen: one in forty groups of no effect falls so
/// far by chance, and must then stand out from zero too; of 30 sessions of a consumer part none claims a term (tested).
const CLAIMED: f64 = 2.0;

/// A coefficient that is zero: its standard deviation beforehand, far below what any position tells.
const ZERO: f64 = 1e-9;

/// Tries the groups one after another, each time the one that brings most, beside `stated`; those that are `barred` are not tried.
///
/// # Errors
/// [`FactorError`] that the types rule out.
pub fn leave_out(
    positions: &[Position],
    about: &[Coefficients<f64>; 3],
    gravity_g: f64,
    stated: &Prior,
    barred: &Claims,
) -> Result<LeftOut, FactorError> {
    let squares = |claims: &Claims| squares(positions, about, gravity_g, &with(stated, claims));
    let mut claims = [false; GROUPS.len()];
    let mut current = squares(&claims)?;
    let linear_rms_g = rms(&current);
    loop {
        let mut best: Option<(usize, Vec<f64>)> = None;
        for group in (0..GROUPS.len()).filter(|group| !claims[*group] && !barred[*group]) {
            let mut tried = claims;
            tried[group] = true;
            let found = squares(&tried)?;
            let least = best.as_ref().map_or(rms(&current), |(_, best)| rms(best));
            if is_less(&found, &current) && rms(&found) < least {
                best = Some((group, found));
            }
        }
        let Some((group, found)) = best else {
            let rms_g = rms(&current);
            return Ok(LeftOut {
                claims,
                linear_rms_g,
                rms_g,
            });
        };
        claims[group] = true;
        current = found;
    }
}

/// `stated`, and zero for all groups that are not claimed.
fn with(stated: &Prior, claims: &Claims) -> Prior {
    let mut prior = *stated;
    for ((_, places), _) in GROUPS.iter().zip(claims).filter(|(_, claimed)| !**claimed) {
        places.iter().for_each(|k| prior.sigma[*k] = ZERO);
    }
    prior
}

/// The group of a coefficient, by its place.
pub fn group_of(coefficient: usize) -> Option<usize> {
    debug_assert!(coefficient < NOMINAL);
    GROUPS
        .iter()
        .position(|(_, places)| places.contains(&coefficient))
}

/// Squares of |a| - g of each position, by the coefficients of the others, g^2.
fn squares(
    positions: &[Position],
    about: &[Coefficients<f64>; 3],
    gravity_g: f64,
    prior: &Prior,
) -> Result<Vec<f64>, FactorError> {
    let count = positions.len();
    let block = count.div_ceil(MOST_FOLDS);
    let mut squares = Vec::with_capacity(count);
    let mut test = Identification::new(*about, gravity_g)?;
    for first in (0..count).step_by(block) {
        let left_out = first..(first + block).min(count);
        test.restart(*about);
        for (k, position) in positions.iter().enumerate() {
            if !left_out.contains(&k) {
                // A position that the triad cannot give was refused by the fit before.
                let _ = test.absorb(position);
            }
        }
        let found = test.estimate(prior)?;
        for position in &positions[left_out] {
            let length = specific_force_g(&found, position.output_v)
                .map_or(f64::INFINITY, |[x, y, z]| (x * x + y * y + z * z).sqrt());
            squares.push((length - gravity_g).powi(2));
        }
    }
    Ok(squares)
}

fn rms(squares: &[f64]) -> f64 {
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Whether the mean of `new` is below that of `old` by more than [`CLAIMED`] standard errors of their difference.
fn is_less(new: &[f64], old: &[f64]) -> bool {
    let n = new.len() as f64;
    let falls: Vec<f64> = old.iter().zip(new).map(|(old, new)| old - new).collect();
    let mean = falls.iter().sum::<f64>() / n;
    let variance = falls.iter().map(|fall| (fall - mean).powi(2)).sum::<f64>() / (n * (n - 1.0));
    mean > CLAIMED * variance.sqrt()
}
