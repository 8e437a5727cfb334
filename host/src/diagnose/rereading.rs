//! Slips of a hand in all rows alike that no two columns contradict: a dial that turned the other way than its column says, a
//! reference whose axes all look backwards. They cost no parameter. Where the nominal model of the campaign read so fits better
//! than any effect does of the campaign as it stands, that is what is said, and no effect.

use shared::model::SpecificForce;

use super::settle::{Settled, nothing_but};
use crate::campaign::{Campaign, Reading, Series};
use crate::contradictions::Contradiction;
use crate::statics::position;

/// Prior probability of such a slip over that of nothing.
const PRIOR: f64 = 0.02;

/// One other way to read the tables.
struct Rereading {
    campaign: Campaign,
    says: Contradiction,
}

/// The slip that makes better sense of a campaign than what was found; `None` where none does.
pub(super) fn rereading(campaign: &Campaign, settled: &Settled) -> Option<Contradiction> {
    if settled.search.hypotheses[0].fit.members.is_empty() {
        return None;
    }
    let others = dial_turned(campaign).chain(reference_turned(campaign));
    let weighed = others.filter_map(|other| {
        let weight = nothing_but(&other.campaign, &settled.assumptions)? + PRIOR.ln();
        Some((weight, other.says))
    });
    let best = weighed.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 > settled.weight).then_some(best.1)
}

/// The dial turned the other way in one series, or in all.
fn dial_turned(campaign: &Campaign) -> impl Iterator<Item = Rereading> {
    let used = |series: &Series| campaign.readings.iter().any(|r| r.series == *series);
    let series: Vec<Series> = Series::ALL.into_iter().filter(used).collect();
    let single = series.iter().map(|&series| {
        let rows = format!("all readings of series {}", u8::from(series));
        (vec![series], rows)
    });
    let all = (series.len() > 1).then(|| (series.clone(), "all readings".to_owned()));
    let cases: Vec<(Vec<Series>, String)> = single.chain(all).collect();
    cases.into_iter().map(|(series, rows)| {
        let mut turned = campaign.clone();
        for reading in &mut turned.readings {
            if series.contains(&reading.series) {
                turn(reading);
            }
        }
        let likely = "the dial turned the other way".to_owned();
        Rereading {
            campaign: turned,
            says: Contradiction::all(["dial_deg", "u_during_v"], -1.0, rows, likely),
        }
    })
}

fn turn(reading: &mut Reading) {
    let length_g = reading.specific_force_g.length();
    reading.dial_deg = -reading.dial_deg;
    let direction = position(reading).specific_force();
    let [i, p, o] = [direction.i, direction.p, direction.o].map(|part| length_g * part);
    reading.specific_force_g = SpecificForce::new(i, p, o);
}

/// All axes of the reference look backwards: the odd moments have the other sign, all others are the same.
fn reference_turned(campaign: &Campaign) -> Option<Rereading> {
    let mut turned = campaign.clone();
    let references = turned
        .runs
        .iter_mut()
        .filter_map(|run| run.reference.as_mut());
    let mut seen = false;
    for reference in references {
        seen |= reference.skewness.iter().any(|skewness| *skewness != 0.0);
        reference.skewness = reference.skewness.map(|skewness| -skewness);
    }
    let likely = "the reference looks backwards along all its axes".to_owned();
    seen.then(|| Rereading {
        campaign: turned,
        says: Contradiction::all(
            ["ref_*_skew", "u_during_v"],
            -1.0,
            "all random runs",
            likely,
        ),
    })
}
