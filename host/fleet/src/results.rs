//! Results of a query: to the terminal, or to CSV, JSON and Parquet by the file's name. Parquet is resumable.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use datafusion::arrow::array::{ArrayRef, RecordBatch, StringArray};
use datafusion::arrow::csv;
use datafusion::arrow::datatypes::{DataType, Field, Schema, SchemaRef};
use datafusion::arrow::json::{ArrayWriter, writer::WriterBuilder};
use datafusion::arrow::util::display::{ArrayFormatter, FormatOptions};
use datafusion::arrow::util::pretty::pretty_format_batches;
use host::error::Error;
use std::sync::Arc;

/// Batches that go somewhere.
pub enum Sink {
    /// A table on the terminal, when all is there.
    Terminal(Vec<RecordBatch>),
    /// Lines of CSV; nested columns as JSON.
    Csv(csv::Writer<File>, PathBuf),
    /// An array of objects.
    Json(Box<ArrayWriter<File>>, PathBuf),
}

fn bad(file: &Path) -> impl Fn(&dyn std::fmt::Display) -> Error {
    move |error| Error::write(file)(std::io::Error::other(error.to_string()))
}

impl Sink {
    /// By the ending of the file's name; the terminal without one.
    ///
    /// # Errors
    /// Another ending, or the file cannot be made.
    pub fn open(file: Option<&Path>) -> Result<Self, Error> {
        let Some(file) = file else {
            return Ok(Self::Terminal(Vec::new()));
        };
        let made = || File::create(file).map_err(Error::write(file));
        match file.extension().and_then(|ending| ending.to_str()) {
            Some("csv") => Ok(Self::Csv(csv::Writer::new(made()?), file.into())),
            Some("json") => {
                let writer = WriterBuilder::new()
                    .with_explicit_nulls(true)
                    .build(made()?);
                Ok(Self::Json(Box::new(writer), file.into()))
            }
            _ => Err(Error::Usage(format!(
                "{}: ends in none of .csv, .json and .parquet",
                file.display()
            ))),
        }
    }

    /// Takes a batch.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn take(&mut self, batch: RecordBatch) -> Result<(), Error> {
        match self {
            Self::Terminal(batches) => batches.push(batch),
            Self::Csv(writer, file) => {
                let batch = flat(&batch).map_err(|error| bad(file)(&error))?;
                writer.write(&batch).map_err(|error| bad(file)(&error))?;
            }
            Self::Json(writer, file) => writer.write(&batch).map_err(|error| bad(file)(&error))?,
        }
        Ok(())
    }

    /// Ends; gives what the terminal is to show.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn end(self) -> Result<Option<String>, Error> {
        match self {
            Self::Terminal(batches) => {
                let table = pretty_format_batches(&batches);
                table
                    .map(|table| Some(table.to_string()))
                    .map_err(|error| Error::Usage(error.to_string()))
            }
            Self::Csv(writer, file) => {
                writer.into_inner().flush().map_err(Error::write(&file))?;
                Ok(None)
            }
            Self::Json(mut writer, file) => {
                writer.finish().map_err(|error| bad(&file)(&error))?;
                writer.into_inner().flush().map_err(Error::write(&file))?;
                Ok(None)
            }
        }
    }
}

/// Nested columns as text: CSV has no others.
fn flat(batch: &RecordBatch) -> datafusion::arrow::error::Result<RecordBatch> {
    let options = FormatOptions::default();
    let mut fields = Vec::new();
    let mut columns: Vec<ArrayRef> = Vec::new();
    for (field, column) in batch.schema().fields().iter().zip(batch.columns()) {
        if !field.data_type().is_nested() {
            fields.push(field.as_ref().clone());
            columns.push(column.clone());
            continue;
        }
        let formatter = ArrayFormatter::try_new(column, &options)?;
        let text = (0..column.len()).map(|row| formatter.value(row).try_to_string());
        let text: StringArray = text.map(|text| text.map(Some)).collect::<Result<_, _>>()?;
        fields.push(Field::new(field.name(), DataType::Utf8, true));
        columns.push(Arc::new(text));
    }
    let schema: SchemaRef = Arc::new(Schema::new(fields));
    RecordBatch::try_new(schema, columns)
}
