//! `vre capture`

use std::io::{self, BufRead};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Duration;

use super::{Command, Console, positive, refuse_campaign};
use crate::attended::{self, Operator, Reply, Test};
use crate::bench::noise::Seed;
use crate::bench::plan::{self, Static};
use crate::bench::simulate::{Specification, VirtualBench};
use crate::campaign::CampaignConfig;
use crate::capture::{self, Captured};
use crate::error::Error;
use crate::source::{BAUD, SerialSource};

/// Measure a campaign with its record: on the virtual bench, or the static test of a real instrument
#[derive(clap::Args)]
#[command(after_help = "Examples:
  vre capture --emulated --runs 0 --out campaigns/emulated
  vre capture --port /dev/ttyACM0 --bench bench.toml --out campaigns/S01000")]
pub struct Capture {
    /// Folder for campaign.toml, static.csv, vibration.csv and record.vre
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write into a folder that holds a campaign already, over it; a record that is there is kept under another name
    #[arg(long)]
    force: bool,
    /// Run the image for the board in the emulator, instead of the firmware's library on the host
    #[arg(long)]
    emulated: bool,
    /// Run the firmware's library on the host, the default
    #[arg(long = "virtual", conflicts_with_all = ["emulated", "port"])]
    on_host: bool,
    /// Measure the instrument at this serial port; the dial is turned by hand
    #[arg(long, value_name = "DEV", requires = "bench", conflicts_with_all = ["emulated", "runs", "seed", "dial_sigma"])]
    port: Option<PathBuf>,
    /// With --port: speed of the line
    #[arg(long, value_name = "BAUD", default_value_t = BAUD, requires = "port")]
    baud: u32,
    /// With --port: instrument and bench, in the format of campaign.toml
    #[arg(long, value_name = "FILE", requires = "port")]
    bench: Option<PathBuf>,
    /// With --port: length of a reading, s
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = positive, requires = "port")]
    dwell: f64,
    /// With --port: time for the dial to come to rest, s
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = positive, requires = "port")]
    settle: f64,
    /// With --port: temperature of the instrument, deg C; that of the bench's reference if not given
    #[arg(
        long,
        value_name = "C",
        requires = "port",
        allow_negative_numbers = true
    )]
    temp_c: Option<f64>,
    /// Fixes everything that is random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The static test
    #[arg(long, value_enum, default_value = "remounted")]
    plan: Static,
    /// Standard uncertainty of a dial mark and of the base's level, arcsec
    #[arg(long, value_name = "ARCSEC", default_value_t = 5.8, value_parser = positive)]
    dial_sigma: f64,
    /// Shaker runs at the most
    #[arg(long, default_value_t = 4)]
    runs: usize,
}

impl Command for Capture {
    fn run(self, console: &Console) -> Result<(), Error> {
        if !self.force {
            refuse_campaign(&self.out, ", or say --force")?;
        }
        if let (Some(port), Some(bench)) = (&self.port, &self.bench) {
            return self.attended(port, bench, console);
        }
        let specification = Specification::with_dial_sigma(self.dial_sigma);
        let mut bench = VirtualBench::new(Seed(self.seed), self.plan, specification, Vec::new());
        bench.plan.runs.truncate(self.runs);
        let bar = console.progress(capture::steps(&bench), "measuring");
        let captured = if self.emulated {
            emulated(&bench, &self.out, || bar.inc(1))?
        } else {
            capture::capture_virtual(&bench, &self.out, || bar.inc(1))?
        };
        bar.finish_and_clear();
        let (tally, campaign) = (&captured.tally, &captured.campaign);
        console.print(format!(
            "{}: {} readings, {} shaker runs; {} samples in blocks, {} missing",
            self.out.display(),
            campaign.readings.len(),
            campaign.runs.len(),
            tally.blocks.received,
            tally.blocks.missing,
        ))?;
        console.json(tally)
    }
}

impl Capture {
    /// A person turns the dial.
    fn attended(&self, port: &Path, bench: &Path, console: &Console) -> Result<(), Error> {
        let config = CampaignConfig::read(bench)?;
        let duration = |option: &str, seconds: f64| {
            Duration::try_from_secs_f64(seconds)
                .map_err(|_| Error::Usage(format!("{option} {seconds}: is too long")))
        };
        console.print(front_end(&config, bench))?;
        let temp_c = self.temp_c.unwrap_or(config.bench.reference_temp_c);
        if !temp_c.is_finite() {
            return Err(Error::Usage(format!("--temp-c {temp_c}: is not finite")));
        }
        let test = Test {
            config,
            dwells: plan::dwells(self.plan),
            settle: duration("--settle", self.settle)?,
            dwell: duration("--dwell", self.dwell)?,
            temp_c,
        };
        let source = SerialSource::open(port, self.baud)?;
        capture::make_way(&self.out)?;
        let mut person = Person::new(console);
        let found = attended::measure(source, &test, &self.out, &mut person)?;
        let readings = found.campaign.map_or(0, |campaign| campaign.readings.len());
        let (tally, missing) = (&found.tally, found.missing);
        console.print(format!(
            "{}: {readings} readings, {missing} positions left out; {} samples in blocks, {} missing with {} frames lost on the line",
            self.out.display(),
            tally.blocks.received,
            tally.blocks.missing,
            tally.missing_frames,
        ))?;
        console.json(tally)
    }
}

/// One line on what lies between instrument and converter, and where that is stated.
fn front_end(config: &CampaignConfig, file: &Path) -> String {
    let acquisition = &config.acquisition;
    let stated = if acquisition.states_front_end() {
        "as stated in"
    } else {
        "no divider or gain is stated in"
    };
    let front_end = acquisition.front_end();
    format!("front end: {front_end} ({stated} {})", file.display())
}

/// The person at the terminal.
struct Person<'c> {
    console: &'c Console,
    lines: Receiver<String>,
}

impl<'c> Person<'c> {
    fn new(console: &'c Console) -> Self {
        let (to, lines) = channel();
        // Waits for the terminal until the program ends.
        thread::spawn(move || {
            for line in io::stdin().lock().lines().map_while(Result::ok) {
                if to.send(line).is_err() {
                    return;
                }
            }
        });
        Self { console, lines }
    }
}

impl Operator for Person<'_> {
    fn tell(&mut self, line: &str) -> Result<(), Error> {
        self.console.print(line)
    }

    fn answer(&mut self) -> Option<Reply> {
        match self.lines.try_recv() {
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Reply::Stop),
            Ok(line) => match line.trim() {
                "" => Some(Reply::Measure),
                "s" => Some(Reply::Skip),
                "q" => Some(Reply::Stop),
                // Not understood: waits for another line.
                _ => None,
            },
        }
    }
}

#[cfg(feature = "emulated")]
fn emulated(
    bench: &VirtualBench,
    out: &std::path::Path,
    step: impl FnMut(),
) -> Result<Captured, Error> {
    let board = crate::bench::emulated::EmulatedBoard::start().map_err(Error::Usage)?;
    capture::capture(bench, &mut { board }, out, step)
}

#[cfg(not(feature = "emulated"))]
fn emulated(_: &VirtualBench, _: &std::path::Path, _: impl FnMut()) -> Result<Captured, Error> {
    let line =
        "--emulated: this vre was built without the emulator; build it with --features emulated";
    Err(Error::Usage(line.into()))
}
