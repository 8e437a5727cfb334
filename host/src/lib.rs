//! The library behind the command `vre`.

pub mod campaign;
pub mod error;
pub mod output;
