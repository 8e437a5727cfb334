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

/// The campaign in `folder`, changed and written into a new folder beside it.
fn changed(campaign: &Path, name: &str, change: impl Fn(&mut Campaign)) -> Outcome<PathBuf> {
    let mut read = Campaign::read(campaign)?;
    change(&mut read);
    let folder = campaign.with_file_name(name);
    read.write(&folder)?;
    Ok(folder)
}

/// All numbers of both answers agree to a part in `1e9`, everything else is the same; `path` is for the message.
fn check_alike(a: &Value, b: &Value, path: &str) {
    match (a, b) {
        (Value::Number(x), Value::Number(y)) => {
            let (x, y) = (x.as_f64().unwrap_or(0.0), y.as_f64().unwrap_or(0.0));
            let alike = (x - y).abs() <= 1e-9 * x.abs().max(y.abs()).max(1e-9);
            assert!(alike, "{path}: {x} {y}");
        }
        (Value::Array(x), Value::Array(y)) => {
            assert_eq!(x.len(), y.len(), "{path}");
            for (k, (x, y)) in x.iter().zip(y).enumerate() {
                check_alike(x, y, &format!("{path}.{k}"));
            }
        }
        (Value::Object(x), Value::Object(y)) => {
            assert_eq!(x.len(), y.len(), "{path}");
            for ((key, x), (other, y)) in x.iter().zip(y) {
                assert_eq!(key, other, "{path}");
                check_alike(x, y, &format!("{path}.{key}"));
            }
        }
        _ => assert_eq!(a, b, "{path}"),
    }
}

/// Turns the output over: every voltage and the factor of the type change their sign.
fn invert(campaign: &mut Campaign) {
    let instrument = &mut campaign.config.instrument;
    instrument.scale_factor_nominal_v_per_g *= -1.0;
    for reading in &mut campaign.readings {
        reading.output_v *= -1.0;
    }
    for measured in campaign
        .runs
        .iter_mut()
        .filter_map(|run| run.measured.as_mut())
    {
        measured.before_v *= -1.0;
        measured.during_v *= -1.0;
        measured.after_v = measured.after_v.map(|after_v| -after_v);
        if let Some(drift) = &mut measured.drift {
            drift.v_per_s *= -1.0;
        }
        if let Some(extremes) = &mut measured.extremes {
            (extremes.minimum_v, extremes.maximum_v) = (-extremes.maximum_v, -extremes.minimum_v);
        }
    }
}

#[test]
fn an_inverted_output_is_an_instrument_like_any_other() -> Outcome {
    let folder = tempfile::tempdir()?;
    let upright = simulate(folder.path(), &["--seed", "7", "--effect", "saturation"])?;
    let inverted = changed(&upright, "inverted", invert)?;
    let (upright, inverted) = (text_of(&upright)?, text_of(&inverted)?);

    let (_, mut a) = vre(&["identify", upright])?;
    let (_, b) = vre(&["identify", inverted])?;
    let k1 = "/coefficients/K1_v_per_g/value";
    let turned = a.pointer(k1).and_then(Value::as_f64).ok_or("a number")?;
    *a.pointer_mut(k1).ok_or("a value")? = (-turned).into();
    // K1's covariances with the others change their sign with it.
    for k in 1..11 {
        for at in [format!("/covariance/0/{k}"), format!("/covariance/{k}/0")] {
            let value = a.pointer(&at).and_then(Value::as_f64).ok_or("a number")?;
            *a.pointer_mut(&at).ok_or("a value")? = (-value).into();
        }
    }
    check_alike(&a, &b, "identify");
    let (_, a) = vre(&["predict", upright])?;
    let (_, b) = vre(&["predict", inverted])?;
    check_alike(&a, &b, "predict");
    let (_, a) = vre(&["diagnose", upright])?;
    let (_, b) = vre(&["diagnose", inverted])?;
    for part in ["verdict", "gap", "location", "shrink"] {
        check_alike(&a[part], &b[part], part);
    }
    assert_eq!(a["which"][0]["effects"], b["which"][0]["effects"]);
    Ok(())
}

#[test]
fn the_time_of_day_at_which_a_campaign_begins_does_not_matter() -> Outcome {
    let folder = tempfile::tempdir()?;
    let at_zero = simulate(folder.path(), &["--seed", "21", "--effect", "drift"])?;
    let (_, a) = vre(&["diagnose", text_of(&at_zero)?])?;
    // Large enough that a cosine of it would tell; a Unix time.
    for (name, offset_s) in [("day", 1e6), ("unix", 1_767_225_600.0)] {
        let later = changed(&at_zero, name, |campaign| {
            campaign
                .readings
                .iter_mut()
                .for_each(|r| r.time_s += offset_s);
            campaign.runs.iter_mut().for_each(|r| r.time_s += offset_s);
        })?;
        let (_, b) = vre(&["diagnose", text_of(&later)?])?;
        check_alike(&a, &b, name);
    }
    Ok(())
}

#[test]
fn excluded_rows_change_nothing_and_their_number_is_told() -> Outcome {
    let folder = tempfile::tempdir()?;
    let whole = simulate(folder.path(), &["--seed", "9"])?;
    let marked = changed(&whole, "marked", |campaign| {
        campaign.readings[4].exclude = true;
        campaign.readings[4].output_v = 0.5;
        campaign.runs[2].exclude = true;
        campaign.runs[2].level_g = 1e-3;
    })?;
    let gone = changed(&whole, "gone", |campaign| {
        campaign.readings.remove(4);
        campaign.runs.remove(2);
    })?;
    for command in ["identify", "predict", "diagnose"] {
        let (text, a) = vre(&[command, text_of(&marked)?])?;
        assert!(
            text.contains("left out as excluded: 1 readings, 1 runs"),
            "{command}: {text}"
        );
        let (_, b) = vre(&[command, text_of(&gone)?])?;
        assert_eq!(a, b, "{command}");
    }
    Ok(())
}

#[test]
fn what_a_laboratory_did_not_measure_is_said_and_the_rest_is_diagnosed() -> Outcome {
    let folder = tempfile::tempdir()?;
    let whole = simulate(
        folder.path(),
        &["--seed", "7", "--effect", "fixture-resonance"],
    )?;
    let lacking = changed(&whole, "lacking", |campaign| {
        for measured in campaign
            .runs
            .iter_mut()
            .filter_map(|run| run.measured.as_mut())
        {
            (measured.after_v, measured.drift, measured.extremes) = (None, None, None);
        }
    })?;
    let (_, found) = vre(&["diagnose", text_of(&lacking)?])?;
    let said = found["not_looked_at"].to_string();
    for part in ["recovery", "drift", "extremes"] {
        assert!(said.contains(part), "{said}");
    }
    assert_ne!(found["verdict"], "no-gap");
    vre(&["predict", text_of(&lacking)?])?;
    Ok(())
}

#[test]
fn a_folder_that_holds_a_campaign_is_written_over_with_force_alone() -> Outcome {
    let folder = tempfile::tempdir()?;
    let out = simulate(folder.path(), &["--seed", "1"])?;
    let at = text_of(&out)?;
    let table = fs::read(out.join("static.csv"))?;
    let told = refused(&["simulate", "--seed", "2", "--out", at])?;
    assert!(told.contains("holds campaign.toml"), "{told}");
    refused(&["capture", "--runs", "0", "--out", at])?;
    assert_eq!(fs::read(out.join("static.csv"))?, table);
    vre(&["simulate", "--seed", "2", "--force", "--out", at])?;
    assert!(fs::read(out.join("static.csv"))? != table);
    Ok(())
}

#[test]
fn a_capture_keeps_the_record_that_is_there_and_verify_fails_where_host_and_instrument_disagree()
-> Outcome {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("captured");
    let at = text_of(&out)?;
    let capture = ["capture", "--plan", "paper", "--runs", "0", "--out", at];
    vre(&capture)?;
    vre(&["verify", at])?;
    let record = fs::read(out.join("record.vre"))?;
    refused(&capture)?;
    vre(&[&capture[..], &["--force", "--seed", "2"]].concat())?;
    assert!(fs::read(out.join("record-1.vre"))? == record);
    assert!(fs::read(out.join("record.vre"))? != record);

    // The host counts a reading less.
    let table = fs::read_to_string(out.join("static.csv"))?;
    let rows: Vec<&str> = table.lines().collect();
    fs::write(out.join("static.csv"), rows[..rows.len() - 1].join("\n"))?;
    let mut command = Command::cargo_bin("vre")?;
    let assert = command.args(["verify", at]).assert().code(1);
    let told = String::from_utf8(assert.get_output().stdout.clone())?;
    assert!(told.contains("DISAGREE"), "{told}");
    Ok(())
}

#[test]
fn no_text_of_a_file_steers_the_terminal_and_a_diagnosis_has_an_end() -> Outcome {
    let folder = tempfile::tempdir()?;
    let campaign = simulate(folder.path(), &[])?;
    let head = campaign.join("campaign.toml");
    let text = fs::read_to_string(&head)?;
    let serial = text.lines().find(|line| line.starts_with("serial"));
    let spoilt = text.replace(
        serial.ok_or("a serial number")?,
        "serial = \"\\u001b]0;x\\u0007\\u009b31m\"\n\"\\u001b[2J\" = 1",
    );
    fs::write(&head, spoilt)?;
    for command in ["identify", "predict"] {
        let mut vre = Command::cargo_bin("vre")?;
        let assert = vre.arg(command).arg(&campaign).assert().success();
        let output = assert.get_output();
        for stream in [&output.stdout, &output.stderr] {
            let text = String::from_utf8(stream.clone())?;
            let steers = |c: char| c.is_control() && c != '\n';
            assert!(!text.contains(steers), "{text:?}");
        }
        let told = String::from_utf8(output.stderr.clone())?;
        assert!(
            told.starts_with("warning: campaign.toml: [instrument] "),
            "{told}"
        );
    }
    let diagnosis = folder.path().join("diagnosis.json");
    fs::write(&diagnosis, vec![b' '; (1 << 24) + 1])?;
    let (at, file) = (text_of(&campaign)?, text_of(&diagnosis)?);
    let mut vre = Command::cargo_bin("vre")?;
    let assert = vre
        .args(["predict", "--quiet", at, "--diagnosis", file])
        .assert();
    let told = String::from_utf8(assert.code(2).get_output().stderr.clone())?;
    assert!(told.contains("has more than 16777216 bytes"), "{told}");
    Ok(())
}
