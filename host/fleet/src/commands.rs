//! The command line of `vre-fleet`, each command a thin layer over the library.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use clap::error::ErrorKind;
use columns::rows::fixture_of;
use host::bench::noise::Seed;
use host::bench::plant::Plant;
use host::campaign::ranges;
use host::error::{Error, printable};
use host::output::{write_file, write_json};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::dataset::{self, Entry};
use crate::engine::{self, failure};
use crate::head_of::{self, head_of};
use crate::results::Sink;
use crate::rowwise;
use crate::sides::{self, Detection, Finding, attribute};

/// The campaigns of many instruments as one data set: asked in SQL, calibrating the heads they were tested on
#[derive(Parser)]
#[command(name = "vre-fleet", version, arg_required_else_help = true)]
enum Command {
    /// Take campaign folders, or folders of folders, into a data set
    #[command(after_help = "Example:\n  vre-fleet gather campaigns/ --out plant")]
    Gather {
        /// Campaign folders, or folders that hold some up to two levels below
        #[arg(required = true)]
        folders: Vec<PathBuf>,
        /// Data set, made if need be; a campaign of the same serial number and time is replaced
        #[arg(long, value_name = "DATASET")]
        out: PathBuf,
    },
    /// Write the campaigns of a data set as folders again
    Scatter {
        /// Data set
        dataset: PathBuf,
        /// Folder for BENCH/SERIAL
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Ask a data set in SQL: table campaigns(serial, time, campaign, bench, month); functions vre_identify(campaign),
    /// vre_predict(campaign, 'random:1'), vre_diagnose(campaign), aggregate vre_bench(campaign)
    #[command(
        after_help = "Example:\n  vre-fleet query plant \"SELECT serial, vre_identify(campaign)['coefficients']['k2_per_g']['value'] AS k2 FROM campaigns ORDER BY k2\""
    )]
    Query {
        /// Data set
        dataset: PathBuf,
        /// The query
        sql: String,
        /// Result, by its ending .csv, .json or .parquet (a folder of parts, which goes on where it was); the terminal without
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Show how the query would be carried out, and do not
        #[arg(long)]
        explain: bool,
    },
    /// Calibrate the dividing head of a bench by all instruments that were tested on it
    #[command(
        after_help = "Example:\n  vre-fleet bench plant --head H1 --out head.toml\n  vre identify campaigns/S01000 --head head.toml"
    )]
    Bench {
        /// Data set
        dataset: PathBuf,
        /// The bench, as campaigns name it in `station` of [record]
        #[arg(long, value_name = "ID")]
        head: String,
        /// What is known of the head, for vre identify, predict and diagnose
        #[arg(long, value_name = "FILE", default_value = "head.toml")]
        out: PathBuf,
        /// The report for programs
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
    },
    /// Diagnose all campaigns, and tell whether each effect found is the instrument's, the bench's, the fixture's or the day's
    Sides {
        /// Data set
        dataset: PathBuf,
        /// The answer for programs
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
    },
    /// Write a data set of simulated instruments of one type on one head
    Simulate {
        /// Data set
        #[arg(long, value_name = "DATASET")]
        out: PathBuf,
        /// Number of instruments
        #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
        instruments: u64,
        /// Fixes everything that is random
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Standard uncertainty of a mark and of the level, arcsec
        #[arg(long, value_name = "ARCSEC", default_value_t = 5.8, value_parser = |text: &str| ranges::ARCSEC_SIGMA.parse(text))]
        dial_sigma: f64,
        /// Mount all instruments alike; else every other one is turned by 180 deg
        #[arg(long)]
        alike: bool,
        /// Shake them too
        #[arg(long)]
        shaken: bool,
        /// Re-zero the head before the instrument of this number, counted from 0
        #[arg(long, value_name = "N")]
        rezero: Option<u64>,
        /// Name of the head
        #[arg(long, default_value = "H1")]
        station: String,
    },
}

/// Runs the command with its arguments, the first being the program's name. Exit status as that of `vre`.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let outcome = match Command::try_parse_from(arguments) {
        Ok(command) => command.run(),
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::DisplayHelp
                    | ErrorKind::DisplayVersion
                    | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
            ) =>
        {
            let _ = error.print();
            return ExitCode::from(error.exit_code() as u8);
        }
        Err(error) => {
            let message = error.render().to_string();
            let line = message
                .lines()
                .take_while(|line| !line.trim().is_empty())
                .map(str::trim);
            let line = line.collect::<Vec<_>>().join(" ");
            Err(Error::Usage(format!(
                "{}; see `vre-fleet --help`",
                line.trim_start_matches("error: ")
            )))
        }
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is_broken_pipe() => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", printable(&error.to_string()));
            ExitCode::from(error.exit_status())
        }
    }
}

impl Command {
    fn run(self) -> Result<(), Error> {
        match self {
            Self::Gather { folders, out } => gather(&folders, &out),
            Self::Scatter { dataset, out } => {
                let bar = spinner();
                let count = dataset::scatter(&dataset, &out, |more| bar.inc(more))?;
                bar.finish_and_clear();
                print(&format!("{}: {count} campaigns\n", out.display()))
            }
            Self::Query {
                dataset,
                sql,
                out,
                explain,
            } => {
                let runtime = tokio::runtime::Builder::new_multi_thread()
                    .enable_all()
                    .build();
                let runtime = runtime.map_err(Error::read(&dataset))?;
                runtime.block_on(query(&dataset, &sql, out.as_deref(), explain))
            }
            Self::Bench {
                dataset,
                head,
                out,
                json,
            } => {
                let bar = spinner();
                let report = head_of(&dataset, &head, |doing| bar.set_message(doing))?;
                bar.finish_and_clear();
                report.head.write(&out)?;
                if let Some(file) = json {
                    write_json(&file, &report)?;
                }
                print(&format!(
                    "{}\n{}: for vre identify, predict and diagnose --head\n",
                    head_of::text(&report),
                    out.display()
                ))
            }
            Self::Sides { dataset, json } => attribute_all(&dataset, json.as_deref()),
            Self::Simulate {
                out,
                instruments,
                seed,
                dial_sigma,
                alike,
                shaken,
                rezero,
                station,
            } => {
                if !(dial_sigma.is_finite() && dial_sigma > 0.0) {
                    return Err(Error::Usage("--dial-sigma is not greater than 0".into()));
                }
                let plant = Plant {
                    alternate: !alike,
                    shaken,
                    rezeroed_before: rezero,
                    station,
                    ..Plant::new(Seed(seed), dial_sigma)
                };
                simulate(&plant, instruments, &out)
            }
        }
    }
}

fn print(text: &str) -> Result<(), Error> {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes())
        .and_then(|()| out.flush())
        .map_err(Error::write(Path::new("standard output")))
}

fn spinner() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {human_pos} {msg} ({elapsed})") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

fn bar(steps: u64) -> ProgressBar {
    let bar = ProgressBar::new(steps);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {human_pos} of {human_len} ({eta})")
    {
        bar.set_style(style);
    }
    bar
}

fn gather(folders: &[PathBuf], out: &Path) -> Result<(), Error> {
    let folders = dataset::campaign_folders(folders)?;
    let progress = bar(folders.len() as u64);
    let gathered = dataset::gather(&folders, out, |more| progress.inc(more))?;
    progress.finish_and_clear();
    for (_, line) in &gathered.refused {
        eprintln!("not taken: {}", printable(line));
    }
    let (added, replaced, refused) = (gathered.added, gathered.replaced, gathered.refused.len());
    if added + replaced == 0 {
        return Err(Error::Usage(format!(
            "none of {refused} folders holds a campaign that can be read"
        )));
    }
    print(&format!(
        "{}: {added} campaigns added, {replaced} replaced, {refused} folders not taken\n",
        out.display()
    ))
}

fn simulate(plant: &Plant, instruments: u64, out: &Path) -> Result<(), Error> {
    const AT_ONCE: u64 = 1024;
    let progress = bar(instruments);
    let mut first = 0;
    while first < instruments {
        let made: Vec<_> = (first..instruments.min(first + AT_ONCE))
            .into_par_iter()
            .map(|number| {
                progress.inc(1);
                plant.campaign(number)
            })
            .collect();
        dataset::add(out, made.iter().map(|made| &made.campaign))?;
        first += AT_ONCE;
    }
    progress.finish_and_clear();
    print(&format!("{}: {instruments} campaigns\n", out.display()))
}

async fn query(dataset: &Path, sql: &str, out: Option<&Path>, explain: bool) -> Result<(), Error> {
    let context = engine::session(dataset).await?;
    let frame = context.sql(sql).await.map_err(|error| failure(&error))?;
    if explain {
        let batches = frame
            .explain(false, false)
            .map_err(|error| failure(&error))?
            .collect()
            .await;
        let batches = batches.map_err(|error| failure(&error))?;
        let table = datafusion::arrow::util::pretty::pretty_format_batches(&batches);
        return print(&format!(
            "{}\n",
            table.map_err(|error| Error::Usage(error.to_string()))?
        ));
    }
    let bar = spinner();
    if let Some(out) = out.filter(|out| out.extension().is_some_and(|ending| ending == "parquet")) {
        rowwise::write_parts(&context, dataset, sql, out, |text| bar.set_message(text)).await?;
        bar.finish_and_clear();
        return print(&format!("{}\n", out.display()));
    }
    let mut sink = Sink::open(out)?;
    engine::each_batch(frame, |batch| {
        bar.inc(batch.num_rows() as u64);
        sink.take(batch)
    })
    .await?;
    bar.finish_and_clear();
    match sink.end()? {
        Some(table) => print(&format!("{table}\n")),
        None => Ok(()),
    }
}

/// What of a diagnosis an attribution needs.
#[derive(Deserialize, Default)]
struct Found {
    #[serde(default)]
    which: Vec<Which>,
}

#[derive(Deserialize)]
struct Which {
    effects: Vec<String>,
    parameters: Vec<Parameter>,
}

#[derive(Deserialize)]
struct Parameter {
    effect: String,
    value: f64,
    sigma: f64,
}

#[derive(Serialize)]
struct Attributions {
    format: &'static str,
    effects: Vec<sides::Attribution>,
    not_diagnosed: Vec<String>,
}

fn attribute_all(dataset: &Path, json: Option<&Path>) -> Result<(), Error> {
    let bar = spinner();
    let mut diagnosed: Vec<([Option<String>; 4], Found)> = Vec::new();
    let mut not_diagnosed = Vec::new();
    for (_, file) in dataset::files(dataset)? {
        for batch in dataset::batches(&file)? {
            let entries = dataset::read(&batch?, &file)?;
            let answers: Vec<_> = entries
                .into_par_iter()
                .map(|entry| {
                    let answer = diagnose(entry);
                    bar.inc(1);
                    answer
                })
                .collect();
            for answer in answers {
                match answer {
                    Ok(answer) => diagnosed.push(answer),
                    Err(line) => not_diagnosed.push(line),
                }
            }
        }
    }
    bar.finish_and_clear();
    let names = diagnosed
        .iter()
        .flat_map(|(_, found)| found.which.first())
        .flat_map(|which| &which.effects);
    let effects = sides::effects(names).into_iter().map(|effect| {
        let findings: Vec<Finding> = diagnosed
            .iter()
            .map(|(shared, found)| finding(&effect, shared, found))
            .collect();
        attribute(&effect, &findings, Detection::default())
    });
    let answer = Attributions {
        format: "vre-sides/1",
        effects: effects.collect(),
        not_diagnosed,
    };
    if let Some(file) = json {
        write_json(file, &answer)?;
    }
    let mut text = sides::text(&answer.effects);
    for line in &answer.not_diagnosed {
        text += &format!("not diagnosed: {line}\n");
    }
    print(&text)
}

fn diagnose(entry: Entry) -> Result<([Option<String>; 4], Found), String> {
    let Entry {
        serial,
        time,
        campaign,
    } = entry;
    let told = || {
        let campaign = campaign.campaign()?.used();
        let answer = columns::functions::diagnosed(&campaign)?;
        let found = serde_json::from_value(answer);
        let found: Found = found.map_err(|error| Error::Usage(error.to_string()))?;
        Ok::<_, Error>((campaign, found))
    };
    let (campaign, found) = told().map_err(|problem| format!("{serial} {time}: {problem}"))?;
    let station = campaign
        .config
        .record
        .as_ref()
        .and_then(|record| record.station.clone());
    let day = time.get(..10).map(str::to_owned);
    Ok(([Some(serial), station, fixture_of(&campaign), day], found))
}

fn finding(effect: &str, shared: &[Option<String>; 4], found: &Found) -> Finding {
    let best = found
        .which
        .first()
        .filter(|which| which.effects.iter().any(|id| id == effect));
    let values = best.map(|which| {
        let own = which
            .parameters
            .iter()
            .filter(|parameter| parameter.effect == effect);
        own.map(|parameter| (parameter.value, parameter.sigma))
            .collect()
    });
    Finding {
        shared: shared.clone(),
        values,
    }
}

/// Writes a note beside parts of a result, whole or not at all.
pub(crate) fn note(file: &Path, text: &str) -> Result<(), Error> {
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).map_err(Error::write(folder))?;
    }
    write_file(file, text.as_bytes())
}
