//! `vre bring-up`

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde::Serialize;
use shared::channels::CHANNELS;
use shared::compensate::Source as MomentsOf;
use shared::wire::board::{BoardState, Cause, TimeBase};
use shared::wire::configuration::{Certified, Compensation, Configuration};
use shared::wire::message::{Command as Ask, Event, Identity, State};

use super::{Command, Console, within};
use crate::campaign::ranges;
use crate::error::Error;
use crate::link::Link;
use crate::source::{BAUD, SerialSource, Source};

/// The first hour with a board: measure what an emulator cannot show, and say what must be seen
#[derive(clap::Args)]
#[command(after_help = "Examples:
  vre bring-up --port /dev/ttyACM0
  vre bring-up --port /dev/ttyACM0 --shorted             with the converter's inputs shorted
  vre bring-up --port /dev/ttyACM0 --write               writes the memory and erases it again")]
pub struct BringUp {
    /// The instrument's serial port
    #[arg(long, value_name = "DEV")]
    port: PathBuf,
    /// Speed of the line
    #[arg(long, value_name = "BAUD", default_value_t = BAUD)]
    baud: u32,
    /// How long to measure, s
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = within(&ranges::DURATION))]
    time: f64,
    /// The converter's inputs are shorted: judge its noise and offset
    #[arg(long)]
    shorted: bool,
    /// Write the memory and read it back; refused where it keeps something
    #[arg(long)]
    write: bool,
}

/// One measurement.
#[derive(Debug, Serialize)]
struct Row {
    name: &'static str,
    seen: String,
    /// What must be seen.
    wanted: &'static str,
    /// `None`: only told.
    passed: Option<bool>,
}

/// Full scale of a code.
const HALF_RANGE: f64 = 8_388_608.0;

/// Largest difference of two crystals, relative: twice 50 ppm, what either is sold with.
const CRYSTALS: f64 = 1e-4;

/// The internal oscillator at room temperature (DS9405, table 41: 1 % at 25 degrees).
const INTERNAL: f64 = 0.01;

/// Least part of the line that raw samples fill at 1 Mbaud and 4 kSPS: 12 bytes each, 8 bits of 10.
const RAW_BYTES_A_SAMPLE: f64 = 12.0;

/// Noise with shorted inputs at gain 1 and a ratio of 1024: 5.35 uV rms (data sheet SBAS890, table 1) are 37 codes. A third
/// and three times that are wrong settings, an open input or a supply that is not clean.
const NOISE_CODES: f64 = 37.0;
const NOISE_FACTOR: f64 = 3.0;

/// Stack that must stay free, bytes: what the deepest interrupt and its frame take, four times.
const STACK_FREE: u32 = 4096;

impl Command for BringUp {
    fn run(self, console: &Console) -> Result<(), Error> {
        let time = Duration::try_from_secs_f64(self.time)
            .map_err(|_| Error::Usage(format!("--time {}: is too long", self.time)))?;
        let mut link = Link::unrecorded(SerialSource::open(&self.port, self.baud)?)?;
        let mut rows = measure(&mut link, time, self.shorted)?;
        if self.write {
            rows.push(write_and_read_back(&mut link)?);
        }
        console.as_told(text(&rows), &rows)?;
        match rows.iter().filter(|row| row.passed == Some(false)).count() {
            0 => Ok(()),
            failed => Err(Error::Link {
                source_name: self.port.display().to_string(),
                problem: format!(
                    "{failed} of {} measurements are not what must be seen",
                    rows.len()
                ),
            }),
        }
    }
}

fn text(rows: &[Row]) -> String {
    let mut text = String::new();
    for row in rows {
        let mark = match row.passed {
            Some(true) => "ok",
            Some(false) => "NOT",
            None => "",
        };
        let _ = writeln!(text, "{mark:4}{:30}{:32}{}", row.name, row.seen, row.wanted);
    }
    text.trim_end().into()
}

/// What comes in a stretch of time.
#[derive(Default)]
struct Heard {
    raw_samples: u64,
    /// Samples, their sum, and the sum of their squares about the blocks' means, of each channel.
    samples: f64,
    sum: [f64; CHANNELS],
    squares: [f64; CHANNELS],
}

impl Heard {
    fn take(&mut self, event: &Event<'_>) {
        match event {
            Event::Raw(raw) => self.raw_samples += raw.samples().len() as u64,
            Event::Block(block) => {
                let count = f64::from(block.count);
                self.samples += count;
                for k in 0..CHANNELS {
                    self.sum[k] += block.moments.sum[k] as f64;
                    self.squares[k] += count * f64::from(block.moments.second[k]);
                }
            }
            _ => {}
        }
    }

    fn mean(&self, channel: usize) -> f64 {
        self.sum[channel] / self.samples.max(1.0)
    }

    fn rms(&self, channel: usize) -> f64 {
        (self.squares[channel] / self.samples.max(1.0)).sqrt()
    }
}

/// Everything that leaves the instrument as it is.
fn measure<S: Source>(
    link: &mut Link<S>,
    time: Duration,
    shorted: bool,
) -> Result<Vec<Row>, Error> {
    let identity = link.greet()?;
    let (before, _) = link.ask_state()?;
    let tally_before = link.tally();
    let mut heard = Heard::default();
    link.command(&Ask::StreamRaw { on: true })?;
    let begun = Instant::now();
    link.listen_to(time, &mut |event| heard.take(event))?;
    let seconds = begun.elapsed().as_secs_f64();
    link.command(&Ask::StreamRaw { on: false })?;
    let (after, board) = link.ask_state()?;
    let tally = link.tally();
    let spoilt = (tally.missing_frames - tally_before.missing_frames)
        + (tally.damaged_bytes - tally_before.damaged_bytes);

    let mut rows = start(&board);
    rows.push(link_rate(&heard, &identity, seconds, spoilt));
    rows.push(beat(&before, &after, &identity, board.time_base));
    rows.push(frames(&before, &after));
    rows.push(losses(&before, &after));
    rows.push(Row {
        name: "line errors, time-outs",
        seen: format!("{}, {}", board.line_errors, board.line_timeouts),
        wanted: "0, 0",
        passed: Some((board.line_errors, board.line_timeouts) == (0, 0)),
    });
    rows.push(stack(&board));
    rows.push(temperature(&board));
    rows.push(Row {
        name: "pulse of the vehicle's time",
        seen: board
            .pulse
            .map_or("none".into(), |pulse| format!("{} pulses", pulse.count)),
        wanted: "one a second, where it is wired",
        passed: None,
    });
    rows.extend((0..CHANNELS).map(|channel| noise(&heard, &identity, channel, shorted)));
    Ok(rows)
}

/// What the board says of its start.
fn start(board: &BoardState) -> Vec<Row> {
    let cause = match board.cause {
        Cause::Panic(place) => format!("panic in {}:{}", place.file(), place.line),
        cause => format!("{cause:?}"),
    };
    vec![
        Row {
            name: "cause of the last reset",
            seen: format!("{cause}, start {}", board.boots),
            wanted: "Power, Pin, or Software after flashing",
            passed: Some(matches!(
                board.cause,
                Cause::Power | Cause::Pin | Cause::Software
            )),
        },
        Row {
            name: "clock",
            seen: format!("{:?}", board.time_base),
            wanted: "External",
            passed: Some(board.time_base == TimeBase::External),
        },
        Row {
            name: "brown-out level 3",
            seen: if board.brown_out_guarded {
                "set"
            } else {
                "not set"
            }
            .into(),
            wanted: "set; see docs/bring-up.md",
            passed: Some(board.brown_out_guarded),
        },
        Row {
            name: "write-protect pin",
            seen: if board.write_protected {
                "closed"
            } else {
                "open"
            }
            .into(),
            wanted: "as the jumper is",
            passed: None,
        },
    ]
}

fn link_rate(heard: &Heard, identity: &Identity, seconds: f64, spoilt: u64) -> Row {
    let rate_hz = heard.raw_samples as f64 / seconds;
    Row {
        name: "raw samples over the line",
        seen: format!(
            "{:.1} kB/s, {spoilt} spoilt",
            rate_hz * RAW_BYTES_A_SAMPLE * 1e-3
        ),
        wanted: "as many as are converted, none spoilt",
        // What is under way at both ends.
        passed: Some(spoilt == 0 && rate_hz > 0.98 * identity.sample_rate_hz),
    }
}

/// The converter's clock against the board's.
fn beat(before: &State, after: &State, identity: &Identity, time_base: TimeBase) -> Row {
    let us = after.clock_us.saturating_sub(before.clock_us).max(1) as f64;
    let made = after.conversions.saturating_sub(before.conversions) as f64;
    let rate_hz = made / us * 1e6;
    let off = rate_hz / identity.sample_rate_hz - 1.0;
    // A conversion more or less at either end.
    let allowed = 2.0 / made.max(1.0)
        + match time_base {
            TimeBase::External => CRYSTALS,
            TimeBase::Internal => INTERNAL,
        };
    Row {
        name: "DRDY against the board's clock",
        seen: format!("{rate_hz:.2} Hz, {:+.0} ppm", off * 1e6),
        wanted: "the nominal rate within 100 ppm",
        passed: Some(off.abs() <= allowed),
    }
}

fn frames(before: &State, after: &State) -> Row {
    let wrong = after
        .converter_checksum_errors
        .wrapping_sub(before.converter_checksum_errors);
    let set_ups = after.converter_resets.wrapping_sub(before.converter_resets);
    Row {
        name: "converter: wrong CRC, set-ups",
        seen: format!("{wrong}, {set_ups}"),
        wanted: "0, 0",
        passed: Some((wrong, set_ups) == (0, 0)),
    }
}

fn losses(before: &State, after: &State) -> Row {
    let lost = after.lost.wrapping_sub(before.lost);
    let dropped = after.dropped_samples.wrapping_sub(before.dropped_samples);
    Row {
        name: "conversions lost, dropped",
        seen: format!("{lost}, {dropped}"),
        wanted: "0, 0",
        passed: Some((lost, dropped) == (0, 0)),
    }
}

fn stack(board: &BoardState) -> Row {
    Row {
        name: "stack never used",
        seen: board
            .stack_free
            .map_or("not told".into(), |free| format!("{free} bytes")),
        wanted: "more than 4096 bytes",
        passed: board.stack_free.map(|free| free > STACK_FREE),
    }
}

fn temperature(board: &BoardState) -> Row {
    let told = |t: Option<f32>| t.map_or("no sensor".into(), |t| format!("{t:.1} deg C"));
    Row {
        name: "temperature: board, instrument",
        seen: format!("{}, {}", told(board.board_c), told(board.instrument_c)),
        wanted: "the room's, and some 5 to 15 K more",
        passed: board.board_c.map(|t| (0.0..60.0).contains(&t)),
    }
}

fn noise(heard: &Heard, identity: &Identity, channel: usize, shorted: bool) -> Row {
    const NAMES: [&str; CHANNELS] = [
        "channel 0, the instrument",
        "channel 1, reference I",
        "channel 2, reference P",
        "channel 3, reference O",
    ];
    let (mean, rms) = (heard.mean(channel), heard.rms(channel));
    let gain = f64::from(identity.gains[channel].max(1));
    let mv = mean / HALF_RANGE * identity.reference_v / gain * 1e3;
    let likely = (NOISE_CODES / NOISE_FACTOR..=NOISE_CODES * NOISE_FACTOR).contains(&rms);
    Row {
        name: NAMES[channel],
        seen: format!("{mv:+.3} mV, noise {rms:.1} codes rms"),
        wanted: if shorted {
            "within 1 mV, 12 to 111 codes"
        } else {
            "short the inputs and say --shorted"
        },
        passed: shorted.then_some(likely && mv.abs() < 1.0),
    }
}

/// Keeps something that compensates nothing, asks for it, and erases it.
fn write_and_read_back<S: Source>(link: &mut Link<S>) -> Result<Row, Error> {
    let row = |seen: String, passed| Row {
        name: "memory: write, read, erase",
        seen,
        wanted: "reads what was written, then nothing",
        passed: Some(passed),
    };
    let before = link.ask_configuration()?;
    if before.certified.is_some() {
        return Ok(row("it keeps a configuration".into(), false));
    }
    let trial = Certified::from(Configuration {
        compensation: Compensation {
            mode: None,
            source: MomentsOf::Instrument,
            block_samples: 40,
            nominal_v_per_g: 1.0,
            reference_v_per_g: [1.0; 3],
            reference_zero_v: [0.0; 3],
        },
        calibration: None,
    });
    let written = link.replace(before.writes, Some(trial))?;
    let erased = link.replace(written.writes, None)?;
    let fault = written.fault.or(erased.fault);
    let seen = match fault {
        Some(fault) => format!("{fault:?}"),
        None => format!("written {} times", erased.writes),
    };
    let sound = fault.is_none()
        && written.certified == Some(trial)
        && erased.certified.is_none()
        && erased.writes == before.writes + 2;
    Ok(row(seen, sound))
}
