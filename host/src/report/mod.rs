//! The report on a campaign: a self-contained page with pictures, text for the terminal, and JSON.
//!
//! [`Report`] holds all that was computed, once; [`text`] and the page only show it.

mod figures;
mod outlook;
mod page;
mod plot;
mod remarks;
pub mod text;

use std::fs;
use std::path::Path;

use shared::identify::static_test::Fit;

use crate::campaign::Campaign;
use crate::error::Error;
use crate::identification::{Identification, Method, fit, identify};
use crate::output::{write_file, write_json};
use crate::prediction::{Prediction, predict};

pub use outlook::{Direction, LevelSigma};
pub use remarks::{Remark, Severity};

/// All that the report shows of a campaign.
#[derive(Clone, Debug)]
pub struct Report<'c> {
    /// The measurements.
    pub campaign: &'c Campaign,
    /// Coefficients from the static test alone, without a prior.
    pub identification: Identification,
    /// Predicted and measured vibration error of the campaign's runs; none without `vibration.csv`.
    pub prediction: Prediction,
    /// The static test's fit behind the predictions, with their prior if the plan needed one.
    pub fit: Fit<f64>,
    /// The blind direction, or the least determined one.
    pub direction: Direction,
    /// Uncertainty of the predicted vibration error over the level of a white noise.
    pub levels: Vec<LevelSigma>,
    /// What the reader must know first, the gravest first.
    pub remarks: Vec<Remark>,
}

impl<'c> Report<'c> {
    /// Identifies, predicts and judges.
    ///
    /// # Errors
    /// Readings that do not determine a fit, see [`identify`].
    pub fn new(campaign: &'c Campaign) -> Result<Self, Error> {
        let identification = identify(campaign, Method::LeastSquares, None)?;
        let prediction = predict(campaign, &campaign.runs, None)?;
        let fit = fit(campaign, &[], prediction.prior_sigma)?;
        let direction = Direction::new(&identification, &fit, prediction.prior_sigma);
        let levels = outlook::levels(campaign, &fit)?;
        let mut report = Self {
            campaign,
            identification,
            prediction,
            fit,
            direction,
            levels,
            remarks: Vec::new(),
        };
        report.remarks = remarks::remarks(&report);
        Ok(report)
    }
}

/// Writes `report.html`, `identification.json` and `prediction.json` into the folder `out`, which is made if need be.
///
/// # Errors
/// Those of [`Report::new`], and what the file system says.
pub fn write<'c>(campaign: &'c Campaign, out: &Path) -> Result<Report<'c>, Error> {
    let report = Report::new(campaign)?;
    let page = page::page(&report)?;
    fs::create_dir_all(out).map_err(Error::write(out))?;
    write_json(&out.join("identification.json"), &report.identification)?;
    write_json(&out.join("prediction.json"), &report.prediction)?;
    write_file(&out.join("report.html"), page.as_bytes())?;
    Ok(report)
}
