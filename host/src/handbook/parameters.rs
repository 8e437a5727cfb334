//! Parameters of effects in words.

/// What a reported parameter of an effect is: words and unit (`resonance frequency`, `Hz`). A name that is not known is its own
/// words, without a unit.
pub fn in_words(effect: &str, name: &str) -> (&'static str, &'static str) {
    match (effect, name) {
        ("fixture-resonance", "fn_hz") => ("resonance frequency of the fixture", "Hz"),
        ("vibropendulous", "fn_hz") => ("natural frequency of the proof mass", "Hz"),
        (_, "fn_hz") => ("natural frequency", "Hz"),
        ("vibropendulous", "k_per_g") => ("product term of input and pendulous axes", "1/g"),
        (_, known) => IN_WORDS
            .iter()
            .find(|(name, ..)| *name == known)
            .map_or(("", ""), |(_, words, unit)| (*words, *unit)),
    }
}

static IN_WORDS: [(&str, &str, &str); 35] = [
    ("q", "quality factor of the resonance", ""),
    (
        "b_per_g",
        "rectification of the motion that the loop leaves",
        "1/g",
    ),
    ("fc_hz", "bandwidth of the servo loop", "Hz"),
    (
        "limit_g",
        "specific force at which the output is clipped",
        "g",
    ),
    (
        "offset_g",
        "how far the middle between the two limits is off zero",
        "g",
    ),
    (
        "ratio_next",
        "motion along the next axis over that along the drive",
        "",
    ),
    (
        "ratio_previous",
        "motion along the previous axis over that along the drive",
        "",
    ),
    ("h2", "second harmonic over the fundamental", ""),
    (
        "r_per_g_hz2",
        "centripetal acceleration per square of acceleration over frequency",
        "Hz^2/g",
    ),
    ("eps", "true motion over the stated one, less 1", ""),
    ("c_g_per_g", "shift of the output per drive", "g/g"),
    (
        "e1s_arcsec",
        "error of the dial that goes with the sine of its angle",
        "arcsec",
    ),
    (
        "e1c_arcsec",
        "error of the dial that goes with the cosine of its angle",
        "arcsec",
    ),
    (
        "e2s_arcsec",
        "error of the dial that goes with the sine of twice its angle",
        "arcsec",
    ),
    (
        "e2c_arcsec",
        "error of the dial that goes with the cosine of twice its angle",
        "arcsec",
    ),
    ("zero_arcsec", "tilt of the base about the shaft", "arcsec"),
    (
        "axis_arcsec",
        "lift of the shaft out of the horizontal",
        "arcsec",
    ),
    ("g_per_k", "bias per temperature", "g/K"),
    (
        "per_k",
        "relative change of the scale factor per temperature",
        "1/K",
    ),
    ("g_per_s", "drift of the bias", "g/s"),
    (
        "c_per_g",
        "final shift of the bias per mean square of the vibration",
        "1/g",
    ),
    ("tau_s", "time constant of warming", "s"),
    ("step_g", "lasting step of the bias", "g"),
    (
        "threshold_g",
        "level from which on a run leaves a step",
        "g",
    ),
    (
        "h_g",
        "half the difference of readings between the two senses of approach",
        "g",
    ),
    ("K0_prime_g", "bias asymmetry", "g"),
    ("Koq_per_g", "odd quadratic coefficient", "1/g"),
    ("k5_per_g4", "fifth-order nonlinearity", "1/g^4"),
    ("k6_per_g5", "sixth-order nonlinearity", "1/g^5"),
    (
        "Kpp_per_g",
        "answer to the square of acceleration along the pendulous axis",
        "1/g",
    ),
    (
        "Koo_per_g",
        "answer to the square of acceleration along the output axis",
        "1/g",
    ),
    (
        "amplitude_g",
        "amplitude of the converter's periodic error",
        "g",
    ),
    ("cycles", "periods of that error over 2 g of output", ""),
    ("phase_rad", "phase of that error at zero output", "rad"),
    (
        "gain",
        "share of an aliased sine that passes the averaging",
        "",
    ),
];

#[cfg(test)]
mod tests {
    use super::in_words;
    use crate::effects::catalogue;

    #[test]
    fn every_reported_parameter_of_the_catalogue_has_words() {
        for effect in catalogue() {
            let own = effect.parameters.iter().map(|parameter| parameter.name);
            let names: Vec<&str> = match effect.report {
                Some((names, _)) => names.to_vec(),
                None => own.filter(|name| !name.starts_with('_')).collect(),
            };
            for name in names {
                let (words, _) = in_words(effect.id, name);
                assert!(!words.is_empty(), "{}: {name}", effect.id);
            }
        }
    }
}
