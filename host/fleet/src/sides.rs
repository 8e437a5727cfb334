//! Which side of the chain an effect belongs to: the instrument, the bench, the fixture or the day. One campaign cannot tell; over
//! many, an effect is the same for all campaigns that share what it belongs to, and differs from one to the next of those.
//!
//! Each side is a grouping of the campaigns. In a group the effect is there or not, with one value of its parameters:
//!
//! ```text
//! found_i ~ detection(there_g),   value_i ~ N(theta_g, s_i^2 + r^2),   theta_g ~ N(m, t^2)
//! ```
//!
//! with the stated uncertainty s_i, the reproducibility r of the diagnosis integrated over a grid, and mean and spread of all
//! values found as m and t. The evidence of a grouping is the product over its groups.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use serde::Serialize;

/// What an effect may belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// It follows the serial number.
    Instrument,
    /// It follows the station.
    Bench,
    /// It follows `fixture` of `[record]`.
    Fixture,
    /// It follows the date.
    Day,
}

impl Side {
    /// All sides.
    pub const ALL: [Self; 4] = [Self::Instrument, Self::Bench, Self::Fixture, Self::Day];

    /// Its word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Instrument => "instrument",
            Self::Bench => "bench",
            Self::Fixture => "fixture",
            Self::Day => "day",
        }
    }
}

/// What the diagnosis of one campaign says of one effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Word of what the campaign shares with others, side by side; none where it states none.
    pub shared: [Option<String>; Side::ALL.len()],
    /// Value and standard uncertainty of each parameter, if the effect was found.
    pub values: Option<Vec<(f64, f64)>>,
}

/// What a data set says of one effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Attribution {
    /// The effect.
    pub effect: String,
    /// Campaigns in which it was found.
    pub found: usize,
    /// Campaigns.
    pub campaigns: usize,
    /// Probability of each side that the data set can tell from the others.
    pub sides: BTreeMap<Side, f64>,
    /// Sides that group the campaigns as another one does, and so have its probability.
    pub same_as: BTreeMap<Side, Side>,
    /// Campaigns with it and without, by the words of each side.
    pub table: BTreeMap<Side, BTreeMap<String, [usize; 2]>>,
}

/// Chosen: how often a diagnosis misses an effect that is there, and finds one that is not. Halving both changes the share of
/// batches of 20 whose side is told right by less than 5 % (test `halved_rates_of_detection_change_no_verdict`).
const MISSED: f64 = 0.1;
const FALSE_ALARM: f64 = 0.02;

/// Reproducibility of a diagnosis in units of its stated uncertainty: the grid that it is integrated over.
const REPRODUCIBILITY: [f64; 4] = [0.0, 0.5, 1.0, 2.0];

/// Rates of detection: of a miss, and of a false alarm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Probability that an effect which is there is not found.
    pub missed: f64,
    /// Probability that one which is not there is found.
    pub false_alarm: f64,
}

impl Default for Detection {
    fn default() -> Self {
        Self {
            missed: MISSED,
            false_alarm: FALSE_ALARM,
        }
    }
}

/// Attributes one effect.
pub fn attribute(effect: &str, findings: &[Finding], detection: Detection) -> Attribution {
    let scale = Scale::of(findings);
    let mut groupings: BTreeMap<Side, Vec<Vec<usize>>> = BTreeMap::new();
    let mut same_as = BTreeMap::new();
    for (place, side) in Side::ALL.into_iter().enumerate() {
        let Some(groups) = groups(findings, place) else {
            continue;
        };
        match groupings.iter().find(|(_, other)| **other == groups) {
            Some((other, _)) => {
                same_as.insert(side, *other);
            }
            None => {
                groupings.insert(side, groups);
            }
        }
    }
    let evidence: Vec<(Side, f64)> = groupings
        .iter()
        .map(|(side, groups)| (*side, log_evidence(findings, groups, &scale, detection)))
        .collect();
    let most = evidence
        .iter()
        .map(|(_, e)| *e)
        .fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = evidence.iter().map(|(_, e)| (e - most).exp()).sum();
    let sides = evidence
        .iter()
        .map(|(side, e)| (*side, (e - most).exp() / total))
        .collect();
    let table = Side::ALL.into_iter().enumerate().map(|(place, side)| {
        let mut counts: BTreeMap<String, [usize; 2]> = BTreeMap::new();
        for finding in findings {
            if let Some(word) = &finding.shared[place] {
                counts.entry(word.clone()).or_default()[usize::from(finding.values.is_none())] += 1;
            }
        }
        (side, counts)
    });
    Attribution {
        effect: effect.into(),
        found: findings
            .iter()
            .filter(|finding| finding.values.is_some())
            .count(),
        campaigns: findings.len(),
        sides,
        same_as,
        table: table.collect(),
    }
}

/// Campaigns that share a word, each group in their order; none where a campaign states none.
fn groups(findings: &[Finding], place: usize) -> Option<Vec<Vec<usize>>> {
    let mut groups: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (number, finding) in findings.iter().enumerate() {
        groups
            .entry(finding.shared[place].as_deref()?)
            .or_default()
            .push(number);
    }
    let mut groups: Vec<Vec<usize>> = groups.into_values().collect();
    groups.sort();
    Some(groups)
}

/// Mean and standard deviation of each parameter over all campaigns that found it.
struct Scale(Vec<(f64, f64)>);

impl Scale {
    fn of(findings: &[Finding]) -> Self {
        let found: Vec<&Vec<(f64, f64)>> =
            findings.iter().filter_map(|f| f.values.as_ref()).collect();
        let parameters = found.iter().map(|values| values.len()).min().unwrap_or(0);
        let count = found.len() as f64;
        let of = |k: usize| {
            let mean = found.iter().map(|values| values[k].0).sum::<f64>() / count;
            let variance = found.iter().map(|v| (v[k].0 - mean).powi(2)).sum::<f64>() / count;
            let stated = found.iter().map(|v| v[k].1.powi(2)).sum::<f64>() / count;
            (mean, variance.max(stated).sqrt())
        };
        Self((0..parameters).map(of).collect())
    }
}

fn log_evidence(
    findings: &[Finding],
    groups: &[Vec<usize>],
    scale: &Scale,
    detection: Detection,
) -> f64 {
    let grid = REPRODUCIBILITY.map(|factor| {
        groups
            .iter()
            .map(|group| of_group(findings, group, scale, detection, factor))
            .sum::<f64>()
    });
    log_mean(&grid)
}

/// Logarithm of the evidence of a group: the effect is there in it, or not, one as likely as the other beforehand.
fn of_group(
    findings: &[Finding],
    group: &[usize],
    scale: &Scale,
    detection: Detection,
    factor: f64,
) -> f64 {
    let found: Vec<&Vec<(f64, f64)>> = group
        .iter()
        .filter_map(|k| findings[*k].values.as_ref())
        .collect();
    let (with, without) = (found.len() as f64, (group.len() - found.len()) as f64);
    let (mut there, mut not) = (
        with * (1.0 - detection.missed).ln() + without * detection.missed.ln(),
        with * detection.false_alarm.ln() + without * (1.0 - detection.false_alarm).ln(),
    );
    for (k, (mean, spread)) in scale.0.iter().enumerate() {
        let values = found.iter().map(|values| {
            let (value, sigma) = values[k];
            (value - mean, sigma * sigma * (1.0 + factor * factor))
        });
        let values: Vec<(f64, f64)> = values.collect();
        there += log_common(&values, spread * spread);
        // A false alarm has values of its own each time.
        not += values
            .iter()
            .map(|value| log_common(&[*value], spread * spread))
            .sum::<f64>();
    }
    log_mean(&[there, not])
}

/// Logarithm of the density of values (about zero, with their variances) that share one offset of this variance.
fn log_common(values: &[(f64, f64)], offset_variance: f64) -> f64 {
    let tiny = f64::MIN_POSITIVE;
    let mut precision = 1.0 / offset_variance.max(tiny);
    let (mut pull, mut squares, mut log_variance) = (0.0, 0.0, offset_variance.max(tiny).ln());
    for (value, variance) in values {
        let variance = variance.max(offset_variance * 1e-12).max(tiny);
        precision += 1.0 / variance;
        pull += value / variance;
        squares += value * value / variance;
        log_variance += variance.ln() + std::f64::consts::TAU.ln();
    }
    -0.5 * (squares - pull * pull / precision + log_variance + precision.ln())
}

fn log_mean(logarithms: &[f64]) -> f64 {
    let most = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logarithms.iter().map(|l| (l - most).exp()).sum();
    most + (sum / logarithms.len() as f64).ln()
}

/// Attributions for people.
pub fn text(attributions: &[Attribution]) -> String {
    let mut text = String::new();
    if attributions.is_empty() {
        text += "no effect was found in any campaign\n";
    }
    for attribution in attributions {
        let Attribution {
            effect,
            found,
            campaigns,
            ..
        } = attribution;
        let _ = writeln!(text, "{effect}: found in {found} of {campaigns} campaigns");
        let mut sides: Vec<_> = attribution.sides.iter().collect();
        sides.sort_by(|a, b| b.1.total_cmp(a.1));
        for (side, probability) in sides {
            let same = attribution
                .same_as
                .iter()
                .filter(|(_, other)| *other == side);
            let same: Vec<&str> = same.map(|(side, _)| side.word()).collect();
            let or = if same.is_empty() {
                String::new()
            } else {
                format!(" (or {}: the same campaigns)", same.join(", "))
            };
            let _ = writeln!(
                text,
                "  {:<11} {:>6.1} %{or}",
                side.word(),
                100.0 * probability
            );
        }
        for side in [Side::Bench, Side::Fixture, Side::Instrument] {
            let counts = attribution.table.get(&side).into_iter().flatten();
            let with: Vec<String> = counts
                .filter(|(_, [with, _])| *with > 0)
                .map(|(word, [with, without])| format!("{word} {with}/{}", with + without))
                .collect();
            if !with.is_empty() {
                let _ = writeln!(text, "    by {:<11} {}", side.word(), with.join("  "));
            }
        }
    }
    text
}

/// Effects that were found in any of these.
pub fn effects<'a>(found: impl Iterator<Item = &'a String>) -> BTreeSet<String> {
    found.cloned().collect()
}
