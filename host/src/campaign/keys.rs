//! The keys of `campaign.toml` with their meaning, and those that are too like one of them to be meant otherwise.

use std::path::Path;

use super::columns::{Column, Content, Need, number};
use super::ranges::{self, Range};
use crate::error::{Error, Place, Problem, clip};

/// A table of `campaign.toml`.
#[derive(Clone, Copy, Debug)]
pub struct KeyTable {
    /// Its name; none of the keys before the first table.
    pub name: Option<&'static str>,
    /// What it is about.
    pub about: &'static str,
    /// Whether a campaign must have it.
    pub required: bool,
    /// Its keys.
    pub keys: &'static [Column],
}

const fn text(
    name: &'static str,
    need: Need,
    example: &'static str,
    meaning: &'static str,
) -> Column {
    Column {
        name,
        content: Content::Text,
        need,
        meaning,
        example,
    }
}

use Need::{Optional, Required};

/// The tables of `campaign.toml` with their keys.
pub static KEYS: [KeyTable; 7] = [
    KeyTable {
        name: None,
        about: "the format of the folder",
        required: true,
        keys: &[text(
            "format",
            Required,
            "\"vre-campaign/1\"",
            "always vre-campaign/1",
        )],
    },
    KeyTable {
        name: Some("instrument"),
        about: "the instrument under test",
        required: true,
        keys: &[
            text("serial", Required, "\"S01000\"", "serial number"),
            text(
                "kind",
                Optional,
                "\"triad\"",
                "triad: three instruments on one body, with positions.csv; absent: one instrument",
            ),
            number(
                "scale_factor_nominal_v_per_g",
                &ranges::SCALE_FACTOR,
                Required,
                "1.2",
                "scale factor of the type, negative of an inverted output; this instrument may differ by some per cent",
            ),
            number(
                "full_scale_g",
                &ranges::FULL_SCALE,
                Required,
                "10.0",
                "range of the instrument",
            ),
            number(
                "cross_coupling_sigma_per_g",
                &ranges::RELATIVE_SIGMA,
                Optional,
                "5e-5",
                "of a triad: what is known of the cross-couplings of the type, standard deviation about zero",
            ),
        ],
    },
    KeyTable {
        name: Some("bench"),
        about: "the dividing head, its base and gravity",
        required: true,
        keys: &[
            number(
                "dial_sigma_arcsec",
                &ranges::ARCSEC_SIGMA,
                Required,
                "1.0",
                "standard uncertainty of one dial mark, common to every reading at that mark; a limit of +-L is L / 1.732",
            ),
            number(
                "dial_repeat_sigma_arcsec",
                &ranges::ARCSEC_SIGMA,
                Optional,
                "0.2",
                "repeatability of one setting to a mark",
            ),
            number(
                "mount_sigma_arcsec",
                &ranges::ARCSEC_SIGMA,
                Optional,
                "60.0",
                "how well a remounting angle is known",
            ),
            number(
                "level_sigma_arcsec",
                &ranges::ARCSEC_SIGMA,
                Required,
                "1.0",
                "standard uncertainty of the base's level",
            ),
            number(
                "local_gravity_g",
                &ranges::LOCAL_GRAVITY,
                Required,
                "1.0",
                "local gravity over the unit g that everything else is in",
            ),
            number(
                "local_gravity_sigma_g",
                &ranges::G_SIGMA,
                Optional,
                "1e-5",
                "of a triad: standard uncertainty of local gravity",
            ),
            number(
                "reference_temp_c",
                &ranges::TEMPERATURE,
                Required,
                "22.0",
                "temperature to which the coefficients belong",
            ),
            number(
                "session_bias_sigma_g",
                &ranges::G_SIGMA,
                Optional,
                "2e-5",
                "how far the bias differs from session to session",
            ),
            number(
                "session_alignment_sigma_arcsec",
                &ranges::ARCSEC_SIGMA,
                Optional,
                "60.0",
                "how far the alignment differs from session to session",
            ),
            number(
                "session_gain_rel_sigma",
                &ranges::RELATIVE_SIGMA,
                Optional,
                "1e-6",
                "how far the logger's gain differs from session to session",
            ),
        ],
    },
    KeyTable {
        name: Some("acquisition"),
        about: "the logger behind the voltages",
        required: true,
        keys: &[
            number(
                "sample_rate_hz",
                &ranges::SAMPLE_RATE,
                Required,
                "400.0",
                "rate of the logger that averages the plateaus",
            ),
            number(
                "divider",
                &ranges::FACTOR,
                Optional,
                "10.0",
                "by what the instrument's output is divided before the converter",
            ),
            number(
                "gain",
                &ranges::FACTOR,
                Optional,
                "1.0",
                "and by what it is amplified",
            ),
            number(
                "sigma_dof",
                &ranges::DEGREES_OF_FREEDOM,
                Optional,
                "30.0",
                "degrees of freedom behind the stated sigmas; few if absent",
            ),
        ],
    },
    KeyTable {
        name: Some("shaker"),
        about: "the reference on the table and the peak detector",
        required: false,
        keys: &[
            number(
                "reference_rms_rel_sigma",
                &ranges::RELATIVE_SIGMA,
                Required,
                "2e-4",
                "relative scatter of the reference's rms from run to run",
            ),
            number(
                "reference_cross_sensitivity",
                &ranges::RELATIVE_SIGMA,
                Optional,
                "0.01",
                "standard uncertainty of the reference's cross-axis sensitivity",
            ),
            number(
                "reference_noise_g",
                &ranges::G_SIGMA,
                Optional,
                "1e-4",
                "rms noise of each reference axis",
            ),
            number(
                "reference_gain_rel_sigma",
                &ranges::RELATIVE_SIGMA,
                Optional,
                "0.005",
                "standard uncertainty of each reference axis's gain, the same in all runs",
            ),
            number(
                "peak_rel_sigma",
                &ranges::RELATIVE_SIGMA,
                Optional,
                "5e-4",
                "scatter of the peak detector from run to run",
            ),
            number(
                "peak_gain_rel_sigma",
                &ranges::RELATIVE_SIGMA,
                Optional,
                "0.005",
                "standard uncertainty of the peak detector's gain, the same in all runs",
            ),
        ],
    },
    KeyTable {
        name: Some("limits"),
        about: "what the instrument must keep",
        required: false,
        keys: &[
            number(
                "vre_g",
                &ranges::VRE_LIMIT,
                Optional,
                "50e-6",
                "greatest magnitude of the vibration error, for pass and fail",
            ),
            text(
                "environment",
                Optional,
                "\"psd:vehicle.csv\"",
                "the vibration in which it is to be kept, as vre predict --vibration takes it",
            ),
        ],
    },
    KeyTable {
        name: Some("record"),
        about: "who measured where and when, for reports",
        required: false,
        keys: &[
            text("date", Optional, "2026-05-14", "day of the measurement"),
            text("operator", Optional, "\"N. N.\"", "who measured"),
            text("station", Optional, "\"dividing head 2\"", "at which bench"),
            text("note", Optional, "\"\"", "whatever else"),
        ],
    },
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

/// What `campaign.toml` says, as far as it can be wrong by itself.
pub(super) struct Values<'c> {
    pub(super) format: &'c str,
    pub(super) serial: &'c str,
    /// Key and value, if it is given.
    pub(super) numbers: &'c [(&'static str, Option<f64>)],
}

impl Values<'_> {
    /// The format must be the one `expected`, the serial number must not be empty, each number in the range of its key.
    pub(super) fn check(&self, file: &Path, expected: &'static str) -> Result<(), Error> {
        let fail = |key: &str, problem| {
            let place = Place {
                column: Some(key.into()),
                ..Place::file(file)
            };
            Err(Error::Input { place, problem })
        };
        if self.format != expected {
            let value = self.format.into();
            return fail("format", Problem::NotOneOf { value, expected });
        }
        if self.serial.trim().is_empty() {
            return fail("serial", Problem::Empty);
        }
        for (key, value) in self.numbers {
            let range = range(key);
            if let Some(Err(problem)) = range.zip(*value).map(|(range, value)| range.check(value)) {
                return fail(key, problem);
            }
        }
        Ok(())
    }
}

/// The range of a key that is a number.
pub(super) fn range(key: &str) -> Option<&'static Range> {
    let mut known = KEYS.iter().flat_map(|table| table.keys);
    known.find_map(|known| match known.content {
        Content::Number(range) if known.name == key => Some(range),
        _ => None,
    })
}

/// No key may be nearly a known one of its table, nor one of another table.
pub(super) fn check(file: &Path, config: &toml::Table) -> Result<(), Error> {
    for KeyTable { name, keys, .. } in KEYS {
        let own = keys.iter().map(|key| key.name);
        // Before the first table stand the names of the tables, too.
        let tables = KEYS.iter().filter_map(|table| table.name);
        let known: Vec<&str> = own.chain(tables.filter(|_| name.is_none())).collect();
        let table = match name {
            None => Some(config),
            Some(name) => config.get(name).and_then(toml::Value::as_table),
        };
        for key in table.into_iter().flat_map(|table| table.keys()) {
            if known.contains(&key.as_str()) {
                continue;
            }
            if let Some(meant) = alike(&known, key)
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
    let named = KEYS.iter().filter(|table| table.name.is_some());
    let mut holding = named.filter(|table| table.keys.iter().any(|known| known.name == key));
    holding.next().map(|table| place(table.name, key))
}
