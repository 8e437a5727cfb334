//! The report on a campaign: a self-contained page with pictures, text for the terminal, and JSON.
//!
//! [`Report`] holds all that was computed, once; [`text`] and the page only show it.

mod certificate;
mod diagnosis;
mod diagnosis_text;
mod figures;
mod frame;
mod laboratory_text;
mod measurement;
mod outlook;
mod page;
mod plot;
mod remarks;
mod signature;
pub mod text;
pub mod triad;

use std::fs;
use std::path::Path;

use shared::identify::static_test::Fit;
use shared::model::NOMINAL;

use certificate::Certificate;

use crate::campaign::Campaign;
use crate::diagnose::{Study, static_test};
use crate::error::Error;
use crate::output::{write_file, write_json};
use crate::prediction::{Prediction, predict};
use crate::statics::{Identification, Method, fit, identify};

pub use diagnosis::page as diagnosis_page;
pub use diagnosis_text::text as diagnosis_text;
pub use laboratory_text::belonging;
pub use measurement::measurement_page;
pub use outlook::{Direction, Outlook, PlanSigma};
pub use remarks::{Remark, Severity};
pub use signature::signature;

/// Symbols of the coefficients in plain text, in the order of [`crate::statics::NAMES`].
const SYMBOLS: [&str; NOMINAL] = [
    "K1",
    "k0",
    "k1\u{2032}",
    "k2",
    "k3",
    "k4",
    "d_OA",
    "d_PA",
    "k_IP",
    "k_IO",
    "k_PO",
];

/// A number of one significant digit as a power of ten, `5×10⁻⁴`.
fn scientific(number: f64) -> String {
    let text = format!("{number:e}");
    let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let raised = exponent.chars().map(|c| match c {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
    });
    format!("{digits}\u{d7}10{}", raised.collect::<String>()).replace('-', "\u{2212}")
}

/// All that the report shows of a campaign.
#[derive(Clone, Debug)]
pub struct Report {
    /// The measurements, without the readings that do not belong.
    pub campaign: Campaign,
    /// Which readings do not, and noise that is not as stated, a line each.
    pub belonging: String,
    /// Coefficients from the static test alone, without a prior.
    pub identification: Identification,
    /// Predicted and measured vibration error of the campaign's runs; none without `vibration.csv`.
    pub prediction: Prediction,
    /// The static test's fit behind the predictions, with their prior if the plan needed one.
    pub fit: Fit<f64>,
    /// The blind direction, or the least determined one.
    pub direction: Direction,
    /// Uncertainty of the predicted vibration error over the level of a white noise.
    pub outlook: Outlook,
    /// What the reader must know first, the gravest first.
    pub remarks: Vec<Remark>,
}

impl Report {
    /// Identifies, predicts and judges.
    ///
    /// # Errors
    /// Readings that do not determine a fit, see [`identify`].
    pub fn new(campaign: &Campaign) -> Result<Self, Error> {
        let judged = static_test(campaign);
        let belonging = belonging(&judged.suspects, &judged.noise);
        let campaign = judged.belonging;
        let identification = identify(&campaign, Method::LeastSquares, None)?;
        let prediction = predict(&campaign, &campaign.runs, None)?;
        let fit = fit(&campaign, prediction.prior_sigma)?;
        let direction = Direction::new(&identification, &fit, prediction.prior_sigma);
        let outlook = Outlook::new(&campaign, &identification, &fit)?;
        let mut report = Self {
            campaign,
            belonging,
            identification,
            prediction,
            fit,
            direction,
            outlook,
            remarks: Vec::new(),
        };
        report.remarks = remarks::remarks(&report);
        Ok(report)
    }
}

/// What a report has beside the campaign.
#[derive(Clone, Copy, Default)]
pub struct Supplement<'a> {
    /// The folder that the campaign was read from: the hashes of its files.
    pub folder: Option<&'a Path>,
    /// The diagnosis: its sections.
    pub study: Option<&'a Study>,
}

/// Writes `report.html`, `identification.json` and `prediction.json` into the folder `out`, which is made if need be.
///
/// # Errors
/// Those of [`Report::new`], and what the file system says.
pub fn write(campaign: &Campaign, supplement: Supplement<'_>, out: &Path) -> Result<Report, Error> {
    let report = Report::new(campaign)?;
    let certificate = Certificate::of(&report.campaign, supplement.folder, &report.fit)?;
    let page = page::page(&report, &certificate, supplement.study)?;
    fs::create_dir_all(out).map_err(Error::write(out))?;
    write_json(&out.join("identification.json"), &report.identification)?;
    write_json(&out.join("prediction.json"), &report.prediction)?;
    write_file(&out.join("report.html"), page.as_bytes())?;
    Ok(report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statics::NAMES;

    #[test]
    fn powers_of_ten_are_raised() {
        assert_eq!(scientific(5e-4), "5\u{d7}10\u{207b}\u{2074}");
        assert_eq!(scientific(-2.5e12), "\u{2212}2.5\u{d7}10\u{b9}\u{b2}");
    }

    #[test]
    fn symbols_are_in_the_order_of_the_names() {
        for (symbol, name) in SYMBOLS.iter().zip(NAMES) {
            let plain = symbol.replace('\u{2032}', "_prime").to_lowercase();
            assert!(
                name.to_lowercase().starts_with(&plain),
                "{symbol} for {name}"
            );
        }
    }
}
