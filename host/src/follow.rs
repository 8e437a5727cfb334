//! A record that is followed while it grows, or read to its end: the same view as of the walk that writes it.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use shared::wire::message::{Block, Event};

use crate::bench::plan::Dwell;
use crate::campaign::{Campaign, CampaignConfig};
use crate::capture::{self, Ledger, LedgerError, PLAN, RECORD, Standing};
use crate::error::Error;
use crate::record::{Item, Reader};
use crate::statics::Environment;
use crate::walk::{Counts, Settings, View, Walk};

/// Bytes read at once.
const CHUNK: usize = 1 << 16;

/// What the follower knows of a record by now.
#[derive(Debug)]
pub struct Follower {
    path: PathBuf,
    file: File,
    environment: Environment,
    reader: Reader,
    ledger: Ledger,
    walk: Option<Walk>,
    /// Readings that the walk was made of.
    counted: Vec<u32>,
    now_s: f64,
    faults: u64,
    last_fault: Option<String>,
}

impl Follower {
    /// Of a record, or of the record in a folder; `environment` is the vibration whose error is shown.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn open(path: &Path, environment: Environment) -> Result<Self, Error> {
        let path = match path.is_dir() {
            true => path.join(RECORD),
            false => path.to_owned(),
        };
        let file = File::open(&path).map_err(Error::read(&path))?;
        Ok(Self {
            path,
            file,
            environment,
            reader: Reader::new(),
            ledger: Ledger::default(),
            walk: None,
            counted: Vec::new(),
            now_s: 0.0,
            faults: 0,
            last_fault: None,
        })
    }

    /// Where the campaign is.
    pub fn folder(&self) -> &Path {
        match self.path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        }
    }

    /// Takes what has come since, and shows what the record tells; nothing while it does not say what the campaign is.
    ///
    /// # Errors
    /// A record of two instruments, or that cannot be read; a campaign that cannot be.
    pub fn look(&mut self) -> Result<Option<View>, Error> {
        let blocks = self.read_on()?;
        self.renew_walk()?;
        let Some(identity) = self.ledger.reduction().identity() else {
            return Ok(None);
        };
        let rate_hz = identity.sample_rate_hz;
        let Some(walk) = &mut self.walk else {
            return Ok(None);
        };
        for block in &blocks {
            self.now_s = block.first_sample as f64 / rate_hz;
            walk.block(block, self.now_s);
        }
        // Orders are for whoever measures.
        let _ = walk.orders();
        if let Some(taken) = self
            .ledger
            .last_reading()
            .filter(|t| t.standing == Standing::Begun)
        {
            let sums = self.ledger.reduction().reading(taken.number);
            let blocks = sums.map_or(0, |sums| sums.blocks() as u32);
            walk.follow(taken.number, &taken.dwell, blocks);
        }
        let counts = Counts::of(self.reader.tally(), self.faults, self.last_fault.clone());
        Ok(Some(walk.view(self.now_s, counts)))
    }

    fn read_on(&mut self) -> Result<Vec<Block>, Error> {
        let Self {
            path,
            file,
            reader,
            ledger,
            faults,
            last_fault,
            ..
        } = self;
        let mut chunk = vec![0; CHUNK];
        let mut blocks = Vec::new();
        loop {
            let length = file.read(&mut chunk).map_err(Error::read(path))?;
            if length == 0 {
                // What is drawn is the last half minute.
                blocks.drain(..blocks.len().saturating_sub(KEPT_BLOCKS));
                return Ok(blocks);
            }
            let fed = reader.feed_items(&mut chunk[..length], &mut |item, _| {
                match &item {
                    Item::Event(Event::Block(block)) => blocks.push(*block),
                    Item::Event(Event::Fault { fault, .. }) => {
                        *faults += 1;
                        *last_fault = Some(format!("{fault:?}"));
                    }
                    _ => {}
                }
                ledger.absorb(&item).map_err(LedgerError::from)
            });
            fed.map_err(|error| error.in_file(path))?;
            blocks.drain(..blocks.len().saturating_sub(2 * KEPT_BLOCKS));
        }
    }

    /// A walk of the readings that count, made anew when these are others.
    fn renew_walk(&mut self) -> Result<(), Error> {
        let counted: Vec<u32> = self.ledger.readings().map(|taken| taken.number).collect();
        if self.walk.is_some() && counted == self.counted {
            return Ok(());
        }
        let Some(identity) = self.ledger.reduction().identity() else {
            return Ok(());
        };
        let Some(config) = self.config()? else {
            return Ok(());
        };
        let at_converter = identity.reference_v / f64::from(identity.gains[0]) / f64::from(1 << 23);
        let block_s = f64::from(identity.block_samples) / identity.sample_rate_hz;
        let blocks = self.ledger.last_reading().map_or(1, |taken| taken.blocks);
        let settings = Settings {
            settle_s: 1.0,
            dwell_s: block_s * f64::from(blocks),
            blocks,
            v_per_code: config.acquisition.front_end().output_v(at_converter),
            environment: self.environment.clone(),
            enough: None,
        };
        let temp_c = self.ledger.last_reading().map(|taken| taken.temp_c);
        let temp_c = temp_c.unwrap_or(config.bench.reference_temp_c);
        let plan = self.plan()?;
        let mut walk = Walk::new(config.clone(), settings, &plan, u32::MAX, temp_c);
        if !counted.is_empty() {
            let campaign: Campaign = capture::campaign(config, &self.ledger, &self.path)?;
            walk.take_over(&campaign.readings);
        }
        (self.walk, self.counted) = (Some(walk), counted);
        Ok(())
    }

    /// campaign.toml beside the record, or as the record has it.
    fn config(&self) -> Result<Option<CampaignConfig>, Error> {
        let file = self.folder().join("campaign.toml");
        if file.exists() {
            return CampaignConfig::read(&file).map(Some);
        }
        let Some(head) = self.ledger.head() else {
            return Ok(None);
        };
        let bad = |error: toml::de::Error| Error::input(&self.path, error.message().to_owned());
        toml::from_str(head).map(Some).map_err(bad)
    }

    /// The plan beside the record; without one the positions that were measured.
    fn plan(&self) -> Result<Vec<Dwell>, Error> {
        let file = self.folder().join(PLAN);
        match file.exists() {
            true => capture::read_plan(&file),
            false => Ok(self.ledger.readings().map(|taken| taken.dwell).collect()),
        }
    }
}

/// Blocks of the last half minute: at a hundred a second.
const KEPT_BLOCKS: usize = 3000;
