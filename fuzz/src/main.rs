//! Hostile input: `cargo run --release -p fuzzing -- TARGET --seconds N --seed S`.
//!
//! A target makes an input out of bytes, hands it to the project's own functions and judges what comes back. The bytes
//! follow from the seed and the number of the iteration, so that a finding is made again by both. The corpus holds the
//! small files by which faults were found; they are tried first.

mod campaign;
mod draw;
mod frames;
mod options;
mod same;
mod sealed;
mod tables;
mod wire;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use arbitrary::Unstructured;
use clap::{Parser, ValueEnum};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use host::error::Error;

/// What is wrong, in a line; `Ok` where the answer makes sense or the refusal is a proper one.
type Judged = Result<(), String>;

/// What is fuzzed.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Target {
    /// campaign.toml and its tables: identification, prediction, diagnosis.
    Campaign,
    /// Raw tables to be measured.
    Tables,
    /// Records of frames.
    Frames,
    /// Commands to the firmware's application, and what it says.
    Wire,
    /// Diagnosis and sealed files.
    Sealed,
    /// Options of the command.
    Options,
}

/// Tries one target with hostile input until a finding, so many iterations, or so many seconds
#[derive(Parser)]
struct Arguments {
    /// What is fuzzed
    target: Target,
    /// Longest time, s
    #[arg(long, default_value_t = 3600)]
    seconds: u64,
    /// Most inputs
    #[arg(long, default_value_t = u64::MAX)]
    iterations: u64,
    /// Fixes every input
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of the first input
    #[arg(long, default_value_t = 0)]
    from: u64,
    /// Write the inputs of findings into this folder
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Go on after a finding, and count them
    #[arg(long)]
    go_on: bool,
}

/// Bytes that one input is made of.
const BYTES: usize = 4096;

/// The bytes of an iteration.
fn bytes(seed: u64, iteration: u64) -> Vec<u8> {
    let mut stream = ChaCha8Rng::seed_from_u64(seed);
    stream.set_stream(iteration);
    let mut bytes = vec![0; BYTES];
    stream.fill_bytes(&mut bytes);
    bytes
}

/// Runs one input; a panic is a finding too.
fn judged(run: impl FnOnce() -> Judged) -> Judged {
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|&text| text.into()));
        Err(format!("panic: {}", text.unwrap_or_default()))
    })
}

/// Every small file, or folder, by which a fault of this target was found.
fn corpus(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("corpus")
        .join(target);
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.sort();
    files
}

/// A refusal is proper if it blames the input in one line.
fn proper(error: &Error) -> Judged {
    let line = error.to_string();
    match (error.exit_status(), line.lines().count()) {
        (2, 1) => Ok(()),
        (status, _) => Err(format!("refused with exit status {status}: {line}")),
    }
}

/// A target with what it keeps from one input to the next.
trait Fuzz {
    /// Tries the input that these bytes make.
    fn input(&mut self, draw: &mut Unstructured<'_>) -> Judged;
    /// Tries a file or folder of the corpus.
    fn file(&mut self, path: &Path) -> Judged;
    /// Writes the last input as it would lie in the corpus, where bytes alone do not make it again for ever.
    fn keep(&self, _to: &Path) -> std::io::Result<()> {
        Ok(())
    }
}

fn main() -> ExitCode {
    // The options' target runs the command itself, as a process of its own.
    let mut arguments = std::env::args_os();
    if arguments
        .nth(1)
        .is_some_and(|first| first == options::AS_VRE)
    {
        let rest = std::iter::once("vre".into()).chain(arguments);
        return host::cli::run(rest);
    }
    let arguments = Arguments::parse();
    let name = format!("{:?}", arguments.target).to_lowercase();
    let target: Result<Box<dyn Fuzz>, Error> = match arguments.target {
        Target::Campaign => campaign::Campaigns::new().map(|target| Box::new(target) as _),
        Target::Tables => Ok(Box::new(tables::Tables)),
        Target::Frames => Ok(Box::new(frames::Frames)),
        Target::Wire => Ok(Box::new(wire::Wire)),
        Target::Sealed => sealed::Sealed::new().map(|target| Box::new(target) as _),
        Target::Options => options::Options::new().map(|target| Box::new(target) as _),
    };
    match target {
        Ok(target) => run(&arguments, &name, target),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments, name: &str, mut target: Box<dyn Fuzz>) -> ExitCode {
    let mut findings = 0;
    let mut tell = |which: String, judged: Judged| {
        if let Err(finding) = judged {
            findings += 1;
            println!("FINDING {name} {which}: {finding}");
        }
        findings > 0 && !arguments.go_on
    };
    let files = corpus(name);
    for file in &files {
        let judged = judged(|| target.file(file));
        if tell(file.display().to_string(), judged) {
            return ExitCode::FAILURE;
        }
    }
    let end = Instant::now() + Duration::from_secs(arguments.seconds);
    let mut tried = 0;
    while tried < arguments.iterations && Instant::now() < end {
        let iteration = arguments.from + tried;
        let bytes = bytes(arguments.seed, iteration);
        let judged = judged(|| target.input(&mut Unstructured::new(&bytes)));
        tried += 1;
        if let (Err(_), Some(folder)) = (&judged, &arguments.keep)
            && let Err(error) = target.keep(&folder.join(format!("{}-{iteration}", arguments.seed)))
        {
            eprintln!("warning: {error}");
        }
        if tell(
            format!("--seed {} --from {iteration}", arguments.seed),
            judged,
        ) {
            return ExitCode::FAILURE;
        }
    }
    println!(
        "{name}: {} files, {tried} inputs, {findings} findings",
        files.len()
    );
    match findings {
        0 => ExitCode::SUCCESS,
        _ => ExitCode::FAILURE,
    }
}
