//! The signs of the commanded direction against those of the reference's correlations.
//!
//! A motion along one line has correlations of the signs of the products of its direction cosines. What turns all axes at
//! once changes no product, and no such check tells it.

use super::robust::FEWEST;
use super::{AXES, Contradiction, DRIVEN, runs};
use crate::campaign::{Campaign, Run};

/// Pairs of axes in the order of the reference's correlations, with their columns.
const PAIRS: [([usize; 2], &str); 3] = [
    ([0, 1], "ref_ip_corr"),
    ([0, 2], "ref_io_corr"),
    ([1, 2], "ref_po_corr"),
];
const DIRECTION: [&str; 3] = ["dir_i", "dir_p", "dir_o"];
const CHANNELS: [&str; 3] = ["I", "P", "O"];

/// Least correlation whose sign is beyond noise and transverse motion.
const LEAST_CORRELATION: f64 = 0.5;

/// Share of a pair's runs with the other sign that speaks for all.
const ALIKE: f64 = 0.8;

/// Places of the runs along a pair of axes, by whether the signs agree.
#[derive(Default)]
struct Pair {
    agree: Vec<usize>,
    reversed: Vec<usize>,
}

impl Pair {
    fn of(campaign: &Campaign, at: usize) -> Self {
        let mut pair = Self::default();
        for (place, run) in runs(campaign) {
            match agrees(run, at) {
                Some(true) => pair.agree.push(place),
                Some(false) => pair.reversed.push(place),
                None => {}
            }
        }
        pair
    }

    fn count(&self) -> usize {
        self.agree.len() + self.reversed.len()
    }

    /// Whether all runs are reversed, or all agree, but for a few; `None` where too few tell.
    fn all_reversed(&self) -> Option<bool> {
        let enough = self.count() >= FEWEST;
        enough.then_some(self.reversed.len() as f64 >= ALIKE * self.count() as f64)
    }
}

fn agrees(run: &Run, at: usize) -> Option<bool> {
    let [one, other] = PAIRS[at].0.map(|axis| run.direction[axis]);
    let correlation = run.reference?.correlation?[at];
    let tells = one.abs().min(other.abs()) > DRIVEN && correlation.abs() >= LEAST_CORRELATION;
    tells.then_some(one * other * correlation > 0.0)
}

/// All contradictions of signs.
pub(super) fn contradictions(campaign: &Campaign) -> Vec<Contradiction> {
    let pairs = [0, 1, 2].map(|at| Pair::of(campaign, at));
    let reversed = [0, 1, 2].map(|at| pairs[at].all_reversed());
    let mut found = Vec::new();
    if reversed.contains(&Some(true)) {
        found.extend(of_all(&reversed));
    }
    found.extend(of_runs(campaign, &pairs, &reversed));
    found
}

/// One axis that makes sense of all pairs, or each pair by itself.
fn of_all(reversed: &[Option<bool>; 3]) -> Vec<Contradiction> {
    let whole: Vec<usize> = (0..3).filter(|&at| reversed[at] == Some(true)).collect();
    let explains = |axis: &usize| {
        let fits = |at: usize| reversed[at].is_none_or(|is| is == PAIRS[at].0.contains(axis));
        (0..3).all(fits)
    };
    let axes: Vec<usize> = (0..3).filter(explains).collect();
    let Some(&axis) = axes.first() else {
        let one = |at: usize| {
            let ([first, second], column) = PAIRS[at];
            let likely = format!(
                "the sign of {} or {} is wrong in all these runs",
                DIRECTION[first], DIRECTION[second]
            );
            let rows = words(&[at]);
            Contradiction::all([DIRECTION[second], column], -1.0, rows, likely)
        };
        return whole.into_iter().map(one).collect();
    };
    let of = |names: [&str; 3]| {
        axes.iter()
            .map(|&axis| names[axis])
            .collect::<Vec<_>>()
            .join(" or ")
    };
    let likely = format!(
        "the reference's {} channel is reversed, or {} has the wrong sign in all runs",
        of(CHANNELS),
        of(DIRECTION)
    );
    let between = [DIRECTION[axis], PAIRS[whole[0]].1];
    vec![Contradiction::all(between, -1.0, words(&whole), likely)]
}

/// `all runs along IA and PA, PA and OA`
fn words(pairs: &[usize]) -> String {
    let along = |&at: &usize| {
        let [first, second] = PAIRS[at].0;
        format!("{} and {}", AXES[first], AXES[second])
    };
    let along: Vec<String> = pairs.iter().map(along).collect();
    format!("all runs along {}", along.join(", "))
}

/// Runs whose signs differ from those of all others along the same axes.
fn of_runs(
    campaign: &Campaign,
    pairs: &[Pair; 3],
    reversed: &[Option<bool>; 3],
) -> Vec<Contradiction> {
    let mut found: Vec<Contradiction> = Vec::new();
    let mut named: Vec<usize> = Vec::new();
    for at in 0..3 {
        let ([first, second], column) = PAIRS[at];
        let odd = match reversed[at] {
            Some(true) => &pairs[at].agree,
            _ => &pairs[at].reversed,
        };
        // A run along three axes shows one wrong sign in two pairs.
        let odd: Vec<usize> = odd
            .iter()
            .copied()
            .filter(|place| !named.contains(place))
            .collect();
        if odd.is_empty() {
            continue;
        }
        let likely = format!(
            "the sign of {} or {} is mistyped",
            DIRECTION[first], DIRECTION[second]
        );
        let between = [DIRECTION[second], column];
        found.push(Contradiction::some(campaign, between, -1.0, &odd, likely));
        named.extend(odd);
    }
    found
}
