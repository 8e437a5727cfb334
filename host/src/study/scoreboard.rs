//! The scoreboard of a study.

use std::collections::BTreeMap;

use serde::Serialize;

use super::cases::{Kind, VISIBILITIES};
use super::trial::{Outcome, Score};

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

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

impl Scoreboard {
    /// The scoreboard for the terminal.
    pub fn text(&self) -> String {
        use std::fmt::Write as _;
        let mut out = String::new();
        let scores = [
            Score::Right,
            Score::InClass,
            Score::Wrong,
            Score::Missed,
            Score::Unexplained,
        ];
        let _ = writeln!(
            out,
            "{:<44} {:>5} {:>6} {:>6} {:>6} {:>6} {:>8}",
            "effect", "vis.", "right", "class", "wrong", "missed", "unexpl."
        );
        for ((kind, effects, visibility), counts) in self.table() {
            let label = match kind {
                Kind::Single | Kind::Pair => effects,
                Kind::Nothing => "none".into(),
                Kind::NothingPaperPlan => "none, paper's plan, 10 arcsec".into(),
                Kind::OutsideCatalogue => format!("{effects} (not in the catalogue)"),
                Kind::Withheld => format!("{effects} (withheld)"),
            };
            let counts = scores.map(|score| counts.get(&score).copied().unwrap_or(0));
            let [right, class, wrong, missed, unexplained] = counts;
            let _ = writeln!(
                out,
                "{label:<44} {visibility:>5} {right:>6} {class:>6} {wrong:>6} {missed:>6} {unexplained:>8}"
            );
        }
        let _ = writeln!(out);
        let of = |test: &dyn Fn(&&Outcome) -> bool| {
            self.outcomes.iter().filter(test).collect::<Vec<_>>()
        };
        let count = |set: &[&Outcome], score: &[Score]| {
            set.iter().filter(|o| score.contains(&o.score)).count()
        };
        for visibility in VISIBILITIES {
            let set = of(&|o| o.kind == Kind::Single && o.visibility == visibility);
            let _ = writeln!(
                out,
                "single effects, visibility {visibility}: right or in class {}, of these by class {}, wrong {}",
                share(count(&set, &[Score::Right, Score::InClass]), set.len()),
                share(count(&set, &[Score::InClass]), set.len()),
                share(count(&set, &[Score::Wrong]), set.len()),
            );
        }
        let row = |out: &mut String, words: &str, set: Vec<&Outcome>, score: &[Score]| {
            let _ = writeln!(out, "{words}: {}", share(count(&set, score), set.len()));
        };
        let alarms = [Score::Wrong, Score::Unexplained];
        row(
            &mut out,
            "no effect: false alarms",
            of(&|o| o.kind == Kind::Nothing),
            &alarms,
        );
        row(
            &mut out,
            "no effect, paper's plan and head: false alarms",
            of(&|o| o.kind == Kind::NothingPaperPlan),
            &alarms,
        );
        row(
            &mut out,
            "outside the catalogue: called unexplained",
            of(&|o| o.kind == Kind::OutsideCatalogue),
            &[Score::Right],
        );
        row(
            &mut out,
            "withheld from the catalogue: called unexplained",
            of(&|o| o.kind == Kind::Withheld),
            &[Score::Right],
        );
        row(
            &mut out,
            "pairs: both named",
            of(&|o| o.kind == Kind::Pair),
            &[Score::Right, Score::InClass],
        );
        let singles = of(&|o| o.kind == Kind::Single);
        let right = singles.iter().filter(|o| o.stage_right).count();
        let _ = writeln!(
            out,
            "single effects, right link of the chain: {}",
            share(right, singles.len())
        );
        let sigmas: Vec<f64> = self
            .outcomes
            .iter()
            .filter_map(|o| o.worst_parameter_sigmas)
            .collect();
        let within = sigmas.iter().filter(|s| **s <= 4.0).count();
        let _ = writeln!(
            out,
            "parameters all within four of their sigmas: {}",
            share(within, sigmas.len())
        );
        let closing: Vec<&Outcome> = singles
            .iter()
            .copied()
            .filter(|o| o.closed.is_some())
            .collect();
        if let Some(closed) = median(closing.iter().filter_map(|o| o.closed).collect()) {
            let held = |o: &&&Outcome| matches!((o.closed, o.closed_interval), (Some(a), Some([low, high])) if (low..=high).contains(&a));
            let close = |o: &&&Outcome| matches!((o.closed, o.closed_stated), (Some(a), Some(b)) if (a - b).abs() <= 0.15);
            let _ = writeln!(
                out,
                "gap on hold-out runs closed: median {:.0} %; stated within 0.15 of it {}, its 90 % interval holds it {}",
                100.0 * closed,
                share(closing.iter().filter(close).count(), closing.len()),
                share(closing.iter().filter(held).count(), closing.len()),
            );
        }
        let worse = self
            .outcomes
            .iter()
            .filter(|o| o.hold_out_ratio > 1.05)
            .count();
        let _ = writeln!(
            out,
            "hold-out runs made worse by more than 5 %: {}",
            share(worse, self.outcomes.len())
        );
        self.calibration(&mut out);
        out
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
        use std::fmt::Write as _;
        let judged = self.judged();
        if judged.is_empty() {
            return;
        }
        let brier = brier(&judged);
        let _ = writeln!(
            out,
            "probability of what is named (Brier score {brier:.3}):"
        );
        for (low, high) in [(0.0, 0.5), (0.5, 0.9), (0.9, 0.99), (0.99, 1.01)] {
            let bin: Vec<&(f64, bool)> = judged
                .iter()
                .filter(|(p, _)| (low..high).contains(p))
                .collect();
            let right = bin.iter().filter(|(_, right)| *right).count();
            let _ = writeln!(
                out,
                "  {low:.2} to {:.2}: right {}",
                f64::min(high, 1.0),
                share(right, bin.len())
            );
        }
    }
}
