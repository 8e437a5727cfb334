//! What the converter's inputs see on the virtual bench: the instrument's output and the triaxial reference, as
//! waveforms at the converter's own pace.

use super::chain::{Chain, Constant, Motion};
use super::converter::Signal;
use super::noise::Stream;
use crate::front_end::FrontEnd;

/// The virtual bench's own front end: its instruments reach some ten volts, its converter 1.2 V.
pub const FRONT_END: FrontEnd = FrontEnd {
    divider: 10.0,
    gain: 1.0,
};

/// Sensitivity of the virtual bench's reference accelerometer at the converter, V/g.
pub const REFERENCE_V_PER_G: f64 = 0.1;

/// Samples of reference noise that are used again and again.
const REFERENCE_NOISE: usize = 1 << 14;

/// Standard deviation of the reference's noise at each sample, g.
const REFERENCE_NOISE_G: f64 = 1e-4;

/// One steady state of the bench, for as long as anyone looks: a dwell at a dial mark, or a vibration whose periodic
/// record is repeated.
pub struct Excitation {
    /// Volts of the four channels over one period, without noise.
    period_v: Vec<[f64; 4]>,
    at: usize,
    noise_v: f64,
    stream: Stream,
    reference_noise_v: Vec<f64>,
}

impl Excitation {
    /// The converter's view of a `motion`, whose records must be at the rate that the converter asks for.
    ///
    /// `noise_v`: standard deviation of the instrument's noise at each of those samples, V at its output;
    /// `reference_scale`: true scale of each axis of the reference over the nominal one.
    pub fn new(
        chain: &Chain<'_>,
        motion: &Motion,
        constant: &Constant,
        noise_v: f64,
        reference_scale: [f64; 3],
        mut stream: Stream,
    ) -> Self {
        let count = motion.sample_count();
        let mut output_g = vec![0.0; count];
        chain.output_g(motion, 0..count, constant, &mut output_g);
        let k1 = FRONT_END.converter_v(chain.coefficients.scale_factor_v_per_g);
        let seen = |axis: usize, w: f64| {
            let force_g = constant.a0_g[axis] + motion.direction[axis] * w;
            REFERENCE_V_PER_G * reference_scale[axis] * force_g
        };
        let period_v = output_g
            .iter()
            .zip(&motion.reference.samples)
            .map(|(u, w)| [k1 * u, seen(0, *w), seen(1, *w), seen(2, *w)])
            .collect();
        let reference_noise_v = (0..REFERENCE_NOISE)
            .map(|_| REFERENCE_V_PER_G * REFERENCE_NOISE_G * stream.normal())
            .collect();
        Self {
            period_v,
            at: 0,
            noise_v: FRONT_END.converter_v(noise_v),
            stream,
            reference_noise_v,
        }
    }
}

impl Signal for Excitation {
    fn fill(&mut self, _start_s: f64, _rate_hz: f64, out: &mut [[f64; 4]]) {
        for volts in out {
            let noise =
                |axis: usize| self.reference_noise_v[(self.at + axis * 4801) % REFERENCE_NOISE];
            let [u, i, p, o] = self.period_v[self.at % self.period_v.len()];
            *volts = [
                u + self.noise_v * self.stream.normal(),
                i + noise(1),
                p + noise(2),
                o + noise(3),
            ];
            self.at += 1;
        }
    }
}
