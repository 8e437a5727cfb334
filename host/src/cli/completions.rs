//! `vre completions`

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::CommandFactory;
use clap_complete::Shell;

use super::{Arguments, Command, Console};
use crate::error::Error;

/// Print completions for a shell, or write the manual pages
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  vre completions bash > ~/.local/share/bash-completion/completions/vre\n  vre completions --man ~/.local/share/man/man1"
)]
#[group(required = true, multiple = false)]
pub struct Completions {
    /// The shell
    shell: Option<Shell>,
    /// Write a manual page a command into this folder
    #[arg(long, value_name = "DIR")]
    man: Option<PathBuf>,
}

impl Command for Completions {
    fn run(self, console: &Console) -> Result<(), Error> {
        let mut command = Arguments::command();
        if let Some(folder) = &self.man {
            std::fs::create_dir_all(folder).map_err(Error::write(folder))?;
            clap_mangen::generate_to(command, folder).map_err(Error::write(folder))?;
            return console.print(format!("{}: manual pages of vre", folder.display()));
        }
        let mut text = Vec::new();
        if let Some(shell) = self.shell {
            clap_complete::generate(shell, &mut command, "vre", &mut text);
        }
        let mut stdout = io::stdout().lock();
        let written = stdout.write_all(&text).and_then(|()| stdout.flush());
        written.map_err(Error::write(Path::new("standard output")))
    }
}
