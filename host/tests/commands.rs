//! Commands that no other test runs, as a user runs them: `plan`, `paper`, `blind-check`, `unseal`, and what `identify` and
//! `predict` say of a plan that is nearly blind.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use host::campaign::Campaign;
use serde_json::Value;
use sha2::{Digest, Sha256};

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Runs the command; its text and its JSON.
fn vre(arguments: &[&str]) -> Outcome<(String, Value)> {
    let folder = tempfile::tempdir()?;
    let json = folder.path().join("result.json");
    let mut command = Command::cargo_bin("vre")?;
    let assert = command.args(arguments).arg("--json").arg(&json).assert();
    let text = String::from_utf8(assert.success().get_output().stdout.clone())?;
    Ok((text, serde_json::from_slice(&fs::read(json)?)?))
}

/// Runs the command, which must refuse in one line.
fn refused(arguments: &[&str]) -> Outcome<String> {
    let assert = Command::cargo_bin("vre")?.args(arguments).assert().code(2);
    let told = String::from_utf8(assert.get_output().stderr.clone())?;
    assert_eq!(told.lines().count(), 1, "{told}");
    Ok(told)
}

fn simulate(folder: &Path, more: &[&str]) -> Outcome<PathBuf> {
    let out = folder.join("campaign");
    let mut command = Command::cargo_bin("vre")?;
    command.arg("simulate").arg("--out").arg(&out).args(more);
    command.assert().success();
    Ok(out)
}

fn text_of(path: &Path) -> Outcome<&str> {
    path.to_str().ok_or_else(|| "not UTF-8".into())
}

#[test]
fn plan_tells_what_the_papers_positions_leave_blind_and_that_remounting_helps() -> Outcome {
    let (text, plan) = vre(&["plan", "paper", "--dial-sigma", "5.8"])?;
    assert!(text.contains("24 readings, rank 10 of 11"), "{text}");
    assert!(text.contains("BLIND along"), "{text}");
    assert_eq!(plan["format"], "vre-plan/1");
    assert_eq!(plan["plan"]["coefficient_sigma"]["k2_per_g"], Value::Null);
    // 0.65 per unit along the blind direction, at a prior of 5e-4.
    let blind_g = plan["plan"]["environments"][0]["blind_sigma_g"].as_f64();
    assert!(blind_g.is_some_and(|g| (g / 5e-4 - 0.65).abs() < 0.01));
    assert_eq!(plan["remounted"]["rank"], 10);

    let (_, full) = vre(&["plan", "full", "--dial-sigma", "5.8"])?;
    let sigma_g = |of: &str| full[of]["environments"][0]["readings_sigma_g"].as_f64();
    assert_eq!(full["plan"]["rank"], 11);
    // The table of closure: 162 and 17 microg for the same 80 readings.
    for (of, known_g) in [("twice", 162e-6), ("remounted", 17e-6)] {
        let found_g = sigma_g(of).ok_or("a number")?;
        assert!((found_g / known_g - 1.0).abs() < 0.03, "{of}: {found_g}");
    }
    Ok(())
}

#[test]
fn plan_searches_a_best_plan_also_where_the_dial_leaves_much_to_the_prior() -> Outcome {
    for dial_sigma in ["5.8", "3600"] {
        let (text, plan) = vre(&["plan", "full", "--dial-sigma", dial_sigma, "--best", "14"])?;
        assert!(text.contains("Best plan found"), "{text}");
        assert_eq!(plan["best"]["positions"].as_array().map(Vec::len), Some(14));
    }
    Ok(())
}

#[test]
fn paper_prints_both_tables_and_that_no_vibration_weights_k4_as_they_ask() -> Outcome {
    let (text, paper) = vre(&["paper"])?;
    assert!(text.contains("AKS-05") && text.contains("A-15") && text.contains("AL-1"));
    assert_eq!(paper["format"], "vre-paper/1");
    let weights = &paper["weights"];
    for (k, known) in [0.92, 1.38, -2.14].into_iter().enumerate() {
        let found = weights["from_computed"][k].as_f64().ok_or("a number")?;
        assert!((found - known).abs() < 0.005, "{found} {known}");
    }
    assert_eq!(paper["instruments"].as_array().map(Vec::len), Some(3));
    Ok(())
}

#[test]
fn blind_check_scores_every_campaign_that_it_was_asked_for() -> Outcome {
    let (text, board) = vre(&["blind-check", "--campaigns", "3", "--seed", "5"])?;
    assert!(text.contains("effect"), "{text}");
    assert_eq!(board["format"], "vre-blind-check/1");
    let outcomes = board["outcomes"].as_array().ok_or("a list")?;
    assert_eq!(outcomes.len(), 3);
    for outcome in outcomes {
        let probability = outcome["probability"].as_f64().ok_or("a number")?;
        assert!((0.0..=1.0).contains(&probability), "{outcome}");
    }
    Ok(())
}

#[test]
fn a_seal_opens_after_a_diagnosis_of_its_campaign_and_for_nothing_else() -> Outcome {
    let folder = tempfile::tempdir()?;
    let campaign = simulate(folder.path(), &["--effect", "sealed"])?;
    assert!(!campaign.join("truth.json").exists());
    let diagnosis = campaign.join("diagnosis.json");
    let (at, file) = (text_of(&campaign)?, text_of(&diagnosis)?);
    refused(&["unseal", at, "--diagnosis", file])?;
    fs::write(&diagnosis, "{}")?;
    refused(&["unseal", at, "--diagnosis", file])?;

    let mut command = Command::cargo_bin("vre")?;
    command.args(["diagnose", at, "--json", file]);
    command.assert().success();
    let (_, opened) = vre(&["unseal", at, "--diagnosis", file])?;
    assert_eq!(opened["format"], "vre-unsealed/1");
    let fingerprint: String = Sha256::digest(fs::read(&diagnosis)?)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    assert_eq!(opened["diagnosis_sha256"], fingerprint);
    let serial = Campaign::read(&campaign)?.config.instrument.serial;
    assert_eq!(opened["truth"]["serial"], serial);
    assert!(
        opened["truth"]["effects"]
            .as_array()
            .is_some_and(|e| e.len() <= 1)
    );

    // A campaign that was touched since.
    let table = campaign.join("static.csv");
    fs::write(&table, fs::read_to_string(&table)? + "\n")?;
    let told = refused(&["unseal", at, "--diagnosis", file])?;
    assert!(told.contains("changed since they were sealed"), "{told}");
    Ok(())
}

/// Rewrites the dial angles of a campaign as an encoder reads them, `step_deg` or two off, and the nominal specific force
/// with them.
fn read_off_an_encoder(campaign: &Path, step_deg: f64) -> Outcome {
    let mut read = Campaign::read(campaign)?;
    for (k, reading) in read.readings.iter_mut().enumerate() {
        let nominal_g = reading.specific_force_g.i;
        reading.dial_deg += step_deg * [0.0, 1.0, -1.0, 2.0, -2.0][k % 5];
        let angle_deg = reading.dial_deg + reading.mount_deg;
        reading.specific_force_g = reading.series.specific_force(angle_deg.to_radians());
        let k1 = read.config.instrument.scale_factor_nominal_v_per_g;
        reading.output_v += k1 * (reading.specific_force_g.i - nominal_g);
    }
    read.runs.clear();
    Ok(read.write(campaign)?)
}

#[test]
fn a_plan_that_is_nearly_blind_is_told_and_predicts_no_worse_than_the_blind_one() -> Outcome {
    let folder = tempfile::tempdir()?;
    let campaign = simulate(folder.path(), &["--plan", "paper", "--dial-sigma", "5.8"])?;
    let holdout = campaign.join("holdout.csv");
    let (at, runs) = (
        text_of(&campaign)?.to_owned(),
        text_of(&holdout)?.to_owned(),
    );
    let sigma_g = || -> Outcome<f64> {
        let (text, prediction) = vre(&["predict", &at, "--runs", &runs])?;
        assert!(text.contains("BLIND"), "{text}");
        let sigma_g = prediction["runs"][0]["vre_g"]["sigma"].as_f64();
        sigma_g.ok_or_else(|| "a number".into())
    };
    read_off_an_encoder(&campaign, 0.0)?;
    let nominal_g = sigma_g()?;
    read_off_an_encoder(&campaign, 1e-3)?;
    let (text, found) = vre(&["identify", &at])?;
    assert!(text.contains("BLIND"), "{text}");
    assert_eq!(found["rank"], 10);
    assert_eq!(found["coefficients"]["k2_per_g"]["value"], Value::Null);
    let ratio = sigma_g()? / nominal_g;
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
    Ok(())
}

#[test]
fn readings_that_do_not_tell_the_scale_factor_are_one_line_and_no_number() -> Outcome {
    let folder = tempfile::tempdir()?;
    let campaign = simulate(folder.path(), &["--dial-sigma", "5.8"])?;
    let mut read = Campaign::read(&campaign)?;
    read.runs.clear();
    // Twelve readings within a millionth of a degree of the horizon.
    read.readings.truncate(12);
    for (k, reading) in read.readings.iter_mut().enumerate() {
        reading.dial_deg = 90.0 + 1e-6 * k as f64;
        reading.series = host::campaign::Series::OutputAxis;
        reading.specific_force_g = reading.series.specific_force(reading.dial_deg.to_radians());
        reading.output_v = 1e-6 * k as f64;
    }
    read.write(&campaign)?;
    let told = refused(&["identify", text_of(&campaign)?])?;
    assert!(told.contains("does not determine"), "{told}");
    Ok(())
}
