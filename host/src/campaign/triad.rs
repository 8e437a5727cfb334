//! The campaign of a triad: `campaign.toml` with `[instrument] kind = "triad"`, `positions.csv`, and `vibration.csv` with
//! three outputs (optional).

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::config::FORMAT;
use super::kind::TRIAD;
use super::positions_table::{self, TriadPosition};
use super::toml_file::read_toml;
use super::triad_runs::{self, TriadRun};
use super::{keys, table_file};
use crate::error::{Error, Problem, printable};
use crate::output::write_file;

/// All the measurements of one triad.
#[derive(Clone, Debug, PartialEq)]
pub struct TriadCampaign {
    /// Triad and bench.
    pub config: TriadConfig,
    /// The positions, in the order of the file; those that are excluded are left out.
    pub positions: Vec<TriadPosition>,
    /// The shaker runs; empty without `vibration.csv`.
    pub runs: Vec<TriadRun>,
}

/// The content of a triad's `campaign.toml`. Keys that mean nothing to us are kept and written back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TriadConfig {
    format: String,
    /// The triad.
    pub instrument: TriadInstrument,
    /// Where it is at rest.
    pub bench: TriadBench,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

/// The triad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TriadInstrument {
    /// Serial number.
    pub serial: String,
    kind: String,
    /// Scale factor of the type, V/g, or counts a g.
    pub scale_factor_nominal_v_per_g: f64,
    /// Range, g.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub full_scale_g: Option<f64>,
    /// What is known of k_IP, k_IO, k_PO of the type: standard deviation about zero, 1/g. Little if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cross_coupling_sigma_per_g: Option<f64>,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

/// Where the triad is at rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TriadBench {
    /// Local gravity over the unit g of everything else.
    pub local_gravity_g: f64,
    /// Its standard uncertainty, g; known for sure if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub local_gravity_sigma_g: Option<f64>,
    /// Keys that mean nothing to us, kept.
    #[serde(flatten)]
    pub unknown: toml::Table,
}

impl TriadConfig {
    /// The head of a triad's campaign.
    pub fn new(
        serial: &str,
        scale_factor_nominal_v_per_g: f64,
        cross_coupling_sigma_per_g: Option<f64>,
        local_gravity_g: f64,
    ) -> Self {
        Self {
            format: FORMAT.into(),
            instrument: TriadInstrument {
                serial: serial.into(),
                kind: TRIAD.into(),
                scale_factor_nominal_v_per_g,
                full_scale_g: None,
                cross_coupling_sigma_per_g,
                unknown: toml::Table::new(),
            },
            bench: TriadBench {
                local_gravity_g,
                local_gravity_sigma_g: None,
                unknown: toml::Table::new(),
            },
            unknown: toml::Table::new(),
        }
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

    fn read(file: &Path) -> Result<Self, Error> {
        let mut config: Self = read_toml(file, |_| Ok(()))?;
        config.instrument.serial = printable(&config.instrument.serial);
        keys::Values {
            format: &config.format,
            serial: &config.instrument.serial,
            numbers: &config.numbers(),
        }
        .check(file, FORMAT)?;
        Ok(config)
    }

    /// Every number, with its key.
    fn numbers(&self) -> [(&'static str, Option<f64>); 5] {
        let (instrument, bench) = (&self.instrument, &self.bench);
        [
            (
                "scale_factor_nominal_v_per_g",
                Some(instrument.scale_factor_nominal_v_per_g),
            ),
            ("full_scale_g", instrument.full_scale_g),
            (
                "cross_coupling_sigma_per_g",
                instrument.cross_coupling_sigma_per_g,
            ),
            ("local_gravity_g", Some(bench.local_gravity_g)),
            ("local_gravity_sigma_g", bench.local_gravity_sigma_g),
        ]
    }
}

impl TriadCampaign {
    /// Reads and checks the campaign in `folder`.
    ///
    /// # Errors
    /// The first thing wrong in `campaign.toml`, `positions.csv` and `vibration.csv`, in this order.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let config = TriadConfig::read(&folder.join("campaign.toml"))?;
        let positions = positions_table::read(&table_file(folder, "positions")?)?;
        let vibration = table_file(folder, "vibration")?;
        let runs = match vibration.exists().then(|| triad_runs::read(&vibration)) {
            None
            | Some(Err(Error::Input {
                problem: Problem::NoRows,
                ..
            })) => Vec::new(),
            Some(runs) => runs?,
        };
        Ok(Self {
            config,
            positions,
            runs,
        })
    }

    /// Writes the campaign into `folder`, which is made if need be.
    ///
    /// # Errors
    /// What the file system says.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        fs::create_dir_all(folder).map_err(Error::write(folder))?;
        self.config.write(&folder.join("campaign.toml"))?;
        positions_table::write(&folder.join("positions.csv"), &self.positions)?;
        let vibration = folder.join("vibration.csv");
        if !self.runs.is_empty() {
            triad_runs::write(&vibration, &self.runs)?;
        } else if vibration.exists() {
            // The table of another campaign must not pass for this one's.
            fs::remove_file(&vibration).map_err(Error::write(&vibration))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_a_triads_head_has_its_range_among_the_keys() {
        for (key, _) in TriadConfig::new("A", 1.0, None, 1.0).numbers() {
            assert!(keys::range(key).is_some(), "{key}");
        }
    }
}
