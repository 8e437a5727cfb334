//! Files of other makers, one module a format. What they hold becomes a campaign, or rows that
//! [`measure`](crate::measure) makes segments of.

pub mod delimited;
mod dialect;
mod layout;
mod lines;
mod source;
mod unit;
pub(crate) mod workbook;

use std::path::Path;

pub(crate) use dialect::iso_time;
pub use dialect::{Dialect, seconds};
pub use layout::Layout;
pub use lines::MAX_ROW_BYTES;
pub(crate) use source::Source;
pub(crate) use unit::Conversion;
pub use unit::Unit;

use crate::error::{Error, Problem};

/// Names of the columns and their units.
#[derive(Clone, Debug)]
pub struct Columns {
    /// Output of the instrument, one column an axis.
    pub outputs: Vec<String>,
    /// Time, and how many of its units make a second.
    pub time: Option<(String, f64)>,
    /// Temperature, C.
    pub temperature: Option<String>,
}

/// Rows of a file, one after the other. A cell is read when it is asked for: what nobody needs may be anything.
pub trait Rows {
    /// Goes to the next row; false after the last.
    ///
    /// # Errors
    /// What the file system says; a row of another length than the header, or too long.
    fn advance(&mut self) -> Result<bool, Error>;

    /// Time, s; none if the file has none.
    ///
    /// # Errors
    /// The cell is not a finite number.
    fn time_s(&self) -> Result<Option<f64>, Error>;

    /// The group that the row belongs to; none without such a column.
    ///
    /// # Errors
    /// The cell is empty or no text.
    fn group(&self) -> Result<Option<&str>, Error>;

    /// Temperature, C; none without such a column.
    ///
    /// # Errors
    /// The cell is not a finite number, or no temperature.
    fn temperature_c(&self) -> Result<Option<f64>, Error>;

    /// The output of an axis, in the order of [`Columns::outputs`], in the file's own unit.
    ///
    /// # Errors
    /// The cell is not a finite number.
    fn output(&self, axis: usize) -> Result<f64, Error>;

    /// An error in the output of an axis.
    fn output_error(&self, axis: usize, problem: Problem) -> Error;

    /// Line of the row in the file, from 1; none if the format has no lines.
    fn line(&self) -> Option<u64>;
}

/// Opens `file`, of whatever format; `group` names the column that tells to which group a row belongs.
///
/// # Errors
/// The file cannot be read, or has no such columns.
pub fn open(file: &Path, columns: &Columns, group: Option<&str>) -> Result<Box<dyn Rows>, Error> {
    Ok(Box::new(delimited::Table::open(file, columns, group)?))
}
