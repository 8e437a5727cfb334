//! Coefficients out of one record with a reference beside the instrument: how the output's fundamental and harmonics move with
//! the amplitude, along ramps and plateaus, together with the means of the plateaus.
//!
//! `blocks.rs` takes the harmonics, `model.rs` what each coefficient makes of the motion, `fit.rs` solves. The harmonics alone
//! predict a vibration error that the mean, which they have not seen, tests.

pub(super) mod answer;
mod blocks;
mod fit;
mod model;

use std::f64::consts::TAU;
use std::path::Path;

use nalgebra::Vector3;
use shared::rectification::Sensitivity;
use shared::vibration::{Kinked, Moments};

pub use answer::{HarmonicFit, Response, Test, WaveformCoefficients};
pub use blocks::Source;

use super::answer::{Axis, Measurement, Plateau, Verdict};
use super::motion;
use crate::error::{Error, clip};
use crate::import::Columns;
use crate::quantity::Quantity;
use blocks::{Block, Blocks, Tone};
use fit::{Fit, Mean, Observed};
use model::{Column, PLACES};

/// Frequencies that are one, apart by so much of it.
const SAME: f64 = 1e-3;

/// Standard deviation of a gain's departure below which it was learnt from the record, of that of its prior.
const LEARNT: f64 = 0.5;

/// Coefficients of the first column of `columns` from the plateaus of `found` and the ramps about them, or why there are none.
///
/// # Errors
/// The columns cannot be read.
pub fn coefficients(
    file: &Path,
    columns: &Columns,
    found: &Measurement,
    source: &Source,
) -> Result<Result<WaveformCoefficients, String>, Error> {
    let sines: Vec<(&Plateau, &Axis, f64)> = found
        .plateaus
        .iter()
        .filter(|plateau| plateau.kind == motion::Kind::Sine)
        .filter_map(|plateau| Some((plateau, plateau.axes.first()?, plateau.frequency_hz?)))
        .collect();
    if sines.is_empty() {
        return Ok(Err("coefficients need a plateau of a sine".into()));
    }
    let tones: Vec<Tone> = sines
        .iter()
        .map(|(plateau, _, frequency_hz)| Tone {
            frequency_hz: *frequency_hz,
            from_s: plateau.from_s,
            to_s: plateau.to_s,
        })
        .collect();
    let extent = found.picture.as_ref().map_or([0.0; 2], |p| p.extent_s);
    let mut blocks = blocks::read(file, columns, source, &tones, extent[1] - extent[0])?;
    let frequencies = joined(&tones, &mut blocks.list);
    let a0_g = source.gravity_g.unwrap_or_else(|| at_rest(found));
    let of_block = |block: &Block| Column::of(a0_g, &block.reference_g);
    let all: Vec<Column> = blocks.list.iter().map(of_block).collect();
    let amplitudes = blocks.list.iter().map(|b| b.reference_g[0].norm());
    let amplitudes_g = [
        amplitudes.clone().fold(f64::INFINITY, f64::min),
        amplitudes.fold(0.0, f64::max),
    ];
    let angular: Vec<f64> = frequencies.iter().map(|hz| TAU * hz).collect();
    let observed = Observed {
        blocks: &blocks.list,
        columns: &all,
        angular: &angular,
        orders: blocks.orders,
        amplitude_g: amplitudes_g[1],
        distortion: source.distortion,
    };
    let plateaus: Vec<Seen<'_>> = sines
        .iter()
        .filter_map(|(plateau, axis, _)| Seen::of(plateau, axis, &blocks.list, &all, a0_g))
        .collect();
    let means: Vec<Mean> = plateaus.iter().filter_map(Seen::mean).collect();
    let (Some(alone), Some(both)) = (fit::fit(&observed, &[]), fit::fit(&observed, &means)) else {
        let column = clip(&source.column);
        return Ok(Err(format!(
            "coefficients need some periods of a sine in {column}, sampled four times a period or more"
        )));
    };
    let [k2_per_g, k3_per_g2, k4_per_g3] = quantities(&both);
    Ok(Ok(WaveformCoefficients {
        k2_per_g,
        k3_per_g2,
        k4_per_g3,
        covariance: std::array::from_fn(|a| std::array::from_fn(|b| both.covariance[(a, b)])),
        k2_of_means_alone_per_g: of_means(&means),
        reference: source.column.clone(),
        reference_distortion: source.distortion,
        a0_g,
        blocks: blocks.list.len(),
        block_s: blocks.length_s,
        amplitudes_g,
        dynamics: dynamics(&frequencies, &both),
        harmonics: left(&both),
        tests: plateaus
            .iter()
            .map(|seen| seen.test(&alone, &both))
            .collect(),
        assumptions: assumptions(source, a0_g, &blocks, amplitudes_g[1]),
    }))
}

/// The frequencies of the tones; the blocks' tones become places among them.
fn joined(tones: &[Tone], blocks: &mut [Block]) -> Vec<f64> {
    let mut frequencies: Vec<f64> = Vec::new();
    let places: Vec<usize> = tones
        .iter()
        .map(|tone| {
            let same = |hz: &f64| (hz - tone.frequency_hz).abs() < SAME * hz;
            frequencies.iter().position(same).unwrap_or_else(|| {
                frequencies.push(tone.frequency_hz);
                frequencies.len() - 1
            })
        })
        .collect();
    blocks
        .iter_mut()
        .for_each(|block| block.tone = places[block.tone]);
    frequencies
}

/// Mean of the rests, g.
fn at_rest(found: &Measurement) -> f64 {
    let rests = found
        .segments
        .iter()
        .filter(|segment| segment.role == "rest");
    let means: Vec<f64> = rests
        .filter_map(|rest| rest.mean_g.first()?.value)
        .collect();
    means.iter().sum::<f64>() / means.len().max(1) as f64
}

fn quantities(fit: &Fit) -> [Quantity; 3] {
    std::array::from_fn(|n| Quantity::new(fit.coefficients[n], fit.covariance[(n, n)].sqrt()))
}

/// k2 by weighted least squares of the means, if k3 and k4 were zero.
fn of_means(means: &[Mean]) -> Option<Quantity> {
    let weighted = |value: fn(&Mean) -> f64| -> f64 {
        let terms = means.iter().map(|m| value(m) * m.by[0] / m.sigma_g.powi(2));
        terms.sum()
    };
    let information = weighted(|mean| mean.by[0]);
    (information > 0.0).then(|| {
        let value = weighted(|mean| mean.shift_g) / information;
        Quantity::new(value, information.sqrt().recip())
    })
}

/// What the model leaves of each harmonic.
fn left(fit: &Fit) -> Vec<HarmonicFit> {
    let orders = fit.noise.iter().zip(1..);
    let told = orders.map(|(noise, order)| HarmonicFit {
        order,
        residual_g: noise.map(|part| part.rms_g),
        unsteadiness: noise.map(|part| part.unsteadiness),
    });
    told.collect()
}

/// Gain and phase at the fundamental, and at the harmonics where the record tells them.
fn dynamics(frequencies: &[f64], fit: &Fit) -> Vec<Response> {
    let tones = frequencies.iter().zip(&fit.gains);
    let all =
        tones.flat_map(|(hz, gains)| gains.iter().zip(1usize..).map(move |(g, k)| (hz, g, k)));
    let told = all.filter(|(_, (gain, sigma), order)| {
        *order == 1 || *sigma < LEARNT * fit::GAIN_SPREAD * (order - 1) as f64 * gain.norm()
    });
    told.map(|(hz, (gain, sigma), order)| Response {
        frequency_hz: order as f64 * hz,
        order,
        gain: Quantity::new(gain.norm(), *sigma),
        phase_deg: Quantity::new(gain.arg().to_degrees(), (sigma / gain.norm()).to_degrees()),
    })
    .collect()
}

/// What was assumed, and how much it would matter.
fn assumptions(source: &Source, a0_g: f64, blocks: &Blocks, level_g: f64) -> Vec<String> {
    let whose = match source.gravity_g {
        Some(_) => "as told",
        None => "the output's mean at rest, its bias included",
    };
    let across = match blocks.across_g {
        Some(rms) => format!("the motion across, {rms:.3} g rms at most,"),
        None => "the motion across, which no reference shows,".into(),
    };
    vec![
        format!("gravity on the input axis is {a0_g:.4} g, {whose}"),
        format!(
            "the motion is along the input axis: k_IP, k_IO, k_PO are zero; with {across} each would be taken for k2 by the ratio \
             of that motion to the one along"
        ),
        "k1' is zero; k5 is zero".into(),
        "reference and instrument move as one, and what follows the nonlinearity is linear".into(),
        format!(
            "the reference's gain is right, and it distorts {:.2e} of {level_g:.4} g at most so (one standard deviation): \
             --reference-distortion. The shaker's own harmonics are in the reference and do no harm",
            source.distortion
        ),
        "the means of plateaus are independent of each other".into(),
    ]
}

/// A plateau with what the reference saw of it.
struct Seen<'a> {
    plateau: &'a Plateau,
    axis: &'a Axis,
    level_g: f64,
    by: Vector3<f64>,
}

impl<'a> Seen<'a> {
    fn of(
        plateau: &'a Plateau,
        axis: &'a Axis,
        blocks: &[Block],
        columns: &[Column],
        a0_g: f64,
    ) -> Option<Self> {
        let within = blocks
            .iter()
            .zip(columns)
            .filter(|(block, _)| (plateau.from_s..=plateau.to_s).contains(&block.at_s));
        let (mut count, mut level, mut sums) = (0.0, 0.0, [0.0; 3]);
        for (block, column) in within {
            count += 1.0;
            level += block.reference_g[0].norm();
            sums.iter_mut()
                .zip(column.moments)
                .for_each(|(sum, m)| *sum += m);
        }
        if count == 0.0 {
            return None;
        }
        let [m2_g2, m3_g3, m4_g4] = sums.map(|sum| sum / count);
        let sensitivity = Sensitivity::new(
            a0_g,
            Moments {
                m2_g2,
                m3_g3,
                m4_g4,
                m5_g5: 0.0,
                cross_ip_g2: 0.0,
                cross_io_g2: 0.0,
                cross_po_g2: 0.0,
                m2_p_g2: 0.0,
                m2_o_g2: 0.0,
                kinked: Kinked::Harmonic,
            },
        );
        Some(Self {
            plateau,
            axis,
            level_g: level / count,
            by: PLACES.map(|place| sensitivity.nominal[place]).into(),
        })
    }

    /// Its mean, where nothing else may have shifted it.
    fn mean(&self) -> Option<Mean> {
        let sound = matches!(self.axis.verdict, Verdict::Shift | Verdict::NoShift);
        let (shift_g, sigma_g) = self.axis.shift_g.known()?;
        (sound && sigma_g > 0.0).then_some(Mean {
            by: self.by.into(),
            shift_g,
            sigma_g,
        })
    }

    fn test(&self, alone: &Fit, both: &Fit) -> Test {
        let variance = (self.by.transpose() * alone.covariance * self.by)[0];
        let predicted = self.by.dot(&alone.coefficients);
        let apart = self
            .axis
            .shift_g
            .known()
            .map(|(shift, sigma)| (shift - predicted) / (variance + sigma * sigma).sqrt());
        Test {
            from_s: self.plateau.from_s,
            to_s: self.plateau.to_s,
            level_g: self.level_g,
            predicted_vre_g: Quantity::new(predicted, variance.sqrt()),
            measured_vre_g: self.axis.shift_g,
            sigmas_apart: apart,
            parts_g: std::array::from_fn(|n| {
                let (by, sigma) = (self.by[n], both.covariance[(n, n)].sqrt());
                Quantity::new(by * both.coefficients[n], by.abs() * sigma)
            }),
            mean_used: self.mean().is_some(),
        }
    }
}
