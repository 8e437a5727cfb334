//! A campaign to fill in, made of the tables of columns and keys.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use rust_xlsxwriter::{Format, Workbook, XlsxError};
use shared::tumble::Position;

use crate::bench::plan::Dwell;
use crate::campaign::Approach;
use crate::campaign::columns::{Column, Columns, Need, TABLES};
use crate::campaign::keys::KEYS;
use crate::error::Error;
use crate::output::write_file;

/// One reading that is to be taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    position: Position,
    approach: Option<Approach>,
}

impl From<Dwell> for Row {
    fn from(dwell: Dwell) -> Self {
        Self {
            position: Position {
                series: dwell.series,
                dial_deg: dwell.dial_deg,
                mount_deg: dwell.mount_deg,
            },
            approach: Some(dwell.approach),
        }
    }
}

impl From<Position> for Row {
    fn from(position: Position) -> Self {
        Self {
            position,
            approach: None,
        }
    }
}

/// Columns that a template leaves out, since they follow from others or few laboratories have them.
const LEFT_OUT: [&str; 4] = ["a_i_g", "a_p_g", "a_o_g", "exclude"];

/// Writes `campaign.toml` and the tables, as workbooks with `xlsx`; the names of the files.
///
/// # Errors
/// What the file system says.
pub fn write(folder: &Path, rows: &[Row], xlsx: bool) -> Result<Vec<String>, Error> {
    fs::create_dir_all(folder).map_err(Error::write(folder))?;
    write_file(&folder.join("campaign.toml"), head().as_bytes())?;
    let [readings, runs, ..] = &TABLES;
    let mut names = vec!["campaign.toml".to_owned()];
    for (table, rows) in [(readings, rows), (runs, [].as_slice())] {
        let columns: Vec<&Column> = table
            .columns
            .iter()
            .filter(|column| !LEFT_OUT.contains(&column.name))
            .collect();
        let cells: Vec<Vec<String>> = rows
            .iter()
            .enumerate()
            .map(|(order, row)| {
                columns
                    .iter()
                    .map(|column| cell(column, order, row))
                    .collect()
            })
            .collect();
        let stem = table.file.trim_end_matches(".csv");
        let name = format!("{stem}.{}", if xlsx { "xlsx" } else { "csv" });
        let file = folder.join(&name);
        match xlsx {
            true => {
                let book = workbook(stem, &columns, &cells);
                let bytes =
                    book.map_err(|error| Error::write(&file)(std::io::Error::other(error)))?;
                write_file(&file, &bytes)?;
            }
            false => write_file(&file, text(table, &columns, &cells).as_bytes())?,
        }
        names.push(name);
    }
    Ok(names)
}

/// What is known of a cell before the reading is taken.
fn cell(column: &Column, order: usize, row: &Row) -> String {
    let position = &row.position;
    match column.name {
        "order" => order.to_string(),
        "series" => u8::from(position.series).to_string(),
        "dial_deg" => position.dial_deg.to_string(),
        "mount_deg" => position.mount_deg.to_string(),
        "approach" => match row.approach {
            Some(Approach::Clockwise) => "cw".into(),
            Some(Approach::CounterClockwise) => "ccw".into(),
            None => String::new(),
        },
        _ => String::new(),
    }
}

/// `campaign.toml`: what a campaign must state, and what it may, all to be filled in.
fn head() -> String {
    let mut text = String::from(
        "# Take the # off the keys that you know and put your own figures in. Those marked REQUIRED must be there.\n",
    );
    for table in KEYS {
        if let Some(name) = table.name {
            // A table of optional keys may stand there empty, but for one that asks for a key.
            let open = table.required || table.keys.iter().all(|key| key.need == Need::Optional);
            let mark = if open { "" } else { "# " };
            let _ = writeln!(text, "\n# {}\n{mark}[{name}]", table.about);
        }
        for key in table.keys {
            let unit = match key.unit() {
                "" => String::new(),
                unit => format!(", {unit}"),
            };
            let need = if key.need == Need::Required {
                "REQUIRED: "
            } else {
                ""
            };
            let _ = match key.name {
                "format" => writeln!(text, "{} = {}", key.name, key.example),
                name => writeln!(
                    text,
                    "# {name} = {}  # {need}{}{unit}",
                    key.example, key.meaning
                ),
            };
        }
    }
    text
}

/// A table as CSV, with its columns explained and an example in comments above.
fn text(table: &Columns, columns: &[&Column], rows: &[Vec<String>]) -> String {
    let mut text = format!(
        "# {} a row. Lines that begin with # are comments.\n",
        table.row
    );
    for column in columns {
        let need = match column.need {
            Need::Required => "",
            Need::Measured => " (empty in a run that is to be predicted)",
            Need::Optional => " (optional)",
        };
        let _ = writeln!(
            text,
            "# {}: {}{need}; {}",
            column.name,
            column.meaning,
            column.values()
        );
    }
    let line = |cells: Vec<&str>| cells.join(",");
    let names = line(columns.iter().map(|column| column.name).collect());
    let example = line(columns.iter().map(|column| column.example).collect());
    let _ = writeln!(text, "# example: {example}\n{names}");
    for row in rows {
        let _ = writeln!(text, "{}", line(row.iter().map(String::as_str).collect()));
    }
    text
}

/// A table as a sheet, and a second one that explains its columns.
fn workbook(name: &str, columns: &[&Column], rows: &[Vec<String>]) -> Result<Vec<u8>, XlsxError> {
    let bold = Format::new().set_bold();
    let mut book = Workbook::new();
    let sheet = book.add_worksheet().set_name(name)?;
    sheet.set_freeze_panes(1, 0)?;
    for (at, column) in (0..).zip(columns) {
        sheet.write_with_format(0, at, column.name, &bold)?;
        sheet.set_column_width(at, column.name.len().max(8) as f64 + 2.0)?;
        for (row, cells) in (1..).zip(rows) {
            let cell = &cells[usize::from(at)];
            match cell.parse::<f64>() {
                Ok(number) => sheet.write(row, at, number)?,
                Err(_) => sheet.write(row, at, cell)?,
            };
        }
    }
    let explained = book.add_worksheet().set_name("columns")?;
    let widths = [22.0, 14.0, 34.0, 90.0, 16.0];
    let heads = ["column", "needed", "values", "meaning", "example"];
    for (at, (head, width)) in (0..).zip(heads.iter().zip(widths)) {
        explained.write_with_format(0, at, *head, &bold)?;
        explained.set_column_width(at, width)?;
    }
    for (row, column) in (1..).zip(columns) {
        let need = match column.need {
            Need::Required => "required",
            Need::Measured => "where measured",
            Need::Optional => "optional",
        };
        let values = column.values();
        let cells = [column.name, need, &values, column.meaning, column.example];
        for (at, cell) in (0..).zip(cells) {
            explained.write(row, at, cell)?;
        }
    }
    book.save_to_buffer()
}
