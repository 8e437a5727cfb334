//! The triad from a record to its coefficients, on the virtual bench in the time domain and as a user runs it.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use host::bench::noise::Seed;
use host::campaign::TriadCampaign;
use host::triad::diagnosis::diagnose;
use host::triad::rests::{Rests, of_samples};
use host::triad::session::{Session, Simulated};
use host::triad::{fit, identify, observations, start};
use serde_json::Value;
use shared::triad::identification::Prior;
use shared::triad::vibration::{BodyMoments, vre_covariance_g2, vre_g};

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

fn by_hand(seed: u64, positions: usize) -> Session {
    Session {
        seed: Seed(seed),
        positions,
        attitude_sigma_arcsec: None,
        noise_g: 2e-6,
    }
}

fn rests(simulated: &Simulated) -> Option<Rests> {
    let samples = simulated.record.iter().map(|s| (s.time_s, s.output_v));
    of_samples(samples, 1.5)
}

#[test]
fn of_a_thousand_sessions_no_motion_is_taken_for_rest_and_95_of_100_rests_are_found() {
    let (mut moving, mut real, mut found, mut claimed) = (0, 0, 0, 0);
    for seed in 0..1000 {
        let simulated = by_hand(seed, 5).at_rest();
        let record = &simulated.record;
        let rests = rests(&simulated).map_or(Vec::new(), |rests| rests.rests);
        claimed += rests.len();
        let index = |time_s: f64| (time_s * 100.0).round() as usize;
        let still = |from: usize, to: usize| record[from..=to].iter().all(|s| s.at_rest);
        moving += rests
            .iter()
            .filter(|r| !still(index(r.from_s), index(r.to_s)))
            .count();
        for stretch in record.chunk_by(|a, b| a.at_rest == b.at_rest) {
            if stretch[0].at_rest {
                let within = |r: &&host::triad::rests::Rest| {
                    r.from_s >= stretch[0].time_s && r.to_s <= stretch[stretch.len() - 1].time_s
                };
                real += 1;
                found += usize::from(rests.iter().any(|r| within(&r)));
            }
        }
    }
    println!("{found} of {real} rests found, {claimed} claimed, {moving} of them moving");
    assert_eq!(moving, 0);
    assert!(found * 100 >= real * 95, "{found} of {real}");
}

#[test]
fn from_record_to_vibration_error_the_stated_uncertainty_holds_over_200_triads() -> Outcome {
    let white = BodyMoments::random([1.0; 3], [0.0; 3]).sensitivities([0.0; 3]);
    let (mut z2, mut stated, mut squares, triads) = (0.0, 0.0, 0.0, 200);
    for seed in 0..triads {
        let simulated = by_hand(seed, 80).at_rest();
        let mut campaign = simulated.campaign.clone();
        campaign.positions = rests(&simulated).ok_or("rests")?.positions();
        let positions = observations::observations(&campaign, 0.0);
        let about = start::start(&campaign)?;
        let prior = Prior::cross_couplings(5e-5);
        let gravity_g = observations::gravity_g(&campaign);
        let fit = shared::triad::identification::identify(&positions, about, gravity_g, &prior)?;
        let covariance = vre_covariance_g2(&white, &fit.covariance);
        let (found, truth) = (
            vre_g(&white, &fit.coefficients),
            vre_g(&white, &simulated.triad),
        );
        for s in 0..3 {
            let each = 1.0 / (3.0 * triads as f64);
            z2 += (found[s] - truth[s]).powi(2) / covariance[s][s] * each;
            squares += (found[s] - truth[s]).powi(2) * each;
            stated += covariance[s][s].sqrt() * each;
        }
    }
    let rms = squares.sqrt();
    println!(
        "stated {:.1} microg, rms error {:.1}, mean z^2 {z2:.3}",
        stated * 1e6,
        rms * 1e6
    );
    // 600 squares of which the three of a triad are correlated: a standard deviation of 0.06 to 0.1.
    assert!((z2 - 1.0).abs() < 0.2, "{z2}");
    assert!((stated * 1e6 / 48.0 - 1.0).abs() < 0.1, "{stated}");
    Ok(())
}

#[test]
fn predictions_by_hand_hold_on_the_shaker() -> Outcome {
    let (mut inside, mut all) = (0, 0);
    for seed in 0..6 {
        let campaign = by_hand(seed, 80).simulate().campaign;
        let predicted = host::triad::predict(&campaign, &campaign.runs)?;
        for run in &predicted.runs {
            for each in run.instruments.values() {
                let (value, sigma) = each.vre_g.known().ok_or("known")?;
                let measured = each.measured_vre_g.ok_or("measured")?;
                let (seen, noise) = measured.known().ok_or("known")?;
                // The bench's noise is Gaussian within the number of its lines: its fourth moment is 1 % off.
                let off = (value - seen).abs() - 0.01 * seen.abs();
                inside += usize::from(off < 2.0 * sigma.hypot(noise));
                all += 1;
            }
        }
    }
    println!("{inside} of {all} within two standard uncertainties");
    assert!(inside * 100 >= all * 88, "{inside} of {all}");
    Ok(())
}

#[test]
fn terms_are_claimed_where_they_are_and_positions_left_out_never_get_worse() -> Outcome {
    let simulated = by_hand(3, 80).at_rest();
    let sharp = identify(&simulated.campaign)?;
    let left_out = &sharp.leave_one_out;
    assert!(
        left_out.rms_g < 0.1 * left_out.nine_parameters_rms_g,
        "{left_out:?}"
    );
    assert!(left_out.claimed.contains(&"k1_prime"), "{left_out:?}");
    // The same triad with the noise of a consumer part: nothing of higher order is a number.
    let coarse = Session {
        noise_g: 1e-3,
        ..by_hand(3, 40)
    };
    let coarse = identify(&coarse.at_rest().campaign)?;
    let left_out = &coarse.leave_one_out;
    assert!(left_out.rms_g <= left_out.nine_parameters_rms_g);
    for each in coarse.instruments.values() {
        assert!(each.coefficients["K1_v_per_g"].value.is_some());
        assert!(each.coefficients["k0_g"].value.is_some());
        assert_eq!(
            each.coefficients["k2_per_g"].value, None,
            "{:?}",
            each.coefficients
        );
    }
    Ok(())
}

#[test]
fn of_a_consumer_part_hardly_ever_a_higher_term_is_claimed() -> Outcome {
    let (mut claims, sessions) = (0, 30);
    for seed in 100..100 + sessions {
        let coarse = Session {
            noise_g: 1e-3,
            ..by_hand(seed, 40)
        };
        let found = fit(&coarse.at_rest().campaign)?;
        let left_out = &found.left_out;
        assert!(left_out.rms_g <= left_out.linear_rms_g);
        claims += usize::from(left_out.claims.contains(&true));
    }
    println!("{claims} of {sessions} sessions claim a term");
    assert!(claims <= 3, "{claims}");
    Ok(())
}

#[test]
fn scatter_of_the_positions_is_in_every_uncertainty() -> Outcome {
    let mut campaign = by_hand(4, 60).at_rest().campaign;
    let before = fit(&campaign)?;
    assert_eq!(before.scatter_g, 0.0);
    let mut stream = Seed(9).stream("scatter", 0);
    for position in &mut campaign.positions {
        for output_v in &mut position.output_v {
            *output_v += 1.2 * 1e-4 * stream.normal();
        }
    }
    let after = fit(&campaign)?;
    assert!(
        (after.scatter_g / 1e-4 - 1.0).abs() < 0.35,
        "{}",
        after.scatter_g
    );
    assert!(after.bounded.covariance[0][0] > 100.0 * before.bounded.covariance[0][0]);
    Ok(())
}

#[test]
fn drift_and_temperature_are_named_before_any_nonlinearity() -> Outcome {
    let consumer = |seed| Session {
        noise_g: 1e-4,
        ..by_hand(seed, 60)
    };
    let (mut drift, mut warmth) = (0, 0);
    for seed in 0..10 {
        let mut campaign = consumer(seed).at_rest().campaign;
        let mut warm = campaign.clone();
        for position in &mut campaign.positions {
            let time_s = position.time_s.unwrap_or(0.0);
            let slopes = [2e-5, -1e-5, 3e-5];
            (0..3).for_each(|s| position.output_v[s] += 1.2 * slopes[s] * time_s);
        }
        let found = diagnose(&campaign)?;
        drift += usize::from(
            found
                .which
                .first()
                .is_some_and(|w| w.effect == "bias-drift"),
        );
        let mut stream = Seed(seed).stream("temperature", 0);
        for position in &mut warm.positions {
            let temp_c = 20.0 + 20.0 * stream.uniform(0.0, 1.0);
            position.temp_c = Some(temp_c);
            (0..3).for_each(|s| position.output_v[s] += 1.2 * 5e-4 * (temp_c - 30.0));
        }
        let found = diagnose(&warm)?;
        let first = found.which.first().map(|w| w.effect);
        warmth += usize::from(first == Some("bias-temperature"));
    }
    assert!(drift >= 9 && warmth >= 9, "{drift} {warmth}");
    Ok(())
}

fn simulated(folder: &Path, more: &[&str]) -> Outcome<PathBuf> {
    let out = folder.join("triad");
    let mut command = Command::cargo_bin("vre")?;
    command
        .args(["simulate", "--triad", "--out"])
        .arg(&out)
        .args(more);
    command.assert().success();
    Ok(out)
}

fn vre(arguments: &[&str], at: &Path) -> Outcome<(String, Value)> {
    let folder = tempfile::tempdir()?;
    let json = folder.path().join("result.json");
    let mut command = Command::cargo_bin("vre")?;
    let command = command.args(arguments).arg(at).arg("--json").arg(&json);
    let text = String::from_utf8(command.assert().success().get_output().stdout.clone())?;
    Ok((text, serde_json::from_slice(&fs::read(json)?)?))
}

fn refused(command: &str, at: &Path) -> Outcome<String> {
    let assert = Command::cargo_bin("vre")?
        .arg(command)
        .arg(at)
        .assert()
        .code(2);
    let told = String::from_utf8(assert.get_output().stderr.clone())?;
    assert_eq!(told.lines().count(), 1, "{told}");
    Ok(told)
}

#[test]
fn commands_of_a_triad_give_what_is_promised() -> Outcome {
    let folder = tempfile::tempdir()?;
    let at = simulated(folder.path(), &["--seed", "3"])?;
    let (text, found) = vre(&["identify"], &at)?;
    assert_eq!(found["format"], "vre-identification/1");
    assert_eq!(
        (&found["rank"], &found["rank_with_prior"]),
        (&25.into(), &33.into())
    );
    assert!(
        text.contains("BLIND: +0.707 x.d_oa_rad  +0.707 y.d_pa_rad"),
        "{text}"
    );
    assert_eq!(found["blind_directions"].as_array().map(Vec::len), Some(8));
    assert_eq!(found["covariance"].as_array().map(Vec::len), Some(33));
    assert!(found["instruments"]["y"]["coefficients"]["k2_per_g"]["sigma"].is_number());
    let (_, predicted) = vre(&["predict"], &at)?;
    assert_eq!(predicted["runs"].as_array().map(Vec::len), Some(12));
    assert!(predicted["runs"][0]["instruments"]["x"]["measured_vre_g"]["value"].is_number());
    let (_, plan) = vre(&["plan"], &at)?;
    assert_eq!(
        (&plan["format"], &plan["rank"]),
        (&"vre-plan/1".into(), &25.into())
    );
    let (_, diagnosis) = vre(&["diagnose"], &at)?;
    assert_eq!(diagnosis["format"], "vre-diagnosis/1");
    let report = folder.path().join("report");
    let mut command = Command::cargo_bin("vre")?;
    command.arg("report").arg(&at).arg("--out").arg(&report);
    command.assert().success();
    let page = fs::read_to_string(report.join("report.html"))?;
    assert!(page.contains("<svg") && page.contains("largest hole"));
    // From the record alone, as of a person with a log.
    let log = folder.path().join("log");
    let mut command = Command::cargo_bin("vre")?;
    command
        .arg("rests")
        .arg(at.join("record.csv"))
        .arg("--out")
        .arg(&log);
    command
        .args(["--scale", "1.2", "--gravity", "0.9992"])
        .assert()
        .success();
    assert_eq!(vre(&["identify"], &log)?.1["rank"], 25);
    assert!(refused("verify", &at)?.contains("is a triad"));
    Ok(())
}

#[test]
fn a_demonstration_by_hand_runs_from_record_to_page() -> Outcome {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("demo");
    let mut command = Command::cargo_bin("vre")?;
    command
        .args(["demo", "--triad", "--positions", "40", "--out"])
        .arg(&out);
    command.assert().success();
    for file in [
        "report.html",
        "identification.json",
        "prediction.json",
        "campaign/positions.csv",
    ] {
        assert!(out.join(file).exists(), "{file}");
    }
    Ok(())
}

/// Rewrites a table: each cell of the rows, with row and column.
fn rewrite(file: &Path, cell: impl Fn(usize, &str, &str) -> String) -> Outcome {
    let table = fs::read_to_string(file)?;
    let mut lines = table.lines();
    let header = lines.next().ok_or("a header")?;
    let names: Vec<&str> = header.split(',').collect();
    let row = |(k, line): (usize, &str)| {
        let cells = names.iter().zip(line.split(','));
        cells
            .map(|(name, text)| cell(k, name, text))
            .collect::<Vec<_>>()
            .join(",")
    };
    let rows: Vec<String> = lines.enumerate().map(row).collect();
    fs::write(file, format!("{header}\n{}\n", rows.join("\n")))?;
    Ok(())
}

#[test]
fn bad_positions_are_one_line_that_names_the_trouble() -> Outcome {
    let folder = tempfile::tempdir()?;
    let fresh = |more: &[&str]| -> Outcome<(PathBuf, PathBuf)> {
        let out = folder.path().join("triad");
        let _ = fs::remove_dir_all(&out);
        let at = simulated(folder.path(), more)?;
        let file = at.join("positions.csv");
        Ok((at, file))
    };
    let scaled = |factor: f64| {
        move |_: usize, name: &str, text: &str| match name.starts_with("u_") {
            true => (text.parse::<f64>().unwrap_or(0.0) * factor).to_string(),
            false => text.to_owned(),
        }
    };
    let (at, file) = fresh(&[])?;
    rewrite(&file, scaled(9.80665))?;
    assert!(refused("identify", &at)?.contains("m/s^2"));
    let (at, file) = fresh(&[])?;
    rewrite(&file, scaled(4096.0))?;
    assert!(refused("identify", &at)?.contains("counts without their scale"));

    let (at, file) = fresh(&[])?;
    let table = fs::read_to_string(&file)?;
    let few: Vec<&str> = table.lines().take(8).collect();
    fs::write(&file, few.join("\n"))?;
    assert!(refused("identify", &at)?.contains("7 positions"));
    fs::write(&file, table.replacen("sigma_y_v", "sigma_why_v", 1))?;
    assert!(refused("identify", &at)?.contains("sigma_y_v"));

    let (at, file) = fresh(&[])?;
    rewrite(&file, |k, name, text| {
        let (sin, cos) = (0.1 * k as f64).sin_cos();
        match name {
            "u_x_v" => (1.2 * cos).to_string(),
            "u_y_v" => (1.2 * sin).to_string(),
            "u_z_v" => "0.001".into(),
            _ => text.into(),
        }
    })?;
    assert!(refused("identify", &at)?.contains("in a plane"));

    let dial = ["--attitude-sigma", "60"];
    let (at, file) = fresh(&dial)?;
    let table = fs::read_to_string(&file)?;
    fs::write(&file, table.replacen("u_x_v,u_y_v", "u_y_v,u_x_v", 1))?;
    let told = refused("identify", &at)?;
    assert!(told.contains("u_x_v and u_y_v swapped"), "{told}");
    let (at, file) = fresh(&dial)?;
    rewrite(&file, |_, name, text| match name {
        "u_z_v" => format!("-{text}").replace("--", ""),
        _ => text.into(),
    })?;
    assert!(refused("identify", &at)?.contains("z upside down"));
    let (at, file) = fresh(&dial)?;
    rewrite(&file, |_, name, text| match name {
        "a_x_g" | "a_y_g" | "a_z_g" => (text.parse::<f64>().unwrap_or(0.0) * 9.81).to_string(),
        _ => text.into(),
    })?;
    let told = refused("identify", &at)?;
    assert!(told.contains("row 2") && told.contains("m/s^2"), "{told}");
    Ok(())
}

#[test]
fn a_triad_is_written_and_read_back() -> Outcome {
    let folder = tempfile::tempdir()?;
    for attitude_sigma_arcsec in [None, Some(20.0)] {
        let session = Session {
            attitude_sigma_arcsec,
            ..by_hand(1, 12)
        };
        let campaign = session.simulate().campaign;
        campaign.write(folder.path())?;
        let back = TriadCampaign::read(folder.path())?;
        assert_eq!(back.runs, campaign.runs);
        assert_eq!(back.config, campaign.config);
        for (one, other) in back.positions.iter().zip(&campaign.positions) {
            assert_eq!((one.output_v, one.sigma_v), (other.output_v, other.sigma_v));
            let sigma = |p: &host::campaign::TriadPosition| p.attitude.map(|a| a.sigma_rad);
            assert_eq!(sigma(one).is_some(), attitude_sigma_arcsec.is_some());
        }
    }
    Ok(())
}
