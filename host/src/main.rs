//! The command `vre`.
fn main() {}
