//! How the instrument moves in a run, and time means over that motion.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::LazyLock;

use shared::model::{NOMINAL, SpecificForce};
use shared::rectification::Sensitivity;
use shared::vibration::{Harmonic, Kinked, KinkedMeans, Moments};

use super::dense::inner_product;
use crate::campaign::{Run, VibrationKind};
use crate::finite_record::{ORDERS, correlation_integrals};

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

/// Motion of the instrument in one run, along one line in the three axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Signed peak (sine) or rms (random) on IA, PA, OA, g.
    pub amplitude_g: [f64; 3],
    /// Second harmonic relative to a sine's amplitude, in the phase that lifts the positive peak.
    pub second_harmonic: f64,
    /// Third and fourth standardized moments of a random record along the line.
    pub shape: [f64; 2],
    /// Relative variance of the mean square, from a spectrum that nobody measured.
    pub power_variance: f64,
}

impl Motion {
    /// The commanded motion, a random record's shape as the reference saw it.
    pub fn commanded(run: &Run) -> Self {
        let axis = main_axis(&run.direction);
        let shape = match (&run.reference, run.kind) {
            (Some(seen), VibrationKind::Random) if seen.kurtosis[axis] > 0.0 => [
                seen.skewness[axis] * run.direction[axis].signum(),
                seen.kurtosis[axis],
            ],
            _ => [0.0, 3.0],
        };
        Self {
            amplitude_g: run.direction.map(|n| n * run.level_g),
            second_harmonic: 0.0,
            shape,
            power_variance: 0.0,
        }
    }

    /// The same motion `factor` times as large.
    pub fn scale(&mut self, factor: f64) {
        self.amplitude_g = self.amplitude_g.map(|w| w * factor);
    }

    /// Multiple of the amplitude at which the specific force along IA, `a0_i_g` at rest, is zero; infinite if it never is.
    pub fn zero(&self, a0_i_g: f64) -> f64 {
        -a0_i_g / self.amplitude_g[0]
    }

    /// Multiple of a sine's amplitude, its second harmonic included, at a phase.
    pub fn at_phase(&self, phase_rad: f64) -> f64 {
        self.at_sine(phase_rad.sin())
    }

    /// The same where the phase has this sine.
    fn at_sine(&self, sine: f64) -> f64 {
        sine - self.second_harmonic * (1.0 - 2.0 * sine * sine)
    }

    /// Multiples of a sine's amplitude, its second harmonic included, at which IA feels most and least.
    pub fn extremes(&self) -> [f64; 2] {
        let h = self.second_harmonic;
        // From a quarter on it turns between the quarter periods as well.
        let turn = self.at_sine((-0.25 / h).clamp(-1.0, 1.0));
        let (least, most) = (turn.min(h - 1.0), turn.max(h + 1.0));
        if self.amplitude_g[0] < 0.0 {
            [least, most]
        } else {
            [most, least]
        }
    }

    /// Derivatives of the vibration error by the nominal coefficients.
    pub fn sensitivity(&self, run: &Run) -> [f64; NOMINAL] {
        let [i, p, o] = self.amplitude_g;
        let moments: Moments<f64> = match run.kind {
            VibrationKind::Sine if self.second_harmonic == 0.0 => Harmonic {
                amplitude_g: SpecificForce::new(i, p, o),
            }
            .into(),
            VibrationKind::Sine => self.distorted(run.specific_force_g.i),
            VibrationKind::Random => {
                let line = |x: f64, y: f64| if x * y == 0.0 { 0.0 } else { (x * y).signum() };
                Moments::near_gaussian(
                    SpecificForce::new(i.abs(), p.abs(), o.abs()),
                    [line(i, p), line(i, o), line(p, o)],
                    self.shape[0] * i.signum(),
                    self.shape[1],
                )
            }
        };
        Sensitivity::new(run.specific_force_g.i, moments).nominal
    }

    /// Moments of s - h cos 2x, s = sin x: M[s^2 cos 2x] = -1/4 and M[s^2 cos^2 2x] = 1/4.
    fn distorted(&self, a0: f64) -> Moments<f64> {
        let [i, p, o] = self.amplitude_g;
        let h = self.second_harmonic;
        let h2 = h * h;
        let m2 = 0.5 * (1.0 + h2);
        Moments {
            m2_g2: m2 * i * i,
            m3_g3: 0.75 * h * i * i * i,
            m4_g4: (0.375 * (1.0 + h2 * h2) + 1.5 * h2) * i * i * i * i,
            m5_g5: 0.0,
            cross_ip_g2: m2 * i * p,
            cross_io_g2: m2 * i * o,
            cross_po_g2: m2 * p * o,
            m2_p_g2: m2 * p * p,
            m2_o_g2: m2 * o * o,
            kinked: Kinked::Measured(self.distorted_kinks(a0)),
        }
    }

    /// Means of sign(a), |a| and a|a| from the integrals of 1, a and a^2 over the pieces of half a period, which passes every
    /// value of the whole, on which a = a0 + i (sin x - h cos 2x) keeps its sign.
    fn distorted_kinks(&self, a0: f64) -> KinkedMeans<f64> {
        let [i, h] = [self.amplitude_g[0], self.second_harmonic];
        let integrals = |x: f64| {
            let [c1, c3] = [x, 3.0 * x].map(f64::cos);
            let [s2, s4] = [2.0 * x, 4.0 * x].map(f64::sin);
            let vibration = -c1 - 0.5 * h * s2;
            let square = 0.5 * x - 0.25 * s2 + h * (c3 / 3.0 - c1) + h * h * (0.5 * x + 0.125 * s4);
            [
                x,
                a0 * x + i * vibration,
                a0 * a0 * x + 2.0 * a0 * i * vibration + i * i * square,
            ]
        };
        let mut sums = [0.0; 3];
        let mut from = -FRAC_PI_2;
        for to in self.phases(self.zero(a0)).into_iter().chain([FRAC_PI_2]) {
            let middle = a0 + i * self.at_phase(0.5 * (from + to));
            let sign = f64::from(middle > 0.0) - f64::from(middle < 0.0);
            let piece = integrals(to).into_iter().zip(integrals(from));
            for (sum, (to, from)) in sums.iter_mut().zip(piece) {
                *sum += sign * (to - from);
            }
            from = to;
        }
        let [sign, absolute_g, signed_square_g2] = sums.map(|sum| sum / PI);
        KinkedMeans {
            sign,
            absolute_g: absolute_g - a0.abs(),
            signed_square_g2: signed_square_g2 - a0 * a0.abs(),
        }
    }

    /// Phases in half a period, in their order, at which a sine with its second harmonic passes a multiple of the amplitude.
    fn phases(&self, multiple: f64) -> Vec<f64> {
        // 2 h s^2 + s - (h + multiple) = 0: by the root that does not cancel, and the other one from their product.
        let h = self.second_harmonic;
        let root = 0.5 * (1.0 + (1.0 + 8.0 * h * (h + multiple)).sqrt());
        let mut sines = [(h + multiple) / root, -root / (2.0 * h)];
        sines.sort_by(f64::total_cmp);
        let passed = sines.into_iter().filter(|sine| sine.abs() < 1.0);
        passed.map(f64::asin).collect()
    }
}

/// The axis with the largest component, the first of equals.
pub fn main_axis(direction: &[f64; 3]) -> usize {
    let largest = direction.iter().fold(0.0_f64, |most, n| most.max(n.abs()));
    let found = direction.iter().position(|n| n.abs() > largest - 1e-6);
    found.unwrap_or(0)
}

/// Tables for time means, made once for all runs of a campaign.
#[derive(Debug)]
pub struct Averages {
    /// Nodes and weights of Gauss and Legendre's rule between -1 and 1, for half a period of a sine and for the normal
    /// density.
    sine: Vec<[f64; 2]>,
    normal: Vec<[f64; 2]>,
    /// Of each random band the integrals of its autocorrelation's powers.
    integrals: Vec<([f64; 2], [f64; ORDERS + 1])>,
    /// Whether means are rough ones, without their variance: grids are gone over for a start.
    pub rough: bool,
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
    pub fn new<'r>(runs: impl Iterator<Item = &'r Run>) -> Self {
        let mut integrals: Vec<([f64; 2], _)> = Vec::new();
        for run in runs.filter(|run| run.kind == VibrationKind::Random) {
            if !integrals.iter().any(|(band, _)| *band == run.band_hz) {
                integrals.push((run.band_hz, correlation_integrals(run.band_hz)));
            }
        }
        Self {
            sine: gauss_legendre(SINE_NODES[0]),
            normal: gauss_legendre(NORMAL_NODES[0]),
            integrals,
            rough: false,
        }
    }

    /// Tables for rough means.
    pub fn rough() -> Self {
        Self {
            sine: gauss_legendre(SINE_NODES[1]),
            normal: gauss_legendre(NORMAL_NODES[1]),
            integrals: Vec::new(),
            rough: true,
        }
    }

    /// The time mean of `function` over a run with this motion. Between its `kinks`, multiples of the motion's
    /// amplitude where it or its slope jumps, the function is smooth; one without any is a polynomial of the sixth degree at
    /// most.
    pub fn mean(
        &self,
        run: &Run,
        motion: &Motion,
        kinks: &[f64],
        function: impl Fn([f64; 3]) -> f64,
    ) -> TimeMean {
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
                pieces(FRAC_PI_2, kinks, &self.sine, add);
            }
            return TimeMean {
                value: sum / PI,
                variance: 0.0,
            };
        }
        // Nodes, and there the weighted function and the orthonormal Hermite polynomials of two orders.
        let most = self.normal.len() * (kinks.len() + 1);
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
            pieces(REACH, kinks.iter().copied(), &self.normal, add);
        }
        let mut before = vec![1.0; nodes.len()];
        let mut last = nodes.clone();
        // The function's coefficients.
        let mut c = [0.0; ORDERS + 1];
        let orders = if self.rough { SEEN } else { ORDERS };
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
        let seen = if run.reference.is_some() { SEEN } else { 2 };
        let integrals = self.integrals.iter().find(|(band, _)| *band == run.band_hz);
        let mut variance = 0.0;
        if let Some((_, integrals)) = integrals {
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

/// Nodes between -`reach` and `reach` at equal distances, each with its width.
fn evenly(reach: f64, nodes: usize, mut visit: impl FnMut(f64, f64)) {
    let width = 2.0 * reach / nodes as f64;
    for k in 0..nodes {
        visit((k as f64 + 0.5) * width - reach, width);
    }
}

/// Nodes of Gauss and Legendre's rule on every piece between -`reach`, the kinks and `reach`, each with its width.
fn pieces(
    reach: f64,
    kinks: impl Iterator<Item = f64>,
    rule: &[[f64; 2]],
    mut visit: impl FnMut(f64, f64),
) {
    let mut edges: Vec<f64> = kinks.filter(|k| k.abs() < reach).collect();
    edges.extend([-reach, reach]);
    edges.sort_by(f64::total_cmp);
    for edge in edges.windows(2) {
        let (centre, half) = (0.5 * (edge[0] + edge[1]), 0.5 * (edge[1] - edge[0]));
        for [x, weight] in rule {
            visit(centre + half * x, half * weight);
        }
    }
}

/// Nodes and weights of Gauss and Legendre's rule between -1 and 1: the zeros of P_n, by Newton's method, and
/// 2 / ((1 - x^2) P_n'(x)^2).
fn gauss_legendre(n: usize) -> Vec<[f64; 2]> {
    let node = |k: usize| {
        let mut x = (PI * (k as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..100 {
            let (mut p, mut before) = (1.0, 0.0);
            for m in 1..=n {
                let m = m as f64;
                (p, before) = (((2.0 * m - 1.0) * x * p - (m - 1.0) * before) / m, p);
            }
            slope = n as f64 * (x * p - before) / (x * x - 1.0);
            let step = p / slope;
            x -= step;
            if step.abs() < 1e-15 {
                break;
            }
        }
        [x, 2.0 / ((1.0 - x * x) * slope * slope)]
    };
    (0..n).map(node).collect()
}

/// Points at which a band is sampled.
const BAND_POINTS: usize = 256;

/// The distinct bands of the runs: what goes by frequency alone is worked out once a band.
#[derive(Debug)]
pub struct Bands {
    /// Of each band its frequencies (Hz) and their weights, which add up to 1; of a sine the one frequency.
    points: Vec<Vec<[f64; 2]>>,
    /// Of each run its band, and the reciprocal of bandwidth times duration (zero for a sine).
    of_run: Vec<(usize, f64)>,
}

impl Bands {
    /// The bands of these runs.
    pub fn new<'r>(runs: impl Iterator<Item = &'r Run>) -> Self {
        let mut edges: Vec<[f64; 2]> = Vec::new();
        let of_run = runs.map(|run| {
            let [low, high] = match run.kind {
                VibrationKind::Sine => [run.band_hz[0]; 2],
                VibrationKind::Random => run.band_hz,
            };
            let band = edges.iter().position(|known| *known == [low, high]);
            let band = band.unwrap_or_else(|| {
                edges.push([low, high]);
                edges.len() - 1
            });
            let width = high - low;
            (
                band,
                if width > 0.0 {
                    (width * run.duration_s).recip()
                } else {
                    0.0
                },
            )
        });
        let of_run = of_run.collect();
        Self {
            points: edges.into_iter().map(sampled).collect(),
            of_run,
        }
    }

    /// Of each run the mean over its band of a frequency response's squared magnitude. For a sine the value at its
    /// frequency, with no variance; for a flat band the mean, and the variance of the mean over records of that length
    /// whose total power is known: var_f(response) / (bandwidth x time).
    pub fn means(&self, response: impl Fn(f64) -> f64) -> Vec<TimeMean> {
        let means = self.several(|f| [response(f)]);
        means.into_iter().map(|[mean]| mean).collect()
    }

    /// The same of several responses at once.
    pub fn several<const N: usize>(
        &self,
        responses: impl Fn(f64) -> [f64; N],
    ) -> Vec<[TimeMean; N]> {
        let of_band = |points: &Vec<[f64; 2]>| {
            let mut means = [TimeMean::default(); N];
            for &[f, weight] in points {
                for (mean, value) in means.iter_mut().zip(responses(f)) {
                    mean.value += weight * value;
                    mean.variance += weight * value * value;
                }
            }
            means.map(|mean| TimeMean {
                variance: (mean.variance - mean.value * mean.value).max(0.0),
                ..mean
            })
        };
        let of_band: Vec<_> = self.points.iter().map(of_band).collect();
        let of_run = |&(band, per_record): &(usize, f64)| {
            of_band[band].map(|mean| TimeMean {
                variance: mean.variance * per_record,
                ..mean
            })
        };
        self.of_run.iter().map(of_run).collect()
    }
}

/// Frequencies of a flat band with their weights.
fn sampled([low, high]: [f64; 2]) -> Vec<[f64; 2]> {
    if high <= low {
        return vec![[low, 1.0]];
    }
    // Equal steps of the logarithm, each weighted by its width: low edges need the finer steps.
    let from = low.max(1e-3 * high);
    let ratio = (high / from).ln() / BAND_POINTS as f64;
    let at = |k: usize| {
        let f = from * ((k as f64 + 0.5) * ratio).exp();
        [f, f * ratio / (high - from)]
    };
    (0..BAND_POINTS).map(at).collect()
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

    #[test]
    fn kinked_means_of_a_distorted_sine_are_its_time_means() {
        // One period in so many phases: a jump or a kink is off by less than one of them.
        const PHASES: usize = 200_000;
        for second_harmonic in [-0.3, -0.1, 1e-9, 0.02, 0.3] {
            for (a0, amplitude) in [
                (0.0, 1.0),
                (0.4, 1.0),
                (-0.9, -1.1),
                (0.05, 6.0),
                (1.0, 0.5),
            ] {
                let motion = Motion {
                    amplitude_g: [amplitude, 0.0, 0.0],
                    second_harmonic,
                    shape: [0.0, 3.0],
                    power_variance: 0.0,
                };
                let mut sums = [0.0; 3];
                let mut seen = [f64::NEG_INFINITY, f64::INFINITY];
                for k in 0..PHASES {
                    let x = TAU * (k as f64 + 0.5) / PHASES as f64;
                    let a: f64 = a0 + amplitude * (x.sin() - second_harmonic * (2.0 * x).cos());
                    seen = [seen[0].max(a), seen[1].min(a)];
                    sums[0] += a.signum();
                    sums[1] += a.abs();
                    sums[2] += a * a.abs();
                }
                let [sign, absolute, square] = sums.map(|sum| sum / PHASES as f64);
                let found = motion.distorted_kinks(a0);
                assert!((found.sign - sign).abs() < 5e-5, "{motion:?} {a0}");
                let absolute_g = absolute - a0.abs();
                assert!(
                    (found.absolute_g - absolute_g).abs() < 1e-8,
                    "{motion:?} {a0}"
                );
                let square_g2 = square - a0 * a0.abs();
                assert!(
                    (found.signed_square_g2 - square_g2).abs() < 1e-7,
                    "{motion:?} {a0}"
                );
                for (multiple, seen) in motion.extremes().into_iter().zip(seen) {
                    assert!((a0 + amplitude * multiple - seen).abs() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn rule_integrates_polynomials_and_a_split_kink_exactly() {
        let rule = gauss_legendre(20);
        let of = |f: &dyn Fn(f64) -> f64| rule.iter().map(|[x, w]| w * f(*x)).sum::<f64>();
        assert!((of(&|_| 1.0) - 2.0).abs() < 1e-14);
        assert!((of(&|x| x.powi(38)) - 2.0 / 39.0).abs() < 1e-14);
        let mut sum = 0.0;
        pieces(1.0, [0.3].into_iter(), &rule, |x, width| {
            sum += width * (x - 0.3).abs()
        });
        assert!((sum - 0.5 * (1.3 * 1.3 + 0.7 * 0.7)).abs() < 1e-14);
    }
}
