//! The report as text for a terminal.

use std::fmt::Write as _;

use super::Report;
use super::remarks::{self, Severity};
use crate::campaign::{Run, VibrationKind};
use crate::prediction::{PredictedRun, Prediction};
use crate::quantity::Quantity;

/// Summary, table of runs and remarks.
pub fn summary(report: &Report) -> String {
    let mut text = remarks::summary(report) + "\n";
    if !report.campaign.runs.is_empty() {
        let _ = write!(
            text,
            "\n{}",
            runs(&report.prediction, &report.campaign.runs)
        );
    }
    for remark in &report.remarks {
        let mark = match remark.severity {
            Severity::Warning => "WARNING",
            Severity::Note => "note",
        };
        let _ = writeln!(text, "\n{mark}: {}. {}", remark.heading, remark.text);
    }
    text
}

/// The vibration errors of runs, predicted and measured, as a table.
pub fn runs(prediction: &Prediction, runs: &[Run]) -> String {
    let mut text = format!(
        "instrument {}, vibration error in 1e-6 g, standard uncertainties in units of the last digits\n\n",
        prediction.serial
    );
    let _ = writeln!(
        text,
        "{:>5}  {:<25} {:>7} {:>18} {:>18} {:>18}",
        "run", "vibration", "a0_I/g", "from static test", "static + shaker", "measured"
    );
    let cell =
        |quantity: Option<Quantity>| quantity.map_or("-".into(), |q| q.scaled(1e6).to_string());
    for (predicted, run) in prediction.runs.iter().zip(runs) {
        let PredictedRun {
            vre_g,
            refit_vre_g,
            measured_vre_g,
            ..
        } = predicted;
        let _ = writeln!(
            text,
            "{:>5}  {:<25} {:>7.3} {:>18} {:>18} {:>18}",
            run.run,
            vibration(run),
            run.specific_force_g.i,
            cell(Some(*vre_g)),
            cell(*refit_vre_g),
            cell(*measured_vre_g),
        );
    }
    text
}

/// A run's vibration in a few words.
pub fn vibration(run: &Run) -> String {
    let [low, high] = run.band_hz;
    match run.kind {
        VibrationKind::Sine => format!("sine {} g, {low} Hz", run.level_g),
        VibrationKind::Random => format!("random {} g, {low}-{high} Hz", run.level_g),
    }
}
