//! The measured shift of a mean, its uncertainty, and what else could have made it.

#[path = "common/noise.rs"]
mod noise;

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use host::measure::{
    Calibration, Columns, Doubt, Kind, Measurement, MotionKind, Outcome, Request, Selection,
    Verdict, measure,
};
use noise::{Geometry, Interval, Noise};
use proptest::prelude::*;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use shared::moments::Accumulator;
use shared::wire::Event;
use shared::wire::framing::Frame;
use shared::wire::message::{Block, Identity, Plateau, Raw, Run, Segment, pack};
use shared::wire::version::{CURRENT, MINIMUM};

fn normal(rng: &mut StdRng) -> f64 {
    StandardNormal.sample(rng)
}

fn calibration() -> Calibration {
    Calibration {
        units_per_g: 1.0,
        full_scale_g: None,
        temperature_sensitivity_g_per_c: None,
    }
}

fn columns(outputs: &[&str]) -> Columns {
    Columns {
        outputs: outputs.iter().map(|&name| name.into()).collect(),
        time: None,
        temperature: None,
    }
}

fn windows(before: &str, during: &str) -> Request {
    Request {
        columns: Columns {
            time: Some(("t".into(), 1.0)),
            ..columns(&["u"])
        },
        selection: Some(Selection::parse(None, before, during, None).unwrap()),
        run: None,
        calibration: calibration(),
    }
}

fn groups(outputs: &[&str]) -> Request {
    Request {
        columns: columns(outputs),
        selection: Some(Selection::parse(Some("file"), "quiet*", "saw*", None).unwrap()),
        run: None,
        calibration: calibration(),
    }
}

fn run(content: &[u8], request: &Request) -> Result<Measurement, host::error::Error> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("raw.csv");
    fs::write(&file, content).unwrap();
    measure(&file, request)
}

/// One record at 200 Hz: 10 s at rest, 15 s under a sine and the shift.
fn one_record(rng: &mut StdRng, shift: f64) -> String {
    let mut table = String::from("t,u\n");
    let (frequency, phase) = (
        rng.random_range(15.0..60.0),
        rng.random_range(0.0..std::f64::consts::TAU),
    );
    for n in 0..5000 {
        let t = f64::from(n) / 200.0;
        let shaken = shift + (std::f64::consts::TAU * frequency * t + phase).sin();
        let u = 1e-3 * normal(rng) + if t >= 10.0 { shaken } else { 0.0 };
        let _ = writeln!(table, "{t},{u}");
    }
    table
}

/// Six files on either side of 200 samples; `offset` gives a file's mean on each axis.
fn files(rng: &mut StdRng, offset: impl Fn(&mut StdRng, usize, bool) -> [f64; 3]) -> String {
    let mut table = String::from("file,x,y,z\n");
    for file in 0..12 {
        let during = file >= 6;
        let name = if during { "saw" } else { "quiet" };
        let mean = offset(rng, file, during);
        for _ in 0..200 {
            let [x, y, z] = mean.map(|mean| mean + 1e-3 * normal(rng));
            let _ = writeln!(table, "{name}{file},{x},{y},{z}");
        }
    }
    table
}

#[test]
fn the_shift_in_one_record_lies_in_its_interval_as_often_as_claimed() {
    let seeds = 150;
    let held = (0..seeds)
        .filter(|&seed| {
            let table = one_record(&mut StdRng::seed_from_u64(seed), 5e-4);
            let found = run(table.as_bytes(), &windows("0..10", "10..30")).unwrap();
            let [low, high] = found.axes[0].interval_95_g;
            (low..high).contains(&5e-4)
        })
        .count();
    assert!(held as f64 > 0.88 * seeds as f64, "{held} of {seeds}");
}

#[test]
fn a_shift_in_one_record_is_attributed_and_none_is_not() {
    let mut rng = StdRng::seed_from_u64(1);
    for (shift, verdict) in [(0.0, Verdict::NoShift), (5e-3, Verdict::Shift)] {
        let table = one_record(&mut rng, shift);
        assert_eq!(
            run(table.as_bytes(), &windows("0..10", "10..30"))
                .unwrap()
                .verdict,
            verdict
        );
    }
}

#[test]
fn the_scatter_between_files_counts() {
    let seeds = 150;
    let held = (0..seeds)
        .filter(|&seed| {
            let mut rng = StdRng::seed_from_u64(seed);
            let table = files(&mut rng, |rng, _, during| {
                [0, 1, 2].map(|_| 2e-3 * normal(rng) + if during { 1e-3 } else { 0.0 })
            });
            let found = run(table.as_bytes(), &groups(&["x"])).unwrap();
            let [low, high] = found.axes[0].interval_95_g;
            (low..high).contains(&1e-3)
        })
        .count();
    assert!(held as f64 > 0.88 * seeds as f64, "{held} of {seeds}");
}

#[test]
fn a_turn_of_the_instrument_is_not_called_a_vibration_error() {
    let table = files(&mut StdRng::seed_from_u64(2), |_, _, during| {
        let angle = if during { 0.01f64 } else { 0.0 };
        [angle.cos(), angle.sin(), 0.0]
    });
    let found = run(table.as_bytes(), &groups(&["x", "y", "z"])).unwrap();
    assert_eq!(found.axes[1].verdict, Verdict::NotAttributable);
    assert_eq!(found.verdict, Verdict::NotAttributable);
    let one_axis = run(table.as_bytes(), &groups(&["y"])).unwrap();
    assert_eq!(one_axis.verdict, Verdict::NotAttributable);
}

#[test]
fn a_shift_that_the_temperature_explains_is_not_called_a_vibration_error() {
    let mut rng = StdRng::seed_from_u64(3);
    let mut table = String::from("t,u,temp\n");
    for n in 0..4000 {
        let temperature = if n < 2000 { 25.0 } else { 26.5 };
        let shaken = if n < 2000 {
            0.0
        } else {
            0.05 * normal(&mut rng)
        };
        let u = 1e-3 * normal(&mut rng) + shaken + 6e-3 * (temperature - 25.0);
        let _ = writeln!(table, "{n},{u},{temperature}");
    }
    let mut request = windows("0..2000", "2000..4000");
    request.columns.temperature = Some("temp".into());
    let unknown = run(table.as_bytes(), &request).unwrap();
    assert_eq!(unknown.verdict, Verdict::NotAttributable);
    assert_eq!(unknown.axes[0].rivals[0].kind, Kind::Temperature);
    assert_eq!(unknown.axes[0].rivals[0].size_g, None);
    // A sensitivity that is known to be small acquits the temperature.
    request.calibration.temperature_sensitivity_g_per_c = Some(1e-4);
    assert_eq!(
        run(table.as_bytes(), &request).unwrap().verdict,
        Verdict::Shift
    );
}

#[test]
fn the_sensitivity_to_temperature_is_found_in_four_quiet_files() {
    let mut rng = StdRng::seed_from_u64(4);
    let mut table = String::from("file,x,temp\n");
    for file in 0..8 {
        let temperature = 20.0 + f64::from(file);
        let name = if file >= 5 { "saw" } else { "quiet" };
        for _ in 0..400 {
            let x = 0.3 + 2e-3 * temperature + 1e-4 * normal(&mut rng);
            let _ = writeln!(table, "{name}{file},{x},{temperature}");
        }
    }
    let mut request = groups(&["x"]);
    request.columns.temperature = Some("temp".into());
    let axis = run(table.as_bytes(), &request).unwrap().axes.remove(0);
    assert_eq!(axis.verdict, Verdict::NotAttributable);
    let size = axis.rivals[0].size_g.unwrap();
    assert!((size - 8e-3).abs() < 1e-4, "{size}");
}

/// The vibration error is nil; all of the shift is what clipping cuts off on one side.
#[test]
fn clipping_is_a_rival_of_the_size_that_it_has() {
    let mut rng = StdRng::seed_from_u64(5);
    let mut table = String::from("t,u\n");
    for n in 0..60_000 {
        let sigma = if n < 20_000 { 0.003 } else { 0.5 };
        let u = (1.0 + sigma * normal(&mut rng)).clamp(-2.0, 2.0);
        let _ = writeln!(table, "{n},{u}");
    }
    let mut request = windows("0..20000", "20000..60000");
    request.calibration.full_scale_g = Some(2.0);
    let axis = run(table.as_bytes(), &request).unwrap().axes.remove(0);
    // sigma (phi(2) - 2 Q(2)) of a Gaussian with sigma = 0.5, 2 sigma below the limit.
    let expected = -0.5 * (0.053_990_97 - 2.0 * 0.022_750_13);
    let size = axis.rivals[0].size_g.unwrap();
    // The share of 40 000 samples is known to 3 %.
    assert!((size / expected - 1.0).abs() < 0.1, "{size} {expected}");
    assert!((axis.clipped_share - 0.02275).abs() < 0.003);
    assert!(axis.rivals[0].decisive && axis.verdict != Verdict::Shift);
}

#[test]
fn uneven_time_is_noted_and_time_that_runs_back_is_named_by_its_row() {
    let mut table = String::from("t,u\n");
    let mut t = 0.0;
    for n in 0..400 {
        t += if n == 300 { 0.5 } else { 0.01 };
        let _ = writeln!(table, "{t},{}", f64::from(n % 7));
    }
    let request = windows("0..2", "2..9");
    let found = run(table.as_bytes(), &request).unwrap();
    assert!(
        found
            .notes
            .iter()
            .any(|note| note.starts_with("irregular sampling: 1 "))
    );
    let _ = writeln!(table, "{},0", t - 0.1);
    let found = run(table.as_bytes(), &request).unwrap();
    let doubt = doubt(&found, Kind::TimeStamps);
    assert!(doubt.decisive, "{doubt:?}");
    assert!(doubt.finding.contains("row 402"), "{doubt:?}");
}

/// The doubt of a kind about the first axis.
fn doubt(found: &Measurement, kind: Kind) -> Doubt {
    let doubts = &found.axes[0].doubts;
    doubts
        .iter()
        .find(|doubt| doubt.kind == kind)
        .unwrap()
        .clone()
}

/// A record at 200 Hz: 20 s at rest, 20 s under a sine of 1 g with a shift of 5 mg, as `change` leaves a sample.
fn changed(change: impl Fn(usize, f64) -> f64) -> String {
    let mut rng = StdRng::seed_from_u64(11);
    let mut table = String::from("t,u\n");
    for n in 0..8000 {
        let t = n as f64 / 200.0;
        let shaken = 5e-3 + (std::f64::consts::TAU * 23.7 * t).sin();
        let u = 1e-3 * normal(&mut rng) + if n >= 4000 { shaken } else { 0.0 };
        let _ = writeln!(table, "{t},{}", change(n, u));
    }
    table
}

#[test]
fn a_record_with_a_fault_is_never_called_a_shift_and_the_fault_is_named() {
    let sound = run(changed(|_, u| u).as_bytes(), &windows("0..20", "20..40")).unwrap();
    assert_eq!(sound.verdict, Verdict::Shift);
    assert!(sound.axes[0].reasons.is_empty());
    type Change = fn(usize, f64) -> f64;
    let faults: [(Kind, Change); 7] = [
        (Kind::Clipping, |_, u| u.clamp(-0.9, 0.9)),
        (
            Kind::Stuck,
            |n, u| if (6000..6100).contains(&n) { 0.4 } else { u },
        ),
        (
            Kind::GrossSamples,
            |n, u| if n == 100 { u + 30.0 } else { u },
        ),
        (Kind::Quantisation, |_, u| (u / 0.05).round() * 0.05),
        (Kind::NoMoreVibration, |n, u| {
            if n < 4000 {
                u
            } else {
                5e-3 + 1e-3 * ((n * 7919 % 1000) as f64 / 500.0 - 1.0)
            }
        }),
        (Kind::Aliasing, |n, u| {
            if n < 4000 {
                u
            } else {
                0.3 * (n as f64 * 1.1e-3).sin() + 1e-3 * u
            }
        }),
        (Kind::GravityLength, |_, u| u),
    ];
    for (kind, change) in faults {
        let mut table = changed(change);
        let mut request = windows("0..20", "20..40");
        if kind == Kind::GravityLength {
            table = table
                .replace("t,u\n", "t,u,v,w\n")
                .lines()
                .map(|l| {
                    if l.starts_with('t') {
                        format!("{l}\n")
                    } else {
                        format!("{l},0.01,9.8\n")
                    }
                })
                .collect();
            request.columns = Columns {
                time: Some(("t".into(), 1.0)),
                ..columns(&["u", "v", "w"])
            };
        }
        let found = run(table.as_bytes(), &request).unwrap();
        assert_ne!(found.axes[0].verdict, Verdict::Shift, "{kind:?}");
        let doubt = doubt(&found, kind);
        assert!(
            doubt.decisive && doubt.outcome == Outcome::Found,
            "{doubt:?}"
        );
        assert!(
            sound.axes[0]
                .doubts
                .iter()
                .any(|d| d.kind == kind && !d.decisive),
            "{kind:?}"
        );
    }
}

#[test]
fn a_gross_sample_is_named_by_its_line_with_the_result_without_it() {
    let table = changed(|n, u| {
        if n == 0 {
            u + 2.0
        } else if n < 4000 {
            u
        } else {
            u - 5e-3
        }
    });
    let found = run(table.as_bytes(), &windows("0..20", "20..40")).unwrap();
    assert_ne!(found.verdict, Verdict::Shift);
    assert!(
        doubt(&found, Kind::GrossSamples)
            .finding
            .contains("in row 2;")
    );
    let without = found.axes[0].without_gross_g.unwrap();
    assert!(without.abs() < 1e-4, "{without}");
}

#[test]
fn a_drift_without_vibration_is_no_vibration_error() {
    let mut rng = StdRng::seed_from_u64(12);
    let mut table = String::from("t,u\n");
    for n in 0..8000 {
        let t = f64::from(n) / 200.0;
        let _ = writeln!(table, "{t},{}", 1e-4 * t + 1e-3 * normal(&mut rng));
    }
    let found = run(table.as_bytes(), &windows("0..10", "30..40")).unwrap();
    assert_eq!(found.verdict, Verdict::NotAttributable);
    let reasons = &found.axes[0].reasons;
    assert!(
        reasons.contains(&Kind::NoMoreVibration) && reasons.contains(&Kind::Drift),
        "{reasons:?}"
    );
}

#[test]
fn a_turn_between_windows_is_a_rival_of_the_axes_across_gravity() {
    let mut rng = StdRng::seed_from_u64(13);
    let mut table = String::from("t,x,y,z\n");
    for n in 0..8000 {
        let during = n >= 4000;
        let angle = if during { 0.01f64 } else { 0.0 };
        let mut axis = |mean: f64| mean + if during { 0.1 } else { 1e-3 } * normal(&mut rng);
        let [x, y, z] = [angle.sin(), 0.0, angle.cos()].map(&mut axis);
        let _ = writeln!(table, "{},{x},{y},{z}", f64::from(n) / 200.0);
    }
    let mut request = windows("0..20", "20..40");
    request.columns = Columns {
        time: Some(("t".into(), 1.0)),
        ..columns(&["x", "y", "z"])
    };
    let found = run(table.as_bytes(), &request).unwrap();
    assert_eq!(found.axes[0].verdict, Verdict::NotAttributable);
    assert_eq!(found.axes[0].reasons, [Kind::Orientation]);
}

/// White noise in units of one sample, at 50 Hz, with windows of 10 s.
#[test]
fn windows_farther_apart_than_the_record_shows_noise_cannot_tell() {
    let mut rng = StdRng::seed_from_u64(14);
    let mut table = String::from("t,u\n");
    for from in [0.0, 3600.0] {
        for n in 0..500 {
            let shaken = if from > 0.0 {
                0.05 * normal(&mut rng) + 0.02
            } else {
                0.0
            };
            let _ = writeln!(
                table,
                "{},{}",
                from + f64::from(n) / 50.0,
                shaken + 1e-3 * normal(&mut rng)
            );
        }
    }
    let found = run(table.as_bytes(), &windows("0..10", "3600..3610")).unwrap();
    assert_eq!(found.verdict, Verdict::CannotTell);
    assert_eq!(found.axes[0].reasons, [Kind::Drift]);
}

/// A rest, a ramp of 20 s, a plateau, a ramp, a rest.
fn shaker(rng: &mut StdRng, sine: bool, drift_per_s: f64) -> String {
    let mut table = String::from("t_s,u_g\n");
    let mut last = 0.0;
    for n in 0..50_000 {
        let t = f64::from(n) / 500.0;
        let level = match t {
            t if t < 20.0 || t >= 80.0 => 0.0,
            t if t < 40.0 => 3.0 * 10f64.powf((t - 40.0) / 10.0),
            t if t < 60.0 => 3.0,
            t => 3.0 * 10f64.powf((60.0 - t) / 10.0),
        };
        // A table does not move away: its motion has no mean.
        let now = normal(rng);
        let motion = match sine {
            true => (std::f64::consts::TAU * 61.3 * t).sin(),
            false => (now - last) / 2f64.sqrt(),
        };
        last = now;
        let x = level * motion;
        let u = 1.0 + x + 5e-4 * x * x + drift_per_s * t + 1e-3 * normal(rng);
        let _ = writeln!(table, "{t},{u}");
    }
    table
}

#[test]
fn without_windows_the_plateau_is_found_and_the_ramps_are_left_out() {
    for (seed, sine) in [(15, true), (16, false)] {
        let table = shaker(&mut StdRng::seed_from_u64(seed), sine, 2e-5);
        let mut request = windows("0..1", "1..2");
        request.selection = None;
        request.columns = Columns {
            time: Some(("t_s".into(), 1.0)),
            ..columns(&["u_g"])
        };
        let found = run(table.as_bytes(), &request).unwrap();
        assert_eq!(found.plateaus.len(), 1, "{:?}", found.plateaus);
        let plateau = &found.plateaus[0];
        assert!(
            (38.5..43.0).contains(&plateau.from_s) && (57.0..61.5).contains(&plateau.to_s),
            "{plateau:?}"
        );
        let expected = 5e-4 * if sine { 4.5 } else { 9.0 };
        let [low, high] = plateau.axes[0].interval_95_g;
        assert!((low..high).contains(&expected), "{expected} {low} {high}");
        assert_eq!(
            plateau.verdict,
            Verdict::Shift,
            "{:?}",
            plateau.axes[0].reasons
        );
        assert_eq!(plateau.against, "before and after");
        match sine {
            true => {
                assert_eq!(plateau.kind, MotionKind::Sine);
                assert!((plateau.frequency_hz.unwrap() - 61.3).abs() < 1e-3);
                assert!((plateau.level_g - 3.0).abs() < 1e-3);
            }
            false => {
                let motion = plateau.axes[0].motion.as_ref().unwrap();
                assert_eq!(plateau.kind, MotionKind::Random);
                assert!(
                    (motion.kurtosis - 3.0).abs() < 0.2
                        && (plateau.level_g / 3.0 - 1.0).abs() < 0.03
                );
                assert!(plateau.band_hz.unwrap()[1] > 200.0);
            }
        }
    }
}

#[test]
fn a_record_without_rest_or_without_vibration_says_so() {
    let mut rng = StdRng::seed_from_u64(17);
    let rows = (0..5000).map(|n| format!("{},{}\n", f64::from(n) / 100.0, normal(&mut rng)));
    let table: String = std::iter::once("t,u\n".into()).chain(rows).collect();
    let request = Request {
        selection: None,
        ..windows("0..1", "1..2")
    };
    let line = run(table.as_bytes(), &request).unwrap_err().to_string();
    assert!(line.contains("no steady vibration is found"), "{line}");
}

#[test]
fn bad_input_is_one_line_with_file_row_and_column() {
    let rows = "0.1,0\n0.2,0\n0.3,0\n";
    let cases: [(Vec<u8>, &str); 10] = [
        (b"".to_vec(), "is an empty file"),
        (
            b"t,v\n1,2\n".to_vec(),
            "column u: is missing from the header",
        ),
        (b"t,u\n".to_vec(), "has no rows"),
        (
            format!("t,u\n{rows}1,NaN\n").into_bytes(),
            "row 5, column u: \"NaN\" is not a finite",
        ),
        (
            format!("t,u\n{rows}x,1\n").into_bytes(),
            "row 5, column t: \"x\" is not a number",
        ),
        (
            format!("t,u\n{rows}1,\n").into_bytes(),
            "row 5, column u: is empty",
        ),
        (
            format!("t,u\n{rows}1,2,3\n").into_bytes(),
            "row 5: has 3 cells, the header 2",
        ),
        (b"t,u\n1,\xe9\n".to_vec(), "row 2, column u: is not UTF-8"),
        (b"t,u\n1,2\n".to_vec(), "no sample is selected by --during"),
        (
            b"t,u\n1,2\n3.5,2\n".to_vec(),
            "\"before\": 1 samples are too few",
        ),
    ];
    for (content, expected) in cases {
        let request = windows("0..2", "3..4");
        let error = match run(&content, &request) {
            Err(error) => error,
            Ok(_) => panic!("{expected}"),
        };
        let line = error.to_string();
        assert_eq!(error.exit_status(), 2);
        assert!(
            line.contains("raw.csv") && line.contains(expected),
            "{line}; not {expected}"
        );
        assert!(!line.contains('\n'));
    }
}

#[test]
fn a_row_is_named_by_its_line_whatever_ends_the_lines() {
    let rows = "t,u\n0,1\n1,1\n2,bad\n3,1\n";
    let long: String = (0..30_000).map(|n| format!("{n},1\n")).collect();
    let long = format!("t,u\n{long}x,1\n");
    for (content, row) in [
        (rows.to_owned(), 4),
        (rows.replace('\n', "\r\n"), 4),
        (rows.replace('\n', "\r"), 4),
        (rows.replacen("0,1\n", "0,1\n\n\r\n", 1), 6),
        (long.replace('\n', "\r\n"), 30_002),
        (long.replace("29999,1\n", "29999,1\n\n"), 30_003),
        (rows.replace("2,bad", "\"2\",\"bad\""), 4),
    ] {
        let line = run(content.as_bytes(), &windows("0..2", "2..90000")).unwrap_err();
        let line = line.to_string();
        assert!(
            line.contains(&format!("row {row}, column")),
            "{row}: {line}"
        );
    }
}

#[test]
fn two_columns_of_one_name_are_refused() {
    let request = windows("0..1", "1..2");
    let line = run(b"t,u,u\n0,1,1\n", &request).unwrap_err().to_string();
    assert!(
        line.ends_with("column u: stands in the header twice"),
        "{line}"
    );
}

/// A shaker run of an instrument of 2 V/g on a converter of 1.2 V: blocks of 40 samples.
fn recorded(shift_v: f64) -> Vec<u8> {
    session(shift_v, 1e-4, 0.3)
}

/// The same with a noise and an amplitude of its own, V.
fn session(shift_v: f64, noise_v: f64, amplitude_v: f64) -> Vec<u8> {
    let mut rng = StdRng::seed_from_u64(6);
    let identity = Identity {
        minimum: MINIMUM,
        current: CURRENT,
        firmware: [0; 3],
        serial: [7; 12],
        sample_rate_hz: 4000.0,
        reference_v: 1.2,
        gains: [1; 4],
        block_samples: 40,
    };
    let mut events = Frame::new();
    let (mut bytes, mut sequence) = (Vec::new(), 0u16);
    let mut send = |event: &Event<'_>| {
        events.encode(event, sequence).unwrap();
        sequence = sequence.wrapping_add(1);
        bytes.extend_from_slice(events.as_bytes());
    };
    send(&Event::Hello(identity));
    let mut index = 0u64;
    for (plateau, blocks) in [
        (Plateau::Before, 300),
        (Plateau::During, 600),
        (Plateau::After, 100),
    ] {
        for _ in 0..blocks {
            let first_sample = index;
            let mut moments = Accumulator::<f32>::new([0; 4]);
            let mut codes = Vec::new();
            for _ in 0..40 {
                let t = index as f64 / 4000.0;
                let shaken = shift_v + amplitude_v * (std::f64::consts::TAU * 80.0 * t).sin();
                let u = noise_v * normal(&mut rng)
                    + if plateau == Plateau::During {
                        shaken
                    } else {
                        0.0
                    };
                let code = (u / 1.2 * f64::from(1 << 23)).round() as i32;
                moments.extend(&[[code, 0, 0, 0]]).unwrap();
                codes.extend(pack(&[code, 0, 0, 0]));
                index += 1;
            }
            let moments = moments.close().unwrap().unwrap().to_wire();
            let segment = Segment::Run(Run { run: 5, plateau });
            send(&Event::Raw(Raw {
                segment: Segment::Idle,
                first_sample,
                codes: &codes,
            }));
            send(&Event::Block(Block {
                segment,
                first_sample,
                count: 40,
                lost: 0,
                moments,
            }));
        }
    }
    bytes
}

#[test]
fn a_recorded_run_is_measured_from_its_blocks_and_from_its_raw_samples() {
    let bytes = recorded(1e-3);
    let mut request = windows("0..3", "3..9");
    request.calibration.units_per_g = 2.0;
    let from_raw = run(&bytes, &request).unwrap();
    let from_blocks = run(
        &bytes,
        &Request {
            selection: None,
            ..request.clone()
        },
    )
    .unwrap();
    for found in [&from_raw, &from_blocks] {
        let axis = &found.axes[0];
        let (value, sigma) = axis.shift_g.known().unwrap();
        assert!(
            (value - 5e-4).abs() < 4.0 * sigma && sigma < 5e-6,
            "{value} {sigma}"
        );
        assert!(
            (axis.rms_during_g - 0.15 / 2f64.sqrt()).abs() < 1e-3,
            "{}",
            axis.rms_during_g
        );
        assert_eq!(found.verdict, Verdict::Shift);
    }
    // Damaged: what is sound is measured, and what was lost is said.
    let mut damaged = bytes;
    damaged[40_000] ^= 0x10;
    damaged.truncate(damaged.len() - 5);
    let found = run(
        &damaged,
        &Request {
            selection: None,
            ..request
        },
    )
    .unwrap();
    let tally = found.record.unwrap();
    assert!(
        tally.missing_frames >= 1 && tally.damaged_stretches >= 2,
        "{tally:?}"
    );
    assert!((found.axes[0].shift_g.value.unwrap() - 5e-4).abs() < 2e-5);
}

/// Of the run in a record, by its blocks.
fn blocks(bytes: &[u8], full_scale_g: Option<f64>) -> Result<Measurement, host::error::Error> {
    let calibration = Calibration {
        units_per_g: 2.0,
        full_scale_g,
        ..calibration()
    };
    let request = Request {
        columns: columns(&[]),
        selection: None,
        run: None,
        calibration,
    };
    run(bytes, &request)
}

/// Length of the first frame with its delimiter.
fn first_frame(bytes: &[u8]) -> usize {
    bytes.iter().position(|&byte| byte == 0).unwrap() + 1
}

#[test]
fn blocks_are_counted_as_blocks_and_their_samples_as_samples() {
    let found = blocks(&recorded(1e-3), None).unwrap();
    let during = &found.segments[1];
    assert_eq!((during.samples, during.blocks), (24_000, Some(600)));
    // Of the samples: means of half a period would have 2/pi of it, or none.
    assert!((during.rms_g[0] - 0.15 / 2f64.sqrt()).abs() < 1e-3);
}

#[test]
fn two_sessions_in_one_record_are_not_one_measurement() {
    let bytes = [recorded(1e-3), recorded(1e-3)].concat();
    let error = blocks(&bytes, None).unwrap_err();
    assert_eq!(error.exit_status(), 2);
    let line = error.to_string();
    let place = format!(
        "in frame 2002 (before byte {})",
        bytes.len() / 2 + first_frame(&bytes)
    );
    assert!(line.contains("two sessions in one record: run 5"), "{line}");
    assert!(line.contains(&place), "{line}");
    let line = run(&bytes, &windows("0..3", "3..9"))
        .unwrap_err()
        .to_string();
    assert!(line.contains("two sessions in one record"), "{line}");
}

#[test]
fn after_a_restart_nobody_speaks_until_he_says_who_he_is() {
    let whole = recorded(1e-3);
    let silent = &whole[first_frame(&whole)..];
    let found = blocks(&[&whole, silent].concat(), None).unwrap();
    assert_eq!(
        found.axes[0].shift_g,
        blocks(&whole, None).unwrap().axes[0].shift_g
    );
    assert_eq!(found.record.unwrap().restarts, 1);
    assert!(
        found
            .notes
            .iter()
            .any(|note| note.starts_with("900 blocks and 0 frames"))
    );
}

#[test]
fn a_record_whose_beginning_is_damaged_is_still_a_record() {
    let whole = recorded(1e-3);
    let hello = first_frame(&whole);
    let rubbish = vec![0x55; 10_000];
    let found = blocks(&[&rubbish, &[0][..], &whole].concat(), None).unwrap();
    assert_eq!(found.verdict, Verdict::Shift);
    // Who speaks is said after the first blocks only.
    let (early, late) = whole[hello..].split_at(40_000);
    let end = early.iter().rposition(|&byte| byte == 0).unwrap() + 1;
    let late_hello = [&early[..end], &whole[..hello], &early[end..], late].concat();
    let found = blocks(&late_hello, None).unwrap();
    assert!(
        found
            .notes
            .iter()
            .any(|note| note.contains("had not yet said who it is"))
    );
    let line = blocks(&whole[hello..], None).unwrap_err().to_string();
    assert!(
        line.contains("raw.csv") && line.contains("never says who it is"),
        "{line}"
    );
    assert!(
        line.contains("2000 sound frames, 1000 of them blocks and 1000 of raw samples"),
        "{line}"
    );
    let line = blocks(b"", None).unwrap_err().to_string();
    assert!(line.ends_with("raw.csv: is an empty file"), "{line}");
}

#[test]
fn blocks_that_touch_full_scale_are_a_rival_of_unknown_size() {
    let axis = blocks(&recorded(1e-3), Some(0.14)).unwrap().axes.remove(0);
    assert_eq!(
        (axis.rivals[0].kind, axis.rivals[0].size_g),
        (Kind::Clipping, None)
    );
    // Half a period a block: each holds one crest, the upper or the lower.
    assert!(
        (axis.clipped_share - 1.0).abs() < 0.01,
        "{}",
        axis.clipped_share
    );
    assert!(axis.rivals[0].finding.contains("% of the blocks"));
    assert_eq!(axis.verdict, Verdict::NotAttributable);
    assert!(
        blocks(&recorded(1e-3), Some(0.16)).unwrap().axes[0]
            .rivals
            .is_empty()
    );
}

#[test]
fn without_scatter_nothing_is_claimed() {
    let lsb_v = 1.2 / f64::from(1 << 23);
    for (codes, verdict) in [
        (0.0, Verdict::NoShift),
        (1.0, Verdict::NoShift),
        (1000.0, Verdict::NotAttributable),
    ] {
        let found = blocks(&session(codes * lsb_v, 0.0, 0.0), None).unwrap();
        let axis = &found.axes[0];
        assert_eq!((axis.verdict, axis.p_value), (verdict, None));
        assert_eq!(axis.quantisation.unwrap().step_g, Some(lsb_v / 2.0));
        assert!(axis.interval_95_g[1] - axis.interval_95_g[0] >= lsb_v);
        assert!(
            found
                .notes
                .iter()
                .any(|note| note.contains("noise is unknown"))
        );
    }
    // All samples equal: a coarse converter, or a dead one.
    for (step, verdict) in [(0, Verdict::CannotTell), (1, Verdict::CannotTell)] {
        let rows = (0..1000).map(|n| format!("{n},{}\n", if n < 500 { 0 } else { step }));
        let table: String = std::iter::once("t,u\n".into()).chain(rows).collect();
        let found = run(table.as_bytes(), &windows("0..500", "500..1000")).unwrap();
        assert_eq!((found.verdict, found.axes[0].p_value), (verdict, None));
    }
    // Even codes that alternate have means without scatter.
    let rows = (0..1024).map(|n| format!("{n},{}\n", n % 2 + n / 512));
    let table: String = std::iter::once("t,u\n".into()).chain(rows).collect();
    let found = run(table.as_bytes(), &windows("0..512", "512..1024")).unwrap();
    assert_ne!(found.verdict, Verdict::Shift);
}

#[test]
fn numbers_that_no_output_has_are_refused_in_their_row() {
    let rows = (0..200).map(|n| format!("{n},{}\n", if n % 2 == 0 { "1e308" } else { "-1e308" }));
    let table: String = std::iter::once("t,u\n".into()).chain(rows).collect();
    let error = run(table.as_bytes(), &windows("0..100", "100..200")).unwrap_err();
    assert_eq!(error.exit_status(), 2);
    let line = error.to_string();
    assert!(
        line.contains("row 2, column u: 1e308 g is more than 1e9 g"),
        "{line}"
    );
}

#[test]
fn the_scale_of_a_record_is_said_to_be_at_the_converter_and_no_absurd_one_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("capture.rec");
    fs::write(&file, recorded(1e-3)).unwrap();
    let vre = |scale: &str| {
        let mut command = assert_cmd::Command::cargo_bin("vre").unwrap();
        command.arg("measure").arg(&file).args(["--scale", scale]);
        command.output().unwrap()
    };
    let text = String::from_utf8(vre("2").stdout).unwrap();
    assert!(
        text.contains("scale 2 V/g at the converter's input"),
        "{text}"
    );
    assert!(text.contains("24000 samples in 600 blocks"), "{text}");
    assert!(text.contains("; 0 restarts"), "{text}");
    for absurd in ["1e-13", "1e13", "0", "nan"] {
        assert_eq!(vre(absurd).status.code(), Some(2));
    }
}

#[test]
fn a_record_of_rubbish_is_an_error() {
    let rubbish: Vec<u8> = (0..100_000u32)
        .map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    let error = run(&rubbish, &windows("0..1", "2..3")).unwrap_err();
    assert_eq!(error.exit_status(), 2);
    assert!(
        error
            .to_string()
            .contains("not one sound frame in 100000 bytes")
    );
}

proptest! {
    #[test]
    fn no_bytes_make_the_table_reader_panic(
        header in prop::bool::ANY,
        bytes in prop::collection::vec(any::<u8>(), 0..400),
        text in "[0-9a-z,.\"\n\r -]{0,400}",
    ) {
        for tail in [bytes.as_slice(), text.as_bytes()] {
            let head: &[u8] = if header { b"t,u,file\n" } else { b"" };
            let content = [head, tail].concat();
            let _ = run(&content, &windows("0..10", "10..30"));
            let _ = run(&content, &groups(&["u"]));
            let _ = run(&content, &Request { selection: None, ..windows("0..1", "2..3") });
        }
    }
}

#[test]
fn windows_that_overlap_or_are_none_are_refused() {
    for (before, during) in [
        ("0..5", "4..9"),
        ("5..1", "6..7"),
        ("a..b", "1..2"),
        ("1", "2..3"),
    ] {
        let error = Selection::parse(None, before, during, None).unwrap_err();
        assert_eq!(error.exit_status(), 2);
    }
    assert!(measure(Path::new("/no/such/file"), &windows("0..1", "2..3")).is_err());
}

#[test]
fn the_command_writes_json_and_exits_2_on_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("raw.csv");
    fs::write(&file, one_record(&mut StdRng::seed_from_u64(8), 5e-3)).unwrap();
    let vre = |column: &str| {
        let mut command = assert_cmd::Command::cargo_bin("vre").unwrap();
        command
            .arg("measure")
            .arg(&file)
            .args(["--column", column, "--time", "t", "--unit", "g"]);
        command.args(["--before", "0..10", "--during", "10..30", "--json", "-"]);
        command.output().unwrap()
    };
    let found: serde_json::Value = serde_json::from_slice(&vre("u").stdout).unwrap();
    assert_eq!(found["format"], "vre-measurement/1");
    assert_eq!(found["verdict"], "shift");
    assert_eq!(found["reasons"], serde_json::json!([]));
    assert!((found["axes"][0]["shift_g"]["value"].as_f64().unwrap() - 5e-3).abs() < 1e-3);
    let failed = vre("v");
    assert_eq!(failed.status.code(), Some(2));
    let line = String::from_utf8(failed.stderr).unwrap();
    assert!(
        line.trim_end()
            .ends_with("raw.csv, column v: is missing from the header"),
        "{line}"
    );
    assert_eq!(line.lines().count(), 1);
}

/// Records of the kinds of noise that inertial sensors have. The long run is
/// `cargo run --release -p host --example coverage -- 1000`.
#[test]
fn intervals_hold_for_every_kind_of_slow_noise_or_nothing_is_told() {
    let records = 40;
    let mut told = 0;
    for kind in Noise::ALL {
        for geometry in [Geometry::SHORT, Geometry::APART] {
            let found: Vec<Interval> = (0..records)
                .map(|seed| geometry.interval(kind, seed))
                .collect();
            let claims: Vec<&Interval> = found.iter().filter(|i| i.told).collect();
            let held = claims.iter().filter(|i| i.holds).count();
            told += claims.len();
            // 95 % of 40 less than 84 % has a chance of 0.5 %.
            let least = (0.84 * claims.len() as f64) as usize;
            assert!(
                held >= least,
                "{kind:?} {geometry:?}: {held} of {}",
                claims.len()
            );
            if kind == Noise::White {
                let mean = claims.iter().map(|i| i.half_over_white).sum::<f64>()
                    / claims.len().max(1) as f64;
                assert!(
                    (0.8..2.5).contains(&mean),
                    "{mean} times what white noise needs"
                );
            }
        }
    }
    assert!(told > 300, "{told} of 400 records are told");
}

#[test]
fn the_scale_is_asked_for_where_no_unit_is_told_and_may_be_negative() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("raw.csv");
    let table = one_record(&mut StdRng::seed_from_u64(19), 5e-3);
    fs::write(&file, &table).unwrap();
    let vre = |options: &[&str]| {
        let mut command = assert_cmd::Command::cargo_bin("vre").unwrap();
        command
            .arg("measure")
            .arg(&file)
            .args(["--column", "u", "--time", "t"]);
        command.args(["--before", "0..10", "--during", "10..30", "--json", "-"]);
        command.args(options).output().unwrap()
    };
    let line = String::from_utf8(vre(&[]).stderr).unwrap();
    assert!(
        line.starts_with("error: --scale is needed, units a g of u"),
        "{line}"
    );
    assert_eq!(vre(&["--unit", "V"]).status.code(), Some(2));
    let shift = |options: &[&str]| {
        let found: serde_json::Value = serde_json::from_slice(&vre(options).stdout).unwrap();
        found["axes"][0]["shift_g"]["value"].as_f64().unwrap()
    };
    let plain = shift(&["--unit", "g"]);
    assert!((plain - 5e-3).abs() < 1e-3);
    assert!((shift(&["--scale", "-2"]) / plain + 0.5).abs() < 1e-9);
    assert!((shift(&["--unit", "mg"]) / plain - 1e-3).abs() < 1e-9);
    fs::write(&file, table.replacen("t,u", "t,u,u", 1)).unwrap();
    let line = String::from_utf8(vre(&[]).stderr).unwrap();
    assert!(
        line.ends_with("column u: stands in the header twice\n"),
        "{line}"
    );
}

#[test]
fn a_record_in_the_dialect_of_another_maker_gives_the_same_answer() {
    let sound = shaker(&mut StdRng::seed_from_u64(18), true, 0.0);
    let rows: Vec<(f64, f64)> = sound
        .lines()
        .skip(1)
        .map(|line| line.split_once(',').unwrap())
        .map(|(t, u)| (t.parse().unwrap(), u.parse().unwrap()))
        .collect();
    let german: String = rows
        .iter()
        .map(|(t, u)| format!("{t:.4};{:.9}\r\n", u * 9.80665).replace('.', ","))
        .collect();
    let tabs: String = rows
        .iter()
        .map(|(t, u)| format!("{:.1}\t{u:.9}\n", 1e3 * t))
        .collect();
    let dated: String = rows
        .iter()
        .map(|(t, u)| {
            let (minute, second) = ((t / 60.0).floor(), t % 60.0);
            format!(
                "\"2024-02-29 23:{:02.0}:{second:07.4}\",{:.9}\n",
                58.0 + minute,
                1e3 * u
            )
        })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let answer = |content: &str| {
        let file = folder.path().join("record.txt");
        fs::write(&file, content).unwrap();
        let mut command = assert_cmd::Command::cargo_bin("vre").unwrap();
        let done = command
            .arg("measure")
            .arg(&file)
            .args(["--json", "-"])
            .output()
            .unwrap();
        let line = String::from_utf8_lossy(&done.stderr).into_owned();
        serde_json::from_slice::<serde_json::Value>(&done.stdout).expect(&line)
    };
    let plain = answer(&sound);
    let expected = plain["plateaus"][0]["shift_g"]["value"].as_f64().unwrap();
    assert!((expected - 2.25e-3).abs() < 1e-4, "{expected}");
    for content in [
        format!("Logger;SN 7\r\n\r\nZeit;Ausgang\r\ns;m/s\u{b2}\r\n{german}"),
        format!("time (ms)\tu [g]\n{tabs}"),
        format!("# made by a logger\ntime,u_mg\n{dated}"),
    ] {
        let found = answer(&content);
        let shift = found["plateaus"][0]["shift_g"]["value"].as_f64().unwrap();
        assert!(
            (shift - expected).abs() < 1e-6,
            "{shift} {expected}: {}",
            &content[..40]
        );
        assert!((found["plateaus"][0]["frequency_hz"].as_f64().unwrap() - 61.3).abs() < 1e-2);
    }
}
