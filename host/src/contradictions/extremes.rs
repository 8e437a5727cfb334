//! The commanded level against the extremes of the output.
//!
//! What the reference does not see, the extremes do: a resonant fixture, which changes with the frequency, and a limit of the
//! output, which no run goes beyond. Both are told from a slip by their neighbours.

use super::likely::{self, Wrong};
use super::robust::{common_factor, median, near, scale_v_per_g};
use super::{Contradiction, LEAST_RMS_G, LEVEL, all_of, commanded_rms_g, main_axis, runs};
use crate::campaign::{Campaign, Run, VibrationKind};

/// Factor by which command and extremes may differ: a drive that its controller sets 6 % too high stays within.
const OFF: f64 = 1.10;

/// Vibration over command that is an instrument's or a reference's fault, not a person's: the effect `reference-scale` holds
/// it, and the fit tells it from others. The factor of a slip (sqrt 2) is asked about all the same.
const OF_AN_EFFECT: std::ops::RangeInclusive<f64> = 0.7..=1.3;

/// How nearly all sines must agree to be off by one factor.
const ALIKE: f64 = 0.05;

/// Least ratio of highest and lowest frequency at which no resonance amplifies all sines alike.
const FREQUENCY_SPAN: f64 = 4.0;

/// Relative difference of frequencies at which a fixture amplifies alike, even on the flank of a resonance of Q = 30, where a
/// part in 1e3 of the frequency makes at most 3 % of the amplitude.
const NEIGHBOUR: f64 = 1e-3;

/// Fewest neighbours that speak against a run.
const FEWEST_NEIGHBOURS: usize = 2;

/// Share of the greatest extremes of a campaign from which on a limit may have cut them.
const NEAR_LIMIT: f64 = 0.97;

/// Greatest over rms of a random vibration of some ten thousand independent values: sqrt(2 ln 1e4), Gaussian.
const RANDOM_CREST: f64 = 4.3;

/// Least factor that the crest of one random record, within a third of [`RANDOM_CREST`], can tell.
const TOLD_BY_RANDOM: f64 = 2.0;

const COLUMN: &str = "u_max_v";

/// Command over half the span of the extremes, along IA.
struct Told {
    place: usize,
    factor: f64,
}

/// What the extremes of all runs come to.
struct Detector {
    scale_v_per_g: f64,
    least_v: f64,
    greatest_v: f64,
}

impl Detector {
    fn new(campaign: &Campaign) -> Self {
        let all = runs(campaign).filter_map(|(_, run)| run.measured?.extremes);
        let none = (f64::INFINITY, f64::NEG_INFINITY);
        let (least_v, greatest_v) = all.fold(none, |(least, greatest), extremes| {
            (
                least.min(extremes.minimum_v),
                greatest.max(extremes.maximum_v),
            )
        });
        Self {
            scale_v_per_g: scale_v_per_g(campaign),
            least_v,
            greatest_v,
        }
    }

    /// `None` where IA is not the main axis of the drive, nothing was detected, or a limit may have cut the extremes.
    fn command_over_extremes(&self, run: &Run) -> Option<f64> {
        let along_g = run.direction[0].abs() * run.level_g;
        let rms_g = run.direction[0].abs() * commanded_rms_g(run);
        let extremes = run.measured?.extremes?;
        let span_v = extremes.maximum_v - extremes.minimum_v;
        let half_span_g = 0.5 * span_v / self.scale_v_per_g.abs();
        if main_axis(run) != 0 || half_span_g <= 0.0 || rms_g.max(half_span_g) < LEAST_RMS_G {
            return None;
        }
        let factor = match run.kind {
            VibrationKind::Sine => along_g / half_span_g,
            VibrationKind::Random => RANDOM_CREST * along_g / half_span_g,
        };
        let at_limit = extremes.maximum_v >= NEAR_LIMIT * self.greatest_v
            || extremes.minimum_v <= NEAR_LIMIT * self.least_v;
        // A limit makes extremes smaller, never larger.
        (!at_limit || factor < 1.0).then_some(factor)
    }
}

/// Command over extremes of the runs at these places that tell whether they are off by `factor`.
pub(super) fn command_over_extremes(
    campaign: &Campaign,
    places: &[usize],
    factor: f64,
) -> Vec<f64> {
    let detector = Detector::new(campaign);
    let tells =
        |run: &&Run| run.kind == VibrationKind::Sine || !near(factor, 1.0, TOLD_BY_RANDOM - 1.0);
    let runs = places.iter().map(|&place| &campaign.runs[place]);
    let told = runs.filter(tells);
    told.filter_map(|run| detector.command_over_extremes(run))
        .collect()
}

/// Contradictions between command and extremes of sines that `found` does not hold.
pub(super) fn contradictions(campaign: &Campaign, found: &[Contradiction]) -> Vec<Contradiction> {
    // What is wrong with all levels or references is settled first.
    let settles = |c: &Contradiction| c.is_of_all() && c.factor > 0.0;
    if found.iter().any(settles) {
        return Vec::new();
    }
    let known: Vec<usize> = found
        .iter()
        .flat_map(|c| c.places(&campaign.runs))
        .collect();
    let detector = Detector::new(campaign);
    let sines = runs(campaign)
        .filter(|(place, run)| run.kind == VibrationKind::Sine && !known.contains(place));
    let told: Vec<Told> = sines
        .filter_map(|(place, run)| {
            let factor = detector.command_over_extremes(run)?;
            Some(Told { place, factor })
        })
        .collect();
    match of_all(campaign, &told) {
        Some(contradiction) => vec![contradiction],
        None => of_runs(campaign, &told),
    }
}

fn of_all(campaign: &Campaign, told: &[Told]) -> Option<Contradiction> {
    let factors: Vec<f64> = told.iter().map(|told| told.factor).collect();
    let factor = common_factor(&factors, ALIKE)?;
    let frequencies = told.iter().map(|told| campaign.runs[told.place].band_hz[0]);
    let lowest_hz = frequencies.clone().fold(f64::INFINITY, f64::min);
    let highest_hz = frequencies.fold(0.0, f64::max);
    let of_an_effect = OF_AN_EFFECT.contains(&factor.recip()) && !likely::is_slip(factor);
    if of_an_effect || highest_hz < FREQUENCY_SPAN * lowest_hz {
        return None;
    }
    let seen = |told: &&Told| campaign.runs[told.place].reference.is_some();
    let likely = match told.iter().filter(seen).count() * 2 > told.len() {
        true => "u_min_v and u_max_v are in another unit or scale".into(),
        false => likely::of_factor(factor, Wrong::Level, COLUMN),
    };
    let rows = all_of(VibrationKind::Sine);
    Some(Contradiction::all([LEVEL, COLUMN], factor, rows, likely))
}

/// Runs without a reference that differ from their neighbours in frequency.
fn of_runs(campaign: &Campaign, told: &[Told]) -> Vec<Contradiction> {
    let frequency_hz = |told: &Told| campaign.runs[told.place].band_hz[0];
    let unseen = |one: &&Told| campaign.runs[one.place].reference.is_none();
    let off = told.iter().filter(unseen).filter_map(|one| {
        let neighbours = told.iter().filter(|other| {
            other.place != one.place && near(frequency_hz(other), frequency_hz(one), NEIGHBOUR)
        });
        let factors: Vec<f64> = neighbours.map(|other| other.factor).collect();
        let enough = factors.len() >= FEWEST_NEIGHBOURS;
        let factor = one.factor / median(factors).filter(|_| enough)?;
        if near(factor, 1.0, OFF - 1.0) {
            return None;
        }
        let level_g = campaign.runs[one.place].level_g;
        let likely = likely::of_cell(LEVEL, level_g, level_g / factor);
        let places = [one.place];
        Some(Contradiction::some(
            campaign,
            [LEVEL, COLUMN],
            factor,
            &places,
            likely,
        ))
    });
    off.collect()
}
