//! From the shaker's drive to the voltage: the links of the chain in their order.

use std::ops::Range;

use shared::model::{Coefficients, SpecificForce};

use super::effects::{Block, Effect};
use super::plan::Shake;
use super::shaker::{Record, Shaker};

/// Samples that are taken through the chain at once.
const BLOCK: usize = 1024;

/// One run's vibration, at the table and at the instrument.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Of the table, along the commanded direction, as the reference sees it, g.
    pub reference: Record,
    /// Of the instrument, along the same direction, g.
    pub instrument: Record,
    /// The instrument's vibration behind the response of each effect that has one.
    states: Vec<Option<Record>>,
    /// Components on IA, PA, OA of the direction of motion; not a unit vector if the table is not guided.
    pub direction: [f64; 3],
}

impl Motion {
    /// What a drive becomes on its way to the instrument.
    pub fn new(
        shaker: &mut Shaker,
        shake: &Shake,
        mut drive: Record,
        effects: &[Box<dyn Effect>],
    ) -> Self {
        let rms_g = drive.rms();
        let mut direction = shake.direction;
        let mut scale = 1.0;
        for effect in effects {
            effect.drive(&mut drive.samples, rms_g);
            direction = effect.direction(direction);
            scale *= effect.motion_scale();
        }
        let reference = drive;
        let mut instrument = reference.clone();
        if scale != 1.0 {
            instrument.samples.iter_mut().for_each(|w| *w *= scale);
        }
        for effect in effects
            .iter()
            .filter(|effect| effect.fixture(0.0).is_some())
        {
            instrument =
                shaker.filter(&instrument, |f_hz| effect.fixture(f_hz).unwrap_or_default());
        }
        let states = effects.iter().map(|effect| {
            effect.response(0.0)?;
            let response = |f_hz| effect.response(f_hz).unwrap_or_default();
            Some(shaker.filter(&instrument, response))
        });
        let states = states.collect();
        Self {
            reference,
            instrument,
            states,
            direction,
        }
    }

    /// No motion at all: one sample of rest.
    pub fn rest(effects: &[Box<dyn Effect>]) -> Self {
        let still = Record {
            fundamental_hz: 1.0,
            samples: vec![0.0],
        };
        let states = effects
            .iter()
            .map(|effect| effect.response(0.0).map(|_| still.clone()));
        Self {
            states: states.collect(),
            reference: still.clone(),
            instrument: still,
            direction: [0.0; 3],
        }
    }

    /// Samples in the record.
    pub fn sample_count(&self) -> usize {
        self.instrument.samples.len()
    }

    /// The stretch of motion from `before` to `after` samples about sample `centre`, `fine` times finer, by
    /// eight-point Lagrange interpolation of the periodic records.
    fn magnified(&self, centre: usize, reach: usize, fine: usize) -> Self {
        let magnify = |record: &Record| Record {
            fundamental_hz: record.fundamental_hz,
            samples: (0..=2 * reach * fine)
                .map(|n| {
                    let count = record.samples.len();
                    let position = (count + centre - reach) as f64 + n as f64 / fine as f64;
                    let first = position.floor() as usize;
                    lagrange(position - first as f64, |k| {
                        record.samples[(first + count + k - 3) % count]
                    })
                })
                .collect(),
        };
        Self {
            reference: magnify(&self.reference),
            instrument: magnify(&self.instrument),
            states: self
                .states
                .iter()
                .map(|state| state.as_ref().map(magnify))
                .collect(),
            direction: self.direction,
        }
    }
}

/// Interpolates eight equidistant samples between the fourth (`fraction` 0) and the fifth (1).
fn lagrange(fraction: f64, sample: impl Fn(usize) -> f64) -> f64 {
    let weight = |k: usize| {
        let others = (0..8).filter(|&j| j != k);
        others
            .map(|j| (fraction + 3.0 - j as f64) / (k as f64 - j as f64))
            .product::<f64>()
    };
    (0..8).map(|k| weight(k) * sample(k)).sum()
}

/// What is constant while a stretch of samples is taken.
#[derive(Clone, Copy, Debug, Default)]
pub struct Constant {
    /// Gravity on IA, PA, OA, g.
    pub a0_g: [f64; 3],
    /// Slow shift of the output, g.
    pub shift_g: f64,
    /// Relative error of the scale factor.
    pub scale_error: f64,
    /// Temperature less the reference temperature, K.
    pub excess_k: f64,
}

/// The instrument and its converter.
#[derive(Clone, Copy)]
pub struct Chain<'a> {
    /// The model (1) that the instrument obeys.
    pub coefficients: &'a Coefficients<f64>,
    /// What it does besides.
    pub effects: &'a [Box<dyn Effect>],
}

/// What a plateau of samples comes to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Mean of what the converter saw, g.
    pub mean_g: f64,
    /// Least output before the converter, g.
    pub minimum_g: f64,
    /// Greatest output before the converter, g.
    pub maximum_g: f64,
}

impl Chain<'_> {
    /// The instrument's output u = U/K1 before the converter for a stretch of at most [`BLOCK`] samples.
    fn analogue(
        &self,
        motion: &Motion,
        range: Range<usize>,
        constant: &Constant,
        force_g: &mut [[f64; BLOCK]; 3],
        output_g: &mut [f64],
    ) {
        let count = range.len();
        let vibration_g = &motion.instrument.samples[range.clone()];
        let [i, p, o] = force_g;
        let (i, p, o) = (&mut i[..count], &mut p[..count], &mut o[..count]);
        for ((axis, a0), n) in [&mut *i, &mut *p, &mut *o]
            .into_iter()
            .zip(constant.a0_g)
            .zip(motion.direction)
        {
            for (a, w) in axis.iter_mut().zip(vibration_g) {
                *a = a0 + n * w;
            }
        }
        let state = |index: usize| match &motion.states[index] {
            Some(record) => &record.samples[range.clone()],
            None => &[],
        };
        for (index, effect) in self.effects.iter().enumerate() {
            effect.force_i(state(index), i);
        }
        for (((out, i), p), o) in output_g.iter_mut().zip(&*i).zip(&*p).zip(&*o) {
            *out = self.coefficients.output_g(SpecificForce::new(*i, *p, *o));
        }
        for (index, effect) in self.effects.iter().enumerate() {
            let block = Block {
                force_g: [i, p, o],
                vibration_g,
                state: state(index),
                direction: motion.direction,
                excess_k: constant.excess_k,
            };
            effect.output(&block, output_g);
        }
        if constant.shift_g != 0.0 || constant.scale_error != 0.0 {
            let scale = 1.0 + constant.scale_error;
            output_g
                .iter_mut()
                .for_each(|out| *out = scale * (*out + constant.shift_g));
        }
        for effect in self.effects {
            effect.limit(output_g);
        }
    }

    /// Output of the converter's input stage, g, for samples `range` of a motion, into `output_g`.
    pub fn output_g(
        &self,
        motion: &Motion,
        range: Range<usize>,
        constant: &Constant,
        output_g: &mut [f64],
    ) {
        let mut force_g = [[0.0; BLOCK]; 3];
        for (first, output_g) in range.step_by(BLOCK).zip(output_g.chunks_mut(BLOCK)) {
            let stretch = first..first + output_g.len();
            self.analogue(motion, stretch, constant, &mut force_g, output_g);
            for effect in self.effects {
                effect.convert(output_g);
            }
        }
    }

    /// Mean and extremes over the whole of a motion. The extremes are found between samples too.
    pub fn summary(&self, motion: &Motion, constant: &Constant) -> Summary {
        let mut force_g = [[0.0; BLOCK]; 3];
        let mut output_g = [0.0; BLOCK];
        let (mut minimum, mut maximum) = ((f64::INFINITY, 0), (f64::NEG_INFINITY, 0));
        let mut sum = 0.0;
        for first in (0..motion.sample_count()).step_by(BLOCK) {
            let stretch = first..(first + BLOCK).min(motion.sample_count());
            let output_g = &mut output_g[..stretch.len()];
            self.analogue(motion, stretch, constant, &mut force_g, output_g);
            for (n, &out) in output_g.iter().enumerate() {
                if out < minimum.0 {
                    minimum = (out, first + n);
                }
                if out > maximum.0 {
                    maximum = (out, first + n);
                }
            }
            for effect in self.effects {
                effect.convert(output_g);
            }
            sum += output_g.iter().sum::<f64>();
        }
        let (mut minimum_g, mut maximum_g) = (minimum.0, maximum.0);
        if motion.sample_count() > 1 {
            for centre in [minimum.1, maximum.1] {
                let near = motion.magnified(centre, 1, 16);
                let output_g = &mut output_g[..near.sample_count()];
                self.analogue(
                    &near,
                    0..near.sample_count(),
                    constant,
                    &mut force_g,
                    output_g,
                );
                minimum_g = output_g.iter().copied().fold(minimum_g, f64::min);
                maximum_g = output_g.iter().copied().fold(maximum_g, f64::max);
            }
        }
        Summary {
            mean_g: sum / motion.sample_count() as f64,
            minimum_g,
            maximum_g,
        }
    }
}
