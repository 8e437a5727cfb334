//! What else than the vibration could have shifted the mean, each looked for without being asked.

use std::f64::consts::{PI, TAU};

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

use super::Calibration;
use super::answer::{Axis, Doubt, Kind, Outcome, Verdict};
use super::motion::Motion;
use super::noise::State;
use super::segment::{Channel, Role, Segment, Spread};
use super::shift::{Found, Scene, interval, middle};
use super::survey::LOUDER;

/// Share of the shift from which on a rival of known size forbids to attribute it.
const SHARE: f64 = 1.0 / 3.0;

/// Difference of temperature from which on it is a rival, C.
const TEMPERATURE_C: f64 = 0.1;

/// Lengths of gravity that three axes can show, g; outside, the unit, the scale or the coupling is another. Chosen: no
/// scale factor is off by half, and 9.8 or 1000 are far outside.
const GRAVITY_G: [f64; 2] = [0.5, 1.5];

/// Length of gravity on two axes from which on the third axis is across it. Chosen.
const SEEN_G: f64 = 0.95;

impl Doubt {
    fn new(kind: Kind, outcome: Outcome, finding: String) -> Self {
        let decisive = outcome == Outcome::Found;
        Self {
            kind,
            size_g: None,
            decisive,
            finding,
            outcome,
        }
    }

    fn found(kind: Kind, finding: String) -> Self {
        Self::new(kind, Outcome::Found, finding)
    }

    fn clear(kind: Kind, finding: impl Into<String>) -> Self {
        Self::new(kind, Outcome::Clear, finding.into())
    }

    fn unseen(kind: Kind, why: impl Into<String>) -> Self {
        Self::new(kind, Outcome::NotLookedFor, why.into())
    }

    /// Of a size that is known: decisive if it is a third of the shift.
    fn sized(self, size_g: f64, shift_g: f64) -> Self {
        Self {
            size_g: Some(size_g),
            decisive: size_g.abs() >= SHARE * shift_g.abs(),
            ..self
        }
    }

    fn harmless(self) -> Self {
        Self {
            decisive: false,
            ..self
        }
    }
}

/// Looks for everything that could have shifted the mean of each axis, and takes back the verdict where something did.
/// `line` tells a row's line in the file.
pub(super) fn judge(
    found: Vec<Found>,
    scene: &Scene<'_>,
    calibration: &Calibration,
    timed: bool,
) -> Vec<Axis> {
    let gravity = Gravity::of(scene, found.len());
    let judged = found.into_iter().enumerate();
    judged
        .map(|(index, found)| {
            let view = View {
                scene,
                index,
                calibration,
                timed,
                found: &found,
                shift: found.axis.shift_g.value.unwrap_or(0.0),
            };
            let motion = view.motion();
            let doubts = view.doubts(gravity.as_ref(), motion.as_ref());
            let clipped_share = clipped(scene, index).iter().sum::<f64>().min(1.0);
            let mut axis = Axis {
                clipped_share,
                motion,
                ..found.axis
            };
            axis.verdict = verdict(axis.verdict, found.observed, &doubts);
            let decisive = doubts.iter().filter(|doubt| doubt.decisive);
            axis.reasons = decisive.map(|doubt| doubt.kind).collect();
            let rivals = doubts
                .iter()
                .filter(|doubt| doubt.outcome == Outcome::Found);
            axis.rivals = rivals.cloned().collect();
            axis.doubts = doubts;
            axis
        })
        .collect()
}

/// What the doubts leave of a verdict by significance alone.
fn verdict(significant: Verdict, observed: bool, doubts: &[Doubt]) -> Verdict {
    let decisive = |kind: Kind| doubts.iter().any(|d| d.decisive && d.kind == kind);
    // A record at fault hides a shift as well as it makes one.
    let fault = [
        Kind::Clipping,
        Kind::Stuck,
        Kind::AcCoupling,
        Kind::GravityLength,
    ]
    .into_iter()
    .any(decisive);
    match significant {
        Verdict::Shift if doubts.iter().any(|d| d.decisive && d.kind != Kind::Drift) => {
            Verdict::NotAttributable
        }
        _ if !observed => Verdict::CannotTell,
        Verdict::Shift if decisive(Kind::Drift) => Verdict::NotAttributable,
        Verdict::NoShift if decisive(Kind::Drift) => Verdict::NotAttributable,
        Verdict::NoShift if fault => Verdict::CannotTell,
        other => other,
    }
}

/// One axis and all that bears on it.
struct View<'a> {
    scene: &'a Scene<'a>,
    index: usize,
    calibration: &'a Calibration,
    timed: bool,
    found: &'a Found,
    shift: f64,
}

impl View<'_> {
    fn doubts(&self, gravity: Option<&Gravity>, motion: Option<&Motion>) -> Vec<Doubt> {
        vec![
            self.temperature(),
            self.clipping(),
            self.no_more_vibration(),
            self.orientation(gravity),
            self.drift(),
            self.stuck(),
            self.gross(),
            self.quantisation(),
            self.aliasing(motion),
            self.ac_coupling(),
            self.time_stamps(),
            self.gravity_length(gravity),
            self.hidden_peaks(motion),
        ]
    }

    fn channels<'s>(&'s self, side: &'s [&Segment]) -> impl Iterator<Item = &'s Channel> {
        side.iter().filter_map(|s| s.channels.get(self.index))
    }

    fn both(&self) -> impl Iterator<Item = (&Segment, &Channel)> {
        let all = self.scene.before.iter().chain(&self.scene.during);
        all.filter_map(|s| Some((*s, s.channels.get(self.index)?)))
    }

    /// Of blocks only moments are known.
    fn in_blocks(&self) -> bool {
        self.both()
            .any(|(segment, _)| segment.samples_in_blocks().is_some())
    }

    /// Of the segment that shakes most.
    fn motion(&self) -> Option<Motion> {
        let shake = |segment: &&&Segment| {
            segment
                .channels
                .get(self.index)
                .map_or(0.0, |c| c.shake.variance())
        };
        let all = self.scene.during.iter();
        let during = all.max_by(|a, b| shake(a).total_cmp(&shake(b)))?;
        let rate = self.timed.then(|| 1.0 / interval(during));
        Motion::of(&during.channels.get(self.index)?.kept, rate)
    }

    /// A vibration that rectifies makes a mean of at most its own modulus, which is below its rms.
    fn no_more_vibration(&self) -> Doubt {
        let kind = Kind::NoMoreVibration;
        let variance = |side: &[&Segment]| {
            let shakes: Spread = self.channels(side).map(|c| c.shake.variance()).collect();
            shakes.mean
        };
        let (before, during) = (variance(&self.scene.before), variance(&self.scene.during));
        let excess = (during - before).max(0.0).sqrt();
        let [b, d] = [before, during].map(|v| 1e3 * v.sqrt());
        let rms = format!("rms {b:.3} mg before and {d:.3} mg during, drift apart");
        if during <= LOUDER * LOUDER * before || during <= 0.0 {
            return Doubt::found(kind, format!("nothing shakes more than before: {rms}"));
        }
        if self.shift.abs() > excess {
            return Doubt::found(kind, format!("the shift is larger than what shakes: {rms}"));
        }
        Doubt::clear(kind, rms)
    }

    /// Slow noise is in the interval; here what the rest before predicts if its trend goes on.
    fn drift(&self) -> Doubt {
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

    fn temperature(&self) -> Doubt {
        let kind = Kind::Temperature;
        let all = || self.scene.before.iter().chain(&self.scene.during);
        if all().any(|segment| segment.temperature_c.count == 0) {
            return Doubt::unseen(kind, "no temperature is given (--temperature)");
        }
        let of = |side: &[&Segment]| {
            let means: Spread = side.iter().map(|s| s.temperature_c.mean).collect();
            means.mean
        };
        let warmer = of(&self.scene.during) - of(&self.scene.before);
        if warmer.abs() < TEMPERATURE_C {
            return Doubt::clear(kind, format!("{warmer:+.2} C during"));
        }
        let known = self.calibration.temperature_sensitivity_g_per_c;
        let (sensitivity, whence) = match (known, quiet_sensitivity(self.scene, self.index)) {
            (Some(stated), _) => (stated, "as stated"),
            (None, Some(seen)) => (seen, "as the segments before show"),
            (None, None) => {
                let text = format!(
                    "{warmer:+.2} C during; a sensitivity of {:+.2} mg/C would explain the whole shift",
                    1e3 * self.shift / warmer
                );
                return Doubt::found(kind, text);
            }
        };
        let size = sensitivity * warmer;
        let text = format!(
            "{warmer:+.2} C during; at {:+.3} mg/C, {whence}, that is {:+.2} mg",
            1e3 * sensitivity,
            1e3 * size
        );
        Doubt::found(kind, text).sized(size, self.shift)
    }

    fn stuck(&self) -> Doubt {
        let kind = Kind::Stuck;
        if self.in_blocks() {
            return Doubt::unseen(kind, "blocks do not show single samples");
        }
        let rms_during = self.found.axis.rms_during_g;
        for (segment, channel) in self.both() {
            // At rest a coarse converter stands still, and that is told as its steps.
            let coarse = channel.step_g.is_none_or(|step| {
                segment.role.state() == State::Rest && channel.spread.standard_deviation() < step
            });
            let dead = segment.role.state() == State::Shaken && rms_during == 0.0;
            if let Some((length, row)) = channel.repeats.stuck()
                && (!coarse || dead)
            {
                let text = format!("{length} equal samples in a row, from {} on", place(row));
                return Doubt::found(kind, text);
            }
        }
        Doubt::clear(kind, "no run of equal samples")
    }

    fn gross(&self) -> Doubt {
        let kind = Kind::GrossSamples;
        if self.in_blocks() {
            return Doubt::unseen(kind, "blocks do not show single samples");
        }
        let count: u64 = self.both().map(|(_, channel)| channel.gross.count).sum();
        let Some(without) = self.found.axis.without_gross_g.filter(|_| count > 0) else {
            return Doubt::clear(kind, "no sample is far from those about it");
        };
        let told: Vec<String> = self
            .both()
            .flat_map(|(_, channel)| &channel.gross.first)
            .take(5)
            .map(|(row, value, _)| format!("{value:.6} g in {}", place(*row)))
            .collect();
        let dots = if count as usize > told.len() {
            ", .."
        } else {
            ""
        };
        let text = format!(
            "{count} samples far from those about them: {}{dots}; without them the shift is {:+.4} mg instead of {:+.4} mg",
            told.join(", "),
            1e3 * without,
            1e3 * self.shift
        );
        // Many are part of the motion: shocks.
        let all: u64 = self.both().map(|(segment, _)| segment.count()).sum();
        let doubt = Doubt::found(kind, text).sized(self.shift - without, self.shift);
        if count * 1000 > all {
            doubt.harmless()
        } else {
            doubt
        }
    }

    /// Noise of standard deviation s makes the mean of a converter of step q linear: what is left is at most
    /// q/2 exp(-2 pi^2 s^2 / q^2) (Widrow and Kollar, Quantization Noise, ch. 7).
    fn quantisation(&self) -> Doubt {
        let kind = Kind::Quantisation;
        if self.in_blocks() {
            return Doubt::clear(kind, "blocks hold the converter's own moments");
        }
        let steps = self.both().filter_map(|(_, channel)| channel.step_g);
        let Some(step) = steps.reduce(f64::min) else {
            return Doubt::unseen(kind, "all samples are equal");
        };
        let bias = |side: &[&Segment]| {
            let worst = self.channels(side).map(|channel| {
                let noise = (channel.shake.variance() - step * step / 12.0).max(0.0);
                0.5 * step * (-2.0 * PI * PI * noise / (step * step)).exp()
            });
            worst.fold(0.0, f64::max)
        };
        let size = bias(&self.scene.before) + bias(&self.scene.during);
        let text = format!(
            "steps of {:.4} mg: the means can be off by {:.2e} mg",
            1e3 * step,
            1e3 * size
        );
        match size > 1e-3 * step {
            true => Doubt::found(kind, text).sized(size, self.shift),
            false => Doubt::clear(kind, text),
        }
    }

    /// A vibration at n times the rate plus or minus a little is seen as that little.
    fn aliasing(&self, motion: Option<&Motion>) -> Doubt {
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
    fn ac_coupling(&self) -> Doubt {
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

    fn time_stamps(&self) -> Doubt {
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

    fn gravity_length(&self, gravity: Option<&Gravity>) -> Doubt {
        let kind = Kind::GravityLength;
        let Some(gravity) = gravity.filter(|gravity| gravity.axes == 3) else {
            return Doubt::unseen(kind, "not three axes");
        };
        let text = format!("three axes show {:.4} g at rest", gravity.before);
        match (GRAVITY_G[0]..GRAVITY_G[1]).contains(&gravity.before) {
            true => Doubt::clear(kind, text),
            false => Doubt::found(
                kind,
                format!("{text}: another unit or scale, or no constant acceleration passes"),
            ),
        }
    }

    fn hidden_peaks(&self, motion: Option<&Motion>) -> Doubt {
        let kind = Kind::HiddenPeaks;
        let Some(limit) = self.calibration.full_scale_g else {
            return Doubt::unseen(kind, "no range is given (--full-scale)");
        };
        let Some(motion) = motion else {
            return Doubt::unseen(kind, "no samples to interpolate");
        };
        let text = format!(
            "between the samples the output reaches {:.4} g of {limit} g",
            motion.peak_g
        );
        match motion.peak_g >= limit {
            true => Doubt::found(kind, text),
            false => Doubt::clear(kind, text),
        }
    }

    fn clipping(&self) -> Doubt {
        let kind = Kind::Clipping;
        let [upper, lower] = clipped(self.scene, self.index);
        if upper + lower == 0.0 {
            return self.pile_up();
        }
        // How many samples of a block are clipped nobody knows.
        let blocks = self.in_blocks();
        let full_scale_g = self.calibration.full_scale_g.filter(|_| !blocks);
        let size = full_scale_g.map(|limit| {
            let centre = mean(&self.scene.during, self.index);
            tail_mean(lower, limit + centre) - tail_mean(upper, limit - centre)
        });
        let cut = match size {
            Some(size) => format!(
                "clipping itself rectifies: {:+.3} mg if the tails are Gaussian, more for impulses",
                1e3 * size
            ),
            None => "clipping itself rectifies, by an unknown amount".into(),
        };
        let text = format!(
            "{:.4} % of the {} clipped; {cut}",
            100.0 * (upper + lower).min(1.0),
            if blocks {
                "blocks hold samples that are"
            } else {
                "samples are"
            },
        );
        let doubt = Doubt::found(kind, text);
        match size {
            Some(size) => doubt.sized(size, self.shift),
            None => doubt,
        }
    }

    /// Samples that pile up at the ends of what was seen.
    fn pile_up(&self) -> Doubt {
        let kind = Kind::Clipping;
        if self.in_blocks() {
            return Doubt::clear(kind, "no block touches the converter's limits");
        }
        let mut tells = true;
        for (segment, channel) in self.both() {
            let [upper, lower] = channel.ends.pile_up();
            let share = |end: Option<(f64, u64)>| {
                end.map_or(0.0, |e| e.1 as f64) / segment.count().max(1) as f64
            };
            let ends: Vec<String> = [upper, lower]
                .iter()
                .flatten()
                .map(|e| format!("{:.6} g", e.0))
                .collect();
            if !ends.is_empty() {
                let text = format!(
                    "{:.3} % of the samples of \"{}\" pile up at {}, the end of the range",
                    100.0 * (share(upper) + share(lower)),
                    segment.name,
                    ends.join(" and ")
                );
                return Doubt::found(kind, text);
            }
            tells &= channel.ends.tells();
        }
        match tells {
            true => Doubt::clear(kind, "no samples pile up at the ends"),
            false => Doubt::unseen(kind, "too few different values to see a pile"),
        }
    }

    /// A turn by an angle moves an axis by the angle times the gravity across it; 1 g is taken where fewer than three axes
    /// do not show it.
    fn orientation(&self, gravity: Option<&Gravity>) -> Doubt {
        let kind = Kind::Orientation;
        let along = mean(&self.scene.during, self.index);
        let total = gravity
            .filter(|g| g.axes == 3)
            .map_or(1.0, |gravity| gravity.during);
        let across = (total * total - along * along).max(0.0).sqrt();
        let explains = match (self.shift / across).abs().to_degrees() {
            degrees if degrees < 90.0 => {
                format!("a turn by {degrees:.3} deg would explain the shift")
            }
            _ => "no small turn would explain the shift".into(),
        };
        let Some(gravity) = gravity else {
            let text = format!("one axis does not show a turn; {explains}");
            return match self.scene.separate {
                true => Doubt::found(kind, text),
                false => Doubt::unseen(kind, text),
            };
        };
        // Only what lies across gravity can be of a turn.
        let size = gravity.across[self.index];
        let text = format!(
            "gravity turns by {:.3} deg on {} axes, {:+.3} mg on this one; {explains}",
            gravity.turn.to_degrees(),
            gravity.axes,
            1e3 * size,
        );
        let doubt = Doubt::found(kind, text).sized(size, self.shift);
        match self.scene.bracketed {
            true => Doubt {
                finding: format!(
                    "{}; it would have to undo itself after the vibration",
                    doubt.finding
                ),
                ..doubt
            },
            false => doubt,
        }
    }
}

/// Rows are counted from 0 until the file tells its lines.
fn place(row: u64) -> String {
    format!("\u{1}{row}\u{2}")
}

/// The rows that a finding names, for `lines` to put in their lines.
pub(super) fn rows(text: &str) -> Vec<u64> {
    let marks = text.split('\u{1}').skip(1);
    marks
        .filter_map(|rest| rest.split('\u{2}').next()?.parse().ok())
        .collect()
}

/// The finding with its rows named.
pub(super) fn named(text: &str, name: impl Fn(u64) -> String) -> String {
    let mut whole = String::new();
    for (index, piece) in text.split('\u{1}').enumerate() {
        match piece.split_once('\u{2}').filter(|_| index > 0) {
            Some((row, rest)) => {
                whole.push_str(&name(row.parse().unwrap_or(0)));
                whole.push_str(rest);
            }
            None => whole.push_str(piece),
        }
    }
    whole
}

fn mean(side: &[&Segment], index: usize) -> f64 {
    let means = side
        .iter()
        .filter_map(|s| s.channels.get(index)?.trace.mean());
    means.collect::<Spread>().mean
}

/// Slope of the means before the vibration over their temperature, g/C: from four segments on that span
/// half a degree.
fn quiet_sensitivity(scene: &Scene<'_>, index: usize) -> Option<f64> {
    let points: Vec<(f64, f64)> = scene
        .before
        .iter()
        .filter_map(|s| Some((s.temperature_c.mean, s.channels.get(index)?.trace.mean()?)))
        .collect();
    let t: Spread = points.iter().map(|point| point.0).collect();
    let u: Spread = points.iter().map(|point| point.1).collect();
    if points.len() < 4 || t.max - t.min < 0.5 {
        return None;
    }
    let products: f64 = points
        .iter()
        .map(|point| (point.0 - t.mean) * (point.1 - u.mean))
        .sum();
    let squares: f64 = points.iter().map(|point| (point.0 - t.mean).powi(2)).sum();
    Some(products / squares)
}

/// Shares of the samples (or blocks) during the vibration at the upper and the lower limit.
fn clipped(scene: &Scene<'_>, index: usize) -> [f64; 2] {
    let channels: Vec<_> = scene
        .during
        .iter()
        .filter_map(|s| s.channels.get(index))
        .collect();
    let all: u64 = channels.iter().map(|c| c.trace.count()).sum();
    [0, 1].map(|end| {
        let at_limit: u64 = channels.iter().map(|c| c.clipped[end]).sum();
        at_limit as f64 / all.max(1) as f64
    })
}

/// Mean of what Gaussian noise has beyond a limit that it passes with the probability `share`.
fn tail_mean(share: f64, limit: f64) -> f64 {
    if share <= 0.0 || limit <= 0.0 {
        return 0.0;
    }
    let a = -Normal::standard().inverse_cdf(share.min(0.4));
    let density = (-0.5 * a * a).exp() / TAU.sqrt();
    limit / a * (density - a * share)
}

/// Gravity as the means of two or three axes show it.
struct Gravity {
    axes: usize,
    /// Its length before, and during, g.
    before: f64,
    during: f64,
    /// Angle between the means before and during, rad.
    turn: f64,
    /// What of the change lies across gravity, on each axis, g.
    across: Vec<f64>,
}

impl Gravity {
    fn of(scene: &Scene<'_>, axes: usize) -> Option<Self> {
        if !(2..=3).contains(&axes) {
            return None;
        }
        let vector =
            |side: &[&Segment]| -> Vec<f64> { (0..axes).map(|index| mean(side, index)).collect() };
        let (b, d) = (vector(&scene.before), vector(&scene.during));
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (before, during) = (dot(&b, &b).sqrt(), dot(&d, &d).sqrt());
        let change: Vec<f64> = d.iter().zip(&b).map(|(d, b)| d - b).collect();
        let middle: Vec<f64> = d.iter().zip(&b).map(|(d, b)| 0.5 * (d + b)).collect();
        let share = dot(&change, &middle) / dot(&middle, &middle).max(f64::MIN_POSITIVE);
        // Of two axes that do not show all of gravity, a turn about any direction changes both.
        let hidden = axes == 2 && before < SEEN_G;
        let share = if hidden { 0.0 } else { share };
        let across = change
            .iter()
            .zip(&middle)
            .map(|(c, m)| c - share * m)
            .collect();
        let cosine = dot(&b, &d) / (before * during).max(f64::MIN_POSITIVE);
        Some(Self {
            axes,
            before,
            during,
            turn: cosine.clamp(-1.0, 1.0).acos(),
            across,
        })
    }
}

/// What should be known about the record.
pub(super) fn notes(scene: &Scene<'_>, columns: &[String]) -> Vec<String> {
    let mut notes = Vec::new();
    let segments: Vec<&Segment> = [scene.before.as_slice(), &scene.during].concat();
    for (role, side) in [(Role::Before, &scene.before), (Role::During, &scene.during)] {
        if segments.len() > 2 && side.len() == 1 {
            notes.push(format!(
                "one segment {role}: what it does not repeat cannot be seen"
            ));
        }
        let unsteady: Vec<&str> = (0..columns.len())
            .filter(|&index| !repeats(side, index))
            .filter_map(|index| columns.get(index).map(String::as_str))
            .collect();
        if !unsteady.is_empty() {
            notes.push(format!(
                "segments {role} differ more than their own noise allows ({}): handling, orientation, or a vibration \
                 of another kind",
                unsteady.join(", ")
            ));
        }
    }
    let gaps: u64 = segments.iter().map(|segment| segment.gaps).sum();
    let worst = segments
        .iter()
        .map(|s| s.interval_s.max / s.interval_s.mean)
        .fold(0.0, f64::max);
    if gaps > 0 {
        notes.push(format!(
            "irregular sampling: {gaps} intervals are more than 1.6 times the mean, the longest {worst:.1} times; means \
             take samples as even"
        ));
    }
    let rms = |segment: &Segment| {
        segment
            .channels
            .iter()
            .map(|c| c.spread.standard_deviation())
            .fold(0.0, f64::max)
    };
    let loudest_before = scene.before.iter().map(|s| rms(s)).fold(0.0, f64::max);
    for quiet in scene
        .during
        .iter()
        .filter(|segment| rms(segment) < 2.0 * loudest_before)
    {
        notes.push(format!(
            "\"{}\" shakes less than twice as much as the segments before",
            quiet.name
        ));
    }
    notes
}

/// Whether the segments' means agree within the noise of each (chi-square at 1 %).
fn repeats(side: &[&Segment], index: usize) -> bool {
    let estimates: Vec<_> = side
        .iter()
        .filter_map(|s| s.channels.get(index)?.trace.mean_estimate(s.count()).ok())
        .filter(|estimate| estimate.sigma > 0.0)
        .collect();
    let weight: f64 = estimates.iter().map(|e| e.sigma.powi(-2)).sum();
    let mean = estimates
        .iter()
        .map(|e| e.value * e.sigma.powi(-2))
        .sum::<f64>()
        / weight;
    let chi2: f64 = estimates
        .iter()
        .map(|e| ((e.value - mean) / e.sigma).powi(2))
        .sum();
    match ChiSquared::new(estimates.len().saturating_sub(1) as f64) {
        Ok(distribution) => distribution.cdf(chi2) < 0.99,
        Err(_) => true, // Fewer than two.
    }
}
