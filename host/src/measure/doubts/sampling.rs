//! How the record was sampled: aliases, a chain that passes no constant acceleration, times.

use super::super::answer::{Doubt, Kind};
use super::super::motion::Motion;
use super::super::segment::Segment;
use super::super::shift::interval;
use super::View;
use super::rows::place;

impl View<'_> {
    /// A vibration at n times the rate plus or minus a little is seen as that little.
    pub(super) fn aliasing(&self, motion: Option<&Motion>) -> Doubt {
        let kind = Kind::Aliasing;
        let (Some(motion), Some(during)) = (motion, self.scene.during.first()) else {
            return Doubt::unseen(kind, "no samples to look at for lines");
        };
        let (cycles, share) = motion.line;
        let periods = cycles * during.count() as f64;
        let at = match self.timed {
            true => format!("{:.4} Hz", cycles / interval(during)),
            false => format!("{cycles:.2e} cycles a sample"),
        };
        if share > 0.1 && periods < 8.0 {
            let text = format!(
                "{periods:.1} periods of a line at {at} in the window: slow, or near a multiple of the sample rate; its mean is not zero"
            );
            return Doubt::found(kind, text);
        }
        let text = "what vibrates near a multiple of the sample rate is not seen unless a filter keeps it out";
        Doubt::clear(kind, format!("strongest line at {at}; {text}"))
    }

    /// A chain that passes no constant acceleration has means that are more alike than their length allows.
    pub(super) fn ac_coupling(&self) -> Doubt {
        let kind = Kind::AcCoupling;
        let Some(channel) = self.channels(&self.scene.before).next() else {
            return Doubt::unseen(kind, "no rest before");
        };
        match channel.batches.whiteness() {
            None => Doubt::unseen(kind, "the rest before is too short"),
            Some((ratio, significant)) => {
                let text =
                    format!("slow noise has {ratio:.2} times the density of faster noise at rest");
                match significant && ratio < 0.25 {
                    true => Doubt::found(kind, format!("a mean that is too quiet: {text}")),
                    false => Doubt::clear(kind, text),
                }
            }
        }
    }

    pub(super) fn time_stamps(&self) -> Doubt {
        let kind = Kind::TimeStamps;
        if !self.timed {
            return Doubt::unseen(kind, "no time is given (--time)");
        }
        let all: Vec<&Segment> = [self.scene.before.as_slice(), &self.scene.during].concat();
        if let Some(segment) = all.iter().find(|s| s.backward.0 > 0) {
            let (count, row) = segment.backward;
            let text = format!("time runs back {count} times, first in {}", place(row));
            return Doubt::found(kind, text);
        }
        let gaps: u64 = all.iter().map(|s| s.gaps).sum();
        let missing = all.iter().map(|s| {
            let longest = s.interval_s.max - s.interval_s.mean;
            longest / (s.interval_s.mean * s.interval_s.count.max(1) as f64)
        });
        let missing = missing.fold(0.0, f64::max);
        let jitter = all
            .iter()
            .map(|s| s.interval_s.standard_deviation() / s.interval_s.mean);
        let jitter = jitter.fold(0.0, f64::max);
        let text = format!(
            "{gaps} gaps, jitter {:.2} % of the interval",
            100.0 * jitter
        );
        // A tenth of the window in one gap: chosen, the mean is then of another window.
        match (missing > 0.1, gaps > 0) {
            (true, _) => Doubt::found(
                kind,
                format!("{text}; one gap of {:.0} % of the window", 100.0 * missing),
            ),
            (false, true) => Doubt::found(kind, text).harmless(),
            (false, false) => Doubt::clear(kind, text),
        }
    }
}
