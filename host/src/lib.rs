//! The library behind the command `vre`.

pub mod attended;
pub mod bench;
pub mod campaign;
pub mod capture;
pub mod cli;
pub mod configuration;
pub mod diagnose;
pub mod error;
mod finite_record;
pub mod front_end;
pub mod import;
pub mod link;
pub mod measure;
pub mod output;
pub mod paper;
pub mod prediction;
pub mod quantity;
pub mod record;
pub mod reduction;
pub mod report;
pub mod seal;
pub mod source;
pub mod statics;
pub mod verification;

// The paths that report, prediction and diagnosis still use.
pub use statics as identification;
pub use statics as planning;
