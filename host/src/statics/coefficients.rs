//! Names of the coefficients, for programs and for people.

use std::collections::BTreeMap;

use shared::identify::blindness::Visibility;
use shared::model::NOMINAL;

/// Names of the coefficients with their units, in the order of
/// [`Coefficients::to_nominal`](shared::model::Coefficients::to_nominal).
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

/// Components of a unit vector up to this are rounding, some 1e-16 in fact.
const ROUNDING: f64 = 1e-9;

/// The blind directions, each as the components that are not zero, by name.
pub fn blind_directions(seen: &Visibility<f64>) -> Vec<BTreeMap<&'static str, f64>> {
    let by_name = |direction: &[f64; NOMINAL]| {
        let named = NAMES.into_iter().zip(*direction);
        named.filter(|(_, c)| c.abs() > ROUNDING).collect()
    };
    seen.blind_directions().iter().map(by_name).collect()
}
