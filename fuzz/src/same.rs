//! What must not change an answer: the order of rows, the unit of the output, the origin of time, the instrument's name, a
//! reading taken as two of less weight.

use arbitrary::Unstructured;
use host::campaign::Campaign;
use host::diagnose::static_test;
use host::prediction::predict;
use host::statics::{Method, identify};
use shared::model::NOMINAL;

use crate::Judged;
use crate::draw::below;

/// Part of a standard uncertainty that rounding may move an estimate by; and beside a blind direction, of which a determined
/// coefficient may hold so much (`shared::identify::blindness`).
const ROUNDING: f64 = 1e-3;
const BESIDE_BLIND: f64 = 3e-2;

/// A change with what it multiplies K1 by.
type Change = (&'static str, fn(&mut Campaign, usize), f64);

const SPLIT: &str = "a reading split in two";

const CHANGES: [Change; 5] = [
    ("rows permuted", permute, 1.0),
    ("volts as millivolts", millivolts, 1e3),
    ("time shifted", shift, 1.0),
    ("instrument renamed", rename, 1.0),
    (SPLIT, split, 1.0),
];

fn permute(campaign: &mut Campaign, by: usize) {
    let count = campaign.readings.len();
    campaign.readings.rotate_left(by % count);
    campaign.readings.swap(0, by % count);
}

fn millivolts(campaign: &mut Campaign, _: usize) {
    campaign.config.instrument.scale_factor_nominal_v_per_g *= 1e3;
    for reading in &mut campaign.readings {
        reading.output_v *= 1e3;
        reading.sigma_v *= 1e3;
    }
    for measured in campaign
        .runs
        .iter_mut()
        .filter_map(|run| run.measured.as_mut())
    {
        measured.before_v *= 1e3;
        measured.during_v *= 1e3;
        measured.sigma_v *= 1e3;
        if let Some(after_v) = &mut measured.after_v {
            *after_v *= 1e3;
        }
        if let Some(drift) = &mut measured.drift {
            drift.v_per_s *= 1e3;
            drift.sigma_v_per_s *= 1e3;
        }
        if let Some(extremes) = &mut measured.extremes {
            extremes.minimum_v *= 1e3;
            extremes.maximum_v *= 1e3;
        }
    }
}

fn shift(campaign: &mut Campaign, by: usize) {
    let by = 86_400.0 * by as f64;
    campaign
        .readings
        .iter_mut()
        .for_each(|reading| reading.time_s += by);
    campaign.runs.iter_mut().for_each(|run| run.time_s += by);
}

fn rename(campaign: &mut Campaign, _: usize) {
    campaign.config.instrument.serial = "another".into();
}

fn split(campaign: &mut Campaign, which: usize) {
    let which = which % campaign.readings.len();
    campaign.readings[which].sigma_v *= std::f64::consts::SQRT_2;
    let mut twin = campaign.readings[which].clone();
    let last = campaign.readings.iter().map(|reading| reading.order).max();
    twin.order = last.unwrap_or(0).wrapping_add(1);
    campaign.readings.push(twin);
}

/// Identification and prediction of a sound campaign stay what they are under a change that means nothing.
pub fn check(draw: &mut Unstructured<'_>, campaign: &Campaign) -> Judged {
    let change = CHANGES[below(draw, CHANGES.len())];
    under(change, below(draw, 1000), campaign)
}

/// The same under every change.
pub fn check_all(campaign: &Campaign) -> Judged {
    CHANGES
        .iter()
        .try_for_each(|change| under(*change, 7, campaign))
}

fn under((what, change, scale): Change, by: usize, campaign: &Campaign) -> Judged {
    let mut original = campaign.clone();
    // Two readings at a mark are two settings: with a repeatability they tell more than one.
    original.config.bench.dial_repeat_sigma_arcsec = 0.0;
    let mut changed = original.clone();
    change(&mut changed, by);
    let identified = [&original, &changed].map(|c| identify(c, Method::LeastSquares, None));
    let (Ok(a), Ok(b)) = (&identified[0], &identified[1]) else {
        return match identified.iter().all(Result::is_err) {
            true => Ok(()),
            false => Err(format!("{what}: refused on one side alone")),
        };
    };
    if a.rank != b.rank {
        return Err(format!("{what}: rank {} becomes {}", a.rank, b.rank));
    }
    let part = if a.rank == NOMINAL {
        ROUNDING
    } else {
        BESIDE_BLIND
    };
    for (k, (a, b)) in a.coefficients.iter().zip(&b.coefficients).enumerate() {
        let scale = if k == 0 { scale } else { 1.0 };
        near(
            &format!("{what}: coefficient {k}"),
            part,
            a.scaled(scale).known(),
            b.known(),
        )?;
    }
    // Whether a reading belongs is decided by all: a decision may tip where one of them became two.
    if what == SPLIT {
        return Ok(());
    }
    let aside = [&original, &changed].map(set_aside);
    if aside[0] != aside[1] {
        return Err(format!(
            "{what}: set aside {:?}, then {:?}",
            aside[0], aside[1]
        ));
    }
    let predicted = [&original, &changed].map(|c| predict(c, &c.runs, None));
    if let [Ok(a), Ok(b)] = &predicted {
        for (a, b) in a.runs.iter().zip(&b.runs) {
            near(
                &format!("{what}: run {}", a.run),
                part,
                a.vre_g.known(),
                b.vre_g.known(),
            )?;
        }
    }
    Ok(())
}

/// Readings that do not belong, by their numbers in order.
fn set_aside(campaign: &Campaign) -> Vec<u64> {
    let judged = static_test(campaign);
    let aside = judged.suspects.iter().filter(|suspect| suspect.set_aside);
    let mut numbers: Vec<u64> = aside.map(|suspect| suspect.number).collect();
    numbers.sort_unstable();
    numbers
}

/// Two estimates are the same within rounding.
fn near(what: &str, part: f64, a: Option<(f64, f64)>, b: Option<(f64, f64)>) -> Judged {
    let same = match (a, b) {
        (Some((a, sigma)), Some((b, other))) => {
            (a - b).abs() <= part * sigma + 1e-9 * a.abs() && (sigma - other).abs() <= part * sigma
        }
        (None, None) => true,
        _ => false,
    };
    match same {
        true => Ok(()),
        false => Err(format!("{what}: {a:?} becomes {b:?}")),
    }
}
