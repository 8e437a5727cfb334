//! Raw tables in many dialects: rests and a vibration, with hostile cells; measured.

use std::fs;
use std::path::Path;

use arbitrary::Unstructured;
use host::error::Error;
use host::gate;
use host::import::Columns;
use host::measure::{Calibration, Measurement, Request, measure};

use crate::draw::{below, number, one_in, one_of, spoil, unit};
use crate::{Fuzz, Judged, proper};

/// The target.
pub struct Tables;

/// A record at rest, shaken and at rest again, before it becomes text.
struct Made {
    time_s: Vec<f64>,
    output_v: Vec<f64>,
}

impl Made {
    fn new(draw: &mut Unstructured<'_>) -> Self {
        let count = 3 * (40 + below(draw, 400));
        let rate_hz = *one_of(draw, &[1.0, 100.0, 1000.0]);
        let level_v = 2.0 * unit(draw);
        let time_s: Vec<f64> = (0..count).map(|n| n as f64 / rate_hz).collect();
        let during = count / 3..2 * count / 3;
        let mut noise = 1_u32;
        let output = |n: usize| {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise_v = 1e-4 * (f64::from(noise) / f64::from(u32::MAX) - 0.5);
            let wave = level_v * (1.3 * n as f64).sin();
            1.0 + noise_v
                + if during.contains(&n) {
                    wave + 1e-3
                } else {
                    0.0
                }
        };
        Self {
            output_v: (0..count).map(output).collect(),
            time_s,
        }
    }

    fn text(&self, (separator, comma): (char, bool)) -> String {
        let mut text = format!("t{separator}u\n");
        for (time, output) in self.time_s.iter().zip(&self.output_v) {
            let row = format!("{time}{separator}{output}\n");
            text += &if comma { row.replace('.', ",") } else { row };
        }
        text
    }
}

/// Dialects: what separates cells, and whether the decimal sign is a comma.
const DIALECTS: [(char, bool); 4] = [(',', false), (';', true), ('\t', false), ('\t', true)];

fn measured(file: &Path, text: &[u8], units_per_g: f64) -> Result<Measurement, Error> {
    fs::write(file, text).map_err(Error::write(file))?;
    let request = Request {
        columns: Columns {
            outputs: vec!["u".into()],
            time: Some(("t".into(), 1.0)),
            temperature: None,
        },
        selection: None,
        run: None,
        calibration: Calibration {
            units_per_g,
            full_scale_g: Some(10.0),
            temperature_sensitivity_g_per_c: None,
        },
    };
    let found = measure(file, &request)?;
    gate::check(&found)?;
    Ok(found)
}

/// Each shift, and its standard uncertainty, g.
fn shifts(found: &Measurement) -> Vec<(f64, f64)> {
    found
        .axes
        .iter()
        .filter_map(|axis| axis.shift_g.known())
        .collect()
}

/// The same record in other units, and later, gives the same shift.
fn same(draw: &mut Unstructured<'_>, file: &Path, made: &Made) -> Judged {
    let original = measured(file, made.text(DIALECTS[0]).as_bytes(), 1.2);
    let (what, other, units_per_g) = match below(draw, 2) {
        0 => (
            "volts as millivolts",
            made.output_v.iter().map(|u| u * 1e3).collect(),
            1.2e3,
        ),
        _ => ("time shifted", made.output_v.clone(), 1.2),
    };
    let shift_s = if what == "time shifted" { 1024.0 } else { 0.0 };
    let other = Made {
        time_s: made.time_s.iter().map(|t| t + shift_s).collect(),
        output_v: other,
    };
    let other = measured(
        file,
        other.text(*one_of(draw, &DIALECTS)).as_bytes(),
        units_per_g,
    );
    match (&original, &other) {
        (Ok(a), Ok(b)) => {
            let (a, b) = (shifts(a), shifts(b));
            let near =
                |((a, sigma), (b, _)): (&(f64, f64), &(f64, f64))| (a - b).abs() <= 1e-2 * sigma;
            match a.len() == b.len() && a.iter().zip(&b).all(near) {
                true => Ok(()),
                false => Err(format!("{what}: {a:?} becomes {b:?}")),
            }
        }
        (Err(a), Err(b)) => proper(a).and(proper(b)),
        _ => Err(format!(
            "{what}: {:?} on one side alone",
            original.err().or(other.err())
        )),
    }
}

impl Fuzz for Tables {
    fn input(&mut self, draw: &mut Unstructured<'_>) -> Judged {
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        let file = folder.path().join("record.csv");
        let made = Made::new(draw);
        if one_in(draw, 4) {
            return same(draw, &file, &made);
        }
        let dialect = *one_of(draw, &DIALECTS);
        let mut lines: Vec<String> = made.text(dialect).lines().map(str::to_owned).collect();
        for _ in 0..=below(draw, 4) {
            let row = below(draw, lines.len());
            let end = lines[row].find(dialect.0).unwrap_or(0);
            let (time, output) = lines[row].split_at(end);
            lines[row] = match below(draw, 3) {
                0 => format!(
                    "{time}{}{}",
                    dialect.0,
                    number(draw, output.trim_start_matches(dialect.0))
                ),
                1 => format!("{}{output}", number(draw, time)),
                _ => String::new(),
            };
        }
        let mut bytes = (lines.join("\n") + "\n").into_bytes();
        if one_in(draw, 8) {
            spoil(draw, &mut bytes);
        }
        measured(&file, &bytes, 1.2)
            .map(drop)
            .or_else(|error| proper(&error))
    }

    fn file(&mut self, path: &Path) -> Judged {
        let bytes = fs::read(path).map_err(|error| error.to_string())?;
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        let answer = measured(&folder.path().join("record.csv"), &bytes, 1.2);
        answer.map(drop).or_else(|error| proper(&error))
    }
}
