//! A capture that is stopped by whatever, at any moment, loses at most the reading that was under way.

#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use host::campaign::Campaign;
use host::capture::{Ledger, RECORD};

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Positions of the plan.
const POSITIONS: usize = 48;
/// Shaker runs after them.
const RUNS: usize = 1;

fn vre() -> Command {
    Command::new(env!("CARGO_BIN_EXE_vre"))
}

fn capture(option: &str, folder: &Path) -> Command {
    let mut command = vre();
    command.args(["capture", "--plan", "paper", "--runs", "1", option]);
    command.arg(folder);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn begin(folder: &Path) -> Outcome<Child> {
    Ok(capture("--out", folder).spawn()?)
}

fn done(mut command: Command) -> Outcome<Output> {
    let output = command.output()?;
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{told}");
    Ok(output)
}

/// What is told of a failure: one line.
fn one_line(output: &Output) -> String {
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(told.lines().count(), 1, "{told}");
    assert!(told.starts_with("error: "), "{told}");
    told
}

fn reduce(folder: &Path) -> Command {
    let mut command = vre();
    command.arg("reduce").arg(folder);
    command
}

/// Whole readings by the record.
fn in_record(folder: &Path) -> Outcome<usize> {
    let file = folder.join(RECORD);
    if !file.exists() {
        return Ok(0);
    }
    Ok(Ledger::read(&file)?.0.readings().count())
}

/// Readings in the table; without one, none.
fn in_table(folder: &Path) -> Outcome<usize> {
    match folder.join("static.csv").exists() {
        true => Ok(Campaign::read(folder)?.readings.len()),
        false => Ok(0),
    }
}

/// What is in a folder whose capture has ended is a campaign or stands in nobody's way, and the capture goes on to its end.
fn assert_nothing_is_lost(folder: &Path, told: &str) -> Outcome {
    let whole = in_record(folder)?;
    let rows = in_table(folder)?;
    assert!(
        rows == whole || rows + 1 == whole,
        "{told}: {rows} rows, {whole} whole readings"
    );
    if whole == 0 {
        done(capture("--out", folder))?;
    } else {
        // The record alone is enough.
        for table in ["campaign.toml", "static.csv", "vibration.csv"] {
            let _ = fs::remove_file(folder.join(table));
        }
        done(reduce(folder))?;
        assert_eq!(in_table(folder)?, whole, "{told}");
        done(capture("--resume", folder))?;
    }
    let campaign = Campaign::read(folder)?;
    assert_eq!(
        (campaign.readings.len(), campaign.runs.len()),
        (POSITIONS, RUNS),
        "{told}"
    );
    let mut orders: Vec<u64> = campaign
        .readings
        .iter()
        .map(|reading| reading.order)
        .collect();
    orders.dedup();
    assert_eq!(orders.len(), POSITIONS, "{told}");
    Ok(())
}

/// Kills captures at moments spread over their whole time.
fn kill(signal: &str, times: u32) -> Outcome {
    let whole = tempfile::tempdir()?;
    let begun = Instant::now();
    done(capture("--out", &whole.path().join("campaign")))?;
    let takes = begun.elapsed();
    for n in 0..times {
        let folder = tempfile::tempdir()?;
        let folder = folder.path().join("campaign");
        let child = begin(&folder)?;
        thread::sleep(takes * n / times);
        let mut kill = Command::new("kill");
        kill.arg(format!("-{signal}")).arg(child.id().to_string());
        // One that has ended already needs none.
        let _ = kill.stderr(Stdio::null()).status()?;
        let output = child.wait_with_output()?;
        if signal != "KILL" && !output.status.success() && output.status.code().is_some() {
            let told = one_line(&output);
            assert!(told.contains("stopped: "), "{told}");
            assert_eq!(in_table(&folder)?, in_record(&folder)?, "in order: {told}");
        }
        assert_nothing_is_lost(&folder, &format!("{signal} {n} of {times}"))?;
    }
    Ok(())
}

#[test]
fn a_capture_killed_at_any_moment_loses_nothing_that_was_whole() -> Outcome {
    kill("KILL", 16)
}

#[test]
fn a_capture_interrupted_at_any_moment_is_closed_in_order() -> Outcome {
    kill("INT", 8)?;
    kill("TERM", 8)
}

/// A limit on the size of files stands for a full disk: the write fails, in the middle of a frame.
#[test]
fn on_a_full_disk_what_was_whole_is_kept_and_the_capture_goes_on_when_there_is_room() -> Outcome {
    for half_kilobytes in [1, 8, 100, 700, 1500] {
        let folder = tempfile::tempdir()?;
        let folder = folder.path().join("campaign");
        let mut command = Command::new("sh");
        command.args([
            "-c",
            "trap '' XFSZ; ulimit -f \"$1\"; shift; exec \"$@\"",
            "sh",
        ]);
        command.arg(half_kilobytes.to_string());
        command.arg(env!("CARGO_BIN_EXE_vre"));
        command
            .args(["capture", "--plan", "paper", "--runs", "1", "--out"])
            .arg(&folder);
        let output = command.output()?;
        assert_eq!(output.status.code(), Some(1));
        let told = one_line(&output);
        assert!(told.contains("cannot be written"), "{told}");
        assert_nothing_is_lost(&folder, &told)?;
    }
    Ok(())
}

#[test]
fn two_captures_in_one_folder_are_refused_and_the_first_comes_to_its_end() -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path().join("campaign");
    let first = begin(&folder)?;
    while !folder.join(RECORD).exists() {
        thread::sleep(Duration::from_millis(2));
    }
    for option in ["--out", "--resume"] {
        let output = capture(option, &folder).arg("--seed").arg("1").output()?;
        assert_eq!(output.status.code(), Some(2));
        assert!(one_line(&output).contains("a capture is at work"));
    }
    let output = first.wait_with_output()?;
    assert!(output.status.success());
    assert_eq!(in_table(&folder)?, POSITIONS);
    Ok(())
}

#[test]
fn a_folder_that_cannot_be_written_is_one_line() -> Outcome {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("file");
    fs::write(&file, "")?;
    let output = capture("--out", &file.join("campaign")).output()?;
    assert_eq!(output.status.code(), Some(1));
    assert!(one_line(&output).contains("cannot be written"));
    Ok(())
}

/// A record that was cut anywhere, as by a power failure, and one with a damaged stretch.
#[test]
fn a_record_cut_or_damaged_anywhere_gives_what_is_whole_in_it() -> Outcome {
    let folder = tempfile::tempdir()?;
    let whole = folder.path().join("whole");
    done(capture("--out", &whole))?;
    let record = fs::read(whole.join(RECORD))?;
    let mut last = 0;
    for n in 0..=12 {
        let cut = folder.path().join(format!("cut-{n}"));
        fs::create_dir(&cut)?;
        fs::write(cut.join(RECORD), &record[..record.len() * n / 12])?;
        let readings = in_record(&cut)?;
        assert!(readings >= last);
        last = readings;
        let output = reduce(&cut).output()?;
        if readings == 0 {
            assert_eq!(output.status.code(), Some(2));
            one_line(&output);
        } else {
            assert!(output.status.success());
            assert_eq!(in_table(&cut)?, readings);
        }
    }
    assert_eq!(last, POSITIONS);
    let mut damaged = record.clone();
    let middle = record.len() / 3;
    damaged[middle..middle + 40].fill(0xa5);
    let at = folder.path().join("damaged");
    fs::create_dir(&at)?;
    fs::write(at.join(RECORD), &damaged)?;
    done(reduce(&at))?;
    assert!(in_table(&at)? >= POSITIONS - 1);
    Ok(())
}

#[test]
fn tables_that_a_person_has_changed_are_written_over_by_force_alone() -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path().join("campaign");
    done(capture("--out", &folder))?;
    done(reduce(&folder))?;
    let table = folder.join("static.csv");
    let text = fs::read_to_string(&table)?;
    let rows: Vec<&str> = text.lines().collect();
    fs::write(&table, rows[..40].join("\n"))?;
    let refused = reduce(&folder).output()?;
    assert_eq!(refused.status.code(), Some(2));
    assert!(one_line(&refused).contains("--force"));
    assert_eq!(in_table(&folder)?, 39);
    let mut forced = reduce(&folder);
    forced.arg("--force");
    done(forced)?;
    assert_eq!(fs::read_to_string(&table)?, text);
    Ok(())
}

/// Whatever moment it is killed at, no file of a simulated campaign is half, and once more makes it whole.
#[test]
fn a_simulation_killed_at_any_moment_leaves_no_half_file_and_is_made_again() -> Outcome {
    let folder = tempfile::tempdir()?;
    let simulate = |at: &Path| {
        let mut command = vre();
        command
            .args(["simulate", "--seed", "5", "--force", "--out"])
            .arg(at);
        command.stdout(Stdio::null());
        command
    };
    let whole = folder.path().join("whole");
    let begun = Instant::now();
    done(simulate(&whole))?;
    let takes = begun.elapsed();
    for n in 0..8 {
        let at = folder.path().join(format!("killed-{n}"));
        let mut child = simulate(&at).spawn()?;
        thread::sleep(takes * n / 8);
        child.kill()?;
        child.wait()?;
        let files = match at.is_dir() {
            true => fs::read_dir(&at)?.collect::<Result<Vec<_>, _>>()?,
            false => Vec::new(),
        };
        // A new file has a hidden name until it is whole, and a kill in that moment leaves it: no table of a campaign.
        let hidden = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with('.');
        for file in files.into_iter().filter(|file| !hidden(&file.file_name())) {
            let expected = fs::read(whole.join(file.file_name()))?;
            assert!(
                fs::read(file.path())? == expected,
                "{:?} is half",
                file.file_name()
            );
        }
        done(simulate(&at))?;
        for name in ["campaign.toml", "static.csv", "vibration.csv", "truth.json"] {
            assert!(
                fs::read(at.join(name))? == fs::read(whole.join(name))?,
                "{name}"
            );
        }
    }
    Ok(())
}

/// A short plan, and the answers of somebody who turns the dial at once.
const SHORT_PLAN: &str = "series,dial_deg\n1,0\n1,90\n1,180\n2,0\n2,90\n2,180\n3,0\n3,90\n";
const SHORT: usize = 8;

fn by_hand(option: &str, folder: &Path, plan: &Path) -> Command {
    let mut command = vre();
    command.args(["capture", "--by-hand", "--dwell", "0.2", "--settle", "0.05"]);
    if option == "--out" {
        command.arg("--plan").arg(plan);
    }
    command.arg(option).arg(folder);
    command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// Runs with these answers, for so long at the most; killed then.
fn answered(
    mut command: Command,
    answers: &str,
    killed_after: Option<Duration>,
) -> Outcome<Output> {
    let mut child = command.spawn()?;
    let mut stdin = child.stdin.take().ok_or("standard input")?;
    std::io::Write::write_all(&mut stdin, answers.as_bytes())?;
    match killed_after {
        Some(time) => {
            thread::sleep(time);
            child.kill()?;
        }
        None => drop(stdin),
    }
    Ok(child.wait_with_output()?)
}

#[test]
fn a_test_by_hand_that_was_killed_goes_on_where_it_was_with_its_own_plan() -> Outcome {
    let folder = tempfile::tempdir()?;
    let plan = folder.path().join("plan.csv");
    fs::write(&plan, SHORT_PLAN)?;
    let mut went_on = 0;
    for n in 0..5 {
        let at = folder.path().join(format!("killed-{n}"));
        let time = Duration::from_millis(400 + 700 * n);
        answered(
            by_hand("--out", &at, &plan),
            &"\n".repeat(SHORT),
            Some(time),
        )?;
        let whole = in_record(&at)?;
        let rows = in_table(&at)?;
        assert!(
            rows == whole || rows + 1 == whole,
            "{rows} rows, {whole} whole readings"
        );
        if whole == 0 || whole == SHORT {
            continue;
        }
        went_on += 1;
        // The dial's answers for what is left, and no more.
        let answers = "\n".repeat(SHORT - whole);
        let output = answered(by_hand("--resume", &at, &plan), &answers, None)?;
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        assert!(
            told.contains(&format!("{} of {SHORT}: ", whole + 1)),
            "{told}"
        );
        let campaign = Campaign::read(&at)?;
        assert_eq!(campaign.readings.len(), SHORT, "{told}");
        // Switched off in between, it has another bias.
        let sessions = |k: usize| campaign.readings[k].session.clone();
        assert!(sessions(0).is_some() && sessions(0) != sessions(SHORT - 1));
    }
    assert!(went_on >= 2, "{went_on} of 5 were killed in the middle");
    Ok(())
}

#[test]
fn another_instrument_than_that_of_the_record_is_refused_before_it_speaks_in_it() -> Outcome {
    let folder = tempfile::tempdir()?;
    let plan = folder.path().join("plan.csv");
    fs::write(&plan, SHORT_PLAN)?;
    let at = folder.path().join("campaign");
    answered(by_hand("--out", &at, &plan), "\n\nq\n", None)?;
    let record = fs::read(at.join(RECORD))?;
    let mut other = by_hand("--resume", &at, &plan);
    other.args(["--seed", "2"]);
    let output = answered(other, "\n", None)?;
    assert_eq!(output.status.code(), Some(1));
    assert!(one_line(&output).contains("the record is of"));
    let instruments = Ledger::read(&at.join(RECORD))?.0;
    assert_eq!(instruments.readings().count(), 2);
    assert!(fs::read(at.join(RECORD))?.starts_with(&record));
    Ok(())
}

#[test]
fn a_reading_that_was_taken_back_is_in_no_table() -> Outcome {
    let folder = tempfile::tempdir()?;
    let plan = folder.path().join("plan.csv");
    fs::write(&plan, SHORT_PLAN)?;
    let at = folder.path().join("campaign");
    // Measured, taken back, and no more.
    answered(by_hand("--out", &at, &plan), "\nr\nq\n", None)?;
    assert!(!at.join("static.csv").exists());
    let output = reduce(&at).output()?;
    assert!(one_line(&output).contains("no whole reading"));
    // It stands in nobody's way.
    answered(by_hand("--out", &at, &plan), "\n\nq\n", None)?;
    assert_eq!(in_table(&at)?, 2);
    Ok(())
}
