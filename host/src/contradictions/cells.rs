//! Cells that hold what nobody measured: zeros, and one value in many rows.

use super::robust::FEWEST;
use super::{ANY_REFERENCE, Contradiction, LEAST_RMS_G, REFERENCE, commanded_rms_g, driven, runs};
use crate::campaign::{Campaign, Run};

/// A cell of vibration.csv that cannot be.
#[derive(Clone, Debug, PartialEq)]
pub struct Impossible {
    /// Place of the run in the campaign.
    pub place: usize,
    /// Column of the cell.
    pub column: &'static str,
    /// What is wrong with it.
    pub problem: String,
}

/// What to do instead.
const LEAVE_EMPTY: &str = "leave the cell empty where nothing was measured";

/// The first cell that cannot be: a reference of 0 on a driven axis, extremes beyond the mean between them.
pub fn impossible(campaign: &Campaign) -> Option<Impossible> {
    runs(campaign).find_map(|(place, run)| {
        let (column, problem) = zero_reference(run).or_else(|| extremes(campaign, run))?;
        Some(Impossible {
            place,
            column,
            problem,
        })
    })
}

fn zero_reference(run: &Run) -> Option<(&'static str, String)> {
    let rms_g = run.reference?.rms_g;
    let moved = |axis: &usize| commanded_rms_g(run) * run.direction[*axis].abs() > LEAST_RMS_G;
    let axis = driven(run).filter(moved).find(|&axis| rms_g[axis] == 0.0)?;
    let problem = format!("reference 0 on a driven axis: {LEAVE_EMPTY}");
    Some((REFERENCE[axis], problem))
}

/// Standard uncertainties of a mean by which it may lie beyond an extreme.
const SIGMAS: f64 = 10.0;

fn extremes(campaign: &Campaign, run: &Run) -> Option<(&'static str, String)> {
    let measured = run.measured?;
    let (found, mean_v) = (measured.extremes?, measured.during_v);
    if !driven(run).any(|axis| axis == 0) || commanded_rms_g(run) < LEAST_RMS_G {
        return None;
    }
    let peak_rel_error = campaign.config.peak_rel_error();
    let size_v = found.minimum_v.abs().max(found.maximum_v.abs());
    let allowed_v = peak_rel_error * size_v + SIGMAS * measured.sigma_v;
    let mean = format!("the mean u_during_v = {mean_v}: {LEAVE_EMPTY}");
    if found.minimum_v > mean_v + allowed_v {
        Some(("u_min_v", format!("{} is above {mean}", found.minimum_v)))
    } else if found.maximum_v < mean_v - allowed_v {
        Some(("u_max_v", format!("{} is below {mean}", found.maximum_v)))
    } else if found.minimum_v == found.maximum_v {
        let problem = format!("is u_min_v too, though IA is driven: {LEAVE_EMPTY}");
        Some(("u_max_v", problem))
    } else {
        None
    }
}

/// Runs of different commands with one and the same measurement to the last digit.
pub(super) fn repeated(campaign: &Campaign) -> Vec<Contradiction> {
    let extremes = |run: &Run| {
        let found = run.measured?.extremes?;
        Some([found.minimum_v, found.maximum_v, 0.0])
    };
    let reference = |run: &Run| Some(run.reference?.rms_g);
    let mut found = of_same(campaign, ["u_min_v", "u_max_v"], extremes);
    found.extend(of_same(campaign, [super::LEVEL, ANY_REFERENCE], reference));
    found
}

fn of_same(
    campaign: &Campaign,
    between: [&str; 2],
    measurement: impl Fn(&Run) -> Option<[f64; 3]>,
) -> Vec<Contradiction> {
    let mut seen: Vec<([f64; 3], usize)> = runs(campaign)
        .filter_map(|(place, run)| Some((measurement(run)?, place)))
        .collect();
    let count = seen.len();
    let order = |a: &[f64; 3], b: &[f64; 3]| {
        let parts = a.iter().zip(b).map(|(x, y)| x.total_cmp(y));
        parts.fold(std::cmp::Ordering::Equal, |first, next| first.then(next))
    };
    seen.sort_by(|(a, i), (b, j)| order(a, b).then(i.cmp(j)));
    let groups = seen.chunk_by(|(a, _), (b, _)| a == b);
    let groups = groups.map(|group| group.iter().map(|(_, place)| *place).collect());
    groups
        .filter(|places: &Vec<usize>| places.len() >= FEWEST && commands_differ(campaign, places))
        .map(|places| {
            let likely = format!(
                "the same value in {} rows, an average perhaps; {LEAVE_EMPTY}",
                places.len()
            );
            match places.len() == count {
                true => Contradiction::all(between, 1.0, "all runs", likely),
                false => Contradiction::some(campaign, between, 1.0, &places, likely),
            }
        })
        .collect()
}

fn commands_differ(campaign: &Campaign, places: &[usize]) -> bool {
    let rms_g = |&place: &usize| commanded_rms_g(&campaign.runs[place]);
    let least = places.iter().map(rms_g).fold(f64::INFINITY, f64::min);
    let most = places.iter().map(rms_g).fold(0.0, f64::max);
    most > super::levels::OFF * least
}
