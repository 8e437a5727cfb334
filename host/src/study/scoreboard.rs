//! The scoreboard of a study.

use std::collections::BTreeMap;

use serde::Serialize;

use super::cases::{Kind, VISIBILITIES};
use super::trial::{Outcome, Score};
use crate::median::median;

/// The scoreboard.
#[derive(Clone, Debug, Serialize)]
pub struct Scoreboard {
    /// Always `vre-blind-check/1`.
    pub format: &'static str,
    /// The seed.
    pub seed: u64,
    /// Every campaign.
    pub outcomes: Vec<Outcome>,
}

impl Scoreboard {
    /// Counts of the scores by kind, effects and visibility.
    pub fn table(&self) -> BTreeMap<(Kind, String, u64), BTreeMap<Score, usize>> {
        let mut table: BTreeMap<_, BTreeMap<Score, usize>> = BTreeMap::new();
        for outcome in &self.outcomes {
            let key = (
                outcome.kind.clone(),
                outcome.effects.join("+"),
                outcome.visibility as u64,
            );
            *table
                .entry(key)
                .or_default()
                .entry(outcome.score)
                .or_default() += 1;
        }
        table
    }
}

/// Shares of a set of outcomes, as text.
fn share(count: usize, of: usize) -> String {
    if of == 0 {
        "-".into()
    } else {
        format!(
            "{:.1} % ({count} of {of})",
            100.0 * count as f64 / of as f64
        )
    }
}

fn brier(judged: &[(f64, bool)]) -> f64 {
    let off = |(p, right): &(f64, bool)| (p - f64::from(u8::from(*right))).powi(2);
    judged.iter().map(off).sum::<f64>() / judged.len() as f64
}

fn line(out: &mut String, text: &str) {
    out.push_str(text);
    out.push('\n');
}

/// How much of the gap on hold-out runs was closed, and whether what was stated of it holds.
fn closing(singles: &[&Outcome], out: &mut String) {
    let closing: Vec<&&Outcome> = singles.iter().filter(|o| o.closed.is_some()).collect();
    let Some(closed) = median(closing.iter().filter_map(|o| o.closed).collect()) else {
        return;
    };
    let held = closing.iter().filter(|o| {
        matches!((o.closed, o.closed_interval), (Some(closed), Some([low, high])) if (low..=high).contains(&closed))
    });
    let near = closing.iter().filter(|o| {
        matches!((o.closed, o.closed_stated), (Some(closed), Some(stated)) if (closed - stated).abs() <= 0.15)
    });
    line(
        out,
        &format!(
            "gap on hold-out runs closed: median {:.0} %; stated within 0.15 of it {}, its 90 % interval holds it {}",
            100.0 * closed,
            share(near.count(), closing.len()),
            share(held.count(), closing.len()),
        ),
    );
}

/// A line of shares: what it says, outcomes of which kind, which scores count.
const LINES: [(&str, Kind, &[Score]); 5] = [
    ("no effect: false alarms", Kind::Nothing, ALARMS),
    (
        "no effect, paper's plan and head: false alarms",
        Kind::NothingPaperPlan,
        ALARMS,
    ),
    (
        "outside the catalogue: called unexplained",
        Kind::OutsideCatalogue,
        &[Score::Right],
    ),
    (
        "withheld from the catalogue: called unexplained",
        Kind::Withheld,
        &[Score::Right],
    ),
    ("pairs: both named", Kind::Pair, NAMED),
];
const ALARMS: &[Score] = &[Score::Wrong, Score::Unexplained];
const NAMED: &[Score] = &[Score::Right, Score::InClass];

fn scored(outcomes: &[&Outcome], scores: &[Score]) -> String {
    let count = outcomes.iter().filter(|o| scores.contains(&o.score));
    share(count.count(), outcomes.len())
}

impl Scoreboard {
    /// The scoreboard for the terminal.
    pub fn text(&self) -> String {
        let mut out = self.counts();
        out.push('\n');
        for visibility in VISIBILITIES {
            let set = self.of(|o| o.kind == Kind::Single && o.visibility == visibility);
            line(
                &mut out,
                &format!(
                    "single effects, visibility {visibility}: right or in class {}, of these by class {}, wrong {}",
                    scored(&set, NAMED),
                    scored(&set, &[Score::InClass]),
                    scored(&set, &[Score::Wrong]),
                ),
            );
        }
        for (words, kind, scores) in LINES {
            let share = scored(&self.of(|o| o.kind == kind), scores);
            line(&mut out, &format!("{words}: {share}"));
        }
        let singles = self.of(|o| o.kind == Kind::Single);
        let right = singles.iter().filter(|o| o.stage_right).count();
        let share_right = share(right, singles.len());
        line(
            &mut out,
            &format!("single effects, right link of the chain: {share_right}"),
        );
        self.parameters(&mut out);
        closing(&singles, &mut out);
        let worse = self.of(|o| o.hold_out_ratio > 1.05).len();
        let share_worse = share(worse, self.outcomes.len());
        line(
            &mut out,
            &format!("hold-out runs made worse by more than 5 %: {share_worse}"),
        );
        self.calibration(&mut out);
        out
    }

    fn of(&self, test: impl Fn(&Outcome) -> bool) -> Vec<&Outcome> {
        self.outcomes.iter().filter(|o| test(o)).collect()
    }

    /// Scores by effects and visibility, one line each.
    fn counts(&self) -> String {
        let mut out = String::new();
        line(
            &mut out,
            &format!(
                "{:<44} {:>5} {:>6} {:>6} {:>6} {:>6} {:>8}",
                "effect", "vis.", "right", "class", "wrong", "missed", "unexpl."
            ),
        );
        for ((kind, effects, visibility), counts) in self.table() {
            let label = match kind {
                Kind::Single | Kind::Pair => effects,
                Kind::Nothing => "none".into(),
                Kind::NothingPaperPlan => "none, paper's plan, 10 arcsec".into(),
                Kind::OutsideCatalogue => format!("{effects} (not in the catalogue)"),
                Kind::Withheld => format!("{effects} (withheld)"),
            };
            let count = |score| counts.get(&score).copied().unwrap_or(0);
            line(
                &mut out,
                &format!(
                    "{label:<44} {visibility:>5} {:>6} {:>6} {:>6} {:>6} {:>8}",
                    count(Score::Right),
                    count(Score::InClass),
                    count(Score::Wrong),
                    count(Score::Missed),
                    count(Score::Unexplained),
                ),
            );
        }
        out
    }

    fn parameters(&self, out: &mut String) {
        let sigmas = self
            .outcomes
            .iter()
            .filter_map(|o| o.worst_parameter_sigmas);
        let sigmas: Vec<f64> = sigmas.collect();
        let within = sigmas.iter().filter(|s| **s <= 4.0).count();
        let share = share(within, sigmas.len());
        line(
            out,
            &format!("parameters all within four of their sigmas: {share}"),
        );
    }

    /// Mean square of the probability of what is named less whether it is right, 0 to 1; NaN of no outcomes.
    pub fn brier_score(&self) -> f64 {
        brier(&self.judged())
    }

    /// Probability of what is named, and whether that is right.
    fn judged(&self) -> Vec<(f64, bool)> {
        self.outcomes
            .iter()
            .filter(|o| {
                !matches!(o.kind, Kind::OutsideCatalogue | Kind::Withheld)
                    || o.score == Score::Wrong
            })
            .map(|o| (o.probability, o.named == o.effects))
            .collect()
    }

    /// Reliability of the probability of what is named, in bins, and its Brier score.
    fn calibration(&self, out: &mut String) {
        let judged = self.judged();
        if judged.is_empty() {
            return;
        }
        let brier = brier(&judged);
        line(
            out,
            &format!("probability of what is named (Brier score {brier:.3}):"),
        );
        for (low, high) in [(0.0, 0.5), (0.5, 0.9), (0.9, 0.99), (0.99, 1.01)] {
            let bin = judged.iter().filter(|(p, _)| (low..high).contains(p));
            let bin: Vec<_> = bin.collect();
            let right = bin.iter().filter(|(_, right)| *right).count();
            line(
                out,
                &format!(
                    "  {low:.2} to {:.2}: right {}",
                    f64::min(high, 1.0),
                    share(right, bin.len())
                ),
            );
        }
    }
}
