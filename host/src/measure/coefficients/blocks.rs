//! Harmonics of output and reference in stretches of some periods, along ramps and plateaus.

use std::f64::consts::TAU;
use std::path::Path;

use nalgebra::{Complex, DMatrix};

use super::super::spread::Spread;
use crate::error::Error;
use crate::import::{self, Columns};

/// Highest harmonic in the fit of a block.
pub(super) const HARMONICS: usize = 5;

/// Periods of a block. Chosen: fewer leave the harmonics correlated, more smear a ramp.
const PERIODS: f64 = 8.0;

/// Most blocks, about: those of a long record are longer.
const MOST: f64 = 4096.0;

/// Share of the reference's variance that is its fundamental. Chosen, as for a plateau that is called a sine.
const SINE: f64 = 0.8;

/// Change of the amplitude along a block, of it, from which on it is left out. Chosen: the mean square is then 2 % more than its
/// middle's, at the foot of a ramp, where coefficients make little.
const CHANGE: f64 = 0.5;

/// Amplitude below which a block is left out, of the largest. Chosen: of 2 % the fourth power is nothing.
const FAINT: f64 = 0.02;

/// Highest frequency of a harmonic, of the sample rate: near half the rate a sine and its alias are one.
const HIGHEST: f64 = 0.48;

/// Where the motion is seen.
#[derive(Clone, Debug)]
pub struct Source {
    /// Column of the reference on IA.
    pub column: String,
    /// Its units a g.
    pub units_per_g: f64,
    /// Units of the output a g.
    pub output_units_per_g: f64,
    /// The reference's axes across, and their units a g.
    pub across: Vec<(String, f64)>,
    /// Standard uncertainty of what the reference itself distorts at the largest amplitude, as a share of it.
    pub distortion: f64,
    /// Gravity on IA, g; without it, the output's mean at rest.
    pub gravity_g: Option<f64>,
}

/// A drive: a frequency, and from when to when it was found steady.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tone {
    pub frequency_hz: f64,
    pub from_s: f64,
    pub to_s: f64,
}

/// Complex amplitudes of one block, x(t) = Re sum_k X_k exp(i k w t), t from the middle of the block.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// The middle, s.
    pub at_s: f64,
    /// Place of its tone.
    pub tone: usize,
    /// Of the reference from the fundamental on, g; 0 of harmonics that the rate does not allow.
    pub reference_g: [Complex<f64>; HARMONICS],
    /// Of the output, g.
    pub output_g: [Complex<f64>; HARMONICS],
    /// Change of the reference's fundamental, g/s.
    pub slope_g_per_s: Complex<f64>,
}

/// The blocks of a record.
pub(super) struct Blocks {
    pub list: Vec<Block>,
    /// Their length, s.
    pub length_s: f64,
    /// Harmonics that the sample rate allows.
    pub orders: usize,
    /// Rms of the reference's further axes on the plateaus, the largest, g; none without such axes.
    pub across_g: Option<f64>,
}

/// Samples of one block: time, output, reference.
type Samples = Vec<[f64; 3]>;

/// Reads the blocks in which the reference is a sine of one of the `tones`; `extent_s` is the record's length.
pub(super) fn read(
    file: &Path,
    columns: &Columns,
    source: &Source,
    tones: &[Tone],
    extent_s: f64,
) -> Result<Blocks, Error> {
    let slowest = tones.iter().map(|tone| tone.frequency_hz);
    let slowest = slowest.fold(f64::INFINITY, f64::min);
    let length_s = (PERIODS / slowest).max(extent_s / MOST);
    let output = columns.outputs.iter().take(1);
    let axes = source.across.iter().map(|axis| &axis.0);
    let outputs = output
        .chain([&source.column])
        .chain(axes)
        .cloned()
        .collect();
    let columns = Columns {
        outputs,
        temperature: None,
        ..columns.clone()
    };
    let mut rows = import::open(file, &columns, None)?;
    let mut list: Vec<Block> = Vec::new();
    let mut orders = HARMONICS;
    let mut across = vec![Spread::default(); source.across.len()];
    let (mut samples, mut start, mut count) = (Samples::new(), f64::NEG_INFINITY, 0u64);
    loop {
        let more = rows.advance()?;
        let at = match more {
            true => rows.time_s()?.unwrap_or(count as f64),
            false => f64::INFINITY,
        };
        count += 1;
        // A time that runs back begins a block, as a gap does.
        if !(start..start + length_s).contains(&at) {
            let whole = samples
                .last()
                .is_some_and(|last| last[0] - start > 0.9 * length_s);
            if let Some((block, allowed)) = whole
                .then(|| block(&samples, tones, length_s, orders))
                .flatten()
            {
                list.push(block);
                orders = allowed;
            }
            samples.clear();
            start = at;
        }
        if !more {
            break;
        }
        let reference = rows.output(1)? / source.units_per_g;
        samples.push([at, rows.output(0)? / source.output_units_per_g, reference]);
        if tones.iter().any(|tone| tone.has(at)) {
            for (axis, (spread, (_, units))) in across.iter_mut().zip(&source.across).enumerate() {
                spread.add(rows.output(2 + axis)? / units);
            }
        }
    }
    let largest = list.iter().map(|b| b.reference_g[0].norm());
    let largest = largest.fold(0.0, f64::max);
    list.retain(|block| block.reference_g[0].norm() > FAINT * largest);
    let across_g = across.iter().map(Spread::standard_deviation);
    Ok(Blocks {
        list,
        length_s,
        orders,
        across_g: across_g.reduce(f64::max),
    })
}

impl Tone {
    fn has(&self, at_s: f64) -> bool {
        (self.from_s..=self.to_s).contains(&at_s)
    }

    /// How far away in time it is, s.
    fn away(&self, at_s: f64) -> f64 {
        (self.from_s - at_s).max(at_s - self.to_s).max(0.0)
    }
}

/// One block by least squares: a line, the harmonics, and a fundamental whose amplitude changes; also how many harmonics its
/// rate allows. `None` where the reference is not a steady sine.
fn block(samples: &Samples, tones: &[Tone], length_s: f64, most: usize) -> Option<(Block, usize)> {
    let middle = 0.5 * (samples.first()?[0] + samples.last()?[0]);
    let nearest = tones.iter().enumerate();
    let (tone, drive) = nearest.min_by(|a, b| a.1.away(middle).total_cmp(&b.1.away(middle)))?;
    let cycles = drive.frequency_hz * length_s / samples.len() as f64;
    let orders = (1..=most).take_while(|&k| k as f64 * cycles < HIGHEST);
    let orders = orders.count();
    let size = 2 * orders + 4;
    if orders == 0 || samples.len() < 2 * size {
        return None;
    }
    let mut normal = DMatrix::<f64>::zeros(size, size);
    let mut right = DMatrix::<f64>::zeros(size, 2);
    let mut row = vec![1.0; size];
    for &[at, output, reference] in samples {
        let x = (at - middle) / length_s;
        let (sine, cosine) = (TAU * drive.frequency_hz * (at - middle)).sin_cos();
        let (mut s, mut c) = (sine, cosine);
        for k in 0..orders {
            (row[2 * k], row[2 * k + 1]) = (c, s);
            (c, s) = (c * cosine - s * sine, s * cosine + c * sine);
        }
        let rest = [x * cosine, x * sine, 1.0, x];
        row[2 * orders..].copy_from_slice(&rest);
        for a in 0..size {
            right[(a, 0)] += row[a] * output;
            right[(a, 1)] += row[a] * reference;
            for b in 0..=a {
                normal[(a, b)] += row[a] * row[b];
            }
        }
    }
    normal.fill_upper_triangle_with_lower_triangle();
    let found = normal.cholesky()?.solve(&right);
    let amplitudes = |column: usize| {
        std::array::from_fn(|k| match k < orders {
            true => Complex::new(found[(2 * k, column)], -found[(2 * k + 1, column)]),
            false => Complex::default(),
        })
    };
    let reference_g: [Complex<f64>; HARMONICS] = amplitudes(1);
    let change = Complex::new(found[(2 * orders, 1)], -found[(2 * orders + 1, 1)]);
    let spread: Spread = samples.iter().map(|sample| sample[2]).collect();
    let strength = reference_g[0].norm();
    let sine = 0.5 * strength * strength > SINE * spread.standard_deviation().powi(2);
    (sine && change.norm() < CHANGE * strength).then_some((
        Block {
            at_s: middle,
            tone,
            reference_g,
            output_g: amplitudes(0),
            slope_g_per_s: change / length_s,
        },
        orders,
    ))
}
