//! The command line: one file a command, each a thin layer over the library.
//!
//! A command is a `clap::Args` struct with a `Command` implementation in a module of its own, and one line in
//! `commands!`.

mod console;
mod head;
mod triad;

use std::ffi::OsString;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

pub use console::Console;

use crate::campaign::Campaign;
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
    diagnose::Diagnose,
    fleet::Fleet,
    identify::Identify,
    measure::Measure,
    paper::Paper,
    plan::Plan,
    predict::Predict,
    report::Report,
    rests::Rests,
    simulate::Simulate,
    unseal::Unseal,
    verify::Verify,
}

/// Vibration rectification error of a navigation accelerometer: predicted from a static test, compared with
/// the shaker.
#[derive(Parser)]
#[command(
    name = "vre",
    version,
    arg_required_else_help = true,
    propagate_version = true
)]
struct Arguments {
    #[command(flatten)]
    console: Console,
    #[command(subcommand)]
    command: Subcommands,
}

/// Runs the command with its `arguments`, the first being the program's name. Exit status: 0 done, 2 bad
/// usage or bad input, 1 anything else; a failure is one line on standard error.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let outcome = match Arguments::try_parse_from(arguments) {
        Ok(Arguments { console, command }) => command.run(&console),
        Err(error) => match error.kind() {
            ErrorKind::DisplayHelp
            | ErrorKind::DisplayVersion
            | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
                // Help that nobody reads is no failure.
                let _ = error.print();
                return ExitCode::from(error.exit_code() as u8);
            }
            _ => Err(Error::Usage(usage_line(&error))),
        },
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is_broken_pipe() => ExitCode::SUCCESS,
        Err(error) => {
            let line = printable(&error.to_string().replace(char::is_control, " "));
            // With standard error closed, the exit status is all that is left to say it.
            let _ = writeln!(io::stderr(), "error: {line}");
            ExitCode::from(error.exit_status())
        }
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
const CAMPAIGN_FILES: [&str; 5] = [
    "campaign.toml",
    "static.csv",
    "positions.csv",
    "vibration.csv",
    RECORD,
];

/// A folder that holds a campaign is not written into; `hint` tells what else can be done than to name another.
fn refuse_campaign(folder: &Path, hint: &str) -> Result<(), Error> {
    let mut names = CAMPAIGN_FILES.iter();
    match names.find(|name| folder.join(name).exists()) {
        Some(name) => Err(Error::Usage(format!(
            "{}: holds {name} of a campaign already; name another folder{hint}",
            folder.display()
        ))),
        None => Ok(()),
    }
}

/// A finite number greater than zero.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("is not a finite number greater than zero".into()),
    }
}

/// The first paragraph of clap's message as one line.
fn usage_line(error: &clap::Error) -> String {
    let message = error.render().to_string();
    let paragraph = message.lines().take_while(|line| !line.trim().is_empty());
    let line = paragraph.map(str::trim).collect::<Vec<_>>().join(" ");
    format!("{}; see `vre --help`", line.trim_start_matches("error: "))
}
