//! Folders of a campaign: cells, rows and columns of its tables and keys of its campaign.toml are changed in a sound one.

use std::fs;
use std::path::Path;

use arbitrary::Unstructured;
use host::bench::effects;
use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Specification, VirtualBench};
use host::campaign::{Campaign, write_runs};
use host::contradictions;
use host::diagnose::{Identified, diagnose, static_test};
use host::error::Error;
use host::gate;
use host::prediction::predict;
use host::statics::{Method, identify};
use tempfile::TempDir;

use crate::draw::{below, number, one_in, one_of, spoil};
use crate::{Fuzz, Judged, proper, same};

const FILES: [&str; 3] = ["campaign.toml", "static.csv", "vibration.csv"];

/// Runs of the sound campaigns: enough for every kind, few enough to be quick.
const RUNS: usize = 16;

/// The target, with sound campaigns to start from.
pub struct Campaigns {
    sound: Vec<[String; 3]>,
    folder: TempDir,
}

/// A simulated campaign of few runs, as it lies on the disk.
pub fn simulated(
    folder: &Path,
    seed: u64,
    statics: Static,
    effect: Option<&str>,
) -> Result<(), Error> {
    let drawn = effect.and_then(effects::find).map(|entry| {
        let mut stream = Seed(seed).stream("effect", 0);
        (entry.draw)(3.0, &mut stream)
    });
    let specification = Specification::with_dial_sigma(1.0);
    let bench = VirtualBench::new(Seed(seed), statics, specification, Vec::from_iter(drawn));
    let simulation = bench.simulate();
    let mut campaign = simulation.campaign;
    campaign.runs.truncate(RUNS);
    campaign.write(folder)?;
    write_runs(&folder.join("holdout.csv"), &simulation.holdout)
}

impl Campaigns {
    pub fn new() -> Result<Self, Error> {
        let folder = TempDir::new().map_err(Error::write(Path::new("a folder")))?;
        let mut sound = Vec::new();
        for (seed, statics, effect) in [
            (1, Static::Default, None),
            (2, Static::Remounted, Some("fixture-resonance")),
            (3, Static::Paper, Some("drift")),
        ] {
            simulated(folder.path(), seed, statics, effect)?;
            let read = |name: &str| fs::read_to_string(folder.path().join(name));
            let mut texts = <[String; 3]>::default();
            for (text, name) in texts.iter_mut().zip(FILES) {
                *text = read(name).map_err(Error::read(Path::new(name)))?;
            }
            sound.push(texts);
        }
        Ok(Self { sound, folder })
    }
}

/// Changes a cell, a row or a column of a table.
fn table(draw: &mut Unstructured<'_>, text: &str) -> String {
    let mut rows: Vec<Vec<String>> = text
        .lines()
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    let row = 1 + below(draw, rows.len() - 1);
    let column = below(draw, rows[0].len());
    match below(draw, 9) {
        0..=3 => rows[row][column] = number(draw, &rows[row][column]),
        4 => {
            let value = number(draw, &rows[row][column]);
            rows[1..]
                .iter_mut()
                .for_each(|cells| cells[column].clone_from(&value));
        }
        5 => rows[1..].iter_mut().for_each(|cells| {
            if let Ok(cell) = cells[column].parse::<f64>() {
                cells[column] = format!("{:e}", cell * 1e3);
            }
        }),
        6 => drop(rows.remove(row)),
        7 => rows.iter_mut().for_each(|cells| drop(cells.remove(column))),
        _ => rows.truncate(row + 1),
    }
    let lines: Vec<String> = rows.iter().map(|cells| cells.join(",")).collect();
    lines.join("\n") + "\n"
}

/// Changes the value of a key, or drops it.
fn keys(draw: &mut Unstructured<'_>, text: &str) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let line = below(draw, lines.len());
    match lines[line].split_once(" = ") {
        Some((key, value)) if !one_in(draw, 6) => {
            lines[line] = format!("{key} = {}", number(draw, value));
        }
        _ => drop(lines.remove(line)),
    }
    lines.join("\n") + "\n"
}

impl Fuzz for Campaigns {
    fn input(&mut self, draw: &mut Unstructured<'_>) -> Judged {
        let mut texts = one_of(draw, &self.sound).clone();
        for _ in 0..=below(draw, 3) {
            match below(draw, 8) {
                0 | 1 => texts[0] = keys(draw, &texts[0]),
                2..=4 => texts[1] = table(draw, &texts[1]),
                _ => texts[2] = table(draw, &texts[2]),
            }
            if texts.iter().any(|text| text.lines().count() < 2) {
                break;
            }
        }
        for (text, name) in texts.into_iter().zip(FILES) {
            let mut bytes = text.into_bytes();
            if one_in(draw, 40) {
                spoil(draw, &mut bytes);
            }
            fs::write(self.folder.path().join(name), bytes).map_err(|e| e.to_string())?;
        }
        let with_diagnosis = one_in(draw, 4);
        let Some(campaign) = check(self.folder.path(), with_diagnosis)? else {
            return Ok(());
        };
        same::check(draw, &campaign)
    }

    fn file(&mut self, path: &Path) -> Judged {
        match check(path, true)? {
            Some(campaign) => same::check_all(&campaign),
            None => Ok(()),
        }
    }

    fn keep(&self, to: &Path) -> std::io::Result<()> {
        fs::create_dir_all(to)?;
        FILES
            .iter()
            .try_for_each(|name| fs::copy(self.folder.path().join(name), to.join(name)).map(drop))
    }
}

/// Reads, identifies, predicts and, if asked, diagnoses a folder: refused properly, or with sense. The campaign, if it was
/// gone through.
pub fn check(folder: &Path, with_diagnosis: bool) -> Result<Option<Campaign>, String> {
    match answers(folder, with_diagnosis) {
        Ok(campaign) => Ok(Some(campaign)),
        Err(error) => proper(&error).map(|()| None),
    }
}

fn answers(folder: &Path, with_diagnosis: bool) -> Result<Campaign, Error> {
    let campaign = Campaign::read(folder)?.used();
    if campaign.readings.is_empty() {
        return Err(Error::Usage("no reading is left".into()));
    }
    contradictions::check(folder, &campaign, false)?;
    let judged = static_test(&campaign);
    let identification = identify(&judged.belonging, Method::LeastSquares, None)?;
    gate::check(&Identified::new(&identification, &judged))?;
    if !campaign.runs.is_empty() {
        gate::check(&predict(&campaign, &campaign.runs, None)?)?;
    }
    if with_diagnosis {
        let study = diagnose(&campaign, &[])?;
        gate::check(&study.diagnosis)?;
        let total: f64 = study
            .diagnosis
            .which
            .iter()
            .map(|which| which.probability)
            .sum();
        if total > 1.0 + 1e-9 {
            return Err(Error::Absurd {
                field: "sum of which[..].probability".into(),
                value: total,
            });
        }
        host::report::diagnosis_page(&study)?;
    }
    Ok(campaign)
}
