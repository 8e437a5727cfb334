//! The statistical model of a campaign: its observations, and what the nominal model and further effects predict of them.

pub mod assumptions;
pub mod judge;
pub mod nuisances;
pub mod observables;
mod prediction;
pub mod reference;
pub mod response;
mod smooth;

use inference::model::{Base, Component, Fidelity, Member, Prediction, SeparableModel};
use inference::observations::{Column, Observations};
use shared::model::{Coefficients, NOMINAL};

use crate::campaign::{Campaign, Run, VibrationKind};
use crate::effects::{Action, Effect};
use crate::forward::conditions::{Conditions, Witnesses, seen_ratios};
use crate::forward::contribution::{Layout, Observable};
use crate::forward::finite_record::unseen_variance_within_g2;
use crate::forward::motion::Motion;
use crate::forward::nominal;
use crate::forward::rows::RunConditions;
use assumptions::Assumptions;
use nuisances::{Nuisance, Sessions};
use prediction::Kept;
use reference::Reference;

/// Prior standard deviations of the coefficients in the order of (1): wider than any instrument of the kind.
const PRIOR_SIGMA: [f64; NOMINAL] = [
    0.3, 0.02, 0.02, 0.02, 0.02, 0.005, 0.05, 0.05, 0.005, 0.005, 0.005,
];

/// A campaign as a separable model: the nominal coefficients over the scale factor are its base, effects its components.
#[derive(Debug)]
pub struct CampaignModel {
    conditions: Conditions,
    witnesses: Witnesses,
    effects: Vec<&'static Effect>,
    components: Vec<Component>,
    scale_v_per_g: f64,
    layout: Layout,
    observations: Observations,
    base: Base,
    /// Row of each run, in the order in which they were given.
    rows: Vec<usize>,
    /// Of each run the variance of M|a0 + w| over records of the moments that the reference saw, g^2.
    kink_variance: Vec<f64>,
    sessions: Sessions,
    nuisances: Vec<Nuisance>,
    reference: Option<Reference>,
    /// First run that another reference, beside the instrument, sees: all that the instrument itself feels.
    seen_beside_instrument: usize,
    kept: Kept,
}

impl CampaignModel {
    /// Of a campaign as it is stated; `further` runs are there for their predictions alone.
    pub fn new(campaign: &Campaign, further: &[Run], effects: &[&'static Effect]) -> Self {
        Self::assuming(campaign, further, effects, &Assumptions::default())
    }

    /// The same under assumptions of one's own.
    pub fn assuming(
        campaign: &Campaign,
        further: &[Run],
        effects: &[&'static Effect],
        assumptions: &Assumptions,
    ) -> Self {
        let scale_v_per_g = observables::scale_factor(campaign);
        Self::with_scale(campaign, further, effects, assumptions, scale_v_per_g)
    }

    /// The same with outputs divided by a given scale factor, V/g.
    pub fn with_scale(
        campaign: &Campaign,
        further: &[Run],
        effects: &[&'static Effect],
        assumptions: &Assumptions,
        scale_v_per_g: f64,
    ) -> Self {
        let given: Vec<&Run> = campaign.runs.iter().chain(further).collect();
        let mut order: Vec<usize> = (0..given.len()).collect();
        order.sort_by(|&a, &b| given[a].time_s.total_cmp(&given[b].time_s));
        let runs: Vec<&Run> = order.iter().map(|&k| given[k]).collect();
        let mut rows = vec![0; given.len()];
        for (row, &k) in order.iter().enumerate() {
            rows[k] = row;
        }
        let mut witnesses = Witnesses::new(campaign, &runs, scale_v_per_g);
        let reference = Reference::of(campaign, &runs);
        let reference = reference.map(|reference| reference.under(assumptions.table_scatters));
        if let Some(reference) = &reference {
            let excess = |run: &&Run| {
                let conditions = RunConditions::from(*run);
                let ratios = seen_ratios(&conditions, run.reference.as_ref());
                reference.level_excess(&conditions, ratios)
            };
            witnesses.level_excess = runs.iter().map(excess).collect();
        }
        let coefficients = Coefficients {
            scale_factor_v_per_g: 1.0,
            ..Coefficients::default()
        };
        let mut conditions = Conditions::new(campaign, &runs, &witnesses, coefficients);
        conditions.linearise_about(coefficients, &witnesses);
        let layout = Layout::new(&conditions.readings, &conditions.runs);
        let excluded: Vec<bool> = order
            .iter()
            .map(|k| assumptions.excluded_runs.contains(k))
            .collect();
        let sessions = Sessions::of(campaign, &runs);
        let observations = observables::Observer {
            campaign,
            layout: &layout,
            runs: &runs,
            scale_v_per_g,
            reference: reference.as_ref(),
            level_excess: &witnesses.level_excess,
            assumptions,
            excluded: &excluded,
        }
        .observe();
        let seen = layout.rows(Observable::Reference);
        let seen = observations.observed_rows(seen).next().is_some();
        let table_sigma = reference
            .as_ref()
            .filter(|_| seen)
            .map_or(0.0, |r| r.gain_sigma);
        let (nuisances, base) = base(&conditions, &layout, &observations, &sessions, table_sigma);
        Self {
            kink_variance: kink_variance(&conditions),
            components: effects.iter().map(|e| e.component(seen)).collect(),
            effects: effects.to_vec(),
            seen_beside_instrument: usize::MAX,
            kept: Kept::of_runs(runs.len()),
            base,
            conditions,
            witnesses,
            scale_v_per_g,
            layout,
            observations,
            rows,
            sessions,
            nuisances,
            reference,
        }
    }

    /// The same rows, runs in g, for predictions by fits of a model of so many nuisances: sessions, the table's level and the
    /// peak detector have no part in them.
    pub fn in_g(self, nuisances: usize) -> Self {
        let observations = self.observations.in_units();
        let mut columns = nominal::design(&self.conditions, &self.layout, &self.conditions.motions);
        columns.extend((0..nuisances).map(|_| Column::zero(self.layout.row_count())));
        let unknowns = columns.len();
        let columns = columns
            .into_iter()
            .map(|column| observations.whiten(column));
        Self {
            base: Base::new(
                &observations,
                columns.collect(),
                vec![1.0; unknowns],
                vec![0.0; unknowns],
            ),
            kept: Kept::of_runs(self.conditions.runs.len()),
            observations,
            ..self
        }
    }

    /// Unknowns of the base beside the coefficients, in their order.
    pub fn nuisances(&self) -> &[Nuisance] {
        &self.nuisances
    }

    /// How good the reference is.
    pub fn reference(&self) -> Option<&Reference> {
        self.reference.as_ref()
    }

    /// Another reference, beside the instrument, sees the runs from this row on.
    pub fn swap_reference_from(&mut self, row: usize) {
        self.seen_beside_instrument = row;
    }

    /// Takes every coefficient but K1 as zero with this standard deviation, in its own unit.
    pub fn set_prior_sigma(&mut self, sigma: f64) {
        for k in 1..NOMINAL {
            self.base.set_prior_precision(k, sigma.powi(-2));
        }
    }

    /// Lets effects take these coefficients.
    pub fn believe(&mut self, coefficients: Coefficients<f64>) {
        self.conditions
            .linearise_about(coefficients, &self.witnesses);
        self.kept.clear();
        let table_sigma = self.reference.as_ref().map_or(0.0, |r| r.gain_sigma);
        let (nuisances, base) = base(
            &self.conditions,
            &self.layout,
            &self.observations,
            &self.sessions,
            table_sigma,
        );
        if nuisances.len() == self.nuisances.len() {
            let precision = self.base.prior_precision.clone();
            let mean = self.base.prior_mean.clone();
            self.base = Base::new(&self.observations, base.columns, precision, mean);
        }
    }

    /// Conditions of readings and runs, in the order of the rows.
    pub fn conditions(&self) -> &Conditions {
        &self.conditions
    }

    /// The effects that are its components.
    pub fn effects(&self) -> &[&'static Effect] {
        &self.effects
    }

    /// The effect of a member.
    pub fn effect(&self, member: &Member) -> &'static Effect {
        self.effects[member.component]
    }

    /// Scale factor by which outputs are divided, V/g.
    pub fn scale_v_per_g(&self) -> f64 {
        self.scale_v_per_g
    }

    /// Rows of an observable.
    pub fn rows(&self, observable: Observable) -> std::ops::Range<usize> {
        self.layout.rows(observable)
    }

    /// Row of a run by its place among the campaign's runs and the further ones after them.
    pub fn row_of_run(&self, place: usize) -> usize {
        self.rows[place]
    }

    /// Rows of `during` and `before` of a run: their difference is its vibration error.
    pub fn vre_rows(&self, run: usize) -> (usize, usize) {
        let first = |observable| self.layout.rows(observable).start;
        (
            first(Observable::During) + run,
            first(Observable::Before) + run,
        )
    }

    /// Rows of a whitened vector as a run's vibration error, g.
    pub fn vre_g(&self, values: &[f64], run: usize) -> f64 {
        let (during, before) = self.vre_rows(run);
        let weight = |row| self.observations.weight(row);
        values[during] / weight(during) - values[before] / weight(before)
    }

    /// Rows of the runs that were made and are not set aside, in blocks of one kind, band and gravity along IA.
    pub fn blocks(&self) -> Vec<Vec<usize>> {
        let (runs, during) = (&self.conditions.runs, self.layout.rows(Observable::During));
        let used =
            |row: usize| runs[row].made && self.observations.weight(during.start + row) > 0.0;
        let mut blocks: Vec<Vec<usize>> = Vec::new();
        for row in (0..runs.len()).filter(|&row| used(row)) {
            let key = |row: usize| {
                (
                    runs[row].kind,
                    runs[row].band_hz,
                    runs[row].specific_force_g.i,
                )
            };
            match blocks.iter_mut().find(|block| key(block[0]) == key(row)) {
                Some(block) => block.push(row),
                None => blocks.push(vec![row]),
            }
        }
        blocks
    }

    /// Number of directions of the even coefficients that the static readings leave undetermined.
    pub fn blind_directions(&self) -> usize {
        let readings = self.conditions.readings.iter();
        let moduli = readings.map(|r| shared::model::terms(r.specific_force_g)[2]);
        let mut distinct: Vec<i64> = moduli.map(|a| (a * 1e4).round() as i64).collect();
        distinct.sort_unstable();
        distinct.dedup();
        // Four even functions of a_I need four values of |a_I|.
        4_usize.saturating_sub(distinct.len())
    }

    /// Variance of each run's `during` in g^2: what effects `added`, a spectrum that nobody measured, and of a random record
    /// what nobody saw.
    pub fn unseen_variance_g2(
        &self,
        coefficients: &Coefficients<f64>,
        motions: &[Motion],
        added_g2: &[f64],
    ) -> Vec<f64> {
        let runs = self.conditions.runs.iter().zip(motions).zip(added_g2);
        let unseen = runs.zip(&self.kink_variance);
        unseen
            .map(|(((run, motion), added), kink)| {
                let spectral = nominal::spectral_variance_g2(run, motion, coefficients);
                let unseen = if run.shape_seen {
                    coefficients.asymmetry.powi(2) * kink
                } else {
                    let integrals = self.conditions.averages.integrals(run);
                    integrals.map_or(0.0, |integrals| {
                        unseen_variance_within_g2(run, coefficients, integrals)
                    })
                };
                unseen + added + spectral
            })
            .collect()
    }
}

/// The coefficients, and what is not the instrument's own.
fn base(
    conditions: &Conditions,
    layout: &Layout,
    observations: &Observations,
    sessions: &Sessions,
    table_sigma: f64,
) -> (Vec<Nuisance>, Base) {
    let mut columns = nominal::design(conditions, layout, &conditions.motions);
    let mut precision = PRIOR_SIGMA.map(|sigma| sigma.powi(-2)).to_vec();
    let mut nuisances = Vec::new();
    for (nuisance, does) in nuisances::nuisances(sessions, conditions, layout, table_sigma) {
        columns.push(does.column);
        precision.push(nuisance.sigma.powi(-2));
        nuisances.push(nuisance);
    }
    let columns = columns
        .into_iter()
        .map(|column| observations.whiten(column));
    // K1 is about 1, in units of the scale factor.
    let mut mean = vec![0.0; precision.len()];
    mean[0] = 1.0;
    (
        nuisances,
        Base::new(observations, columns.collect(), precision, mean),
    )
}

fn kink_variance(conditions: &Conditions) -> Vec<f64> {
    let runs = conditions.runs.iter().zip(&conditions.motions);
    runs.map(|(run, motion)| match run.kind {
        VibrationKind::Sine => 0.0,
        VibrationKind::Random => {
            let zero = motion.zero(run.specific_force_g.i);
            let mean = conditions
                .averages
                .mean(run, motion, &[zero], Fidelity::Full, |a| a[0].abs());
            mean.variance
        }
    })
    .collect()
}

impl SeparableModel for CampaignModel {
    fn observations(&self) -> &Observations {
        &self.observations
    }

    fn base(&self) -> &Base {
        &self.base
    }

    fn components(&self) -> &[Component] {
        &self.components
    }

    fn predict(&self, members: &[Member], fidelity: Fidelity) -> Prediction {
        match fidelity {
            Fidelity::Screening => self.predict_anew(members),
            Fidelity::Full => self.predict_kept(members),
        }
    }

    fn variance(&self, members: &[Member], prediction: &Prediction, x: &[f64]) -> Vec<f64> {
        let transformed = self.transformed(members);
        let motions = transformed
            .as_ref()
            .map_or(&self.conditions.motions, |t| &t.motions);
        let added = prediction.added_variance(&x[self.base.columns.len()..]);
        let unseen = self.unseen_variance_g2(&nominal::coefficients(x), motions, &added);
        let during = self.layout.rows(Observable::During);
        let weighted = unseen.into_iter().zip(during);
        weighted
            .map(|(variance, row)| variance * self.observations.weight(row).powi(2))
            .collect()
    }

    fn unit_variance(&self, component: usize) -> Vec<f64> {
        let Action::AddsVariance(variance) = self.effects[component].action else {
            return vec![0.0; self.conditions.runs.len()];
        };
        let runs = self
            .conditions
            .runs
            .iter()
            .zip(self.layout.rows(Observable::During));
        runs.map(|(run, row)| {
            variance(run, &self.conditions) * self.observations.weight(row).powi(2)
        })
        .collect()
    }

    /// From peak to peak of the runs. Peaks alike but for the detector's error count as one.
    fn threshold_steps(&self, from: f64, to: f64) -> Vec<(f64, f64)> {
        let mut edges: Vec<f64> = self.conditions.peaks_g.to_vec();
        edges.retain(|peak| (from..to).contains(peak));
        edges.extend([from, to]);
        edges.sort_by(f64::total_cmp);
        edges.dedup_by(|b, a| *b < *a * (1.0 + self.conditions.peak_rel_error));
        edges.windows(2).map(|edge| (edge[0], edge[1])).collect()
    }

    fn linearise_about(&mut self, base_values: &[f64]) {
        self.believe(nominal::coefficients(base_values));
    }

    fn smooth_families(&self) -> Vec<Vec<Column>> {
        self.families()
    }
}
