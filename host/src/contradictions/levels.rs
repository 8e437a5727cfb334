//! The commanded level against the rms that the reference saw.
//!
//! A second harmonic of 0.3 raises an rms by 4.4 %; a table that is not guided straight moves axes beside the main one, and
//! leaves the main axis alone; gains of a reference are within a few per cent. None of them is [`OFF`].

use super::likely::{self, Wrong};
use super::robust::{common_factor, distance, median, near};
use super::{
    ANY_REFERENCE, AXES, Contradiction, KINDS, LEAST_RMS_G, LEVEL, REFERENCE, all_of,
    commanded_rms_g, driven, extremes, main_axis, runs,
};
use crate::campaign::{Campaign, VibrationKind};

/// Factor by which command and reference may differ: above the 4.4 % of the strongest distortion.
pub(super) const OFF: f64 = 1.05;

/// Likewise for an axis beside the main one, onto which a table's transverse motion of 0.3 may fall.
const OFF_ACROSS: f64 = 3.0;

/// Command over reference of one run.
struct Compared {
    place: usize,
    kind: VibrationKind,
    main: usize,
    /// By axis; `None` where an axis is not driven, or too little moves.
    factors: [Option<f64>; 3],
}

impl Compared {
    fn all(campaign: &Campaign, without: &[usize]) -> Vec<Self> {
        let left = runs(campaign).filter(|(place, _)| !without.contains(place));
        let compared = left.filter_map(|(place, run)| {
            let seen_g = run.reference?.rms_g;
            let mut factors = [None; 3];
            for axis in driven(run) {
                let told_g = run.direction[axis].abs() * commanded_rms_g(run);
                if seen_g[axis] > 0.0 && told_g.max(seen_g[axis]) > LEAST_RMS_G {
                    factors[axis] = Some(told_g / seen_g[axis]);
                }
            }
            let main = main_axis(run);
            factors[main]?;
            let kind = run.kind;
            Some(Self {
                place,
                kind,
                main,
                factors,
            })
        });
        compared.collect()
    }

    /// That of the main axis.
    fn factor(&self) -> f64 {
        self.factors[self.main].unwrap_or(1.0)
    }
}

/// What a whole kind, or a whole axis of a kind, is off by.
struct Base {
    of_kind: [f64; 2],
    of_axis: [[f64; 3]; 2],
}

impl Base {
    fn of(compared: &[Compared]) -> Self {
        let common = |kind: VibrationKind, axis: Option<usize>| {
            let alike = |c: &&Compared| c.kind == kind && axis.is_none_or(|axis| axis == c.main);
            let factors = compared.iter().filter(alike).map(Compared::factor);
            common_factor(&factors.collect::<Vec<_>>(), OFF - 1.0)
        };
        let of_kind = KINDS.map(|kind| common(kind, None).unwrap_or(1.0));
        let axes = |at: usize| [0, 1, 2].map(|a| common(KINDS[at], Some(a)).unwrap_or(of_kind[at]));
        Self {
            of_kind,
            of_axis: [axes(0), axes(1)],
        }
    }

    fn expected(&self, run: &Compared, axis: usize) -> f64 {
        self.of_axis[(run.kind == VibrationKind::Random) as usize][axis]
    }
}

/// All contradictions between command and reference, but for the runs at the places `without`.
pub(super) fn contradictions(campaign: &Campaign, without: &[usize]) -> Vec<Contradiction> {
    let compared = Compared::all(campaign, without);
    let base = Base::of(&compared);
    let mut found = of_kinds(campaign, &compared, &base);
    found.extend(of_axes(campaign, &compared, &base));
    found.extend(of_runs(campaign, &compared, &base));
    found
}

fn is_off(factor: f64) -> bool {
    !near(factor, 1.0, OFF - 1.0)
}

fn of_kinds(campaign: &Campaign, compared: &[Compared], base: &Base) -> Vec<Contradiction> {
    let between = [LEVEL, ANY_REFERENCE];
    let one = |words: &str, kind: Option<VibrationKind>, factor: f64| {
        let of_kind = |c: &&Compared| kind.is_none_or(|kind| kind == c.kind);
        let places: Vec<usize> = compared.iter().filter(of_kind).map(|c| c.place).collect();
        let likely = likely::of_factor(factor, wrong(campaign, &places, factor), ANY_REFERENCE);
        Contradiction::all(between, factor, words, likely)
    };
    let [sine, random] = base.of_kind;
    if is_off(sine) && near(sine, random, OFF - 1.0) {
        return vec![one("all runs", None, sine)];
    }
    let off = KINDS.into_iter().zip(base.of_kind);
    let off = off.filter(|(_, factor)| is_off(*factor));
    off.map(|(kind, factor)| one(all_of(kind), Some(kind), factor))
        .collect()
}

/// Axes that are off where the kind is not.
fn of_axes(campaign: &Campaign, compared: &[Compared], base: &Base) -> Vec<Contradiction> {
    let mut found = Vec::new();
    for axis in 0..3 {
        let [sine, random] = [0, 1].map(|at| base.of_axis[at][axis] / base.of_kind[at]);
        let alike = is_off(sine) && near(sine, random, OFF - 1.0);
        let kinds: &[(Option<VibrationKind>, f64)] = match alike {
            true => &[(None, sine)],
            false => &[(Some(KINDS[0]), sine), (Some(KINDS[1]), random)],
        };
        for &(kind, factor) in kinds.iter().filter(|(_, factor)| is_off(*factor)) {
            let here = |c: &&Compared| c.main == axis && kind.is_none_or(|kind| kind == c.kind);
            let places: Vec<usize> = compared.iter().filter(here).map(|c| c.place).collect();
            let column = REFERENCE[axis];
            let likely = likely::of_factor(factor, wrong(campaign, &places, factor), column);
            let rows = format!("{} along {}", kind.map_or("all runs", all_of), AXES[axis]);
            found.push(Contradiction::all([LEVEL, column], factor, rows, likely));
        }
    }
    found
}

/// A run that is off what its kind and axis are.
struct Off {
    place: usize,
    factor: f64,
    column: &'static str,
}

fn of_runs(campaign: &Campaign, compared: &[Compared], base: &Base) -> Vec<Contradiction> {
    let mut off: Vec<Off> = compared
        .iter()
        .filter_map(|run| deviation(run, base))
        .collect();
    off.sort_by(|a, b| a.factor.total_cmp(&b.factor));
    let same = |a: &Off, b: &Off| a.column == b.column && near(a.factor, b.factor, OFF - 1.0);
    off.chunk_by(same)
        .map(|group| of_group(campaign, group))
        .collect()
}

fn deviation(run: &Compared, base: &Base) -> Option<Off> {
    let beyond = |axis: usize| {
        let factor = run.factors[axis]? / base.expected(run, axis);
        Some((factor, distance(factor, 1.0)))
    };
    let axes: Vec<_> = (0..3)
        .filter_map(|axis| Some((axis, beyond(axis)?)))
        .collect();
    // The level moves all driven axes alike, a transverse motion those beside the main one.
    if axes.iter().all(|(_, (_, off))| *off > OFF.ln()) {
        let (factor, _) = beyond(run.main)?;
        return Some(Off {
            place: run.place,
            factor,
            column: ANY_REFERENCE,
        });
    }
    let worst = axes.iter().max_by(|(_, a), (_, b)| a.1.total_cmp(&b.1))?;
    let (axis, (factor, off)) = *worst;
    (off > OFF_ACROSS.ln() || axis == run.main && off > OFF.ln()).then_some(Off {
        place: run.place,
        factor,
        column: REFERENCE[axis],
    })
}

fn of_group(campaign: &Campaign, group: &[Off]) -> Contradiction {
    let mut places: Vec<usize> = group.iter().map(|off| off.place).collect();
    places.sort_unstable();
    let column = group[0].column;
    let factors = group.iter().map(|off| off.factor).collect();
    let factor = median(factors).unwrap_or(1.0);
    let wrong = match column {
        ANY_REFERENCE => wrong(campaign, &places, factor),
        _ => Wrong::Reference,
    };
    let likely = match (places.as_slice(), wrong) {
        (&[place], Wrong::Level | Wrong::Unknown) if column == ANY_REFERENCE => {
            let level_g = campaign.runs[place].level_g;
            likely::of_cell(LEVEL, level_g, level_g / factor)
        }
        (&[place], _) => of_reference_cell(campaign, place, column, factor),
        _ => likely::of_factor(factor, wrong, column),
    };
    Contradiction::some(campaign, [LEVEL, column], factor, &places, likely)
}

/// The reference's cell that would agree with the command.
fn of_reference_cell(campaign: &Campaign, place: usize, column: &str, factor: f64) -> String {
    let run = &campaign.runs[place];
    let axis = REFERENCE.iter().position(|name| *name == column);
    let axis = axis.unwrap_or_else(|| main_axis(run));
    let holds_g = run.reference.map_or(0.0, |seen| seen.rms_g[axis]);
    likely::of_cell(REFERENCE[axis], holds_g, holds_g * factor)
}

/// Which of command and reference the extremes of the output contradict, if most of these runs tell.
fn wrong(campaign: &Campaign, places: &[usize], factor: f64) -> Wrong {
    let votes = extremes::command_over_extremes(campaign, places, factor);
    // With the command where that is the nearer one.
    let with_command = |told: &&f64| distance(**told, 1.0) < distance(**told, factor);
    let ayes = votes.iter().filter(with_command).count();
    match (2 * ayes).cmp(&votes.len()) {
        std::cmp::Ordering::Greater => Wrong::Reference,
        std::cmp::Ordering::Less => Wrong::Level,
        std::cmp::Ordering::Equal => Wrong::Unknown,
    }
}
