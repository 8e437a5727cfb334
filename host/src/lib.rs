//! The library behind the command `vre`.

pub mod campaign;
pub mod cli;
pub mod error;
pub mod output;
pub mod quantity;
