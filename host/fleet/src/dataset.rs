//! A data set: campaigns as rows of Parquet, `bench=STATION/month=YYYY-MM/campaigns.parquet`. The file of a month is written
//! whole or not at all.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atomic_write_file::AtomicWriteFile;
use columns::cell::Cell;
use columns::rows::CampaignRow;
use columns::{campaign_field, encode};
use datafusion::arrow::array::{Array, ArrayRef, RecordBatch, StringArray, StructArray};
use datafusion::arrow::datatypes::{Schema, SchemaRef};
use datafusion::parquet::arrow::ArrowWriter;
use datafusion::parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use datafusion::parquet::basic::{Compression, ZstdLevel};
use datafusion::parquet::file::properties::WriterProperties;
use host::campaign::{Campaign, is_triad};
use host::error::Error;
use rayon::prelude::*;

/// File of a month.
const FILE: &str = "campaigns.parquet";
/// Rows of a row group and of a batch: some megabytes of readings, so that memory does not grow with a month.
pub const ROWS: usize = 256;
/// Words for a station or a date that no campaign states.
const NONE: &str = "none";

/// One campaign of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Serial number of the instrument.
    pub serial: String,
    /// `date` of `[record]` as text; empty without one.
    pub time: String,
    /// The campaign.
    pub campaign: CampaignRow,
}

impl Entry {
    fn of(campaign: &Campaign) -> Result<Self, String> {
        Ok(Self {
            serial: campaign.config.instrument.serial.clone(),
            time: time_of(campaign),
            campaign: CampaignRow::new(campaign)?,
        })
    }
}

/// Where a campaign stands: bench and month.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Partition {
    /// `station` of `[record]`, letters that no path takes replaced; `none` without one.
    pub bench: String,
    /// The first seven letters of the date, `2026-01`; `none` without a date of that form.
    pub month: String,
}

impl Partition {
    /// Of a campaign.
    pub fn of(campaign: &Campaign) -> Self {
        let record = campaign.config.record.as_ref();
        let station = record
            .and_then(|record| record.station.as_deref())
            .unwrap_or(NONE);
        let safe = |c: char| {
            if c.is_ascii_alphanumeric() || "-_.".contains(c) {
                c
            } else {
                '_'
            }
        };
        let bench: String = station.trim().chars().map(safe).collect();
        let date = time_of(campaign);
        let month = date.get(..7).filter(|month| {
            let mut letters = month.bytes().enumerate();
            letters.all(|(k, c)| {
                if k == 4 {
                    c == b'-'
                } else {
                    c.is_ascii_digit()
                }
            })
        });
        Self {
            bench: if bench.trim_matches('.').is_empty() {
                NONE.into()
            } else {
                bench
            },
            month: month.unwrap_or(NONE).into(),
        }
    }

    /// Its file below a data set.
    pub fn file(&self, dataset: &Path) -> PathBuf {
        let Self { bench, month } = self;
        dataset
            .join(format!("bench={bench}"))
            .join(format!("month={month}"))
            .join(FILE)
    }
}

/// The date of a campaign as text; empty without one.
pub fn time_of(campaign: &Campaign) -> String {
    let record = campaign.config.record.as_ref();
    match record.and_then(|record| record.date.as_ref()) {
        None => String::new(),
        Some(value) => value
            .as_str()
            .map_or_else(|| value.to_string(), str::to_owned),
    }
}

/// The columns of a file; bench and month stand in its path.
pub fn schema() -> SchemaRef {
    Arc::new(Schema::new(vec![
        String::field("serial"),
        String::field("time"),
        campaign_field(),
    ]))
}

/// What a gathering came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Gathered {
    /// Campaigns that are new.
    pub added: usize,
    /// Campaigns that took the place of one of the same serial number and time.
    pub replaced: usize,
    /// Folders that hold no campaign that could be read, with the line that `vre identify` prints.
    pub refused: Vec<(PathBuf, String)>,
}

/// Campaign folders at or below these, two levels deep at the most, in the order of their names.
///
/// # Errors
/// A folder cannot be listed, or none of them holds a campaign.
pub fn campaign_folders(roots: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut found = Vec::new();
    for root in roots {
        let before = found.len();
        look(root, 2, &mut found)?;
        if found.len() == before {
            return Err(Error::input(
                root,
                "holds no campaign: no campaign.toml in it or up to two levels below",
            ));
        }
    }
    Ok(found)
}

fn look(folder: &Path, levels: usize, found: &mut Vec<PathBuf>) -> Result<(), Error> {
    if folder.join("campaign.toml").exists() {
        found.push(folder.into());
        return Ok(());
    }
    let entries = fs::read_dir(folder).map_err(Error::read(folder))?;
    let mut below: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_dir())
        .collect();
    below.sort();
    if levels > 0 {
        below
            .iter()
            .try_for_each(|folder| look(folder, levels - 1, found))?;
    }
    Ok(())
}

fn entry(folder: &Path) -> Result<(Partition, Entry), String> {
    if is_triad(folder) {
        return Err(format!(
            "{}: is a triad, which a data set does not take",
            folder.display()
        ));
    }
    let campaign = Campaign::read(folder).map_err(|error| error.to_string())?;
    Ok((Partition::of(&campaign), Entry::of(&campaign)?))
}

/// Folders that are read before they are written: memory does not grow with their number.
const AT_ONCE: usize = 4096;

/// Takes campaign folders into a data set, which is made if need be. A campaign of the same serial number and time is replaced.
/// `step` is told how many more folders are done.
///
/// # Errors
/// The data set cannot be read or written.
pub fn gather(
    folders: &[PathBuf],
    dataset: &Path,
    step: impl Fn(u64) + Sync,
) -> Result<Gathered, Error> {
    let mut gathered = Gathered::default();
    for part in folders.chunks(AT_ONCE) {
        let read: Vec<_> = part
            .par_iter()
            .map(|folder| {
                let entry = entry(folder);
                step(1);
                (folder, entry)
            })
            .collect();
        let mut months: BTreeMap<Partition, Vec<Entry>> = BTreeMap::new();
        for (folder, entry) in read {
            match entry {
                Ok((partition, entry)) => months.entry(partition).or_default().push(entry),
                Err(line) => gathered.refused.push((folder.clone(), line)),
            }
        }
        for (partition, entries) in months {
            put(&partition.file(dataset), entries, &mut gathered)?;
        }
    }
    Ok(gathered)
}

/// Takes campaigns into a data set, as [`gather`] does.
///
/// # Errors
/// The data set cannot be read or written.
pub fn add<'c>(dataset: &Path, campaigns: impl Iterator<Item = &'c Campaign>) -> Result<(), Error> {
    let mut months: BTreeMap<Partition, Vec<Entry>> = BTreeMap::new();
    for campaign in campaigns {
        let entry = Entry::of(campaign).map_err(Error::Usage)?;
        months
            .entry(Partition::of(campaign))
            .or_default()
            .push(entry);
    }
    let mut gathered = Gathered::default();
    months
        .into_iter()
        .try_for_each(|(partition, entries)| put(&partition.file(dataset), entries, &mut gathered))
}

fn put(file: &Path, new: Vec<Entry>, gathered: &mut Gathered) -> Result<(), Error> {
    let mut entries: BTreeMap<(String, String), Entry> = BTreeMap::new();
    let key = |entry: &Entry| (entry.serial.clone(), entry.time.clone());
    if file.exists() {
        for batch in batches(file)? {
            for entry in read(&batch?, file)? {
                entries.insert(key(&entry), entry);
            }
        }
    }
    for entry in new {
        match entries.insert(key(&entry), entry) {
            Some(_) => gathered.replaced += 1,
            None => gathered.added += 1,
        }
    }
    let mut entries: Vec<Entry> = entries.into_values().collect();
    // In the order of time: a head is a matter of time.
    entries.sort_by(|a, b| (&a.time, &a.serial).cmp(&(&b.time, &b.serial)));
    write(file, &entries)
}

/// Writes a file of campaigns, in one step.
///
/// # Errors
/// What the file system says.
pub fn write(file: &Path, entries: &[Entry]) -> Result<(), Error> {
    let bad = |error: &dyn std::fmt::Display| {
        Error::write(file)(std::io::Error::other(error.to_string()))
    };
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).map_err(Error::write(folder))?;
    }
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_max_row_group_row_count(Some(ROWS))
        .build();
    let mut new = AtomicWriteFile::open(file).map_err(Error::write(file))?;
    let mut writer =
        ArrowWriter::try_new(&mut new, schema(), Some(properties)).map_err(|e| bad(&e))?;
    for part in entries.chunks(ROWS) {
        let batch = batch(part).map_err(|error| bad(&error))?;
        writer.write(&batch).map_err(|error| bad(&error))?;
    }
    writer.close().map_err(|error| bad(&error))?;
    new.flush()
        .and_then(|()| new.commit())
        .map_err(Error::write(file))
}

fn batch(entries: &[Entry]) -> datafusion::arrow::error::Result<RecordBatch> {
    let text = |of: fn(&Entry) -> &str| {
        Arc::new(StringArray::from_iter_values(entries.iter().map(of))) as ArrayRef
    };
    let rows: Vec<CampaignRow> = entries.iter().map(|entry| entry.campaign.clone()).collect();
    let columns = vec![
        text(|entry| &entry.serial),
        text(|entry| &entry.time),
        encode(&rows)?,
    ];
    RecordBatch::try_new(schema(), columns)
}

/// The batches of a file of campaigns.
///
/// # Errors
/// It cannot be opened, or is no Parquet.
pub fn batches(
    file: &Path,
) -> Result<impl Iterator<Item = Result<RecordBatch, Error>> + use<>, Error> {
    let opened = File::open(file).map_err(Error::read(file))?;
    let builder = ParquetRecordBatchReaderBuilder::try_new(opened)
        .and_then(|b| b.with_batch_size(ROWS).build());
    let file = file.to_owned();
    let bad = move |error: String| Error::input(&file, error);
    let reader = builder.map_err(|error| bad(error.to_string()))?;
    Ok(reader.map(move |batch| batch.map_err(|error| bad(error.to_string()))))
}

/// The entries of a batch.
///
/// # Errors
/// A column is missing or of another type.
pub fn read(batch: &RecordBatch, file: &Path) -> Result<Vec<Entry>, Error> {
    let columns = StructArray::from(batch.clone());
    let column = |row: usize| {
        Ok::<_, String>(Entry {
            serial: columns::cell::read_column(&columns, "serial", row)?,
            time: columns::cell::read_column(&columns, "time", row)?,
            campaign: columns::cell::read_column(&columns, "campaign", row)?,
        })
    };
    (0..columns.len())
        .map(|row| column(row).map_err(|problem| Error::input(file, problem)))
        .collect()
}

/// The files of a data set with their partitions, in order.
///
/// # Errors
/// It is no data set, or cannot be listed.
pub fn files(dataset: &Path) -> Result<Vec<(Partition, PathBuf)>, Error> {
    let part = |path: &Path, key: &str| {
        let name = path.file_name()?.to_str()?;
        name.strip_prefix(key)?.strip_prefix('=').map(str::to_owned)
    };
    let below = |folder: &Path| -> Result<Vec<PathBuf>, Error> {
        let entries = fs::read_dir(folder).map_err(Error::read(folder))?;
        let mut paths: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .collect();
        paths.sort();
        Ok(paths)
    };
    let mut found = Vec::new();
    for bench in below(dataset)? {
        let Some(name) = part(&bench, "bench") else {
            continue;
        };
        for month in below(&bench)? {
            let Some(when) = part(&month, "month") else {
                continue;
            };
            let file = month.join(FILE);
            if file.exists() {
                let partition = Partition {
                    bench: name.clone(),
                    month: when,
                };
                found.push((partition, file));
            }
        }
    }
    if found.is_empty() {
        return Err(Error::input(
            dataset,
            "is no data set; make one with vre-fleet gather",
        ));
    }
    Ok(found)
}

/// Writes every campaign of a data set as a folder `BENCH/SERIAL` (with the time, where a serial number stands there more than
/// once) below `out`; returns their number. `step` is told of each.
///
/// # Errors
/// A file cannot be read, or a folder written or is there already.
pub fn scatter(dataset: &Path, out: &Path, step: impl Fn(u64)) -> Result<usize, Error> {
    let mut count = 0;
    for (partition, file) in files(dataset)? {
        for batch in batches(&file)? {
            for entry in read(&batch?, &file)? {
                let folder = free_folder(&out.join(&partition.bench), &entry)?;
                let campaign = entry.campaign.campaign();
                let campaign = campaign.map_err(|problem| {
                    Error::input(&file, format!("{}: {problem}", entry.serial))
                })?;
                campaign.write(&folder)?;
                count += 1;
                step(1);
            }
        }
    }
    Ok(count)
}

fn free_folder(bench: &Path, entry: &Entry) -> Result<PathBuf, Error> {
    let safe = |text: &str| -> String {
        let letter = |c: char| {
            if c.is_ascii_alphanumeric() || "-_.".contains(c) {
                c
            } else {
                '_'
            }
        };
        text.trim_matches('.').chars().map(letter).collect()
    };
    let plain = bench.join(safe(&entry.serial));
    if !plain.exists() {
        return Ok(plain);
    }
    let timed = bench.join(format!("{}_{}", safe(&entry.serial), safe(&entry.time)));
    match timed.exists() {
        false => Ok(timed),
        true => Err(Error::Usage(format!(
            "{}: is there already; name another --out",
            timed.display()
        ))),
    }
}
