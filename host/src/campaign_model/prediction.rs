//! What a hypothesis predicts: what a changed motion makes of the nominal model, and what effects add.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use inference::fit::{predicted, unknowns_of};
use inference::model::{Columns, Fidelity, Member, Prediction, SeparableModel, Transformed};
use inference::observations::Column;
use shared::model::{NOMINAL, terms};

use super::CampaignModel;
use crate::effects::{Action, Seen};
use crate::forward::conditions::Conditions;
use crate::forward::contribution::Observable;
use crate::forward::motion::Motion;
use crate::forward::nominal;

/// Motions of the runs under some effects.
#[derive(Debug)]
pub(super) struct ChangedMotion {
    pub(super) motions: Vec<Motion>,
    nominal: Arc<Transformed>,
    /// What the reference sees of it.
    seen: Option<Column>,
}

/// Effects, by their number, with those of their parameters that matter.
type Key = Vec<(usize, Vec<f64>)>;

/// What was made last: a fit moves few parameters at a time.
#[derive(Debug)]
pub(super) struct Kept {
    /// How many at the most.
    most: usize,
    /// By the effects that change the motion.
    motions: Mutex<VecDeque<(Key, Arc<ChangedMotion>)>>,
    /// By the effect with its parameters that are not in proportion, and those that change the motion.
    columns: Mutex<VecDeque<(Key, Arc<Columns>)>>,
}

impl Kept {
    /// As many as a fit comes back to, fewer of many runs: memory grows with each run.
    pub(super) fn of_runs(runs: usize) -> Self {
        const MOST: usize = 32;
        const LEAST: usize = 4;
        const KEPT_RUNS: usize = 40_000;
        Self {
            most: (KEPT_RUNS / runs.max(1)).clamp(LEAST, MOST),
            motions: Mutex::default(),
            columns: Mutex::default(),
        }
    }

    /// Forgets all: they depend on something that has changed.
    pub(super) fn clear(&self) {
        lock(&self.motions).clear();
        lock(&self.columns).clear();
    }

    fn get<T>(
        &self,
        kept: &Mutex<VecDeque<(Key, Arc<T>)>>,
        key: Key,
        make: impl FnOnce() -> T,
    ) -> Arc<T> {
        let known = {
            let mut kept = lock(kept);
            let known = kept.iter().position(|known| known.0 == key);
            known.and_then(|place| kept.remove(place))
        };
        // Others go on meanwhile.
        let latest = known.unwrap_or_else(|| (key, Arc::new(make())));
        let value = Arc::clone(&latest.1);
        let mut kept = lock(kept);
        kept.truncate(self.most - 1);
        kept.push_front(latest);
        value
    }
}

/// What is kept is whole at any time.
fn lock<T>(kept: &Mutex<T>) -> MutexGuard<'_, T> {
    kept.lock().unwrap_or_else(PoisonError::into_inner)
}

impl CampaignModel {
    /// A prediction made anew, for a first look.
    pub(super) fn predict_anew(&self, members: &[Member]) -> Prediction {
        let changed = self
            .transforms(members)
            .then(|| Arc::new(self.change_motion(members)));
        let columns = |member: &Member, felt: &Conditions| {
            Arc::new(self.columns(member, felt, Fidelity::Screening))
        };
        self.assemble(members, changed, columns)
    }

    /// A prediction from what was made last, as far as it serves.
    pub(super) fn predict_kept(&self, members: &[Member]) -> Prediction {
        let changed = self.transformed(members);
        let by = self.transforming_key(members);
        let columns = |member: &Member, felt: &Conditions| {
            let nonlinear = member.values[self.effect(member).linear()..].to_vec();
            let key = [&[(member.component, nonlinear)], &by[..]].concat();
            let make = || self.columns(member, felt, Fidelity::Full);
            self.kept.get(&self.kept.columns, key, make)
        };
        self.assemble(members, changed, columns)
    }

    fn assemble(
        &self,
        members: &[Member],
        changed: Option<Arc<ChangedMotion>>,
        columns: impl Fn(&Member, &Conditions) -> Arc<Columns>,
    ) -> Prediction {
        let conditions = &self.conditions;
        let mut prediction = Prediction::of_base(conditions.runs.len());
        // What adds to the output sees the motion as it is.
        let moved = changed.as_ref().map(|changed| Conditions {
            motions: changed.motions.clone(),
            ..conditions.clone()
        });
        if let Some(changed) = changed {
            prediction.transform(Arc::clone(&changed.nominal));
            if let Some(seen) = &changed.seen {
                prediction.add_offset(seen);
            }
        }
        let felt = moved.as_ref().unwrap_or(conditions);
        for member in members {
            let effect = self.effect(member);
            match effect.action {
                Action::Adds(_) => {
                    let columns = columns(member, felt);
                    if effect.linear() > 0 {
                        prediction.add_linear(columns);
                        continue;
                    }
                    for (column, variance) in &*columns {
                        prediction.add_offset(column);
                        prediction.add_variance(variance.iter().copied());
                    }
                }
                Action::TransformsMotion(..) => {}
                Action::AddsVariance(variance) => {
                    let size = member.values[0];
                    let runs = conditions.runs.iter();
                    prediction
                        .add_variance(runs.map(|run| size * size * variance(run, conditions)));
                }
            }
        }
        prediction
    }

    /// What an effect adds, whitened.
    fn columns(&self, member: &Member, felt: &Conditions, fidelity: Fidelity) -> Columns {
        let effect = self.effect(member);
        let Action::Adds(add) = effect.action else {
            return Vec::new();
        };
        let mut added = vec![self.layout.nothing(); effect.linear().max(1)];
        add(&member.values, felt, &self.witnesses, fidelity, &mut added);
        let whitened = added
            .into_iter()
            .map(|added| (self.observations.whiten(added.column), added.variance_g2));
        whitened.collect()
    }

    fn transforms(&self, members: &[Member]) -> bool {
        let transforms = |m: &Member| matches!(self.effect(m).action, Action::TransformsMotion(..));
        members.iter().any(transforms)
    }

    fn transforming_key(&self, members: &[Member]) -> Key {
        let transforms =
            |m: &&Member| matches!(self.effect(m).action, Action::TransformsMotion(..));
        let transforming = members.iter().filter(transforms);
        transforming
            .map(|m| (m.component, m.values.clone()))
            .collect()
    }

    /// What members make of the motion; `None` if it is as commanded.
    pub(super) fn transformed(&self, members: &[Member]) -> Option<Arc<ChangedMotion>> {
        let by = self.transforming_key(members);
        (!by.is_empty()).then(|| {
            self.kept
                .get(&self.kept.motions, by, || self.change_motion(members))
        })
    }

    fn change_motion(&self, members: &[Member]) -> ChangedMotion {
        let (motions, seen) = self.changed_motions(members);
        let nominal = Arc::new(self.transformed_base(&motions));
        ChangedMotion {
            motions,
            nominal,
            seen,
        }
    }

    /// The nominal model's rows that depend on motion.
    fn transformed_base(&self, motions: &[Motion]) -> Transformed {
        let runs = &self.conditions.runs;
        let rest: Vec<_> = runs.iter().map(|run| terms(run.specific_force_g)).collect();
        let moving = nominal::moving(runs, motions);
        let unknowns = self.base.columns.len();
        let mut values = Vec::with_capacity(3 * runs.len() * unknowns);
        let kinds = [Observable::During, Observable::Maximum, Observable::Minimum];
        for (part, kind) in kinds.into_iter().enumerate() {
            for ((row, moving), rest) in self.layout.rows(kind).zip(&moving).zip(&rest) {
                let weight = self.observations.weight(row);
                values.extend((0..NOMINAL).map(|k| match kind {
                    Observable::During => (rest[k] + moving[part][k]) * weight,
                    _ => moving[part][k] * weight,
                }));
                // Sessions and the table's level act as at the commanded motion.
                values.extend(self.base.columns[NOMINAL..].iter().map(|c| c.at(row)));
            }
        }
        Transformed::new(values, unknowns)
    }

    /// Motions of the instrument under some effects, and what the reference sees of them, whitened.
    fn changed_motions(&self, members: &[Member]) -> (Vec<Motion>, Option<Column>) {
        let s = &self.conditions;
        let (mut instrument_motion, mut reference_motion) = (s.motions.clone(), s.motions.clone());
        let mut sees = false;
        for member in members {
            if let Action::TransformsMotion(transform, by) = self.effect(member).action {
                transform(&member.values, s, &self.witnesses, &mut instrument_motion);
                if by == Seen::ByReference {
                    sees = true;
                    transform(&member.values, s, &self.witnesses, &mut reference_motion);
                }
            }
        }
        let swapped = self.seen_beside_instrument.min(s.runs.len());
        reference_motion[swapped..].copy_from_slice(&instrument_motion[swapped..]);
        let sees = sees || swapped < s.runs.len();
        let column = sees.then(|| self.seen_by_reference(&reference_motion));
        (instrument_motion, column)
    }

    /// What the reference shows of motions that are not as commanded, whitened.
    fn seen_by_reference(&self, motions: &[Motion]) -> Column {
        let mut seen = self.layout.nothing();
        for (row, (run, motion)) in self.conditions.runs.iter().zip(motions).enumerate() {
            let h = motion.second_harmonic;
            // The harmonic adds its own power, h^2.
            let rms = (1.0 + h * h).sqrt();
            let level_g = run.level_g * (1.0 + self.witnesses.level_excess[row].0);
            for axis in 0..3 {
                let ratio = motion.amplitude_g[axis] / level_g * rms;
                seen.add(
                    Observable::Reference,
                    3 * row + axis,
                    ratio - run.direction[axis],
                );
            }
            // M[(sin x - h cos 2x)^3] = 3h/4, M[..^4] = 3/8 (1 + 4 h^2 + h^4), over the rms value's powers.
            let (h2, power) = (h * h, 0.5 * (1.0 + h * h));
            seen.add(Observable::Shape, 2 * row, 0.75 * h / power.powf(1.5));
            let kurtosis = 0.375 * (1.0 + 4.0 * h2 + h2 * h2) / (power * power) - 1.5;
            seen.add(Observable::Shape, 2 * row + 1, kurtosis);
        }
        self.observations.whiten(seen.column)
    }

    /// The whitened prediction of effects at given parameters and unknowns of the base (nuisances that are not given are zero),
    /// and the variance (g^2) that they
    /// add to each run's `during`.
    pub fn prediction(&self, members: &[Member], base_values: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let prediction = self.predict(members, Fidelity::Full);
        let mut base_values = base_values.to_vec();
        base_values.resize(self.base.columns.len(), 0.0);
        let x = unknowns_of(self, &base_values, members);
        let mut variance = prediction.added_variance(&x[base_values.len()..]);
        if let Some(changed) = self.transformed(members) {
            let coefficients = nominal::coefficients(&x);
            let runs = self.conditions.runs.iter().zip(&changed.motions);
            for (variance, (run, motion)) in variance.iter_mut().zip(runs) {
                *variance += nominal::spectral_variance_g2(run, motion, &coefficients);
            }
        }
        (predicted(self, &prediction, &x), variance)
    }
}
