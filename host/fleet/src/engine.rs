//! DataFusion over a data set, with our functions.

use std::path::Path;
use std::sync::Arc;

use datafusion::arrow::array::RecordBatch;
use datafusion::arrow::datatypes::DataType;
use datafusion::datasource::file_format::parquet::ParquetFormat;
use datafusion::datasource::listing::ListingOptions;
use datafusion::execution::config::SessionConfig;
use datafusion::prelude::{DataFrame, SessionContext};
use futures::StreamExt;
use host::error::Error;

use crate::dataset::{self, ROWS};
use crate::functions::register;

/// Name of the table.
pub const TABLE: &str = "campaigns";

/// A session in which `campaigns` is the data set: the columns serial, time, campaign, bench and month.
///
/// # Errors
/// There is no data set.
pub async fn session(dataset: &Path) -> Result<SessionContext, Error> {
    dataset::files(dataset)?;
    // Small batches: a campaign is some ten kilobytes, a diagnosis half a second.
    let config = SessionConfig::new()
        .with_batch_size(ROWS)
        .with_information_schema(false);
    let context = SessionContext::new_with_config(config);
    register(&context);
    let options = ListingOptions::new(Arc::new(
        ParquetFormat::default().with_force_view_types(false),
    ))
    .with_file_extension(".parquet")
    .with_table_partition_cols(vec![
        ("bench".into(), DataType::Utf8),
        ("month".into(), DataType::Utf8),
    ]);
    let place = dataset
        .to_str()
        .ok_or_else(|| Error::input(dataset, "its name is not UTF-8"))?;
    context
        .register_listing_table(TABLE, place, options, Some(dataset::schema()), None)
        .await
        .map_err(|error| failure(&error))?;
    Ok(context)
}

/// Carries out a query and hands over its rows, batch by batch.
///
/// # Errors
/// What the engine says, and what `take` does.
pub async fn each_batch(
    frame: DataFrame,
    mut take: impl FnMut(RecordBatch) -> Result<(), Error>,
) -> Result<(), Error> {
    let stream = frame.execute_stream().await;
    let mut stream = stream.map_err(|error| failure(&error))?;
    while let Some(batch) = stream.next().await {
        take(batch.map_err(|error| failure(&error))?)?;
    }
    Ok(())
}

/// What the engine says, in one line.
pub fn failure(error: &datafusion::error::DataFusionError) -> Error {
    let text = error.strip_backtrace();
    Error::Usage(text.split_whitespace().collect::<Vec<_>>().join(" "))
}
