//! Writes what the command answers for some hundreds of simulated campaigns, so that a change which should change
//! nothing can be shown to change nothing.
//!
//! ```text
//! cargo run --release -p host --example pin -- target/release/vre pinned/campaigns pinned/before
//! ... the change ...
//! cargo run --release -p host --example pin -- target/release/vre pinned/campaigns pinned/after
//! diff -r pinned/before pinned/after
//! ```
//!
//! Campaigns that are there already are used as they are.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use host::bench::effects;
use rayon::prelude::*;

/// A campaign to simulate: its name, the options of `vre simulate`, and what is taken out of its tables.
struct Case {
    name: String,
    options: Vec<String>,
    without: Without,
}

#[derive(Clone, Copy, PartialEq)]
enum Without {
    Nothing,
    Runs,
    Reference,
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [vre, campaigns, answers] = &arguments[..] else {
        return Err("usage: pin VRE CAMPAIGNS ANSWERS".into());
    };
    fs::create_dir_all(answers)?;
    let cases = cases();
    cases.par_iter().try_for_each(|case| {
        let folder = campaigns.join(&case.name);
        if !folder.exists() {
            simulate(vre, case, &folder)?;
        }
        answer(vre, &folder, &answers.join(&case.name))
    })?;
    println!(
        "{} campaigns answered in {}",
        cases.len(),
        answers.display()
    );
    Ok(())
}

/// All effects at two strengths, pairs, nothing; each plan; with and without runs and reference.
fn cases() -> Vec<Case> {
    let ids: Vec<&str> = effects::catalogue().map(|entry| entry.id).collect();
    let mut cases = Vec::new();
    let mut add = |acting: &[&str], seed: usize, options: &[&str], without| {
        let mut words: Vec<String> = options.iter().map(|word| (*word).into()).collect();
        words.extend(["--seed".into(), seed.to_string()]);
        for id in acting {
            words.extend(["--effect".into(), (*id).into()]);
        }
        let acting = if acting.is_empty() {
            "none".into()
        } else {
            acting.join("+")
        };
        cases.push(Case {
            name: format!("{:03}-{acting}", cases.len()),
            options: words,
            without,
        });
    };
    for (k, id) in ids.iter().enumerate() {
        for (visibility, plan) in [("30", "default"), ("300", "default"), ("100", "remounted")] {
            let options = ["--visibility", visibility, "--plan", plan];
            add(&[id], 1000 + k, &options, Without::Nothing);
        }
        let next = ids[(k * 7 + 5) % ids.len()];
        if next != *id {
            add(
                &[id, next],
                2000 + k,
                &["--visibility", "100"],
                Without::Nothing,
            );
        }
        add(
            &[id],
            3000 + k,
            &["--visibility", "100"],
            Without::Reference,
        );
        add(&[id], 4000 + k, &["--strength", "3"], Without::Runs);
    }
    for seed in 0..20 {
        for plan in ["default", "remounted", "paper"] {
            add(&[], 5000 + seed, &["--plan", plan], Without::Nothing);
        }
        add(
            &[],
            6000 + seed,
            &["--dial-sigma", "5.8"],
            Without::Reference,
        );
    }
    cases
}

fn simulate(vre: &Path, case: &Case, folder: &Path) -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut command = Command::new(vre);
    command
        .args(["simulate", "--quiet", "--out"])
        .arg(folder)
        .args(&case.options);
    if !command.output()?.status.success() {
        // No strength of this effect is seen so well here: a campaign of its typical size instead.
        let mut plain = case.options.clone();
        if let Some(at) = plain.iter().position(|word| word == "--visibility") {
            plain.drain(at..at + 2);
        }
        let mut command = Command::new(vre);
        command
            .args(["simulate", "--quiet", "--out"])
            .arg(folder)
            .args(plain);
        if !command.output()?.status.success() {
            return Err(format!("{}: cannot be simulated", case.name).into());
        }
    }
    let table = folder.join("vibration.csv");
    match case.without {
        Without::Nothing => {}
        Without::Runs => fs::remove_file(&table)?,
        Without::Reference => without_reference(&table)?,
    }
    Ok(())
}

/// Takes the reference's columns out of a table of runs.
fn without_reference(table: &Path) -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut reader = csv::Reader::from_path(table)?;
    let headers = reader.headers()?.clone();
    let kept = |record: &csv::StringRecord| -> csv::StringRecord {
        let cells = headers.iter().zip(record);
        cells
            .filter(|(name, _)| !name.starts_with("ref_"))
            .map(|(_, cell)| cell)
            .collect()
    };
    let mut rows = vec![kept(&headers)];
    for record in reader.records() {
        rows.push(kept(&record?));
    }
    let mut writer = csv::Writer::from_path(table)?;
    for row in &rows {
        writer.write_record(row)?;
    }
    Ok(writer.flush()?)
}

/// Writes every command's text, JSON and errors for one campaign below `answers`.
fn answer(vre: &Path, folder: &Path, answers: &Path) -> Result<(), Box<dyn Error + Send + Sync>> {
    fs::create_dir_all(answers)?;
    let diagnosis = answers.join("diagnosis.json");
    let holdout = folder.join("holdout.csv");
    let commands: [(&str, Vec<&std::ffi::OsStr>); 4] = [
        ("identify", vec![]),
        ("diagnose", vec![]),
        ("predict", vec!["--runs".as_ref(), holdout.as_ref()]),
        (
            "predict",
            vec![
                "--runs".as_ref(),
                holdout.as_ref(),
                "--diagnosis".as_ref(),
                diagnosis.as_ref(),
            ],
        ),
    ];
    let names = [
        "identification",
        "diagnosis",
        "prediction",
        "prediction-with-effects",
    ];
    for ((command, options), name) in commands.iter().zip(names) {
        let json = answers.join(format!("{name}.json"));
        let output = Command::new(vre)
            .arg(command)
            .arg(folder)
            .args(options)
            .arg("--json")
            .arg(&json)
            .env("COLUMNS", "100")
            .output()?;
        let text = [output.stdout, output.stderr].concat();
        // Where campaign and answers lie is no part of the answer.
        let text = String::from_utf8_lossy(&text).replace(&*folder.to_string_lossy(), "CAMPAIGN");
        let text = text.replace(&*answers.to_string_lossy(), "ANSWERS");
        fs::write(answers.join(format!("{name}.txt")), text)?;
    }
    Ok(())
}
