//! `measure` of a file, of columns of numbers, or of record batches.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow::array::{ArrayRef, Float64Array, RecordBatch, RecordBatchReader};
use arrow::error::ArrowError;
use arrow::record_batch::RecordBatchIterator;
use host::campaign::ranges;
use host::error::{Error, Place};
use host::import::{self, Columns, Unit};
use host::measure::{self, Calibration, Request, Selection};
use parquet::arrow::ArrowWriter;
use pyo3::prelude::*;
use pyo3_arrow::input::AnyRecordBatch;

use crate::failure::{detached, imported, usage, within};

/// What a person says of a record.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Said {
    columns: Vec<String>,
    units_per_g: Option<f64>,
    time: Option<String>,
    temperature: Option<String>,
    before: Option<String>,
    during: Option<String>,
    group: Option<String>,
    without: Option<String>,
    run: Option<u32>,
    full_scale_g: Option<f64>,
}

/// Name of a record that is no file.
const RECORD: &str = "record";

/// Measures a file, as JSON.
#[pyfunction]
pub fn of_file(py: Python<'_>, file: PathBuf, said: Said) -> PyResult<String> {
    detached(py, || measured(&file, said, &file.display().to_string()))
}

/// Measures columns of numbers, as JSON.
#[pyfunction]
pub fn of_columns(
    py: Python<'_>,
    columns: HashMap<String, Vec<f64>>,
    said: Said,
) -> PyResult<String> {
    detached(py, || {
        let mut columns: Vec<_> = columns.into_iter().collect();
        columns.sort_by(|a, b| a.0.cmp(&b.0));
        let columns = columns.into_iter();
        let columns =
            columns.map(|(name, values)| (name, Arc::new(Float64Array::from(values)) as ArrayRef));
        let batch = RecordBatch::try_from_iter(columns).map_err(|error| unreadable(&error))?;
        let schema = batch.schema();
        let one = RecordBatchIterator::new([Ok(batch)], schema);
        in_memory(Box::new(one), said)
    })
}

/// Measures record batches, as JSON.
#[pyfunction]
pub fn of_batches(py: Python<'_>, batches: &Bound<'_, PyAny>, said: Said) -> PyResult<String> {
    let reader = imported::<AnyRecordBatch>(batches)?.into_reader()?;
    detached(py, || in_memory(reader, said))
}

fn unreadable(error: &ArrowError) -> Error {
    Error::input(Path::new(RECORD), error.to_string())
}

/// Batches go through a file of the temporary folder: the way of every other record, in memory that does not grow with them.
fn in_memory(batches: Box<dyn RecordBatchReader + Send>, said: Said) -> Result<String, Error> {
    let place = Path::new(RECORD);
    let made = tempfile::Builder::new().suffix(".parquet").tempfile();
    let file = made.map_err(Error::write(place))?;
    let bad = |error: String| Error::input(place, error);
    let schema = batches.schema();
    let writer = ArrowWriter::try_new(file.as_file(), schema, None);
    let mut writer = writer.map_err(|error| bad(error.to_string()))?;
    for batch in batches {
        let written = writer.write(&batch.map_err(|error| unreadable(&error))?);
        written.map_err(|error| bad(error.to_string()))?;
    }
    writer.close().map_err(|error| bad(error.to_string()))?;
    // The file's own name says nothing to anybody.
    measured(file.path(), said, RECORD).map_err(|error| match error {
        Error::Input {
            place: Place { row, column, .. },
            problem,
        } => {
            let file = place.into();
            let place = Place { file, row, column };
            Error::Input { place, problem }
        }
        other => other,
    })
}

fn measured(file: &Path, said: Said, name: &str) -> Result<String, Error> {
    let request = said.request(file)?;
    let mut measured = measure::measure(file, &request)?;
    measured.input = name.into();
    host::gate::check(&measured)?;
    serde_json::to_string(&measured).map_err(usage)
}

impl Said {
    /// The request, with what names and units of a table tell.
    fn request(mut self, file: &Path) -> Result<Request, Error> {
        if !measure::is_record(file, &self.columns)? {
            self.complete(file)?;
        }
        let units_per_g = self.units_per_g.ok_or_else(|| {
            usage("units_per_g is needed: the columns' names tell no unit of acceleration")
        })?;
        let units_per_g = within(&ranges::RECORD_SCALE, "units_per_g", units_per_g)?;
        let full_scale_g = self.full_scale_g;
        let full_scale_g = full_scale_g
            .map(|g| within(&ranges::FULL_SCALE, "full_scale_g", g))
            .transpose()?;
        let time = self
            .time
            .map(|name| {
                let per_second = import::layout(file, &[&name])?.seconds(&name);
                Ok::<_, Error>((name, per_second.unwrap_or(1.0)))
            })
            .transpose()?;
        let selection = match (&self.before, &self.during) {
            (Some(before), Some(during)) => {
                let (group, without) = (self.group.as_deref(), self.without.as_deref());
                Some(Selection::parse(group, before, during, without)?)
            }
            (None, None) => None,
            _ => return Err(usage("before and during go together")),
        };
        Ok(Request {
            columns: Columns {
                outputs: self.columns,
                time,
                temperature: self.temperature,
            },
            selection,
            run: self.run,
            calibration: Calibration {
                units_per_g,
                full_scale_g,
                temperature_sensitivity_g_per_c: None,
            },
        })
    }

    fn complete(&mut self, file: &Path) -> Result<(), Error> {
        let names: Vec<&str> = self.columns.iter().map(String::as_str).collect();
        let layout = import::layout(file, &names)?;
        if self.columns.is_empty() {
            self.columns.clone_from(&layout.outputs);
            self.time = self.time.take().or(layout.time.clone());
        }
        if self.columns.is_empty() {
            let names = layout.names.join(", ");
            let problem = format!("no column's name tells an acceleration; columns are {names}");
            return Err(usage(problem));
        }
        if self.units_per_g.is_none() {
            let units = self.columns.iter().map(|name| layout.unit(name));
            let mut units = units.map(|unit| unit.and_then(Unit::units_per_g));
            let first = units.next().flatten();
            self.units_per_g = first.filter(|_| units.all(|other| other == first));
        }
        Ok(())
    }
}
