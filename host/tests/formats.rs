//! Records of other makers: what the programs that people use wrote is what is read, and what is damaged is told in a line.

use std::path::{Path, PathBuf};

use host::error::Error;
use host::import::{Channel, Clock, Wanted, channels};
use host::measure::{Calibration, Columns, Request, Selection, measure};

/// Samples a second in all files.
const RATE_HZ: f64 = 200.0;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/formats")
}

/// All channels of a file, its blocks joined; times follow each other too.
fn read(file: &Path) -> Result<Vec<Channel>, Error> {
    let mut all: Vec<Channel> = Vec::new();
    for block in channels(file, Wanted::All)?.blocks {
        let block = block?;
        if all.is_empty() {
            all = block;
            continue;
        }
        for (known, next) in all.iter_mut().zip(block) {
            assert_eq!(known.name, next.name);
            known.values.extend(next.values);
            if let (Clock::Times(times), Clock::Times(more)) = (&mut known.clock, next.clock) {
                *times = times.iter().chain(more.iter()).copied().collect();
            }
        }
    }
    Ok(all)
}

fn channel(name: &str, of: &str) -> Channel {
    let all = read(&folder().join(of)).unwrap();
    let names: Vec<String> = all.iter().map(|channel| channel.name.clone()).collect();
    let found = all.into_iter().find(|channel| channel.name == name);
    found.unwrap_or_else(|| panic!("{of}: {name} is not among {names:?}"))
}

/// The clock of a channel as times, s; none of one without.
fn times(channel: &Channel) -> Vec<f64> {
    match &channel.clock {
        Clock::Order => Vec::new(),
        Clock::Rate { hz, start_s } => {
            let count = channel.values.len();
            (0..count).map(|n| start_s + n as f64 / hz).collect()
        }
        Clock::Times(times) => times.to_vec(),
    }
}

/// A channel: the file, its name, its unit, what a unit is of the text's, and whether the file tells the times.
type Case = (&'static str, &'static str, Option<&'static str>, f64, bool);

const X: [Case; 15] = [
    ("record.wav", "1", Some("counts"), 1024.0, true),
    ("float.wav", "1", None, 1.0, true),
    ("record.parquet", "x_g", None, 1.0, false),
    ("stamped.parquet", "x_g", None, 1.0, false),
    ("record.mat", "x_g", None, 1.0, false),
    ("plain.mat", "x_g", None, 1.0, true),
    ("hdf5.mat", "x_g", None, 1.0, false),
    ("record.uff", "x", Some("g"), 1.0, true),
    ("binary.uff", "x", Some("g"), 1.0, true),
    ("record.tdms", "x", Some("g"), 1.0, true),
    ("record.ulg", "sensor_accel_0.acc_g[0]", None, 1.0, true),
    ("record.bin", "ACC[0].AccX", Some("m/s/s"), 1.0, true),
    ("record.mcap", "/imu.linear_acceleration.x", None, 1.0, true),
    ("json.mcap", "/acc.x_g", None, 1.0, true),
    ("record.csv", "x_g", None, 1.0, true),
];

const Y: [Case; 15] = [
    ("record.wav", "2", Some("counts"), 1024.0, true),
    ("float.wav", "2", None, 1.0, true),
    ("record.parquet", "y_g", None, 1.0, false),
    ("stamped.parquet", "y_counts", None, 1024.0, false),
    ("record.mat", "log.y_g", None, 1.0, false),
    ("plain.mat", "y_g", None, 1.0, true),
    ("hdf5.mat", "log.y_g", None, 1.0, false),
    ("record.uff", "y", Some("g"), 1.0, true),
    ("binary.uff", "y", Some("g"), 1.0, true),
    ("record.tdms", "y", Some("counts"), 1024.0, true),
    ("record.ulg", "sensor_accel_0.acc_g[1]", None, 1.0, true),
    ("record.bin", "ACC[0].AccY", Some("m/s/s"), 1.0, true),
    ("record.mcap", "/imu.linear_acceleration.y", None, 1.0, true),
    ("json.mcap", "/acc.sensor.y_g", None, 1.0, true),
    ("record.csv", "y_g", None, 1.0, true),
];

#[test]
fn every_format_holds_the_samples_units_and_times_that_were_written() {
    for (cases, column) in [(X, "x_g"), (Y, "y_g")] {
        let text = channel(column, "record.csv");
        for (file, name, unit, units, timed) in cases {
            let found = channel(name, file);
            let values: Vec<f64> = found.values.iter().map(|value| value / units).collect();
            assert_eq!(values, text.values, "{file}, {name}");
            assert_eq!(found.unit.as_deref(), unit, "{file}, {name}");
            let times = times(&found);
            let expected = if timed { text.values.len() } else { 0 };
            assert_eq!(times.len(), expected, "{file}, {name}");
            for (n, time) in times.iter().enumerate() {
                let off = (time - times[0] - n as f64 / RATE_HZ).abs();
                assert!(off < 1e-8, "{file}, {name}: sample {n} at {time}");
            }
        }
    }
}

#[test]
fn a_matrix_has_a_channel_for_each_column_however_it_lies() {
    for file in ["record.mat", "hdf5.mat"] {
        for (name, column) in [("acc.1", "x_g"), ("acc.2", "y_g")] {
            let values = channel(column, "record.csv").values;
            let counts: Vec<f64> = values.iter().map(|g| 1024.0 * g).collect();
            assert_eq!(channel(name, file).values, counts, "{file}, {name}");
        }
    }
}

#[test]
fn a_time_stamp_of_parquet_counts_from_its_midnight() {
    let time = channel("time", "stamped.parquet");
    assert_eq!(time.unit.as_deref(), Some("s"));
    // 1 700 000 000 s after 1970 began are 19 675 days and 80 000 s.
    assert_eq!(time.values[0], 80_000.0);
    assert!((time.values[239] - 80_001.195).abs() < 1e-9);
}

#[test]
fn a_row_without_a_value_is_no_number() {
    let (gappy, whole) = (
        channel("gappy_g", "stamped.parquet"),
        channel("x_g", "stamped.parquet"),
    );
    assert_eq!(gappy.values.len(), 240);
    for (n, (found, value)) in gappy.values.iter().zip(whole.values).enumerate() {
        match n % 10 {
            3 => assert!(found.is_nan(), "{n}"),
            _ => assert_eq!(*found, value, "{n}"),
        }
    }
    let error = measure(
        &folder().join("stamped.parquet"),
        &request("gappy_g", None, 1.0),
    );
    let line = error.unwrap_err().to_string();
    assert!(
        line.contains("column gappy_g: sample 4 is not a finite number"),
        "{line}"
    );
}

#[test]
fn the_scales_that_a_channel_states_are_applied_one_after_the_other() {
    let values = channel("x_g", "record.csv").values;
    assert_eq!(channel("a/x", "scaled.tdms").values, values);
    let counts: Vec<f64> = values.iter().map(|g| 1024.0 * g).collect();
    assert_eq!(channel("b/x", "scaled.tdms").values, counts);
}

#[test]
fn uneven_times_and_numbers_that_touch_each_other_are_read_from_a_universal_file() {
    let told = |line: &str| format!("{line:<80}\n");
    let mut set: String = ["    -1", "    58", "x", "NONE", "NONE", "NONE", "NONE"]
        .map(told)
        .concat();
    set +=
        &told("    1         0    0         0       NONE         7   3       NONE         0   0");
    set += &told("         4         3         0  0.00000e+00  0.00000e+00  0.00000e+00");
    set += &told("        17    0    0    0 Time                 s");
    set += &told("        12    0    0    0 Acceleration         m/s^2");
    set += &told("         0    0    0    0 NONE                 NONE");
    set += &told("         0    0    0    0 NONE                 NONE");
    // E13.5 and E20.12 in turns, without a blank between.
    set += "-1.00000e-001-1.000000000000e+000 0.00000e+000 2.5000000000000e+00\n 3.00000D-001-4.0000000000000D+00\n    -1\n";
    let found = damaged("uneven.uff", set.as_bytes()).unwrap();
    assert_eq!(
        (found[0].name.as_str(), found[0].unit.as_deref()),
        ("x", Some("m/s^2"))
    );
    assert_eq!(times(&found[0]), [-0.1, 0.0, 0.3]);
    assert_eq!(found[0].values, [-1.0, 2.5, -4.0]);
    let short = set.replace("         3         0  0.0", "         4         0  0.0");
    let line = damaged("uneven.uff", short.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(
        line.contains("data set at line 2: ends after 3 of 4 samples"),
        "{line}"
    );
}

fn request(column: &str, time: Option<&str>, units_per_g: f64) -> Request {
    Request {
        columns: Columns {
            outputs: vec![column.into()],
            time: time.map(|name| (name.into(), 1.0)),
            temperature: None,
        },
        selection: None,
        run: None,
        calibration: Calibration {
            units_per_g,
            full_scale_g: None,
            temperature_sensitivity_g_per_c: None,
        },
    }
}

/// The shift of a channel between the halves of its record, of which the first sample is taken at `from_s`.
fn halves(file: &str, mut request: Request, from_s: f64) -> [f64; 2] {
    // Edges between samples.
    let window = |from: f64, to: f64| format!("{}..{}", from_s + from, from_s + to);
    let (before, during) = (window(-0.0025, 0.5975), window(0.5975, 1.1975));
    request.selection = Some(Selection::parse(None, &before, &during, None).unwrap());
    let found = measure(&folder().join(file), &request).unwrap();
    let shift = found.axes[0].shift_g;
    [shift.value.unwrap(), shift.sigma.unwrap()]
}

#[test]
fn a_record_gives_the_same_shift_in_whatever_format() {
    let text = halves("record.csv", request("x_g", Some("t_s"), 1.0), 0.0);
    assert!((text[0] - 16.0 / 1024.0).abs() < 5e-3, "{text:?}");
    for (file, name, _, units, timed) in X {
        let time = match file {
            "stamped.parquet" => Some("time"),
            "record.csv" => continue,
            _ if timed => None,
            _ => Some("t_s"),
        };
        let from_s = match time {
            Some(time) => channel(time, file).values[0],
            None => times(&channel(name, file))[0],
        };
        let found = halves(file, request(name, time, units), from_s);
        for (a, b) in found.iter().zip(text) {
            assert!((a - b).abs() < 1e-9, "{file}: {found:?}, not {text:?}");
        }
    }
}

#[test]
fn a_channel_that_is_not_there_or_of_another_clock_is_one_line_with_its_name() {
    for (file, ..) in X {
        let error = measure(&folder().join(file), &request("nothing", None, 1.0)).unwrap_err();
        let line = error.to_string();
        let told = line.contains(file) && line.contains("nothing") && !line.contains('\n');
        assert!(told && error.exit_status() == 2, "{line}");
    }
    let mut both = request("x_g", None, 1.0);
    both.columns.outputs.push("fs_less".into());
    let error = measure(&folder().join("plain.mat"), &both).unwrap_err();
    assert!(error.to_string().contains("which has x_g, y_g"), "{error}");
}

/// A damaged copy of a file: what reading it gives.
fn damaged(name: &str, content: &[u8]) -> Result<Vec<Channel>, Error> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    std::fs::write(&file, content).unwrap();
    read(&file)
}

#[test]
fn a_file_that_is_cut_off_is_one_line_or_what_was_whole_before_with_a_remark() {
    for (file, name, ..) in X {
        let whole = std::fs::read(folder().join(file)).unwrap();
        let count = channel(name, file).values.len();
        for cut in (1..60)
            .map(|n| n * whole.len() / 60)
            .chain([whole.len() - 1])
        {
            match damaged(file, &whole[..cut]) {
                Ok(found) => {
                    let found = found.iter().find(|channel| channel.name == name);
                    assert!(found.is_none_or(|c| c.values.len() <= count), "{file}");
                }
                Err(error) => {
                    let line = error.to_string();
                    assert!(line.contains(file) && !line.contains('\n'), "{line}");
                }
            }
        }
        // Text that is cut within its last number is still text; a log may be cut anywhere.
        let part = damaged(file, &whole[..whole.len() * 7 / 10]);
        if !["record.csv", "record.ulg", "record.bin"].contains(&file) {
            assert!(part.is_err(), "{file}");
        }
    }
}

#[test]
fn bytes_that_are_changed_never_end_the_program() {
    let mut state = 7u64;
    let mut random = move |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as usize % below
    };
    for (file, ..) in X {
        let whole = std::fs::read(folder().join(file)).unwrap();
        for _ in 0..100 {
            let mut bytes = whole.clone();
            for _ in 0..1 + random(8) {
                // The beginning holds what the rest is read by.
                let within = if random(2) == 0 {
                    bytes.len()
                } else {
                    bytes.len().min(600)
                };
                let at = random(within);
                bytes[at] = [0, 0xff, random(256) as u8][random(3)];
            }
            if let Err(error) = damaged(file, &bytes) {
                assert!(!error.to_string().is_empty());
            }
        }
    }
}

#[test]
fn a_file_that_is_named_as_another_format_than_it_is_says_so() {
    for (name, format) in [
        ("a.wav", "WAV"),
        ("a.mat", "MATLAB"),
        ("a.tdms", "TDMS"),
        ("a.ulg", "ULog"),
    ] {
        let line = damaged(name, b"some text\nand more\n")
            .unwrap_err()
            .to_string();
        assert!(
            line.contains("does not begin as") && line.contains(format),
            "{line}"
        );
    }
}
