//! What the image costs, counted by the emulator: instructions, memory, time; and what a square root costs and is worth.
//!
//! Instructions are counted, cycles are not: the emulator lets each instruction take the same time, 10 ns, which at 168 MHz
//! is 1.7 cycles and a cautious mean for this core with its flash. What is said of load and time rests on that.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::time::Duration;

use addr2line::Loader;
use shared::compensate::{Mode, Source};
use shared::identify::static_test::Bench;
use shared::rectification::Covariance;
use shared::self_check::SetUp;
use shared::tumble::full_rank_plan;
use shared::wire::Command;
use shared::wire::configuration::{Calibration, Compensation, Configuration};
use shared::wire::message::{Approach, Coefficients, Position};

use crate::board::INSTRUCTIONS_PER_SECOND;
use crate::converter::Plain;
use crate::image::Rate;
use crate::{Conversation, Emulator, Error, Heard, Model, image};

/// Clock of the converter, Hz.
const CLOCK_HZ: u32 = 8_192_000;

/// Where moments and compensation are written.
const MATHEMATICS: [&str; 6] = [
    "shared/src/moments.rs",
    "shared/src/compensate.rs",
    "shared/src/rectification.rs",
    "shared/src/model.rs",
    "shared/src/vibration.rs",
    "shared/src/scalar.rs",
];

/// A figure, and the most that it may be.
#[derive(Clone, Debug)]
pub struct Figure {
    /// What it is.
    pub name: &'static str,
    /// How much.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// The budget, in the same unit.
    pub budget: Option<f64>,
}

/// The figures, one a line when printed.
#[derive(Clone, Debug)]
pub struct Table(pub Vec<Figure>);

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for figure in &self.0 {
            let Figure {
                name,
                value,
                unit,
                budget,
            } = figure;
            let digits = match *value {
                whole if whole.fract() == 0.0 || whole >= 100.0 => 0,
                small if small < 1.0 => 2,
                _ => 1,
            };
            write!(f, "{name:58} {value:10.digits$} {unit}")?;
            match budget {
                Some(budget) => writeln!(f, " (of {budget})")?,
                None => writeln!(f)?,
            }
        }
        Ok(())
    }
}

/// Something to convert on every channel, neither constant nor beyond 24 bits.
fn signal(conversion: u64) -> [i32; 4] {
    let wave = |step: u64, size: i32| {
        let phase = (conversion * step % 1024) as f64 / 1024.0;
        (f64::from(size) * (std::f64::consts::TAU * phase).sin()) as i32
    };
    [
        wave(37, 900_000),
        wave(37, 700_000),
        wave(41, 30_000),
        wave(11, 5_000),
    ]
}

/// Compensation with every coefficient and the whole covariance.
fn configuration(mode: Mode) -> Configuration {
    let covariance = Covariance::from_fn(|j, k| if j == k { 1e-12 } else { 1e-14 });
    let coefficients = Coefficients {
        nominal: [
            0.1, 2e-4, -6.2e-4, 3.9e-4, 2.7e-4, -4.9e-5, 3.8e-4, -6e-4, -4.6e-5, 2.6e-5, 5e-5,
        ],
        further: [7e-6, 2e-4, -3e-4, 1e-4, -8e-5],
    };
    Configuration {
        compensation: Compensation {
            mode: Some(mode),
            source: Source::Reference,
            block_samples: 40,
            nominal_v_per_g: 0.1,
            reference_v_per_g: [0.1; 3],
            reference_zero_v: [0.0; 3],
        },
        calibration: Some(Calibration {
            coefficients,
            covariance,
            rank: 11,
        }),
    }
}

/// A board in one of its ways of working, its memory at rest.
fn working(model: Model, rate: Rate, mode: Option<Mode>, raw: bool) -> Result<Conversation, Error> {
    let converter = Plain::new(CLOCK_HZ, signal);
    let board = Emulator::start_model_at(model, converter, rate, INSTRUCTIONS_PER_SECOND)?;
    let mut host = Conversation::with_board(board)?;
    if let Some(mode) = mode {
        host.replace(Some(configuration(mode).into()))?;
        host.heard();
        until_stored(&mut host)?;
    }
    host.command(&Command::StreamRaw { on: raw })?;
    host.listen(Duration::from_millis(100))?;
    Ok(host)
}

/// Lets time go by until the board has told what became of a writing; an erasure may come before it.
fn until_stored(host: &mut Conversation) -> Result<(), Error> {
    for _ in 0..100 {
        host.listen(Duration::from_millis(100))?;
        let told = |heard: &Heard| matches!(heard, Heard::Stored(..));
        if host.heard().iter().any(told) {
            return Ok(());
        }
    }
    Err(Error::Ended("nothing is told of a writing".into()))
}

/// Instructions a four-channel sample over two seconds, everything included; the board after it.
fn a_sample(
    model: Model,
    rate: Rate,
    mode: Option<Mode>,
    raw: bool,
) -> Result<(f64, Conversation), Error> {
    let mut host = working(model, rate, mode, raw)?;
    let count = |host: &Conversation| {
        (
            host.board.instructions(),
            host.board.converter().conversions(),
        )
    };
    let before = count(&host);
    host.listen(Duration::from_secs(2))?;
    let after = count(&host);
    Ok((
        (after.0 - before.0) as f64 / (after.1 - before.1) as f64,
        host,
    ))
}

/// How many of the executed instructions come from source files whose path ends so, inlined ones included.
fn written_in(
    executed: &BTreeMap<u64, u64>,
    loader: &Loader,
    is_one: impl Fn(&str) -> bool,
) -> u64 {
    let comes_from = |address: u64| {
        let Ok(mut frames) = loader.find_frames(address) else {
            return false;
        };
        while let Ok(Some(frame)) = frames.next() {
            if frame.location.and_then(|l| l.file).is_some_and(&is_one) {
                return true;
            }
        }
        false
    };
    let counted = executed.iter().filter(|(address, _)| comes_from(**address));
    counted.map(|(_, count)| count).sum()
}

/// Instructions a sample that are written in the files of the mathematics.
fn of_mathematics(mode: Mode, loader: &Loader) -> Result<f64, Error> {
    let mut host = working(Model::F429, Rate::X1024, Some(mode), false)?;
    let before = host.board.converter().conversions();
    let executed = host.board.trace(Duration::from_millis(100))?;
    let samples = host.board.converter().conversions() - before;
    let is_one = |file: &str| MATHEMATICS.iter().any(|name| file.ends_with(name));
    Ok(written_in(&executed, loader, is_one) as f64 / samples as f64)
}

/// A whole static test of 40 short readings and its outcome, on a painted stack: milliseconds from the last command to the
/// outcome, and bytes of stack that were used.
fn self_check() -> Result<(f64, f64), Error> {
    let mut host = Conversation::start(Plain::new(CLOCK_HZ, signal))?;
    host.replace(Some(configuration(Mode::Block).into()))?;
    host.command(&Command::StreamRaw { on: true })?;
    let set_up = SetUp {
        bench: Bench {
            dial_sigma_rad: 5e-6,
            dial_repeat_sigma_rad: 1e-6,
            mount_sigma_rad: 3e-4,
            level_sigma_rad: 5e-6,
            local_gravity_g: 1.0,
        },
        nominal_v_per_g: 0.1,
        reference_v_per_g: None,
    };
    host.command(&Command::BeginCheck(set_up))?;
    for (position, reading) in full_rank_plan().zip(0..) {
        host.command(&Command::StartPosition(Position {
            reading,
            series: position.series.into(),
            dial_deg: position.dial_deg,
            mount_deg: position.mount_deg,
            approach: Approach::Cw,
        }))?;
        host.listen(Duration::from_millis(50))?;
        host.command(&Command::StopPosition)?;
    }
    host.command(&Command::StreamRaw { on: false })?;
    host.listen(Duration::from_millis(100))?;
    host.heard();
    let before = host.board.now();
    host.send(&Command::Conclude);
    while host.board.now() - before < Duration::from_secs(2) {
        host.listen(Duration::from_micros(100))?;
        let outcome = |heard: &Heard| matches!(heard, Heard::Check(_));
        if host.heard().iter().any(outcome) {
            let took = host.board.now() - before;
            let used = host.board.stack_used()?;
            return Ok((took.as_secs_f64() * 1e3, used as f64));
        }
    }
    Err(Error::Ended("no outcome of the self-check".into()))
}

/// Bytes of these sections.
fn bytes(loader: &Loader, sections: &[&str]) -> f64 {
    let range = |name: &&str| loader.get_section_range(name.as_bytes());
    let sizes = sections.iter().filter_map(range);
    sizes.map(|range| (range.end - range.begin) as f64).sum()
}

fn loader(path: &Path) -> Result<Loader, Error> {
    Loader::new(path).map_err(|error| Error::Ended(format!("{}: {error}", path.display())))
}

/// Measures everything. Takes some 20 s.
pub fn table() -> Result<Table, Error> {
    let loader = loader(&image::path()?)?;
    let mut figures = Vec::new();
    let mut add = |name, value, unit, budget| {
        figures.push(Figure {
            name,
            value,
            unit,
            budget,
        });
    };
    let load = |a_sample: f64, rate_hz: f64| {
        100.0 * a_sample * rate_hz / INSTRUCTIONS_PER_SECOND.get() as f64
    };
    let (plain, _) = a_sample(Model::F429, Rate::X1024, None, false)?;
    let (block, _) = a_sample(Model::F429, Rate::X1024, Some(Mode::Block), false)?;
    let (point, _) = a_sample(Model::F429, Rate::X1024, Some(Mode::Pointwise), false)?;
    let (raw, _) = a_sample(Model::F429, Rate::X1024, Some(Mode::Block), true)?;
    let (fast, mut host) = a_sample(Model::F429, Rate::X256, Some(Mode::Block), false)?;
    let (other, _) = a_sample(Model::H743, Rate::X1024, Some(Mode::Block), false)?;
    let (other_raw, _) = a_sample(Model::H743, Rate::X1024, Some(Mode::Block), true)?;
    let state = host.state()?;
    let lost = state.map_or(f64::NAN, |state| {
        (state.lost + state.dropped_samples) as f64
    });

    let sample = "instructions a sample";
    add("4 kSPS, blocks", plain, sample, None);
    add("4 kSPS, blocks, compensated", block, sample, Some(1100.0));
    add(
        "4 kSPS, blocks, compensated point by point",
        point,
        sample,
        None,
    );
    add(
        "4 kSPS, blocks, compensated, and raw samples",
        raw,
        sample,
        Some(1320.0),
    );
    let mathematics = of_mathematics(Mode::Block, &loader)?;
    add(
        "of them moments and compensation by blocks",
        mathematics,
        sample,
        Some(300.0),
    );
    let mathematics = of_mathematics(Mode::Pointwise, &loader)?;
    add(
        "of them moments and compensation point by point",
        mathematics,
        sample,
        Some(460.0),
    );
    add(
        "16 kSPS, blocks of 40 samples, compensated",
        fast,
        sample,
        None,
    );
    add(
        "lost or dropped of them in two seconds",
        lost,
        "samples",
        Some(0.0),
    );
    add(
        "load at 4 kSPS, at 1.7 cycles an instruction",
        load(block, 4e3),
        "%",
        None,
    );
    add(
        "load at 16 kSPS, at 1.7 cycles an instruction",
        load(fast, 16e3),
        "%",
        None,
    );

    add(
        "NUCLEO-H743ZI2 at 4 kSPS, blocks, compensated",
        other,
        sample,
        None,
    );
    add("the same, and raw samples", other_raw, sample, None);

    for section in [
        ".vector_table",
        ".text",
        ".rodata",
        ".data",
        ".bss",
        ".uninit",
    ] {
        add(section, bytes(&loader, &[section]), "bytes", None);
    }
    let flash = bytes(&loader, &[".vector_table", ".text", ".rodata", ".data"]);
    add("flash", flash, "bytes", Some(image::FLASH_BUDGET as f64));
    let ram = bytes(&loader, &[".data", ".bss", ".uninit"]);
    add("static RAM", ram, "bytes", Some(33_452.0));
    let (took_ms, stack) = self_check()?;
    add(
        "stack, most of it in use, self-check included",
        stack,
        "bytes",
        None,
    );
    add(
        "self-check of 40 readings, from command to outcome",
        took_ms,
        "ms at 1.7 cycles an instruction",
        None,
    );
    Ok(Table(figures))
}

/// The square roots of `libm` and of `micromath`, the two that the hot path could call: instructions, and the largest
/// relative error over every mantissa that is a multiple of 2^-12.
pub fn roots() -> Result<Table, Error> {
    let path = image::example("roots")?;
    let loader = loader(&path)?;
    let mut board = Emulator::start_image(Plain::new(CLOCK_HZ, signal), &path)?;
    let executed = board.trace(Duration::from_millis(2))?;
    let mut figures = Vec::new();
    let mut add = |name, value, unit| {
        figures.push(Figure {
            name,
            value,
            unit,
            budget: None,
        });
    };
    // The first instruction of a function that is never inlined is executed once a call.
    let calls = |function: &str| {
        let entry = executed.iter().filter(|(address, _)| {
            // The lowest bit of a function's address says that its instructions are Thumb's.
            let entry = **address | 1;
            let symbol = loader.find_symbol_info(entry);
            symbol.is_some_and(|s| s.address() == entry && s.name().contains(function))
        });
        entry.map(|(_, count)| *count as f64).sum::<f64>()
    };
    let instructions =
        |library: &str| written_in(&executed, &loader, |file| file.contains(library));
    let libm = instructions("/libm-") as f64 / calls("libm_root");
    let micromath = instructions("/micromath-") as f64 / calls("micromath_root");
    add("square root of libm", libm, "instructions");
    add("square root of micromath", micromath, "instructions");
    let error = |root: fn(f32) -> f32| {
        let mantissas = (0..3 << 12).map(|k| 1.0 + k as f32 / 4096.0);
        let relative = mantissas.map(|x| (f64::from(root(x)) / f64::from(x).sqrt() - 1.0).abs());
        relative.fold(0.0, f64::max) * 1e6
    };
    add("its relative error, libm", error(libm::sqrtf), "1e-6");
    add(
        "its relative error, micromath",
        error(micromath::F32Ext::sqrt),
        "1e-6",
    );
    Ok(Table(figures))
}

/// Instructions a sample by function, those first that take most: a way of working, traced for a tenth of a second.
pub fn by_function(
    model: Model,
    mode: Option<Mode>,
    raw: bool,
) -> Result<Vec<(String, f64)>, Error> {
    let loader = loader(&image::path_of(model, Rate::X1024)?)?;
    let mut host = working(model, Rate::X1024, mode, raw)?;
    let before = host.board.converter().conversions();
    let executed = host.board.trace(Duration::from_millis(100))?;
    let samples = (host.board.converter().conversions() - before) as f64;
    let mut functions = BTreeMap::<String, f64>::new();
    for (address, count) in executed {
        // The lowest bit of a function's address says that its instructions are Thumb's.
        let symbol = loader.find_symbol_info(address | 1);
        let name = symbol.map_or("?", |symbol| symbol.name());
        let name = addr2line::demangle_auto(name.into(), None).into_owned();
        *functions.entry(name).or_default() += count as f64 / samples;
    }
    let mut functions: Vec<_> = functions.into_iter().collect();
    functions.sort_by(|a, b| b.1.total_cmp(&a.1));
    Ok(functions)
}
