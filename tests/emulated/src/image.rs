//! The image, built as it is flashed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};
use std::{env, fs};

use crate::part::Model;

const TARGET: &str = "thumbv7em-none-eabihf";

/// Bytes of flash that an image may take: a quarter of the bank that the code has for itself.
pub const FLASH_BUDGET: u64 = 256 << 10;

/// Why there is no image.
#[derive(Clone, Debug, thiserror::Error)]
pub enum Error {
    /// The compiler could not be started.
    #[error("cargo did not start: {0}")]
    Start(String),
    /// It did not build.
    #[error("the image did not build:\n{0}")]
    Build(String),
    /// It could not be put aside.
    #[error("the image could not be copied: {0}")]
    Copy(String),
}

/// How often the image's converter gives a conversion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rate {
    /// 4 kSPS.
    X1024,
    /// 16 kSPS.
    X256,
    /// 32 kSPS.
    X128,
}

impl Rate {
    /// Conversions a second.
    pub const fn hz(self) -> u64 {
        match self {
            Self::X1024 => 4_000,
            Self::X256 => 16_000,
            Self::X128 => 32_000,
        }
    }

    const fn feature(self) -> &'static str {
        match self {
            Self::X1024 => "",
            Self::X256 => "oversampling-256",
            Self::X128 => "oversampling-128",
        }
    }
}

/// The file of the image at 4 kSPS, built on the first call.
pub fn path() -> Result<PathBuf, Error> {
    path_at(Rate::X1024)
}

/// The same at a rate.
pub fn path_at(rate: Rate) -> Result<PathBuf, Error> {
    path_of(Model::F429, rate)
}

/// The file of a board's image at a rate, built on the first call and put aside, since the next one takes its place.
pub fn path_of(model: Model, rate: Rate) -> Result<PathBuf, Error> {
    type Images = BTreeMap<(Model, Rate), Result<PathBuf, Error>>;
    static IMAGES: Mutex<Images> = Mutex::new(BTreeMap::new());
    let mut images = IMAGES.lock().unwrap_or_else(PoisonError::into_inner);
    let image = images.entry((model, rate)).or_insert_with(|| {
        let features = format!("{} {}", model.name(), rate.feature());
        let only = ["--no-default-features", "--features", features.trim_end()];
        let built = build(&[&["--bin", "firmware"], &only[..]].concat())?;
        let aside = format!("firmware-{}-{}-ksps", model.name(), rate.hz() / 1000);
        let aside = built.with_file_name(aside);
        fs::copy(&built, &aside).map_err(|e| Error::Copy(e.to_string()))?;
        Ok(aside)
    });
    image.clone()
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
