//! Imperfections of a laboratory on the virtual bench: each touches what it says and nothing else.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use host::bench::imperfections::{self, Imperfection, catalogue};
use host::bench::noise::Seed;
use host::bench::plan::Static;
use host::bench::simulate::{Simulation, Specification, VirtualBench};
use host::campaign::{Campaign, Run, VibrationKind, write_runs};
use serde_json::Value;

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

fn bench(seed: u64) -> VirtualBench {
    let specification = Specification::with_dial_sigma(1.0);
    VirtualBench::new(Seed(seed), Static::Paper, specification, Vec::new())
}

fn simulate(seed: u64, imperfections: &[&str]) -> Outcome<Simulation> {
    let parsed: Result<Vec<Imperfection>, String> =
        imperfections.iter().map(|text| text.parse()).collect();
    Ok(imperfections::simulate(bench(seed), &parsed?))
}

const OUTPUTS: [&str; 5] = [
    "u_before_v",
    "u_during_v",
    "u_after_v",
    "u_min_v",
    "u_max_v",
];
const RMS: [&str; 3] = ["ref_i_rms_g", "ref_p_rms_g", "ref_o_rms_g"];
const MOMENTS: [&str; 9] = [
    "ref_i_skew",
    "ref_i_kurt",
    "ref_p_skew",
    "ref_p_kurt",
    "ref_o_skew",
    "ref_o_kurt",
    "ref_ip_corr",
    "ref_io_corr",
    "ref_po_corr",
];
const DIRECTION: [&str; 3] = ["dir_i", "dir_p", "dir_o"];
const ANGLE: [&str; 4] = ["dial_deg", "a_i_g", "a_p_g", "a_o_g"];
const PLATEAUS: [&str; 3] = ["u_before_v", "u_during_v", "u_after_v"];
const RUN_SIGMAS: [&str; 2] = ["sigma_v", "drift_sigma_v_per_s"];

/// Columns of static.csv, vibration.csv and holdout.csv that an imperfection may touch, and whether campaign.toml.
type Columns = (
    Vec<&'static str>,
    Vec<&'static str>,
    Vec<&'static str>,
    bool,
);

fn columns(id: &str) -> Columns {
    let runs = |columns: &[&'static str]| (vec![], columns.to_vec(), vec![], false);
    let all_runs = |columns: &[&'static str]| (vec![], columns.to_vec(), columns.to_vec(), false);
    let readings = |columns: &[&'static str]| (columns.to_vec(), vec![], vec![], false);
    let reference = [&RMS[..], &MOMENTS].concat();
    let motion = [&["u_during_v", "u_min_v", "u_max_v"], &RMS[..]].concat();
    let noisy = [&OUTPUTS[..], &["drift_v_per_s"]].concat();
    match id {
        "session-bias" | "session-alignment" | "session-day-unmarked" => runs(&OUTPUTS),
        "session-gain" => runs(&[&PLATEAUS[..], &["drift_v_per_s"]].concat()),
        "session-day" => {
            let runs = [&OUTPUTS[..], &["session"]].concat();
            (vec![], runs, vec!["session"], false)
        }
        "noise-readings" => readings(&["sigma_v"]),
        "noise-runs" => runs(&RUN_SIGMAS),
        "noise-all" => (vec!["sigma_v"], RUN_SIGMAS.to_vec(), vec![], false),
        "dial-sigma" => (vec![], vec![], vec![], true),
        "gross-reading" | "gross-readings" | "rows-swapped" => readings(&["u_v"]),
        "gross-run" | "gross-runs" => runs(&PLATEAUS),
        "angle-off" | "angle-digits" | "angle-180" => readings(&ANGLE),
        "level-typed" => runs(&["level_g"]),
        "levels-factor" | "levels-rms" | "levels-ms2" => all_runs(&["level_g"]),
        "sign-direction" => all_runs(&["dir_p", "dir_o"]),
        "sign-axis" => all_runs(&DIRECTION),
        // IA is driven in every run to hold out: a little of the other axes leaves its moments.
        "reference-cross" => {
            let of_i = ["ref_i_skew", "ref_i_kurt"];
            let others = reference.iter().filter(|column| !of_i.contains(column));
            (vec![], reference.clone(), others.copied().collect(), false)
        }
        "reference-noise" | "no-reference" => all_runs(&reference),
        // A skewness of 0 is there already where no random run moves OA.
        "reference-zeros" => {
            let others = reference.iter().filter(|column| **column != "ref_o_skew");
            (vec![], reference.clone(), others.copied().collect(), false)
        }
        "reference-gain" | "reference-scatter" => all_runs(&RMS),
        "reference-reversed" => all_runs(&["ref_p_skew", "ref_ip_corr", "ref_po_corr"]),
        "reference-mean" => runs(&reference),
        "peak-gain" | "extremes-mean" | "no-extremes" => runs(&["u_min_v", "u_max_v"]),
        "table-scatter" | "table-gain" => (vec![], motion, RMS.to_vec(), false),
        "no-before" => runs(&["u_before_v"]),
        "no-recovery" => runs(&["u_after_v"]),
        "no-drift" => runs(&["drift_v_per_s", "drift_sigma_v_per_s"]),
        "inverted" => (vec!["u_v"], noisy, vec![], true),
        "heavy-tails" => (vec!["u_v"], noisy, vec![], false),
        "times-of-day" => (vec!["time_s"], vec!["time_s"], vec!["time_s"], false),
        "plausible" => {
            let runs = [&motion[..], &MOMENTS, &RUN_SIGMAS].concat();
            (vec!["sigma_v"], runs, reference, false)
        }
        other => panic!("what does {other} touch?"),
    }
}

/// The files of a campaign; of a table its cells by line and column.
#[derive(PartialEq)]
struct Files {
    config: String,
    tables: BTreeMap<&'static str, Vec<BTreeMap<String, String>>>,
}

fn files(simulation: &Simulation, folder: &Path) -> Outcome<Files> {
    simulation.campaign.write(folder)?;
    write_runs(&folder.join("holdout.csv"), &simulation.holdout)?;
    let mut tables = BTreeMap::new();
    for file in ["static.csv", "vibration.csv", "holdout.csv"] {
        let mut reader = csv::Reader::from_path(folder.join(file))?;
        let rows: Result<_, _> = reader.deserialize().collect();
        tables.insert(file, rows?);
    }
    let config = fs::read_to_string(folder.join("campaign.toml"))?;
    Ok(Files { config, tables })
}

/// Places that differ, `file:line` and the column.
fn differences(one: &Files, other: &Files) -> BTreeSet<(&'static str, u64, String)> {
    let mut found = BTreeSet::new();
    if one.config != other.config {
        found.insert(("campaign.toml", 0, String::new()));
    }
    for (file, rows) in &one.tables {
        let others = &other.tables[file];
        assert_eq!(rows.len(), others.len());
        for (line, (row, other)) in (2..).zip(rows.iter().zip(others)) {
            let columns = row.keys().chain(other.keys());
            let differs = |column: &&String| {
                let cell = |row: &BTreeMap<String, String>| row.get(*column).cloned();
                cell(row).unwrap_or_default() != cell(other).unwrap_or_default()
            };
            found.extend(
                columns
                    .filter(differs)
                    .map(|column| (*file, line, column.clone())),
            );
        }
    }
    found
}

/// Whether a row is among those that the truth names; `true` too for what it names as a whole file.
fn named(rows: &[String], file: &str, line: u64) -> bool {
    rows.iter()
        .any(|row| *row == file || *row == format!("{file}:{line}"))
}

#[test]
fn each_imperfection_touches_the_columns_and_rows_that_it_says_and_nothing_else() -> Outcome {
    /// In so many campaigns, every column that an imperfection may touch is touched once.
    const SEEDS: u64 = 12;
    let folder = tempfile::tempdir()?;
    let mut bare: Vec<(Files, Simulation)> = Vec::new();
    for seed in 0..SEEDS {
        let simulation = simulate(seed, &[])?;
        assert!(simulation.truth.imperfections.is_empty());
        bare.push((files(&simulation, folder.path())?, simulation));
    }
    for entry in catalogue() {
        let id = entry.id;
        let (of_static, of_runs, of_holdout, config) = columns(id);
        let mut expected: BTreeSet<(&str, String)> = BTreeSet::new();
        let tables = [
            ("static.csv", of_static),
            ("vibration.csv", of_runs),
            ("holdout.csv", of_holdout),
        ];
        for (file, columns) in tables {
            expected.extend(columns.into_iter().map(|column| (file, column.to_owned())));
        }
        expected.extend(config.then(|| ("campaign.toml", String::new())));
        let mut touched = BTreeSet::new();
        for (seed, (without, simulation)) in (0..).zip(&bare) {
            let with = simulate(seed, &[id])?;
            let [truth] = &with.truth.imperfections[..] else {
                panic!("{id}: one imperfection");
            };
            assert_eq!(
                (truth.id, truth.size),
                (id, entry.size.map(|size| size.usual))
            );
            let found = differences(&files(&with, folder.path())?, without);
            for (file, line, column) in &found {
                assert!(
                    named(&truth.rows, file, *line),
                    "{id}: {file}:{line} {column}"
                );
            }
            for row in &truth.rows {
                let (file, line) = row.split_once(':').unwrap_or((row, ""));
                let line = line.parse().ok();
                let really = |(of, at, _): &&(&str, u64, String)| {
                    *of == file && line.is_none_or(|line: u64| line == *at)
                };
                assert!(
                    found.iter().any(|place| really(&place)),
                    "{id}: {row} is as it was"
                );
            }
            let (now, then) = (&with.truth, &simulation.truth);
            assert_eq!(
                now.coefficients.map(f64::abs),
                then.coefficients.map(f64::abs),
                "{id}"
            );
            touched.extend(found.into_iter().map(|(file, _, column)| (file, column)));
            if touched == expected {
                break;
            }
        }
        assert_eq!(touched, expected, "{id}");
    }
    Ok(())
}

#[test]
fn identifiers_are_unique_words_and_each_says_what_it_is_with_its_size() {
    let mut seen = BTreeSet::new();
    for entry in catalogue() {
        assert!(seen.insert(entry.id), "{}", entry.id);
        let word = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        assert!(entry.id.chars().all(word), "{}", entry.id);
        // Six columns before it, of eighty.
        assert!((1..=74).contains(&entry.says.len()), "{}", entry.id);
        if let Some(size) = entry.size {
            let [low, high] = size.between;
            assert!(low < size.usual && size.usual < high, "{}", entry.id);
        }
    }
}

#[test]
fn what_a_laboratory_did_is_read_back_unless_a_cell_cannot_be_which_is_named() -> Outcome {
    for entry in catalogue() {
        let folder = tempfile::tempdir()?;
        let simulation = simulate(3, &[entry.id])?;
        simulation.campaign.write(folder.path())?;
        let told = match Campaign::read(folder.path()) {
            Ok(_) => String::new(),
            Err(error) => error.to_string(),
        };
        let first = simulation.truth.imperfections[0].rows[0].replace(':', ", row ");
        match entry.id {
            "no-before" => assert!(
                told.contains("vibration.csv, row 2, column u_before_v"),
                "{told}"
            ),
            // The mean kurtosis over axes that move and axes at rest is none that a record can have.
            "reference-mean" => assert!(told.contains(&first) && told.contains("kurt"), "{told}"),
            id => assert_eq!(told, "", "{id}"),
        }
    }
    Ok(())
}

/// The runs with an imperfection beside those without, in pairs.
fn pairs(seed: u64, imperfection: &str) -> Outcome<Vec<(Run, Run)>> {
    let [with, without] = [&[imperfection][..], &[]].map(|given| simulate(seed, given));
    let (with, without) = (with?.campaign.runs, without?.campaign.runs);
    Ok(with.into_iter().zip(without).collect())
}

#[test]
fn a_session_shifts_its_plateaus_by_its_bias_and_scales_them_by_its_gain() -> Outcome {
    let k1_v_per_g = simulate(5, &[])?.truth.coefficients[0];
    for (with, without) in pairs(5, "session-bias:40")? {
        let (with, without) = (
            with.measured.ok_or("made")?,
            without.measured.ok_or("made")?,
        );
        let shift_g = (with.before_v - without.before_v) / k1_v_per_g;
        assert!((shift_g.abs() / 40e-6 - 1.0).abs() < 1e-4, "{shift_g}");
        let (now, then) = (
            with.during_v - with.before_v,
            without.during_v - without.before_v,
        );
        assert!((now - then).abs() < 1e-9);
    }
    for (with, without) in pairs(5, "session-gain:0.02")? {
        let (with, without) = (
            with.measured.ok_or("made")?,
            without.measured.ok_or("made")?,
        );
        if without.before_v.abs() > 0.1 {
            let gain = with.before_v / without.before_v;
            assert!(((gain - 1.0).abs() - 0.02).abs() < 1e-8, "{gain}");
        }
        assert_eq!(with.extremes, without.extremes);
    }
    Ok(())
}

/// That the root mean square of standard normal deviates is 1 within four of its standard deviations.
fn check_unit(deviates: &[f64], what: &str) {
    let count = deviates.len() as f64;
    let mean_square = deviates.iter().map(|z| z * z).sum::<f64>() / count;
    let off = (mean_square - 1.0) / (2.0 / count).sqrt();
    assert!(off.abs() < 4.0, "{what}: {mean_square} of {count}");
}

#[test]
fn table_and_reference_scatter_as_much_as_they_say() -> Outcome {
    let main = |run: &Run| -> Outcome<f64> {
        let rms_g = run.reference.ok_or("a reference")?.rms_g;
        let level_g = match run.kind {
            VibrationKind::Sine => run.level_g * std::f64::consts::FRAC_1_SQRT_2,
            VibrationKind::Random => run.level_g,
        };
        let axis = (0..3)
            .find(|&axis| run.direction[axis] != 0.0)
            .ok_or("driven")?;
        Ok(rms_g[axis] / (level_g * run.direction[axis].abs()) - 1.0)
    };
    let (mut table, mut reference) = (Vec::new(), Vec::new());
    for seed in 0..6 {
        for run in simulate(seed, &["table-scatter:0.004"])?.campaign.runs {
            // The reference's own scatter of 2e-4 is beside it.
            table.push(main(&run)? / 0.004_f64.hypot(2e-4));
        }
        for run in simulate(seed, &["reference-scatter:0.004"])?.campaign.runs {
            reference.push(main(&run)? / 0.004);
        }
    }
    check_unit(&table, "table");
    check_unit(&reference, "reference");
    Ok(())
}

#[test]
fn a_gross_error_is_as_large_as_it_says() -> Outcome {
    for seed in 0..6 {
        for (with, without) in pairs(seed, "gross-runs:25")? {
            let (with, without) = (
                with.measured.ok_or("made")?,
                without.measured.ok_or("made")?,
            );
            let plateaus = [
                (with.before_v, without.before_v),
                (with.during_v, without.during_v),
                (
                    with.after_v.ok_or("after")?,
                    without.after_v.ok_or("after")?,
                ),
            ];
            let errors_v = plateaus.map(|(with, without)| (with - without).abs());
            let largest = errors_v.into_iter().fold(0.0, f64::max) / without.sigma_v;
            assert!(
                largest == 0.0 || (largest / 25.0 - 1.0).abs() < 1e-3,
                "{largest}"
            );
        }
    }
    Ok(())
}

#[test]
fn one_that_is_given_twice_happens_twice_and_the_order_does_not_matter() -> Outcome {
    let rows = |simulation: &Simulation| -> BTreeSet<String> {
        let all = simulation.truth.imperfections.iter();
        all.flat_map(|one| one.rows.clone()).collect()
    };
    let twice = simulate(8, &["gross-run", "gross-run"])?;
    assert_eq!(rows(&twice).len(), 2);
    let once = simulate(8, &["gross-run"])?;
    assert!(rows(&twice).is_superset(&rows(&once)));

    let together = [
        "session-bias",
        "level-typed",
        "reference-noise:1",
        "angle-digits",
    ];
    let mut reversed = together;
    reversed.reverse();
    let (one, other) = (simulate(8, &together)?, simulate(8, &reversed)?);
    assert_eq!(one.campaign, other.campaign);
    assert_eq!(rows(&one), rows(&other));
    Ok(())
}

#[test]
fn the_command_writes_the_imperfections_into_the_truth_and_refuses_what_it_does_not_know() -> Outcome
{
    let folder = tempfile::tempdir()?;
    let simulate = |out: &str, more: &[&str]| -> Outcome<Command> {
        let mut command = Command::cargo_bin("vre")?;
        command.args(["simulate", "--seed", "4", "--plan", "paper", "--out"]);
        command.arg(folder.path().join(out)).args(more);
        Ok(command)
    };
    let truth = |out: &str| -> Outcome<Value> {
        let text = fs::read(folder.path().join(out).join("truth.json"))?;
        Ok(serde_json::from_slice(&text)?)
    };
    simulate("as-stated", &[])?.assert().success();
    assert_eq!(truth("as-stated")?.get("imperfections"), None);
    let given = [
        "--imperfection",
        "gross-run:25",
        "--imperfection",
        "levels-rms",
    ];
    simulate("hasty", &given)?.assert().success();
    let told = truth("hasty")?;
    let told = told["imperfections"].as_array().ok_or("a list")?;
    assert_eq!(told.len(), 2);
    assert_eq!(
        (&told[0]["id"], &told[0]["size"]),
        (&"gross-run".into(), &25.0.into())
    );
    let row = told[0]["rows"][0].as_str().ok_or("a row")?;
    assert!(row.starts_with("vibration.csv:"), "{row}");
    assert_eq!(told[1]["size"], Value::Null);

    for (wrong, said) in [
        ("gros-run", "gross-run, gross-runs"),
        (
            "gross-run:much",
            "a number between 0 and 100000, as 30 sigma",
        ),
        ("gross-run:NaN", "a number between"),
        ("heavy-tails:2", "a number between 2 and 1000, as 3 dof"),
        ("levels-rms:3", "levels-rms has no size"),
    ] {
        let assert = simulate("wrong", &["--imperfection", wrong])?
            .assert()
            .code(2);
        let told = String::from_utf8(assert.get_output().stderr.clone())?;
        assert_eq!(told.lines().count(), 1, "{told}");
        assert!(told.contains(said), "{told}");
        assert!(!folder.path().join("wrong").exists());
    }
    Ok(())
}

#[test]
fn the_help_lists_every_imperfection() -> Outcome {
    let assert = Command::cargo_bin("vre")?
        .args(["simulate", "--help"])
        .assert()
        .success();
    let help = String::from_utf8(assert.get_output().stdout.clone())?;
    for entry in catalogue() {
        let named = |line: &str| line.trim_start().split('[').next() == Some(entry.id);
        assert!(help.lines().any(named), "{}", entry.id);
    }
    Ok(())
}

#[test]
fn a_blind_check_of_laboratories_counts_every_campaign_and_gives_intervals() -> Outcome {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("board.json");
    let mut command = Command::cargo_bin("vre")?;
    command.args([
        "blind-check",
        "--imperfect",
        "--count",
        "2",
        "--seed",
        "5",
        "--json",
    ]);
    command.arg(&file).args([
        "--imperfection",
        "gross-run:40",
        "--imperfection",
        "levels-ms2",
    ]);
    let assert = command.assert().success();
    let text = String::from_utf8(assert.get_output().stdout.clone())?;
    assert!(
        text.lines().all(|line| line.chars().count() <= 80),
        "{text}"
    );
    for row in [
        "gross-run",
        "levels-ms2",
        "wrong name at >= .9",
        "said >= .999: right",
    ] {
        assert!(text.contains(row), "{text}");
    }
    let board: Value = serde_json::from_slice(&fs::read(&file)?)?;
    assert_eq!(board["format"], "vre-blind-check-imperfect/1");
    let outcomes = board["outcomes"].as_array().ok_or("a list")?;
    // The bench as stated and two imperfections, with no effect and with one of two visibilities, twice.
    assert_eq!(outcomes.len(), 18);
    for outcome in outcomes
        .iter()
        .filter(|o| o["imperfection"] == "levels-ms2")
    {
        assert_eq!(
            (&outcome["answer"], &outcome["told"]),
            (&"refused".into(), &true.into())
        );
        let refusal = outcome["refusal"].as_str().ok_or("a line")?;
        assert!(
            refusal.starts_with("vibration.csv, column level_g"),
            "{refusal}"
        );
    }
    for outcome in outcomes.iter().filter(|o| o["imperfection"] == "gross-run") {
        assert_eq!(
            (&outcome["size"], &outcome["told"]),
            (&40.0.into(), &true.into()),
            "{outcome}"
        );
        let named = outcome["named_rows"].as_array().ok_or("rows")?;
        assert!(named.contains(&outcome["rows"][0]), "{outcome}");
    }
    for group in board["groups"].as_array().ok_or("groups")? {
        assert_eq!(group["campaigns"], 4);
        let shares = group["shares"].as_object().ok_or("shares")?;
        assert_eq!(shares["refused"]["count"], 2);
        assert_eq!(shares["refused_in_error"]["count"], 0);
        for (name, share) in shares {
            let [low, high] = [0, 1].map(|end| share["interval_95"][end].as_f64());
            let (low, high) = (low.ok_or("low")?, high.ok_or("high")?);
            let (count, of) = (share["count"].as_f64(), share["of"].as_f64());
            let found = count.ok_or("count")? / of.ok_or("of")?.max(1.0);
            assert!(low <= found && found <= high, "{name} {share}");
        }
    }
    Ok(())
}

#[test]
fn a_blind_check_gives_the_same_answers_on_one_thread_and_options_that_it_lacks_are_told() -> Outcome
{
    let board = |threads: &str| -> Outcome<Value> {
        let mut command = Command::cargo_bin("vre")?;
        command.env("RAYON_NUM_THREADS", threads);
        command.args([
            "blind-check",
            "--imperfect",
            "--imperfection",
            "table-scatter",
            "--json",
            "-",
        ]);
        Ok(serde_json::from_slice(
            &command.assert().success().get_output().stdout,
        )?)
    };
    assert_eq!(board("1")?, board("2")?);
    for wrong in [
        &["--count", "3"][..],
        &["--imperfect", "--campaigns", "3"],
        &["--imperfect", "--without", "nothing-known"],
        &["--imperfect", "--count", "0"],
    ] {
        let assert = Command::cargo_bin("vre")?
            .arg("blind-check")
            .args(wrong)
            .assert();
        let told = String::from_utf8(assert.code(2).get_output().stderr.clone())?;
        assert_eq!(told.lines().count(), 1, "{told}");
    }
    Ok(())
}
