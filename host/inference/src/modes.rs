//! Other places of a component's parameters at which a fit does about as well: a likelihood of several modes, each of which the
//! curvature at one of them knows nothing of.

use crate::fit::{Fit, fit};
use crate::model::{Kind, Member, SeparableModel};
use crate::prior::Prior;
use crate::remainder::Remainder;
use crate::search::{SearchPolicy, Seek, Start, Starts, keep_best};
use crate::variance::fit_with_size;

/// Most places that are fitted. Chosen: plans of a few angles alias a period to some eight others.
const MOST: usize = 12;
/// Standard deviations of a parameter within which two fits are at one place.
const ONE_PLACE: f64 = 4.0;
/// Share of the posterior from which on a place counts.
const LEAST_SHARE: f64 = 1e-3;

/// A place of the parameters.
pub struct Mode {
    /// The fit there.
    pub fit: Fit,
    /// Its share of the posterior among all places.
    pub share: f64,
}

/// The places of member `m` of a fit, by the evidence at each; that of the fit itself is the first. Modes lie apart along the
/// component's first parameter that is not in proportion, and are looked for where its grid has a peak.
pub fn modes(model: &dyn SeparableModel, policy: &SearchPolicy, fit: &Fit, m: usize) -> Vec<Mode> {
    let mut places = vec![fit.clone()];
    for members in starts(model, policy, fit, m) {
        let Some(found) = fit_with_size(model, members, &fit.precision_factor) else {
            continue;
        };
        if !places
            .iter()
            .any(|known| at_one_place(model, known, &found, m))
        {
            places.push(found);
        }
    }
    let greatest = places
        .iter()
        .map(|fit| fit.log_evidence)
        .fold(f64::NEG_INFINITY, f64::max);
    let weight = |fit: &Fit| (fit.log_evidence - greatest).exp();
    let total: f64 = places.iter().map(weight).sum();
    let mode = |fit: Fit| Mode {
        share: weight(&fit) / total,
        fit,
    };
    let mut modes = places.into_iter().map(mode);
    let here = modes.next();
    let others = modes.filter(|mode| mode.share > LEAST_SHARE);
    here.into_iter().chain(others).collect()
}

/// Members with member `m` at each peak of its grid, the highest first.
fn starts(
    model: &dyn SeparableModel,
    policy: &SearchPolicy,
    known: &Fit,
    m: usize,
) -> Vec<Vec<Member>> {
    let number = known.members[m].component;
    let component = &model.components()[number];
    let first = component.linear();
    let along = component
        .parameters
        .get(first)
        .map(|parameter| parameter.prior);
    let smooth = matches!(along, Some(Prior::Nonlinear { .. }));
    if !smooth || component.kind == Kind::AddsVariance || component.begins_at_nothing() {
        return Vec::new();
    }
    let mut others = known.members.clone();
    others.remove(m);
    let Some(base) = fit(model, others, &known.precision_factor, 2) else {
        return Vec::new();
    };
    let none = Starts::default();
    let seek = Seek {
        model,
        policy,
        starts: &none,
    };
    let remainder = Remainder::new(model, &base);
    // The best of each value along the grid.
    let mut best: Vec<(f64, Member)> = Vec::new();
    for values in component.grid() {
        let start = Start::of(Member {
            component: number,
            values,
        });
        let gain = seek.gain(&base, &remainder, &start, &[]);
        keep_best(&mut best, first, gain, &start.member);
    }
    best.sort_by(|a, b| a.1.values[first].total_cmp(&b.1.values[first]));
    let highest = best.iter().map(|(gain, _)| *gain).fold(0.0, f64::max);
    let at = |k: Option<usize>| {
        k.and_then(|k| best.get(k))
            .map_or(f64::NEG_INFINITY, |b| b.0)
    };
    let is_peak = |k: &usize| {
        let here = best[*k].0;
        here > policy.mode_worth * highest && here >= at(k.checked_sub(1)) && here > at(Some(k + 1))
    };
    let mut peaks: Vec<usize> = (0..best.len()).filter(is_peak).collect();
    peaks.sort_by(|a, b| best[*b].0.total_cmp(&best[*a].0));
    peaks.truncate(MOST);
    let with = |k: usize| {
        let mut members = known.members.clone();
        members[m] = best[k].1.clone();
        members
    };
    peaks.into_iter().map(with).collect()
}

fn at_one_place(model: &dyn SeparableModel, one: &Fit, other: &Fit, m: usize) -> bool {
    let component = &model.components()[one.members[m].component];
    let first = component.linear();
    let prior = component.parameters[first].prior;
    let place = |fit: &Fit| prior.inner(fit.members[m].values[first]);
    let variance = |fit: &Fit| fit.unknown(m, first).map_or(0.0, |i| fit.covariance(i, i));
    let sigma = variance(one).max(variance(other)).sqrt();
    (place(one) - place(other)).abs() <= ONE_PLACE * sigma
}
