//! Time means over a run's motion.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::LazyLock;

use inference::dense::inner_product;
use inference::model::Fidelity;

use super::finite_record::{ORDERS, correlation_integrals};
use super::motion::Motion;
use super::quadrature::{evenly, gauss_legendre, pieces};
use super::rows::RunConditions;
use crate::campaign::VibrationKind;

/// Nodes on each smooth piece of half a period, and of the normal density between -REACH and REACH standard deviations;
/// those of rough means.
const SINE_NODES: [usize; 2] = [20, 10];
const NORMAL_NODES: [usize; 2] = [60, 30];
/// The same for polynomials up to the sixth degree, evenly spaced: exact for what repeats, and for what dies away but for
/// the cut at REACH.
const EVEN_SINE_NODES: usize = 14;
const EVEN_NORMAL_NODES: usize = 28;
const REACH: f64 = 7.0;
/// Highest moment that the reference reports.
const SEEN: usize = 4;

/// Tables for time means, made once for all runs of a campaign.
#[derive(Debug)]
pub struct Averages {
    /// Nodes and weights of Gauss and Legendre's rule between -1 and 1, for half a period of a sine and for the normal
    /// density.
    sine: [Vec<[f64; 2]>; 2],
    normal: [Vec<[f64; 2]>; 2],
    /// Of each random band the integrals of its autocorrelation's powers.
    integrals: HashMap<[u64; 2], [f64; ORDERS + 1]>,
}

/// The time mean of a function of the specific force over one run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeMean {
    /// Its expectation, given what the reference saw.
    pub value: f64,
    /// Its variance over records that the reference cannot tell apart.
    pub variance: f64,
}

/// 1/sqrt n and sqrt((n-1)/n): h_n = x h_(n-1) / sqrt n - sqrt((n-1)/n) h_(n-2) of the orthonormal Hermite polynomials.
static RECURRENCE: LazyLock<[[f64; 2]; ORDERS + 1]> = LazyLock::new(|| {
    std::array::from_fn(|n| {
        let n = (n as f64).max(1.0);
        [n.sqrt().recip(), ((n - 1.0) / n).sqrt()]
    })
});

impl Averages {
    /// Tables for these runs.
    pub fn new(runs: &[RunConditions]) -> Self {
        let mut integrals = HashMap::new();
        for run in runs.iter().filter(|run| run.kind == VibrationKind::Random) {
            let band = integrals.entry(run.band_hz.map(f64::to_bits));
            band.or_insert_with(|| correlation_integrals(run.band_hz));
        }
        Self {
            sine: SINE_NODES.map(gauss_legendre),
            normal: NORMAL_NODES.map(gauss_legendre),
            integrals,
        }
    }

    /// Integrals of the powers of a random run's autocorrelation, s; `None` for a sine.
    pub(crate) fn integrals(&self, run: &RunConditions) -> Option<&[f64; ORDERS + 1]> {
        match run.kind {
            VibrationKind::Sine => None,
            VibrationKind::Random => self.integrals.get(&run.band_hz.map(f64::to_bits)),
        }
    }

    /// The time mean of `function` over a run with this motion. Between its `kinks`, multiples of the motion's
    /// amplitude where it or its slope jumps, the function is smooth; one without any is a polynomial of the sixth degree at
    /// most. For a first look the nodes are fewer, and there is no variance.
    pub fn mean(
        &self,
        run: &RunConditions,
        motion: &Motion,
        kinks: &[f64],
        fidelity: Fidelity,
        function: impl Fn([f64; 3]) -> f64,
    ) -> TimeMean {
        let screening = fidelity == Fidelity::Screening;
        let (sine, normal) = (
            &self.sine[usize::from(screening)],
            &self.normal[usize::from(screening)],
        );
        let a0 = run.specific_force_g;
        let [i, p, o] = motion.amplitude_g;
        let at = |w: f64| function([a0.i + i * w, a0.p + p * w, a0.o + o * w]);
        if run.kind == VibrationKind::Sine {
            // Half a period passes every value of the whole.
            let mut sum = 0.0;
            let add = |x: f64, width: f64| sum += width * at(motion.at_phase(x));
            if kinks.is_empty() {
                evenly(FRAC_PI_2, EVEN_SINE_NODES, add);
            } else {
                let kinks = kinks.iter().flat_map(|kink| motion.phases(*kink));
                pieces(FRAC_PI_2, kinks, sine, add);
            }
            return TimeMean {
                value: sum / PI,
                variance: 0.0,
            };
        }
        // Nodes, and there the weighted function and the orthonormal Hermite polynomials of two orders.
        let most = normal.len() * (kinks.len() + 1);
        let [mut nodes, mut weighted] = [(); 2].map(|()| Vec::with_capacity(most));
        let mut square = 0.0;
        let add = |x: f64, width: f64| {
            let f = at(x);
            if f != 0.0 {
                let w = f * width * (-0.5 * x * x).exp() / TAU.sqrt();
                square += w * f;
                nodes.push(x);
                weighted.push(w);
            }
        };
        if kinks.is_empty() {
            evenly(REACH, EVEN_NORMAL_NODES, add);
        } else {
            pieces(REACH, kinks.iter().copied(), normal, add);
        }
        let mut before = vec![1.0; nodes.len()];
        let mut last = nodes.clone();
        // The function's coefficients.
        let mut c = [0.0; ORDERS + 1];
        let orders = if screening { SEEN } else { ORDERS };
        c[0] = weighted.iter().sum();
        c[1] = inner_product(&weighted, &last);
        for (c, [of_last, of_before]) in c.iter_mut().zip(&*RECURRENCE).take(orders + 1).skip(2) {
            for ((before, last), x) in before.iter_mut().zip(&last).zip(&nodes) {
                *before = of_last * x * last - of_before * *before;
            }
            std::mem::swap(&mut before, &mut last);
            *c = inner_product(&weighted, &last);
        }
        // M[He_3] is the skewness, M[He_4] the kurtosis less 3 (the mean square is exact).
        let [skew, kurt] = motion.shape;
        let value = c[0] + c[3] * skew / 6f64.sqrt() + c[4] * (kurt - 3.0) / 24f64.sqrt();
        let seen = if run.shape_seen { SEEN } else { 2 };
        let integrals = self.integrals(run).filter(|_| !screening);
        let mut variance = 0.0;
        if let Some(integrals) = integrals {
            let mut left = square - c[..=seen].iter().map(|c| c * c).sum::<f64>();
            for n in seen + 1..=ORDERS {
                variance += c[n] * c[n] * integrals[n] / run.duration_s;
                left -= c[n] * c[n];
            }
            variance += left.max(0.0) * integrals[ORDERS] / run.duration_s;
        }
        TimeMean { value, variance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_nodes_give_the_moments_of_a_sine_and_of_noise() {
        let mut sine = 0.0;
        evenly(FRAC_PI_2, EVEN_SINE_NODES, |x, width| {
            sine += width * x.sin().powi(6)
        });
        assert!((sine / PI - 5.0 / 16.0).abs() < 1e-14);
        let (mut sixth, mut twelfth) = (0.0, 0.0);
        evenly(REACH, EVEN_NORMAL_NODES, |x, width| {
            let density = (-0.5 * x * x).exp() / TAU.sqrt();
            sixth += width * density * x.powi(6);
            twelfth += width * density * x.powi(12);
        });
        assert!((sixth / 15.0 - 1.0).abs() < 1e-7);
        assert!((twelfth / 10_395.0 - 1.0).abs() < 1e-5);
    }
}
