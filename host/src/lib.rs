//! The library behind the command `vre`.
