//! The person at the terminal: one line for what is next, one for each reading, one letter for each wish.

use std::io::{self, BufRead};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use super::Console;
use crate::attended::Operator;
use crate::error::Error;
use crate::walk::{Phase, ReadingView, StopView, View, Wish};

const KEYS: &str = "Enter to measure, r to redo the last, s to skip, w to swap series, b for the best next, p to pause, \
c and a remark, t and a temperature, q to stop";

/// The person at the terminal.
pub(super) struct Terminal<'c> {
    console: &'c Console,
    lines: Receiver<String>,
    /// What was told last: the stop, its phase's name and the message.
    told: Option<(Option<usize>, bool, String)>,
    readings: usize,
    enough: bool,
}

impl<'c> Terminal<'c> {
    pub(super) fn new(console: &'c Console) -> Self {
        let (to, lines) = channel();
        // Waits for the terminal until the program ends.
        thread::spawn(move || {
            for line in io::stdin().lock().lines().map_while(Result::ok) {
                if to.send(line).is_err() {
                    return;
                }
            }
        });
        Self {
            console,
            lines,
            told: None,
            readings: 0,
            enough: false,
        }
    }

    fn reading(&self, reading: &ReadingView) -> Result<(), Error> {
        let mark = if reading.sound { "ok" } else { "RED" };
        self.console.print(format!(
            "  {mark}: {:+.7} g +- {:.1e}; {}",
            reading.output_g, reading.sigma_g, reading.reason
        ))
    }

    fn vre(&mut self, view: &View) -> Result<(), Error> {
        let Some(vre) = &view.vre else { return Ok(()) };
        let (text, environment) = (&vre.text, &vre.environment);
        self.console
            .print(format!("  vibration error in {environment}: {text} 1e-6 g"))?;
        if vre.enough == Some(true) && !self.enough {
            self.enough = true;
            self.console
                .print("  that is enough: q stops, Enter goes on")?;
        }
        Ok(())
    }

    fn stop(&self, view: &View, at: usize, stop: &StopView) -> Result<(), Error> {
        let sense = match stop.approach {
            "cw" => "clockwise",
            _ => "counter-clockwise",
        };
        // The keys are explained once.
        let keys = if self.told.is_none() {
            format!("; {KEYS}")
        } else {
            String::new()
        };
        self.console.print(format!(
            "{} of {}: series {}, mounted at {} deg: dial {} deg, {sense}{keys}",
            at + 1,
            view.stops.len(),
            stop.series,
            stop.mount_deg,
            stop.dial_deg,
        ))
    }
}

impl Operator for Terminal<'_> {
    fn show(&mut self, view: &View) -> Result<(), Error> {
        if let [.., last] = view.readings.as_slice()
            && view.readings.len() > self.readings
        {
            self.reading(last)?;
            self.vre(view)?;
        }
        self.readings = view.readings.len();
        let paused = view.phase == Phase::Paused;
        if !paused && view.phase != Phase::Place {
            return Ok(());
        }
        let now = (view.at, paused, view.message.clone());
        if self.told.as_ref() == Some(&now) {
            return Ok(());
        }
        if !view.message.is_empty() {
            self.console.print(&view.message)?;
        }
        match (
            paused,
            view.at.and_then(|at| Some((at, view.stops.get(at)?))),
        ) {
            (true, _) => self.console.print("paused; Enter goes on")?,
            (false, Some((at, stop))) => self.stop(view, at, stop)?,
            (false, None) => {}
        }
        self.told = Some(now);
        Ok(())
    }

    fn wish(&mut self, waits: bool) -> Option<Wish> {
        // A line that is typed ahead is for the next position.
        if !waits {
            return None;
        }
        match self.lines.try_recv() {
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Wish::Stop),
            Ok(line) => understood(line.trim()),
        }
    }
}

/// What a line wishes; nothing if it is not understood.
fn understood(line: &str) -> Option<Wish> {
    let (key, rest) = line.split_at(line.chars().next().map_or(0, char::len_utf8));
    match (key, rest.trim()) {
        ("", _) => Some(Wish::Measure),
        ("r", "") => Some(Wish::Redo { reading: None }),
        ("r", number) => Some(Wish::Redo {
            reading: Some(number.parse().ok()?),
        }),
        ("s", "") => Some(Wish::Skip),
        ("w", "") => Some(Wish::SwapSeries),
        ("b", "") => Some(Wish::Best),
        ("p", "") => Some(Wish::Pause),
        ("q", "") => Some(Wish::Stop),
        ("c", text) => Some(Wish::Remark { text: text.into() }),
        ("t", temp_c) => Some(Wish::Temperature {
            temp_c: temp_c.parse().ok()?,
        }),
        _ => None,
    }
}
