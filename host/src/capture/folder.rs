//! The folder of a capture: whose it is, and how its files come to be.
//!
//! ```text
//! .capture.lock   held while a capture runs, by the operating system: a killed one leaves nothing locked
//! record.vre      written first
//! campaign.toml   written when the record has been begun
//! plan.csv        the positions of an attended test, for going on
//! static.csv, vibration.csv   grow with each reading and run, each time as a whole file
//! ```

use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::ledger::Ledger;
use super::plan::PLAN;
use super::recorder::Recorder;
use super::tables;
use crate::campaign::{Campaign, CampaignConfig};
use crate::error::Error;

/// The record's name in a campaign folder.
pub const RECORD: &str = "record.vre";
/// The name of a campaign's head.
pub(super) const HEAD: &str = "campaign.toml";

const STATIC: &str = "static.csv";
const LOCK: &str = ".capture.lock";
/// Tables of measurements.
const TABLES: [&str; 3] = [STATIC, "positions.csv", "vibration.csv"];

/// A folder that no other capture writes into.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// A new capture begins: what is there makes way.
    new: bool,
    /// Locked until it is dropped.
    _lock: File,
}

impl Folder {
    /// The folder for a new capture. A campaign that is there is refused; with `force` it makes way when the new one
    /// [begins](Self::begin). A capture that never took anything stands in nobody's way.
    ///
    /// # Errors
    /// [`Error::Usage`] for a folder that holds a campaign, or in which a capture is at work; what the file system says.
    pub fn claim(path: &Path, force: bool) -> Result<Self, Error> {
        fs::create_dir_all(path).map_err(Error::write(path))?;
        let folder = Self::lock(path, true)?;
        if !force {
            folder.refuse_campaign()?;
        }
        Ok(folder)
    }

    /// The folder of a capture that is to go on, and what its record tells.
    ///
    /// # Errors
    /// [`Error::Input`] for a folder that is none of a capture; [`Error::Usage`] if a capture is at work in it.
    pub fn reopen(path: &Path) -> Result<(Self, Ledger), Error> {
        if !path.is_dir() {
            return Err(Error::input(path, "is not the folder of a capture"));
        }
        if !path.join(RECORD).exists() {
            return Err(Error::input(path, format!("holds no {RECORD}")));
        }
        let folder = Self::lock(path, false)?;
        let (ledger, _) = Ledger::read(&folder.record())?;
        Ok((folder, ledger))
    }

    fn lock(path: &Path, new: bool) -> Result<Self, Error> {
        let file = path.join(LOCK);
        let lock = File::options()
            .create(true)
            .append(true)
            .open(&file)
            .map_err(Error::write(&file))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let line = format!("{}: a capture is at work in this folder", path.display());
                return Err(Error::Usage(line));
            }
            // A file system without locks: one person at one bench is the rule.
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => {}
            Err(TryLockError::Error(error)) => return Err(Error::write(&file)(error)),
        }
        Ok(Self {
            path: path.into(),
            new,
            _lock: lock,
        })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The record's file.
    pub fn record(&self) -> PathBuf {
        self.path.join(RECORD)
    }

    /// The file of the plan.
    pub fn plan(&self) -> PathBuf {
        self.path.join(PLAN)
    }

    fn refuse_campaign(&self) -> Result<(), Error> {
        let refuse = |what: String| {
            let at = self.path.display();
            let line = format!("{at}: holds {what} already; name another folder, or say --force");
            Err(Error::Usage(line))
        };
        let there = |name: &str| self.path.join(name).exists();
        if let Some(table) = TABLES.iter().find(|name| there(name)) {
            return refuse(format!("{table} of a campaign"));
        }
        let record = self.record();
        if !record.exists() {
            return match there(HEAD) {
                true => refuse(format!("{HEAD} of a campaign")),
                false => Ok(()),
            };
        }
        let (ledger, _) = Ledger::read(&record)?;
        match (ledger.readings().count(), ledger.runs().count()) {
            (0, 0) if ledger.reduction().has_segments() && ledger.began_unix_ms().is_none() => {
                refuse(format!("{RECORD} of a campaign"))
            }
            (0, 0) => Ok(()),
            (readings, runs) => {
                let at = self.path.display();
                let line = format!(
                    "{at}: holds a capture of {readings} readings and {runs} runs; go on with --resume {at}, make its tables \
                     with vre reduce {at}, name another folder, or say --force"
                );
                Err(Error::Usage(line))
            }
        }
    }

    /// The record is kept as `record-1.vre` or the next number that is free, and the tables are removed, since they would pass
    /// for those of the new one.
    fn make_way(&self) -> Result<(), Error> {
        let record = self.record();
        match fs::metadata(&record) {
            Ok(there) if there.len() == 0 => remove(&record)?,
            Ok(_) => {
                let mut names = (1_u32..).map(|n| self.path.join(format!("record-{n}.vre")));
                if let Some(kept) = names.find(|kept| !kept.exists()) {
                    fs::rename(&record, &kept).map_err(Error::write(&kept))?;
                }
            }
            Err(_) => {}
        }
        for name in TABLES.into_iter().chain([HEAD, PLAN]) {
            remove(&self.path.join(name))?;
        }
        Ok(())
    }

    /// Begins the record, or goes on with it, and writes campaign.toml.
    ///
    /// # Errors
    /// What the file system says.
    pub fn begin(&self, config: &CampaignConfig, ledger: Ledger) -> Result<Recorder, Error> {
        if self.new {
            self.make_way()?;
        }
        let mut recorder = Recorder::append(&self.record(), ledger)?;
        recorder.begin(config)?;
        config.write(&self.path.join(HEAD))?;
        Ok(recorder)
    }

    /// Writes the tables anew from what the record tells by now. While nothing counts there is none, and no campaign.
    ///
    /// # Errors
    /// What the file system says; a record without an identity.
    pub fn write_tables(
        &self,
        config: &CampaignConfig,
        ledger: &Ledger,
    ) -> Result<Option<Campaign>, Error> {
        if ledger.is_empty() {
            for table in TABLES {
                remove(&self.path.join(table))?;
            }
            return Ok(None);
        }
        let campaign = tables::campaign(config.clone(), ledger, &self.record())?;
        campaign.write(&self.path)?;
        Ok(Some(campaign))
    }

    /// campaign.toml as it stands in the folder, or as the record has it if the folder has none.
    ///
    /// # Errors
    /// Neither is there, or what is there cannot be.
    pub fn config(&self, ledger: &Ledger) -> Result<CampaignConfig, Error> {
        let file = self.path.join(HEAD);
        if !file.exists() {
            let text = ledger.head().ok_or_else(|| {
                let problem = format!("has no {HEAD}, and {RECORD} does not hold it either");
                Error::input(&self.path, problem)
            })?;
            crate::output::write_file(&file, text.as_bytes())?;
        }
        CampaignConfig::read(&file)
    }
}

/// The campaign that the record in `path` tells, as its tables in the folder. Tables that say something else are written
/// over with `force` alone.
///
/// # Errors
/// A folder without a record, or whose record holds no reading and no run; what the file system says.
pub fn tables_of(path: &Path, force: bool) -> Result<(Campaign, Ledger), Error> {
    let (folder, ledger) = Folder::reopen(path)?;
    let record = folder.record();
    if ledger.is_empty() {
        let problem = match ledger.began_unix_ms() {
            Some(_) => "holds no whole reading and no whole run",
            None => "does not say where the dial stood: it was made before records did",
        };
        return Err(Error::input(&record, problem));
    }
    let config = folder.config(&ledger)?;
    let campaign = tables::campaign(config, &ledger, &record)?;
    if !force {
        for table in TABLES.map(|name| path.join(name)) {
            if table.exists() && !same(&campaign, &table)? {
                let line = format!(
                    "{}: says something else than the record; say --force to write over it",
                    table.display()
                );
                return Err(Error::Usage(line));
            }
        }
    }
    campaign.write(path)?;
    Ok((campaign, ledger))
}

/// Whether the campaign would write this table as it is.
fn same(campaign: &Campaign, table: &Path) -> Result<bool, Error> {
    let scratch = tempfile::tempdir().map_err(Error::write(table))?;
    campaign.write(scratch.path())?;
    let name = table.file_name().unwrap_or_default();
    let fresh = fs::read(scratch.path().join(name)).ok();
    Ok(fresh == Some(fs::read(table).map_err(Error::read(table))?))
}

fn remove(file: &Path) -> Result<(), Error> {
    match fs::remove_file(file) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(Error::write(file)(error)),
        _ => Ok(()),
    }
}
