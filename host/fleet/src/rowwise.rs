//! A result of Parquet as a folder of parts that goes on where it was. A query that only looks at one row at a time is carried out
//! month by month, a part each; any other one is one part.

use std::path::Path;

use datafusion::arrow::datatypes::DataType;
use datafusion::common::tree_node::{TreeNode, TreeNodeRecursion};
use datafusion::datasource::file_format::parquet::ParquetFormat;
use datafusion::datasource::listing::ListingOptions;
use datafusion::logical_expr::LogicalPlan;
use datafusion::parquet::arrow::ArrowWriter;
use datafusion::prelude::{DataFrame, SessionContext};
use host::error::Error;
use std::sync::Arc;

use crate::commands::note;
use crate::dataset;
use crate::engine::{TABLE, each_batch, failure};

/// Whether each row of the result comes from one row of the data set.
pub fn is_rowwise(plan: &LogicalPlan) -> bool {
    let mut rowwise = true;
    let visited = plan.apply(|node| {
        let one_to_one = matches!(
            node,
            LogicalPlan::Projection(_)
                | LogicalPlan::Filter(_)
                | LogicalPlan::TableScan(_)
                | LogicalPlan::SubqueryAlias(_)
        );
        rowwise &= one_to_one;
        Ok(if rowwise {
            TreeNodeRecursion::Continue
        } else {
            TreeNodeRecursion::Stop
        })
    });
    rowwise && visited.is_ok()
}

/// Writes the result of a query as parts below `out`; parts that are there already are not made again. `step` is told of each.
///
/// # Errors
/// The query fails, `out` holds parts of another query, or cannot be written.
pub async fn write_parts(
    context: &SessionContext,
    dataset: &Path,
    sql: &str,
    out: &Path,
    step: impl Fn(String),
) -> Result<(), Error> {
    let query = out.join("_query.sql");
    match std::fs::read_to_string(&query) {
        Ok(earlier) if earlier != sql => {
            return Err(Error::Usage(format!(
                "{}: holds parts of another query; name another file",
                out.display()
            )));
        }
        Ok(_) => {}
        Err(_) if out.exists() => {
            return Err(Error::Usage(format!(
                "{}: is there already; name another file",
                out.display()
            )));
        }
        Err(_) => note(&query, sql)?,
    }
    let plan = |error| failure(&error);
    let frame = context.sql(sql).await.map_err(plan)?;
    if !is_rowwise(frame.logical_plan()) {
        return part(frame, &out.join("part-all.parquet")).await;
    }
    let files = dataset::files(dataset)?;
    for (number, (partition, file)) in files.iter().enumerate() {
        let name = format!("part-{}-{}.parquet", partition.bench, partition.month);
        step(format!("part {} of {}", number + 1, files.len()));
        if out.join(&name).exists() {
            continue;
        }
        // The same query over this month alone.
        context
            .deregister_table(TABLE)
            .map_err(|error| failure(&error))?;
        let options = ListingOptions::new(Arc::new(
            ParquetFormat::default().with_force_view_types(false),
        ))
        .with_file_extension(".parquet")
        .with_table_partition_cols(Vec::<(String, DataType)>::new());
        let place = file.to_string_lossy();
        let month = format!("{TABLE}_of_month");
        context
            .register_listing_table(&month, &place, options, Some(dataset::schema()), None)
            .await
            .map_err(|error| failure(&error))?;
        let literal = |text: &str| text.replace('\'', "''");
        let view = format!(
            "CREATE OR REPLACE VIEW {TABLE} AS SELECT *, '{}' AS bench, '{}' AS month FROM {month}",
            literal(&partition.bench),
            literal(&partition.month)
        );
        context.sql(&view).await.map_err(|error| failure(&error))?;
        let frame = context.sql(sql).await.map_err(|error| failure(&error))?;
        part(frame, &out.join(name)).await?;
        context
            .deregister_table(&month)
            .map_err(|error| failure(&error))?;
    }
    Ok(())
}

async fn part(frame: DataFrame, file: &Path) -> Result<(), Error> {
    if file.exists() {
        return Ok(());
    }
    let bad = |error: String| Error::write(file)(std::io::Error::other(error));
    let unfinished = file.with_extension("unfinished");
    let made = std::fs::File::create(&unfinished).map_err(Error::write(&unfinished))?;
    let schema = Arc::new(frame.schema().as_arrow().clone());
    let mut writer =
        ArrowWriter::try_new(made, schema, None).map_err(|error| bad(error.to_string()))?;
    each_batch(frame, |batch| {
        let written = writer.write(&batch);
        written.map_err(|error| bad(error.to_string()))
    })
    .await?;
    writer.close().map_err(|error| bad(error.to_string()))?;
    std::fs::rename(&unfinished, file).map_err(Error::write(file))
}
