//! One hypothesis (no, one or several components) fitted together with the base.
//!
//! Unknowns of the base and parameters in proportion are solved for exactly; the others by Gauss-Newton steps from a start
//! (variable projection).

use crate::evidence::{Ended, log_evidence};
use crate::linear::{Solution, Weighing, solve, solve_linear};
use crate::model::{Fidelity, Kind, Member, Prediction, SeparableModel, linear_precision};
use crate::observations::Column;
use crate::prior::Prior;

/// Change of -2 log likelihood, and of the logarithm of a row's precision, at which a fit has settled.
pub(crate) const SETTLED: f64 = 1e-2;
/// A step that did not help is shortened to this part of it at least, and to this of the first one at last.
const SHORTEST: f64 = 0.1;
const LEAST_PART: f64 = 1e-3;
/// Settings of the first nonlinear parameter that go along with a threshold.
pub(crate) const ALONG: usize = 20;
/// Most steps of the first round, and of later ones.
const STEPS: [usize; 2] = [30, 8];

/// A hypothesis fitted to the observations.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Its components with their fitted parameters.
    pub members: Vec<Member>,
    /// Unknowns of the base.
    pub base_values: Vec<f64>,
    /// -2 log likelihood, up to what all hypotheses share, prior of the base included.
    pub objective: f64,
    /// Logarithm of the marginal likelihood, up to what all hypotheses share.
    pub log_evidence: f64,
    /// Covariance of the base's unknowns and the parameters, row by row, in the order of `columns`.
    pub covariance: Vec<f64>,
    /// What each unknown does to the observations, whitened: the base's, then each member's parameters (thresholds left
    /// out).
    pub columns: Vec<Column>,
    /// Member and parameter of each unknown after the base's.
    pub unknowns: Vec<(usize, usize)>,
    /// Whitened residuals; uncertain rows by their whole uncertainty.
    pub residuals: Vec<f64>,
    /// Of each uncertain row the reciprocal variance in units of the stated one.
    pub precision_factor: Vec<f64>,
}

impl Fit {
    /// Sum of the logarithms of the uncertain rows' variances.
    pub(crate) fn log_variance(&self) -> f64 {
        self.precision_factor
            .iter()
            .map(|factor| -factor.ln())
            .sum()
    }

    /// Covariance of two unknowns.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        self.covariance[i * self.columns.len() + j]
    }

    /// Number of a member's parameter among the unknowns; none of a threshold.
    pub fn unknown(&self, member: usize, parameter: usize) -> Option<usize> {
        let place = self
            .unknowns
            .iter()
            .position(|&u| u == (member, parameter))?;
        Some(self.base_values.len() + place)
    }
}

/// How a derivative is formed.
#[derive(Clone, Copy)]
enum Difference {
    /// On one side: good enough for the way to a fit.
    Forward,
    /// On both: a kink would tell half of itself on one side.
    Central,
}

/// A fit under way: members at their values, what they predict, what is solved for at them.
struct State {
    members: Vec<Member>,
    prediction: Prediction,
    solution: Solution,
}

impl State {
    fn new(model: &dyn SeparableModel, members: Vec<Member>, weighing: &Weighing) -> Option<Self> {
        let prediction = model.predict(&members, Fidelity::Full);
        let solution = solve_linear(model, &members, &prediction, weighing)?;
        Some(Self {
            members,
            prediction,
            solution,
        })
    }
}

/// Fits the base alone.
pub fn fit_base(model: &dyn SeparableModel) -> Option<Fit> {
    let certain = vec![1.0; model.observations().uncertain().len()];
    fit(model, Vec::new(), &certain, 3)
}

/// Fits members from their values; `precision_factor` is a first guess of how much each uncertain row counts. `None` if the
/// observations and priors do not determine it.
pub fn fit(
    model: &dyn SeparableModel,
    members: Vec<Member>,
    precision_factor: &[f64],
    rounds: usize,
) -> Option<Fit> {
    let nonlinear = nonlinear(model, &members);
    fit_some(model, members, &nonlinear, precision_factor, rounds)
}

/// The same with these of the nonlinear parameters, by member and number; the others stay as they are.
pub(crate) fn fit_some(
    model: &dyn SeparableModel,
    members: Vec<Member>,
    nonlinear: &[(usize, usize)],
    precision_factor: &[f64],
    rounds: usize,
) -> Option<Fit> {
    let mut weighing = Weighing::new(model, precision_factor.to_vec());
    let mut log_variance = 0.0;
    let mut state = State::new(model, members, &weighing)?;
    for round in 0..rounds {
        descend(model, &mut state, nonlinear, &weighing, STEPS[round.min(1)]);
        if round == 0 && sweep(model, &mut state.members, &weighing) {
            state = State::new(model, state.members, &weighing)?;
        }
        // What of the uncertain rows nobody saw follows from the fit itself.
        let extra = model.variance(&state.members, &state.prediction, &state.solution.x);
        let factors: Vec<f64> = extra.iter().map(|extra| 1.0 / (1.0 + extra)).collect();
        let before = weighing.precision_factor.iter().zip(&factors);
        let settled = before.map(|(a, b)| (a / b).ln().abs()).fold(0.0, f64::max) < SETTLED;
        weighing = Weighing::new(model, factors);
        log_variance = extra.iter().map(|e| e.ln_1p()).sum();
        state.solution = solve_linear(model, &state.members, &state.prediction, &weighing)?;
        if settled {
            break;
        }
    }
    finish(model, state, nonlinear, weighing, log_variance)
}

/// Gauss-Newton steps until one does not help or helps little.
fn descend(
    model: &dyn SeparableModel,
    state: &mut State,
    nonlinear: &[(usize, usize)],
    weighing: &Weighing,
    steps: usize,
) {
    let steps = if nonlinear.is_empty() { 0 } else { steps };
    for _ in 0..steps {
        let x = &state.solution.x;
        let derivatives = derivatives(model, &state.members, x, nonlinear, Difference::Forward);
        let Some((direction, objective)) =
            direction(model, state, &derivatives, nonlinear, weighing)
        else {
            break;
        };
        let promised = state.solution.objective - objective;
        let Some(better) = line_search(model, state, nonlinear, &direction, promised, weighing)
        else {
            break;
        };
        let gained = state.solution.objective - better.solution.objective;
        *state = better;
        if gained < SETTLED {
            break;
        }
    }
}

/// A part of a step that helps; none if it promises too little.
fn line_search(
    model: &dyn SeparableModel,
    state: &State,
    nonlinear: &[(usize, usize)],
    direction: &[f64],
    promised: f64,
    weighing: &Weighing,
) -> Option<State> {
    let mut fraction = 1.0;
    // A part of the step promises that part of the whole's gain, at least.
    while fraction * promised > SETTLED && fraction > LEAST_PART {
        let candidate = moved(model, &state.members, nonlinear, direction, fraction);
        let tried = State::new(model, candidate, weighing);
        let objective = tried
            .as_ref()
            .map_or(f64::INFINITY, |t| t.solution.objective);
        let lost = objective - state.solution.objective;
        match tried {
            Some(tried) if lost < 0.0 => return Some(tried),
            _ => {
                // Where the parabola through what is known has its least value.
                let least = promised * fraction / (lost + 2.0 * promised * fraction);
                fraction *= least.max(SHORTEST);
            }
        }
    }
    None
}

/// -2 log likelihood of members at their values, all in proportion solved for.
pub(crate) fn profile(model: &dyn SeparableModel, members: &[Member], weighing: &Weighing) -> f64 {
    let prediction = model.predict(members, Fidelity::Full);
    solve_linear(model, members, &prediction, weighing)
        .map_or(f64::INFINITY, |solution| solution.objective)
}

/// Moves thresholds to the best step near their start; whether any moved.
fn sweep(model: &dyn SeparableModel, members: &mut [Member], weighing: &Weighing) -> bool {
    let mut moved_any = false;
    for m in 0..members.len() {
        let parameters = model.components()[members[m].component].parameters;
        for (k, parameter) in parameters.iter().enumerate() {
            let Prior::Threshold { from, to, points } = parameter.prior else {
                continue;
            };
            let start = members[m].values[k];
            let near = 1.5 * (to - from) / points as f64;
            let mut best = (profile(model, members, weighing), start);
            for (low, high) in model.threshold_steps(from.max(start - near), to.min(start + near)) {
                members[m].values[k] = 0.5 * (low + high);
                let objective = profile(model, members, weighing);
                if objective < best.0 {
                    best = (objective, members[m].values[k]);
                }
            }
            members[m].values[k] = best.1;
            moved_any |= best.1 != start;
        }
    }
    moved_any
}

/// At a step of threshold `k` of member `m` the best of some settings `along` it of the component's first nonlinear
/// parameter, with its objective.
pub(crate) fn best_at_step(
    model: &dyn SeparableModel,
    members: &[Member],
    (m, k): (usize, usize),
    (low, high): (f64, f64),
    along: &[f64],
    weighing: &Weighing,
) -> Option<(f64, Vec<Member>)> {
    let with = |setting: &f64| {
        let mut members = members.to_vec();
        let first = model.components()[members[m].component].linear();
        members[m].values[first] = *setting;
        members[m].values[k] = 0.5 * (low + high);
        (profile(model, &members, weighing), members)
    };
    along.iter().map(with).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The best of fits anew from the most promising steps of a threshold, the component's first nonlinear parameter going
/// along: the fit itself looked near its start alone. `None` if that is no better.
pub(crate) fn thresholds_anew(model: &dyn SeparableModel, found: &Fit) -> Option<Fit> {
    const TRIED: usize = 3;
    let weighing = Weighing::new(model, found.precision_factor.clone());
    let mut starts: Vec<(f64, Vec<Member>)> = Vec::new();
    for (m, member) in found.members.iter().enumerate() {
        let component = &model.components()[member.component];
        for (k, parameter) in component.parameters.iter().enumerate() {
            let Prior::Threshold { from, to, .. } = parameter.prior else {
                continue;
            };
            let along = component.parameters[component.linear()]
                .prior
                .settings(ALONG);
            let steps = model.threshold_steps(from, to).into_iter();
            let best = |step| best_at_step(model, &found.members, (m, k), step, &along, &weighing);
            starts.extend(steps.filter_map(best));
        }
    }
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let fits = starts.into_iter().take(TRIED);
    fits.filter_map(|(_, members)| fit(model, members, &found.precision_factor, 2))
        .filter(|anew| anew.objective < found.objective - SETTLED)
        .min_by(|a, b| a.objective.total_cmp(&b.objective))
}

/// Columns of the derivatives by the nonlinear parameters on their internal scale.
fn derivatives(
    model: &dyn SeparableModel,
    members: &[Member],
    x: &[f64],
    nonlinear: &[(usize, usize)],
    difference: Difference,
) -> Vec<Column> {
    let (components, base) = (model.components(), model.base().columns.len());
    let kind = |m: &Member| components[m.component].kind;
    let transforming = members.iter().any(|m| kind(m) == Kind::TransformsBase);
    let linear = |members: &[Member]| -> usize {
        members
            .iter()
            .map(|m| components[m.component].linear())
            .sum()
    };
    let column = |&(m, k): &(usize, usize)| {
        let prior = components[members[m].component].parameters[k].prior;
        let (from, to) = prior.range().unwrap_or((0.0, 1.0));
        let t = prior.inner(members[m].values[k]);
        // Without a transformation nothing but the component itself changes.
        let alone = !transforming && kind(&members[m]) == Kind::Adds;
        let first = base + linear(&members[..m]);
        let its_own = [&vec![0.0; base], &x[first..first + linear(&members[m..=m])]].concat();
        let at = |t: f64| {
            let mut moved = members.to_vec();
            moved[m].values[k] = prior.outer(t);
            if alone {
                let prediction = model.predict(&moved[m..=m], Fidelity::Full);
                beside_base(model, &prediction, &its_own)
            } else {
                beside_base(model, &model.predict(&moved, Fidelity::Full), x)
            }
        };
        let h = 1e-4 * (to - from);
        let behind = match difference {
            Difference::Forward => 0.0,
            Difference::Central => h,
        };
        let (then, now) = (at(t - behind), at(t + h));
        let change = now.iter().zip(&then).map(|(now, then)| now - then);
        let slope = change.map(|change| change / (h + behind)).collect();
        model.observations().column(slope)
    };
    nonlinear.iter().map(column).collect()
}

/// What the members predict beside the base as it is (the whole, if they transform it), whitened.
fn beside_base(model: &dyn SeparableModel, prediction: &Prediction, x: &[f64]) -> Vec<f64> {
    let (observations, base) = (model.observations(), model.base());
    let mut sum = prediction
        .offset()
        .map_or_else(|| vec![0.0; observations.len()], Column::to_vec);
    let transformed = prediction.transformed(base, observations);
    let of_base = transformed.into_iter().flatten().zip(x);
    let further = prediction
        .linear()
        .map(|(c, _)| c)
        .zip(&x[base.columns.len()..]);
    for (column, x) in of_base.chain(further) {
        column.add_to(&mut sum, *x);
    }
    sum
}

/// The whole prediction at the unknowns `x`, whitened.
pub fn predicted(model: &dyn SeparableModel, prediction: &Prediction, x: &[f64]) -> Vec<f64> {
    let mut sum = beside_base(model, prediction, x);
    if prediction.transformed_rows().is_none() {
        for (column, x) in model.base().columns.iter().zip(x) {
            column.add_to(&mut sum, *x);
        }
    }
    sum
}

/// The unknowns of a solution: those of the base, then the members' values in proportion.
pub fn unknowns_of(
    model: &dyn SeparableModel,
    base_values: &[f64],
    members: &[Member],
) -> Vec<f64> {
    let mut x = base_values.to_vec();
    for member in members {
        let linear = model.components()[member.component].linear();
        x.extend_from_slice(&member.values[..linear]);
    }
    x
}

/// At given members and unknowns of the base: what each unknown does, and the whole prediction.
pub fn tangent(
    model: &dyn SeparableModel,
    members: &[Member],
    base_values: &[f64],
) -> (Vec<Column>, Vec<f64>) {
    let nonlinear = nonlinear(model, members);
    let prediction = model.predict(members, Fidelity::Full);
    let x = unknowns_of(model, base_values, members);
    let derivatives = derivatives(model, members, &x, &nonlinear, Difference::Central);
    let values = predicted(model, &prediction, &x);
    (columns_of(model, &prediction, derivatives), values)
}

/// The Gauss-Newton step of the nonlinear parameters on their internal scale, and the objective that it promises.
fn direction(
    model: &dyn SeparableModel,
    state: &State,
    derivatives: &[Column],
    nonlinear: &[(usize, usize)],
    weighing: &Weighing,
) -> Option<(Vec<f64>, f64)> {
    let precision = precision(model, &state.members, nonlinear, 1.0)?;
    let solved = solve(model, &state.prediction, derivatives, &precision, weighing)?;
    let step = solved.x[solved.x.len() - nonlinear.len()..].to_vec();
    Some((step, solved.objective))
}

fn finish(
    model: &dyn SeparableModel,
    state: State,
    nonlinear: &[(usize, usize)],
    weighing: Weighing,
    log_variance: f64,
) -> Option<Fit> {
    let State {
        mut members,
        prediction,
        solution,
    } = state;
    let derivatives = derivatives(model, &members, &solution.x, nonlinear, Difference::Central);
    // Variance of an even probability over a range: a twelfth of its square.
    let precision = precision(model, &members, nonlinear, 12.0)?;
    let base = model.base().columns.len();
    let mut unknowns = Vec::new();
    for (m, member) in members.iter_mut().enumerate() {
        for k in 0..model.components()[member.component].linear() {
            member.values[k] = solution.x[base + unknowns.len()];
            unknowns.push((m, k));
        }
    }
    unknowns.extend(nonlinear);
    let fitted = predicted(model, &prediction, &solution.x);
    let factor = if nonlinear.is_empty() {
        solution.factor
    } else {
        solve(model, &prediction, &derivatives, &precision, &weighing)?.factor
    };
    let left = residuals(model, &fitted, &vec![1.0; weighing.precision_factor.len()]);
    let left = model.observations().column(left);
    let roots = weighing.precision_factor.iter().map(|factor| factor.sqrt());
    let residuals = model.observations().times(&left, roots).to_vec();
    let slope = |column| {
        model
            .observations()
            .dot(column, &left, &weighing.precision_factor)
    };
    let ended = Ended {
        objective: solution.objective + log_variance,
        unknowns: &unknowns,
        factor: &factor,
        slopes: &derivatives.iter().map(slope).collect::<Vec<_>>(),
        held: &precision[precision.len() - nonlinear.len()..],
    };
    Some(Fit {
        log_evidence: log_evidence(model, &members, &ended, &weighing),
        covariance: factor.inverse(),
        columns: columns_of(model, &prediction, derivatives),
        base_values: solution.x[..base].to_vec(),
        members,
        objective: ended.objective,
        unknowns,
        residuals,
        precision_factor: weighing.precision_factor,
    })
}

/// What each unknown does: the base's, what is in proportion, then the nonlinear parameters by their derivatives.
fn columns_of(
    model: &dyn SeparableModel,
    prediction: &Prediction,
    derivatives: Vec<Column>,
) -> Vec<Column> {
    let base = model.base();
    let transformed = prediction.transformed(base, model.observations());
    let of_base = transformed.unwrap_or(&base.columns).iter();
    let linear = prediction.linear().map(|(column, _)| column);
    of_base.chain(linear).cloned().chain(derivatives).collect()
}

fn residuals(model: &dyn SeparableModel, fitted: &[f64], precision_factor: &[f64]) -> Vec<f64> {
    let observations = model.observations();
    let mut residuals = observations.observed().to_vec();
    residuals.iter_mut().zip(fitted).for_each(|(y, f)| *y -= f);
    let uncertain = residuals[observations.uncertain()].iter_mut();
    for (residual, factor) in uncertain.zip(precision_factor) {
        *residual *= factor.sqrt();
    }
    residuals
}

/// Member and number of each parameter that is refined by Gauss-Newton steps.
pub fn nonlinear(model: &dyn SeparableModel, members: &[Member]) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    for (m, member) in members.iter().enumerate() {
        let component = &model.components()[member.component];
        if component.kind == Kind::AddsVariance {
            continue;
        }
        let parameters = component.parameters.iter().enumerate();
        let nonlinear = parameters.filter(|(_, p)| matches!(p.prior, Prior::Nonlinear { .. }));
        found.extend(nonlinear.map(|(k, _)| (m, k)));
    }
    found
}

/// The members a fraction of a step further, within the parameters' ranges.
fn moved(
    model: &dyn SeparableModel,
    members: &[Member],
    nonlinear: &[(usize, usize)],
    direction: &[f64],
    fraction: f64,
) -> Vec<Member> {
    let mut members = members.to_vec();
    for (&(m, k), step) in nonlinear.iter().zip(direction) {
        let prior = model.components()[members[m].component].parameters[k].prior;
        if let Some((from, to)) = prior.range() {
            let largest = 0.3 * (to - from);
            let t = prior.inner(members[m].values[k]) + fraction * step.clamp(-largest, largest);
            members[m].values[k] = prior.outer(t.clamp(from, to));
        }
    }
    members
}

/// Precision of what is in proportion, then of the nonlinear parameters on their internal scale: `part` over the square of
/// their range.
fn precision(
    model: &dyn SeparableModel,
    members: &[Member],
    nonlinear: &[(usize, usize)],
    part: f64,
) -> Option<Vec<f64>> {
    let mut all = linear_precision(model, members);
    for &(m, k) in nonlinear {
        let prior = model.components()[members[m].component].parameters[k].prior;
        let (from, to) = prior.range()?;
        all.push(part / (to - from).powi(2));
    }
    Some(all)
}
