//! Which effects: singles, pairs and steps beyond, by marginal likelihood.

use shared::model::NOMINAL;

use super::adequacy::Adequacy;
use super::catalogue::{Action, Effect, Role};
use super::fit::{Fit, Member, grid, nominal};
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
/// Share of the gap (in units of its root) below which a misfit is the formulas' and not another effect's.
const TOLERATED_SHARE: f64 = 0.05;
/// Likeness of two effects of a set of three or more beyond which they stand in together for something else.
const STAND_IN: f64 = 0.5;
/// Most effects at once.
const MOST_EFFECTS: usize = 3;
/// Best hypotheses that another effect is added to.
const BASES: usize = 3;

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

/// A start of an effect with the columns that it needs, made once.
struct Start {
    member: Member,
    columns: Vec<Column>,
}

impl Problem<'_> {
    /// Searches `catalogue`. `None` if the campaign does not determine even the nominal model with its priors.
    pub fn search(&mut self, catalogue: &[&'static Effect]) -> Option<Search> {
        self.situation.coefficients = self.coefficients_at_rest()?;
        let null = self.fit_nominal()?;
        let starts: Vec<Start> = catalogue
            .iter()
            .flat_map(|effect| self.starts(effect))
            .collect();
        let mut singles = self.add_to(&null, catalogue, &starts);
        singles.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        let families = self.families();
        let null_adequacy = self.adequacy(&null, &families);
        let gap_chi2 = null_adequacy
            .observables
            .iter()
            .map(|(chi2, freedom)| chi2 - freedom)
            .sum::<f64>()
            .max(0.0);
        let moved = singles
            .first()
            .is_some_and(|best| best.log_evidence > null.log_evidence + WORTH);
        if moved {
            // The coefficients that effects look at, now that the largest bend is out of them.
            self.situation.coefficients = nominal(&singles[0].theta);
            for fit in singles.iter_mut().take(6) {
                if let Some(again) = self.fit(fit.members.clone(), &fit.trust, 2) {
                    *fit = again;
                }
            }
        }
        let mut fits = singles;
        let judge = |fits: &[Fit], problem: &Self| {
            let best = fits.iter().max_by(|a, b| {
                problem
                    .weigh(a, catalogue.len())
                    .total_cmp(&problem.weigh(b, catalogue.len()))
            });
            best.map(|best| problem.adequacy(best, &families))
        };
        let mut adequacy = judge(&fits, self).unwrap_or_else(|| null_adequacy.clone());
        for effects in 2..=MOST_EFFECTS {
            if !moved || !insufficient(&adequacy) {
                break;
            }
            let mut bases: Vec<&Fit> = fits
                .iter()
                .filter(|fit| fit.members.len() == effects - 1)
                .collect();
            bases.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
            bases.truncate(BASES);
            let mut larger: Vec<Fit> = Vec::new();
            let mut offer = |found: Vec<Fit>| {
                for fit in found {
                    match larger.iter_mut().find(|known| same(known, &fit)) {
                        Some(known) if known.log_evidence < fit.log_evidence => *known = fit,
                        Some(_) => {}
                        None => larger.push(fit),
                    }
                }
            };
            for base in bases {
                offer(self.extend(base, catalogue, &starts));
            }
            let best = larger
                .iter()
                .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
                .cloned();
            // A second look from the newest member: the first one may have stood in for two.
            if let Some(best) = best.filter(|best| best.members.len() == 2) {
                let newest = best.members.last().cloned().into_iter().collect();
                if let Some(base) = self.fit(newest, &best.trust, 2) {
                    let found = self.extend(&base, catalogue, &starts);
                    for fit in found {
                        match larger.iter_mut().find(|known| same(known, &fit)) {
                            Some(known) if known.log_evidence < fit.log_evidence => *known = fit,
                            Some(_) => {}
                            None => larger.push(fit),
                        }
                    }
                }
            }
            if effects > 2 {
                larger.retain(|fit| self.likeness(&null, fit) < STAND_IN);
            }
            fits.extend(larger);
            adequacy = judge(&fits, self).unwrap_or(adequacy);
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

    /// Coefficients from all that stands still.
    fn coefficients_at_rest(&self) -> Option<shared::model::Coefficients<f64>> {
        let mut trust = vec![1.0; self.run_count()];
        trust.fill(1e-12);
        let fit = self.fit(Vec::new(), &trust, 0)?;
        Some(nominal(&fit.theta))
    }

    fn starts(&self, effect: &'static Effect) -> Vec<Start> {
        grid(effect)
            .into_iter()
            .map(|member| {
                let columns = match effect.action {
                    Action::Adds(add) => (0..effect.linear().max(1))
                        .map(|k| {
                            let mut change = self.no_change();
                            add(&member.values, k, &self.situation, &mut change);
                            self.whiten(change).0
                        })
                        .collect(),
                    _ => Vec::new(),
                };
                Start { member, columns }
            })
            .collect()
    }

    /// The best start of every effect on top of a fit, by the drop of chi-square, largest first.
    fn promising(&self, base: &Fit, starts: &[Start]) -> Vec<(f64, Member)> {
        let residual = self.column(base.residuals.clone());
        let mut best: Vec<(f64, Member)> = Vec::new();
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
                Action::Adds(_)
                    if start
                        .columns
                        .iter()
                        .all(|c| c.values.iter().all(|&v| v == 0.0)) =>
                {
                    0.0
                }
                Action::Adds(_) if effect.linear() > 0 => {
                    let columns: Vec<&Column> = start.columns.iter().collect();
                    self.gain(base, &columns, &residual, 1e8).0
                }
                Action::Adds(_) | Action::Moves(..) => {
                    let mut members = base.members.clone();
                    members.push(start.member.clone());
                    base.objective - log_variance(base) - self.profile(&members, &base.trust)
                }
                Action::Scatters(_) => self.scatter_gain(base, &start.member),
            };
            match best
                .iter_mut()
                .find(|(_, member)| std::ptr::eq(member.effect, effect))
            {
                Some(known) if gain > known.0 => *known = (gain, start.member.clone()),
                Some(_) => {}
                None => best.push((gain, start.member.clone())),
            }
        }
        best.sort_by(|a, b| b.0.total_cmp(&a.0));
        best
    }

    /// Every effect on top of a fit.
    fn add_to(&self, base: &Fit, catalogue: &[&'static Effect], starts: &[Start]) -> Vec<Fit> {
        let promising = self.promising(base, starts);
        debug_assert!(promising.len() <= catalogue.len());
        promising
            .into_iter()
            .filter_map(|(_, member)| self.refined(base, member))
            .collect()
    }

    /// The most promising further effects on top of a fit.
    fn extend(&self, base: &Fit, _: &[&'static Effect], starts: &[Start]) -> Vec<Fit> {
        let promising = self.promising(base, starts).into_iter().take(4);
        promising
            .filter_map(|(_, member)| self.refined(base, member))
            .collect()
    }

    fn refined(&self, base: &Fit, member: Member) -> Option<Fit> {
        let mut members = base.members.clone();
        members.push(member);
        let scatters = members
            .iter()
            .position(|m| matches!(m.effect.action, Action::Scatters(_)));
        let mut fit = self.fit(members, &base.trust, 2)?;
        if let Some(index) = scatters {
            for _ in 0..3 {
                let mut members = fit.members.clone();
                members[index].values[0] = self.best_scatter(&fit, index);
                fit = self.fit(members, &fit.trust, 2)?;
            }
        }
        Some(fit)
    }

    /// Drop of -2 log likelihood by a scatter of `during`, at a fit's residuals.
    fn scatter_gain(&self, base: &Fit, member: &Member) -> f64 {
        let Action::Scatters(scatter) = member.effect.action else {
            return 0.0;
        };
        let rows = self.range(Block::During);
        let mut gain = 0.0;
        for ((run, row), trust) in self.situation.runs.iter().zip(rows).zip(&base.trust) {
            let added =
                scatter(&member.values, run, &self.situation) * self.weights[row].powi(2) * trust;
            gain += base.residuals[row].powi(2) * added / (1.0 + added) - added.ln_1p();
        }
        gain
    }

    /// Largest likeness of any two effects of a fit, beyond what the nominal model can imitate.
    fn likeness(&self, null: &Fit, fit: &Fit) -> f64 {
        let alone: Vec<Column> = fit
            .members
            .iter()
            .map(|member| self.alone(fit, member))
            .collect();
        let references: Vec<&Column> = alone.iter().collect();
        let correlation = self.similarity(null, &references);
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
        let Action::Scatters(scatter) = member.effect.action else {
            return member.values[0];
        };
        let rows = self.range(Block::During);
        for ((run, row), trust) in self.situation.runs.iter().zip(rows).zip(&mut bare.trust) {
            let added = scatter(&member.values, run, &self.situation) * self.weights[row].powi(2);
            let without = 1.0 / (1.0 / *trust - added).max(1.0);
            bare.residuals[row] *= (without / *trust).sqrt();
            *trust = without;
        }
        let gain = |gain: f64| {
            self.scatter_gain(
                &bare,
                &Member {
                    effect: member.effect,
                    values: vec![gain],
                },
            )
        };
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
        let best = hypotheses[0].log_weight;
        let something_else = PRIOR_SOMETHING_ELSE.ln() + adequacy.log_something_else / temper;
        let nothing_known =
            PRIOR_SOMETHING_ELSE.ln() + null.log_evidence + null_adequacy.log_something_else - best;
        let mut total = something_else.exp() + nothing_known.exp();
        for hypothesis in &mut hypotheses {
            hypothesis.probability = ((hypothesis.log_weight - best) / temper).exp();
            total += hypothesis.probability;
        }
        for hypothesis in &mut hypotheses {
            hypothesis.probability /= total;
        }
        let large = adequacy.excess > TOLERATED_SHARE.powi(2) * gap_chi2;
        let unexplained =
            large && (adequacy.p_value < MISFIT || something_else > 3.0 || nothing_known > 0.0);
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

fn same(a: &Fit, b: &Fit) -> bool {
    let names = |fit: &Fit| {
        let mut names: Vec<&str> = fit.members.iter().map(|m| m.effect.id).collect();
        names.sort_unstable();
        names
    };
    debug_assert!(a.theta.len() == NOMINAL);
    names(a) == names(b)
}
