//! What a campaign's tables accept, and where they say that something is wrong.

mod common;

use std::fs;
use std::path::Path;

use host::campaign::{Campaign, MAX_ROWS, ranges};
use tempfile::TempDir;

/// A campaign's folder, one of whose files is changed by `edit`.
fn edited(file: &str, edit: impl FnOnce(String) -> Vec<u8>) -> TempDir {
    let folder = TempDir::new().unwrap();
    common::campaign().write(folder.path()).unwrap();
    let path = folder.path().join(file);
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, edit(text)).unwrap();
    folder
}

/// The table with `value` in the `row`th line (the header being 1) of `column`.
fn with_cell(table: &str, row: usize, column: &str, value: &str) -> Vec<u8> {
    let mut lines: Vec<Vec<&str>> = table
        .lines()
        .map(|line| line.split(',').collect())
        .collect();
    let index = lines[0].iter().position(|name| *name == column).unwrap();
    lines[row - 1][index] = value;
    let joined: Vec<String> = lines.iter().map(|cells| cells.join(",")).collect();
    joined.join("\n").into_bytes()
}

/// The message of reading `folder`, without the folder's name.
fn complaint(folder: &Path) -> String {
    let message = Campaign::read(folder)
        .expect_err("the campaign was accepted")
        .to_string();
    assert!(!message.contains('\n'), "more than one line: {message}");
    message.replace(&format!("{}/", folder.display()), "")
}

#[test]
fn what_is_written_is_read_back_to_the_last_digit() {
    let folder = TempDir::new().unwrap();
    let campaign = common::campaign();
    campaign.write(folder.path()).unwrap();
    assert_eq!(Campaign::read(folder.path()).unwrap(), campaign);
}

#[test]
fn order_of_columns_line_ends_and_byte_order_mark_do_not_matter() {
    let folder = edited("static.csv", |table| {
        let reversed = table.lines().map(|line| {
            let cells: Vec<&str> = line.split(',').rev().collect();
            cells.join(" , ")
        });
        format!("\u{feff}{}", reversed.collect::<Vec<_>>().join("\r\n")).into_bytes()
    });
    assert_eq!(Campaign::read(folder.path()).unwrap(), common::campaign());
}

#[test]
fn unknown_columns_and_keys_are_written_back() {
    let folder = edited("static.csv", |table| {
        let mut lines = table.lines();
        let header = format!("{},operator\n", lines.next().unwrap());
        lines
            .fold(header, |text, line| text + line + ",\"N. N., senior\"\n")
            .into_bytes()
    });
    let config = folder.path().join("campaign.toml");
    let text = fs::read_to_string(&config).unwrap();
    fs::write(&config, text.replace("[bench]", "[bench]\nroom = \"17\"")).unwrap();
    let campaign = Campaign::read(folder.path()).unwrap();
    let expected = ("operator".to_owned(), "N. N., senior".to_owned());
    assert!(
        campaign
            .readings
            .iter()
            .all(|reading| reading.unknown == [expected.clone()])
    );

    let copy = TempDir::new().unwrap();
    campaign.write(copy.path()).unwrap();
    assert_eq!(Campaign::read(copy.path()).unwrap(), campaign);
    assert!(
        fs::read_to_string(copy.path().join("campaign.toml"))
            .unwrap()
            .contains("room = \"17\"")
    );
}

#[test]
fn mount_and_reference_may_be_absent_as_whole_columns() {
    let folder = edited("vibration.csv", |table| {
        let lines = table
            .lines()
            .map(|line| line.split(',').take(22).collect::<Vec<_>>().join(","));
        lines.collect::<Vec<_>>().join("\n").into_bytes()
    });
    let path = folder.path().join("static.csv");
    let table = fs::read_to_string(&path).unwrap();
    let lines = table.lines().map(|line| {
        let mut cells: Vec<&str> = line.split(',').collect();
        cells.remove(4);
        cells.join(",")
    });
    fs::write(&path, lines.collect::<Vec<_>>().join("\n")).unwrap();
    let campaign = Campaign::read(folder.path()).unwrap();
    assert!(campaign.runs.iter().all(|run| run.reference.is_none()));
    assert_eq!(campaign.readings, common::campaign().readings);
}

/// A run across the input axis has hardly any extremes, and each is known to a few parts in 1e4.
#[test]
fn extremes_may_cross_by_the_peak_detectors_error() {
    let measured = common::campaign().runs[1].measured.unwrap();
    let low_v = measured.extremes.unwrap().minimum_v;
    let below = |part: f64| {
        let value = (low_v - part * low_v.abs()).to_string();
        edited("vibration.csv", |table| {
            with_cell(&table, 3, "u_max_v", &value)
        })
    };
    assert!(Campaign::read(below(5e-4).path()).is_ok());
    assert!(complaint(below(1e-2).path()).contains("is below u_min_v"));
}

#[test]
fn a_campaign_without_vibration_has_no_runs() {
    let folder = TempDir::new().unwrap();
    common::campaign().write(folder.path()).unwrap();
    fs::remove_file(folder.path().join("vibration.csv")).unwrap();
    assert!(Campaign::read(folder.path()).unwrap().runs.is_empty());
}

#[test]
fn a_bad_cell_is_named_by_file_row_and_column() {
    let cases = [
        (
            "static.csv",
            "u_v",
            "1,2",
            "static.csv, row 4: has 13 cells, the header 12",
        ),
        (
            "static.csv",
            "u_v",
            "-0.6V",
            "static.csv, row 4, column u_v: \"-0.6V\" is not a number",
        ),
        (
            "static.csv",
            "u_v",
            "NaN",
            "static.csv, row 4, column u_v: \"NaN\" is not a finite number",
        ),
        (
            "static.csv",
            "u_v",
            "1e999",
            "static.csv, row 4, column u_v: \"1e999\" is not a finite number",
        ),
        (
            "static.csv",
            "temp_c",
            "inf",
            "static.csv, row 4, column temp_c: \"inf\" is not a finite number",
        ),
        (
            "static.csv",
            "u_v",
            "",
            "static.csv, row 4, column u_v: is empty",
        ),
        (
            "static.csv",
            "sigma_v",
            "0",
            "static.csv, row 4, column sigma_v: 0 V is outside of 1e-12 to 1e7 V",
        ),
        (
            "static.csv",
            "sigma_v",
            "-1e-6",
            "column sigma_v: -1e-6 V is outside of 1e-12",
        ),
        (
            "static.csv",
            "series",
            "4",
            "column series: \"4\" is not a series: 1, 2 or 3",
        ),
        (
            "static.csv",
            "approach",
            "left",
            "column approach: \"left\" is not an approach: cw or ccw",
        ),
        (
            "static.csv",
            "order",
            "1.5",
            "column order: \"1.5\" is not a whole number from 0 on",
        ),
        (
            "static.csv",
            "order",
            "0",
            "column order: 0 stands already in row 2; are two tables joined?",
        ),
        (
            "static.csv",
            "dial_deg",
            "90",
            "does not belong to this series at dial + mount = 90 deg",
        ),
        (
            "static.csv",
            "mount_deg",
            "180",
            "does not belong to this series at dial + mount = 225 deg",
        ),
        (
            "static.csv",
            "a_o_g",
            "0.0002",
            "column a_o_g: 0.0002 does not belong to this series",
        ),
        (
            "static.csv",
            "a_i_g",
            "-6.934",
            "column a_i_g: the specific force is 6.9",
        ),
        (
            "vibration.csv",
            "kind",
            "sinus",
            "column kind: \"sinus\" is not a kind: sine or random",
        ),
        (
            "vibration.csv",
            "duration_s",
            "0",
            "column duration_s: 0 s is outside of 0.001 to 1e6 s",
        ),
        (
            "vibration.csv",
            "level_g",
            "-1",
            "column level_g: -1 g is outside of 1e-6 to 10000 g",
        ),
        (
            "vibration.csv",
            "dir_i",
            "0.6001",
            "column dir_i: the direction is 1.0000",
        ),
        (
            "vibration.csv",
            "f_lo_hz",
            "2001",
            "column f_hi_hz: 2000 is below f_lo_hz = 2001",
        ),
        (
            "vibration.csv",
            "f_lo_hz",
            "2000",
            "column f_hi_hz: 2000 is f_lo_hz too",
        ),
        (
            "vibration.csv",
            "kind",
            "sine",
            "column f_hi_hz: 2000 is not f_lo_hz = 20, but a sine",
        ),
        (
            "vibration.csv",
            "u_during_v",
            "",
            "vibration.csv, row 3, column u_during_v: is empty",
        ),
        ("vibration.csv", "u_min_v", "", "column u_min_v: is empty"),
        (
            "vibration.csv",
            "u_max_v",
            "-5",
            "column u_max_v: -5 is below u_min_v",
        ),
        (
            "vibration.csv",
            "drift_v_per_s",
            "",
            "column drift_v_per_s: is empty",
        ),
        (
            "vibration.csv",
            "sigma_v",
            "0",
            "column sigma_v: 0 V is outside of 1e-12",
        ),
        (
            "vibration.csv",
            "ref_p_rms_g",
            "",
            "column ref_p_rms_g: is empty",
        ),
        (
            "vibration.csv",
            "ref_p_rms_g",
            "-1",
            "column ref_p_rms_g: -1 g is outside of 0",
        ),
        (
            "vibration.csv",
            "ref_ip_corr",
            "1.1",
            "column ref_ip_corr: 1.1 is outside of -1",
        ),
        (
            "vibration.csv",
            "time_s",
            "1",
            "column time_s: 1 is before 8100 of the row above",
        ),
        (
            "vibration.csv",
            "run",
            "0",
            "column run: 0 stands already in row 2",
        ),
    ];
    for (file, column, value, expected) in cases {
        let row = if file == "static.csv" { 4 } else { 3 };
        let folder = edited(file, |table| with_cell(&table, row, column, value));
        let message = complaint(folder.path());
        assert!(
            message.contains(expected),
            "{column} = {value:?}: {message:?}"
        );
    }
}

#[test]
fn all_missing_columns_are_named_in_one_message() {
    let folder = edited("static.csv", |table| {
        let table = table.replacen("u_v", "mean", 1);
        table.replacen("sigma_v", "s", 1).into_bytes()
    });
    assert_eq!(
        complaint(folder.path()),
        "static.csv: columns u_v, sigma_v are missing from the header"
    );
    let folder = edited("vibration.csv", |table| {
        let table = table.replacen("level_g", "level", 1);
        let table = table.replacen("u_max_v", "u_most", 1);
        table.replacen("ref_p_kurt", "kurtosis", 1).into_bytes()
    });
    assert_eq!(
        complaint(folder.path()),
        "vibration.csv: columns level_g, u_max_v, ref_p_kurt are missing from the header"
    );
}

#[test]
fn a_bad_header_is_named() {
    let folder = edited("static.csv", |table| {
        table.replacen("u_v", "u_mv", 1).into_bytes()
    });
    assert_eq!(
        complaint(folder.path()),
        "static.csv, column u_v: is missing from the header"
    );
    let folder = edited("static.csv", |table| {
        table.replacen("temp_c", "u_v", 1).into_bytes()
    });
    assert_eq!(
        complaint(folder.path()),
        "static.csv, column u_v: stands in the header twice"
    );
    let folder = edited("vibration.csv", |table| {
        table.replace("ref_o_skew", "x").into_bytes()
    });
    assert_eq!(
        complaint(folder.path()),
        "vibration.csv, column ref_o_skew: is missing from the header"
    );
}

#[test]
fn a_file_without_content_is_named() {
    for content in ["", "\u{feff}", "\n\n"] {
        let folder = edited("static.csv", |_| content.into());
        assert_eq!(complaint(folder.path()), "static.csv: is an empty file");
        let folder = edited("campaign.toml", |_| content.into());
        assert_eq!(complaint(folder.path()), "campaign.toml: is an empty file");
    }
    let folder = edited("static.csv", |table| table.lines().next().unwrap().into());
    assert_eq!(complaint(folder.path()), "static.csv: has no rows");
    // A shaker test that was not made.
    let folder = edited("vibration.csv", |table| {
        table.lines().next().unwrap().into()
    });
    assert!(Campaign::read(folder.path()).unwrap().runs.is_empty());
    let folder = edited("static.csv", |table| table.lines().next().unwrap().into());
    fs::remove_file(folder.path().join("static.csv")).unwrap();
    assert!(complaint(folder.path()).starts_with("static.csv: cannot be read: No such file"));
}

#[test]
fn latin_1_is_named_with_its_row() {
    let latin = |table: String, from: &str| {
        let at = table.find(from).unwrap();
        let mut bytes = table.into_bytes();
        bytes[at] = 0xb0;
        bytes
    };
    let folder = edited("static.csv", |table| latin(table, "22.5"));
    assert_eq!(
        complaint(folder.path()),
        "static.csv, row 2, column temp_c: is not UTF-8 text; save the file as UTF-8"
    );
    let folder = edited("static.csv", |table| latin(table, "temp_c"));
    assert_eq!(
        complaint(folder.path()),
        "static.csv, row 1: is not UTF-8 text; save the file as UTF-8"
    );
    let folder = edited("campaign.toml", |text| latin(text, "A1"));
    assert_eq!(
        complaint(folder.path()),
        "campaign.toml, row 4: is not UTF-8 text; save the file as UTF-8"
    );
}

#[test]
fn a_row_of_another_instrument_is_named() {
    let folder = edited("static.csv", |table| {
        let mut lines = table.lines();
        let header = format!("{},serial\n", lines.next().unwrap());
        let rows = lines
            .enumerate()
            .map(|(index, line)| format!("{line},{}\n", if index == 7 { "A2" } else { "A1" }));
        (header + &rows.collect::<String>()).into_bytes()
    });
    let expected = "static.csv, row 9, column serial: \"A2\" is another instrument than \"A1\" of campaign.toml";
    assert_eq!(complaint(folder.path()), expected);
}

#[test]
fn a_bad_configuration_is_named() {
    let cases = [
        (
            "vre-campaign/1",
            "vre-campaign/2",
            "column format: \"vre-campaign/2\" is not vre-campaign/1",
        ),
        (
            "dial_sigma_arcsec = 5.8",
            "dial_sigma_arcsec = -1.0",
            "column dial_sigma_arcsec: -1 arcsec is outside of 0 to 36000 arcsec",
        ),
        (
            "dial_sigma_arcsec = 5.8",
            "dial_sigma_arcsec = nan",
            "column dial_sigma_arcsec: \"NaN\"",
        ),
        (
            "dial_sigma_arcsec = 5.8",
            "dial_sigma_arcsec = \"x\"",
            "campaign.toml, row 9: invalid type",
        ),
        (
            "dial_sigma_arcsec = 5.8",
            "",
            "missing field `dial_sigma_arcsec`",
        ),
        (
            "dial_sigma_arcsec = 5.8",
            "dial_sigma_arcsec",
            "campaign.toml, row 9: ",
        ),
        (
            "local_gravity_g = 1.0",
            "local_gravity_g = 9.81",
            "column local_gravity_g: 9.81 g is outside of 0.9 to 1.1 g",
        ),
        (
            "per_g = 1.25",
            "per_g = 0.0",
            "column scale_factor_nominal_v_per_g: 0 V/g is not at least 1e-9 V/g in magnitude",
        ),
        (
            "serial = \"A1\"",
            "serial = \" \"",
            "column serial: is empty",
        ),
        ("[acquisition]", "[instrument]", "campaign.toml, row "),
    ];
    for (from, to, expected) in cases {
        let folder = edited("campaign.toml", |text| {
            text.replacen(from, to, 1).into_bytes()
        });
        let message = complaint(folder.path());
        assert!(message.contains(expected), "{to}: {message}");
    }
}

#[test]
fn a_table_too_large_for_a_campaign_is_refused_after_a_bounded_read() {
    let folder = edited("static.csv", |table| {
        let rows: Vec<&str> = table.lines().skip(1).collect();
        let mut text = table.lines().next().unwrap().to_owned();
        for (order, row) in (0..=MAX_ROWS).zip(rows.iter().cycle()) {
            text += &format!("\n{order},{}", row.split_once(',').unwrap().1);
        }
        text.into_bytes()
    });
    assert_eq!(
        complaint(folder.path()),
        "static.csv, row 4098, column order: is one of more than 4096 readings"
    );
    let folder = edited("static.csv", |table| {
        (table + "1,\"" + &"never ending ".repeat(200_000)).into_bytes()
    });
    assert!(complaint(folder.path()).contains("a row has more than 1048576 bytes"));
}

/// The table without these columns.
fn without_columns(table: &str, gone: &[&str]) -> Vec<u8> {
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let lines = table.lines().map(|line| {
        let kept = header.iter().zip(line.split(','));
        let kept = kept.filter(|(name, _)| !gone.contains(name));
        kept.map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
    });
    lines.collect::<Vec<_>>().join("\n").into_bytes()
}

#[test]
fn words_are_known_in_capitals_and_with_spaces() {
    let folder = edited("static.csv", |table| {
        with_cell(&table, 4, "approach", " CW ")
    });
    let path = folder.path().join("vibration.csv");
    let table = fs::read_to_string(&path).unwrap();
    let spelt = table
        .replace("sine", " Sine")
        .replace("random", "RANDOM ")
        .replacen("u_during_v", " u_during_v ", 1);
    fs::write(&path, spelt).unwrap();
    assert_eq!(Campaign::read(folder.path()).unwrap(), common::campaign());
}

#[test]
fn specific_force_is_computed_where_it_is_absent_and_must_agree_where_it_is_not() {
    let forces = ["a_i_g", "a_p_g", "a_o_g"];
    let folder = edited("static.csv", |table| without_columns(&table, &forces));
    assert_eq!(Campaign::read(folder.path()).unwrap(), common::campaign());
    let folder = edited("static.csv", |table| with_cell(&table, 4, "a_p_g", ""));
    assert_eq!(Campaign::read(folder.path()).unwrap(), common::campaign());
    let folder = edited("static.csv", |table| {
        without_columns(
            &String::from_utf8(with_cell(&table, 4, "a_o_g", "0.3")).unwrap(),
            &forces[..2],
        )
    });
    assert!(complaint(folder.path()).starts_with("static.csv, row 4, column a_"));
}

#[test]
fn recovery_drift_and_extremes_may_be_absent_as_columns_and_as_cells() {
    let further = [
        "u_after_v",
        "drift_v_per_s",
        "drift_sigma_v_per_s",
        "u_min_v",
        "u_max_v",
    ];
    let of_row_3 = edited("vibration.csv", |table| {
        further
            .iter()
            .fold(table, |table, column| {
                String::from_utf8(with_cell(&table, 3, column, "")).unwrap()
            })
            .into_bytes()
    });
    let of_all = edited("vibration.csv", |table| without_columns(&table, &further));
    for (folder, lacking) in [(of_row_3, 1..2), (of_all, 0..2)] {
        let read = Campaign::read(folder.path()).unwrap();
        let mut expected = common::campaign();
        for run in &mut expected.runs[lacking] {
            let measured = run.measured.as_mut().unwrap();
            (measured.after_v, measured.drift, measured.extremes) = (None, None, None);
        }
        assert_eq!(read, expected);
        let copy = TempDir::new().unwrap();
        read.write(copy.path()).unwrap();
        assert_eq!(Campaign::read(copy.path()).unwrap(), read);
    }
}

#[test]
fn sessions_and_excluded_rows_are_kept_and_excluded_rows_are_not_used() {
    let mut campaign = common::campaign();
    campaign.readings[0].session = Some("monday".into());
    // Excluded for what would be an error otherwise.
    campaign.readings[3].exclude = true;
    campaign.readings[3].output_v = 0.0;
    campaign.runs[1].exclude = true;
    campaign.runs[1].session = Some("shaker 2".into());
    campaign.runs[1].time_s = 0.0;
    let folder = TempDir::new().unwrap();
    campaign.write(folder.path()).unwrap();
    let read = Campaign::read(folder.path()).unwrap();
    assert_eq!(read, campaign);
    assert_eq!(read.excluded(), (1, 1));
    let used = read.used();
    assert_eq!(used.readings.len(), campaign.readings.len() - 1);
    assert!(used.readings.iter().all(|reading| !reading.exclude));
    assert_eq!(
        used.runs.iter().map(|run| run.run).collect::<Vec<_>>(),
        [0, 2]
    );

    for reading in &mut campaign.readings {
        reading.exclude = true;
    }
    campaign.write(folder.path()).unwrap();
    assert_eq!(
        complaint(folder.path()),
        "static.csv: every reading is excluded"
    );
    let folder = edited("static.csv", |table| {
        with_cell(
            &table.replacen("temp_c", "exclude", 1),
            3,
            "exclude",
            "22.5",
        )
    });
    assert!(complaint(folder.path()).contains("temp_c: is missing"));
}

#[test]
fn what_campaign_toml_may_say_further_is_kept_and_written_back() {
    let further = "session_bias_sigma_g = 1e-5\nsession_alignment_sigma_arcsec = 30.0\nsession_gain_rel_sigma = 1e-6";
    let folder = edited("campaign.toml", |text| {
        let text = text.replace("[bench]", &format!("[bench]\n{further}"));
        let text = text.replace("[acquisition]", "[acquisition]\nsigma_dof = 8");
        let text = text.replace(
            "[shaker]",
            "[shaker]\nreference_cross_sensitivity = 0.02\nreference_noise_g = 1e-4\n\
             reference_gain_rel_sigma = 0.005\npeak_gain_rel_sigma = 0.01",
        );
        let last = "\n[limits]\nvre_g = 1e-4\nenvironment = \"random:2\"\nbias_g = 1e-3\n\
                    [record]\ndate = 2026-05-04\noperator = \"N. N.\"\nstation = \"3\"\nnote = \"damp\"\n";
        (text + last).into_bytes()
    });
    let campaign = Campaign::read(folder.path()).unwrap();
    let config = &campaign.config;
    assert_eq!(config.bench.session_bias_sigma_g, Some(1e-5));
    assert_eq!(config.bench.session_alignment_sigma_arcsec, Some(30.0));
    assert_eq!(config.bench.session_gain_rel_sigma, Some(1e-6));
    assert_eq!(config.acquisition.sigma_dof, Some(8.0));
    let shaker = config.shaker.as_ref().unwrap();
    assert_eq!(shaker.reference_cross_sensitivity, Some(0.02));
    assert_eq!(shaker.reference_noise_g, Some(1e-4));
    assert_eq!(shaker.reference_gain_rel_sigma, Some(0.005));
    assert_eq!(shaker.peak_gain_rel_sigma, Some(0.01));
    assert_eq!(config.limits.as_ref().unwrap().vre_g, Some(1e-4));
    let operator = config.record.as_ref().unwrap().operator.as_deref();
    assert_eq!(operator, Some("N. N."));
    assert!(campaign.oddities().is_empty(), "{:?}", campaign.oddities());
    let copy = TempDir::new().unwrap();
    campaign.write(copy.path()).unwrap();
    assert_eq!(Campaign::read(copy.path()).unwrap(), campaign);
}

#[test]
fn a_key_that_is_nearly_known_or_stands_in_another_table_is_an_error_and_others_are_odd() {
    for (from, to, expected) in [
        (
            "mount_sigma_arcsec",
            "mount_sigma_arcse",
            "column mount_sigma_arcse: is not known; is [bench] mount_sigma_arcsec meant?",
        ),
        (
            "[acquisition]",
            "[acquisition]\nSigma_DOFs = 3",
            "column Sigma_DOFs: is not known; is [acquisition] sigma_dof meant?",
        ),
        (
            "[bench]",
            "[bench]\nsigma_dof = 3",
            "column sigma_dof: is not known; is [acquisition] sigma_dof meant?",
        ),
        (
            "[acquisition]",
            "[Limit]\n[acquisition]",
            "column Limit: is not known; is limits meant?",
        ),
    ] {
        let folder = edited("campaign.toml", |text| {
            text.replacen(from, to, 1).into_bytes()
        });
        let message = complaint(folder.path());
        assert!(message.contains(expected), "{message}");
    }
    let folder = edited("campaign.toml", |text| {
        text.replacen("[bench]", "[bench]\nroom = 17", 1)
            .into_bytes()
    });
    assert_eq!(
        Campaign::read(folder.path()).unwrap().oddities(),
        ["campaign.toml: [bench] room is not known; kept, and not used"]
    );
}

#[test]
fn what_is_odd_is_told_and_no_error() {
    let mut campaign = common::campaign();
    assert!(campaign.oddities().is_empty());
    campaign.config.instrument.full_scale_g = 1.0;
    campaign.readings[5].temp_c = 295.0;
    campaign.readings[7].time_s = 0.0;
    let odd = campaign.oddities();
    let expected = [
        "vibration.csv: run 0 has 1.7999999999999998 g along the input axis",
        "static.csv: reading 5 is at 295 C",
        "static.csv: reading 7 at 0 s follows one at 630 s: time goes backwards",
    ];
    assert_eq!(odd.len(), expected.len(), "{odd:?}");
    for (odd, expected) in odd.iter().zip(expected) {
        assert!(odd.starts_with(expected), "{odd}");
    }
}

#[test]
fn absurd_numbers_pass_in_no_cell_and_under_no_key() {
    let absurd = ["5e-324", "-5e-324", "1e160", "-1e160", "1e300", "-1e300"];
    let folder = edited("static.csv", String::into_bytes);
    let told_of = |file: &str, spoilt: &dyn Fn(&str) -> Vec<u8>| {
        let path = folder.path().join(file);
        let sound = fs::read_to_string(&path).unwrap();
        fs::write(&path, spoilt(&sound)).unwrap();
        let message = complaint(folder.path());
        fs::write(&path, &sound).unwrap();
        message
    };
    for file in ["static.csv", "vibration.csv"] {
        let table = fs::read_to_string(folder.path().join(file)).unwrap();
        let words = ["approach", "series", "kind"];
        let columns = table.lines().next().unwrap().split(',');
        for column in columns.filter(|column| !words.contains(column)) {
            for value in absurd {
                let message = told_of(file, &|table| with_cell(table, 3, column, value));
                let place = format!("{file}, row 3, column ");
                assert!(message.starts_with(&place), "{column} {value}: {message}");
            }
        }
    }
    let text = fs::read_to_string(folder.path().join("campaign.toml")).unwrap();
    let keys: Vec<&str> = text
        .lines()
        .filter_map(|line| line.split_once(" = "))
        .filter(|(_, value)| value.parse::<f64>().is_ok())
        .map(|(key, _)| key)
        .collect();
    assert!(keys.len() > 8, "{keys:?}");
    for key in keys {
        for value in absurd {
            let message = told_of("campaign.toml", &|text| {
                let lines = text.lines().map(|line| match line.split_once(" = ") {
                    Some((found, _)) if found == key => format!("{key} = {value}"),
                    _ => line.to_owned(),
                });
                lines.collect::<Vec<_>>().join("\n").into_bytes()
            });
            assert!(message.contains(&format!("column {key}: ")), "{message}");
        }
    }
}

#[test]
fn moments_that_no_motion_has_are_named() {
    let cases: [(&[(&str, &str)], &str); 3] = [
        (
            &[("ref_i_skew", "100"), ("ref_i_kurt", "3")],
            "vibration.csv, row 3, column ref_i_kurt: 3 is below 1 + skewness^2 = 10001",
        ),
        (
            &[("ref_p_kurt", "0.99")],
            "vibration.csv, row 3, column ref_p_kurt: 0.99 is below 1 + skewness^2 = 1",
        ),
        (
            &[
                ("ref_ip_corr", "0.9"),
                ("ref_io_corr", "0.9"),
                ("ref_po_corr", "-0.9"),
            ],
            "vibration.csv, row 3, column ref_ip_corr: 0.9 with 0.9 and -0.9: no motion has",
        ),
    ];
    for (cells, expected) in cases {
        let folder = edited("vibration.csv", |table| {
            let spoilt = cells.iter().fold(table, |table, (column, value)| {
                String::from_utf8(with_cell(&table, 3, column, value)).unwrap()
            });
            spoilt.into_bytes()
        });
        let message = complaint(folder.path());
        assert!(message.starts_with(expected), "{message}");
    }
    // A square wave printed with three decimals, and a motion along one line.
    let folder = edited("vibration.csv", |table| {
        let table = String::from_utf8(with_cell(&table, 3, "ref_i_kurt", "0.9996")).unwrap();
        let table = String::from_utf8(with_cell(&table, 3, "ref_io_corr", "0.999")).unwrap();
        with_cell(&table, 3, "ref_po_corr", "0.999")
    });
    Campaign::read(folder.path()).unwrap();
}

#[test]
fn what_steers_a_terminal_is_taken_out_of_texts() {
    let folder = edited("campaign.toml", |text| {
        let text = text.replacen("\"A1\"", "\"A\\u001b[31m1\\u202e\"", 1);
        (text + "\n[record]\nnote = \"a\\u0007b\"\n").into_bytes()
    });
    let config = Campaign::read(folder.path()).unwrap().config;
    assert_eq!(config.instrument.serial, "A[31m1");
    assert_eq!(config.record.unwrap().note.as_deref(), Some("ab"));
}

#[test]
fn the_document_of_ranges_is_the_table_that_is_checked() {
    let rows = ranges::ALL.iter().map(|range| format!("- {range}\n"));
    let document = include_str!("../../docs/ranges.md");
    let listed: Vec<&str> = document
        .split_inclusive('\n')
        .filter(|l| l.starts_with("- "))
        .collect();
    assert_eq!(listed.concat(), rows.collect::<String>());
}

#[test]
fn a_row_of_a_table_with_carriage_returns_or_blank_lines_is_named_by_its_line() {
    let folder = tempfile::tempdir().unwrap();
    common::campaign().write(folder.path()).unwrap();
    let file = folder.path().join("static.csv");
    let table = std::fs::read_to_string(&file).unwrap();
    let mut lines: Vec<String> = table.lines().map(str::to_owned).collect();
    lines[3] = lines[3].replacen(',', ",x", 1);
    for (text, row) in [
        (lines.join("\r\n"), 4),
        (lines.join("\n").replacen('\n', "\n\n", 1), 5),
    ] {
        std::fs::write(&file, text).unwrap();
        let line = Campaign::read(folder.path()).unwrap_err().to_string();
        assert!(line.contains(&format!("static.csv, row {row}, ")), "{line}");
    }
}
