//! What a hypothesis predicts, in parts: what a changed motion makes of the nominal model, and what effects add.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use shared::model::NOMINAL;

use super::catalogue::{Action, Add, Seen};
use super::fit::Member;
use super::motion::Motion;
use super::problem::{Block, Column, Problem, Situation};

/// The prediction's parts at given parameters.
pub(super) struct Parts {
    /// `None` if the motion is as commanded.
    moved: Option<Rc<Moved>>,
    /// Columns of the parameters in proportion, effect by effect.
    linear: Vec<Rc<Columns>>,
    /// What is added without a parameter in proportion.
    pub(super) offset: Option<Column>,
    /// Variance added without one, g^2.
    variance: Vec<f64>,
}

/// What a changed motion makes of the nominal model.
#[derive(Debug)]
struct Moved {
    motions: Vec<Motion>,
    nominal: Vec<Column>,
    /// What the reference sees of it.
    seen: Option<Column>,
}

/// What an effect adds for a unit of each parameter in proportion (or at all, without one): the column, and the variance
/// of each run's `during`, g^2.
pub(super) type Columns = Vec<(Column, Vec<f64>)>;

/// Effects with those of their parameters that matter.
type Key = Vec<(&'static str, Vec<f64>)>;

/// What was made last: a fit moves few parameters at a time.
#[derive(Debug, Default)]
pub(super) struct Made {
    /// By the effects that change the motion.
    moved: RefCell<VecDeque<(Key, Rc<Moved>)>>,
    /// By the effect with its parameters that are not in proportion, and those that change the motion.
    columns: RefCell<VecDeque<(Key, Rc<Columns>)>>,
}

impl Made {
    const KEPT: usize = 32;

    /// Forgets all: they depend on something that has changed.
    pub(super) fn clear(&self) {
        self.moved.borrow_mut().clear();
        self.columns.borrow_mut().clear();
    }

    fn get<T>(kept: &RefCell<VecDeque<(Key, Rc<T>)>>, key: Key, make: impl FnOnce() -> T) -> Rc<T> {
        let mut kept = kept.borrow_mut();
        let known = kept.iter().position(|known| known.0 == key);
        let latest = known.and_then(|place| kept.remove(place));
        let latest = latest.unwrap_or_else(|| (key, Rc::new(make())));
        let value = Rc::clone(&latest.1);
        kept.truncate(Self::KEPT - 1);
        kept.push_front(latest);
        value
    }
}

impl Parts {
    /// Motions of the instrument; `None` if as commanded.
    pub(super) fn motions(&self) -> Option<&[Motion]> {
        self.moved.as_ref().map(|moved| &moved.motions[..])
    }

    /// The nominal model's columns at a changed motion.
    pub(super) fn nominal(&self) -> Option<&[Column]> {
        self.moved.as_ref().map(|moved| &moved.nominal[..])
    }

    /// Columns of the parameters in proportion, and the variance that a unit of each adds.
    pub(super) fn linear(&self) -> impl Iterator<Item = &(Column, Vec<f64>)> {
        self.linear.iter().flat_map(|columns| columns.iter())
    }

    /// The variance that effects add to each run's `during`, g^2, with the unknowns `x`.
    pub(super) fn added_variance(&self, x: &[f64]) -> Vec<f64> {
        let mut added = self.variance.clone();
        for ((_, unit), x) in self.linear().zip(&x[NOMINAL..]) {
            for (sum, unit) in added.iter_mut().zip(unit) {
                *sum += x * x * unit;
            }
        }
        added
    }
}

impl Problem<'_> {
    /// What `members` predict at the values that they have.
    pub(super) fn parts(&self, members: &[Member]) -> Parts {
        let s = &self.situation;
        let moving = |m: &&Member| matches!(m.effect.action, Action::Moves(..));
        let movers = members.iter().filter(moving);
        let by: Key = movers.map(|m| (m.effect.id, m.values.clone())).collect();
        let moved = (!by.is_empty()).then(|| {
            Made::get(&self.made.moved, by.clone(), || {
                let (motions, seen) = self.moved_motions(members);
                let nominal = self.redesign(&motions);
                Moved {
                    motions,
                    nominal,
                    seen,
                }
            })
        });
        let mut parts = Parts {
            linear: Vec::new(),
            offset: moved.as_ref().and_then(|moved| moved.seen.clone()),
            variance: vec![0.0; self.run_count()],
            moved,
        };
        for Member { effect, values } in members {
            match effect.action {
                Action::Adds(add) => {
                    let make = || -> Columns {
                        // What adds to the output sees the motion as it is.
                        let moved = parts.motions().map(|motions| Situation {
                            motions: motions.to_vec(),
                            ..s.clone()
                        });
                        let felt = moved.as_ref().unwrap_or(s);
                        self.columns(add, effect.linear(), values, felt)
                    };
                    let curved = values[effect.linear()..].to_vec();
                    let key = [&[(effect.id, curved)], &by[..]].concat();
                    let columns = Made::get(&self.made.columns, key, make);
                    if effect.linear() > 0 {
                        parts.linear.push(columns);
                        continue;
                    }
                    for (column, variance) in &*columns {
                        match &mut parts.offset {
                            Some(offset) => offset.add(column),
                            none => *none = Some(column.clone()),
                        }
                        for (sum, added) in parts.variance.iter_mut().zip(variance) {
                            *sum += added;
                        }
                    }
                }
                Action::Moves(..) => {}
                Action::Scatters(scatter) => {
                    for (run, variance) in s.runs.iter().zip(&mut parts.variance) {
                        *variance += values[0] * values[0] * scatter(run, s);
                    }
                }
            }
        }
        parts
    }

    /// What an effect of so many parameters in proportion adds, whitened.
    pub(super) fn columns(
        &self,
        add: Add,
        linear: usize,
        values: &[f64],
        felt: &Situation<'_>,
    ) -> Columns {
        let mut changes = vec![self.no_change(); linear.max(1)];
        add(values, felt, &mut changes);
        let whitened = changes.into_iter().map(|change| self.whiten(change));
        whitened.collect()
    }

    /// Motions of the instrument under some effects, and what the reference sees of them, whitened.
    pub(super) fn moved_motions(&self, members: &[Member]) -> (Vec<Motion>, Option<Column>) {
        let s = &self.situation;
        let (mut felt, mut seen) = (s.motions.clone(), s.motions.clone());
        let mut sees = false;
        for Member { effect, values } in members {
            if let Action::Moves(move_, by) = effect.action {
                move_(values, s, &mut felt);
                if by == Seen::ByReference {
                    sees = true;
                    move_(values, s, &mut seen);
                }
            }
        }
        let swapped = self.seen_beside_instrument.min(s.runs.len());
        seen[swapped..].copy_from_slice(&felt[swapped..]);
        let sees = sees || swapped < s.runs.len();
        let column = sees.then(|| self.seen_by_reference(&seen));
        (felt, column)
    }

    /// What the reference shows of motions that are not as commanded, whitened.
    fn seen_by_reference(&self, motions: &[Motion]) -> Column {
        let mut change = self.no_change();
        for (row, (run, motion)) in self.situation.runs.iter().zip(motions).enumerate() {
            let h = motion.second_harmonic;
            // The harmonic adds its own power, h^2.
            let rms = (1.0 + h * h).sqrt();
            for axis in 0..3 {
                let ratio = motion.amplitude_g[axis] / run.level_g * rms;
                change.add(
                    Block::Reference,
                    3 * row + axis,
                    ratio - run.direction[axis],
                );
            }
            // M[(sin x - h cos 2x)^3] = 3h/4, M[..^4] = 3/8 (1 + 4 h^2 + h^4), over the rms value's powers.
            let (h2, power) = (h * h, 0.5 * (1.0 + h * h));
            change.add(Block::Shape, 2 * row, 0.75 * h / power.powf(1.5));
            change.add(
                Block::Shape,
                2 * row + 1,
                0.375 * (1.0 + 4.0 * h2 + h2 * h2) / (power * power) - 1.5,
            );
        }
        self.whiten(change).0
    }
}
