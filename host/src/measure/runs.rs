//! Plateaus of a record as shaker runs of a campaign, with the moments that the reference saw.

use std::path::Path;

use shared::model::SpecificForce;

use super::answer::{Axis, Measurement, Plateau, Verdict};
use super::motion;
use crate::campaign::{
    BEFORE_TO_DURING_S, Measured, ReferenceMoments, Run, UnknownCells, VibrationKind,
};
use crate::error::Error;
use crate::import::{self, Columns};

/// What is known of the record beside its columns.
#[derive(Clone, Debug)]
pub struct Station {
    /// Reference on IA, PA and OA: column and units a g.
    pub reference: [Option<(String, f64)>; 3],
    /// Gravity on IA, PA and OA, g; without it, what the reference shows at rest.
    pub gravity_g: Option<[f64; 3]>,
    /// Unit vector of the motion on IA, PA and OA; without it, what the reference shows.
    pub direction: Option<[f64; 3]>,
    /// Volts a g: how the output in g goes into the campaign's volts.
    pub volts_per_g: f64,
    /// Temperature of the instrument where no column tells it, C.
    pub temperature_c: f64,
}

/// The time between the last run of a campaign and the first of another record, s. Chosen: what is before is over.
pub const APART_S: f64 = 60.0;

/// Share of the largest axis below which a motion across is none that was commanded. Chosen: the cross motion of a shaker is
/// some per cent.
const COMMANDED: f64 = 0.1;

/// Length of gravity that a reference shows which passes a constant acceleration, g.
const GRAVITY: std::ops::Range<f64> = 0.5..1.5;

/// One run for each plateau, numbered from `number` on, the first `from_s` into the campaign. The output during the vibration is
/// that before plus the shift, each with the shift's uncertainty over the root of two. A plateau whose shift is not the
/// vibration's is kept and excluded.
///
/// # Errors
/// The reference's columns cannot be read; a record without time; gravity that is neither told nor seen.
pub fn runs(
    file: &Path,
    columns: &Columns,
    found: &Measurement,
    station: &Station,
    number: u64,
    from_s: f64,
) -> Result<Vec<Run>, Error> {
    let stretches = stretches(file, columns, found, station)?;
    let first = found.plateaus.first().map_or(0.0, middle);
    let plateaus = found.plateaus.iter().zip(&stretches.plateaus).zip(number..);
    let runs = plateaus.map(|((plateau, seen), number)| {
        let axis = plateau.axes.first();
        let usage = |what: &str| {
            let place = format!("plateau at {:.3} s", plateau.from_s);
            Error::input(file, format!("{place}: {what}"))
        };
        let axis = axis.ok_or_else(|| usage("it has no output"))?;
        let band_hz =
            band(plateau).ok_or_else(|| usage("the record has no time, so no frequency"))?;
        let gravity = station.gravity_g.or(stretches.gravity());
        let [i, p, o] = gravity.ok_or_else(|| {
            usage("--gravity I,P,O is needed: the reference shows none at rest on three axes")
        })?;
        let direction = station
            .direction
            .or(seen.direction())
            .unwrap_or([1.0, 0.0, 0.0]);
        Ok(Run {
            run: number,
            time_s: from_s + middle(plateau) - first - BEFORE_TO_DURING_S,
            kind: match plateau.kind {
                motion::Kind::Sine => VibrationKind::Sine,
                motion::Kind::Random => VibrationKind::Random,
            },
            direction,
            level_g: seen.level(plateau.kind).unwrap_or(plateau.level_g),
            band_hz,
            specific_force_g: SpecificForce::new(i, p, o),
            temp_c: seen.temperature().unwrap_or(station.temperature_c),
            duration_s: plateau.to_s - plateau.from_s,
            measured: measured(found, plateau, axis, station),
            reference: seen.moments(&station.reference),
            session: None,
            exclude: plateau.verdict == Verdict::NotAttributable,
            line: 0,
            unknown: UnknownCells::default(),
        })
    });
    runs.collect()
}

fn middle(plateau: &Plateau) -> f64 {
    0.5 * (plateau.from_s + plateau.to_s)
}

fn band(plateau: &Plateau) -> Option<[f64; 2]> {
    plateau.frequency_hz.map(|hz| [hz, hz]).or(plateau.band_hz)
}

/// The output before and during; none where the noise is unknown.
fn measured(
    found: &Measurement,
    plateau: &Plateau,
    axis: &Axis,
    station: &Station,
) -> Option<Measured> {
    let (shift, sigma) = (axis.shift_g.value?, axis.shift_g.sigma?);
    let rests = found
        .segments
        .iter()
        .filter(|segment| segment.role == "rest");
    let before = rests.filter_map(|rest| Some((rest.extent_s?, rest.mean_g.first()?.value?)));
    let near = |extent: &[f64; 2]| (0.5 * (extent[0] + extent[1]) - middle(plateau)).abs();
    let (_, before_g) = before.min_by(|a, b| near(&a.0).total_cmp(&near(&b.0)))?;
    Some(Measured {
        before_v: before_g * station.volts_per_g,
        during_v: (before_g + shift) * station.volts_per_g,
        after_v: None,
        sigma_v: sigma * station.volts_per_g.abs() / 2f64.sqrt(),
        drift: None,
        extremes: None,
    })
}

/// What the reference saw on the plateaus, and at rest.
struct Stretches {
    plateaus: Vec<Seen>,
    rest: Seen,
}

impl Stretches {
    /// Gravity, if the reference has three axes and passes a constant acceleration.
    fn gravity(&self) -> Option<[f64; 3]> {
        let [i, p, o] = [0, 1, 2].map(|axis| self.rest.mean(axis));
        let gravity = [i?, p?, o?];
        let length = gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
        GRAVITY.contains(&length).then_some(gravity)
    }
}

/// Reads the reference, and the temperature.
fn stretches(
    file: &Path,
    columns: &Columns,
    found: &Measurement,
    station: &Station,
) -> Result<Stretches, Error> {
    let mut stretches = Stretches {
        plateaus: vec![Seen::default(); found.plateaus.len()],
        rest: Seen::default(),
    };
    let named = station.reference.iter().flatten();
    let mut outputs: Vec<String> = named.map(|(name, _)| name.clone()).collect();
    if outputs.is_empty() && columns.temperature.is_none() {
        return Ok(stretches);
    }
    if outputs.is_empty() {
        outputs.clone_from(&columns.outputs);
    }
    let mut rows = import::open(
        file,
        &Columns {
            outputs,
            ..columns.clone()
        },
        None,
    )?;
    let rests = found
        .picture
        .as_ref()
        .map_or(&[][..], |picture| &picture.rests_s);
    let mut count = 0u64;
    while rows.advance()? {
        let at = rows.time_s()?.unwrap_or(count as f64);
        count += 1;
        let mut plateaus = found.plateaus.iter().zip(&mut stretches.plateaus);
        let on = plateaus.find(|(p, _)| (p.from_s..=p.to_s).contains(&at));
        let seen = match on {
            Some((_, seen)) => seen,
            None if rests.iter().any(|[from, to]| (*from..=*to).contains(&at)) => {
                &mut stretches.rest
            }
            None => continue,
        };
        let mut values = [0.0; 3];
        let told = station.reference.iter().enumerate();
        for (output, (axis, (_, units))) in
            told.filter_map(|(n, r)| Some((n, r.as_ref()?))).enumerate()
        {
            values[axis] = rows.output(output)? / units;
        }
        seen.add(values, rows.temperature_c()?);
    }
    for (axis, reference) in station.reference.iter().enumerate() {
        let all = stretches.plateaus.iter_mut().chain([&mut stretches.rest]);
        all.for_each(|seen| seen.has[axis] = reference.is_some());
    }
    Ok(stretches)
}

/// Sums of powers about the first sample, which keeps their digits.
#[derive(Clone, Debug, Default)]
struct Seen {
    has: [bool; 3],
    count: f64,
    origin: [f64; 3],
    /// Of each axis, the first to the fourth power.
    powers: [[f64; 4]; 3],
    /// IP, IO, PO.
    products: [f64; 3],
    temperature: (f64, f64),
}

/// Axes of the products.
const PAIRS: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

impl Seen {
    fn add(&mut self, values: [f64; 3], temperature_c: Option<f64>) {
        if self.count == 0.0 {
            self.origin = values;
        }
        self.count += 1.0;
        let off: [f64; 3] = std::array::from_fn(|axis| values[axis] - self.origin[axis]);
        for (powers, x) in self.powers.iter_mut().zip(off) {
            let square = x * x;
            let terms = [x, square, square * x, square * square];
            powers
                .iter_mut()
                .zip(terms)
                .for_each(|(sum, term)| *sum += term);
        }
        for (sum, [a, b]) in self.products.iter_mut().zip(PAIRS) {
            *sum += off[a] * off[b];
        }
        if let Some(temperature) = temperature_c {
            self.temperature.0 += temperature;
            self.temperature.1 += 1.0;
        }
    }

    fn temperature(&self) -> Option<f64> {
        let (sum, count) = self.temperature;
        (count > 0.0).then(|| sum / count)
    }

    fn mean(&self, axis: usize) -> Option<f64> {
        let there = self.has[axis] && self.count > 0.0;
        there.then(|| self.origin[axis] + self.powers[axis][0] / self.count)
    }

    /// Central moments: second, third and fourth.
    fn central(&self, axis: usize) -> [f64; 3] {
        let [m, s2, s3, s4] = self.powers[axis].map(|sum| sum / self.count.max(1.0));
        [
            s2 - m * m,
            s3 - 3.0 * m * s2 + 2.0 * m.powi(3),
            s4 - 4.0 * m * s3 + 6.0 * m * m * s2 - 3.0 * m.powi(4),
        ]
    }

    fn rms(&self) -> Option<[f64; 3]> {
        let some = self.count > 1.0 && self.has.contains(&true);
        some.then(|| std::array::from_fn(|axis| self.central(axis)[0].max(0.0).sqrt()))
    }

    fn covariance(&self, pair: usize) -> f64 {
        let [a, b] = PAIRS[pair];
        let mean = |axis: usize| self.powers[axis][0] / self.count;
        self.products[pair] / self.count - mean(a) * mean(b)
    }

    /// Along the axes that move, with the sign of their correlation with the one that moves most.
    fn direction(&self) -> Option<[f64; 3]> {
        let rms = self.rms()?;
        let main = (0..3).max_by(|&a, &b| rms[a].total_cmp(&rms[b]))?;
        if rms[main] <= 0.0 {
            return None;
        }
        let sign = |axis: usize| {
            let pair = PAIRS
                .iter()
                .position(|p| p.contains(&axis) && p.contains(&main));
            pair.filter(|_| axis != main)
                .map_or(1.0, |pair| self.covariance(pair).signum())
        };
        let along: [f64; 3] = std::array::from_fn(|axis| match rms[axis] < COMMANDED * rms[main] {
            true => 0.0,
            false => sign(axis) * rms[axis],
        });
        let length = along.iter().map(|x| x * x).sum::<f64>().sqrt();
        Some(along.map(|x| x / length))
    }

    /// Level: peak of a sine, rms of random vibration.
    fn level(&self, kind: motion::Kind) -> Option<f64> {
        let rms = self.rms()?.iter().map(|x| x * x).sum::<f64>().sqrt();
        Some(match kind {
            motion::Kind::Sine => 2f64.sqrt() * rms,
            motion::Kind::Random => rms,
        })
    }

    /// Moments of all axes: an axis without a reference stands still.
    fn moments(&self, reference: &[Option<(String, f64)>; 3]) -> Option<ReferenceMoments> {
        let rms_g = self.rms()?;
        let standardized = |axis: usize, order: usize| match rms_g[axis] > 0.0 {
            true => self.central(axis)[order - 2] / rms_g[axis].powi(order as i32),
            false => 0.0,
        };
        let all = reference.iter().all(Option::is_some);
        let correlation = |pair: usize| {
            let [a, b] = PAIRS[pair];
            let scale = rms_g[a] * rms_g[b];
            let r = if scale > 0.0 {
                self.covariance(pair) / scale
            } else {
                0.0
            };
            r.clamp(-1.0, 1.0)
        };
        Some(ReferenceMoments {
            rms_g,
            skewness: std::array::from_fn(|axis| standardized(axis, 3)),
            kurtosis: std::array::from_fn(|axis| standardized(axis, 4)),
            correlation: all.then(|| std::array::from_fn(correlation)),
        })
    }
}
