//! The triaxial reference accelerometer on the table.

use super::chain::Motion;
use super::devices::Reference;
use super::noise::Stream;
use super::shaker::Record;

/// Samples, at least, that a reference with noise of its own takes in a run: 8 s at its logger's 8 kHz.
const NOISY_SAMPLES: usize = 1 << 16;

/// What it tells of one run, on IA, PA, OA.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Rms value, g, within the reference's relative uncertainty.
    pub rms_g: [f64; 3],
    /// Third standardized moment of this very record; 0 on an axis that stands still.
    pub skewness: [f64; 3],
    /// Fourth standardized moment (1.5 for a sine, near 3 for noise); 0 on an axis that stands still.
    pub kurtosis: [f64; 3],
    /// Correlation coefficients IA-PA, IA-OA, PA-OA; 0 where an axis stands still.
    pub correlation: [f64; 3],
}

/// The reference's view of a motion. The scale of each axis is off by the relative standard uncertainty
/// `rms_rel_sigma`, anew in every run.
pub fn look(
    motion: &Motion,
    reference: &Reference,
    rms_rel_sigma: f64,
    stream: &mut Stream,
) -> Seen {
    let direction = reference.seen(motion.direction);
    // Drawn for every axis, so that a run that moves more axes does not shift the errors of the others.
    let scale = [(); 3].map(|()| 1.0 + rms_rel_sigma * stream.normal());
    let seen = if reference.noise_g == 0.0 {
        in_proportion(&motion.reference, direction)
    } else {
        noisy(&motion.reference, direction, reference.noise_g, stream)
    };
    Seen {
        rms_g: std::array::from_fn(|axis| seen.rms_g[axis] * scale[axis]),
        ..seen
    }
}

/// Root of the mean square about the mean, and third and fourth standardized moments.
fn moments(samples: &[f64]) -> [f64; 3] {
    let count = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / count;
    let (mut m2, mut m3, mut m4) = (0.0, 0.0, 0.0);
    for sample in samples {
        let w = sample - mean;
        let square = w * w;
        m2 += square;
        m3 += square * w;
        m4 += square * square;
    }
    let (m2, m3, m4) = (m2 / count, m3 / count, m4 / count);
    [m2.sqrt(), m3 / m2.powf(1.5), m4 / (m2 * m2)]
}

/// Without noise the axes move in proportion, so that one record's moments serve all. An axis that stands still has the
/// sign 0.
fn in_proportion(record: &Record, direction: [f64; 3]) -> Seen {
    let [rms_g, skewness, kurtosis] = moments(&record.samples);
    let sign = direction.map(|n| if n == 0.0 { 0.0 } else { n.signum() });
    Seen {
        rms_g: direction.map(|n| n.abs() * rms_g),
        skewness: sign.map(|sign| sign * skewness),
        kurtosis: sign.map(|sign| sign.abs() * kurtosis),
        correlation: PAIRS.map(|(one, other)| sign[one] * sign[other]),
    }
}

/// With white Gaussian noise on every axis, sample by sample.
fn noisy(record: &Record, direction: [f64; 3], noise_g: f64, stream: &mut Stream) -> Seen {
    let period = &record.samples;
    let count = period.len() * NOISY_SAMPLES.div_ceil(period.len());
    let axes = direction.map(|n| {
        let motion = period.iter().cycle().take(count);
        let sensed = motion.map(|w| n * w + noise_g * stream.normal());
        sensed.collect::<Vec<f64>>()
    });
    let each = axes.each_ref().map(|axis| moments(axis));
    let correlation = PAIRS.map(|(one, other)| {
        let products = axes[one].iter().zip(&axes[other]).map(|(a, b)| a * b);
        products.sum::<f64>() / count as f64 / each[one][0] / each[other][0]
    });
    Seen {
        rms_g: each.map(|[rms_g, ..]| rms_g),
        skewness: each.map(|[_, skewness, _]| skewness),
        kurtosis: each.map(|[.., kurtosis]| kurtosis),
        correlation,
    }
}

/// IA-PA, IA-OA, PA-OA.
const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::noise::Seed;

    /// A sine of 1 g in a direction across OA.
    fn motion() -> Motion {
        let mut motion = Motion::rest(&[]);
        let step = std::f64::consts::TAU / 4096.0;
        motion.reference.samples = (0..4096).map(|n| (step * f64::from(n)).sin()).collect();
        motion.direction = [0.6, -0.8, 0.0];
        motion
    }

    fn seen(reference: &Reference) -> Seen {
        look(
            &motion(),
            reference,
            0.0,
            &mut Seed(2).stream("reference", 0),
        )
    }

    /// Sums of independent variables add their cumulants: a sine's are A^2/2 and -3 A^4/8, a Gaussian's s^2 and 0.
    #[test]
    fn noise_adds_to_the_cumulants_of_the_motion_and_is_all_that_an_axis_at_rest_reads() {
        let noise_g = 0.2;
        let found = seen(&Reference {
            noise_g,
            ..Reference::default()
        });
        for (axis, amplitude_g) in [0.6, 0.8, 0.0_f64].into_iter().enumerate() {
            let variance = amplitude_g.powi(2) / 2.0 + noise_g.powi(2);
            assert!((found.rms_g[axis] / variance.sqrt() - 1.0).abs() < 0.01);
            let excess = -3.0 / 8.0 * amplitude_g.powi(4) / variance.powi(2);
            assert!((found.kurtosis[axis] - 3.0 - excess).abs() < 0.08);
        }
        let driven = 0.6 * 0.8 / 2.0 / (0.18 + 0.04_f64).sqrt() / (0.32 + 0.04_f64).sqrt();
        assert!((found.correlation[0] + driven).abs() < 0.01);
        assert!(found.correlation[1].abs() < 0.02);
    }

    #[test]
    fn a_little_noise_leaves_what_a_quiet_reference_sees() {
        let quiet = seen(&Reference::default());
        let noisy = seen(&Reference {
            noise_g: 1e-9,
            ..Reference::default()
        });
        for axis in 0..2 {
            assert!((noisy.rms_g[axis] - quiet.rms_g[axis]).abs() < 1e-9);
            assert!((noisy.kurtosis[axis] - quiet.kurtosis[axis]).abs() < 1e-7);
        }
        assert!((noisy.correlation[0] - quiet.correlation[0]).abs() < 1e-7);
    }

    #[test]
    fn cross_sensitivity_moves_an_axis_at_rest_and_a_negative_gain_turns_a_correlation_over() {
        let found = seen(&Reference {
            response: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.01, 0.0, 1.0]],
            ..Reference::default()
        });
        assert!((found.rms_g[2] - 0.006 * 0.5_f64.sqrt()).abs() < 1e-12);
        assert_eq!(found.correlation, [1.0, 1.0, 1.0]);
        assert_eq!(seen(&Reference::default()).correlation, [-1.0, 0.0, 0.0]);
    }
}
