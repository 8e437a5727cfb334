//! The report as text for a terminal.

use std::fmt::Write as _;

use super::Report;
use super::remarks::{self, Severity};
use crate::campaign::{Run, VibrationKind};
use crate::prediction::{PredictedRun, Prediction};
use crate::quantity::{Quantity, fixed, significant};

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

/// The vibration errors of runs, predicted and measured, as a table that is as wide as its cells ask for; a column that no run
/// has a value in is left out.
pub fn runs(prediction: &Prediction, runs: &[Run]) -> String {
    let mut text = format!(
        "instrument {}, vibration error in 1e-6 g, a0_I in g,\nstandard uncertainties in units of the last digits\n\n",
        prediction.serial
    );
    type Of = fn(&PredictedRun) -> Option<Quantity>;
    let quantities: [(&str, Of); 4] = [
        ("static test", |run| Some(run.vre_g)),
        ("+ shaker", |run| run.refit_vre_g),
        ("+ effects", |run| run.with_effects_vre_g),
        ("measured", |run| run.measured_vre_g),
    ];
    let mut columns: Vec<Vec<String>> = [
        column("run", runs, |run| run.run.to_string()),
        column("vibration, Hz", runs, shaken),
        column("along", runs, |run| along(run.direction)),
        column("a0_I", runs, |run| fixed(run.specific_force_g.i, 2)),
    ]
    .into();
    for (name, of) in quantities {
        if prediction.runs.iter().any(|run| of(run).is_some()) {
            let cell = |run: &PredictedRun| {
                of(run).map_or("-".into(), |quantity| quantity.scaled(1e6).to_string())
            };
            columns.push(column(name, &prediction.runs, cell));
        }
    }
    let width = |column: &Vec<String>| column.iter().map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = columns
        .iter()
        .map(|column| width(column).unwrap_or(0))
        .collect();
    for row in 0..=runs.len() {
        let cells = columns.iter().zip(&widths).enumerate();
        let cells = cells.map(|(index, (column, width))| match index {
            1 | 2 => format!("{:<width$}", column[row]),
            _ => format!("{:>width$}", column[row]),
        });
        let _ = writeln!(text, "{}", cells.collect::<Vec<_>>().join(" "));
    }
    text
}

/// A column's name and cells.
fn column<R>(name: &str, rows: &[R], cell: impl Fn(&R) -> String) -> Vec<String> {
    std::iter::once(name.to_owned())
        .chain(rows.iter().map(cell))
        .collect()
}

/// A direction in instrument axes: `I`, `-P`, `I+O` of equal parts, else each part with its axis.
pub fn along(direction: [f64; 3]) -> String {
    let parts: Vec<(f64, char)> = direction
        .into_iter()
        .zip(['I', 'P', 'O'])
        .filter(|(part, _)| part.abs() >= 5e-4)
        .collect();
    let first = parts.first().map_or(0.0, |(part, _)| part.abs());
    let alike = parts
        .iter()
        .all(|(part, _)| (part.abs() - first).abs() < 1e-3);
    let written = parts.iter().enumerate().map(|(index, (part, axis))| {
        let sign = match (*part < 0.0, index) {
            (true, _) => "-",
            (false, 0) => "",
            (false, _) => "+",
        };
        let size = match alike {
            true => String::new(),
            false => significant(part.abs(), 2),
        };
        format!("{sign}{size}{axis}")
    });
    written.collect()
}

/// A run's vibration in a column of those in Hz.
fn shaken(run: &Run) -> String {
    vibration(run).replace([','], "").replace(" Hz", "")
}

/// A run's vibration in a few words.
pub fn vibration(run: &Run) -> String {
    let [low, high] = run.band_hz.map(|hz| significant(hz, 5));
    let level = significant(run.level_g, 4);
    match run.kind {
        VibrationKind::Sine => format!("sine {level} g, {low} Hz"),
        VibrationKind::Random => format!("random {level} g, {low}-{high} Hz"),
    }
}

#[cfg(test)]
mod tests {
    use super::along;

    #[test]
    fn a_direction_is_named_by_its_axes() {
        let root = 0.5_f64.sqrt();
        for (direction, named) in [
            ([1.0, 0.0, 0.0], "I"),
            ([0.0, -1.0, 0.0], "-P"),
            ([root, 0.0, -root], "I-O"),
            ([0.6, 0.8, 0.0], "0.6I+0.8P"),
        ] {
            assert_eq!(along(direction), named);
        }
    }
}
