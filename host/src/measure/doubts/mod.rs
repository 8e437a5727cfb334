//! What else than the vibration could have shifted the mean, each looked for without being asked: one file a subject.

mod drift;
mod gravity;
mod notes;
mod range;
mod rows;
mod samples;
mod sampling;
mod temperature;

pub(super) use notes::notes;
pub(super) use rows::{named, rows};

use super::Calibration;
use super::answer::{Axis, Doubt, Kind, Outcome, Verdict};
use super::motion::Motion;
use super::segment::{Channel, Segment, Spread};
use super::shift::{Found, Scene, interval};
use super::survey::LOUDER;
use gravity::Gravity;
use range::clipped;

/// Share of the shift from which on a rival of known size forbids to attribute it.
const SHARE: f64 = 1.0 / 3.0;

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
}

fn mean(side: &[&Segment], index: usize) -> f64 {
    let means = side
        .iter()
        .filter_map(|s| s.channels.get(index)?.trace.mean());
    means.collect::<Spread>().mean
}
