//! A campaign measured by the instrument itself: commands go out, frames come in and are recorded, and the tables of the
//! campaign are made from what the record tells.
//!
//! ```text
//! virtual bench -> bench --\                      /-> ledger -> tables -> static.csv, vibration.csv
//! person, dial  -> attended -> recorder -> record.vre
//!                                                 \-> ledger (later, `vre reduce`) -> the same tables
//! ```
//!
//! The record comes first: a reading is in the table only when the record has it whole. So a capture that is stopped at any
//! moment, by whatever, loses at most the reading that was under way.

mod bench;
mod folder;
mod ledger;
mod plan;
mod recorder;
mod tables;

pub use bench::{capture, capture_until, capture_virtual, position, set_up, steps, virtual_board};
pub use folder::{Folder, RECORD, tables_of};
pub use ledger::{Ledger, LedgerError, Shaken, Standing, Taken};
pub use plan::{PLAN, plan_of, read_plan, remaining, write_plan, write_sheet};
pub use recorder::{Recorder, unix_ms};
pub use tables::campaign;

use crate::campaign::Campaign;
use crate::record::Tally;

/// What came of a capture.
#[derive(Clone, Debug)]
pub struct Captured {
    /// The campaign as made from the record.
    pub campaign: Campaign,
    /// What the record held and what was lost.
    pub tally: Tally,
    /// Whether it came to its end.
    pub complete: bool,
}
