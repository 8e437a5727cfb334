//! What a laboratory has of its own, in words: rows that do not belong, noise that is not as stated, sessions, shaker and
//! reference.

use std::fmt::Write as _;

use crate::diagnose::answer::{
    AxisEstimate, Estimate, NoiseFactor, SessionEstimate, ShakerEstimate, SuspectRow,
};
use crate::quantity::Quantity;

/// Standard deviations from which on something is told.
const TOLD: f64 = 4.0;
/// Noise of a reference from which on it is told, g: below it is nothing beside any level.
const NOISE_TOLD_G: f64 = 2e-5;
/// Relative scatter, gain and cross-sensitivity from which on they are told: a few times what a good reference has.
const RELATIVE_TOLD: f64 = 5e-4;

/// Rows that do not belong and noise that is not as stated, a line each.
pub fn belonging(suspects: &[SuspectRow], noise: &[NoiseFactor]) -> String {
    let mut out = String::new();
    for suspect in suspects {
        let would = suspect.would_explain.as_ref();
        let would = would.map_or(String::new(), |slip| format!("; {slip} would explain it"));
        let aside = if suspect.set_aside { "; set aside" } else { "" };
        let _ = writeln!(
            out,
            "row {} of {} ({} {}) does not belong: {:.1} sigma{would}{aside}",
            suspect.row, suspect.file, suspect.what, suspect.number, suspect.sigma_off
        );
    }
    for noise in noise.iter().filter(|noise| !noise.stated_holds) {
        let factor = noise.factor.value;
        let (word, times) = match factor > 1.0 {
            true => ("small", factor),
            false => ("large", factor.recip()),
        };
        let _ = writeln!(
            out,
            "the stated noise of {} is too {word}, by {times:.2}; the answer uses what the data show",
            noise.of
        );
    }
    out
}

/// What sessions after the first have of their own, a line each.
pub(super) fn sessions(out: &mut String, sessions: &[SessionEstimate]) {
    for session in sessions {
        let told = |name: &str, estimate: Option<Estimate>, nothing: f64, scale: f64| {
            let estimate = estimate?;
            let far = (estimate.value - nothing).abs() > TOLD * estimate.sigma;
            far.then(|| {
                let quantity = Quantity::new(scale * estimate.value, scale * estimate.sigma);
                format!("{name} {quantity}")
            })
        };
        let turns = session.alignment_rad.iter().zip(["about PA", "about OA"]);
        let turns = turns.filter_map(|(turn, axis)| {
            told(&format!("turned {axis} by microrad"), Some(*turn), 0.0, 1e6)
        });
        let remarks: Vec<String> = told("bias off by microg", session.bias_g, 0.0, 1e6)
            .into_iter()
            .chain(turns)
            .chain(told("gain", session.gain, 1.0, 1.0))
            .collect();
        if !remarks.is_empty() {
            let _ = writeln!(
                out,
                "session {}: {}; no gap",
                session.session,
                remarks.join(", ")
            );
        }
    }
}

/// What shaker, reference and peak detector have of their own, a line each. `moves_across`: the instrument felt that the table
/// moves across its drive.
pub(super) fn shaker(out: &mut String, found: &ShakerEstimate, moves_across: bool) {
    let above = |value: Option<f64>, least: f64| value.filter(|value| *value > least);
    if let Some(noise_g) = above(found.reference_noise_g, NOISE_TOLD_G) {
        let _ = writeln!(
            out,
            "the reference has noise of {:.2} mg rms in each axis; it is in every ref_*_rms_g",
            1e3 * noise_g
        );
    }
    if let Some(scatter) = above(found.reference_scatter, RELATIVE_TOLD) {
        let percent = 100.0 * scatter;
        let _ = writeln!(
            out,
            "the reference has a scatter of {percent:.2} % from run to run"
        );
    }
    if let Some(scatter) = above(found.table_scatter, RELATIVE_TOLD) {
        let percent = 100.0 * scatter;
        let _ = writeln!(
            out,
            "the table misses its command by {percent:.2} % from run to run; the reference is believed"
        );
    }
    let gains = found.reference_gain.iter().filter(|gain| told(gain, 1.0));
    let gains: Vec<String> = gains
        .map(|gain| format!("{} {}", gain.axis, Quantity::new(gain.value, gain.sigma)))
        .collect();
    if !gains.is_empty() {
        let gains = gains.join(", ");
        let _ = writeln!(out, "the reference's gain over the command is off: {gains}");
    }
    let crosses = found.reference_cross_sensitivity.iter();
    let largest = crosses
        .filter(|cross| told(cross, 0.0))
        .max_by(|a, b| a.value.abs().total_cmp(&b.value.abs()));
    if let Some(cross) = largest {
        let percent = Quantity::new(100.0 * cross.value, 100.0 * cross.sigma);
        let _ = writeln!(
            out,
            "the reference's axis {} reads {percent} % of motion along {}: {}",
            cross.axis,
            cross.along,
            match moves_across {
                true => "motion of the table across its drive, which the instrument feels",
                false =>
                    "its cross-sensitivity, or motion of the table across its drive (turn the reference by 180 deg to tell)",
            }
        );
    }
    let off = |estimate: &Estimate| {
        let off = (estimate.value - 1.0).abs();
        off > TOLD * estimate.sigma && off > RELATIVE_TOLD
    };
    if let Some(level) = found.table_level.as_ref().filter(|level| off(level)) {
        let level = Quantity::new(level.value, level.sigma);
        let _ = writeln!(
            out,
            "the table's level is {level} times its command, by the instrument"
        );
    }
    if let Some(gain) = found.peak_gain.as_ref().filter(|gain| off(gain)) {
        let gain = Quantity::new(gain.value, gain.sigma);
        let _ = writeln!(out, "the peak detector's gain is {gain} (u_min_v, u_max_v)");
    }
}

fn told(estimate: &AxisEstimate, nothing: f64) -> bool {
    let off = (estimate.value - nothing).abs();
    off > TOLD * estimate.sigma && off > RELATIVE_TOLD
}
