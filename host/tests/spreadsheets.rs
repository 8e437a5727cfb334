//! A campaign's tables as spreadsheets and other makers' programs write them.

mod common;

use std::fs;
use std::path::Path;

use host::campaign::{Campaign, read_runs};
use rust_xlsxwriter::Workbook;
use tempfile::TempDir;

/// A campaign's folder, and the text of one of its tables.
fn folder_and(table: &str) -> (TempDir, String) {
    let folder = TempDir::new().unwrap();
    common::campaign().write(folder.path()).unwrap();
    let text = fs::read_to_string(folder.path().join(table)).unwrap();
    (folder, text)
}

/// Reads the campaign with `text` in the place of `table`.
fn read_with(table: &str, edit: impl FnOnce(&str) -> String) -> Result<Campaign, String> {
    let (folder, text) = folder_and(table);
    fs::write(folder.path().join(table), edit(&text)).unwrap();
    read(folder.path())
}

/// The campaign, or the complaint without the folder's name.
fn read(folder: &Path) -> Result<Campaign, String> {
    Campaign::read(folder).map_err(|error| {
        let message = error.to_string();
        message.replace(&format!("{}/", folder.display()), "")
    })
}

/// Rows of cells; no cell of these tables has a quote.
fn cells(table: &str) -> Vec<Vec<String>> {
    let row = |line: &str| line.split(',').map(str::to_owned).collect();
    table.lines().map(row).collect()
}

fn joined(cells: &[Vec<String>], by: &str) -> String {
    let lines: Vec<String> = cells.iter().map(|row| row.join(by)).collect();
    lines.join("\r\n") + "\r\n"
}

/// The same campaign, but for the lines in which its rows stand.
fn check_alike(found: Result<Campaign, String>) {
    let (mut found, mut expected) = (found.unwrap(), common::campaign());
    for campaign in [&mut found, &mut expected] {
        campaign.readings.iter_mut().for_each(|row| row.line = 0);
        campaign.runs.iter_mut().for_each(|row| row.line = 0);
    }
    assert_eq!(found, expected);
}

#[test]
fn semicolons_tabs_bars_and_decimal_commas_change_nothing() {
    for table in ["static.csv", "vibration.csv"] {
        for by in [";", "\t", "|"] {
            check_alike(read_with(table, |text| joined(&cells(text), by)));
        }
        let german = |text: &str| joined(&cells(&text.replace('.', ";")), "\t").replace(';', ",");
        check_alike(read_with(table, german));
    }
}

#[test]
fn a_line_that_states_the_separator_comments_blank_rows_and_empty_trailing_cells_are_no_data() {
    let padded = |text: &str| {
        let mut rows = cells(text);
        rows.iter_mut()
            .for_each(|row| row.extend(["".into(), "".into()]));
        let blank = vec![String::new(); rows[0].len()];
        rows.insert(3, blank.clone());
        rows.push(blank);
        format!("sep=;\r\n# order;time_s are ours\r\n{}", joined(&rows, ";")).replacen(
            "\r\n0;",
            "\r\n# the first\r\n0;",
            1,
        )
    };
    check_alike(read_with("static.csv", padded));
    check_alike(read_with("vibration.csv", padded));
    // Cells beyond the header's alone.
    check_alike(read_with("static.csv", |text| {
        text.replace('\n', ",,\n").replacen(",,\n", "\n", 1)
    }));
}

#[test]
fn errors_name_the_files_own_line_and_the_headers_own_word() {
    let damaged = |text: &str| {
        let text = text.replacen("u_v", "U [V]", 1);
        let lines: Vec<&str> = text.lines().collect();
        let row = lines[3].replacen(',', ",x", 1);
        format!(
            "# by hand\n\n{}\n{}\n# second\n{}\n{row}\n",
            lines[0], lines[1], lines[2]
        )
    };
    let complaint = read_with("static.csv", damaged).unwrap_err();
    assert!(
        complaint.starts_with("static.csv, row 7, column time_s: \"x"),
        "{complaint}"
    );
    let empty = |text: &str| {
        let mut rows = cells(&text.replacen("u_v", "U [V]", 1));
        let column = rows[0].iter().position(|name| name == "U [V]").unwrap();
        rows[4][column].clear();
        joined(&rows, ";")
    };
    assert_eq!(
        read_with("static.csv", empty).unwrap_err(),
        "static.csv, row 5, column U [V]: is empty"
    );
}

#[test]
fn names_in_other_letters_and_units_behind_them_are_the_same_columns() {
    check_alike(read_with("static.csv", |text| {
        let text = text.replacen("order", "Order", 1);
        let text = text.replacen("dial_deg", " Dial (deg)", 1);
        let text = text.replacen("temp_c", "TEMP [\u{b0}C]", 1);
        text.replacen("u_v", "U / V", 1)
    }));
    let scaled = |text: &str| {
        let mut rows = cells(text);
        for (name, written, factor) in [
            ("u_v", "u [mV]", 1e3),
            ("sigma_v", "Sigma [\u{b5}V]", 1e6),
            ("time_s", "time [min]", 1.0 / 60.0),
            ("dial_deg", "dial [rad]", std::f64::consts::PI / 180.0),
        ] {
            let column = rows[0].iter().position(|cell| cell == name).unwrap();
            rows[0][column] = written.into();
            for row in &mut rows[1..] {
                row[column] = (row[column].parse::<f64>().unwrap() * factor).to_string();
            }
        }
        joined(&rows, ",")
    };
    let found = read_with("static.csv", scaled).unwrap();
    for (found, expected) in found.readings.iter().zip(&common::campaign().readings) {
        for (a, b) in [
            (found.output_v, expected.output_v),
            (found.sigma_v, expected.sigma_v),
            (found.time_s, expected.time_s),
            (found.dial_deg, expected.dial_deg),
        ] {
            assert!((a - b).abs() <= 1e-15 * (1.0 + b.abs()), "{a} for {b}");
        }
    }
}

#[test]
fn a_row_of_units_under_the_header_counts() {
    let found = read_with("static.csv", |text| {
        let mut rows = cells(text);
        let unit = |name: &String| match name.as_str() {
            "u_v" => "mV".to_owned(),
            "time_s" => "s".into(),
            _ => "-".into(),
        };
        let units = rows[0].iter().map(unit).collect();
        let column = rows[0].iter().position(|cell| cell == "u_v").unwrap();
        rows[0][column] = "u".into();
        for row in &mut rows[1..] {
            row[column] = (1e3 * row[column].parse::<f64>().unwrap()).to_string();
        }
        rows.insert(1, units);
        joined(&rows, ";")
    });
    let (found, expected) = (found.unwrap(), common::campaign());
    assert_eq!(found.readings.len(), expected.readings.len());
    for (found, expected) in found.readings.iter().zip(&expected.readings) {
        assert!((found.output_v - expected.output_v).abs() < 1e-15);
    }
}

#[test]
fn a_unit_that_cannot_be_is_one_line_that_tells_what_to_write() {
    for (written, told) in [
        (
            "u [furlong]",
            "static.csv, row 1, column u [furlong]: \"furlong\" is no unit of u_v; write u [V] or one like it",
        ),
        (
            "u_v [mV]",
            "static.csv, row 1, column u_v [mV]: names two units; write u [mV]",
        ),
    ] {
        let found = read_with("static.csv", |text| text.replacen("u_v", written, 1));
        assert_eq!(found.unwrap_err(), told);
    }
    let commas = read_with("static.csv", |text| text.replacen("22.5", "22,5", 1));
    assert_eq!(
        commas.unwrap_err(),
        "static.csv, row 2: has 13 cells, the header 12; where commas are decimal signs, separate cells by semicolons"
    );
    let mut wide = Vec::from(*b"\xff\xfe");
    wide.extend("order".encode_utf16().flat_map(u16::to_le_bytes));
    let (folder, _) = folder_and("static.csv");
    fs::write(folder.path().join("static.csv"), wide).unwrap();
    assert_eq!(
        read(folder.path()).unwrap_err(),
        "static.csv: is UTF-16 text; save it as \"CSV UTF-8\""
    );
}

/// Writes a workbook as a spreadsheet program has it: numbers as numbers, a title above, a second sheet that explains.
fn write_workbook(file: &Path, rows: &[Vec<String>]) {
    let mut book = Workbook::new();
    let explaining = book.add_worksheet().set_name("about").unwrap();
    explaining.write(0, 0, "column").unwrap();
    explaining.write(1, 0, "order").unwrap();
    let sheet = book.add_worksheet().set_name("data").unwrap();
    sheet.write(0, 1, "Our bench, 2026").unwrap();
    for (row, cells) in (2..).zip(rows) {
        for (column, cell) in (1..).zip(cells) {
            match cell.parse::<f64>() {
                Ok(number) => sheet.write(row, column, number).unwrap(),
                Err(_) => sheet.write(row, column, cell).unwrap(),
            };
        }
    }
    book.save(file).unwrap();
}

#[test]
fn a_sheet_of_a_workbook_is_a_table_and_its_rows_are_named_by_their_numbers() {
    for table in ["static", "vibration"] {
        let csv = format!("{table}.csv");
        let (folder, text) = folder_and(&csv);
        fs::remove_file(folder.path().join(&csv)).unwrap();
        let file = folder.path().join(format!("{table}.xlsx"));
        write_workbook(&file, &cells(&text));
        check_alike(read(folder.path()));
    }
    let (folder, text) = folder_and("static.csv");
    fs::remove_file(folder.path().join("static.csv")).unwrap();
    let mut rows = cells(&text);
    rows[2][4] = "left".into();
    write_workbook(&folder.path().join("static.xlsx"), &rows);
    let name = &rows[0][4];
    let complaint = read(folder.path()).unwrap_err();
    assert!(
        complaint.starts_with(&format!("static.xlsx, row 5, column {name}: \"left\"")),
        "{complaint}"
    );
}

#[test]
fn two_files_of_one_table_and_a_damaged_workbook_are_refused() {
    let (folder, text) = folder_and("static.csv");
    let file = folder.path().join("static.xlsx");
    write_workbook(&file, &cells(&text));
    assert_eq!(
        read(folder.path()).unwrap_err(),
        "static.csv: stands beside static.xlsx; keep one of them"
    );
    let bytes = fs::read(&file).unwrap();
    fs::remove_file(folder.path().join("static.csv")).unwrap();
    for length in [4, bytes.len() / 3, bytes.len() - 20] {
        fs::write(&file, &bytes[..length]).unwrap();
        let complaint = read(folder.path()).unwrap_err();
        assert!(
            complaint.starts_with("static.xlsx: is no XLSX, XLS or ODS that can be read"),
            "{complaint}"
        );
    }
}

/// The files were written by odfpy 1.4 and by openpyxl 3.1 from the table beside them.
#[test]
fn workbooks_of_other_programs_are_read_as_the_table_they_were_made_of() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let config = common::campaign().config;
    let runs = |name: &str| {
        let mut runs = read_runs(&data.join(name), &config).unwrap();
        runs.iter_mut().for_each(|run| run.line = 0);
        runs
    };
    let expected = runs("runs.csv");
    assert_eq!(expected.len(), 3);
    for name in ["runs.ods", "runs.xlsx"] {
        assert_eq!(runs(name), expected, "{name}");
    }
}
