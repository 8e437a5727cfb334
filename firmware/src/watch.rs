//! Who feeds the watchdog: every task, or nobody.
//!
//! A task that works counts its [steps](Task::step); one that may wait for ever for something to do says so with
//! [`Task::rest`]. The watchdog is fed only when each task has made a step since it was fed last, or rests.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// A task as the watchdog sees it.
#[derive(Debug, Default)]
pub struct Task {
    steps: AtomicU32,
    rests: AtomicBool,
}

impl Task {
    /// At work, before its first step.
    pub const fn new() -> Self {
        Self {
            steps: AtomicU32::new(0),
            rests: AtomicBool::new(false),
        }
    }

    /// One more step is made; it is at work from here on.
    #[inline]
    pub fn step(&self) {
        // Only the task itself writes it.
        let steps = self.steps.load(Ordering::Relaxed).wrapping_add(1);
        self.steps.store(steps, Ordering::Relaxed);
        self.rests.store(false, Ordering::Release);
    }

    /// It waits for something to do, for as long as it takes.
    pub fn rest(&self) {
        self.rests.store(true, Ordering::Release);
    }
}

/// Looks after `N` tasks.
#[derive(Debug)]
pub struct Supervisor<'t, const N: usize> {
    tasks: [&'t Task; N],
    /// Steps of each when the watchdog was fed last.
    seen: [u32; N],
}

impl<'t, const N: usize> Supervisor<'t, N> {
    /// Of tasks that have just been started.
    pub fn new(tasks: [&'t Task; N]) -> Self {
        let seen = tasks.map(|task| task.steps.load(Ordering::Relaxed));
        Self { tasks, seen }
    }

    /// True when the watchdog is to be fed.
    pub fn all_alive(&mut self) -> bool {
        let steps = self.tasks.map(|task| task.steps.load(Ordering::Relaxed));
        let mut pairs = self.tasks.iter().zip(steps.iter().zip(&self.seen));
        let alive =
            pairs.all(|(task, (now, seen))| now != seen || task.rests.load(Ordering::Acquire));
        if alive {
            self.seen = steps;
        }
        alive
    }

    /// The first that made no step, as its place in the list.
    pub fn first_dead(&self) -> Option<usize> {
        let mut tasks = self.tasks.iter().zip(&self.seen);
        tasks.position(|(task, seen)| {
            task.steps.load(Ordering::Relaxed) == *seen && !task.rests.load(Ordering::Acquire)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_watchdog_is_fed_only_when_each_task_made_a_step_or_rests() {
        let tasks = [const { Task::new() }; 3];
        let mut supervisor = Supervisor::new([&tasks[0], &tasks[1], &tasks[2]]);
        assert!(!supervisor.all_alive());
        tasks.iter().for_each(Task::step);
        assert!(supervisor.all_alive());
        // Two of three are not enough, however often they step.
        for _ in 0..3 {
            tasks[0].step();
            tasks[2].step();
            assert!(!supervisor.all_alive());
            assert_eq!(supervisor.first_dead(), Some(1));
        }
        tasks[1].rest();
        assert!(supervisor.all_alive());
        assert_eq!(supervisor.first_dead(), Some(0));
        tasks[0].step();
        tasks[2].step();
        assert!(supervisor.all_alive());
        // Who rests no longer has to step again.
        tasks[1].step();
        tasks[0].step();
        tasks[2].step();
        assert!(supervisor.all_alive());
        tasks[0].step();
        tasks[2].step();
        assert!(!supervisor.all_alive());
    }
}
