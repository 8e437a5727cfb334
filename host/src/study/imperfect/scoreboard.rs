//! The scoreboard of laboratories as they are.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

use super::EFFECTS;
use super::trial::{Answer, ImperfectOutcome};
use crate::study::interval::Share;

/// The scoreboard.
#[derive(Clone, Debug, Serialize)]
pub struct ImperfectScoreboard {
    /// Always `vre-blind-check-imperfect/1`.
    pub format: &'static str,
    /// The seed.
    pub seed: u64,
    /// Shares with one imperfection, without an effect and with one.
    pub groups: Vec<Group>,
    /// Every campaign.
    pub outcomes: Vec<ImperfectOutcome>,
}

/// Campaigns with one imperfection and an effect of one visibility, or none.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// Visibility of the effect on the bench as stated; `None` without one.
    pub visibility: Option<f64>,
    /// Campaigns.
    pub campaigns: u64,
    /// Shares by what they are of.
    pub shares: BTreeMap<&'static str, Share>,
}

/// Whether a campaign counts; `None` if it is no trial of that share.
type Counts = fn(&ImperfectOutcome) -> Option<bool>;

/// What is printed, in its order, and in a few words.
const ROWS: [(&str, &str, Counts); 11] = [
    ("right", "right", |o| {
        (!rightly_refused(o)).then(|| right(o))
    }),
    ("wrong", "wrong name", |o| Some(o.answer == Answer::Wrong)),
    ("wrong_at_90", "wrong name at >= .9", |o| {
        Some(o.answer == Answer::Wrong && states(o, 0.9))
    }),
    ("unexplained", "unexplained", |o| {
        Some(o.answer == Answer::Unexplained)
    }),
    ("missed", "effect not seen", |o| {
        o.effect.map(|_| o.answer == Answer::Missed)
    }),
    ("refused", "refused", |o| Some(o.answer == Answer::Refused)),
    ("refused_in_error", "refused in error", |o| {
        Some(o.answer == Answer::Refused && !rightly_refused(o))
    }),
    ("told", "imperfection told", |o| o.told),
    ("sound_rows", "sound rows named", |o| {
        let sound = |row: &String| !o.rows.contains(row);
        (o.answer != Answer::Refused).then(|| o.named_rows.iter().any(sound))
    }),
    ("stated_90", "said >= .9: right", |o| {
        states(o, 0.9).then(|| right(o))
    }),
    ("stated_999", "said >= .999: right", |o| {
        states(o, 0.999).then(|| right(o))
    }),
];

fn right(outcome: &ImperfectOutcome) -> bool {
    matches!(outcome.answer, Answer::Right | Answer::InClass)
}

/// Whether a refusal tells what the laboratory did.
fn rightly_refused(outcome: &ImperfectOutcome) -> bool {
    outcome.answer == Answer::Refused && outcome.told == Some(true)
}

/// Whether effects are named at that probability.
fn states(outcome: &ImperfectOutcome, least: f64) -> bool {
    outcome.probability.is_some_and(|p| p >= least)
}

impl ImperfectScoreboard {
    /// Of the campaigns of a study.
    pub(super) fn new(seed: u64, outcomes: Vec<ImperfectOutcome>) -> Self {
        let group = |visibility: Option<f64>| {
            let of = |o: &&ImperfectOutcome| o.imperfection.is_some() && o.visibility == visibility;
            let set: Vec<&ImperfectOutcome> = outcomes.iter().filter(of).collect();
            let share = |counts: Counts| Share::of(set.iter().filter_map(|o| counts(o)));
            Group {
                visibility,
                campaigns: set.len() as u64,
                shares: ROWS
                    .iter()
                    .map(|(id, _, counts)| (*id, share(*counts)))
                    .collect(),
            }
        };
        Self {
            format: "vre-blind-check-imperfect/1",
            seed,
            groups: EFFECTS.into_iter().map(group).collect(),
            outcomes,
        }
    }

    /// The scoreboard for a terminal of 80 columns.
    pub fn text(&self) -> String {
        let mut out = self.by_imperfection();
        out += "open: unexplained, or an effect that is not seen; ref: refused\n\n";
        out += "One imperfection; in brackets the central 95 % by Clopper and Pearson\n";
        out += "right: of those that were not refused for what the laboratory did\n";
        let mut line = |words: &str, cells: Vec<String>| {
            let cells: String = cells.iter().map(|cell| format!("{cell:>20}")).collect();
            let _ = writeln!(out, "{words:<20}{cells}");
        };
        let head = |group: &Group| match group.visibility {
            None => "no effect".into(),
            Some(visibility) => format!("effect at {visibility}"),
        };
        line("", self.groups.iter().map(head).collect());
        let campaigns = |group: &Group| group.campaigns.to_string();
        line("campaigns", self.groups.iter().map(campaigns).collect());
        for (id, words, _) in ROWS {
            let cell = |group: &Group| group.shares.get(id).map_or("-".into(), Share::text);
            line(words, self.groups.iter().map(cell).collect());
        }
        out
    }

    /// Counts of the answers for each imperfection, without an effect and with one.
    fn by_imperfection(&self) -> String {
        let mut kinds: Vec<Option<&str>> = Vec::new();
        for outcome in &self.outcomes {
            if !kinds.contains(&outcome.imperfection) {
                kinds.push(outcome.imperfection);
            }
        }
        let mut out = format!(
            "{:<22}{:<24}{:<24}{:>8}\n",
            "", "no effect", "effect", "told"
        );
        let head = ["right", "wrong", "open", "ref"]
            .map(|word| format!("{word:<6}"))
            .concat();
        let _ = writeln!(out, "{:<22}{head}{head}", "imperfection");
        for kind in kinds {
            let of = |o: &&ImperfectOutcome| o.imperfection == kind;
            let set: Vec<&ImperfectOutcome> = self.outcomes.iter().filter(of).collect();
            let counts = [false, true].map(|acts| {
                let set = set.iter().filter(|o| o.effect.is_some() == acts);
                let answers: Vec<Answer> = set.map(|o| o.answer).collect();
                let count = |of: &[Answer]| answers.iter().filter(|a| of.contains(a)).count();
                let right = [Answer::Right, Answer::InClass];
                let open = [Answer::Unexplained, Answer::Missed];
                let columns: [&[Answer]; 4] = [&right, &[Answer::Wrong], &open, &[Answer::Refused]];
                columns.map(|of| format!("{:<6}", count(of))).concat()
            });
            let told = Share::of(set.iter().filter_map(|o| o.told));
            let told = match told.of {
                0 => String::new(),
                of => format!("{} of {of}", told.count),
            };
            let kind = kind.unwrap_or("none: bench as stated");
            let line = format!("{kind:<22}{}{told:>8}", counts.concat());
            let _ = writeln!(out, "{}", line.trim_end());
        }
        out
    }
}
