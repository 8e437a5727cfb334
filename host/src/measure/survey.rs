//! A record at a glance: how strongly each piece of it shakes, and where it is at rest, on a plateau, or on a ramp.

use std::ops::Range;

use super::spread::Spread;
use crate::median::{MEDIAN_TO_SIGMA, median};

/// Samples of the shortest pieces.
const SHORTEST: u64 = 64;

/// Most pieces; beyond, they are joined in pairs.
const MOST: usize = 1 << 14;

/// Fewest pieces of a rest or a plateau.
const FEWEST: usize = 8;

/// A plateau shakes at least so much more than a rest, in rms. Chosen, as for a vibration that is to explain a shift.
pub(super) const LOUDER: f64 = 1.5;

/// What is kept of each piece of a record, in constant memory.
#[derive(Clone, Debug)]
pub struct Survey {
    length: u64,
    pieces: Vec<Vec<Spread>>,
    filling: Vec<Spread>,
    rows: u64,
    times: Option<[f64; 2]>,
}

/// What a stretch of a record is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stretch {
    /// Nothing shakes.
    Rest,
    /// The vibration keeps its strength.
    Plateau,
}

impl Survey {
    /// Of nothing yet, of so many columns.
    pub fn new(columns: usize) -> Self {
        Self {
            length: SHORTEST,
            pieces: Vec::new(),
            filling: vec![Spread::default(); columns],
            rows: 0,
            times: None,
        }
    }

    /// Takes the row of a time, in g.
    pub fn push(&mut self, outputs_g: &[f64], time_s: Option<f64>) {
        for (spread, &output) in self.filling.iter_mut().zip(outputs_g) {
            spread.add(output);
        }
        self.rows += 1;
        if let Some(time) = time_s {
            let [from, to] = self.times.unwrap_or([time, time]);
            self.times = Some([from.min(time), to.max(time)]);
        }
        if self.rows.is_multiple_of(self.length) {
            let next = vec![Spread::default(); self.filling.len()];
            self.pieces.push(std::mem::replace(&mut self.filling, next));
            if self.pieces.len() == MOST {
                self.pieces = joined(&self.pieces, 2);
                self.length *= 2;
            }
        }
    }

    /// From the first time to the last, s; or in rows.
    pub fn extent(&self) -> [f64; 2] {
        self.times.unwrap_or([0.0, self.rows as f64])
    }

    /// Root of the sum over columns of the variances in each of about `count` pieces of equal length, g.
    pub fn profile(&self, count: usize) -> Vec<f64> {
        let by = self.pieces.len().div_ceil(count.max(1)).max(1);
        joined(&self.pieces, by)
            .iter()
            .map(|piece| shake(piece))
            .collect()
    }

    /// Rests and plateaus as ranges of rows.
    pub fn stretches(&self) -> Vec<(Stretch, Range<u64>)> {
        let by = self.periods();
        let pieces = joined(&self.pieces, by);
        let length = self.length * by as u64;
        let profile: Vec<f64> = pieces.iter().map(|piece| shake(piece)).collect();
        let Some(rest) = quietest(&profile) else {
            return Vec::new();
        };
        let loud = |&shake: &f64| shake > LOUDER * rest;
        let tolerance = tolerance(&profile);
        let mut found = Vec::new();
        let mut at = 0;
        for run in profile.chunk_by(|a, b| loud(a) == loud(b)) {
            let place = at..at + run.len();
            at += run.len();
            if loud(&run[0]) {
                let steady = plateaus(run, tolerance).into_iter();
                found.extend(
                    steady.map(|p| (Stretch::Plateau, place.start + p.start..place.start + p.end)),
                );
            } else {
                // Pieces next to a louder one hold its beginning or end.
                let from = place.start + usize::from(place.start > 0);
                let to = place.end - usize::from(place.end < profile.len());
                if from + FEWEST <= to {
                    found.push((Stretch::Rest, from..to));
                }
            }
        }
        let rows = |place: Range<usize>| place.start as u64 * length..place.end as u64 * length;
        found
            .into_iter()
            .map(|(kind, place)| (kind, rows(place)))
            .collect()
    }

    /// How many pieces to join so that a piece holds some periods of the vibration: its mean then scatters little, compared
    /// with what shakes in it.
    fn periods(&self) -> usize {
        let mut by = 1;
        while self.pieces.len() / (2 * by) >= 4 * FEWEST {
            let pieces = joined(&self.pieces, by);
            let loudest = pieces.iter().map(|piece| shake(piece)).fold(0.0, f64::max);
            let pairs = pieces
                .windows(2)
                .filter(|pair| shake(&pair[0]) > 0.25 * loudest);
            let ratios = pairs.map(|pair| {
                let means = pair[0].iter().zip(&pair[1]);
                let step: f64 = means.map(|(a, b)| (a.mean - b.mean).powi(2)).sum();
                0.5 * step / shake(&pair[0]).powi(2).max(f64::MIN_POSITIVE)
            });
            if median(ratios.collect()).is_none_or(|ratio| ratio < 0.02) {
                break;
            }
            by *= 2;
        }
        by
    }
}

fn shake(piece: &[Spread]) -> f64 {
    let variances = piece
        .iter()
        .map(|column| column.standard_deviation().powi(2));
    variances.sum::<f64>().sqrt()
}

/// The pieces joined by so many.
fn joined(pieces: &[Vec<Spread>], by: usize) -> Vec<Vec<Spread>> {
    let all = pieces.chunks_exact(by);
    all.map(|group| {
        let mut sum = group[0].clone();
        for piece in &group[1..] {
            sum.iter_mut().zip(piece).for_each(|(a, b)| a.join(b));
        }
        sum
    })
    .collect()
}

/// What shakes at rest: the tenth part from below, among pieces that are not dead still if there are such.
fn quietest(profile: &[f64]) -> Option<f64> {
    let mut sorted: Vec<f64> = profile.to_vec();
    sorted.sort_by(f64::total_cmp);
    let tenth = *sorted.get(sorted.len() / 10)?;
    let alive = sorted.iter().copied().find(|&shake| shake > 0.0)?;
    Some(tenth.max(alive))
}

/// How far the logarithm of the rms of a steady vibration strays: five times the scatter from piece to piece, at least 5 %.
fn tolerance(profile: &[f64]) -> f64 {
    let logs = profile
        .windows(2)
        .filter(|pair| pair[0] > 0.0 && pair[1] > 0.0);
    let steps = logs.map(|pair| (pair[1] / pair[0]).ln().abs()).collect();
    let scatter = MEDIAN_TO_SIGMA * median(steps).unwrap_or(0.0) / 2f64.sqrt();
    (5.0 * scatter).clamp(0.05, 0.5)
}

/// Steady runs of a loud stretch.
fn plateaus(run: &[f64], tolerance: f64) -> Vec<Range<usize>> {
    let logs: Vec<f64> = run.iter().map(|shake| shake.ln()).collect();
    let mut found = Vec::new();
    let mut from = 0;
    while from < logs.len() {
        let mut sum = 0.0;
        let steady = logs[from..].iter().enumerate().take_while(|(n, log)| {
            let within = *n == 0 || (*log - sum / *n as f64).abs() <= tolerance;
            sum += *log;
            within
        });
        let to = from + steady.count().max(1);
        if let Some(place) = trimmed(&logs, from..to) {
            found.push(place);
        }
        from = to;
    }
    found
}

/// A run without its ends, which can be of a ramp; `None` if it is short or one ramp as a whole.
fn trimmed(logs: &[f64], run: Range<usize>) -> Option<Range<usize>> {
    if run.len() < FEWEST + 2 {
        return None;
    }
    let quarter = run.len() / 4;
    let middle = median(logs[run.start + quarter..run.end - quarter].to_vec())?;
    let steps = logs[run.clone()]
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs());
    let scatter = MEDIAN_TO_SIGMA * median(steps.collect())? / 2f64.sqrt();
    let near = (2.0 * scatter).max(END);
    let off = |n: &usize| (logs[*n] - middle).abs() > near;
    let from = 1 + run.clone().take_while(off).last().unwrap_or(run.start);
    let to = run
        .clone()
        .rev()
        .take_while(off)
        .last()
        .unwrap_or(run.end - 1);
    let place = from..to;
    // Of a ramp the most is cut off.
    if place.len() < FEWEST || 2 * place.len() < run.len() {
        return None;
    }
    // The change along the run, against what is left about the line.
    let n = place.len() as f64;
    let half = 0.5 * (n - 1.0);
    let values = || place.clone().map(|at| logs[at]);
    let mean = values().sum::<f64>() / n;
    let moment: f64 = values()
        .enumerate()
        .map(|(k, y)| (k as f64 - half) * (y - mean))
        .sum();
    let slope = moment / (n * (n * n - 1.0) / 12.0);
    let residual: Spread = values()
        .enumerate()
        .map(|(k, y)| y - mean - slope * (k as f64 - half))
        .collect();
    let scatter = residual.standard_deviation() * (12.0 / n).sqrt();
    ((slope * n).abs() < (3.0 * scatter).max(RAMP)).then_some(place)
}

/// Change of the logarithm of the rms along a plateau from which on it is a ramp. Chosen: 3 % of amplitude are 6 % of
/// vibration error.
const RAMP: f64 = 0.03;

/// How near the logarithm of the rms comes to that of the plateau before a ramp ends. Chosen: 0.5 % of amplitude are 1 % of
/// vibration error, over a few pieces of the plateau.
const END: f64 = 0.005;
