//! Coefficients by least squares over the harmonics of all blocks and the means of the plateaus.
//!
//! ```text
//! Y_1 = T_1 [ R_1 (1 - c_1 |R_1/A|^2) + sum_n k_n F_n1 ] + D dR_1/dt
//! Y_k = T_k [ R_k - c_k A (R_1/A)^k + sum_n k_n F_nk ]               k = 2, 3, 4, with c_3 + c_1/3 for c_3
//! shift = sum_n k_n F_n0                                                          F_n0 of (8)
//! ```
//!
//! Y output, R reference, A the largest amplitude, F_nk the k-th harmonic of (a0 + w)^n. Free are the gain T_1 and the delay of
//! a changing amplitude D; T_k has the prior of a delay and a flat gain, c_k, what the reference itself distorts, that of the
//! stated linearity.

use nalgebra::{Complex, DMatrix, DVector, Matrix3, Vector3};

use super::blocks::{Block, HARMONICS};
use super::model::Column;

/// Highest order in the fit: the fourth power reaches it.
const ORDERS: usize = 4;

/// Standard deviation of the gain at twice the frequency, of that at the frequency; at k times k - 1 times as much. Chosen: a
/// loop whose bandwidth is six times the frequency has it.
pub(super) const GAIN_SPREAD: f64 = 0.1;

/// Standard deviation, of the motion at the largest amplitude, of what a coefficient makes of it. Chosen: wider than any
/// instrument.
const WIDE: f64 = 1.0;

/// Standard deviation of the delay of a changing amplitude, rad. Chosen: wider than any instrument.
const DELAY_SPREAD: f64 = 10.0;

/// Third harmonic of a cubic over its change of gain: sin^3 = 3/4 sin - 1/4 sin 3x.
const CUBIC: f64 = 1.0 / 3.0;

/// Rounds of weights; each is followed by the solution with them. Measured: the fourth changes nothing by 1e-6.
const ROUNDS: usize = 6;

/// The mean of one plateau.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mean {
    /// Derivatives of the vibration error by k2, k3 and k4.
    pub by: [f64; 3],
    /// The shift, g.
    pub shift_g: f64,
    /// Its standard uncertainty, g.
    pub sigma_g: f64,
}

/// What is fitted.
pub(super) struct Observed<'a> {
    pub blocks: &'a [Block],
    pub columns: &'a [Column],
    /// Angular frequency of each tone, rad/s.
    pub angular: &'a [f64],
    /// Harmonics that the sample rate allows.
    pub orders: usize,
    /// Largest amplitude, g.
    pub amplitude_g: f64,
    /// Standard deviation of the reference's own distortion.
    pub distortion: f64,
}

/// What is found.
pub(super) struct Fit {
    /// k2, k3, k4.
    pub coefficients: Vector3<f64>,
    pub covariance: Matrix3<f64>,
    /// Of each tone and order the gain, and the standard deviation of its real and imaginary part.
    pub gains: Vec<Vec<(Complex<f64>, f64)>>,
    /// Of each order what is left in phase and in quadrature.
    pub noise: Vec<[Noise; 2]>,
}

/// What the model leaves of a harmonic in the blocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    /// Root of the mean square, g.
    pub rms_g: f64,
    /// Variance over half the mean square of the steps from block to block.
    pub unsteadiness: f64,
    /// Variance to weigh by, more than the mean square where what is left is slower than from block to block, g^2.
    variance: f64,
}

/// Places of the unknowns: three coefficients, c_k, and of each tone T_1, D, T_2, ..
#[derive(Clone, Copy)]
struct Places {
    orders: usize,
}

impl Places {
    fn distortion(order: usize) -> usize {
        3 + 2 * (order - 1)
    }

    fn gain(self, tone: usize, order: usize) -> usize {
        3 + 2 * self.orders + tone * 2 * (self.orders + 1) + 2 * (order - 1)
    }

    fn delay(self, tone: usize) -> usize {
        self.gain(tone, self.orders + 1)
    }

    fn count(self, tones: usize) -> usize {
        self.gain(tones, 1)
    }
}

/// The state of a fit.
struct Solver<'a> {
    observed: &'a Observed<'a>,
    places: Places,
    /// Of each tone and order the gain about which the prior stands.
    centre: Vec<Vec<Complex<f64>>>,
    /// The reference's harmonics as smooth functions of the amplitude.
    smooth: Vec<[Complex<f64>; HARMONICS]>,
    x: DVector<f64>,
    /// By order, of what is in phase and in quadrature.
    noise: Vec<[Noise; 2]>,
}

/// The fit to the blocks and the `means`; `None` where they are too few.
pub(super) fn fit(observed: &Observed<'_>, means: &[Mean]) -> Option<Fit> {
    let places = Places {
        orders: observed.orders.min(ORDERS),
    };
    let tones = observed.angular.len();
    if observed.blocks.len() < 4 * tones + 8 {
        return None;
    }
    let first: Vec<Complex<f64>> = (0..tones)
        .map(|tone| {
            let blocks = || observed.blocks.iter().filter(move |b| b.tone == tone);
            let cross: Complex<f64> = blocks()
                .map(|b| b.output_g[0] * b.reference_g[0].conj())
                .sum();
            cross / blocks().map(|b| b.reference_g[0].norm_sqr()).sum::<f64>()
        })
        .collect();
    let extrapolated = |t: &Complex<f64>| -> Vec<Complex<f64>> {
        let orders = 1..=places.orders;
        orders
            .map(|k| Complex::from_polar(t.norm(), k as f64 * t.arg()))
            .collect()
    };
    let mut solver = Solver {
        observed,
        places,
        centre: first.iter().map(extrapolated).collect(),
        smooth: smooth(observed, places.orders),
        x: DVector::zeros(places.count(tones)),
        noise: Vec::new(),
    };
    solver.learn_noise();
    let mut covariance = None;
    for _ in 0..ROUNDS {
        covariance = Some(solver.step(means)?);
        solver.learn_noise();
    }
    Some(solver.answer(&covariance?))
}

/// Of each block the reference's harmonics from the second on as c_1 a + c_2 a^2 + c_3 a^3 in the phase of R_1^k, a its
/// amplitude: the noise of the single block, which would draw T_k to zero, is not in it.
fn smooth(observed: &Observed<'_>, orders: usize) -> Vec<[Complex<f64>; HARMONICS]> {
    let mut all: Vec<_> = observed.blocks.iter().map(|b| b.reference_g).collect();
    let basis = |block: &Block| {
        let a = block.reference_g[0].norm() / observed.amplitude_g;
        Vector3::new(a, a * a, a * a * a)
    };
    for tone in 0..observed.angular.len() {
        let mut normal = Matrix3::zeros();
        let mut right = [[Vector3::zeros(); 2]; HARMONICS];
        let of_tone = || observed.blocks.iter().filter(move |b| b.tone == tone);
        for block in of_tone() {
            let row = basis(block);
            normal += row * row.transpose();
            for order in 2..=orders {
                let turned = block.reference_g[order - 1] * turn(block, order).conj();
                right[order - 1][0] += row * turned.re;
                right[order - 1][1] += row * turned.im;
            }
        }
        let Ok(inverse) = normal.pseudo_inverse(1e-9 * normal.trace()) else {
            continue;
        };
        let places = observed
            .blocks
            .iter()
            .zip(&mut all)
            .filter(|(b, _)| b.tone == tone);
        for (block, harmonics) in places {
            let row = basis(block);
            for order in 2..=orders {
                let [re, im] = right[order - 1].map(|right| row.dot(&(inverse * right)));
                harmonics[order - 1] = Complex::new(re, im) * turn(block, order);
            }
        }
    }
    all
}

/// exp(i k phase of R_1).
fn turn(block: &Block, order: usize) -> Complex<f64> {
    Complex::from_polar(1.0, order as f64 * block.reference_g[0].arg())
}

/// A row of the linearised model: what is left and its derivatives by the unknowns that it knows, real in phase with what the
/// motion's power makes, where the coefficients are, and imaginary in quadrature, where times that jitter are.
struct Row {
    left: Complex<f64>,
    by: Vec<(usize, Complex<f64>)>,
}

impl Solver<'_> {
    fn complex(&self, place: usize) -> Complex<f64> {
        Complex::new(self.x[place], self.x[place + 1])
    }

    /// k_n A^(n-1) are the unknowns: of one size.
    fn scale(&self, n: usize) -> f64 {
        self.observed.amplitude_g.powi(n as i32 + 1)
    }

    fn row(&self, index: usize, order: usize) -> Row {
        let (block, column) = (&self.observed.blocks[index], &self.observed.columns[index]);
        let tone = block.tone;
        let r = block.reference_g[0] / self.observed.amplitude_g;
        let distorted = match order {
            1 => block.reference_g[0] * r.norm_sqr(),
            _ => r.powi(order as i32) * self.observed.amplitude_g,
        };
        let powers: [Complex<f64>; 3] =
            std::array::from_fn(|n| column.harmonics[order - 1][n] / self.scale(n));
        let mut own = self.complex(Places::distortion(order));
        if order == 3 {
            own += self.complex(Places::distortion(1)) * CUBIC;
        }
        let mut inner = self.smooth[index][order - 1] - own * distorted;
        for (n, power) in powers.iter().enumerate() {
            inner += power * self.x[n];
        }
        let centre = self.centre[tone][order - 1];
        let place = self.places.gain(tone, order);
        let gain = centre * (self.complex(place) + 1.0);
        // What of the reference is not smooth is a motion all the same.
        let fluctuation = block.reference_g[order - 1] - self.smooth[index][order - 1];
        let mut left = block.output_g[order - 1] - gain * inner - centre * fluctuation;
        let i = Complex::<f64>::i();
        let mut by: Vec<(usize, Complex<f64>)> = Vec::with_capacity(11);
        by.extend(
            powers
                .iter()
                .enumerate()
                .map(|(n, power)| (n, gain * power)),
        );
        let mut add = |place: usize, derivative: Complex<f64>| {
            by.extend([(place, derivative), (place + 1, i * derivative)]);
        };
        add(Places::distortion(order), -gain * distorted);
        if order == 3 {
            add(Places::distortion(1), -gain * distorted * CUBIC);
        }
        add(place, centre * inner);
        if order == 1 {
            let delayed = centre * block.slope_g_per_s / self.observed.angular[tone];
            left -= delayed * self.complex(self.places.delay(tone));
            add(self.places.delay(tone), delayed);
        }
        let turn = (turn(block, order) * centre / centre.norm()).conj();
        by.iter_mut()
            .for_each(|(_, derivative)| *derivative *= turn);
        Row {
            left: left * turn,
            by,
        }
    }

    /// One step of Gauss and Newton; gives the covariance of the unknowns.
    fn step(&mut self, means: &[Mean]) -> Option<DMatrix<f64>> {
        let size = self.x.len();
        let mut normal = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        for order in 1..=self.places.orders {
            let [re, im] = self.noise[order - 1].map(|noise| 1.0 / noise.variance);
            for index in 0..self.observed.blocks.len() {
                let row = self.row(index, order);
                for (a, by_a) in &row.by {
                    let weighted = Complex::new(re * by_a.re, im * by_a.im);
                    right[*a] += weighted.re * row.left.re + weighted.im * row.left.im;
                    for (b, by_b) in &row.by {
                        normal[(*a, *b)] += weighted.re * by_b.re + weighted.im * by_b.im;
                    }
                }
            }
        }
        for mean in means {
            let by: [f64; 3] = std::array::from_fn(|n| mean.by[n] / self.scale(n));
            let predicted: f64 = by.iter().zip(self.x.iter()).map(|(by, x)| by * x).sum();
            let weight = mean.sigma_g.powi(-2);
            for a in 0..3 {
                right[a] += weight * by[a] * (mean.shift_g - predicted);
                (0..3).for_each(|b| normal[(a, b)] += weight * by[a] * by[b]);
            }
        }
        for (place, sigma) in self.priors() {
            normal[(place, place)] += sigma.powi(-2);
            right[place] -= self.x[place] * sigma.powi(-2);
        }
        let covariance = normal.cholesky()?.inverse();
        self.x += &covariance * right;
        Some(covariance)
    }

    /// Standard deviations of the unknowns about zero.
    fn priors(&self) -> Vec<(usize, f64)> {
        let mut all: Vec<(usize, f64)> = (0..3).map(|n| (n, WIDE)).collect();
        let mut add = |place: usize, sigma: f64| all.extend([(place, sigma), (place + 1, sigma)]);
        // A reference without distortion is one of which nothing is seen.
        let own = self.observed.distortion.max(1e-9);
        (1..=self.places.orders).for_each(|order| add(Places::distortion(order), own));
        for (tone, centre) in self.centre.iter().enumerate() {
            // A delay turns the k-th harmonic by k times the phase, a high pass by less than the phase.
            let phase = centre[0].arg();
            let phase =
                (phase - std::f64::consts::PI * (phase / std::f64::consts::PI).round()).abs();
            add(self.places.gain(tone, 1), WIDE);
            add(self.places.delay(tone), DELAY_SPREAD);
            for order in 2..=self.places.orders {
                let sigma = (order - 1) as f64 * (GAIN_SPREAD + phase);
                add(self.places.gain(tone, order), sigma);
            }
        }
        all
    }

    /// The noise of each harmonic by what the model leaves.
    fn learn_noise(&mut self) {
        let blocks = self.observed.blocks;
        let of_order = |order: usize| {
            let all = 0..blocks.len();
            let left: Vec<Complex<f64>> = all.map(|index| self.row(index, order).left).collect();
            // Gain and delay of each tone, and a coefficient.
            let known = self.observed.angular.len() * if order == 1 { 2 } else { 1 } + 1;
            let part = |part: fn(&Complex<f64>) -> f64| {
                let pairs = blocks.windows(2).zip(left.windows(2));
                let steps = pairs.filter(|(blocks, _)| blocks[0].tone == blocks[1].tone);
                let steps: Vec<f64> = steps
                    .map(|(_, left)| (part(&left[1]) - part(&left[0])).powi(2))
                    .collect();
                let squares = left.iter().map(|left| part(left).powi(2)).sum();
                Noise::of(squares, blocks.len(), known, &steps)
            };
            [part(|left| left.re), part(|left| left.im)]
        };
        self.noise = (1..=self.places.orders).map(of_order).collect();
    }

    fn answer(&self, covariance: &DMatrix<f64>) -> Fit {
        let gain = |tone: usize, order: usize| {
            let place = self.places.gain(tone, order);
            let centre = self.centre[tone][order - 1];
            let variance = 0.5 * (covariance[(place, place)] + covariance[(place + 1, place + 1)]);
            (
                centre * (self.complex(place) + 1.0),
                centre.norm() * variance.sqrt(),
            )
        };
        let of_tone = |tone| {
            (1..=self.places.orders)
                .map(|order| gain(tone, order))
                .collect()
        };
        Fit {
            coefficients: Vector3::from_fn(|n, _| self.x[n] / self.scale(n)),
            covariance: Matrix3::from_fn(|a, b| {
                covariance[(a, b)] / (self.scale(a) * self.scale(b))
            }),
            gains: (0..self.centre.len()).map(of_tone).collect(),
            noise: self.noise.clone(),
        }
    }
}

impl Noise {
    /// Of the sum of the squares over so many blocks, less what is known of them, and of the squares of the steps.
    fn of(squares: f64, blocks: usize, known: usize, steps: &[f64]) -> Self {
        // A harmonic without noise has some all the same.
        const LEAST: f64 = 1e-30;
        let n = blocks as f64;
        let variance = (squares / (blocks - known) as f64).max(LEAST);
        let step = 0.5 * steps.iter().sum::<f64>() / steps.len() as f64;
        let unsteadiness = variance / step.max(LEAST);
        // The variance of a mean of an autoregression of first order with this ratio of von Neumann, over that of independent
        // blocks; within three standard deviations of the ratio they are taken for independent.
        let slower = match unsteadiness - 1.0 > 3.0 / n.sqrt() {
            true => 2.0 * unsteadiness - 1.0,
            false => 1.0,
        };
        Self {
            rms_g: (squares / n).sqrt(),
            unsteadiness,
            variance: slower * variance,
        }
    }
}
