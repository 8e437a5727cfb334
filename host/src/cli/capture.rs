//! `vre capture`

use std::net::SocketAddr;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::operator::Terminal;
use super::plan::Vibration;
use super::{Command, Console, within};
use crate::attended::{self, Connection, Operator, Test};
use crate::bench::board::Board;
use crate::bench::excitation::FRONT_END;
use crate::bench::noise::Seed;
use crate::bench::plan::{Dwell, Static};
use crate::bench::simulate::{Specification, VirtualBench};
use crate::campaign::{CampaignConfig, ranges};
use crate::capture::{self, Captured, Folder, Ledger};
use crate::error::Error;
use crate::interrupt::Interrupt;
use crate::page::Page;
use crate::source::{BAUD, Hand, InstrumentSource, SerialSource, order_of};

/// Measure a campaign with its record: on the virtual bench, or the static test of a real instrument
#[derive(clap::Args)]
#[command(after_help = "Examples:
  vre capture --emulated --runs 0 --out campaigns/emulated
  vre capture --port /dev/ttyACM0 --bench bench.toml --out campaigns/S01000
  vre capture --port /dev/ttyACM0 --resume campaigns/S01000
  vre capture --by-hand --plan best.json --out try
  vre capture --plan remounted --sheet sheet.csv")]
pub struct Capture {
    /// Folder for campaign.toml, static.csv, vibration.csv and record.vre
    #[arg(long, value_name = "DIR", required_unless_present_any = ["resume", "sheet"])]
    out: Option<PathBuf>,
    /// Go on with the capture in DIR that was stopped: what its record has whole is not measured again
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "force", "sheet"])]
    resume: Option<PathBuf>,
    /// Write into a folder that holds a campaign already, over it; a record that is there is kept under another name
    #[arg(long)]
    force: bool,
    /// Run the image for the board in the emulator, instead of the firmware's library on the host
    #[arg(long)]
    emulated: bool,
    /// Run the firmware's library on the host, the default
    #[arg(long = "virtual", conflicts_with_all = ["emulated", "port"])]
    on_host: bool,
    /// Walk through the static test of the virtual instrument by hand and in real time, as with --port
    #[arg(long, conflicts_with_all = ["emulated", "port"])]
    by_hand: bool,
    /// Measure the instrument at this serial port; the dial is turned by hand
    #[arg(long, value_name = "DEV", conflicts_with_all = ["emulated", "runs", "seed", "dial_sigma"])]
    port: Option<PathBuf>,
    /// With --port: speed of the line
    #[arg(long, value_name = "BAUD", default_value_t = BAUD, requires = "port")]
    baud: u32,
    /// With --port: instrument and bench, in the format of campaign.toml; with --resume that of the folder
    #[arg(
        long,
        value_name = "FILE",
        requires = "port",
        conflicts_with = "resume"
    )]
    bench: Option<PathBuf>,
    /// By hand: length of a reading, s [default: 10; with --resume that of the readings that are there]
    #[arg(long, value_name = "S", value_parser = within(&ranges::DURATION))]
    dwell: Option<f64>,
    /// By hand: how long the output has to be steady before a reading, s
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = within(&ranges::DURATION))]
    settle: f64,
    /// By hand: temperature of the instrument, deg C; that of the bench's reference if not given
    #[arg(long, value_name = "C", value_parser = within(&ranges::TEMPERATURE), allow_negative_numbers = true)]
    temp_c: Option<f64>,
    /// By hand: the vibration along IA whose error the test is for, `sine:` peak or `random:` rms in g
    #[arg(long, value_name = "KIND:LEVEL", default_value = "random:1")]
    vibration: Vibration,
    /// By hand: tell when the standard uncertainty of that error is this share of it
    #[arg(long, value_name = "SHARE", value_parser = within(&ranges::ENOUGH))]
    enough: Option<f64>,
    /// By hand: from a page in a browser, instead of here
    #[arg(long)]
    page: bool,
    /// With --page: serve it at ADDRESS:PORT; port 0 is any that is free
    #[arg(
        long,
        value_name = "ADDRESS:PORT",
        default_value = "127.0.0.1:0",
        requires = "page"
    )]
    listen: SocketAddr,
    /// Fixes everything that is random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The static test: `default`, `paper`, `remounted`, a CSV file with the columns series, dial_deg and, optional, mount_deg
    /// and approach, or what `vre plan --best N --json FILE` wrote
    #[arg(long, value_name = "PLAN", default_value = "remounted")]
    plan: String,
    /// Write the plan as a run sheet to fill in by hand, CSV, and measure nothing
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// Standard uncertainty of a dial mark and of the base's level, arcsec
    #[arg(long, value_name = "ARCSEC", default_value_t = 5.8, value_parser = within(&ranges::ARCSEC_SIGMA))]
    dial_sigma: f64,
    /// Shaker runs at the most
    #[arg(long, default_value_t = 4)]
    runs: usize,
}

impl Command for Capture {
    fn run(self, console: &Console) -> Result<(), Error> {
        if let Some(sheet) = &self.sheet {
            let dwells = capture::plan_of(&self.plan)?;
            capture::write_sheet(sheet, &dwells)?;
            return console.print(format!("{}: {} positions", sheet.display(), dwells.len()));
        }
        match (&self.port, self.by_hand || self.page) {
            (Some(port), _) => {
                let (port, baud) = (port.clone(), self.baud);
                self.attended(&mut Serial { port, baud }, console)
            }
            (None, true) => {
                let plan = self.dwells()?;
                self.attended(&mut Virtual::new(&self, plan), console)
            }
            (None, false) => self.of_bench(console),
        }
    }
}

impl Capture {
    /// The folder, and what its record tells already.
    fn folder(&self) -> Result<(Folder, Ledger), Error> {
        match (&self.resume, &self.out) {
            (Some(folder), _) => Folder::reopen(folder),
            (None, Some(out)) => Ok((Folder::claim(out, self.force)?, Ledger::default())),
            (None, None) => Err(Error::Usage("--out DIR is missing".into())),
        }
    }

    fn virtual_bench(&self, dwells: Vec<Dwell>) -> VirtualBench {
        virtual_bench(self.seed, self.dial_sigma, self.runs, dwells)
    }

    /// Everything at once, on the virtual bench.
    fn of_bench(&self, console: &Console) -> Result<(), Error> {
        let interrupt = Interrupt::catch()?;
        let bench = self.virtual_bench(self.dwells()?);
        let (folder, ledger) = self.folder()?;
        of_this_instrument(&folder, &ledger, &bench)?;
        let bar = console.progress(capture::steps(&bench), "measuring");
        let mut step = || {
            bar.inc(1);
            match interrupt.came() {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        };
        let mut measure = |board: &mut dyn Board| {
            capture::capture_until(&bench, board, &folder, ledger.clone(), &mut step)
        };
        let captured = match self.emulated {
            true => emulated(&mut measure)?,
            false => measure(&mut capture::virtual_board(&bench))?,
        };
        bar.finish_and_clear();
        let Captured {
            campaign,
            tally,
            complete,
        } = &captured;
        let at = folder.path().display();
        if !complete {
            return Err(stopped(&folder, campaign.readings.len()));
        }
        console.print(format!(
            "{at}: {} readings, {} shaker runs; {} samples in blocks, {} missing",
            campaign.readings.len(),
            campaign.runs.len(),
            tally.blocks.received,
            tally.blocks.missing,
        ))?;
        console.json(tally)
    }

    /// The plan of this capture, or that of the capture that goes on.
    fn dwells(&self) -> Result<Vec<Dwell>, Error> {
        let kept = self
            .resume
            .as_ref()
            .map(|folder| folder.join(capture::PLAN));
        match kept.filter(|kept| kept.exists()) {
            Some(kept) => capture::read_plan(&kept),
            None => capture::plan_of(&self.plan),
        }
    }

    /// A person turns the dial.
    fn attended<C: Connection>(&self, connection: &mut C, console: &Console) -> Result<(), Error> {
        let dwells = self.dwells()?;
        let stated = match (&self.bench, &self.port, &self.resume) {
            (Some(bench), _, _) => Some(CampaignConfig::read(bench)?),
            (None, Some(_), None) => {
                let line = "--port needs --bench FILE: instrument and bench, as in campaign.toml";
                return Err(Error::Usage(line.into()));
            }
            _ => None,
        };
        let interrupt = Interrupt::catch()?;
        let (folder, ledger) = self.folder()?;
        let config = match (stated, &self.resume) {
            (Some(config), _) => config,
            (None, Some(_)) => folder.config(&ledger)?,
            (None, None) => {
                let mut config = self.virtual_bench(dwells.clone()).config();
                config.acquisition = config.acquisition.with_front_end(FRONT_END);
                config
            }
        };
        console.print(front_end(&config, self.bench.as_deref()))?;
        let test = self.test(config, dwells, &ledger)?;
        let measure = |person: &mut dyn Operator| {
            attended::measure(connection, &test, &folder, ledger, person, Some(&interrupt))
        };
        let found = match self.page {
            false => measure(&mut Terminal::new(console)),
            true => {
                let at = folder.path().display().to_string();
                let mut page = Page::serve(self.listen, &at, false)?;
                console.print(format!("the page is at {}", page.url()))?;
                let found = measure(&mut page);
                page.close();
                found
            }
        };
        let found = found.inspect_err(|_| self.tell_resume(&folder, console))?;
        let readings = found.campaign.map_or(0, |campaign| campaign.readings.len());
        let (tally, missing) = (&found.tally, found.missing);
        if interrupt.came() {
            return Err(stopped(&folder, readings));
        }
        console.print(format!(
            "{}: {readings} readings, {missing} positions left out; {} samples in blocks, {} missing with {} frames lost on the line",
            folder.path().display(),
            tally.blocks.received,
            tally.blocks.missing,
            tally.missing_frames,
        ))?;
        console.json(tally)
    }

    fn test(
        &self,
        config: CampaignConfig,
        dwells: Vec<Dwell>,
        ledger: &Ledger,
    ) -> Result<Test, Error> {
        let duration = |option: &str, seconds: f64| {
            Duration::try_from_secs_f64(seconds)
                .map_err(|_| Error::Usage(format!("{option} {seconds}: is too long")))
        };
        let temp_c = self.temp_c.unwrap_or(config.bench.reference_temp_c);
        if !temp_c.is_finite() {
            return Err(Error::Usage(format!("--temp-c {temp_c}: is not finite")));
        }
        let dwell_s = self.dwell.or_else(|| last_dwell_s(ledger)).unwrap_or(10.0);
        Ok(Test {
            config,
            dwells,
            settle: duration("--settle", self.settle)?,
            dwell: duration("--dwell", dwell_s)?,
            temp_c,
            environment: self.vibration.environment(&[1.0, 0.0, 0.0], 0.0),
            enough: self.enough,
        })
    }

    /// Where an interrupted capture goes on; the error that follows is more important than a closed standard output.
    fn tell_resume(&self, folder: &Folder, console: &Console) {
        let at = folder.path().display();
        let _ = console.print(format!(
            "what was measured is in {at}; go on with --resume {at}"
        ));
    }
}

/// The length of the last reading that was begun, s.
fn last_dwell_s(ledger: &Ledger) -> Option<f64> {
    let identity = ledger.reduction().identity()?;
    let block_s = f64::from(identity.block_samples) / identity.sample_rate_hz;
    let last = ledger.last_reading()?;
    Some(f64::from(last.blocks) * block_s)
}

fn stopped(folder: &Folder, readings: usize) -> Error {
    let at = folder.path().display();
    Error::Stopped(format!(
        "stopped: {readings} readings are in {at}; go on with --resume {at}"
    ))
}

fn virtual_bench(seed: u64, dial_sigma: f64, runs: usize, dwells: Vec<Dwell>) -> VirtualBench {
    let specification = Specification::with_dial_sigma(dial_sigma);
    let mut bench = VirtualBench::new(Seed(seed), Static::default(), specification, Vec::new());
    bench.plan.dwells = dwells;
    bench.plan.runs.truncate(runs);
    bench
}

/// A capture of the virtual bench goes on with the same instrument alone.
fn of_this_instrument(folder: &Folder, ledger: &Ledger, bench: &VirtualBench) -> Result<(), Error> {
    if ledger.head().is_none() {
        return Ok(());
    }
    let serial = folder.config(ledger)?.instrument.serial;
    match serial == bench.serial() {
        true => Ok(()),
        false => Err(Error::Usage(format!(
            "{}: is a capture of instrument {serial}; --seed {} is instrument {}",
            folder.path().display(),
            bench.seed.0,
            bench.serial()
        ))),
    }
}

/// One line on what lies between instrument and converter, and where that is stated.
fn front_end(config: &CampaignConfig, file: Option<&Path>) -> String {
    let acquisition = &config.acquisition;
    let stated = if acquisition.states_front_end() {
        "as stated in"
    } else {
        "no divider or gain is stated in"
    };
    let front_end = acquisition.front_end();
    let file = file.unwrap_or(Path::new("campaign.toml"));
    format!("front end: {front_end} ({stated} {})", file.display())
}

/// An instrument at a serial port.
struct Serial {
    port: PathBuf,
    baud: u32,
}

impl Connection for Serial {
    type Source = SerialSource;

    fn connect(&mut self) -> Result<SerialSource, Error> {
        SerialSource::open(&self.port, self.baud)
    }
}

/// The virtual instrument.
struct Virtual {
    seed: u64,
    dial_sigma: f64,
    plan: Vec<Dwell>,
    hand: Hand,
}

impl Virtual {
    fn new(command: &Capture, plan: Vec<Dwell>) -> Self {
        Self {
            seed: command.seed,
            dial_sigma: command.dial_sigma,
            plan,
            hand: Hand::default(),
        }
    }
}

impl Connection for Virtual {
    type Source = InstrumentSource;

    fn connect(&mut self) -> Result<InstrumentSource, Error> {
        let (seed, dial_sigma, plan) = (self.seed, self.dial_sigma, self.plan.clone());
        let bench = move || virtual_bench(seed, dial_sigma, 0, plan);
        Ok(InstrumentSource::start(
            bench,
            capture::virtual_board,
            &self.hand,
        ))
    }

    fn turn(&mut self, to: &Dwell) {
        if let Some(order) = order_of(&self.plan, to) {
            self.hand.turn(order);
        }
    }
}

#[cfg(feature = "emulated")]
fn emulated(
    measure: &mut dyn FnMut(&mut dyn Board) -> Result<Captured, Error>,
) -> Result<Captured, Error> {
    let mut board = crate::bench::emulated::EmulatedBoard::start().map_err(Error::Usage)?;
    measure(&mut board)
}

#[cfg(not(feature = "emulated"))]
fn emulated(
    _: &mut dyn FnMut(&mut dyn Board) -> Result<Captured, Error>,
) -> Result<Captured, Error> {
    let line =
        "--emulated: this vre was built without the emulator; build it with --features emulated";
    Err(Error::Usage(line.into()))
}
