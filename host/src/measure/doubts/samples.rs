//! Samples that are not of the motion, and those of a coarse converter.

use std::f64::consts::PI;

use super::super::answer::{Doubt, Kind};
use super::super::noise::State;
use super::super::segment::Segment;
use super::View;
use super::rows::place;

impl View<'_> {
    pub(super) fn stuck(&self) -> Doubt {
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

    pub(super) fn gross(&self) -> Doubt {
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
    pub(super) fn quantisation(&self) -> Doubt {
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
}
