//! Where a command's results go: text for people, JSON for programs, progress on the terminal.

use std::ffi::OsString;
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use terminal_size::{Width, terminal_size};

use super::wrap::wrapped;
use crate::error::{Error, printable};
use crate::output::{json_text, write_json};

/// The options that all commands share.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Console {
    /// Write the result as JSON to FILE; `-` is standard output, the text then goes to standard error
    #[arg(long, value_name = "FILE", global = true)]
    json: Option<PathBuf>,
    /// Print no text and no progress
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Whether the result was written as JSON.
    #[arg(skip)]
    answered: Arc<AtomicBool>,
}

impl Console {
    /// Of arguments that could not be parsed: where they say that JSON goes.
    pub(super) fn of_arguments(arguments: &[OsString]) -> Self {
        let mut rest = arguments.iter();
        let json = rest.find_map(
            |argument| match argument.to_str()?.strip_prefix("--json")? {
                "" => Some(None),
                file => file.strip_prefix('=').map(|file| Some(PathBuf::from(file))),
            },
        );
        Self {
            json: json.and_then(|file| file.or_else(|| rest.next().map(PathBuf::from))),
            ..Self::default()
        }
    }

    /// Prints `text`, which ends its last line itself or not, for people.
    ///
    /// # Errors
    /// Standard output cannot be written.
    pub fn print(&self, text: impl Display) -> Result<(), Error> {
        if self.quiet {
            return Ok(());
        }
        let text = text.to_string();
        match self.json_to_stdout() {
            true => write_text(io::stderr(), "standard error", &text),
            false => write_text(io::stdout(), "standard output", &text),
        }
    }

    /// Tells on standard error what is odd but no failure.
    ///
    /// # Errors
    /// Standard error cannot be written.
    pub fn warn(&self, line: impl Display) -> Result<(), Error> {
        if self.quiet {
            return Ok(());
        }
        let line = format!("warning: {line}");
        write_text(io::stderr(), "standard error", &line)
    }

    /// Writes a failure where `--json` says, if it was given and holds no result: some commands fail with one, as a disagreement.
    ///
    /// # Errors
    /// The file or standard output cannot be written.
    pub(super) fn json_failure(&self, failure: &impl Serialize) -> Result<(), Error> {
        match self.answered.load(Ordering::Relaxed) {
            true => Ok(()),
            false => self.json(failure),
        }
    }

    /// Writes `result` where `--json` says, if it was given.
    ///
    /// # Errors
    /// The file or standard output cannot be written.
    pub fn json(&self, result: &impl Serialize) -> Result<(), Error> {
        self.answered.store(true, Ordering::Relaxed);
        match &self.json {
            None => Ok(()),
            Some(file) if self.json_to_stdout() => {
                write_lines(io::stdout(), "standard output", &json_text(file, result)?)
            }
            Some(file) => write_json(file, result),
        }
    }

    /// A progress bar of `steps` on standard error; nothing is drawn with `--quiet` or without a terminal.
    pub fn progress(&self, steps: u64, doing: &'static str) -> ProgressBar {
        if self.quiet {
            return ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
        }
        let style = ProgressStyle::with_template("{msg:24} {bar:40} {percent:>3} %  {eta} left");
        let bar = ProgressBar::new(steps).with_message(doing);
        bar.enable_steady_tick(Duration::from_millis(100));
        match style {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        }
    }

    fn json_to_stdout(&self) -> bool {
        self.json.as_deref() == Some(Path::new("-"))
    }
}

/// Lines without what steers a terminal, whoever wrote it into a file or onto the link.
fn terminal_text(text: &str) -> String {
    let lines: Vec<String> = text.split('\n').map(printable).collect();
    lines.join("\n")
}

/// Writes lines for people: without what steers a terminal, and on one no longer than it is wide.
fn write_text(stream: impl Write + IsTerminal, name: &str, text: &str) -> Result<(), Error> {
    let text = terminal_text(text);
    let size = stream.is_terminal().then(terminal_size).flatten();
    match size {
        Some((Width(width), _)) => write_lines(stream, name, &wrapped(&text, width.into())),
        None => write_lines(stream, name, &text),
    }
}

fn write_lines(mut stream: impl Write, name: &str, text: &str) -> Result<(), Error> {
    let end = if text.is_empty() || text.ends_with('\n') {
        ""
    } else {
        "\n"
    };
    stream
        .write_all(text.as_bytes())
        .and_then(|()| stream.write_all(end.as_bytes()))
        .and_then(|()| stream.flush())
        .map_err(Error::write(Path::new(name)))
}
