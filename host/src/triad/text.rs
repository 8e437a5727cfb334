//! What is known of a triad, for people.

use std::fmt::Write as _;

use shared::triad::body::Axis;

use super::answer::TriadIdentification;
use super::diagnosis::TriadDiagnosis;
use super::planning::{Conditions, TriadPlan};
use super::prediction::TriadPrediction;
use super::rests::Rests;
use crate::campaign::{TriadRun, VibrationKind};
use crate::quantity::Quantity;
use crate::statics::{MEANINGS, NAMES};

/// Most coefficients of a blind direction that is printed.
const READABLE: usize = 4;

/// The coefficients of the three instruments beside each other.
pub fn identification(found: &TriadIdentification) -> String {
    let mut text = format!(
        "triad {}, {} positions\n\n{:<12} {:>18} {:>18} {:>18}\n",
        found.serial,
        found.residuals_g.len(),
        "",
        "x",
        "y",
        "z"
    );
    for (name, meaning) in NAMES.iter().zip(MEANINGS) {
        let factor = if *name == NAMES[0] { 1.0 } else { 1e6 };
        let cells = Axis::ALL.map(|axis| {
            let quantity = &found.instruments[axis.name()].coefficients[name];
            quantity.scaled(factor).to_string()
        });
        let unit = if factor == 1.0 { "    " } else { "e-6 " };
        let [x, y, z] = cells;
        let _ = writeln!(text, "{name:<12} {x:>18} {y:>18} {z:>18} {unit}  {meaning}");
    }
    let _ = writeln!(
        text,
        "\nStandard uncertainties in units of the last digits."
    );
    if found.frame == "chosen" {
        let _ = writeln!(
            text,
            "No attitude is known: the frame is chosen so that IA of x is x and IA of y lies in the plane of x and y. A mirrored \
             or renamed axis, and a scale factor common to all three beyond that of local gravity, cannot be told."
        );
    }
    let _ = writeln!(
        text,
        "rank {} of 33 by the positions, {} with frame and prior; chi-square {:.1} at {} degrees of freedom",
        found.rank, found.rank_with_prior, found.chi2, found.dof
    );
    let (plain, mixed): (Vec<_>, Vec<_>) = found
        .blind_directions
        .iter()
        .partition(|direction| direction.len() <= READABLE);
    for direction in plain {
        let parts: Vec<_> = direction
            .iter()
            .map(|(n, c)| format!("{c:+.3} {n}"))
            .collect();
        let _ = writeln!(text, "BLIND: {}", parts.join("  "));
    }
    if !mixed.is_empty() {
        let _ = writeln!(
            text,
            "BLIND: {} combinations of many coefficients besides, which noise hides; --json lists them",
            mixed.len()
        );
    }
    write_prior(&mut text, found.cross_coupling_sigma_per_g);
    if found.scatter_g > 0.0 {
        let _ = writeln!(
            text,
            "SCATTER: the positions scatter by {:.3} mg beyond their stated noise (drift, temperature, handling); that is in every \
             uncertainty, and higher terms are stated only where positions that were left out bear them out.",
            found.scatter_g * 1e3
        );
    }
    write_left_out(&mut text, found);
    write_vre(&mut text, found);
    text
}

fn write_prior(text: &mut String, cross_coupling_sigma_per_g: Option<f64>) {
    let _ = match cross_coupling_sigma_per_g {
        Some(sigma) => writeln!(
            text,
            "Prior: k_IP, k_IO and k_PO are 0 +- {sigma:e} (cross_coupling_sigma_per_g of campaign.toml)."
        ),
        None => writeln!(
            text,
            "No prior of the cross-couplings is stated (cross_coupling_sigma_per_g of campaign.toml)."
        ),
    };
    text.push_str(
        "Assumed of higher terms that positions left out do not bear out, and of all in predictions: 0 +- 5e-4 beforehand.\n",
    );
}

fn write_left_out(text: &mut String, found: &TriadIdentification) {
    let left_out = &found.leave_one_out;
    let _ = writeln!(
        text,
        "positions left out: |a| - g misses by {:.2} microg rms with scale factors, biases and misalignments alone, by {:.2} with {}",
        left_out.nine_parameters_rms_g * 1e6,
        left_out.rms_g * 1e6,
        match left_out.claimed.as_slice() {
            [] => "no further term: none is borne out".to_owned(),
            claimed => claimed.join(", "),
        }
    );
}

fn write_vre(text: &mut String, found: &TriadIdentification) {
    let vre = &found.vre_at_1_g_rms_g;
    let _ = writeln!(
        text,
        "\nVibration error at 1 g rms of white noise along each input axis, a0 = 0, microg:"
    );
    for (name, quantities) in [
        ("with the prior", &vre.with_prior),
        ("without it", &vre.without_prior),
    ] {
        let [x, y, z] = Axis::ALL.map(|axis| quantities[axis.name()].scaled(1e6).to_string());
        let _ = writeln!(text, "  {name:<16} {x:>14} {y:>14} {z:>14}");
    }
}

/// Predicted and measured vibration errors.
pub fn prediction(found: &TriadPrediction, runs: &[TriadRun]) -> String {
    let mut text = format!(
        "triad {}: vibration error in microg\n\n{:>4} {:<26} {:>4} {:>16} {:>16} {:>16}\n",
        found.serial, "run", "vibration", "axis", "predicted", "without prior", "measured"
    );
    for (run, predicted) in runs.iter().zip(&found.runs) {
        let kind = match run.kind {
            VibrationKind::Sine => "sine",
            VibrationKind::Random => "random",
        };
        let along = run.direction.map(|c| format!("{c:.2}")).join(" ");
        let name = format!("{kind} {} g, {along}", run.level_g);
        for axis in Axis::ALL {
            let each = &predicted.instruments[axis.name()];
            let cell = |quantity: Quantity| quantity.scaled(1e6).to_string();
            let measured = each.measured_vre_g.map_or("-".into(), cell);
            let first = if axis == Axis::X {
                (run.run.to_string(), name.as_str())
            } else {
                (String::new(), "")
            };
            let _ = writeln!(
                text,
                "{:>4} {:<26} {:>4} {:>16} {:>16} {measured:>16}",
                first.0,
                first.1,
                axis.name(),
                cell(each.vre_g),
                cell(each.without_prior_vre_g)
            );
        }
    }
    text.push('\n');
    write_prior(&mut text, found.cross_coupling_sigma_per_g);
    text
}

/// What the positions leave, and what makes it.
pub fn diagnosis(found: &TriadDiagnosis) -> String {
    let mut text = format!(
        "triad {}: {}\n\ngap      a linear triad misses |a| = g by {:.2} times the stated noise\n",
        found.serial, found.verdict, found.gap.rms_over_noise
    );
    for named in &found.which {
        let _ = writeln!(text, "which    {}", named.effect);
        for parameter in &named.parameters {
            let _ = writeln!(text, "         {} = {}", parameter.name, parameter.quantity);
        }
    }
    let shrink = &found.shrink;
    let _ = writeln!(
        text,
        "shrink   positions left out miss |a| = g by {:.2} (linear), {:.2} (with effects) microg",
        shrink.held_out_rms_linear_g * 1e6,
        shrink.held_out_rms_with_effects_g * 1e6
    );
    if !found.not_asked.is_empty() {
        let _ = writeln!(
            text,
            "not asked, since positions.csv has no times or temperatures that differ: {}",
            found.not_asked.join(", ")
        );
    }
    text
}

/// What orientations tell.
pub fn plan(plan: &TriadPlan, conditions: &Conditions) -> String {
    let attitude = match conditions.attitude_sigma_rad {
        None => "held by hand".to_owned(),
        Some(sigma) => format!(
            "attitudes known to {:.1} arcsec",
            sigma / shared::tumble::ARCSEC_RAD
        ),
    };
    let mut text = format!(
        "{} positions, {attitude}; noise {:.2e} g a reading; rank {} of 33\nlargest hole: {:.0} deg from the nearest position\n\n\
         Standard uncertainty of the predicted vibration error, microg:\n",
        plan.positions, conditions.noise_g, plan.rank, plan.largest_hole_deg
    );
    for environment in &plan.environments {
        let _ = writeln!(text, "{}", environment.name);
        let stated = match conditions.cross_coupling_sigma_per_g {
            Some(sigma) => format!("cross-couplings 0 +- {sigma:e}"),
            None => "cross-couplings not stated".into(),
        };
        for (name, [x, y, z]) in [
            (stated.as_str(), environment.vre_sigma_g),
            ("without that", environment.without_prior_sigma_g),
        ] {
            let (x, y, z) = (x * 1e6, y * 1e6, z * 1e6);
            let _ = writeln!(text, "  {name:<28} x {x:>8.1}   y {y:>8.1}   z {z:>8.1}");
        }
    }
    let _ = writeln!(
        text,
        "\nOrientations to add (specific force on x, y, z), each the best after those above it:"
    );
    for addition in &plan.add {
        let [x, y, z] = addition.direction;
        let _ = writeln!(
            text,
            "  {x:>6.2} {y:>6.2} {z:>6.2}   then {:.1} microg rms",
            addition.vre_sigma_g * 1e6
        );
    }
    text
}

/// The rests of a record.
pub fn rests(found: &Rests) -> String {
    let mut text = format!(
        "{:>4} {:>10} {:>8} {:>13} {:>13} {:>13}\n",
        "rest", "from / s", "long / s", "x", "y", "z"
    );
    for (k, rest) in found.rests.iter().enumerate() {
        let [x, y, z] = [0, 1, 2].map(|s| Quantity::new(rest.mean[s], rest.sigma[s]).to_string());
        let _ = writeln!(
            text,
            "{:>4} {:>10.2} {:>8.2} {x:>13} {y:>13} {z:>13}",
            k + 1,
            rest.from_s,
            rest.to_s - rest.from_s
        );
    }
    let line = |name: &str, values: [f64; 3]| {
        let [x, y, z] = values;
        format!("{name:<52} {x:>10.3e} {y:>10.3e} {z:>10.3e}\n")
    };
    text.push('\n');
    text += &line("noise of a sample at rest (quietest blocks)", found.noise);
    text += &line(
        "threshold: noise within a block of 0.25 s",
        found.greatest_noise,
    );
    text += &line("threshold: step from block to block", found.greatest_step);
    text += &line(
        "noise of means over that of white noise",
        found.noise_factor,
    );
    let _ = writeln!(
        text,
        "{} rests in {:.0} s; not taken: {} that creep, {} too short",
        found.rests.len(),
        found.length_s,
        found.creeping,
        found.too_short
    );
    text
}
