//! Which rows belong, and how far the stated noise holds, by what a fit leaves.

use inference::adequacy::leverages;
use inference::fit::{Fit, fit_base};
use inference::model::SeparableModel;
use inference::observations::Column;
use inference::outlier::distances;
use inference::scales::Beyond;

use super::CampaignModel;
use super::assumptions::{Assumptions, Noise};
use super::observables::static_parts;
use super::reference::Reference;
use crate::campaign::{Campaign, Run};
use crate::forward::contribution::Observable;
use crate::median::{SPREAD_OF_SCALE, scale};

/// Distance in standard deviations from which on a row does not belong: by chance one of 1e9.
const GROSS: f64 = 6.0;
/// Distance up to which a row that was set aside belongs after all.
const STILL_GROSS: f64 = 5.0;
/// Plateaus of a run.
const PLATEAUS: [Observable; 3] = [Observable::Before, Observable::During, Observable::After];
/// Most rows of a table that are set aside, as a share; one at least.
const MOST_SHARE: f64 = 0.05;
/// Factor beyond which it is not the noise that a table states too small.
const MOST_FACTOR: f64 = 5.0;
/// Standard deviations of its logarithm at which a factor on the noise is taken up. At less the misfit that it leaves, some
/// 3 standard deviations of chi-square, is no misfit to the search either.
const CLEAR: f64 = 2.5;
/// The same of a first step, at which a factor is looked at more closely.
const DOUBT: f64 = 0.5 * CLEAR;
/// Factor up to which numbers were computed, not measured: no noise is stated so much too large.
const COMPUTED: f64 = 0.05;
/// Fewest rows that tell a factor.
const FEWEST: usize = 8;

/// Standard deviations of its logarithm from which on a factor on the noise is told: by chance one in 1e4. A static test by
/// itself takes up no other one.
pub const TOLD: f64 = 4.0;
/// Most rounds of fit and judgement of a static test.
const ROUNDS: usize = 4;

/// A row that does not belong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suspect {
    /// Whether it is a reading, or a run.
    pub reading: bool,
    /// Its place in the campaign.
    pub place: usize,
    /// In standard deviations, from what all other rows say of it.
    pub distance: f64,
    /// Number of its observations beside the one that lies so far.
    pub others: usize,
}

/// What is assumed of a campaign before it is searched: runs that contradict themselves are set aside, and the table follows
/// its command or the reference, whichever the nominal model bears out. `None` if it determines nothing.
pub fn beforehand(campaign: &Campaign) -> Option<Assumptions> {
    let command = Assumptions::of(campaign);
    let runs: Vec<&Run> = campaign.runs.iter().collect();
    if Reference::of(campaign, &runs).is_none_or(|reference| reference.table_scatter == 0.0) {
        return Some(command);
    }
    let reference = Assumptions {
        table_scatters: true,
        ..command.clone()
    };
    let misfit = |assumptions: &Assumptions| {
        let model = CampaignModel::assuming(campaign, &[], &[], assumptions);
        let fit = fit_base(&model)?;
        // The reference's own rows differ in their weights: what the instrument says decides.
        let during = model.rows(Observable::During);
        Some(fit.residuals[during].iter().map(|z| z * z).sum::<f64>())
    };
    let better = misfit(&reference)? < misfit(&command)?;
    Some(if better { reference } else { command })
}

/// A static test by itself, under assumptions that agree with what it shows.
pub struct StaticTest {
    /// Its model, without runs.
    pub model: CampaignModel,
    /// The nominal model's fit.
    pub fit: Fit,
    /// What belongs, and how large the noise is.
    pub assumptions: Assumptions,
}

/// Judges the static test of a campaign. `None` if it determines nothing.
pub fn static_test(campaign: &Campaign) -> Option<StaticTest> {
    let alone = Campaign {
        runs: Vec::new(),
        ..campaign.clone()
    };
    let mut assumed = Assumptions::default();
    let mut rounds = 0;
    loop {
        let model = CampaignModel::assuming(&alone, &[], &[], &assumed);
        let fit = fit_base(&model)?;
        // Smooth functions of the angle take what an effect leaves: it must not pass for rows or noise.
        let judged = judge(&alone, &model, &fit, true, &assumed);
        if rounds == ROUNDS || judged.agree(&assumed) {
            return Some(StaticTest {
                model,
                fit,
                assumptions: assumed,
            });
        }
        rounds += 1;
        assumed = judged;
    }
}

impl StaticTest {
    /// The factor on the stated noise of readings, and its relative standard uncertainty; `None` of too few. That on the errors
    /// of the dial's marks besides, where it is another than one.
    pub fn scatter(&self, campaign: &Campaign) -> Vec<(Noise, f64, f64)> {
        let further = self.model.flexible();
        let distances = distances(&self.model, &self.fit, &further);
        let readings = scatter(&self.model, &distances, Noise::Readings, &self.assumptions);
        let mut found =
            Vec::from_iter(readings.map(|(f, relative)| (Noise::Readings, f, relative)));
        let (model, fit) = (&self.model, &self.fit);
        found.extend(scale_of_marks(
            campaign,
            model,
            fit,
            &further,
            &self.assumptions,
        ));
        found
    }
}

/// What a fit says of the assumptions that it was made under: noise and rows judged by it. `flexible` lets smooth functions
/// of the conditions take what the fit leaves.
pub fn judge(
    campaign: &Campaign,
    model: &CampaignModel,
    fit: &Fit,
    flexible: bool,
    under: &Assumptions,
) -> Assumptions {
    let mut further: Vec<Column> = Vec::new();
    if flexible {
        further.extend(model.flexible());
    }
    let mut judged = Assumptions {
        table_scatters: under.table_scatters,
        ..Assumptions::without(under.contradictory_runs.clone())
    };
    for suspect in suspects(campaign, model, fit, under) {
        if suspect.distance.abs() > STILL_GROSS {
            judged.set_aside(suspect.reading, suspect.place);
        }
    }
    let clear = match campaign.runs.is_empty() {
        true => TOLD,
        false => CLEAR,
    };
    // One row at a time: a bad one makes its neighbours look bad.
    loop {
        let distances = distances(model, fit, &further);
        for noise in Noise::ALL {
            let found = scatter(model, &distances, noise, under);
            judged.noise_factor[noise as usize] =
                found.map_or(1.0, |found| clear_factor(found, clear));
        }
        let readings = Readings::new(campaign, model, fit, &further, under).scales(DOUBT);
        let scales = readings.map(|found| found.map(|found| clear_factor(found, clear)));
        // Where the marks are as they are stated, the robust scale of distances is the better one.
        if let Some([own, marks]) = scales.filter(|[_, marks]| *marks != 1.0) {
            judged.noise_factor[Noise::Readings as usize] = own;
            judged.noise_factor[Noise::Marks as usize] = marks;
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
    let full =
        |set_aside: usize, count: usize| set_aside as f64 >= (MOST_SHARE * count as f64).ceil();
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
        // Not told by the size of residuals: readings share them.
        Noise::Marks => &[],
    };
    let observations = model.observations();
    let all = observables
        .iter()
        .flat_map(|o| observations.observed_rows(model.rows(*o)));
    all.collect()
}

/// The factor on a kind of stated noise by the scale of distances, and its relative standard uncertainty; `None` of too few
/// rows.
fn scatter(
    model: &CampaignModel,
    distances: &[f64],
    noise: Noise,
    under: &Assumptions,
) -> Option<(f64, f64)> {
    let seen = rows(model, noise)
        .into_iter()
        .map(|row| distances[row].abs());
    let moduli: Vec<f64> = seen.filter(|z| *z > 0.0).collect();
    let n = moduli.len();
    if n < FEWEST {
        return None;
    }
    let found = under.factor(noise) * scale(&moduli)?;
    Some((found, SPREAD_OF_SCALE / (n as f64).sqrt()))
}

/// What tells the factors on the noise of the readings and on the errors of the dial's marks.
struct Readings<'m> {
    campaign: &'m Campaign,
    model: &'m CampaignModel,
    under: &'m Assumptions,
    beyond: Beyond,
    residuals: &'m [f64],
}

impl<'m> Readings<'m> {
    /// Beyond what a fit and `further` columns take.
    fn new(
        campaign: &'m Campaign,
        model: &'m CampaignModel,
        fit: &'m Fit,
        further: &[Column],
        under: &'m Assumptions,
    ) -> Self {
        let rows = model.rows(Observable::Static);
        let columns = fit.columns.iter().chain(further);
        let unknowns: Vec<Vec<f64>> = columns.map(|c| c.part(rows.clone()).to_vec()).collect();
        Self {
            campaign,
            model,
            under,
            beyond: Beyond::new(rows.len(), &unknowns),
            residuals: &fit.residuals[rows],
        }
    }

    /// Both factors, each with its relative standard uncertainty; `None` where the readings do not tell them, or that of the
    /// marks does not seem off by `doubt` standard deviations.
    fn scales(&self, doubt: f64) -> Option<[(f64, f64); 2]> {
        let whitening = self.model.observations().whitening();
        let scale_v_per_g = self.model.scale_v_per_g();
        let parts = static_parts(self.campaign, scale_v_per_g, self.under, &whitening)?;
        let found = self
            .beyond
            .scales(self.residuals, &parts, &[f64::INFINITY, doubt])?;
        let of = |noise: Noise, (factor, relative): (f64, f64)| {
            (self.under.factor(noise) * factor, relative)
        };
        Some([of(Noise::Readings, found[0]), of(Noise::Marks, found[1])])
    }
}

/// A factor that was found; 1 where it is not `clear` standard deviations of its logarithm off that.
fn clear_factor((found, relative): (f64, f64), clear: f64) -> f64 {
    let told = (COMPUTED..MOST_FACTOR).contains(&found) && found.ln().abs() > clear * relative;
    if told { found } else { 1.0 }
}

/// Of each row that is set aside its distance from what the answer expects of it.
pub fn suspects(
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
        table_scatters: assumptions.table_scatters,
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
        others: 0,
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
        let observed =
            |range: std::ops::Range<usize>| whole.observations().observed_rows(range).count();
        let of_run = |o: Observable| {
            let each = o.per_run();
            let first = whole.rows(o).start + each * row;
            observed(first..first + each)
        };
        let runs = Observable::ALL
            .into_iter()
            .filter(|o| *o != Observable::Static);
        Suspect {
            reading: false,
            place,
            distance: far,
            others: runs.map(of_run).sum::<usize>().saturating_sub(1),
        }
    });
    readings.chain(runs).collect()
}

/// Whitened residuals of all rows of a model under a fit that was made without some of them.
fn residuals(model: &CampaignModel, fit: &Fit) -> Vec<f64> {
    let (values, _) = model.prediction(&fit.members, &fit.base_values);
    let mut residuals = model.observations().observed().to_vec();
    residuals.iter_mut().zip(&values).for_each(|(y, f)| *y -= f);
    for (row, factor) in model.observations().uncertain().zip(&fit.precision_factor) {
        residuals[row] *= factor.sqrt();
    }
    residuals
}

/// The factor on each kind of stated noise by what a fit leaves, with its relative standard uncertainty; that on the errors of
/// the dial's marks where it is another than one.
pub fn noise(
    campaign: &Campaign,
    model: &CampaignModel,
    fit: &Fit,
    assumptions: &Assumptions,
) -> Vec<(Noise, f64, f64)> {
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
    let mut found: Vec<_> = Noise::ALL.into_iter().filter_map(of).collect();
    found.extend(scale_of_marks(campaign, model, fit, &[], assumptions));
    found
}

/// The factor on the errors of the dial's marks, if it is assumed to be another than one.
fn scale_of_marks(
    campaign: &Campaign,
    model: &CampaignModel,
    fit: &Fit,
    further: &[Column],
    assumptions: &Assumptions,
) -> Option<(Noise, f64, f64)> {
    if assumptions.factor(Noise::Marks) == 1.0 {
        return None;
    }
    let [_, (factor, relative)] =
        Readings::new(campaign, model, fit, further, assumptions).scales(0.0)?;
    Some((Noise::Marks, factor, relative))
}
