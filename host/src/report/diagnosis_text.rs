//! A diagnosis for the terminal.

use std::fmt::Write as _;

use super::laboratory_text::{belonging, sessions, shaker};
use crate::diagnose::answer::{Condition, Shrink, Which};
use crate::diagnose::{Diagnosis, Verdict, WHY_NOT_CARRIED};
use crate::effects;
use crate::quantity::{Quantity, significant};

/// A diagnosis in a screenful.
pub fn text(diagnosis: &Diagnosis) -> String {
    let mut out = String::new();
    to_do(&mut out, diagnosis);
    let _ = writeln!(
        out,
        "instrument {}: {}\n",
        diagnosis.serial,
        headline(diagnosis)
    );
    let gap = &diagnosis.gap;
    let _ = writeln!(
        out,
        "gap      the nominal model misses by {:.2} times the stated noise (chance of that: {})",
        gap.rms_over_noise,
        probability(gap.p_value)
    );
    if diagnosis.verdict.sees_none() {
        sight(&mut out, diagnosis);
    } else {
        place(&mut out, diagnosis);
        causes(&mut out, diagnosis);
        likeness(&mut out, diagnosis);
    }
    predictions(&mut out, diagnosis);
    for test in diagnosis.next_tests.iter().take(3) {
        let _ = writeln!(
            out,
            "next     {} ({:.2} bits)",
            test.change, test.expected_bits
        );
    }
    for note in &diagnosis.not_looked_at {
        let _ = writeln!(out, "not seen {note}");
    }
    out
}

/// Which gap could have been seen.
fn sight(out: &mut String, diagnosis: &Diagnosis) {
    let _ = match diagnosis.sight {
        None => writeln!(out, "seen     no run could have shown a gap"),
        Some(sight) => writeln!(
            out,
            "seen     a gap of {} % of the vibration error ({} microg rms) would have shown, a smaller one not",
            significant(100.0 * sight.share_of_vre, 2),
            significant(1e6 * sight.rms_g, 2)
        ),
    };
}

/// The effect that takes what the reference reads across the drive for the table's.
const TRANSVERSE: &str = "shaker-transverse";

/// What the user must look at before all else.
fn to_do(out: &mut String, diagnosis: &Diagnosis) {
    out.push_str(&belonging(&diagnosis.suspects, &diagnosis.noise));
    sessions(out, &diagnosis.sessions);
    if let Some(found) = &diagnosis.shaker {
        let moves = diagnosis.which[0].effects.iter().any(|id| id == TRANSVERSE);
        shaker(out, found, moves && !diagnosis.verdict.sees_none());
    }
    if !out.is_empty() {
        out.push('\n');
    }
}

/// Where the gap lies, and at which link of the chain.
fn place(out: &mut String, diagnosis: &Diagnosis) {
    let location = &diagnosis.location;
    let shares = location.observables.iter().filter(|o| o.share >= 0.005);
    let shares: Vec<String> = shares
        .map(|o| format!("{} {:.0} %", o.name, 100.0 * o.share))
        .collect();
    let _ = writeln!(out, "where    {}", shares.join(", "));
    regions(out, &location.conditions);
    let mut stages = location.stages.clone();
    stages.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    if let Some(stage) = stages.first().filter(|s| s.probability > 0.05) {
        let word = serde_json::to_string(&stage.stage).unwrap_or_default();
        let percent = 100.0 * stage.probability;
        let _ = writeln!(out, "link     {} ({percent:.0} %)", word.trim_matches('"'));
    }
}

/// The conditions that hold most of an excess, with their runs or readings.
fn regions(out: &mut String, conditions: &[Condition]) {
    for condition in conditions.iter().take(3) {
        let _ = writeln!(
            out,
            "         {:.0} % of it within {} {} to {}: {} {}",
            100.0 * condition.share,
            condition.factor,
            significant(condition.low, 6),
            significant(condition.high, 6),
            if condition.of_readings() {
                "readings"
            } else {
                "runs"
            },
            ranges(&condition.runs)
        );
    }
}

/// What an unexplained gap is like, and where it is not.
fn likeness(out: &mut String, diagnosis: &Diagnosis) {
    let Some(like) = &diagnosis.like else {
        return;
    };
    let _ = writeln!(
        out,
        "like     {}, which makes {:.0} % of it, but the fit leaves {:.2} times the stated noise",
        like.effects.join(" + "),
        100.0 * like.share_of_gap,
        like.leaves_rms_over_noise
    );
    regions(out, &like.leaves_in);
}

/// Most ranges of numbers that a line names.
const RANGES: usize = 6;

/// Numbers as `3, 7, 12-15`, the rest as how many there are.
fn ranges(numbers: &[u64]) -> String {
    let mut sorted = numbers.to_vec();
    sorted.sort_unstable();
    let followed = |a: &u64, b: &u64| b - a == 1;
    let chunks: Vec<&[u64]> = sorted.chunk_by(followed).collect();
    let mut named: Vec<String> = chunks[..chunks.len().min(RANGES)]
        .iter()
        .map(|chunk| match chunk {
            [one] => one.to_string(),
            [first, .., last] => format!("{first}-{last}"),
            [] => String::new(),
        })
        .collect();
    if let Some(rest) = chunks.get(RANGES..).filter(|rest| !rest.is_empty()) {
        named.push(format!("{} more", rest.concat().len()));
    }
    named.join(", ")
}

/// Which effects, with the parameters of the most probable ones.
fn causes(out: &mut String, diagnosis: &Diagnosis) {
    let name = |which: &Which| match &which.effects[..] {
        [] => "nothing".into(),
        effects => effects.join(" + "),
    };
    for which in diagnosis.which.iter().take(4) {
        let percent = 100.0 * which.probability;
        let _ = writeln!(out, "which    {:<40} {percent:>6.1} %", name(which));
    }
    let best = &diagnosis.which[0];
    for parameter in &best.parameters {
        let quantity = Quantity::new(parameter.value, parameter.sigma);
        let _ = writeln!(out, "         {} = {quantity}", parameter.name);
    }
    for id in &best.effects {
        if let Some(effect) = effects::find(id) {
            let _ = writeln!(out, "         {id}: {}", effect.says);
        }
    }
    if !best.indistinguishable_from.is_empty() {
        let _ = writeln!(
            out,
            "         these data cannot tell {} from {}",
            best.effects.join(" and "),
            best.indistinguishable_from.join(", ")
        );
    }
}

/// What it means for predictions and on board.
fn predictions(out: &mut String, diagnosis: &Diagnosis) {
    if let Some(shrink) = &diagnosis.shrink {
        let _ = writeln!(
            out,
            "shrink   held-out runs miss by {:.2} (static test), {:.2} (refitted), {:.2} (with effects) microg; noise {:.2}; {}",
            1e6 * shrink.held_out_rms_static_only_g,
            1e6 * shrink.held_out_rms_refit_g,
            1e6 * shrink.held_out_rms_with_effects_g,
            1e6 * shrink.noise_floor_rms_g,
            closed(diagnosis, shrink)
        );
    }
    if let Some(cause) = &diagnosis.identification {
        let _ = writeln!(
            out,
            "static   the static prediction alone is off by {} ({:.0} % of its error): no effect, a matter of the plan and the dial",
            cause.cause,
            100.0 * cause.share
        );
    }
    let Some(compensation) = diagnosis.offered() else {
        return;
    };
    for id in &compensation.carried {
        let _ = writeln!(
            out,
            "on board {id}: a coefficient of the compensation, which vre configure --diagnosis hands over"
        );
    }
    for id in &compensation.not_carried {
        let _ = writeln!(out, "on board {id}: stays uncompensated: {WHY_NOT_CARRIED}");
    }
}

/// What effects close on new runs, in words.
fn closed(diagnosis: &Diagnosis, shrink: &Shrink) -> String {
    let [low, high] = shrink.closed_fraction_interval_90.map(|part| 100.0 * part);
    if diagnosis.which[0].effects.is_empty() {
        return "no effect to close it".into();
    }
    if shrink.closed_fraction == 0.0 {
        return "closed 0 %: predictions are no better with effects, and made without".into();
    }
    format!(
        "closed {:.0} % ({low:.0} to {high:.0} %)",
        100.0 * shrink.closed_fraction
    )
}

/// The verdict as a sentence.
pub fn headline(diagnosis: &Diagnosis) -> String {
    let best = &diagnosis.which[0];
    let names = best.effects.join(" and ");
    match diagnosis.verdict {
        Verdict::NoGap => "no gap beyond the stated uncertainty".into(),
        Verdict::CannotTell => {
            "cannot tell: a gap as large as the vibration error itself could not have shown".into()
        }
        Verdict::Explained => format!(
            "the gap is explained by {names} ({:.0} %)",
            100.0 * best.probability
        ),
        Verdict::Ambiguous => format!(
            "the gap is explained by {names} or {}",
            best.indistinguishable_from.join(" or ")
        ),
        Verdict::Unexplained => "there is a gap, and nothing in the catalogue explains it".into(),
    }
}

fn probability(p: f64) -> String {
    if p < 1e-4 {
        "less than 1 in 10 000".into()
    } else {
        format!("{:.2} %", 100.0 * p)
    }
}
