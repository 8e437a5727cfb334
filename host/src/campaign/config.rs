//! `campaign.toml`: which instrument, on which bench.

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::toml_file::read_toml;
use super::{MarkErrors, keys, kind};
use crate::error::{Error, printable};
use crate::front_end::FrontEnd;
use crate::output::write_file;

pub(super) const FORMAT: &str = "vre-campaign/1";

/// The content of `campaign.toml`. Keys that mean nothing to us are kept and written back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CampaignConfig {
    format: String,
    /// The instrument under test.
    pub instrument: Instrument,
    /// The static bench.
    pub bench: Bench,
    /// The logger behind the voltages.
    pub acquisition: Acquisition,
    /// The shaker, if one was used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shaker: Option<Shaker>,
    /// What the instrument must keep, if anything is stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<Limits>,
    /// Who measured where and when, if it is stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record: Option<Record>,
    /// What is known of the marks' errors from other campaigns; it stands in no file of this one.
    #[serde(skip)]
    pub mark_errors: Option<Arc<MarkErrors>>,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

/// The instrument under test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Instrument {
    /// Serial number.
    pub serial: String,
    /// Scale factor of the type, V/g, negative for an inverted output; that of this instrument may be some per cent off.
    pub scale_factor_nominal_v_per_g: f64,
    /// Range, g.
    pub full_scale_g: f64,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

/// The dividing head, its base and the local gravity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bench {
    /// Standard uncertainty of one dial mark, arcsec; common to every reading at that mark.
    pub dial_sigma_arcsec: f64,
    /// Repeatability of one setting to a mark, arcsec.
    #[serde(default)]
    pub dial_repeat_sigma_arcsec: f64,
    /// Standard uncertainty of a remounting angle, arcsec; common to a series and mount.
    #[serde(default)]
    pub mount_sigma_arcsec: f64,
    /// Standard uncertainty of the base's level, arcsec, for each of two tilts common to all readings.
    pub level_sigma_arcsec: f64,
    /// Local gravity over the unit g of everything else.
    pub local_gravity_g: f64,
    /// Temperature to which the coefficients belong, degrees Celsius.
    pub reference_temp_c: f64,
    /// Standard deviation of the bias from session to session, g; a power cycle's if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session_bias_sigma_g: Option<f64>,
    /// Standard deviation of the instrument's alignment on its fixture from session to session, arcsec; a remounting's if
    /// absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session_alignment_sigma_arcsec: Option<f64>,
    /// Relative standard deviation of the logger's gain from session to session; that of one logger if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session_gain_rel_sigma: Option<f64>,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

/// The logger that averages the plateaus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Acquisition {
    /// Sample rate, Hz.
    pub sample_rate_hz: f64,
    /// The instrument's output is divided by this before the converter, > 0; not at all if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub divider: Option<f64>,
    /// And amplified by this, > 0; not at all if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Degrees of freedom behind the stated standard uncertainties; few if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_dof: Option<f64>,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

impl Acquisition {
    /// What lies between instrument and converter.
    pub fn front_end(&self) -> FrontEnd {
        let none = FrontEnd::default();
        FrontEnd {
            divider: self.divider.unwrap_or(none.divider),
            gain: self.gain.unwrap_or(none.gain),
        }
    }

    /// States what lies between instrument and converter.
    pub fn with_front_end(self, front_end: FrontEnd) -> Self {
        Self {
            divider: Some(front_end.divider),
            gain: Some(front_end.gain),
            ..self
        }
    }

    /// Whether a divider or a gain is stated.
    pub fn states_front_end(&self) -> bool {
        self.divider.is_some() || self.gain.is_some()
    }
}

/// Relative standard uncertainty of a peak detector that states none: a few parts in 1e4.
const PEAK_REL_SIGMA: f64 = 5e-4;

/// The shaker's reference accelerometer, and the peak detector at the instrument's output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shaker {
    /// Relative standard uncertainty of the reference's rms, drawn anew in each run.
    pub reference_rms_rel_sigma: f64,
    /// Standard uncertainty of the reference's cross-axis sensitivity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_cross_sensitivity: Option<f64>,
    /// Noise of each of the reference's axes, g rms: it is in every rms, and an axis at rest reads it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_noise_g: Option<f64>,
    /// Relative standard uncertainty of the gain of each of the reference's axes, the same in all runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_gain_rel_sigma: Option<f64>,
    /// Relative standard uncertainty of an excursion by the peak detector, drawn anew in each run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_rel_sigma: Option<f64>,
    /// Relative standard uncertainty of the peak detector's gain, the same in all runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_gain_rel_sigma: Option<f64>,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

/// What the instrument must keep, for pass and fail.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Greatest magnitude of the vibration error, g.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vre_g: Option<f64>,
    /// The vibration in which it is to be kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub environment: Option<String>,
    /// Further limits, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

/// Who measured where and when, for reports.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// When; a date of TOML or words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<toml::Value>,
    /// Who.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// At which bench.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub station: Option<String>,
    /// Whatever else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

impl CampaignConfig {
    /// A campaign's head without further keys.
    pub fn new(
        instrument: Instrument,
        bench: Bench,
        acquisition: Acquisition,
        shaker: Option<Shaker>,
    ) -> Self {
        let format = FORMAT.into();
        Self {
            format,
            instrument,
            bench,
            acquisition,
            shaker,
            limits: None,
            record: None,
            mark_errors: None,
            unknown: toml::Table::new(),
        }
    }

    /// Relative standard uncertainty of an excursion by the peak detector.
    pub fn peak_rel_sigma(&self) -> f64 {
        let stated = self.shaker.as_ref().and_then(|s| s.peak_rel_sigma);
        stated.unwrap_or(PEAK_REL_SIGMA)
    }

    /// Relative difference up to which two extremes may be alike: four of its standard uncertainties.
    pub fn peak_rel_error(&self) -> f64 {
        4.0 * self.peak_rel_sigma()
    }

    /// Reads and checks `file`.
    ///
    /// # Errors
    /// Unreadable, not UTF-8, not TOML, another format, a missing key, or a value that cannot be.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let mut config: Self = read_toml(file, |table| kind::of_one(file, table))?;
        config.strip();
        config.check(file)?;
        Ok(config)
    }

    /// Writes `file`.
    ///
    /// # Errors
    /// What the file system says.
    pub fn write(&self, file: &Path) -> Result<(), Error> {
        let text = toml::to_string(self)
            .map_err(|error| Error::write(file)(std::io::Error::other(error)))?;
        write_file(file, text.as_bytes())
    }

    pub(super) fn check(&self, file: &Path) -> Result<(), Error> {
        let values = keys::Values {
            format: &self.format,
            serial: &self.instrument.serial,
            numbers: &self.numbers(),
        };
        values.check(file, FORMAT)
    }

    /// Every number, with its key.
    fn numbers(&self) -> [(&'static str, Option<f64>); 22] {
        let Self {
            instrument,
            bench,
            acquisition,
            ..
        } = self;
        let shaker = self.shaker.as_ref();
        [
            (
                "scale_factor_nominal_v_per_g",
                Some(instrument.scale_factor_nominal_v_per_g),
            ),
            ("full_scale_g", Some(instrument.full_scale_g)),
            ("dial_sigma_arcsec", Some(bench.dial_sigma_arcsec)),
            (
                "dial_repeat_sigma_arcsec",
                Some(bench.dial_repeat_sigma_arcsec),
            ),
            ("mount_sigma_arcsec", Some(bench.mount_sigma_arcsec)),
            ("level_sigma_arcsec", Some(bench.level_sigma_arcsec)),
            ("local_gravity_g", Some(bench.local_gravity_g)),
            ("reference_temp_c", Some(bench.reference_temp_c)),
            ("session_bias_sigma_g", bench.session_bias_sigma_g),
            (
                "session_alignment_sigma_arcsec",
                bench.session_alignment_sigma_arcsec,
            ),
            ("session_gain_rel_sigma", bench.session_gain_rel_sigma),
            ("sample_rate_hz", Some(acquisition.sample_rate_hz)),
            ("divider", acquisition.divider),
            ("gain", acquisition.gain),
            ("sigma_dof", acquisition.sigma_dof),
            (
                "reference_rms_rel_sigma",
                shaker.map(|shaker| shaker.reference_rms_rel_sigma),
            ),
            (
                "reference_cross_sensitivity",
                shaker.and_then(|shaker| shaker.reference_cross_sensitivity),
            ),
            (
                "reference_noise_g",
                shaker.and_then(|shaker| shaker.reference_noise_g),
            ),
            (
                "reference_gain_rel_sigma",
                shaker.and_then(|shaker| shaker.reference_gain_rel_sigma),
            ),
            (
                "vre_g",
                self.limits.as_ref().and_then(|limits| limits.vre_g),
            ),
            (
                "peak_rel_sigma",
                shaker.and_then(|shaker| shaker.peak_rel_sigma),
            ),
            (
                "peak_gain_rel_sigma",
                shaker.and_then(|shaker| shaker.peak_gain_rel_sigma),
            ),
        ]
    }

    /// Takes what steers a terminal out of every text that people see.
    fn strip(&mut self) {
        let record = self.record.iter_mut();
        let record = record.flat_map(|r| [&mut r.operator, &mut r.station, &mut r.note]);
        let limits = self.limits.iter_mut().map(|limits| &mut limits.environment);
        let texts = record.chain(limits).flatten();
        for text in texts.chain([&mut self.instrument.serial]) {
            *text = printable(text);
        }
    }

    /// Keys that mean nothing to us, with the table that they stand in.
    pub fn unknown_keys(&self) -> Vec<String> {
        let tables = [
            (None, Some(&self.unknown)),
            (Some("instrument"), Some(&self.instrument.unknown)),
            (Some("bench"), Some(&self.bench.unknown)),
            (Some("acquisition"), Some(&self.acquisition.unknown)),
            (Some("shaker"), self.shaker.as_ref().map(|s| &s.unknown)),
            (Some("record"), self.record.as_ref().map(|r| &r.unknown)),
        ];
        let keys = tables.into_iter().flat_map(|(table, unknown)| {
            let keys = unknown.into_iter().flat_map(|unknown| unknown.keys());
            keys.map(move |key| keys::place(table, key))
        });
        keys.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::noise::Seed;
    use crate::bench::plan::Static;
    use crate::bench::simulate::{Specification, VirtualBench};

    #[test]
    fn every_number_of_the_head_has_its_range_among_the_keys() {
        let specification = Specification::with_dial_sigma(1.0);
        let bench = VirtualBench::new(Seed(1), Static::Default, specification, Vec::new());
        for (key, _) in bench.config().numbers() {
            assert!(keys::range(key).is_some(), "{key}");
        }
    }
}
