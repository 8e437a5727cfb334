//! Drift and slow noise between the means.

use super::super::answer::{Doubt, Kind, Verdict};
use super::super::segment::Segment;
use super::super::shift::{Found, middle};
use super::View;

impl View<'_> {
    /// Slow noise is in the interval; here what the rest before predicts if its trend goes on.
    pub(super) fn drift(&self) -> Doubt {
        let kind = Kind::Drift;
        let Found {
            observed,
            distance,
            longest,
            ..
        } = *self.found;
        if self.scene.separate {
            let alone = self.scene.before.len() == 1 && self.scene.during.len() == 1;
            let why = "the time between files is not known; their scatter counts";
            return match alone {
                true => Doubt::found(
                    kind,
                    "one file on either side: what happens between files cannot be seen".into(),
                ),
                false => Doubt::unseen(kind, why),
            };
        }
        let unit = if self.timed { "s" } else { "rows" };
        if !observed {
            let text = format!(
                "the means are {distance:.4} {unit} apart, and no stretch shows the noise over more than {longest:.4} {unit}"
            );
            return Doubt::found(kind, text);
        }
        if self.found.axis.verdict == Verdict::NoShift && self.found.beyond_own_noise {
            let text = "the means differ by more than the noise within the windows, but not by more than the slow noise that the \
                        record shows makes it";
            return Doubt::found(kind, text.into());
        }
        if let Some((after, sigma)) = self.found.axis.after_less_before_g.and_then(|q| q.known()) {
            let text = format!(
                "the rest after the vibration is {:+.3} mg from that before (standard uncertainty {:.3} mg)",
                1e3 * after,
                1e3 * sigma
            );
            let size = self.unsteady().unwrap_or(after);
            return match after.abs() > 3.0 * sigma {
                true => Doubt::found(kind, text).sized(size, self.shift),
                false => Doubt::clear(kind, text),
            };
        }
        let rest = self
            .scene
            .before
            .first()
            .and_then(|s| Some((s, s.channels.get(self.index)?)));
        let Some((rate, sigma)) = rest.and_then(|(segment, channel)| {
            let [from, to] = segment.extent?;
            let (change, sigma) = channel.batches.trend()?;
            Some((change / (to - from), sigma / (to - from)))
        }) else {
            return Doubt::unseen(kind, "the rest before is too short for a trend");
        };
        let size = rate * distance;
        let text = format!(
            "the trend of the rest before makes {:+.3} mg over {distance:.4} {unit} (standard uncertainty {:.3} mg); slow noise is in the interval",
            1e3 * size,
            1e3 * sigma * distance
        );
        match rate.abs() > 4.0 * sigma {
            true => Doubt::found(kind, text).sized(size, self.shift),
            false => Doubt::clear(kind, text),
        }
    }

    /// What a drift that is not steady leaves of the shift against both rests, if the rates of the rests tell: the error of
    /// linear interpolation, half the second derivative times the distances to either rest. `None` without a rest on either
    /// side.
    fn unsteady(&self) -> Option<f64> {
        let (before, during) = (self.scene.before.first()?, self.scene.during.first()?);
        let after = self.scene.after.filter(|_| self.scene.bracketed)?;
        let rate = |segment: &Segment| {
            let (change, sigma) = segment.channels.get(self.index)?.batches.trend()?;
            let [from, to] = segment.extent?;
            Some((change / (to - from), sigma / (to - from)))
        };
        let [at_before, at_during, at_after] = [before, during, &after].map(|s| middle(s));
        let reach = 0.5 * (at_during - at_before) * (at_after - at_during) / (at_after - at_before);
        match (rate(before), rate(after)) {
            (Some((r0, s0)), Some((r1, s1))) if (r1 - r0).abs() > 3.0 * s0.hypot(s1) => {
                Some((r1 - r0) * reach)
            }
            // The rates agree within what they tell, which the interval holds.
            (Some(_), Some(_)) => Some(0.0),
            _ => Some(0.5 * self.found.axis.after_less_before_g?.value?),
        }
    }
}
