//! A turn against gravity, and gravity's own length.

use super::super::answer::{Doubt, Kind};
use super::super::segment::Segment;
use super::super::shift::Scene;
use super::{View, mean};

/// Lengths of gravity that three axes can show, g; outside, the unit, the scale or the coupling is another. Chosen: no
/// scale factor is off by half, and 9.8 or 1000 are far outside.
const GRAVITY_G: [f64; 2] = [0.5, 1.5];

/// Length of gravity on two axes from which on the third axis is across it. Chosen.
const SEEN_G: f64 = 0.95;

/// Gravity as the means of two or three axes show it.
pub(super) struct Gravity {
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
    pub(super) fn of(scene: &Scene<'_>, axes: usize) -> Option<Self> {
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

impl View<'_> {
    pub(super) fn gravity_length(&self, gravity: Option<&Gravity>) -> Doubt {
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

    /// A turn by an angle moves an axis by the angle times the gravity across it; 1 g is taken where fewer than three axes
    /// do not show it.
    pub(super) fn orientation(&self, gravity: Option<&Gravity>) -> Doubt {
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
