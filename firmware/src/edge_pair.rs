//! Count and stamp of one and the same edge, from two timers of which one is told by the other.
//!
//! The capture that stamps an edge also sends a pulse, and the second timer counts that pulse some of its ticks later:
//! 2 to 3 for the synchronisation of its trigger (RM0090, 18.3.15). Between the two, a fresh stamp stands beside an old
//! count.

/// Reads both: `stamp`, then `count` twice, of which the second is taken, and the stamp again.
///
/// An edge between the two readings of the stamp changes it, and all is read once more. An edge before the first reading
/// of the stamp is in the count by then: an access to the timers' bus takes at least two of its clocks (AMBA APB: set-up
/// and access), four ticks of a timer that runs at twice that clock, so that the count is of eight ticks later.
#[inline]
pub fn read(mut stamp: impl FnMut() -> u32, mut count: impl FnMut() -> u32) -> (u32, u32) {
    loop {
        let first = stamp();
        count();
        let edges = count();
        if stamp() == first {
            return (edges, first);
        }
    }
}

#[cfg(test)]
mod tests {
    use core::cell::Cell;

    use super::read;

    /// Ticks that an access to the timers takes.
    const ACCESS: u64 = 4;

    /// Two timers and one edge, which the count tells so many ticks late.
    struct Timers {
        now: Cell<u64>,
        edge: u64,
        late: u64,
    }

    impl Timers {
        fn access(&self, passed: impl Fn(u64) -> bool) -> u32 {
            let now = self.now.get() + ACCESS;
            self.now.set(now);
            u32::from(passed(now))
        }

        fn stamp(&self) -> u32 {
            self.access(|now| now >= self.edge)
        }

        fn count(&self) -> u32 {
            self.access(|now| now >= self.edge + self.late)
        }
    }

    fn cases() -> impl Iterator<Item = Timers> {
        (0..40).flat_map(|edge| {
            // Twice what the manual says.
            (0..=6).map(move |late| Timers {
                now: Cell::new(0),
                edge,
                late,
            })
        })
    }

    #[test]
    fn count_and_stamp_are_of_one_edge_whenever_it_comes() {
        for timers in cases() {
            let (count, stamp) = read(|| timers.stamp(), || timers.count());
            assert_eq!(count, stamp, "{} + {}", timers.edge, timers.late);
        }
    }

    #[test]
    fn a_stamp_between_two_equal_counts_may_be_of_a_later_edge() {
        let torn = cases().any(|timers| {
            loop {
                let count = timers.count();
                let stamp = timers.stamp();
                if timers.count() == count {
                    break count != stamp;
                }
            }
        });
        assert!(torn);
    }
}
