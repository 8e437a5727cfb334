//! The stops of a walk: the positions of the plan, what has become of each, and which is next.

use serde::Serialize;

use crate::bench::plan::Dwell;

/// What has become of a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopState {
    /// It is still to be measured.
    Waiting,
    /// It was left out; it can be chosen all the same.
    Skipped,
    /// It was measured, by the reading of that number.
    Taken(u32),
}

/// The positions of a plan, each with what has become of it, and the one that is measured now.
#[derive(Clone, Debug)]
pub struct Stops {
    all: Vec<(Dwell, StopState)>,
    at: Option<usize>,
}

impl Stops {
    /// All positions of a plan, none of them measured.
    pub fn new(plan: &[Dwell]) -> Self {
        let all: Vec<_> = plan
            .iter()
            .map(|dwell| (*dwell, StopState::Waiting))
            .collect();
        let at = (!all.is_empty()).then_some(0);
        Self { all, at }
    }

    /// A reading of an earlier capture was taken there. The next stop is the first that waits.
    pub fn was_taken(&mut self, dwell: &Dwell, reading: u32) {
        let waiting = (*dwell, StopState::Waiting);
        if let Some(stop) = self.all.iter_mut().find(|stop| **stop == waiting) {
            stop.1 = StopState::Taken(reading);
        }
        self.at = self.first_waiting(0);
    }

    /// All of them, in the plan's order.
    pub fn all(&self) -> &[(Dwell, StopState)] {
        &self.all
    }

    /// Index of the stop that is measured now; none when all are done.
    pub fn at(&self) -> Option<usize> {
        self.at
    }

    /// The position that is measured now.
    pub fn dwell(&self) -> Option<&Dwell> {
        self.at.map(|at| &self.all[at].0)
    }

    /// How many are without a reading.
    pub fn missing(&self) -> usize {
        let taken = |stop: &&(Dwell, StopState)| matches!(stop.1, StopState::Taken(_));
        self.all.len() - self.all.iter().filter(taken).count()
    }

    /// Those that wait, by index.
    pub fn indices_waiting(&self) -> impl Iterator<Item = usize> {
        let stops = self.all.iter().enumerate();
        stops
            .filter(|(_, stop)| stop.1 == StopState::Waiting)
            .map(|(index, _)| index)
    }

    /// The stop that is measured now is done, and the next that waits follows, from the beginning again after the last.
    pub fn done(&mut self, standing: StopState) {
        if let Some(at) = self.at {
            self.all[at].1 = standing;
            self.at = self.first_waiting(at);
        }
    }

    /// The first stop that waits at this position.
    pub fn waits_at(&self, dwell: &Dwell) -> Option<usize> {
        self.all
            .iter()
            .position(|stop| *stop == (*dwell, StopState::Waiting))
    }

    /// Goes to a stop that waits or was left out; false for one that was taken, or none.
    pub fn choose(&mut self, index: usize) -> bool {
        match self.all.get_mut(index) {
            Some((_, standing)) if !matches!(standing, StopState::Taken(_)) => {
                *standing = StopState::Waiting;
                self.at = Some(index);
                true
            }
            _ => false,
        }
    }

    /// Goes back to the stop of a reading; false if no stop is of it.
    pub fn redo(&mut self, reading: u32) -> bool {
        let taken = StopState::Taken(reading);
        match self.all.iter().position(|stop| stop.1 == taken) {
            Some(index) => {
                self.all[index].1 = StopState::Waiting;
                self.at = Some(index);
                true
            }
            None => false,
        }
    }

    /// Goes to the next stop that waits in another mounting: another series, or the instrument turned on the shaft. False if
    /// there is none.
    pub fn swap_series(&mut self) -> bool {
        let Some(here) = self.dwell().copied() else {
            return false;
        };
        let at = self.at.unwrap_or(0);
        let other = self.cyclic(at).find(|&index| {
            let (dwell, standing) = &self.all[index];
            *standing == StopState::Waiting
                && (dwell.series, dwell.mount_deg) != (here.series, here.mount_deg)
        });
        self.at = other.or(self.at);
        other.is_some()
    }

    fn first_waiting(&self, after: usize) -> Option<usize> {
        let mut from = self.cyclic(after);
        from.find(|&index| self.all[index].1 == StopState::Waiting)
    }

    /// All indices, from this one around.
    fn cyclic(&self, from: usize) -> impl Iterator<Item = usize> + use<> {
        let count = self.all.len();
        (0..count).map(move |step| (from + step) % count)
    }
}
