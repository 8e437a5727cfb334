//! `campaign.toml`: which instrument, on which bench.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Place, Problem};
use crate::front_end::FrontEnd;
use crate::output::write_file;

const FORMAT: &str = "vre-campaign/1";
const MAX_BYTES: u64 = 1 << 20;
/// Smaller than what any dial's angle is known to; 0 says that an angle is exact.
const SMALLEST_SIGMA_ARCSEC: f64 = 1e-6;

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
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

/// The instrument under test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Instrument {
    /// Serial number.
    pub serial: String,
    /// Scale factor of the type, V/g; that of this instrument may be some per cent off.
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

/// The shaker's reference accelerometer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shaker {
    /// Relative standard uncertainty of the reference's rms.
    pub reference_rms_rel_sigma: f64,
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
            unknown: toml::Table::new(),
        }
    }

    /// Reads and checks `file`.
    ///
    /// # Errors
    /// Unreadable, not UTF-8, not TOML, another format, a missing key, or a value that cannot be.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let mut bytes = Vec::new();
        File::open(file)
            .and_then(|source| source.take(MAX_BYTES + 1).read_to_end(&mut bytes))
            .map_err(Error::read(file))?;
        if bytes.len() as u64 > MAX_BYTES {
            return Err(Error::input(
                file,
                format!("has more than {MAX_BYTES} bytes"),
            ));
        }
        let at = |offset: usize| Place {
            row: Some(
                1 + bytes[..offset]
                    .iter()
                    .filter(|&&byte| byte == b'\n')
                    .count() as u64,
            ),
            ..Place::file(file)
        };
        let text = std::str::from_utf8(&bytes).map_err(|error| Error::Input {
            place: at(error.valid_up_to()),
            problem: Problem::NotUtf8,
        })?;
        if text.trim_start_matches('\u{feff}').trim().is_empty() {
            return Err(Error::input(file, Problem::EmptyFile));
        }
        let config: Self = toml::from_str(text).map_err(|error| {
            let place = match error.span() {
                Some(span) => at(span.start.min(bytes.len())),
                None => Place::file(file),
            };
            let problem = Problem::Other(error.message().replace('\n', " "));
            Error::Input { place, problem }
        })?;
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

    fn check(&self, file: &Path) -> Result<(), Error> {
        let fail = |key: &str, problem| {
            let place = Place {
                column: Some(key.into()),
                ..Place::file(file)
            };
            Err(Error::Input { place, problem })
        };
        if self.format != FORMAT {
            let problem = Problem::NotOneOf {
                value: self.format.clone(),
                expected: "vre-campaign/1",
            };
            return fail("format", problem);
        }
        if self.instrument.serial.trim().is_empty() {
            return fail("serial", Problem::Empty);
        }
        let front_end = self.acquisition.front_end();
        let positive = [
            (
                "scale_factor_nominal_v_per_g",
                self.instrument.scale_factor_nominal_v_per_g,
            ),
            ("full_scale_g", self.instrument.full_scale_g),
            ("sample_rate_hz", self.acquisition.sample_rate_hz),
            ("divider", front_end.divider),
            ("gain", front_end.gain),
        ];
        for (key, value) in positive {
            if !value.is_finite() {
                return fail(key, Problem::NotFinite(value.to_string()));
            }
            if value <= 0.0 {
                return fail(key, Problem::NotPositive(value));
            }
        }
        for (key, value, low, high) in self.ranges() {
            if !value.is_finite() {
                return fail(key, Problem::NotFinite(value.to_string()));
            }
            if !(low..=high).contains(&value) {
                return fail(key, Problem::OutOfRange { value, low, high });
            }
            if key.ends_with("_arcsec") && value > 0.0 && value < SMALLEST_SIGMA_ARCSEC {
                let problem = format!("{value} is neither 0 nor at least {SMALLEST_SIGMA_ARCSEC}");
                return fail(key, problem.into());
            }
        }
        Ok(())
    }
    /// Numbers of bench and shaker by their keys, each with its least and its greatest value.
    fn ranges(&self) -> impl Iterator<Item = (&'static str, f64, f64, f64)> {
        let bench = &self.bench;
        let ranges = [
            ("dial_sigma_arcsec", bench.dial_sigma_arcsec, 0.0, 36_000.0),
            (
                "dial_repeat_sigma_arcsec",
                bench.dial_repeat_sigma_arcsec,
                0.0,
                36_000.0,
            ),
            (
                "mount_sigma_arcsec",
                bench.mount_sigma_arcsec,
                0.0,
                36_000.0,
            ),
            (
                "level_sigma_arcsec",
                bench.level_sigma_arcsec,
                0.0,
                36_000.0,
            ),
            ("local_gravity_g", bench.local_gravity_g, 0.9, 1.1),
            ("reference_temp_c", bench.reference_temp_c, -273.15, 1000.0),
        ];
        let relative = self.shaker.iter().map(|shaker| {
            (
                "reference_rms_rel_sigma",
                shaker.reference_rms_rel_sigma,
                0.0,
                1.0,
            )
        });
        ranges.into_iter().chain(relative)
    }
}
