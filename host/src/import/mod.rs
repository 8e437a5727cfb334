//! Files of other makers, one module a format. What they hold becomes a campaign, or rows that
//! [`measure`](crate::measure) makes segments of.

mod channels;
mod cursor;
mod dataflash;
pub mod delimited;
mod dialect;
mod format;
#[cfg(feature = "hdf5")]
mod hdf5;
mod layout;
mod lines;
mod mat;
#[cfg(feature = "mcap")]
mod mcap;
#[cfg(feature = "parquet")]
mod parquet;
#[cfg(feature = "mcap")]
mod ros;
mod source;
mod tdms;
mod tdms_scale;
mod uff;
mod ulog;
mod unit;
mod wav;
pub(crate) mod workbook;

use std::fs::File;
use std::io::Read;
use std::path::Path;

pub use channels::{Blocks, Channel, Channels, Clock, Head, Wanted};
pub(crate) use dialect::iso_time;
pub use dialect::{Dialect, seconds};
pub use format::Format;
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

    /// What should be known of the file, as that its end is cut off.
    fn remark(&self) -> Option<&str> {
        None
    }
}

/// Opens `file`, of whatever format; `group` names the column that tells to which group a row belongs.
///
/// # Errors
/// The file cannot be read, or has no such columns.
pub fn open(file: &Path, columns: &Columns, group: Option<&str>) -> Result<Box<dyn Rows>, Error> {
    let Some(format) = format(file)? else {
        return Ok(Box::new(delimited::Table::open(file, columns, group)?));
    };
    if group.is_some() {
        let problem =
            "is no table of text: groups of rows are told by a column of such a table alone";
        return Err(Error::input(file, problem));
    }
    let rows = channels::Sampled::open(file, columns, |wanted| format.open(file, wanted))?;
    Ok(Box::new(rows))
}

/// The channels of `file`, of whatever format.
///
/// # Errors
/// The file cannot be read, or has no channels.
pub fn channels(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    match format(file)? {
        Some(format) => format.open(file, wanted),
        None => delimited::channels(file, wanted),
    }
}

/// Names and units of the columns or channels of `file`; `names` are those that are asked for.
///
/// # Errors
/// The file cannot be read.
pub fn layout(file: &Path, names: &[&str]) -> Result<Layout, Error> {
    Ok(match format(file)? {
        Some(format) => Layout::of_channels(&format.open(file, Wanted::Named(&[]))?),
        None => Layout::of(&Dialect::of(file, names)?),
    })
}

/// Bytes by which a format is told.
const HEAD: u64 = 1024;

/// The format of a file of channels; none of a table of text or of a workbook.
///
/// # Errors
/// The file cannot be read, or is named as one of a format and does not begin so.
pub fn format(file: &Path) -> Result<Option<Format>, Error> {
    let mut head = Vec::new();
    let source = File::open(file).map_err(Error::read(file))?;
    let mut source = source.take(HEAD);
    source.read_to_end(&mut head).map_err(Error::read(file))?;
    match Format::of(&head) {
        Some(format) => Ok(Some(format)),
        None => format::check_name(file).map(|()| None),
    }
}
