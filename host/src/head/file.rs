//! `head.toml`, `vre-head/1`: what is known of a head and of the type tested on it, carried from day to day.

use std::path::Path;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use shared::tumble::{ARCSEC_RAD, within_a_turn};

use super::batch::TYPE;
use super::posterior::{Posterior, Prior};
use super::reduced::MAX_MARKS;
use crate::error::{Error, clip, printable};
use crate::input::read_at_most;
use crate::output::write_file;
use crate::statics::NAMES;

const FORMAT: &str = "vre-head/1";
/// Largest file that is read: four times that of a head with all marks.
const MAX_BYTES: u64 = 1 << 24;

/// The content of `head.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeadFile {
    format: String,
    /// Name of the head.
    pub id: String,
    /// Campaigns that taught it: serial number and the first digits of the readings' SHA-256.
    pub campaigns: Vec<String>,
    /// The marks.
    pub marks: Marks,
    /// The type.
    #[serde(rename = "type")]
    pub kind: Type,
    /// Covariance of (the type's mean, the marks' errors in arcsec), row by row.
    pub covariance: Vec<Vec<f64>>,
}

/// Errors of the marks.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Marks {
    /// Angles, deg, within a turn.
    pub dial_deg: Vec<f64>,
    /// Errors, arcsec: the instrument stands at the mark's angle and this.
    pub error_arcsec: Vec<f64>,
    /// Their standard uncertainties, arcsec.
    pub sigma_arcsec: Vec<f64>,
}

/// Coefficients of the type, each in its own unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Type {
    /// Their names.
    pub names: Vec<String>,
    /// Their means.
    pub mean: Vec<f64>,
    /// Standard deviations of single instruments about them.
    pub spread: Vec<f64>,
}

impl HeadFile {
    /// What a batch says of a head of that name; `campaigns` by their keys.
    pub fn new(id: &str, posterior: &Posterior, campaigns: Vec<String>) -> Self {
        let marks = posterior.marks_deg.len();
        // Marks in the order of their angles.
        let mut order: Vec<usize> = (0..marks).collect();
        order.sort_by(|a, b| posterior.marks_deg[*a].total_cmp(&posterior.marks_deg[*b]));
        let places: Vec<usize> = (0..TYPE)
            .chain(order.iter().map(|mark| TYPE + mark))
            .collect();
        let unit = |k: usize| if k < TYPE { 1.0 } else { ARCSEC_RAD };
        let row = |i: &usize| {
            let element = |j: &usize| posterior.covariance[(*i, *j)] / unit(*i) / unit(*j);
            places.iter().map(element).collect()
        };
        Self {
            format: FORMAT.into(),
            id: id.into(),
            campaigns,
            marks: Marks {
                dial_deg: order
                    .iter()
                    .map(|mark| posterior.marks_deg[*mark])
                    .collect(),
                error_arcsec: order
                    .iter()
                    .map(|mark| posterior.mean[TYPE + mark] / ARCSEC_RAD)
                    .collect(),
                sigma_arcsec: order
                    .iter()
                    .map(|mark| posterior.mark_sigma_rad(*mark) / ARCSEC_RAD)
                    .collect(),
            },
            kind: Type {
                names: NAMES[1..].iter().map(|name| (*name).into()).collect(),
                mean: posterior.mean.rows(0, TYPE).iter().copied().collect(),
                spread: posterior.spread.to_vec(),
            },
            covariance: places.iter().map(row).collect(),
        }
    }

    /// Reads and checks `file`.
    ///
    /// # Errors
    /// Unreadable, not TOML of that format, or numbers that cannot be.
    pub fn read(file: &Path) -> Result<Self, Error> {
        let bytes = read_at_most(file, MAX_BYTES)?;
        let text =
            std::str::from_utf8(&bytes).map_err(|_| Error::input(file, "is not UTF-8 text"))?;
        let mut head: Self = toml::from_str(text)
            .map_err(|error| Error::input(file, error.message().replace('\n', " ")))?;
        head.check()
            .map_err(|problem| Error::input(file, problem))?;
        head.id = printable(&head.id);
        Ok(head)
    }

    fn check(&self) -> Result<(), String> {
        let Self {
            marks,
            kind,
            covariance,
            ..
        } = self;
        if self.format != FORMAT {
            return Err(format!(
                "its format is \"{}\", not \"{FORMAT}\"",
                clip(&self.format)
            ));
        }
        let count = marks.dial_deg.len();
        let order = TYPE + count;
        let lengths = [marks.error_arcsec.len(), marks.sigma_arcsec.len()];
        if lengths != [count; 2] || count > MAX_MARKS {
            return Err(format!(
                "[marks] has not one error and sigma for each of up to {MAX_MARKS} marks"
            ));
        }
        if kind.mean.len() != TYPE
            || kind.spread.len() != TYPE
            || !kind.names.iter().eq(&NAMES[1..])
        {
            return Err(format!(
                "[type] has not the {TYPE} coefficients from k0_g on"
            ));
        }
        if covariance.len() != order || covariance.iter().any(|row| row.len() != order) {
            return Err(format!(
                "covariance has not {order} rows of {order} numbers"
            ));
        }
        let numbers = covariance
            .iter()
            .flatten()
            .chain(&marks.dial_deg)
            .chain(&marks.error_arcsec);
        if !numbers
            .chain(&kind.mean)
            .chain(&kind.spread)
            .all(|x| x.is_finite())
        {
            return Err("a number is not finite".into());
        }
        let mut sorted: Vec<f64> = marks
            .dial_deg
            .iter()
            .map(|mark| within_a_turn(*mark))
            .collect();
        sorted.sort_by(f64::total_cmp);
        sorted.dedup();
        if sorted.len() != count || sorted.iter().ne(marks.dial_deg.iter()) {
            return Err("dial_deg is not in ascending order within a turn".into());
        }
        let positive =
            DMatrix::from_fn(order, order, |i, j| covariance[i.max(j)][i.min(j)]).cholesky();
        if positive.is_none() || kind.spread.iter().any(|sigma| *sigma <= 0.0) {
            return Err("covariance or spread is not positive".into());
        }
        Ok(())
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

    /// What is known before the next campaign.
    pub fn prior(&self) -> Prior {
        let order = TYPE + self.marks.dial_deg.len();
        let unit = |k: usize| if k < TYPE { 1.0 } else { ARCSEC_RAD };
        let values = self.kind.mean.iter().chain(&self.marks.error_arcsec);
        Prior {
            marks_deg: self.marks.dial_deg.clone(),
            mean: DVector::from_iterator(
                order,
                values.enumerate().map(|(k, value)| value * unit(k)),
            ),
            covariance: DMatrix::from_fn(order, order, |i, j| {
                self.covariance[i.max(j)][i.min(j)] * unit(i) * unit(j)
            }),
        }
    }

    /// Spread of the type.
    pub fn spread(&self) -> [f64; TYPE] {
        std::array::from_fn(|k| self.kind.spread[k])
    }
}
