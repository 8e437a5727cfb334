//! Which effects: singles, pairs and steps beyond, by marginal likelihood.

use std::collections::HashMap;
use std::rc::Rc;

use shared::model::NOMINAL;

use super::adequacy::{Adequacy, Remainder};
use super::catalogue::{Action, Effect, Role};
use super::dense::Cholesky;
use super::fit::{Fit, Member, grid, nominal};
use super::motion::Averages;
use super::problem::{Block, Column, Problem};

/// Prior probability that nothing acts; the rest is shared among the effects.
const PRIOR_NOTHING: f64 = 0.5;
/// Prior probability that one more effect acts besides.
const PRIOR_ANOTHER: f64 = 0.1;
/// Prior probability that what acts is not in the catalogue.
const PRIOR_SOMETHING_ELSE: f64 = 0.02;
/// Least log evidence over nothing that makes an effect worth a closer look.
const WORTH: f64 = 3.0;
/// A misfit less probable than this needs another effect.
const MISFIT: f64 = 1e-4;
/// Probability that an unexplained gap leaves to all hypotheses together, none of which explains it.
const UNEXPLAINED_REST: f64 = 0.1;
/// Share of the gap (in units of its root) below which a misfit is the formulas' and not another effect's.
const TOLERATED_SHARE: f64 = 0.05;
/// Likeness of two effects of a set of three or more beyond which they stand in together for something else.
const STAND_IN: f64 = 0.5;
/// Most effects at once.
const MOST_EFFECTS: usize = 3;
/// Best hypotheses that another effect is added to.
const BASES: usize = 3;
/// Most promising effects that are fitted, first and on top of others.
const CLOSER_LOOK: usize = 10;
const FURTHER: usize = 4;
/// Share of the most promising effect's gain, at the nearest points of the grids, below which another one cannot win.
const HOPELESS: f64 = 0.05;
/// A small value of a parameter that begins at nothing.
const SMALL: f64 = 2e-3;
/// Difference of -2 log likelihood below which two fits are the same.
const ALIKE: f64 = 0.1;
/// Modes that an effect of several curved parameters is fitted from.
const MODES: usize = 3;

/// A hypothesis with its standing.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Its fit.
    pub fit: Fit,
    /// Logarithm of prior times evidence.
    pub log_weight: f64,
    /// Probability among all hypotheses, "something else" included.
    pub probability: f64,
}

/// What the search found.
#[derive(Clone, Debug)]
pub struct Search {
    /// The nominal model alone.
    pub null: Fit,
    /// How well that does.
    pub null_adequacy: Adequacy,
    /// Hypotheses, the nominal model included, most probable first.
    pub hypotheses: Vec<Hypothesis>,
    /// How well the most probable one does.
    pub adequacy: Adequacy,
    /// Chi-square of the gap beyond its expectation, of the nominal model fitted to everything.
    pub gap_chi2: f64,
    /// Whether the most probable hypothesis leaves something that the catalogue does not explain.
    pub unexplained: bool,
}

/// A start of an effect with what it does, made once.
struct Start {
    member: Member,
    /// Of an effect that adds: its columns.
    columns: Vec<Column>,
    /// Of one that moves the instrument: the rows of the moving runs, and what the reference sees of it.
    rows: Vec<[[f64; NOMINAL]; 3]>,
    seen: Option<Column>,
}

/// An effect's best starts on top of a fit.
struct Promise {
    /// Drop of -2 log likelihood, each with its start; largest first.
    starts: Vec<(f64, Member)>,
}

impl Problem<'_> {
    /// Searches `catalogue`. `None` if the campaign does not determine even the nominal model with its priors.
    pub fn search(&mut self, catalogue: &[&'static Effect]) -> Option<Search> {
        let at_rest = self.coefficients_at_rest()?;
        self.suppose(at_rest);
        let null = self.fit_nominal()?;
        let exact = std::mem::replace(&mut self.situation.averages, Rc::new(Averages::rough()));
        let starts: Vec<Start> = catalogue
            .iter()
            .flat_map(|effect| self.starts(effect))
            .collect();
        self.situation.averages = exact;
        let mut fits = self.add_to(&null, &starts, CLOSER_LOOK);
        fits.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        let families = self.families();
        let null_adequacy = self.adequacy(&null, &families);
        let excess = null_adequacy
            .observables
            .iter()
            .map(|(chi2, freedom)| chi2 - freedom);
        let gap_chi2 = excess.sum::<f64>().max(0.0);
        let moved = fits
            .first()
            .is_some_and(|best| best.log_evidence > null.log_evidence + WORTH);
        if moved {
            // The coefficients that effects look at, now that the largest bend is out of them.
            self.suppose(nominal(&fits[0].theta));
            for fit in fits.iter_mut().take(3) {
                if let Some(again) = self.refit(fit.members.clone(), &fit.trust) {
                    *fit = again;
                }
            }
        }
        self.step_best(&mut fits, catalogue.len());
        let mut adequacy = self
            .judge(&fits, &families, catalogue.len())
            .unwrap_or_else(|| null_adequacy.clone());
        for effects in 2..=MOST_EFFECTS {
            if !moved || !insufficient(&adequacy) {
                break;
            }
            let mut bases: Vec<&Fit> = fits
                .iter()
                .filter(|fit| fit.members.len() == effects - 1)
                .collect();
            bases.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
            bases.truncate(if effects == 2 { BASES } else { 1 });
            let (mut found, mut again): (Vec<Fit>, Vec<Fit>) = Default::default();
            for base in &bases {
                offer(&mut found, self.add_to(base, &starts, FURTHER));
            }
            if let Some(best) = best_of(&found).cloned() {
                let best = self.stepped_anew(&best).unwrap_or(best);
                offer(&mut found, vec![best.clone()]);
                // Each effect alone again from where the set put it, and what else could stand beside it: the first
                // one may have stood in for two.
                for member in best.members.iter().filter(|_| effects == 2) {
                    let Some(alone) = self.refit(vec![member.clone()], &best.trust) else {
                        continue;
                    };
                    let known = |base: &&Fit| {
                        same(base, &alone) && (base.objective - alone.objective).abs() < ALIKE
                    };
                    if !bases.iter().any(known) {
                        offer(&mut found, self.add_to(&alone, &starts, FURTHER));
                    }
                    again.push(alone);
                }
            }
            offer(&mut fits, again);
            if effects > 2 {
                found.retain(|fit| self.likeness(&null, fit) < STAND_IN);
            }
            fits.extend(found);
            self.step_best(&mut fits, catalogue.len());
            adequacy = self
                .judge(&fits, &families, catalogue.len())
                .unwrap_or(adequacy);
        }
        fits.push(null.clone());
        Some(self.conclude(
            null,
            null_adequacy,
            fits,
            gap_chi2,
            &families,
            catalogue.len(),
        ))
    }

    /// Puts the most probable fit's parameters that go by steps where they do best.
    fn step_best(&self, fits: &mut [Fit], catalogue: usize) {
        if let Some(best) = self.most_probable(fits, catalogue)
            && let Some(again) = self.stepped_anew(&fits[best])
        {
            fits[best] = again;
        }
    }

    /// The most probable of several fits by its number.
    fn most_probable(&self, fits: &[Fit], catalogue: usize) -> Option<usize> {
        let weight = |k: &usize| self.weigh(&fits[*k], catalogue);
        (0..fits.len()).max_by(|a, b| weight(a).total_cmp(&weight(b)))
    }

    /// How well the most probable of several fits does.
    fn judge(&self, fits: &[Fit], families: &[Vec<Column>], catalogue: usize) -> Option<Adequacy> {
        let best = self.most_probable(fits, catalogue)?;
        Some(self.adequacy(&fits[best], families))
    }

    /// Coefficients from all that stands still.
    fn coefficients_at_rest(&self) -> Option<shared::model::Coefficients<f64>> {
        let mut trust = vec![1.0; self.run_count()];
        trust.fill(1e-12);
        let fit = self.fit(Vec::new(), &trust, 0)?;
        Some(nominal(&fit.theta))
    }

    fn starts(&self, effect: &'static Effect) -> Vec<Start> {
        let members = if from_nothing(effect) {
            let alone = |k| {
                (0..effect.parameters.len())
                    .map(|j| if j == k { SMALL } else { 0.0 })
                    .collect()
            };
            (0..effect.parameters.len())
                .map(|k| Member {
                    effect,
                    values: alone(k),
                })
                .collect()
        } else {
            grid(effect)
        };
        members
            .into_iter()
            .map(|member| {
                let mut start = Start {
                    columns: Vec::new(),
                    rows: Vec::new(),
                    seen: None,
                    member,
                };
                match effect.action {
                    Action::Adds(add) => {
                        let (values, linear) = (&start.member.values, effect.linear());
                        let columns = self.columns(add, linear, values, &self.situation);
                        start
                            .columns
                            .extend(columns.into_iter().map(|(column, _)| column));
                    }
                    Action::Moves(..) => {
                        let (motions, seen) =
                            self.moved_motions(std::slice::from_ref(&start.member));
                        start.rows = self.moving(&motions);
                        start.seen = seen;
                    }
                    Action::Scatters(_) => {}
                }
                start
            })
            .collect()
    }

    /// The best starts of every effect on top of a fit, the most promising effect first.
    fn promising(&self, base: &Fit, starts: &[Start]) -> Vec<Promise> {
        let remainder = self.remainder(base);
        let commanded = self.moving(&self.situation.motions);
        let mut promises: Vec<Promise> = Vec::new();
        let mut scatters: HashMap<&str, Vec<(usize, f64)>> = HashMap::new();
        for start in starts {
            let effect = start.member.effect;
            if base
                .members
                .iter()
                .any(|member| std::ptr::eq(member.effect, effect))
            {
                continue;
            }
            let gain = match effect.action {
                Action::Adds(_) if effect.linear() > 0 => {
                    let columns: Vec<&Column> = start.columns.iter().collect();
                    remainder.gain(&columns, 1e8).0
                }
                Action::Adds(_) => fixed_gain(&remainder, &start.columns[0]),
                Action::Moves(..) if from_nothing(effect) => {
                    let column = self.moved_difference(base, start, &commanded);
                    remainder.gain(&[&column], 1e8).0
                }
                Action::Moves(..) if base.members.is_empty() => self.moved_gain(base, start),
                Action::Moves(..) => {
                    fixed_gain(&remainder, &self.moved_difference(base, start, &commanded))
                }
                Action::Scatters(_) => {
                    let unit = scatters
                        .entry(effect.id)
                        .or_insert_with(|| self.unit_scatter(base, effect));
                    self.scatter_gain(base, unit, start.member.values[0])
                }
            };
            // One start for each value of the first parameter that is not in proportion: modes lie apart along it.
            let mode = |member: &Member| member.values.get(effect.linear()).copied();
            let known = promises
                .iter_mut()
                .find(|p| std::ptr::eq(p.starts[0].1.effect, effect));
            let Some(known) = known else {
                promises.push(Promise {
                    starts: vec![(gain, start.member.clone())],
                });
                continue;
            };
            match known
                .starts
                .iter_mut()
                .find(|(_, member)| mode(member) == mode(&start.member))
            {
                Some(same) if gain > same.0 => *same = (gain, start.member.clone()),
                Some(_) => {}
                None => known.starts.push((gain, start.member.clone())),
            }
        }
        for promise in &mut promises {
            promise.starts.sort_by(|a, b| b.0.total_cmp(&a.0));
            let curved = promise.starts[0].1.values.len() - promise.starts[0].1.effect.linear();
            promise.starts.truncate(if curved > 1 { MODES } else { 2 });
        }
        promises.sort_by(|a, b| b.starts[0].0.total_cmp(&a.starts[0].0));
        let largest = promises.first().map_or(0.0, |p| p.starts[0].0);
        promises.retain(|p| p.starts[0].0 > HOPELESS * largest);
        promises
    }

    /// What a changed motion adds to the predictions of a fit.
    fn moved_difference(
        &self,
        base: &Fit,
        start: &Start,
        commanded: &[[[f64; NOMINAL]; 3]],
    ) -> Column {
        let mut values = start
            .seen
            .as_ref()
            .map_or_else(|| vec![0.0; self.weights.len()], |seen| seen.values.clone());
        let blocks =
            [Block::During, Block::Maximum, Block::Minimum].map(|block| self.range(block).start);
        for (row, (moved, commanded)) in start.rows.iter().zip(commanded).enumerate() {
            for (part, first) in blocks.into_iter().enumerate() {
                if self.weights[first + row] == 0.0 {
                    continue;
                }
                let terms = moved[part].iter().zip(&commanded[part]).zip(&base.theta);
                values[first + row] +=
                    self.weights[first + row] * terms.map(|((a, b), x)| (a - b) * x).sum::<f64>();
            }
        }
        self.column(values)
    }

    /// Drop of chi-square by a changed motion, the coefficients fitted anew.
    fn moved_gain(&self, base: &Fit, start: &Start) -> f64 {
        let mut matrix = self.still.matrix;
        let mut right = self.still.right;
        let mut square = self.still.square;
        let blocks =
            [Block::During, Block::Maximum, Block::Minimum].map(|block| self.range(block).start);
        for (row, (moved, run)) in start.rows.iter().zip(&self.situation.runs).enumerate() {
            let rest = shared::model::terms(run.specific_force_g);
            for (part, first) in blocks.into_iter().enumerate() {
                let weight = self.weights[first + row];
                if weight == 0.0 {
                    continue;
                }
                let root = weight
                    * if part == 0 {
                        base.trust[row].sqrt()
                    } else {
                        1.0
                    };
                let mut x = moved[part];
                if part == 0 {
                    for (x, rest) in x.iter_mut().zip(rest) {
                        *x += rest;
                    }
                }
                let y = self.observed.values[first + row] / weight * root;
                for i in 0..NOMINAL {
                    x[i] *= root;
                    right[i] += x[i] * y;
                    for j in 0..=i {
                        matrix[i * NOMINAL + j] += x[i] * x[j];
                    }
                }
                square += y * y;
            }
        }
        let seen = start
            .seen
            .iter()
            .flat_map(|seen| [Block::Reference, Block::Shape].map(|block| (seen, block)));
        for (seen, block) in seen {
            let rows = self.range(block);
            let pairs = seen.values[rows.clone()]
                .iter()
                .zip(&self.observed.values[rows]);
            square += pairs.map(|(seen, y)| seen * (seen - 2.0 * y)).sum::<f64>();
        }
        let Some(factor) = Cholesky::new(matrix.to_vec(), NOMINAL) else {
            return f64::NEG_INFINITY;
        };
        factor.forward(&mut right);
        let objective = square - right.iter().map(|x| x * x).sum::<f64>();
        base.objective - log_variance(base) - objective
    }

    /// Every promising effect on top of a fit, and its best start.
    fn add_to(&self, base: &Fit, starts: &[Start], most: usize) -> Vec<Fit> {
        let promising = self.promising(base, starts).into_iter().take(most);
        promising
            .filter_map(|promise| {
                let largest = promise.starts[0].0;
                // Another mode is worth a fit if the coarse grid may have missed its peak.
                let worth = promise
                    .starts
                    .into_iter()
                    .filter(|(gain, _)| *gain > 0.5 * largest);
                let fits = worth.filter_map(|(_, member)| self.refined(base, member));
                let best = fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
                Some(self.other_signs(best))
            })
            .collect()
    }

    /// Without a reference nothing but the instrument's cross-couplings tells the sign of a motion across the drive: a
    /// fit's last effect from the other signs as well.
    fn other_signs(&self, mut best: Fit) -> Fit {
        let last = best.members.len() - 1;
        let Member { effect, values } = best.members[last].clone();
        if !from_nothing(effect)
            || values.len() < 2
            || self.observed_rows(Block::Reference).next().is_some()
        {
            return best;
        }
        for signs in 1..1_usize << values.len() {
            let mut members = best.members.clone();
            for (k, value) in values.iter().enumerate() {
                members[last].values[k] = if signs >> k & 1 == 1 { -value } else { *value };
            }
            if let Some(fit) = self.refit(members, &best.trust)
                && fit.log_evidence > best.log_evidence
            {
                best = fit;
            }
        }
        best
    }

    fn refined(&self, base: &Fit, member: Member) -> Option<Fit> {
        let mut members = base.members.clone();
        members.push(member);
        self.refit(members, &base.trust)
    }

    fn refit(&self, members: Vec<Member>, trust: &[f64]) -> Option<Fit> {
        let scatters = members
            .iter()
            .position(|m| matches!(m.effect.action, Action::Scatters(_)));
        let mut fit = self.fit(members, trust, 2)?;
        if let Some(index) = scatters {
            for _ in 0..3 {
                let mut members = fit.members.clone();
                members[index].values[0] = self.best_scatter(&fit, index);
                fit = self.fit(members, &fit.trust, 2)?;
            }
        }
        Some(fit)
    }

    /// Drop of -2 log likelihood by a scatter of `during` of that size, at a fit's residuals. `unit` is what of size 1 would
    /// add to the variance of each run that it touches, in units of what the fit has: row of the run, and variance.
    fn scatter_gain(&self, base: &Fit, unit: &[(usize, f64)], size: f64) -> f64 {
        let gain = unit.iter().map(|&(row, unit)| {
            let added = size * size * unit;
            base.residuals[row].powi(2) * added / (1.0 + added) - added.ln_1p()
        });
        gain.sum()
    }

    fn unit_scatter(&self, base: &Fit, effect: &Effect) -> Vec<(usize, f64)> {
        let Action::Scatters(scatter) = effect.action else {
            return Vec::new();
        };
        let runs = self.situation.runs.iter().zip(self.range(Block::During));
        runs.zip(&base.trust)
            .map(|((run, row), trust)| {
                let variance = scatter(run, &self.situation);
                (row, variance * self.weights[row].powi(2) * trust)
            })
            .filter(|(_, unit)| *unit > 0.0)
            .collect()
    }

    /// Largest likeness of any two effects of a fit, beyond what the nominal model can imitate.
    fn likeness(&self, null: &Fit, fit: &Fit) -> f64 {
        let alone: Vec<Column> = fit
            .members
            .iter()
            .map(|member| self.alone(fit, member))
            .collect();
        let references: Vec<&Column> = alone.iter().collect();
        let correlation = self.remainder(null).similarity(&references);
        let mut largest = 0.0_f64;
        for i in 0..alone.len() {
            for j in 0..i {
                largest = largest.max(correlation[i][j].abs());
            }
        }
        largest
    }

    /// What one effect of a fit adds to the observations.
    fn alone(&self, fit: &Fit, member: &Member) -> Column {
        let (_, with, _) = self.tangent(std::slice::from_ref(member), &fit.theta);
        let (_, bare, _) = self.tangent(&[], &fit.theta);
        self.column(with.iter().zip(&bare).map(|(a, b)| a - b).collect())
    }

    /// The most likely size of a scatter, at a fit's residuals without it.
    fn best_scatter(&self, fit: &Fit, index: usize) -> f64 {
        let mut bare = fit.clone();
        let member = bare.members.remove(index);
        let first = self.range(Block::During).start;
        for (row, added) in self.unit_scatter(fit, member.effect) {
            // In units of the variance with the scatter: what is left without it, the noise's own at least.
            let trust = &mut bare.trust[row - first];
            let left = (1.0 - member.values[0].powi(2) * added).max(*trust);
            bare.residuals[row] /= left.sqrt();
            *trust /= left;
        }
        let unit = self.unit_scatter(&bare, member.effect);
        let gain = |size: f64| self.scatter_gain(&bare, &unit, size);
        let Role::Curved { from, to, .. } = member.effect.parameters[0].role else {
            return member.values[0];
        };
        let steps = 200;
        let at = |step: i32| from * (to / from).powf(f64::from(step) / f64::from(steps));
        (0..=steps)
            .map(at)
            .max_by(|a, b| gain(*a).total_cmp(&gain(*b)))
            .unwrap_or(from)
    }

    /// Logarithm of prior times evidence.
    fn weigh(&self, fit: &Fit, catalogue: usize) -> f64 {
        let (n, k) = (catalogue as f64, fit.members.len() as i32);
        let prior = match k {
            0 => PRIOR_NOTHING.ln(),
            _ => ((1.0 - PRIOR_NOTHING) * PRIOR_ANOTHER.powi(k - 1) / n.powi(k)).ln(),
        };
        prior + fit.log_evidence
    }

    fn conclude(
        &self,
        null: Fit,
        null_adequacy: Adequacy,
        fits: Vec<Fit>,
        gap_chi2: f64,
        families: &[Vec<Column>],
        catalogue: usize,
    ) -> Search {
        let mut hypotheses: Vec<Hypothesis> = fits
            .into_iter()
            .map(|fit| Hypothesis {
                log_weight: self.weigh(&fit, catalogue),
                fit,
                probability: 0.0,
            })
            .collect();
        hypotheses.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let adequacy = self.adequacy(&hypotheses[0].fit, families);
        let (chi2, freedom) = adequacy
            .observables
            .iter()
            .fold((0.0, 0.0), |sum, o| (sum.0 + o.0, sum.1 + o.1));
        // Where even the best leaves more than noise, differences count for less.
        let temper = (chi2 / f64::max(freedom, 1.0)).max(1.0);
        let large = adequacy.excess > TOLERATED_SHARE.powi(2) * gap_chi2;
        let best = hypotheses[0].log_weight;
        let something_else = PRIOR_SOMETHING_ELSE.ln() + adequacy.log_something_else / temper;
        let nothing_known =
            PRIOR_SOMETHING_ELSE.ln() + null.log_evidence + null_adequacy.log_something_else - best;
        let unexplained =
            large && (adequacy.p_value < MISFIT || something_else > 3.0 || nothing_known > 0.0);
        let mut total = 0.0;
        for hypothesis in &mut hypotheses {
            hypothesis.probability = ((hypothesis.log_weight - best) / temper).exp();
            total += hypothesis.probability;
        }
        let known = if unexplained {
            UNEXPLAINED_REST
        } else if large {
            total / (total + something_else.exp() + nothing_known.exp())
        } else {
            // A small misfit is the formulas': it makes nothing else probable.
            1.0
        };
        for hypothesis in &mut hypotheses {
            hypothesis.probability *= known / total;
        }
        Search {
            null,
            null_adequacy,
            hypotheses,
            adequacy,
            gap_chi2,
            unexplained,
        }
    }
}

fn insufficient(adequacy: &Adequacy) -> bool {
    adequacy.p_value < MISFIT || adequacy.log_something_else > 7.0
}

fn log_variance(fit: &Fit) -> f64 {
    fit.trust.iter().map(|trust| -trust.ln()).sum()
}

/// Whether an effect that moves the instrument begins at no motion: its parameters can then be refined from there.
fn from_nothing(effect: &Effect) -> bool {
    let even = |role: Role| {
        matches!(
            role,
            Role::Curved {
                logarithmic: false,
                ..
            }
        )
    };
    matches!(effect.action, Action::Moves(..)) && effect.parameters.iter().all(|p| even(p.role))
}

/// Drop of chi-square by a column that is added as it is.
fn fixed_gain(remainder: &Remainder<'_>, column: &Column) -> f64 {
    let (matrix, right) = remainder.normal(&[column]);
    2.0 * right[0] - matrix[0]
}

fn best_of(fits: &[Fit]) -> Option<&Fit> {
    fits.iter()
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

/// Adds fits to a collection that keeps the best of each set of effects.
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
    let names = |fit: &Fit| {
        let mut names: Vec<&str> = fit.members.iter().map(|m| m.effect.id).collect();
        names.sort_unstable();
        names
    };
    debug_assert!(a.theta.len() == NOMINAL);
    names(a) == names(b)
}
