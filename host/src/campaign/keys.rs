//! The keys of `campaign.toml`, and those that are too like one of them to be meant otherwise.

use std::path::Path;

use crate::error::{Error, Place, Problem, clip};

/// Tables with their keys; the first has no name. A table without keys here takes any.
const KNOWN: [(Option<&str>, &[&str]); 7] = [
    (
        None,
        &[
            "format",
            "instrument",
            "bench",
            "acquisition",
            "shaker",
            "limits",
            "record",
        ],
    ),
    (
        Some("instrument"),
        &["serial", "scale_factor_nominal_v_per_g", "full_scale_g"],
    ),
    (
        Some("bench"),
        &[
            "dial_sigma_arcsec",
            "dial_repeat_sigma_arcsec",
            "mount_sigma_arcsec",
            "level_sigma_arcsec",
            "local_gravity_g",
            "reference_temp_c",
            "session_bias_sigma_g",
            "session_alignment_sigma_arcsec",
            "session_gain_rel_sigma",
        ],
    ),
    (
        Some("acquisition"),
        &["sample_rate_hz", "divider", "gain", "sigma_dof"],
    ),
    (
        Some("shaker"),
        &[
            "reference_rms_rel_sigma",
            "reference_cross_sensitivity",
            "reference_noise_g",
            "reference_gain_rel_sigma",
            "peak_rel_sigma",
            "peak_gain_rel_sigma",
        ],
    ),
    (Some("limits"), &["vre_g", "environment"]),
    (Some("record"), &["date", "operator", "station", "note"]),
];

/// Letters by which two keys differ at the most that are taken for one key misspelt.
const LETTERS: usize = 2;

/// A key with its table, for people.
pub(super) fn place(table: Option<&str>, key: &str) -> String {
    match table {
        Some(table) => format!("[{table}] {}", clip(key)),
        None => clip(key),
    }
}

/// No key may be nearly a known one of its table, nor one of another table.
pub(super) fn check(file: &Path, config: &toml::Table) -> Result<(), Error> {
    for (name, known) in KNOWN {
        let table = match name {
            None => Some(config),
            Some(name) => config.get(name).and_then(toml::Value::as_table),
        };
        for key in table.into_iter().flat_map(|table| table.keys()) {
            if known.contains(&key.as_str()) {
                continue;
            }
            if let Some(meant) = alike(known, key)
                .map(|like| self::place(name, like))
                .or_else(|| elsewhere(key))
            {
                let place = Place {
                    column: Some(key.clone()),
                    ..Place::file(file)
                };
                let problem = Problem::LikeKnownKey { known: meant };
                return Err(Error::Input { place, problem });
            }
        }
    }
    Ok(())
}

/// A known key that this one nearly is.
fn alike<'k>(known: &[&'k str], key: &str) -> Option<&'k str> {
    let key = key.to_lowercase();
    known
        .iter()
        .copied()
        .find(|known| strsim::levenshtein(known, &key) <= LETTERS)
}

/// The place of a key that belongs into another table.
fn elsewhere(key: &str) -> Option<String> {
    let named = KNOWN.iter().filter(|(name, _)| name.is_some());
    let mut holding = named.filter(|(_, keys)| keys.contains(&key));
    holding.next().map(|(name, _)| place(*name, key))
}
