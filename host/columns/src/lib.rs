//! A campaign as one row of Arrow columns, and what `vre` answers as structs with the names and units of its JSON.
//!
//! ```text
//! campaign folder <-> host::campaign <-> rows (nested lists of structs) -> functions -> answers (structs)
//! ```
//!
//! Engines and languages stand on this: it knows of none.

pub mod answers;
pub mod cell;
pub mod functions;
pub mod rows;

pub use arrow;
pub use rows::{CampaignRow, campaign_field, decode, encode};
