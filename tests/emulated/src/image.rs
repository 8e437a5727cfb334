//! The image, built as it is flashed.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

const TARGET: &str = "thumbv7em-none-eabihf";

/// Why there is no image.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Error {
    /// The compiler could not be started.
    #[error("cargo did not start: {0}")]
    Start(String),
    /// It did not build.
    #[error("the image did not build:\n{0}")]
    Build(String),
}

/// The image's file, built on the first call.
pub fn path() -> Result<&'static Path, Error> {
    static IMAGE: LazyLock<Result<PathBuf, Error>> =
        LazyLock::new(|| build(&["--bin", "firmware"]));
    IMAGE.as_deref().map_err(Clone::clone)
}

/// The file of an example for the board, built as the image is.
pub fn example(name: &str) -> Result<PathBuf, Error> {
    build(&["--example", name])
}

/// Builds with the flags of the image and no others: what is set for the host's own build is taken out.
fn build(what: &[&str]) -> Result<PathBuf, Error> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command
        .current_dir(&root)
        .args([
            "build",
            "--profile",
            "image",
            "--locked",
            "-p",
            "firmware",
            "--target",
            TARGET,
        ])
        .args(what)
        .args(["--message-format", "json-render-diagnostics"]);
    for variable in [
        "RUSTFLAGS",
        "CARGO_ENCODED_RUSTFLAGS",
        "RUSTC_WRAPPER",
        "RUSTC_WORKSPACE_WRAPPER",
    ] {
        command.env_remove(variable);
    }
    let output = command.output().map_err(|e| Error::Start(e.to_string()))?;
    let messages = String::from_utf8_lossy(&output.stdout);
    executable(&messages)
        .filter(|_| output.status.success())
        .ok_or_else(|| Error::Build(String::from_utf8_lossy(&output.stderr).into_owned()))
}

/// The path of the executable among the messages of cargo, one JSON object a line.
fn executable(messages: &str) -> Option<PathBuf> {
    messages.lines().find_map(|line| {
        let message: serde_json::Value = serde_json::from_str(line).ok()?;
        message["executable"].as_str().map(PathBuf::from)
    })
}
