//! Which components act: singles, pairs and steps beyond, by marginal likelihood.

use std::sync::OnceLock;

use rayon::prelude::*;

use crate::adequacy::{Adequacy, adequacy, log_something_else};
use crate::dense::Cholesky;
use crate::fit::{Fit, fit_base, tangent, thresholds_anew};
use crate::model::{Fidelity, Kind, Member, Prediction, SeparableModel};
use crate::normal::Normal;
use crate::observations::Column;
use crate::remainder::Remainder;
use crate::variance::{fit_with_size, gain, unit};

/// Every threshold of a search.
#[derive(Clone, Copy, Debug)]
pub struct SearchPolicy {
    /// Prior probability that nothing acts; the rest is shared among the components.
    pub prior_nothing: f64,
    /// Prior probability that one more component acts besides.
    pub prior_another: f64,
    /// Prior probability that what acts is not among the components.
    pub prior_something_else: f64,
    /// Least log evidence over nothing that makes a component worth a closer look.
    pub worth: f64,
    /// A misfit less probable than this needs another component.
    pub misfit: f64,
    /// Log evidence for "something else" from which on another component is looked for.
    pub another_looked_for: f64,
    /// Log odds of "something else" above which a large misfit is unexplained.
    pub something_else_wins: f64,
    /// Probability that an unexplained gap leaves to all hypotheses together, none of which explains it.
    pub unexplained_rest: f64,
    /// Share of the gap (in units of its root) below which a misfit is the formulas' and not another component's.
    pub tolerated_share: f64,
    /// Likeness of two components of a set of three or more beyond which they stand in together for something else.
    pub stand_in: f64,
    /// Standard deviations from nothing that a component's parameters have at least.
    pub acts: f64,
    /// Most components at once.
    pub most_members: usize,
    /// Best hypotheses that another component is added to.
    pub bases: usize,
    /// Most promising components that are fitted first, and on top of others.
    pub closer_look: usize,
    /// The same on top of others.
    pub further_look: usize,
    /// Most rounds of a fit and of what its components take for the base.
    pub carried: usize,
    /// Share of the most promising component's gain, at the nearest points of the grids, below which another one cannot win.
    pub hopeless: f64,
    /// A small value of a parameter that begins at nothing.
    pub small: f64,
    /// Difference of -2 log likelihood below which two fits are the same.
    pub alike: f64,
    /// Modes that a component of several nonlinear parameters is fitted from.
    pub modes: usize,
    /// Part of the best mode's gain from which on another mode is fitted too: the grid may have missed its peak.
    pub mode_worth: f64,
    /// Rows, over all starts, up to which what a start predicts is kept from one look to the next: memory against time. A row
    /// of a start takes some 40 bytes.
    pub kept_rows: usize,
}

impl Default for SearchPolicy {
    fn default() -> Self {
        Self {
            prior_nothing: 0.5,
            prior_another: 0.1,
            prior_something_else: 0.1,
            worth: 3.0,
            misfit: 1e-4,
            another_looked_for: 7.0,
            something_else_wins: 3.0,
            unexplained_rest: 0.1,
            tolerated_share: 0.025,
            stand_in: 0.5,
            acts: 3.0,
            most_members: 3,
            bases: 3,
            closer_look: 10,
            further_look: 4,
            carried: 20,
            hopeless: 0.05,
            small: 2e-3,
            alike: 0.1,
            modes: 3,
            mode_worth: 0.5,
            kept_rows: 1_500_000,
        }
    }
}

impl SearchPolicy {
    /// Whether a fit leaves so much that another component is looked for.
    fn insufficient(&self, adequacy: &Adequacy) -> bool {
        adequacy.p_value < self.misfit || adequacy.log_something_else > self.another_looked_for
    }
}

/// A hypothesis with its standing.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Its fit.
    pub fit: Fit,
    /// Logarithm of prior times evidence.
    pub log_posterior_weight: f64,
    /// Probability among all hypotheses, "something else" included.
    pub probability: f64,
}

/// What a search found.
#[derive(Clone, Debug)]
pub struct Search {
    /// The base alone.
    pub null: Fit,
    /// How well that does.
    pub null_adequacy: Adequacy,
    /// Hypotheses, the base alone included, most probable first.
    pub hypotheses: Vec<Hypothesis>,
    /// Whether the most probable hypothesis leaves something that the components do not explain.
    pub unexplained: bool,
}

impl Search {
    /// Takes what was found for no explanation, whatever it leaves: something else is known to be at work.
    pub fn leave_unexplained(&mut self, policy: &SearchPolicy) {
        let total: f64 = self.hypotheses.iter().map(|h| h.probability).sum();
        if !self.unexplained && total > 0.0 {
            for hypothesis in &mut self.hypotheses {
                hypothesis.probability *= policy.unexplained_rest / total;
            }
        }
        self.unexplained = true;
    }
}

/// Searches all components of a model. `None` if the observations and priors do not determine even the base.
pub fn search(model: &mut dyn SeparableModel, policy: &SearchPolicy) -> Option<Search> {
    let undisturbed = still_base(model)?;
    model.linearise_about(&undisturbed);
    let null = fit_base(model)?;
    let null = carried(model, policy, null);
    model.linearise_about(&null.base_values);
    let families = model.smooth_families();
    let null_adequacy = adequacy(model, &null, &families);
    let mut base = null.clone();
    if policy.insufficient(&null_adequacy) {
        // What acts may have bent the base.
        model.linearise_about(&undisturbed);
        base = fit_base(model)?;
    }
    let starts = Starts::new(model, policy);
    let seek = Seek {
        model,
        policy,
        starts: &starts,
    };
    let mut fits = seek.add_to(&base, policy.closer_look);
    fits.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let best = fits.first();
    let promising = best.is_some_and(|best| best.log_evidence > null.log_evidence + policy.worth);
    if promising {
        // What components take for the base, now that the largest bend is out of it.
        carry_best(model, policy, &mut fits);
    }
    let seek = Seek {
        model,
        policy,
        starts: &starts,
    };
    seek.thresholds_of_best(&mut fits);
    if promising {
        seek.extend(&null, &null_adequacy, &mut fits, &families);
    }
    fits.push(null.clone());
    Some(seek.conclude(null, null_adequacy, fits, &families))
}

/// Unknowns of the base by the rows that no transformation touches.
fn still_base(model: &dyn SeparableModel) -> Option<Vec<f64>> {
    let still = &model.base().still;
    let mut x = still.right.clone();
    Cholesky::new(still.matrix.clone(), x.len())?.solve(&mut x);
    Some(x)
}

/// A fit carried to where components take its own base.
fn carried(model: &mut dyn SeparableModel, policy: &SearchPolicy, mut fit: Fit) -> Fit {
    for _ in 0..policy.carried {
        model.linearise_about(&fit.base_values);
        let again = fit_with_size(model, fit.members.clone(), &fit.precision_factor);
        let Some(again) = again else { break };
        let moved = (again.objective - fit.objective).abs();
        fit = again;
        if moved < 0.1 * policy.alike {
            break;
        }
    }
    fit
}

/// Carries each of the best fits to its own base, and the model to the best one's.
fn carry_best(model: &mut dyn SeparableModel, policy: &SearchPolicy, fits: &mut [Fit]) {
    let best = policy.bases.min(fits.len());
    for fit in &mut fits[..best] {
        *fit = carried(model, policy, fit.clone());
    }
    fits[..best].sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    model.linearise_about(&fits[0].base_values);
}

/// A component at one of its starts with what it does there, if that is kept.
pub(crate) struct Start {
    pub(crate) member: Member,
    prediction: Option<Prediction>,
}

impl Start {
    /// Nothing kept.
    pub(crate) fn of(member: Member) -> Self {
        Self {
            member,
            prediction: None,
        }
    }

    fn predict(model: &dyn SeparableModel, member: &Member) -> Prediction {
        match model.components()[member.component].kind {
            Kind::AddsVariance => Prediction::default(),
            _ => model.predict(std::slice::from_ref(member), Fidelity::Screening),
        }
    }
}

/// Every start of every component.
#[derive(Default)]
pub(crate) struct Starts(Vec<Start>);

impl Starts {
    fn new(model: &dyn SeparableModel, policy: &SearchPolicy) -> Self {
        let components = model.components().iter().enumerate();
        let members = components.flat_map(|(component, entry)| {
            let count = entry.parameters.len();
            let grid = if entry.begins_at_nothing() {
                let alone = |k| {
                    let mut values = vec![0.0; count];
                    values[k] = policy.small;
                    values
                };
                (0..count).map(alone).collect()
            } else {
                entry.grid()
            };
            let member = move |values| Member { component, values };
            grid.into_iter().map(member)
        });
        let kept = policy.kept_rows / model.observations().len().max(1);
        let start = |(number, member): (usize, Member)| Start {
            prediction: (number < kept).then(|| Start::predict(model, &member)),
            member,
        };
        let members: Vec<Member> = members.collect();
        let starts = members.into_par_iter().enumerate();
        Self(starts.map(start).collect())
    }
}

/// Keeps, of a component's starts with their gains, the best for each value of parameter `first`.
pub(crate) fn keep_best(starts: &mut Vec<(f64, Member)>, first: usize, gain: f64, member: &Member) {
    let mode = |member: &Member| member.values.get(first).copied();
    match starts
        .iter_mut()
        .find(|(_, known)| mode(known) == mode(member))
    {
        Some(same) if gain > same.0 => *same = (gain, member.clone()),
        Some(_) => {}
        None => starts.push((gain, member.clone())),
    }
}

/// A component's best starts on top of a fit: the drop of -2 log likelihood of each, largest first.
struct Promise {
    starts: Vec<(f64, Member)>,
}

/// A search on its way.
pub(crate) struct Seek<'m> {
    pub(crate) model: &'m dyn SeparableModel,
    pub(crate) policy: &'m SearchPolicy,
    pub(crate) starts: &'m Starts,
}

impl Seek<'_> {
    /// Adds a second component, and a third, as long as the most probable set leaves too much.
    fn extend(
        &self,
        null: &Fit,
        null_adequacy: &Adequacy,
        fits: &mut Vec<Fit>,
        families: &[Vec<Column>],
    ) {
        let mut judged = self
            .judge(fits, families)
            .unwrap_or_else(|| null_adequacy.clone());
        for members in 2..=self.policy.most_members {
            if !self.policy.insufficient(&judged) {
                break;
            }
            let bases = self.bases(fits, members - 1);
            let (mut found, again) = self.on_top_of(&bases, members);
            offer(fits, again);
            if members > 2 {
                found.retain(|fit| self.likeness(null, fit) < self.policy.stand_in);
            }
            fits.extend(found);
            self.thresholds_of_best(fits);
            judged = self.judge(fits, families).unwrap_or(judged);
        }
    }

    /// The best fits of so many members, which others are added to.
    fn bases(&self, fits: &[Fit], members: usize) -> Vec<Fit> {
        let mut bases: Vec<&Fit> = fits
            .iter()
            .filter(|fit| fit.members.len() == members)
            .collect();
        bases.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        bases.truncate(if members == 1 { self.policy.bases } else { 1 });
        bases.into_iter().cloned().collect()
    }

    /// Sets of so many members on top of `bases`, and single ones fitted again on the way.
    fn on_top_of(&self, bases: &[Fit], members: usize) -> (Vec<Fit>, Vec<Fit>) {
        let further = self.policy.further_look;
        let (mut found, mut again): (Vec<Fit>, Vec<Fit>) = Default::default();
        for base in bases {
            offer(&mut found, self.add_to(base, further));
        }
        let Some(best) = best_of(&found).cloned() else {
            return (found, again);
        };
        let best = thresholds_anew(self.model, &best).unwrap_or(best);
        offer(&mut found, vec![best.clone()]);
        // Each member alone again from where the set put it, and what else could stand beside it: the first one may have
        // stood in for two.
        for member in best.members.iter().filter(|_| members == 2) {
            let alone = fit_with_size(self.model, vec![member.clone()], &best.precision_factor);
            let Some(alone) = alone else { continue };
            let known = |base: &Fit| {
                let difference = (base.objective - alone.objective).abs();
                same(base, &alone) && difference < self.policy.alike
            };
            if !bases.iter().any(known) {
                offer(&mut found, self.add_to(&alone, further));
            }
            again.push(alone);
        }
        (found, again)
    }

    /// Puts the most probable fit's thresholds where they do best.
    fn thresholds_of_best(&self, fits: &mut [Fit]) {
        if let Some(best) = self.most_probable(fits)
            && let Some(again) = thresholds_anew(self.model, &fits[best])
        {
            fits[best] = again;
        }
    }

    /// The most probable of several fits by its number.
    fn most_probable(&self, fits: &[Fit]) -> Option<usize> {
        let weight = |k: &usize| self.log_posterior_weight(&fits[*k]);
        (0..fits.len()).max_by(|a, b| weight(a).total_cmp(&weight(b)))
    }

    /// How well the most probable of several fits does.
    fn judge(&self, fits: &[Fit], families: &[Vec<Column>]) -> Option<Adequacy> {
        let best = self.most_probable(fits)?;
        Some(adequacy(self.model, &fits[best], families))
    }

    /// The best starts of every component on top of a fit, the most promising component first.
    fn promising(&self, base: &Fit) -> Vec<Promise> {
        let remainder = Remainder::new(self.model, base);
        let units = self.model.components().iter().map(|_| OnceLock::new());
        let units: Vec<OnceLock<Vec<(usize, f64)>>> = units.collect();
        let free = |start: &&Start| {
            let mut members = base.members.iter();
            !members.any(|member| member.component == start.member.component)
        };
        let gain = |start| (self.gain(base, &remainder, start, &units), &start.member);
        let starts = self.starts.0.par_iter().filter(free);
        let gains: Vec<(f64, &Member)> = starts.map(gain).collect();
        let mut promises: Vec<Promise> = Vec::new();
        for (gain, member) in gains {
            self.keep(&mut promises, gain, member);
        }
        for promise in &mut promises {
            promise.starts.sort_by(|a, b| b.0.total_cmp(&a.0));
            let member = &promise.starts[0].1;
            let linear = self.model.components()[member.component].linear();
            let several = member.values.len() - linear > 1;
            promise
                .starts
                .truncate(if several { self.policy.modes } else { 2 });
        }
        promises.sort_by(|a, b| b.starts[0].0.total_cmp(&a.starts[0].0));
        let largest = promises.first().map_or(0.0, |p| p.starts[0].0);
        promises.retain(|p| p.starts[0].0 > self.policy.hopeless * largest);
        promises
    }

    /// Keeps one start for each value of the first parameter that is not in proportion: modes lie apart along it.
    fn keep(&self, promises: &mut Vec<Promise>, gain: f64, member: &Member) {
        let first = self.model.components()[member.component].linear();
        let known = promises
            .iter_mut()
            .find(|p| p.starts[0].1.component == member.component);
        match known {
            Some(known) => keep_best(&mut known.starts, first, gain, member),
            None => promises.push(Promise {
                starts: vec![(gain, member.clone())],
            }),
        }
    }

    /// Drop of -2 log likelihood by a start on top of a fit.
    pub(crate) fn gain(
        &self,
        base: &Fit,
        remainder: &Remainder<'_>,
        start: &Start,
        units: &[OnceLock<Vec<(usize, f64)>>],
    ) -> f64 {
        let number = start.member.component;
        let component = &self.model.components()[number];
        let anew;
        let prediction = match &start.prediction {
            Some(kept) => kept,
            None => {
                anew = Start::predict(self.model, &start.member);
                &anew
            }
        };
        match component.kind {
            Kind::Adds if component.linear() > 0 => {
                let columns: Vec<&Column> = prediction.linear().map(|(column, _)| column).collect();
                remainder.gain(&columns, 1e8).0
            }
            Kind::Adds => prediction
                .offset()
                .map_or(0.0, |column| remainder.fixed_gain(column)),
            Kind::TransformsBase if component.begins_at_nothing() => {
                let column = self.transformed_difference(base, prediction);
                remainder.gain(&[&column], 1e8).0
            }
            Kind::TransformsBase if base.members.is_empty() => {
                self.transformed_gain(base, prediction)
            }
            Kind::TransformsBase => {
                remainder.fixed_gain(&self.transformed_difference(base, prediction))
            }
            Kind::AddsVariance => {
                let unit = units[number].get_or_init(|| unit(self.model, base, number));
                gain(base, unit, start.member.values[0])
            }
        }
    }

    /// What a transformation adds to the predictions of a fit.
    fn transformed_difference(&self, base: &Fit, prediction: &Prediction) -> Column {
        let observations = self.model.observations();
        let mut values = prediction
            .offset()
            .map_or_else(|| vec![0.0; observations.len()], Column::to_vec);
        let columns = &self.model.base().columns;
        for (row, transformed) in prediction
            .transformed_rows()
            .into_iter()
            .flat_map(|transformed| transformed.rows(observations))
        {
            let terms = transformed.iter().zip(columns).zip(&base.base_values);
            values[row] += terms
                .map(|((value, column), x)| (value - column.at(row)) * x)
                .sum::<f64>();
        }
        observations.column(values)
    }

    /// Drop of chi-square by a transformation, the base fitted anew.
    fn transformed_gain(&self, base: &Fit, prediction: &Prediction) -> f64 {
        let observations = self.model.observations();
        let observed = observations.observed().part(0..observations.len());
        let uncertain = observations.uncertain();
        let Normal {
            mut matrix,
            mut right,
            mut square,
        } = self.model.base().still.clone();
        let n = right.len();
        let mut x = vec![0.0; n];
        for (row, transformed) in prediction
            .transformed_rows()
            .into_iter()
            .flat_map(|transformed| transformed.rows(observations))
        {
            if observations.weight(row) == 0.0 {
                continue;
            }
            let root = if uncertain.contains(&row) {
                base.precision_factor[row - uncertain.start].sqrt()
            } else {
                1.0
            };
            x.iter_mut()
                .zip(transformed)
                .for_each(|(x, t)| *x = *t * root);
            let y = observed[row] * root;
            for i in 0..n {
                right[i] += x[i] * y;
                for j in 0..=i {
                    matrix[i * n + j] += x[i] * x[j];
                }
            }
            square += y * y;
        }
        for observable in observations.observables().iter().filter(|o| !o.transforms) {
            let rows = observable.rows.clone();
            if let Some(seen) = prediction.offset() {
                let seen = seen.part(rows.clone());
                let pairs = seen.iter().zip(&observed[rows]);
                square += pairs.map(|(seen, y)| seen * (seen - 2.0 * y)).sum::<f64>();
            }
        }
        let Some(factor) = Cholesky::new(matrix, n) else {
            return f64::NEG_INFINITY;
        };
        factor.forward(&mut right);
        let objective = square - right.iter().map(|x| x * x).sum::<f64>();
        base.objective - base.log_variance() - objective
    }

    /// Every promising component on top of a fit, from its best start.
    fn add_to(&self, base: &Fit, most: usize) -> Vec<Fit> {
        let mut promising = self.promising(base);
        promising.truncate(most);
        promising
            .into_par_iter()
            .filter_map(|promise| {
                let least = self.policy.mode_worth * promise.starts[0].0;
                let worth = promise.starts.into_iter().filter(|(gain, _)| *gain > least);
                let fits = worth.filter_map(|(_, member)| {
                    let members = [&base.members[..], &[member]].concat();
                    fit_with_size(self.model, members, &base.precision_factor)
                });
                let best = fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
                Some(self.other_signs(best))
            })
            .collect()
    }

    /// A fit's last component from the other signs of its parameters as well, where those may be alike.
    fn other_signs(&self, mut best: Fit) -> Fit {
        let last = best.members.len() - 1;
        let Member { component, values } = best.members[last].clone();
        if !self.model.components()[component].signs_alike {
            return best;
        }
        for signs in 1..1_usize << values.len() {
            let mut members = best.members.clone();
            for (k, value) in values.iter().enumerate() {
                members[last].values[k] = if signs >> k & 1 == 1 { -value } else { *value };
            }
            if let Some(fit) = fit_with_size(self.model, members, &best.precision_factor)
                && fit.log_evidence > best.log_evidence
            {
                best = fit;
            }
        }
        best
    }

    /// Largest likeness of any two components of a fit, beyond what the base can imitate.
    fn likeness(&self, null: &Fit, fit: &Fit) -> f64 {
        let alone = fit.members.iter().map(|member| self.alone(fit, member));
        let alone: Vec<Column> = alone.collect();
        let references: Vec<&Column> = alone.iter().collect();
        let correlation = Remainder::new(self.model, null).similarity(&references);
        let mut largest = 0.0_f64;
        for i in 0..alone.len() {
            for j in 0..i {
                largest = largest.max(correlation[i][j].abs());
            }
        }
        largest
    }

    /// What one component of a fit adds to the observations.
    fn alone(&self, fit: &Fit, member: &Member) -> Column {
        let (_, with) = tangent(self.model, std::slice::from_ref(member), &fit.base_values);
        let (_, bare) = tangent(self.model, &[], &fit.base_values);
        let difference = with.iter().zip(&bare).map(|(a, b)| a - b);
        self.model.observations().column(difference.collect())
    }

    /// Logarithm of prior times evidence.
    fn log_posterior_weight(&self, fit: &Fit) -> f64 {
        let policy = self.policy;
        let (n, k) = (
            self.model.components().len() as f64,
            fit.members.len() as i32,
        );
        let prior = match k {
            0 => policy.prior_nothing.ln(),
            _ => {
                let acting = 1.0 - policy.prior_nothing;
                (acting * policy.prior_another.powi(k - 1) / n.powi(k)).ln()
            }
        };
        prior + fit.log_evidence
    }

    /// Whether each component of a fit does something: of its parameters that nothing has at zero one is clearly another.
    fn all_act(&self, fit: &Fit) -> bool {
        fit.members.iter().enumerate().all(|(m, member)| {
            let component = &self.model.components()[member.component];
            let from_nothing = match component.begins_at_nothing() {
                true => member.values.len(),
                false => component.linear(),
            };
            let distance = |k: usize| {
                let unknown = fit.unknown(m, k)?;
                let prior = component.parameters[k].prior;
                let sigma = fit.covariance(unknown, unknown).max(0.0).sqrt();
                Some((prior.inner(member.values[k]) / sigma).abs())
            };
            let mut distances = (0..from_nothing).filter_map(distance).peekable();
            distances.peek().is_none() || distances.any(|far| far > self.policy.acts)
        })
    }

    /// Logarithm of the odds that something else acts in the place of one component or of all: smooth shapes on top of the best
    /// hypothesis of each lesser number of components, against the best of all.
    fn something_else_instead(
        &self,
        hypotheses: &[Hypothesis],
        null_adequacy: &Adequacy,
        families: &[Vec<Column>],
    ) -> f64 {
        let best = &hypotheses[0];
        let lesser = (0..best.fit.members.len()).filter_map(|count| {
            hypotheses
                .iter()
                .find(|hypothesis| hypothesis.fit.members.len() == count)
        });
        let odds = lesser.map(|hypothesis| {
            let something_else = match hypothesis.fit.members.is_empty() {
                true => null_adequacy.log_something_else,
                false => log_something_else(self.model, &hypothesis.fit, families),
            };
            hypothesis.log_posterior_weight - best.log_posterior_weight
                + self.policy.prior_something_else.ln()
                + something_else
        });
        odds.fold(f64::NEG_INFINITY, f64::max)
    }

    fn conclude(
        &self,
        null: Fit,
        null_adequacy: Adequacy,
        fits: Vec<Fit>,
        families: &[Vec<Column>],
    ) -> Search {
        let policy = self.policy;
        let mut hypotheses: Vec<Hypothesis> = fits
            .into_iter()
            .filter(|fit| self.all_act(fit))
            .map(|fit| Hypothesis {
                log_posterior_weight: self.log_posterior_weight(&fit),
                fit,
                probability: 0.0,
            })
            .collect();
        hypotheses.sort_by(|a, b| b.log_posterior_weight.total_cmp(&a.log_posterior_weight));
        let adequacy = adequacy(self.model, &hypotheses[0].fit, families);
        let (chi2, freedom) = adequacy.total();
        // Where even the best leaves more than noise, differences count for less.
        let temper = (chi2 / f64::max(freedom, 1.0)).max(1.0);
        let excess = null_adequacy
            .observables
            .iter()
            .map(|(chi2, freedom)| chi2 - freedom);
        let gap_chi2 = excess.sum::<f64>().max(0.0);
        let large = adequacy.excess > policy.tolerated_share.powi(2) * gap_chi2;
        let best = hypotheses[0].log_posterior_weight;
        let prior_something_else = policy.prior_something_else.ln();
        let something_else = prior_something_else + adequacy.log_something_else / temper;
        let instead = self.something_else_instead(&hypotheses, &null_adequacy, families) / temper;
        let unexplained = (large
            && (adequacy.p_value < policy.misfit || something_else > policy.something_else_wins))
            || instead > 0.0;
        let mut total = 0.0;
        for hypothesis in &mut hypotheses {
            hypothesis.probability = ((hypothesis.log_posterior_weight - best) / temper).exp();
            total += hypothesis.probability;
        }
        let known = if unexplained {
            policy.unexplained_rest
        } else {
            // A small misfit is the formulas': it makes nothing else besides probable.
            let besides = if large { something_else.exp() } else { 0.0 };
            total / (total + besides + instead.exp())
        };
        for hypothesis in &mut hypotheses {
            hypothesis.probability *= known / total;
        }
        Search {
            null,
            null_adequacy,
            hypotheses,
            unexplained,
        }
    }
}

fn best_of(fits: &[Fit]) -> Option<&Fit> {
    fits.iter()
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

/// Adds fits to a collection that keeps the best of each set of components.
fn offer(known: &mut Vec<Fit>, found: Vec<Fit>) {
    for fit in found {
        match known.iter_mut().find(|known| same(known, &fit)) {
            Some(known) if known.log_evidence < fit.log_evidence => *known = fit,
            Some(_) => {}
            None => known.push(fit),
        }
    }
}

fn same(a: &Fit, b: &Fit) -> bool {
    let sorted = |fit: &Fit| {
        let mut numbers: Vec<usize> = fit.members.iter().map(|m| m.component).collect();
        numbers.sort_unstable();
        numbers
    };
    sorted(a) == sorted(b)
}
