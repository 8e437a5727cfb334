//! What a campaign's tables accept, and where they say that something is wrong.

mod common;

use std::fs;
use std::path::Path;

use host::campaign::{Campaign, MAX_ROWS};
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
            "static.csv, row 4, column sigma_v: 0 is not greater than zero",
        ),
        (
            "static.csv",
            "sigma_v",
            "-1e-6",
            "column sigma_v: -0.000001 is not greater than zero",
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
            "CW",
            "column approach: \"CW\" is not an approach: cw or ccw",
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
            "column duration_s: 0 is not greater than zero",
        ),
        (
            "vibration.csv",
            "level_g",
            "-1",
            "column level_g: -1 is outside of 0 to 1000000",
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
            "column sigma_v: 0 is not greater than zero",
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
            "column ref_p_rms_g: -1 is outside of 0",
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
        "static.csv, row 2, column temp_c: is not UTF-8 text"
    );
    let folder = edited("static.csv", |table| latin(table, "temp_c"));
    assert_eq!(
        complaint(folder.path()),
        "static.csv, row 1: is not UTF-8 text"
    );
    let folder = edited("campaign.toml", |text| latin(text, "A1"));
    assert_eq!(
        complaint(folder.path()),
        "campaign.toml, row 4: is not UTF-8 text"
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
            "column dial_sigma_arcsec: -1 is outside",
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
            "column local_gravity_g: 9.81 is outside",
        ),
        (
            "per_g = 1.25",
            "per_g = 0.0",
            "column scale_factor_nominal_v_per_g: 0 is not greater than zero",
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
