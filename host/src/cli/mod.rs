//! The command line: one file a command, each a thin layer over the library.
//!
//! A command is a `clap::Args` struct with a `Command` implementation in a module of its own, and one line in
//! `commands!`.

mod console;
mod environment;
mod head;
mod into;
mod operator;
mod sparkline;
mod triad;
mod wrap;

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};
use serde::Serialize;

pub use console::Console;

use crate::campaign::{Campaign, table_file};
use crate::capture::RECORD;
use crate::error::{Error, printable};

/// What a command does with its arguments.
trait Command {
    fn run(self, console: &Console) -> Result<(), Error>;
}

/// The subcommands from the modules that hold them.
macro_rules! commands {
    ($($module:ident :: $name:ident),* $(,)?) => {
        $(mod $module;)*

        #[derive(Subcommand)]
        enum Subcommands {
            $($name($module::$name),)*
        }

        impl Command for Subcommands {
            fn run(self, console: &Console) -> Result<(), Error> {
                match self {
                    $(Self::$name(command) => command.run(console),)*
                }
            }
        }
    };
}

commands! {
    bring_up::BringUp,
    capture::Capture,
    configure::Configure,
    demo::Demo,
    blind_check::BlindCheck,
    completions::Completions,
    diagnose::Diagnose,
    effects::Effects,
    help::Help,
    fleet::Fleet,
    identify::Identify,
    look::Look,
    measure::Measure,
    paper::Paper,
    plan::Plan,
    predict::Predict,
    reduce::Reduce,
    report::Report,
    rests::Rests,
    simulate::Simulate,
    template::Template,
    unseal::Unseal,
    verify::Verify,
    watch::Watch,
}

/// Vibration rectification error of a navigation accelerometer: predicted from a static test, compared with
/// the shaker.
#[derive(Parser)]
#[command(
    name = "vre",
    version,
    arg_required_else_help = true,
    propagate_version = true,
    disable_help_subcommand = true
)]
struct Arguments {
    #[command(flatten)]
    console: Console,
    #[command(subcommand)]
    command: Subcommands,
}

/// Columns of text that is not fitted to a terminal.
const COLUMNS: usize = 80;

/// Runs the command with its `arguments`, the first being the program's name. Exit status: 0 done, 2 bad
/// usage or bad input, 1 anything else; a failure is one line on standard error, and an object where `--json` says.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let (console, outcome) = match Arguments::try_parse_from(&arguments) {
        Ok(Arguments { console, command }) => {
            let outcome = command.run(&console);
            (console, outcome)
        }
        Err(error) => match error.kind() {
            ErrorKind::DisplayHelp
            | ErrorKind::DisplayVersion
            | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
                // Help that nobody reads is no failure.
                let _ = error.print();
                return ExitCode::from(error.exit_code() as u8);
            }
            _ => {
                let failure = Error::Usage(usage_line(&error));
                (Console::of_arguments(&arguments), Err(failure))
            }
        },
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is_broken_pipe() => ExitCode::SUCCESS,
        Err(error) => {
            let line = printable(&error.to_string().replace(char::is_control, " "));
            // With standard error closed, the exit status is all that is left to say it.
            let _ = writeln!(io::stderr(), "error: {line}");
            let _ = console.json_failure(&Failure::new(&error, line));
            ExitCode::from(error.exit_status())
        }
    }
}

/// A failure for programs, `vre-error/1`.
#[derive(Serialize)]
struct Failure<'e> {
    format: &'static str,
    error: String,
    exit_status: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    file: Option<&'e Path>,
    #[serde(skip_serializing_if = "Option::is_none")]
    row: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    column: Option<&'e str>,
}

impl<'e> Failure<'e> {
    fn new(error: &'e Error, line: String) -> Self {
        let place = match error {
            Error::Input { place, .. } => Some(place),
            _ => None,
        };
        let file = match error {
            Error::Read { file, .. } | Error::Write { file, .. } => Some(file),
            _ => place.map(|place| &place.file),
        };
        Self {
            format: "vre-error/1",
            error: line,
            exit_status: error.exit_status(),
            file: file.map(PathBuf::as_path),
            row: place.and_then(|place| place.row),
            column: place.and_then(|place| place.column.as_deref()),
        }
    }
}

/// `; is ... meant?` where one of the known words is like this one.
fn like(word: &str, known: Vec<&str>) -> String {
    let scored = known
        .into_iter()
        .map(|known| (strsim::jaro(word, known), known));
    let best = scored.max_by(|a, b| a.0.total_cmp(&b.0));
    // By eye: as strict as clap, which names a word from 0.7 on.
    match best {
        Some((score, known)) if score > 0.7 => format!("; is {known} meant?"),
        _ => String::new(),
    }
}

/// A row that is left out: its line of a table, `static.csv:12`; without a table's name of static.csv.
#[derive(Clone, Debug)]
struct RowName {
    table: String,
    line: u64,
}

impl std::str::FromStr for RowName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (table, line) = text.rsplit_once(':').unwrap_or(("static.csv", text));
        if !["static.csv", "vibration.csv"].contains(&table) {
            return Err(
                "the tables are static.csv and vibration.csv, as in vibration.csv:12".into(),
            );
        }
        let line = line
            .parse()
            .map_err(|_| "not a line of a table".to_owned())?;
        Ok(Self {
            table: table.into(),
            line,
        })
    }
}

/// Excludes rows of a campaign that was read.
fn exclude(campaign: &mut Campaign, folder: &Path, rows: &[RowName]) -> Result<(), Error> {
    for RowName { table, line } in rows {
        let mark = match table.as_str() {
            "static.csv" => {
                let mut readings = campaign.readings.iter_mut();
                readings.find(|r| r.line == *line).map(|r| &mut r.exclude)
            }
            _ => {
                let mut runs = campaign.runs.iter_mut();
                runs.find(|r| r.line == *line).map(|r| &mut r.exclude)
            }
        };
        let nothing = || {
            Error::Usage(format!(
                "--exclude: {} has no row {line}",
                folder.join(table).display()
            ))
        };
        *mark.ok_or_else(nothing)? = true;
    }
    if campaign.readings.iter().all(|reading| reading.exclude) {
        return Err(Error::Usage(
            "--exclude: no reading of static.csv is left".into(),
        ));
    }
    Ok(())
}

/// The campaign in `folder` as it is used, without further rows. Tells what is odd about it, and how many of its rows are
/// excluded.
fn read_campaign(folder: &Path, without: &[RowName], console: &Console) -> Result<Campaign, Error> {
    let mut campaign = Campaign::read(folder)?;
    exclude(&mut campaign, folder, without)?;
    let (readings, runs) = campaign.excluded();
    let campaign = campaign.used();
    for oddity in campaign.oddities() {
        console.warn(oddity)?;
    }
    if readings + runs > 0 {
        console.print(format!(
            "left out as excluded: {readings} readings, {runs} runs\n"
        ))?;
    }
    Ok(campaign)
}

/// Files by which a folder holds a campaign.
const CAMPAIGN_FILES: [&str; 2] = ["campaign.toml", RECORD];

/// Tables by which it does, whatever program wrote them.
const TABLES: [&str; 3] = ["static", "positions", "vibration"];

/// A folder that holds a campaign is not written into; `hint` tells what else can be done than to name another.
fn refuse_campaign(folder: &Path, hint: &str) -> Result<(), Error> {
    let files = CAMPAIGN_FILES.iter().map(|name| folder.join(name));
    let tables = TABLES.iter().map(|stem| table_file(folder, stem));
    for file in files.map(Ok).chain(tables) {
        let file = file?;
        if file.exists() {
            let name = file.file_name().unwrap_or_default().display();
            return Err(Error::Usage(format!(
                "{}: holds {name} of a campaign already; name another folder{hint}",
                folder.display()
            )));
        }
    }
    Ok(())
}

/// A finite number greater than zero.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("is not a finite number greater than zero".into()),
    }
}

/// The first paragraph of clap's message, and its tips, as one line.
fn usage_line(error: &clap::Error) -> String {
    let message = error.render().to_string();
    let paragraph = message.lines().take_while(|line| !line.trim().is_empty());
    let tips = message
        .lines()
        .filter_map(|line| line.trim().strip_prefix("tip: "));
    let line = paragraph.map(str::trim).collect::<Vec<_>>().join(" ");
    let line = line.trim_start_matches("error: ");
    let tips: String = tips.map(|tip| format!("; {tip}")).collect();
    format!("{line}{tips}; see `vre --help`")
}
