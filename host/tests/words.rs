//! What the terminal explains, templates, completions, and what is said of slips.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use host::campaign::Campaign;
use host::campaign::columns::TABLES;
use host::handbook::Topic;
use refusal::refused;
use serde_json::Value;

mod common;
#[path = "common/refusal.rs"]
mod refusal;

/// Runs the command, which must be done.
fn vre(arguments: &[&str]) -> String {
    let assert = Command::cargo_bin("vre").unwrap().args(arguments).assert();
    String::from_utf8(assert.success().get_output().stdout.clone()).unwrap()
}

fn of(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn every_topic_and_every_effect_is_explained_within_eighty_columns() {
    for topic in Topic::ALL {
        let text = vre(&["help", topic.name()]);
        assert!(text.lines().count() > 8, "{text}");
        for line in text.lines() {
            assert!(line.chars().count() <= 80, "{}: {line}", topic.name());
        }
    }
    let listed = vre(&["effects"]);
    for effect in host::effects::catalogue() {
        assert!(listed.contains(effect.id), "{}", effect.id);
        let text = vre(&["effects", effect.id]);
        assert!(
            text.lines().all(|line| line.chars().count() <= 80),
            "{text}"
        );
        assert!(text.contains(effect.says) || text.contains(&effect.says[..40]));
    }
    assert!(vre(&["help", "identify"]).contains("Usage: vre identify"));
    assert!(vre(&["help"]).contains("verdicts"));
}

#[test]
fn every_column_that_a_campaign_is_written_with_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let mut campaign = common::campaign();
    campaign.readings[0].session = Some("a".into());
    campaign.readings[0].exclude = true;
    campaign.runs[0].session = Some("b".into());
    campaign.runs[0].exclude = true;
    campaign.write(folder.path()).unwrap();
    for table in &TABLES[..2] {
        let text = fs::read_to_string(folder.path().join(table.file)).unwrap();
        let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let known: Vec<&str> = table.columns.iter().map(|column| column.name).collect();
        for name in &names {
            assert!(known.contains(name), "{name}");
        }
        assert_eq!(names.len(), known.len(), "{}", table.file);
    }
}

/// The template with its required keys taken in and its tables filled from a simulated campaign.
#[test]
fn a_template_that_is_filled_in_is_a_campaign() {
    for workbook in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let made = folder.path().join("made");
        let more: &[&str] = if workbook { &["--xlsx"] } else { &[] };
        vre(&[&["template", of(&made), "--plan", "paper"], more].concat());
        let again = refused(&["template", of(&made)]);
        assert!(again.contains("holds campaign.toml"), "{again}");
        let head = made.join("campaign.toml");
        let text = fs::read_to_string(&head).unwrap();
        let required = text.lines().filter(|line| line.contains("# REQUIRED:"));
        let required = required.filter(|line| !line.contains("reference_rms_rel_sigma"));
        assert!(required.count() > 7, "{text}");
        let incomplete = refused(&["identify", of(&made)]);
        assert!(incomplete.contains("campaign.toml, row"), "{incomplete}");
        let filled = text.lines().map(|line| match line.strip_prefix("# ") {
            Some(key) if key.contains("# REQUIRED:") && !key.starts_with("reference_rms") => key,
            _ => line,
        });
        fs::write(&head, filled.collect::<Vec<_>>().join("\n")).unwrap();
        let empty = refused(&["identify", of(&made)]);
        assert!(empty.contains("column time_s: is empty"), "{empty}");
        if workbook {
            continue;
        }
        let table = made.join("static.csv");
        let text = fs::read_to_string(&table).unwrap();
        let rows = text.lines().map(
            |line| match line.split(',').next().unwrap().parse::<u32>() {
                // order,time_s,series,dial_deg,mount_deg,approach,temp_c,u_v,sigma_v,session
                Ok(order) => {
                    let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
                    let series = cells[2].parse::<u8>().unwrap();
                    let series = host::campaign::Series::try_from(series).unwrap();
                    let angle = cells[3].parse::<f64>().unwrap().to_radians();
                    cells[1] = (90 * order).to_string();
                    cells[6] = "22".into();
                    cells[7] = (1.2 * series.specific_force(angle).i).to_string();
                    cells[8] = "2e-6".into();
                    cells.join(",")
                }
                Err(_) => line.to_owned(),
            },
        );
        fs::write(&table, rows.collect::<Vec<_>>().join("\n")).unwrap();
        assert_eq!(Campaign::read(&made).unwrap().readings.len(), 48);
        assert!(vre(&["identify", of(&made)]).contains("K1_v_per_g"));
    }
}

#[test]
fn completions_and_manual_pages_know_every_command() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let text = vre(&["completions", shell]);
        for command in ["identify", "template", "blind-check"] {
            assert!(text.contains(command), "{shell}: {command}");
        }
    }
    let folder = tempfile::tempdir().unwrap();
    vre(&["completions", "--man", of(folder.path())]);
    for page in ["vre.1", "vre-identify.1", "vre-template.1"] {
        assert!(folder.path().join(page).exists(), "{page}");
    }
    refused(&["completions"]);
}

#[test]
fn a_slip_is_answered_with_what_is_like_it() {
    assert!(refused(&["identfy", "x"]).contains("'identify'"));
    assert!(refused(&["identify", "x", "--prior-sgma", "1"]).contains("--prior-sigma"));
    assert!(refused(&["effects", "fixture-resonace"]).contains("is fixture-resonance meant?"));
    assert!(refused(&["help", "colums"]).contains("is columns meant?"));
    assert!(refused(&["help", "zzzz"]).contains("see `vre help`"));
}

#[test]
fn a_failure_is_an_object_for_programs() {
    let folder = tempfile::tempdir().unwrap();
    common::campaign().write(folder.path()).unwrap();
    let table = folder.path().join("static.csv");
    let text = fs::read_to_string(&table).unwrap();
    fs::write(&table, text.replacen("22.5", "warm", 1)).unwrap();
    let failure = |arguments: &[&str]| -> Value {
        let mut command = Command::cargo_bin("vre").unwrap();
        let assert = command.args(arguments).assert().code(2);
        serde_json::from_slice(&assert.get_output().stdout).unwrap()
    };
    let found = failure(&["identify", of(folder.path()), "--json", "-"]);
    assert_eq!(found["format"], "vre-error/1");
    assert_eq!(found["file"], of(&table));
    assert_eq!(
        (&found["row"], &found["column"]),
        (&2.into(), &"temp_c".into())
    );
    assert_eq!(found["exit_status"], 2);
    for usage in [
        ["identfy", "--json=-"].as_slice(),
        &["identify", "--json", "-"],
    ] {
        assert_eq!(failure(usage)["format"], "vre-error/1");
    }
}

#[test]
fn what_would_do_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for arguments in [
        ["simulate", "--out", of(&out), "--strength", "2"].as_slice(),
        &[
            "simulate",
            "--out",
            of(&out),
            "--strength",
            "2",
            "--effect",
            "none",
        ],
        &["blind-check", "--campaigns", "0"],
    ] {
        refused(arguments);
        assert!(!out.exists());
    }
}

#[test]
fn the_table_of_predictions_fits_eighty_columns_and_shows_directions() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    vre(&["simulate", "--out", of(&out), "--seed", "3"]);
    let text = vre(&["predict", of(&out)]);
    for line in text.lines() {
        assert!(line.chars().count() <= 80, "{line}");
    }
    assert!(text.contains(" along ") && text.contains(" I+O "), "{text}");
    let escapes = Command::cargo_bin("vre")
        .unwrap()
        .env("NO_COLOR", "1")
        .arg("help")
        .assert();
    assert!(!escapes.get_output().stdout.contains(&0x1b));
}
