//! Which rows belong, and how far the stated noise holds: first by what a flexible model leaves, then by what the most
//! probable hypothesis leaves, until the two agree.
//!
//! A gross error and an effect may stand in for one another: a narrow resonance looks like a few bad runs. So the search is
//! made with all rows as well, and the two are compared by their evidence; each row that does not belong costs as much as an
//! error of hand is improbable.

use inference::adequacy::leverages;
use inference::fit::{Fit, fit_base};
use inference::model::SeparableModel;
use inference::observations::Column;
use inference::outlier::distances;
use inference::search::{Search, SearchPolicy, search};

use crate::campaign::Campaign;
use crate::campaign_model::CampaignModel;
use crate::campaign_model::assumptions::{Assumptions, Noise};
use crate::effects::Effect;
use crate::forward::contribution::Observable;

/// Distance in standard deviations from which on a row does not belong: by chance one of 1e9.
const GROSS: f64 = 6.0;
/// Distance up to which a row that was set aside belongs after all.
const STILL_GROSS: f64 = 5.0;
/// Plateaus of a run.
const PLATEAUS: [Observable; 3] = [Observable::Before, Observable::During, Observable::After];
/// Most rows of a table that are set aside, as a share and at least.
const MOST_SHARE: f64 = 0.05;
const MOST: usize = 3;
/// Most rounds of search and judgement.
const ROUNDS: usize = 3;
/// Robust standard deviation of the logarithm of a scale by the median of n moduli, times sqrt n.
const SPREAD_OF_MEDIAN: f64 = 1.16;
/// Its standard deviations at which a factor on the noise is called one.
const CLEAR: f64 = 4.0;
/// Change of a factor's logarithm up to which two judgements agree.
const AGREE: f64 = 0.1;
/// Fewest rows that tell a factor.
const FEWEST: usize = 8;
/// Prior probability of an error of hand in a row, and the width of such errors in standard deviations (half, of a Cauchy
/// distribution).
const PRIOR_GROSS: f64 = 2e-3;
const GROSS_WIDTH: f64 = 30.0;
/// Standard deviation by which a reading that is set aside counts, over a usual one of a microg.
const EXCLUDED_OVER_STATED: f64 = 1e9;
/// 1 / 0.6745: a normal standard deviation over the median of moduli.
const MEDIAN_TO_SIGMA: f64 = 1.482_6;

/// A campaign's model under assumptions that agree with what was found.
pub(super) struct Settled {
    pub(super) model: CampaignModel,
    pub(super) search: Search,
    pub(super) assumptions: Assumptions,
    /// Rows that do not belong, with their distance in standard deviations.
    pub(super) suspects: Vec<Suspect>,
    /// Each kind of noise: the factor on its stated size by what the answer leaves, and its relative standard uncertainty.
    pub(super) noise: Vec<(Noise, f64, f64)>,
}

/// A row that does not belong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Suspect {
    /// Whether it is a reading (or a run), and its place in the campaign.
    pub(super) reading: bool,
    pub(super) place: usize,
    pub(super) distance: f64,
}

/// Searches a campaign until assumptions and answer agree. `None` if it determines nothing.
pub(super) fn settle(campaign: &Campaign, effects: &[&'static Effect]) -> Option<Settled> {
    let stated = Assumptions::default();
    let plain = CampaignModel::assuming(campaign, &[], effects, &stated);
    let flexible = judge(campaign, &plain, &fit_base(&plain)?, true, &stated);
    let mut best = attempt(campaign, effects, stated)?;
    if !agree(&flexible, &best.assumptions) {
        best = better(best, attempt(campaign, effects, flexible)?);
    }
    for _ in 0..ROUNDS {
        let judged = judge(campaign, &best.model, best.fit(), false, &best.assumptions);
        if agree(&judged, &best.assumptions) {
            break;
        }
        let next = attempt(campaign, effects, judged)?;
        if next.weight() < best.weight() {
            break;
        }
        best = next;
    }
    let Attempt {
        model,
        search,
        assumptions,
    } = best;
    let fit = &search.hypotheses[0].fit;
    let suspects = suspects(campaign, &model, fit, &assumptions);
    let noise = noise(&model, fit, &assumptions);
    Some(Settled {
        model,
        search,
        assumptions,
        suspects,
        noise,
    })
}

/// A search under some assumptions.
struct Attempt {
    model: CampaignModel,
    search: Search,
    assumptions: Assumptions,
}

fn attempt(
    campaign: &Campaign,
    effects: &[&'static Effect],
    assumptions: Assumptions,
) -> Option<Attempt> {
    let mut model = CampaignModel::assuming(campaign, &[], effects, &assumptions);
    let search = search(&mut model, &SearchPolicy::default())?;
    Some(Attempt {
        model,
        search,
        assumptions,
    })
}

impl Attempt {
    fn fit(&self) -> &Fit {
        &self.search.hypotheses[0].fit
    }

    /// Logarithm of the posterior weight of what it found, rows that do not belong and factors on the noise included, up to
    /// what all attempts share.
    fn weight(&self) -> f64 {
        let excluded =
            self.assumptions.excluded_readings.len() + self.assumptions.excluded_runs.len();
        // An error of a few tens of standard deviations under its own distribution, against a sound row's.
        let cost = -PRIOR_GROSS.ln() + (GROSS_WIDTH * (std::f64::consts::PI / 2.0).sqrt()).ln();
        let evidence = self.search.hypotheses[0].log_posterior_weight;
        evidence - cost * excluded as f64 - self.log_spread()
    }

    /// Sum of the logarithms of the standard deviations that the factors on the noise change.
    fn log_spread(&self) -> f64 {
        let assumptions = &self.assumptions;
        let rows = |observables: &[Observable]| -> f64 {
            let all = observables.iter().map(|o| self.model.rows(*o).len());
            all.sum::<usize>() as f64
        };
        let plateaus = rows(&[Observable::Before, Observable::During, Observable::After]);
        let drifts = rows(&[Observable::Drift]);
        // A reading that is set aside counts with the noise that it was stated to have.
        let set_aside = assumptions.excluded_readings.len() as f64 * EXCLUDED_OVER_STATED.ln();
        self.model.observations().log_spread_of_correlated() - set_aside
            + plateaus * assumptions.factor(Noise::Plateaus).ln()
            + drifts * assumptions.factor(Noise::Drift).ln()
    }
}

fn better(one: Attempt, other: Attempt) -> Attempt {
    if other.weight() > one.weight() {
        other
    } else {
        one
    }
}

fn agree(one: &Assumptions, other: &Assumptions) -> bool {
    let factors = one.noise_factor.iter().zip(&other.noise_factor);
    let alike = |(a, b): (&f64, &f64)| (a / b).ln().abs() < AGREE;
    one.excluded_readings == other.excluded_readings
        && one.excluded_runs == other.excluded_runs
        && factors.map(alike).all(|alike| alike)
}

/// What a fit says of the assumptions that it was made under: noise and rows judged by it. `flexible` lets smooth functions
/// of the conditions take what the fit leaves.
fn judge(
    campaign: &Campaign,
    model: &CampaignModel,
    fit: &Fit,
    flexible: bool,
    under: &Assumptions,
) -> Assumptions {
    let mut further: Vec<Column> = Vec::new();
    if flexible {
        further.extend(model.smooth_families().into_iter().flatten());
    }
    let mut judged = Assumptions::default();
    for suspect in suspects(campaign, model, fit, under) {
        if suspect.distance.abs() > STILL_GROSS {
            judged.set_aside(suspect.reading, suspect.place);
        }
    }
    // One row at a time: a bad one makes its neighbours look bad.
    loop {
        let distances = distances(model, fit, &further);
        for noise in Noise::ALL {
            let seen = rows(model, noise)
                .into_iter()
                .map(|row| distances[row].abs());
            let seen: Vec<f64> = seen.filter(|z| *z > 0.0).collect();
            judged.noise_factor[noise as usize] = factor(seen, under.factor(noise));
        }
        let Some((reading, place)) = farthest(campaign, model, &distances, under, &judged) else {
            return judged;
        };
        judged.set_aside(reading, place);
        further.extend(shifts(model, reading, place));
    }
}

/// The row that lies farthest from what the others say of it, if it does not belong and may still be set aside: whether it
/// is a reading, and its place.
fn farthest(
    campaign: &Campaign,
    model: &CampaignModel,
    distances: &[f64],
    under: &Assumptions,
    judged: &Assumptions,
) -> Option<(bool, usize)> {
    let relative = |noise: Noise| judged.factor(noise) / under.factor(noise);
    let first = model.rows(Observable::Static).start;
    let readings = (0..campaign.readings.len())
        .filter(|place| !judged.excluded_readings.contains(place))
        .map(|place| {
            let distance = (distances[first + place] / relative(Noise::Readings)).abs();
            (distance, (true, place))
        });
    let runs = (0..campaign.runs.len())
        .filter(|place| !judged.excluded_runs.contains(place))
        .map(|place| {
            let row = model.row_of_run(place);
            let at = |o: Observable| distances[model.rows(o).start + row].abs();
            let plateau = PLATEAUS.map(at).into_iter().fold(0.0, f64::max);
            let drift = at(Observable::Drift) / relative(Noise::Drift);
            (
                (plateau / relative(Noise::Plateaus)).max(drift),
                (false, place),
            )
        });
    let full = |set_aside: usize, count: usize| {
        set_aside >= ((MOST_SHARE * count as f64) as usize).max(MOST)
    };
    let (distance, row) = readings.chain(runs).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let full = match row.0 {
        true => full(judged.excluded_readings.len(), campaign.readings.len()),
        false => full(judged.excluded_runs.len(), campaign.runs.len()),
    };
    (distance > GROSS && !full).then_some(row)
}

/// Columns of shifts of free size in a reading, or in every plateau and the drift of a run.
fn shifts(model: &CampaignModel, reading: bool, place: usize) -> Vec<Column> {
    let observations = model.observations();
    let unit = |observable: Observable, row: usize| {
        let mut column = Column::zero(observations.len());
        column.add_at(model.rows(observable), row, 1.0);
        observations.whiten(column)
    };
    if reading {
        return vec![unit(Observable::Static, place)];
    }
    let row = model.row_of_run(place);
    let observables = PLATEAUS.into_iter().chain([Observable::Drift]);
    observables
        .map(|observable| unit(observable, row))
        .collect()
}

/// Rows that tell the noise of a kind: plateaus at rest, since those during runs hold the vibration error.
fn rows(model: &CampaignModel, noise: Noise) -> Vec<usize> {
    let observables: &[Observable] = match noise {
        Noise::Readings => &[Observable::Static],
        Noise::Plateaus => &[Observable::Before, Observable::After],
        Noise::Drift => &[Observable::Drift],
    };
    let observations = model.observations();
    let all = observables
        .iter()
        .flat_map(|o| observations.observed_rows(model.rows(*o)));
    all.collect()
}

/// The factor on the stated noise by moduli of distances under the factor `under`; 1 where it is not clearly another.
fn factor(mut moduli: Vec<f64>, under: f64) -> f64 {
    let n = moduli.len();
    if n < FEWEST {
        return 1.0;
    }
    moduli.sort_by(f64::total_cmp);
    let found = under * MEDIAN_TO_SIGMA * moduli[n / 2];
    let clear = CLEAR * SPREAD_OF_MEDIAN / (n as f64).sqrt();
    if found.ln().abs() > clear { found } else { 1.0 }
}

/// Of each row that is set aside its distance from what the answer expects of it.
fn suspects(
    campaign: &Campaign,
    model: &CampaignModel,
    fit: &Fit,
    assumptions: &Assumptions,
) -> Vec<Suspect> {
    if assumptions.excluded_readings.is_empty() && assumptions.excluded_runs.is_empty() {
        return Vec::new();
    }
    // The same answer, held against all rows.
    let all = Assumptions {
        noise_factor: assumptions.noise_factor,
        ..Assumptions::default()
    };
    let whole = CampaignModel::assuming(campaign, &[], model.effects(), &all);
    let mut held = fit.clone();
    held.residuals = residuals(&whole, fit);
    let distances = distances(&whole, &held, &[]);
    let readings = assumptions.excluded_readings.iter().map(|&place| Suspect {
        reading: true,
        place,
        distance: distances[whole.rows(Observable::Static).start + place],
    });
    let runs = assumptions.excluded_runs.iter().map(|&place| {
        let row = whole.row_of_run(place);
        let at = |o: Observable| distances[whole.rows(o).start + row];
        let four = [
            Observable::During,
            Observable::Before,
            Observable::After,
            Observable::Drift,
        ];
        let far = four
            .map(at)
            .into_iter()
            .fold(0.0, |far: f64, z| if z.abs() > far.abs() { z } else { far });
        Suspect {
            reading: false,
            place,
            distance: far,
        }
    });
    readings.chain(runs).collect()
}

/// Whitened residuals of all rows of a model under a fit that was made without some of them.
fn residuals(model: &CampaignModel, fit: &Fit) -> Vec<f64> {
    let (values, _) = model.prediction(&fit.members, &fit.base_values);
    let observed = &model.observations().observed().values;
    let mut residuals: Vec<f64> = observed.iter().zip(&values).map(|(y, f)| y - f).collect();
    for (row, factor) in model.observations().uncertain().zip(&fit.precision_factor) {
        residuals[row] *= factor.sqrt();
    }
    residuals
}

/// The factor on each kind of stated noise by what a fit leaves, with its relative standard uncertainty.
fn noise(model: &CampaignModel, fit: &Fit, assumptions: &Assumptions) -> Vec<(Noise, f64, f64)> {
    let leverages = leverages(model, fit);
    let of = |noise: Noise| {
        let rows = rows(model, noise);
        let chi2: f64 = rows.iter().map(|&row| fit.residuals[row].powi(2)).sum();
        let freedom: f64 = rows.iter().map(|&row| 1.0 - leverages[row]).sum();
        (freedom >= FEWEST as f64).then(|| {
            let found = assumptions.factor(noise) * (chi2 / freedom).sqrt();
            (noise, found, (2.0 * freedom).sqrt().recip())
        })
    };
    Noise::ALL.into_iter().filter_map(of).collect()
}
