//! `vre capture --port`: the virtual board at the far end of a pseudo-terminal, a person's answers on standard input.

#![cfg(unix)]

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use firmware::adc::registers::Config;
use host::bench::board::VirtualBoard;
use host::bench::converter::{Converter, Signal};
use host::campaign::Campaign;
use host::statics::{Method, identify};
use host::verification::verify;
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use shared::tumble::{Position, Series};
use shared::wire::{self, Deframer};

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Conversions between two looks at the line.
const STEP: u64 = 40;
const STEP_TIME: Duration = Duration::from_millis(10);

/// An instrument at rest on a dial that stands where the host says, with some
/// noise.
struct AtRest {
    input_v: f64,
    /// Scale factor at the converter, V/g.
    scale_v_per_g: f64,
    noise: u64,
}

impl Signal for AtRest {
    fn fill(&mut self, _: f64, _: f64, out: &mut [[f64; 4]]) {
        for input in out.as_flattened_mut() {
            // Knuth's linear congruence; the upper bits.
            let next = self.noise.wrapping_mul(6_364_136_223_846_793_005);
            self.noise = next.wrapping_add(1_442_695_040_888_963_407);
            *input = self.input_v + 1e-6 * (self.noise >> 40) as f64 / f64::from(1 << 24);
        }
    }
}

/// The virtual board at the far end of a line, running in real time.
struct Instrument {
    port: PathBuf,
    ends: Arc<AtomicBool>,
    board: Option<JoinHandle<()>>,
}

impl Instrument {
    /// One of 1.2 V/g behind a divider by ten; the cable is pulled after so many bytes from the host.
    fn start(pulled_after: u64) -> Outcome<Self> {
        Self::with_scale(0.12, pulled_after)
    }

    /// One with that scale factor at the converter.
    fn with_scale(scale_v_per_g: f64, pulled_after: u64) -> Outcome<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let mut raw = tcgetattr(&master)?;
        raw.make_raw();
        tcsetattr(&master, OptionalActions::Now, &raw)?;
        fcntl_setfl(&master, OFlags::RDWR | OFlags::NONBLOCK)?;
        let port = PathBuf::from(ptsname(&master, Vec::new())?.into_string()?);
        let ends = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&ends);
        let board = thread::spawn(move || converse(master, scale_v_per_g, pulled_after, &ended));
        Ok(Self {
            port,
            ends,
            board: Some(board),
        })
    }
}

impl Drop for Instrument {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(board) = self.board.take() {
            board.join().expect("the board runs");
        }
    }
}

fn converse(master: OwnedFd, scale_v_per_g: f64, pulled_after: u64, ended: &AtomicBool) {
    let mut line = File::from(master);
    let mut board = VirtualBoard::new(Converter::new(Config::default()), 40, *b"virtualboard");
    let mut commands = Deframer::new();
    let mut heard = 0;
    let mut signal = AtRest {
        input_v: 0.0,
        scale_v_per_g,
        noise: 1,
    };
    let mut bytes = [0; 1024];
    while !ended.load(Ordering::Relaxed) && heard < pulled_after {
        let begun = Instant::now();
        // Nobody at the other end is no trouble.
        if let Ok(length) = line.read(&mut bytes) {
            board.receive(&bytes[..length]);
            turn(&mut commands, &bytes[..length], &mut signal);
            heard += length as u64;
        }
        board.run(STEP, &mut signal, &mut |bytes| {
            // What does not fit is lost, as on a line.
            let _ = line.write(bytes);
        });
        thread::sleep(STEP_TIME.saturating_sub(begun.elapsed()));
    }
}

/// The dial is where the reading says.
fn turn(commands: &mut Deframer, mut bytes: &[u8], signal: &mut AtRest) {
    while !bytes.is_empty() {
        let (taken, packet) = commands.feed(bytes);
        bytes = &bytes[taken..];
        let Some(Ok(packet)) = packet else { continue };
        if let Ok(wire::Command::StartPosition(position)) = packet.message() {
            let dial = Position {
                series: Series::try_from(position.series).expect("a series"),
                dial_deg: position.dial_deg,
                mount_deg: position.mount_deg,
            };
            signal.input_v = signal.scale_v_per_g * dial.specific_force().i;
        }
    }
}

/// What lies between the instruments of these tests and the converter.
const DIVIDER: &str = "divider = 10.0";

fn bench(folder: &Path, front_end: &str) -> Outcome<PathBuf> {
    let file = folder.join("bench.toml");
    let text = r#"format = "vre-campaign/1"
[instrument]
serial = "S01000"
scale_factor_nominal_v_per_g = 1.2
full_scale_g = 10.0
[bench]
dial_sigma_arcsec = 1.0
level_sigma_arcsec = 1.0
local_gravity_g = 1.0
reference_temp_c = 22.0
[acquisition]
sample_rate_hz = 400.0
"#;
    std::fs::write(&file, format!("{text}{front_end}\n"))?;
    Ok(file)
}

fn capture(port: &Path, folder: &Path, answers: &str) -> Outcome<assert_cmd::assert::Assert> {
    capture_behind(DIVIDER, port, folder, answers)
}

fn capture_behind(
    front_end: &str,
    port: &Path,
    folder: &Path,
    answers: &str,
) -> Outcome<assert_cmd::assert::Assert> {
    let mut command = Command::cargo_bin("vre")?;
    command.args([
        "capture", "--plan", "paper", "--dwell", "0.2", "--settle", "0.02",
    ]);
    command.arg("--port").arg(port);
    command.arg("--bench").arg(bench(folder, front_end)?);
    command.arg("--out").arg(folder.join("campaign"));
    Ok(command.write_stdin(answers).assert())
}

#[test]
fn a_person_walks_through_the_plan_and_host_and_instrument_agree() -> Outcome {
    let folder = tempfile::tempdir()?;
    let instrument = Instrument::start(u64::MAX)?;
    // The paper's 48 positions, two of them left out.
    let answers = format!("s\n{}s\n", "\n".repeat(46));
    let assert = capture(&instrument.port, folder.path(), &answers)?.success();
    let told = String::from_utf8(assert.get_output().stdout.clone())?;
    assert!(told.contains("1 of 48: series 1, mounted at 0 deg: dial 0 deg, counter-clockwise"));
    assert!(told.contains("46 readings, 2 positions left out"), "{told}");
    assert!(told.contains("0 missing with 0 frames lost"), "{told}");
    let out = folder.path().join("campaign");
    assert_eq!(Campaign::read(&out)?.readings.len(), 46);
    let found = verify(&out)?;
    assert!(found.agrees(), "{found:?}");
    assert_eq!(found.instrument.readings, 46);
    Ok(())
}

#[test]
fn readings_are_volts_at_the_instruments_output_by_the_front_end_of_its_own_bench() -> Outcome {
    for (front_end, scale_at_converter, told) in [
        (
            "divider = 8.0\ngain = 2.0",
            0.3,
            "divider 8, gain 2 (as stated in",
        ),
        ("", 1.1, "straight to the converter (no divider or gain is"),
    ] {
        let folder = tempfile::tempdir()?;
        let instrument = Instrument::with_scale(scale_at_converter, u64::MAX)?;
        let assert = capture_behind(front_end, &instrument.port, folder.path(), "\n\nq\n")?;
        let output = String::from_utf8(assert.success().get_output().stdout.clone())?;
        assert!(output.contains(told), "{output}");
        let campaign = Campaign::read(&folder.path().join("campaign"))?;
        // At 0 and at 45 deg of series 1.
        let expected_v = if front_end.is_empty() { 1.1 } else { 1.2 };
        for (reading, a_i) in campaign.readings.iter().zip([-1.0, -0.5_f64.sqrt()]) {
            // The dial moves as the reading begins: one or two of its 800 conversions are still of the position before.
            let output_v = reading.output_v;
            assert!((output_v - expected_v * a_i).abs() < 4e-3, "{output_v}");
        }
    }
    Ok(())
}

#[test]
fn a_cable_pulled_in_the_middle_is_one_line_and_what_was_captured_remains() -> Outcome {
    let folder = tempfile::tempdir()?;
    // Greeting, self-check and some positions.
    let instrument = Instrument::start(400)?;
    let answers = "\n".repeat(48);
    let assert = capture(&instrument.port, folder.path(), &answers)?.code(1);
    let told = String::from_utf8(assert.get_output().stderr.clone())?;
    let port = instrument.port.display();
    assert_eq!(told.lines().count(), 1, "{told}");
    assert!(
        told.starts_with(&format!("error: {port}: lost: ")),
        "{told}"
    );
    let out = folder.path().join("campaign");
    let readings = Campaign::read(&out)?.readings.len();
    assert!((1..48).contains(&readings), "{readings}");
    assert!(out.join("record.vre").metadata()?.len() > 10_000);
    // Nothing is written over.
    let again = Instrument::start(u64::MAX)?;
    capture(&again.port, folder.path(), "q\n")?.code(2);
    assert_eq!(Campaign::read(&out)?.readings.len(), readings);
    Ok(())
}

#[test]
fn a_port_without_an_instrument_is_one_line() -> Outcome {
    let folder = tempfile::tempdir()?;
    let instrument = Instrument::start(0)?;
    let missing = folder.path().join("no-such-port");
    for (port, status) in [(missing, 2), (instrument.port.clone(), 2)] {
        let assert = capture(&port, folder.path(), "")?.code(status);
        let told = String::from_utf8(assert.get_output().stderr.clone())?;
        assert_eq!(told.lines().count(), 1, "{told}");
    }
    Ok(())
}

/// A campaign of the virtual bench.
fn simulate(folder: &Path, name: &str, more: &[&str]) -> Outcome<PathBuf> {
    let out = folder.join(name);
    let mut command = Command::cargo_bin("vre")?;
    command.args(["simulate", "--seed", "3", "--out"]).arg(&out);
    command.args(more).assert().success();
    Ok(out)
}

/// What the command finds in a campaign, in a file.
fn diagnose(campaign: &Path) -> Outcome<PathBuf> {
    let file = campaign.join("diagnosis.json");
    let mut command = Command::cargo_bin("vre")?;
    command
        .arg("diagnose")
        .arg(campaign)
        .arg("--json")
        .arg(&file);
    command.assert().success();
    Ok(file)
}

#[test]
fn a_diagnosis_that_hands_nothing_over_is_one_line_and_reaches_no_instrument() -> Outcome {
    let folder = tempfile::tempdir()?;
    let bare = simulate(folder.path(), "bare", &[])?;
    let diagnosis = diagnose(&bare)?;
    let text = std::fs::read_to_string(&diagnosis)?;
    let write = |name: &str, text: &str| -> Outcome<PathBuf> {
        let file = folder.path().join(name);
        std::fs::write(&file, text)?;
        Ok(file)
    };
    let serial = Campaign::read(&bare)?.config.instrument.serial;
    let mut unexplained: serde_json::Value = serde_json::from_str(&text)?;
    unexplained["compensation"] = serde_json::Value::Null;
    for (file, says) in [
        (diagnosis, "holds no term"),
        (
            write("other.json", &text.replace(&serial, "other"))?,
            "is of instrument other",
        ),
        (write("none.json", &unexplained.to_string())?, "unexplained"),
        (write("nonsense.json", "nonsense")?, "nonsense.json"),
        (folder.path().join("missing.json"), "cannot be read"),
    ] {
        let mut command = Command::cargo_bin("vre")?;
        command
            .arg("configure")
            .arg(&bare)
            .arg("--diagnosis")
            .arg(&file);
        let assert = command.args(["--port", "no-such-port"]).assert().code(2);
        let told = String::from_utf8(assert.get_output().stderr.clone())?;
        assert_eq!(told.lines().count(), 1, "{told}");
        assert!(told.contains(says), "{told}");
    }
    Ok(())
}

#[test]
fn an_instrument_keeps_the_coefficients_it_is_given_shows_them_and_forgets_them() -> Outcome {
    let folder = tempfile::tempdir()?;
    let campaign = simulate(folder.path(), "campaign", &[])?;
    let instrument = Instrument::start(u64::MAX)?;
    let configure = |more: &[&str]| -> Outcome<serde_json::Value> {
        let mut command = Command::cargo_bin("vre")?;
        command.args(["configure", "--json", "-", "--port"]);
        let assert = command.arg(&instrument.port).args(more).assert().success();
        Ok(serde_json::from_slice(&assert.get_output().stdout)?)
    };
    assert_eq!(configure(&[])?["writes"], 0);
    let given = configure(&[campaign.to_str().ok_or("a path")?, "--block", "80"])?;
    assert_eq!(given["fault"], serde_json::Value::Null);
    assert!(given["writes"].as_u64() >= Some(1), "{given}");
    let shown = configure(&[])?;
    assert_eq!(shown, given);
    let serial = Campaign::read(&campaign)?.config.instrument.serial;
    let kept = &shown["provenance"];
    assert_eq!(kept["serial"], serial.as_str());
    assert_eq!(kept["accepted_by"], serde_json::json!([0, 1, 0]));
    assert!(kept["temperature_c"][0].as_f64() <= kept["temperature_c"][1].as_f64());
    let kept = &shown["configuration"];
    assert_eq!(kept["compensation"]["block_samples"], 80);
    // In volts at the converter: the simulated campaign states no front end.
    let found = identify(&Campaign::read(&campaign)?, Method::LeastSquares, None)?;
    let k1 = kept["calibration"]["coefficients"]["nominal"][0].as_f64();
    assert_eq!(k1, Some(found.model.scale_factor_v_per_g));
    // As it states one, and as the option says otherwise.
    let file = campaign.join("campaign.toml");
    let stated = std::fs::read_to_string(&file)?
        .replace("[acquisition]", "[acquisition]\ndivider = 10.0\ngain = 2.0");
    std::fs::write(&file, stated)?;
    for (more, ratio) in [(&[][..], 5.0), (&["--divider", "4"], 4.0)] {
        let mut arguments = vec![campaign.to_str().ok_or("a path")?];
        arguments.extend(more);
        let given = configure(&arguments)?;
        let k1 = given["configuration"]["calibration"]["coefficients"]["nominal"][0].as_f64();
        let expected = found.model.scale_factor_v_per_g / ratio;
        assert!(k1.is_some_and(|k1| (k1 / expected - 1.0).abs() < 1e-14));
    }

    // With what a diagnosis found beyond the nominal model.
    let odd = simulate(folder.path(), "odd", &["--effect", "odd-quadratic"])?;
    let diagnosis = diagnose(&odd)?;
    let odd = odd.to_str().ok_or("a path")?;
    let file = diagnosis.to_str().ok_or("a path")?;
    let given = configure(&[odd, "--diagnosis", file])?;
    let calibration = &given["configuration"]["calibration"];
    let told: serde_json::Value = serde_json::from_slice(&std::fs::read(&diagnosis)?)?;
    let found = &told["compensation"]["coefficients"]["odd_quadratic_per_g"];
    assert!(found.as_f64().is_some_and(|koq| koq != 0.0), "{told}");
    assert_eq!(calibration["coefficients"]["further"][2], *found);
    assert_eq!(calibration["rank"], 11);
    assert_eq!(
        configure(&["--erase"])?["configuration"],
        serde_json::Value::Null
    );
    Ok(())
}

#[test]
fn another_instruments_coefficients_are_replaced_only_by_force() -> Outcome {
    let folder = tempfile::tempdir()?;
    let campaign = simulate(folder.path(), "campaign", &[])?;
    let other = simulate(folder.path(), "other", &[])?;
    let file = other.join("campaign.toml");
    let serial = Campaign::read(&other)?.config.instrument.serial;
    let text = std::fs::read_to_string(&file)?;
    std::fs::write(&file, text.replace(&serial, "S99999"))?;
    let instrument = Instrument::start(u64::MAX)?;
    let configure = |what: &Path, more: &[&str]| -> Outcome<assert_cmd::assert::Assert> {
        let mut command = Command::cargo_bin("vre")?;
        command.arg("configure").arg(what).args(more);
        Ok(command.arg("--port").arg(&instrument.port).assert())
    };
    configure(&campaign, &["--bias-drift", "50"])?.success();
    let refused = configure(&other, &[])?.code(2);
    let told = String::from_utf8(refused.get_output().stderr.clone())?;
    assert_eq!(told.lines().count(), 1, "{told}");
    assert!(told.contains(&serial) && told.contains("S99999"), "{told}");
    let forced = configure(&other, &["--force"])?.success();
    let told = String::from_utf8(forced.get_output().stdout.clone())?;
    assert!(told.contains("Instrument S99999"), "{told}");
    Ok(())
}

#[test]
fn a_board_is_brought_up_by_one_command_that_says_what_must_be_seen() -> Outcome {
    let instrument = Instrument::start(u64::MAX)?;
    let mut command = Command::cargo_bin("vre")?;
    command.args([
        "bring-up", "--time", "1", "--write", "--json", "-", "--port",
    ]);
    let assert = command.arg(&instrument.port).assert();
    let rows: serde_json::Value = serde_json::from_slice(&assert.get_output().stdout)?;
    let row = |name: &str| {
        let rows = rows.as_array().expect("rows");
        let found = rows.iter().find(|row| row["name"] == name);
        found
            .unwrap_or_else(|| panic!("no row {name}: {rows:?}"))
            .clone()
    };
    // What the virtual board can show.
    for name in [
        "converter: wrong CRC, set-ups",
        "DRDY against the board's clock",
        "cause of the last reset",
        "memory: write, read, erase",
    ] {
        assert_eq!(row(name)["passed"], true, "{}", row(name));
    }
    // It has no supply that could fall, and says so; a measurement that fails is an exit status.
    assert_eq!(row("brown-out level 3")["passed"], false);
    assert.code(1);
    Ok(())
}
