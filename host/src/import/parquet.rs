//! Parquet, by the crate of Apache Arrow without Arrow: columns of numbers and of time, batch by batch.

use std::fs::File;
use std::path::{Path, PathBuf};

use parquet::basic::{LogicalType, TimeUnit, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;

use super::channels::{Channel, Channels, Clock, Head, Wanted};
use crate::error::Error;

/// Rows of a batch.
const BATCH: usize = 1 << 14;

/// Seconds of a day.
const DAY: i64 = 86_400;

/// Opens a Parquet file. Its columns of numbers are channels; a time stamp becomes seconds from the midnight before the first.
///
/// # Errors
/// Unreadable, damaged, or without a column of numbers.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let source = File::open(file).map_err(Error::read(file))?;
    let length = source.metadata().map_err(Error::read(file))?.len();
    let reader = SerializedFileReader::new(source).map_err(damaged(file))?;
    check(reader.metadata(), length).map_err(damaged(file))?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let columns = schema.columns().iter().enumerate();
    let columns: Vec<Column> = columns
        .filter_map(|(index, column)| Column::of(index, column))
        .collect();
    if columns.is_empty() {
        return Err(Error::input(file, "holds no column of numbers"));
    }
    let heads = columns.iter().map(|column| column.head.clone()).collect();
    let columns = columns.into_iter();
    let batches = Batches {
        file: file.into(),
        reader,
        columns: columns
            .filter(|column| wanted.has(&column.head.name))
            .collect(),
        group: 0,
        readers: Vec::new(),
        left: 0,
        failed: false,
    };
    Ok(Channels {
        heads,
        blocks: Box::new(batches),
        remark: None,
    })
}

/// Every column of every group of rows lies within the file: the crate takes that for granted.
fn check(metadata: &ParquetMetaData, length: u64) -> Result<(), ParquetError> {
    let columns = metadata
        .row_groups()
        .iter()
        .flat_map(|group| group.columns());
    for column in columns {
        let from = column
            .dictionary_page_offset()
            .unwrap_or(column.data_page_offset());
        let range = u64::try_from(from)
            .ok()
            .zip(u64::try_from(column.compressed_size()).ok());
        let end = range.and_then(|(from, size)| from.checked_add(size));
        if end.is_none_or(|end| end > length) {
            let what = format!("column {} lies outside of the file", column.column_path());
            return Err(ParquetError::General(what));
        }
    }
    Ok(())
}

fn damaged(file: &Path) -> impl Fn(ParquetError) -> Error {
    move |error| Error::input(file, format!("is a damaged Parquet file: {error}"))
}

/// A column of numbers.
struct Column {
    head: Head,
    index: usize,
    nullable: bool,
    /// Whether its integers have no sign.
    unsigned: bool,
    /// Of a column of time: units a second, and the midnight before the first, in units.
    time: Option<(i64, Option<i64>)>,
}

impl Column {
    fn of(index: usize, column: &ColumnDescriptor) -> Option<Self> {
        let number = matches!(
            column.physical_type(),
            Type::BOOLEAN | Type::INT32 | Type::INT64 | Type::FLOAT | Type::DOUBLE
        );
        let time = match column.logical_type_ref() {
            Some(LogicalType::Timestamp(time)) => Some(match time.unit {
                TimeUnit::MILLIS => 1_000,
                TimeUnit::MICROS => 1_000_000,
                TimeUnit::NANOS => 1_000_000_000,
            }),
            Some(LogicalType::Decimal { .. } | LogicalType::Date | LogicalType::Time(_)) => {
                return None;
            }
            _ => None,
        };
        let unsigned = matches!(column.logical_type_ref(), Some(LogicalType::Integer(kind)) if !kind.is_signed);
        // A list has many values a row.
        (number && column.max_rep_level() == 0).then(|| Self {
            head: Head {
                name: column.path().string(),
                unit: time.is_some().then(|| "s".into()),
            },
            index,
            nullable: column.max_def_level() > 0,
            unsigned,
            time: time.map(|units| (units, None)),
        })
    }

    /// The next rows, NaN where there is none.
    fn read(&mut self, reader: &mut ColumnReader, rows: usize) -> Result<Vec<f64>, ParquetError> {
        let (nullable, unsigned) = (self.nullable, self.unsigned);
        match reader {
            ColumnReader::BoolColumnReader(r) => {
                read(r, rows, nullable, |v| f64::from(u8::from(v)))
            }
            ColumnReader::Int32ColumnReader(r) if unsigned => {
                read(r, rows, nullable, |v| f64::from(v as u32))
            }
            ColumnReader::Int32ColumnReader(r) => read(r, rows, nullable, f64::from),
            ColumnReader::Int64ColumnReader(r) if unsigned => {
                read(r, rows, nullable, |v| v as u64 as f64)
            }
            ColumnReader::FloatColumnReader(r) => read(r, rows, nullable, f64::from),
            ColumnReader::DoubleColumnReader(r) => read(r, rows, nullable, |v| v),
            ColumnReader::Int64ColumnReader(r) => {
                let Some((units, midnight)) = &mut self.time else {
                    return read(r, rows, nullable, |v| v as f64);
                };
                let units = *units;
                read(r, rows, nullable, |v| {
                    let day = v.div_euclid(DAY * units) * DAY * units;
                    let from = *midnight.get_or_insert(day);
                    v.saturating_sub(from) as f64 / units as f64
                })
            }
            _ => Ok(Vec::new()),
        }
    }
}

fn read<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    nullable: bool,
    mut number: impl FnMut(T::T) -> f64,
) -> Result<Vec<f64>, ParquetError> {
    let (mut values, mut levels) = (Vec::new(), Vec::new());
    let (read, ..) =
        reader.read_records(rows, nullable.then_some(&mut levels), None, &mut values)?;
    if read < rows {
        return Err(ParquetError::EOF(format!("{read} of {rows} rows")));
    }
    let most = levels.iter().copied().max().unwrap_or(0);
    let mut values = values.into_iter().map(&mut number);
    if !nullable || values.len() == rows {
        return Ok(values.collect());
    }
    let mut next = |level: &i16| match *level == most && most > 0 {
        true => values.next().unwrap_or(f64::NAN),
        false => f64::NAN,
    };
    Ok(levels.iter().map(&mut next).collect())
}

/// The batches of a file.
struct Batches {
    file: PathBuf,
    reader: SerializedFileReader<File>,
    columns: Vec<Column>,
    group: usize,
    readers: Vec<ColumnReader>,
    left: usize,
    failed: bool,
}

impl Batches {
    /// The next batch; `None` after the last group of rows.
    fn batch(&mut self) -> Result<Option<Vec<Channel>>, ParquetError> {
        while self.left == 0 {
            if self.group == self.reader.num_row_groups() {
                return Ok(None);
            }
            let group = self.reader.get_row_group(self.group)?;
            let readers = self.columns.iter();
            self.readers = readers
                .map(|column| group.get_column_reader(column.index))
                .collect::<Result<_, _>>()?;
            self.left = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            self.group += 1;
        }
        let rows = self.left.min(BATCH);
        self.left -= rows;
        let columns = self.columns.iter_mut().zip(&mut self.readers);
        let channels = columns.map(|(column, reader)| {
            Ok(Channel {
                name: column.head.name.clone(),
                unit: column.head.unit.clone(),
                clock: Clock::Order,
                values: column.read(reader, rows)?,
            })
        });
        channels.collect::<Result<_, _>>().map(Some)
    }
}

impl Iterator for Batches {
    type Item = Result<Vec<Channel>, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let batch = self.batch().map_err(damaged(&self.file));
        self.failed = batch.is_err();
        batch.transpose()
    }
}
