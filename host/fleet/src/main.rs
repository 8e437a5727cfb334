//! The command `vre-fleet`.

use std::process::ExitCode;

fn main() -> ExitCode {
    fleet::commands::run(std::env::args_os())
}
