//! `vre fleet`

use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process;

use super::{Command, Console};
use crate::error::Error;

/// Ask the campaigns of many instruments, and calibrate the heads they were tested on: starts `vre-fleet`, a program of its own
#[derive(clap::Args)]
#[command(
    disable_help_flag = true,
    after_help = "Example:\n  vre fleet gather campaigns/ --out plant\n  vre fleet bench plant --head H1"
)]
pub struct Fleet {
    /// What `vre-fleet` is to do
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

impl Command for Fleet {
    fn run(self, _: &Console) -> Result<(), Error> {
        let program = beside_this().unwrap_or_else(|| "vre-fleet".into());
        match process::Command::new(&program).args(&self.arguments).status() {
            // Its exit status means what ours does; a program that was killed has none.
            Ok(status) => process::exit(status.code().unwrap_or(1)),
            Err(error) if error.kind() == ErrorKind::NotFound => Err(Error::Usage(
                "vre-fleet is not installed, since it takes long to build; `cargo install --path host/fleet` in the project's \
                 folder installs it"
                    .into(),
            )),
            Err(error) => Err(Error::read(Path::new(&program))(error)),
        }
    }
}

/// The program in the folder of this one.
fn beside_this() -> Option<PathBuf> {
    let name = format!("vre-fleet{}", std::env::consts::EXE_SUFFIX);
    let program = std::env::current_exe().ok()?.with_file_name(name);
    program.exists().then_some(program)
}
