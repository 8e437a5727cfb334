//! `vre look`, and `vre measure` into a campaign and onto a page, as a user runs them.

#[path = "common/command.rs"]
mod command;
#[path = "common/refusal.rs"]
mod refusal;

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use command::vre;
use host::campaign::{CampaignConfig, Run, VibrationKind, read_runs};
use rand::SeedableRng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};
use refusal::refused;

fn formats() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/formats")
}

fn text_of(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn look_tells_channels_rates_units_and_lengths_of_every_format() {
    for entry in fs::read_dir(formats()).unwrap() {
        let file = entry.unwrap().path();
        let (text, found) = vre(&["look", text_of(&file)]);
        assert_eq!(found["format"], "vre-look/1");
        let channels = found["channels"].as_array().unwrap();
        assert!(!channels.is_empty(), "{}", file.display());
        for channel in channels {
            let name = channel["name"].as_str().unwrap();
            assert!(text.contains(name), "{}: {name}", file.display());
            assert_eq!(channel["samples"], 240, "{}: {name}", file.display());
            if let Some(rate) = channel["rate_hz"].as_f64() {
                assert!((rate - 200.0).abs() < 1e-3, "{}: {rate}", file.display());
            }
        }
    }
    let (text, found) = vre(&["look", text_of(&formats().join("record.tdms"))]);
    assert_eq!(found["file_format"], "TDMS");
    let x = &found["channels"][0];
    assert_eq!(
        (&x["name"], &x["unit"], &x["rate_hz"]),
        (&"x".into(), &"g".into(), &200.0.into())
    );
    // A vibration that sets in half way: low bars, then high ones.
    assert_eq!(x["drawn"], "standard-deviation");
    let bars = text.lines().find(|line| line.contains('\u{2588}')).unwrap();
    assert!(bars.trim_start().starts_with('\u{2581}'), "{bars}");
    assert!(refused(&["look", text_of(&formats().join("nothing.wav"))]).contains("nothing.wav"));
}

/// An instrument of `scale` volts a g along gravity beside a reference, at 500 Hz: 8 s of rest and 10 s of plateau in turns, with sines of
/// these amplitudes along IA and OA (0.6 and 0.8), which shift the instrument by a thousandth of the square of that along IA.
fn shaken(scale: f64, amplitudes_g: &[f64]) -> String {
    let mut rng = StdRng::seed_from_u64(5);
    let mut noise = |sigma: f64| {
        let deviate: f64 = StandardNormal.sample(&mut rng);
        sigma * deviate
    };
    let mut table = String::from("t_s,out_mv,x_g,y_g,z_g\n");
    let mut n = 0u32;
    let mut row = |amplitude: f64| {
        let t = f64::from(n) / 500.0;
        n += 1;
        let sine = (std::f64::consts::TAU * 40.0 * t).sin();
        let along = 0.6 * amplitude * sine;
        let output = scale * (1.0 + along + 2e-3 * (0.6 * amplitude).powi(2) * sine * sine);
        let (x, z) = (1.0 + along, 0.8 * amplitude * sine);
        let _ = writeln!(
            table,
            "{t},{},{},{},{}",
            1e3 * (output + noise(1e-4)),
            x + noise(1e-4),
            noise(1e-4),
            z + noise(1e-4)
        );
    };
    for &amplitude in amplitudes_g {
        (0..4000).for_each(|_| row(0.0));
        (0..5000).for_each(|_| row(amplitude));
    }
    (0..4000).for_each(|_| row(0.0));
    table
}

/// A campaign that was simulated, and its runs.
fn campaign(folder: &Path) -> (PathBuf, Vec<Run>) {
    let out = folder.join("campaign");
    let mut command = Command::cargo_bin("vre").unwrap();
    command.args(["simulate", "--seed", "3", "--out"]).arg(&out);
    command.assert().success();
    let runs = runs(&out);
    (out, runs)
}

fn runs(campaign: &Path) -> Vec<Run> {
    let config = CampaignConfig::read(&campaign.join("campaign.toml")).unwrap();
    read_runs(&campaign.join("vibration.csv"), &config).unwrap()
}

const AXES: &str = "u=out_mv,ref_i=x_g,ref_p=y_g,ref_o=z_g";

#[test]
fn plateaus_become_runs_with_the_moments_that_the_reference_saw() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("record.csv");
    let (campaign, before) = campaign(folder.path());
    let config = CampaignConfig::read(&campaign.join("campaign.toml")).unwrap();
    let scale = config.instrument.scale_factor_nominal_v_per_g;
    fs::write(&file, shaken(scale, &[2.0, 5.0])).unwrap();
    let page = folder.path().join("page.html");
    let arguments = ["measure", text_of(&file), "--time", "t_s", "--axes", AXES];
    let more = ["--into", text_of(&campaign), "--html", text_of(&page)];
    let (text, found) = vre(&[arguments.as_slice(), &more].concat());
    assert!(text.contains("2 runs appended"), "{text}");
    let all = runs(&campaign);
    assert_eq!(all.len(), before.len() + 2);
    assert_eq!(
        all[..before.len()]
            .iter()
            .map(|run| run.run)
            .collect::<Vec<_>>(),
        before.iter().map(|run| run.run).collect::<Vec<_>>()
    );
    for ((run, amplitude), plateau) in all[before.len()..]
        .iter()
        .zip([2.0, 5.0])
        .zip(found["plateaus"].as_array().unwrap())
    {
        assert_eq!(run.kind, VibrationKind::Sine);
        assert!(
            (run.level_g / amplitude - 1.0).abs() < 1e-3,
            "{}",
            run.level_g
        );
        assert!((run.band_hz[0] - 40.0).abs() < 0.01 && run.band_hz[0] == run.band_hz[1]);
        for (found, true_) in run.direction.iter().zip([0.6, 0.0, 0.8]) {
            assert!((found - true_).abs() < 1e-3, "{:?}", run.direction);
        }
        let force = run.specific_force_g;
        assert!((force.i - 1.0).abs() < 1e-3 && force.p.abs() < 1e-3 && force.o.abs() < 1e-3);
        let measured = run.measured.unwrap();
        let shift_g = (measured.during_v - measured.before_v) / scale;
        let told = plateau["axes"][0]["shift_g"]["value"].as_f64().unwrap();
        assert!((shift_g - told).abs() < 1e-12, "{shift_g} of {told}");
        let expected = 1e-3 * (0.6f64 * amplitude).powi(2);
        let sigma_g = 2f64.sqrt() * measured.sigma_v / scale;
        assert!(
            (shift_g - expected).abs() < 4.0 * sigma_g && sigma_g < 1e-4,
            "{shift_g} +- {sigma_g}, not {expected}"
        );
        let seen = run.reference.unwrap();
        assert!((seen.rms_g[0] - 0.6 * amplitude / 2f64.sqrt()).abs() < 1e-3);
        assert!((seen.kurtosis[0] - 1.5).abs() < 1e-2 && seen.skewness[0].abs() < 1e-2);
        assert!((seen.correlation.unwrap()[1] - 1.0).abs() < 1e-3);
    }
    let page = fs::read_to_string(page).unwrap();
    for needle in ["<svg", "Plateaus", "temperature", "shift"] {
        assert!(page.contains(needle), "{needle}");
    }
    assert!(
        !page.contains("http://")
            || page.matches("http://").count() == page.matches("http://www.w3.org").count()
    );
}

#[test]
fn a_campaign_that_takes_no_runs_is_left_as_it_is_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("record.csv");
    fs::write(&file, shaken(1.2, &[2.0])).unwrap();
    let (campaign, _) = campaign(folder.path());
    let table = fs::read(campaign.join("vibration.csv")).unwrap();
    let into = |axes: &str| {
        let arguments = [
            "measure",
            text_of(&file),
            "--time",
            "t_s",
            "--axes",
            axes,
            "--into",
            text_of(&campaign),
        ];
        refused(&arguments)
    };
    for (axes, told) in [
        ("u=out_mv,ref_i=x_g", "--gravity I,P,O is needed"),
        (
            "u=out_mv,ref_i=out_mv",
            "column out_mv: is no column of a unit of acceleration",
        ),
        (
            "u=out_mv,ref_i=w_g",
            "column w_g: is missing from the header",
        ),
        ("ref_i=x_g", "names no column of the output"),
        ("u=out_mv,u=out_mv", "names u twice"),
        ("v=out", "is none of u=NAME"),
    ] {
        let line = into(axes);
        assert!(line.contains(told), "{axes}: {line}");
    }
    assert_eq!(fs::read(campaign.join("vibration.csv")).unwrap(), table);
}

#[test]
fn a_triad_and_a_table_in_a_workbook_take_no_runs_and_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("record.csv");
    fs::write(&file, shaken(1.2, &[2.0])).unwrap();
    let (campaign, _) = campaign(folder.path());
    let triad = folder.path().join("triad");
    let mut command = Command::cargo_bin("vre").unwrap();
    let arguments = ["simulate", "--triad", "--seed", "3", "--out"];
    command.args(arguments).arg(&triad).assert().success();
    let table = campaign.join("vibration.csv");
    let workbook = campaign.join("vibration.xlsx");
    fs::rename(&table, &workbook).unwrap();
    let before = fs::read(&workbook).unwrap();
    for (into, told) in [
        (
            &triad,
            "takes the campaign of one instrument, not of a triad",
        ),
        (
            &campaign,
            "vibration.xlsx: is a workbook, to which no run is appended; save it as vibration.csv",
        ),
    ] {
        let arguments = ["measure", text_of(&file), "--time", "t_s", "--axes", AXES];
        let line = refused(&[&arguments[..], &["--into", text_of(into)]].concat());
        assert!(line.contains(told), "{line}");
    }
    assert_eq!(fs::read(&workbook).unwrap(), before);
    assert!(!table.exists());
}
