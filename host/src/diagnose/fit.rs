//! One hypothesis (no, one or several effects) fitted to a campaign together with the nominal coefficients.
//!
//! Coefficients and parameters in proportion are solved for exactly; the others by Gauss-Newton steps from a start.
//! The marginal likelihood is Laplace's: the likelihood at the fit, times the volume of the parameters that it leaves,
//! over the volume that they had before.

use shared::model::{Coefficients, NOMINAL};

use super::catalogue::{Action, Effect, Role};
use super::dense::Cholesky;
use super::motion::Motion;
use super::parts::Parts;
use super::problem::{Block, Column, Normal, Problem};
use crate::campaign::DETECTOR_REL_ERROR;

/// Change of chi-square, and of the logarithm of a run's weight, at which a fit has settled.
const SETTLED: f64 = 1e-2;
/// A step that did not help is shortened to this part of it at least, and to this of the first one at last.
const SHORTEST: f64 = 0.1;
const LEAST_PART: f64 = 1e-3;
/// Settings of the first curved parameter that go along with one that goes by steps.
pub(super) const ALONG: usize = 20;

/// An effect with values of its parameters.
#[derive(Clone, Debug)]
pub struct Member {
    /// The effect.
    pub effect: &'static Effect,
    /// Its parameters in the catalogue's order.
    pub values: Vec<f64>,
}

/// A hypothesis fitted to a campaign.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Its effects with their fitted parameters.
    pub members: Vec<Member>,
    /// Coefficients of the nominal model over the problem's scale factor, as (1) is linear in them.
    pub theta: [f64; NOMINAL],
    /// -2 log likelihood, up to what all hypotheses share, prior of the coefficients included.
    pub objective: f64,
    /// Logarithm of the marginal likelihood, up to what all hypotheses share.
    pub log_evidence: f64,
    /// Covariance of coefficients and parameters, row by row, in the order of `columns`.
    pub covariance: Vec<f64>,
    /// What each unknown does to the observations, whitened: coefficients, then each member's parameters (those
    /// that go by steps left out).
    pub columns: Vec<Column>,
    /// Member and parameter of each unknown after the coefficients.
    pub unknowns: Vec<(usize, usize)>,
    /// Whitened residuals; `during` of random runs by their whole uncertainty.
    pub residuals: Vec<f64>,
    /// Of each run the reciprocal variance of `during` in units of the noise's.
    pub trust: Vec<f64>,
    /// Motion of the instrument under the hypothesis.
    pub motions: Vec<Motion>,
}

/// Internal scale of a curved parameter.
fn inner(role: Role, value: f64) -> f64 {
    match role {
        Role::Curved {
            logarithmic: true, ..
        } => value.ln(),
        _ => value,
    }
}

pub(super) fn outer(role: Role, inner: f64) -> f64 {
    match role {
        Role::Curved {
            logarithmic: true, ..
        } => inner.exp(),
        _ => inner,
    }
}

/// Ends of a parameter's range on its internal scale.
pub(super) fn range(role: Role) -> Option<(f64, f64)> {
    match role {
        Role::Linear { .. } => None,
        Role::Curved { from, to, .. } => Some((inner(role, from), inner(role, to))),
        Role::Stepped { from, to, .. } => Some((from, to)),
    }
}

/// The grid of a parameter's starts; of one in proportion, 1.
fn starts(role: Role) -> Vec<f64> {
    match role {
        Role::Linear { .. } => vec![1.0],
        Role::Curved { points, .. } | Role::Stepped { points, .. } => settings(role, points),
    }
}

/// So many values of a parameter, the middles of equal parts of its range.
pub(super) fn settings(role: Role, points: usize) -> Vec<f64> {
    let Some((from, to)) = range(role) else {
        return Vec::new();
    };
    let step = (to - from) / points as f64;
    let at = |k: usize| outer(role, from + (k as f64 + 0.5) * step);
    (0..points).map(at).collect()
}

/// Every combination of the starts of an effect's parameters.
pub fn grid(effect: &'static Effect) -> Vec<Member> {
    let mut members = vec![Vec::new()];
    for parameter in effect.parameters {
        let starts = starts(parameter.role);
        members = members
            .iter()
            .flat_map(|values| {
                starts.iter().map(move |&start| {
                    let mut values = values.clone();
                    values.push(start);
                    values
                })
            })
            .collect();
    }
    members
        .into_iter()
        .map(|values| Member { effect, values })
        .collect()
}

/// How much each run's `during` counts, and the normal equations at the commanded motion under that.
pub(super) struct Weighing {
    trust: Vec<f64>,
    commanded: Normal,
}

/// How a derivative is formed.
#[derive(Clone, Copy)]
enum Difference {
    /// On one side: good enough for the way to a fit.
    Forward,
    /// On both: clipping has kinks, where one side would tell half of it.
    Central,
}

/// A solved linear problem.
struct Solution {
    x: Vec<f64>,
    objective: f64,
    factor: Cholesky,
}

impl Problem<'_> {
    /// Least squares over the coefficients, whose normal equations are given, and further columns with `precision` on
    /// them; `offset` is taken off the observations.
    fn solve(
        &self,
        normal: &Normal,
        nominal: &[Column],
        further: &[&Column],
        precision: &[f64],
        offset: Option<&Column>,
        trust: &[f64],
    ) -> Option<Solution> {
        let n = NOMINAL + further.len();
        let columns = || nominal.iter().chain(further.iter().copied());
        let mut matrix = vec![0.0; n * n];
        for i in 0..NOMINAL {
            let row = &normal.matrix[i * NOMINAL..=i * NOMINAL + i];
            matrix[i * n..=i * n + i].copy_from_slice(row);
        }
        let mut x = normal.right.to_vec();
        for (i, column) in further.iter().enumerate() {
            let row = &mut matrix[(NOMINAL + i) * n..][..=NOMINAL + i];
            for (value, other) in row.iter_mut().zip(columns()) {
                *value = self.dot(column, other, trust);
            }
            row[NOMINAL + i] += precision[i];
            x.push(self.dot(column, &self.observed, trust));
        }
        let mut square = normal.square;
        if let Some(offset) = offset {
            for (x, column) in x.iter_mut().zip(columns()) {
                *x -= self.dot(offset, column, trust);
            }
            square += self.dot(offset, offset, trust);
            square -= 2.0 * self.dot(offset, &self.observed, trust);
        }
        let right = x.clone();
        let factor = Cholesky::new(matrix, n)?;
        factor.solve(&mut x);
        let explained: f64 = x.iter().zip(&right).map(|(x, r)| x * r).sum();
        Some(Solution {
            x,
            objective: square - explained,
            factor,
        })
    }

    /// How much each run's `during` counts.
    pub(super) fn weighing(&self, trust: Vec<f64>) -> Weighing {
        Weighing {
            commanded: self.normal(&self.nominal, &trust),
            trust,
        }
    }

    /// -2 log likelihood of members at their values, all in proportion solved for.
    pub(super) fn profile(&self, members: &[Member], weighing: &Weighing) -> f64 {
        let parts = self.parts(members);
        self.solve_parts(members, &parts, weighing)
            .map_or(f64::INFINITY, |solution| solution.objective)
    }

    fn solve_parts(
        &self,
        members: &[Member],
        parts: &Parts,
        weighing: &Weighing,
    ) -> Option<Solution> {
        self.solve_near(members, parts, &[], &[], weighing)
    }

    /// Solves for all in proportion and, by their `derivatives`, for small changes of the curved parameters.
    fn solve_near(
        &self,
        members: &[Member],
        parts: &Parts,
        derivatives: &[Column],
        precision: &[f64],
        weighing: &Weighing,
    ) -> Option<Solution> {
        let trust = &weighing.trust;
        let moved = parts.nominal();
        let normal = moved.map(|nominal| self.normal(nominal, trust));
        let linear = parts.linear().map(|(column, _)| column);
        self.solve(
            normal.as_ref().unwrap_or(&weighing.commanded),
            moved.unwrap_or(&self.nominal),
            &linear.chain(derivatives).collect::<Vec<_>>(),
            &[&linear_precision(members), precision].concat(),
            parts.offset.as_ref(),
            trust,
        )
    }

    /// Prediction of the members' part (and of the nominal one, if motion is changed), whitened.
    fn predicted(&self, parts: &Parts, x: &[f64]) -> Vec<f64> {
        let mut sum = parts
            .offset
            .as_ref()
            .map_or_else(|| vec![0.0; self.weights.len()], |o| o.values.clone());
        let nominal = parts.nominal().into_iter().flatten().zip(x);
        for (column, x) in nominal.chain(parts.linear().map(|(c, _)| c).zip(&x[NOMINAL..])) {
            for (s, v) in sum.iter_mut().zip(&column.values) {
                *s += x * v;
            }
        }
        sum
    }

    /// Fits the nominal model alone.
    pub fn fit_nominal(&self) -> Option<Fit> {
        self.fit(Vec::new(), &vec![1.0; self.run_count()], 3)
    }

    /// Fits members from their values; `trust` is a first guess of the trust in each run.
    pub fn fit(&self, members: Vec<Member>, trust: &[f64], rounds: usize) -> Option<Fit> {
        let curved = curved(&members);
        self.fit_some(members, curved, trust, rounds)
    }

    /// The same with these of the curved parameters, by member and number; the others stay as they are.
    pub(super) fn fit_some(
        &self,
        mut members: Vec<Member>,
        curved: Vec<(usize, usize)>,
        trust: &[f64],
        rounds: usize,
    ) -> Option<Fit> {
        let mut weighing = self.weighing(trust.to_vec());
        let mut log_variance = 0.0;
        let mut parts = self.parts(&members);
        let mut solution = self.solve_parts(&members, &parts, &weighing)?;
        for round in 0..rounds {
            let steps = if curved.is_empty() {
                0
            } else if round == 0 {
                30
            } else {
                8
            };
            for _ in 0..steps {
                let derivatives =
                    self.derivatives(&members, &solution.x, &curved, Difference::Forward);
                let Some((direction, objective)) =
                    self.direction(&members, &parts, &derivatives, &curved, &weighing)
                else {
                    break;
                };
                let promised = solution.objective - objective;
                let mut fraction = 1.0;
                let mut better = None;
                // A part of the step promises that part of the whole's gain, at least.
                while better.is_none() && fraction * promised > SETTLED && fraction > LEAST_PART {
                    let candidate = moved(&members, &curved, &direction, fraction);
                    let parts = self.parts(&candidate);
                    let tried = self.solve_parts(&candidate, &parts, &weighing);
                    let objective = tried.as_ref().map_or(f64::INFINITY, |t| t.objective);
                    let lost = objective - solution.objective;
                    if let (Some(tried), true) = (tried, lost < 0.0) {
                        better = Some((candidate, parts, tried));
                    } else {
                        // Where the parabola through what is known has its least value.
                        let least = promised * fraction / (lost + 2.0 * promised * fraction);
                        fraction *= least.max(SHORTEST);
                    }
                }
                let Some(better) = better else { break };
                let gained = solution.objective - better.2.objective;
                (members, parts, solution) = better;
                if gained < SETTLED {
                    break;
                }
            }
            if round == 0 && self.sweep(&mut members, &weighing) {
                parts = self.parts(&members);
                solution = self.solve_parts(&members, &parts, &weighing)?;
            }
            // What of the random runs nobody saw follows from the fit itself.
            let theta = nominal(&solution.x);
            let motions = parts.motions().unwrap_or(&self.situation.motions);
            let added = parts.added_variance(&solution.x);
            let extra = self.unseen_variance(&theta, motions, &added);
            let trust: Vec<f64> = extra.iter().map(|e| 1.0 / (1.0 + e)).collect();
            let before = weighing.trust.iter().zip(&trust);
            let settled = before.map(|(a, b)| (a / b).ln().abs()).fold(0.0, f64::max) < SETTLED;
            weighing = self.weighing(trust);
            log_variance = extra.iter().map(|e| e.ln_1p()).sum();
            solution = self.solve_parts(&members, &parts, &weighing)?;
            if settled {
                break;
            }
        }
        let derivatives = self.derivatives(&members, &solution.x, &curved, Difference::Central);
        self.finish(
            members,
            parts,
            solution,
            derivatives,
            curved,
            weighing,
            log_variance,
        )
    }

    /// The ranges of a threshold of the runs' peaks over which it makes no difference: from peak to peak. Peaks alike but for
    /// the detector's error count as one.
    pub(super) fn steps(&self, from: f64, to: f64) -> Vec<(f64, f64)> {
        let mut edges: Vec<f64> = self.situation.peaks_g.clone();
        edges.retain(|peak| (from..to).contains(peak));
        edges.extend([from, to]);
        edges.sort_by(f64::total_cmp);
        edges.dedup_by(|b, a| *b < *a * (1.0 + DETECTOR_REL_ERROR));
        edges.windows(2).map(|edge| (edge[0], edge[1])).collect()
    }

    /// Moves parameters that go by steps to the best step near their start; whether any moved.
    fn sweep(&self, members: &mut [Member], weighing: &Weighing) -> bool {
        let mut moved = false;
        for m in 0..members.len() {
            for k in 0..members[m].effect.parameters.len() {
                let Role::Stepped { from, to, points } = members[m].effect.parameters[k].role
                else {
                    continue;
                };
                let start = members[m].values[k];
                let near = 1.5 * (to - from) / points as f64;
                let mut best = (self.profile(members, weighing), start);
                for (low, high) in self.steps(from.max(start - near), to.min(start + near)) {
                    members[m].values[k] = 0.5 * (low + high);
                    let objective = self.profile(members, weighing);
                    if objective < best.0 {
                        best = (objective, members[m].values[k]);
                    }
                }
                members[m].values[k] = best.1;
                moved |= best.1 != start;
            }
        }
        moved
    }

    /// At a step of parameter `k` of member `m` the best of some settings `along` it of the effect's first curved parameter,
    /// with its objective.
    pub(super) fn best_at_step(
        &self,
        members: &[Member],
        (m, k): (usize, usize),
        (low, high): (f64, f64),
        along: &[f64],
        weighing: &Weighing,
    ) -> Option<(f64, Vec<Member>)> {
        let with = |setting: &f64| {
            let mut members = members.to_vec();
            let first = members[m].effect.linear();
            members[m].values[first] = *setting;
            members[m].values[k] = 0.5 * (low + high);
            (self.profile(&members, weighing), members)
        };
        along.iter().map(with).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// The best of fits anew from the most promising steps of a parameter that goes by steps, the effect's first curved
    /// parameter going along: the fit itself looked near its start alone. `None` if that is no better.
    pub(super) fn stepped_anew(&self, fit: &Fit) -> Option<Fit> {
        const TRIED: usize = 3;
        let weighing = self.weighing(fit.trust.clone());
        let mut starts: Vec<(f64, Vec<Member>)> = Vec::new();
        for (m, Member { effect, .. }) in fit.members.iter().enumerate() {
            for (k, parameter) in effect.parameters.iter().enumerate() {
                let Role::Stepped { from, to, .. } = parameter.role else {
                    continue;
                };
                let along = settings(effect.parameters[effect.linear()].role, ALONG);
                let steps = self.steps(from, to).into_iter();
                let best = |step| self.best_at_step(&fit.members, (m, k), step, &along, &weighing);
                starts.extend(steps.filter_map(best));
            }
        }
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let fits = starts.into_iter().take(TRIED);
        fits.filter_map(|(_, members)| self.fit(members, &fit.trust, 2))
            .filter(|anew| anew.objective < fit.objective - SETTLED)
            .min_by(|a, b| a.objective.total_cmp(&b.objective))
    }

    /// Columns of the derivatives by the curved parameters on their internal scale.
    fn derivatives(
        &self,
        members: &[Member],
        x: &[f64],
        curved: &[(usize, usize)],
        difference: Difference,
    ) -> Vec<Column> {
        let moving = members
            .iter()
            .any(|m| matches!(m.effect.action, Action::Moves(..)));
        let column = |&(m, k): &(usize, usize)| {
            let role = members[m].effect.parameters[k].role;
            let (from, to) = range(role).unwrap_or((0.0, 1.0));
            let t = inner(role, members[m].values[k]);
            // Without a change of motion nothing but the effect itself changes.
            let alone = !moving && matches!(members[m].effect.action, Action::Adds(_));
            let linear =
                |members: &[Member]| members.iter().map(|m| m.effect.linear()).sum::<usize>();
            let first = NOMINAL + linear(&members[..m]);
            let its_own = [&[0.0; NOMINAL], &x[first..first + linear(&members[m..=m])]].concat();
            let at = |t: f64| {
                let mut moved = members.to_vec();
                moved[m].values[k] = outer(role, t);
                if alone {
                    self.predicted(&self.parts(&moved[m..=m]), &its_own)
                } else {
                    self.predicted(&self.parts(&moved), x)
                }
            };
            let h = 1e-4 * (to - from);
            let behind = match difference {
                Difference::Forward => 0.0,
                Difference::Central => h,
            };
            let (then, now) = (at(t - behind), at(t + h));
            let change = now.iter().zip(&then).map(|(now, then)| now - then);
            self.column(change.map(|change| change / (h + behind)).collect())
        };
        curved.iter().map(column).collect()
    }

    /// The whitened prediction of effects at given parameters and (linear) coefficients, and the variance (g^2) that they
    /// add to each run's `during`.
    pub fn prediction(&self, members: &[Member], theta: &[f64; NOMINAL]) -> (Vec<f64>, Vec<f64>) {
        let parts = self.parts(members);
        let mut x = theta.to_vec();
        for member in members {
            x.extend_from_slice(&member.values[..member.effect.linear()]);
        }
        let mut variance = parts.added_variance(&x);
        if let Some(motions) = parts.motions() {
            let coefficients = nominal(&x);
            for (variance, (run, motion)) in variance
                .iter_mut()
                .zip(self.situation.runs.iter().zip(motions))
            {
                *variance += self.spectral_variance(run, motion, &coefficients);
            }
        }
        (self.fitted(&parts, &x), variance)
    }

    /// At given members and coefficients: what each unknown does, the whole prediction, the variance of `during`.
    pub(super) fn tangent(
        &self,
        members: &[Member],
        theta: &[f64; NOMINAL],
    ) -> (Vec<Column>, Vec<f64>, Vec<f64>) {
        let curved = curved(members);
        let parts = self.parts(members);
        let mut x = theta.to_vec();
        for member in members {
            x.extend_from_slice(&member.values[..member.effect.linear()]);
        }
        let derivatives = self.derivatives(members, &x, &curved, Difference::Central);
        let prediction = self.fitted(&parts, &x);
        let added = parts.added_variance(&x);
        (self.unknowns(&parts, derivatives), prediction, added)
    }

    /// The Gauss-Newton step of the curved parameters on their internal scale, and the objective that it promises.
    fn direction(
        &self,
        members: &[Member],
        parts: &Parts,
        derivatives: &[Column],
        curved: &[(usize, usize)],
        weighing: &Weighing,
    ) -> Option<(Vec<f64>, f64)> {
        let precision = curved_precision(members, curved, 1.0)?;
        let solved = self.solve_near(members, parts, derivatives, &precision, weighing)?;
        let step = solved.x[solved.x.len() - curved.len()..].to_vec();
        Some((step, solved.objective))
    }

    #[expect(clippy::too_many_arguments, reason = "the end of a fit")]
    fn finish(
        &self,
        mut members: Vec<Member>,
        parts: Parts,
        solution: Solution,
        derivatives: Vec<Column>,
        curved: Vec<(usize, usize)>,
        weighing: Weighing,
        log_variance: f64,
    ) -> Option<Fit> {
        let mut unknowns = Vec::new();
        let mut log_prior = 0.0;
        // Variance of an even probability over a range: a twelfth of its square.
        let precision = curved_precision(&members, &curved, 12.0)?;
        for (m, member) in members.iter_mut().enumerate() {
            for (k, parameter) in member.effect.parameters.iter().enumerate() {
                match parameter.role {
                    Role::Linear { width } => {
                        let value = solution.x[NOMINAL + unknowns.len()];
                        member.values[k] = value;
                        unknowns.push((m, k));
                        log_prior -=
                            (std::f64::consts::PI * width * (1.0 + (value / width).powi(2))).ln();
                    }
                    Role::Stepped { points, .. } => log_prior -= 0.5 * (points as f64).ln(),
                    Role::Curved { .. } if matches!(member.effect.action, Action::Scatters(_)) => {
                        log_prior -= 2.0
                    }
                    Role::Curved { .. } => {}
                }
            }
        }
        for &(m, k) in &curved {
            let (from, to) = range(members[m].effect.parameters[k].role)?;
            log_prior -= (to - from).ln();
            unknowns.push((m, k));
        }
        let theta = nominal_values(&solution.x);
        let fitted = self.fitted(&parts, &solution.x);
        let residuals = self.residuals(&fitted, &weighing.trust);
        let factor = if curved.is_empty() {
            solution.factor
        } else {
            self.solve_near(&members, &parts, &derivatives, &precision, &weighing)?
                .factor
        };
        let columns = self.unknowns(&parts, derivatives);
        let objective = solution.objective + log_variance;
        let volume = unknowns.len() as f64 * std::f64::consts::TAU.ln() - factor.log_determinant();
        Some(Fit {
            log_evidence: 0.5 * (volume - objective) + log_prior,
            covariance: factor.inverse(),
            motions: parts.motions().unwrap_or(&self.situation.motions).to_vec(),
            members,
            theta,
            objective,
            columns,
            unknowns,
            residuals,
            trust: weighing.trust,
        })
    }

    /// What each unknown does: the coefficients, what is in proportion, then the curved parameters by their derivatives.
    fn unknowns(&self, parts: &Parts, derivatives: Vec<Column>) -> Vec<Column> {
        let nominal = parts.nominal().unwrap_or(&self.nominal).iter();
        let linear = parts.linear().map(|(column, _)| column);
        nominal.chain(linear).cloned().chain(derivatives).collect()
    }

    /// The whole prediction, whitened.
    fn fitted(&self, parts: &Parts, x: &[f64]) -> Vec<f64> {
        let mut sum = self.predicted(parts, x);
        if parts.nominal().is_none() {
            for (column, x) in self.nominal.iter().zip(x) {
                for (s, v) in sum.iter_mut().zip(&column.values) {
                    *s += x * v;
                }
            }
        }
        sum
    }

    fn residuals(&self, fitted: &[f64], trust: &[f64]) -> Vec<f64> {
        let mut residuals: Vec<f64> = self
            .observed
            .values
            .iter()
            .zip(fitted)
            .map(|(y, f)| y - f)
            .collect();
        for (residual, trust) in residuals[self.range(Block::During)].iter_mut().zip(trust) {
            *residual *= trust.sqrt();
        }
        residuals
    }
}

/// Member and number of each parameter that is refined by Gauss-Newton steps.
pub(super) fn curved(members: &[Member]) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    for (m, member) in members.iter().enumerate() {
        if matches!(member.effect.action, Action::Scatters(_)) {
            continue;
        }
        let parameters = member.effect.parameters.iter().enumerate();
        let curved = parameters.filter(|(_, p)| matches!(p.role, Role::Curved { .. }));
        found.extend(curved.map(|(k, _)| (m, k)));
    }
    found
}

/// The members a fraction of a step further, within the parameters' ranges.
fn moved(
    members: &[Member],
    curved: &[(usize, usize)],
    direction: &[f64],
    fraction: f64,
) -> Vec<Member> {
    let mut members = members.to_vec();
    for (&(m, k), step) in curved.iter().zip(direction) {
        let role = members[m].effect.parameters[k].role;
        if let Some((from, to)) = range(role) {
            let largest = 0.3 * (to - from);
            let t = inner(role, members[m].values[k]) + fraction * step.clamp(-largest, largest);
            members[m].values[k] = outer(role, t.clamp(from, to));
        }
    }
    members
}

fn linear_precision(members: &[Member]) -> Vec<f64> {
    let roles = members
        .iter()
        .flat_map(|m| m.effect.parameters)
        .map(|p| p.role);
    roles
        .filter_map(|role| match role {
            // The Cauchy prior is counted at the fit; this keeps what no observation sees from running away.
            Role::Linear { width } => Some((100.0 * width).powi(-2)),
            _ => None,
        })
        .collect()
}

/// Precision of the curved parameters on their internal scale, over the square of their range.
fn curved_precision(
    members: &[Member],
    curved: &[(usize, usize)],
    precision: f64,
) -> Option<Vec<f64>> {
    let of = |&(m, k): &(usize, usize)| {
        let (from, to) = range(members[m].effect.parameters[k].role)?;
        Some(precision / (to - from).powi(2))
    };
    curved.iter().map(of).collect()
}

fn nominal_values(x: &[f64]) -> [f64; NOMINAL] {
    std::array::from_fn(|k| x[k])
}

/// The coefficients behind the linear unknowns, with a scale factor of 1.
pub fn nominal(x: &[f64]) -> Coefficients<f64> {
    let k1 = x[0];
    let mut c = nominal_values(x).map(|x| x / k1);
    c[0] = 1.0;
    Coefficients::from_nominal(c)
}
