//! A vibration by its spectral densities, with sines on it.

use shared::model::SpecificForce;
use shared::rectification::Sensitivity;
use shared::vibration::{Harmonic, Kinked, Moments, Random};

use super::mixture::kinked_means;
use crate::campaign::{Breakpoint, Density, SpectrumTable};

/// A sine along one line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sine {
    /// Frequency, Hz; what is rectified does not depend on it.
    pub f_hz: f64,
    /// Peak on IA, PA, OA with the sign of the direction, g.
    pub peak_g: [f64; 3],
}

/// Gaussian noise by its second moments, and sines of frequencies that have no common measure.
#[derive(Clone, Debug, PartialEq)]
pub struct Vibration {
    /// Rms of the noise on IA, PA, OA, g.
    pub sigma_g: [f64; 3],
    /// Covariances IA-PA, IA-OA, PA-OA of the noise, g^2.
    pub cross_g2: [f64; 3],
    /// Integral of the square of the density on IA, g^4/Hz.
    pub density_square_g4_per_hz: f64,
    /// The sines.
    pub sines: Vec<Sine>,
}

/// Steps of a stretch between two breakpoints in the logarithm of frequency.
const STEPS: usize = 64;

const PAIRS: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

impl Vibration {
    /// Noise of this rms along a unit vector, flat over nothing in particular.
    pub fn random(rms_g: f64, direction: [f64; 3]) -> Self {
        Self {
            sigma_g: direction.map(|n| (n * rms_g).abs()),
            cross_g2: PAIRS.map(|[j, k]| direction[j] * direction[k] * rms_g * rms_g),
            density_square_g4_per_hz: 0.0,
            sines: Vec::new(),
        }
    }

    /// A sine of this peak along a unit vector.
    pub fn sine(peak_g: f64, f_hz: f64, direction: [f64; 3]) -> Self {
        Self {
            sigma_g: [0.0; 3],
            cross_g2: [0.0; 3],
            density_square_g4_per_hz: 0.0,
            sines: vec![Sine {
                f_hz,
                peak_g: direction.map(|n| n * peak_g),
            }],
        }
    }

    /// Of a table; what it has along one direction goes along the unit vector `direction`.
    pub fn of_table(table: &SpectrumTable, direction: [f64; 3]) -> Self {
        let mut powers = [0.0; 3];
        let mut found = Self::random(0.0, direction);
        for pair in table.breakpoints.windows(2) {
            let (low, high) = (&pair[0], &pair[1]);
            let stretch = (high.f_hz / low.f_hz).ln();
            for (step, weight) in simpson_weights(STEPS).enumerate() {
                let share = step as f64 / STEPS as f64;
                let f_hz = low.f_hz * (share * stretch).exp();
                // Df = f d(ln f).
                let width = weight * stretch / STEPS as f64 * f_hz;
                let densities = between(low, high, share, direction);
                for (power, density) in powers.iter_mut().zip(densities) {
                    *power += width * density;
                }
                found.density_square_g4_per_hz += width * densities[0] * densities[0];
                for (pair, [j, k]) in PAIRS.into_iter().enumerate() {
                    let coherence = match low.density {
                        Density::Along(_) => (direction[j] * direction[k]).signum(),
                        Density::Axes(_) => {
                            low.coherence[pair] * (1.0 - share) + high.coherence[pair] * share
                        }
                    };
                    found.cross_g2[pair] +=
                        width * coherence * (densities[j] * densities[k]).sqrt();
                }
            }
        }
        found.sigma_g = powers.map(f64::sqrt);
        found.sines = table
            .sines
            .iter()
            .map(|[f_hz, peak_g]| Sine {
                f_hz: *f_hz,
                peak_g: direction.map(|n| n * peak_g),
            })
            .collect();
        found
    }

    /// Rms on IA, PA, OA, sines included, g.
    pub fn rms_g(&self) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let sines = self
                .sines
                .iter()
                .map(|sine| 0.5 * sine.peak_g[axis].powi(2));
            (self.sigma_g[axis].powi(2) + sines.sum::<f64>()).sqrt()
        })
    }

    /// Rms of all axes together, g.
    pub fn total_rms_g(&self) -> f64 {
        self.rms_g().iter().map(|rms| rms * rms).sum::<f64>().sqrt()
    }

    /// Greatest magnitude on IA that is reached now and then: four standard deviations of the noise, and the sines' peaks, g.
    pub fn reach_g(&self) -> f64 {
        let peaks = self.sines.iter().map(|sine| sine.peak_g[0].abs());
        4.0 * self.sigma_g[0] + peaks.sum::<f64>()
    }

    /// The same motion `factor` times as large.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            sigma_g: self.sigma_g.map(|sigma| factor * sigma),
            cross_g2: self.cross_g2.map(|cross| factor * factor * cross),
            density_square_g4_per_hz: factor.powi(4) * self.density_square_g4_per_hz,
            sines: self
                .sines
                .iter()
                .map(|sine| Sine {
                    peak_g: sine.peak_g.map(|peak| factor * peak),
                    ..*sine
                })
                .collect(),
        }
    }

    /// Derivatives of the vibration error by the coefficients, at a systematic specific force on IA.
    pub fn sensitivity(&self, a0_i_g: f64) -> Sensitivity<f64> {
        Sensitivity::new(a0_i_g, self.moments(a0_i_g))
    }

    /// Central moments. Noise and sines are independent of each other:
    ///
    /// ```text
    /// m2 = s^2 + q,  q = sum A^2/2,   m4 = 3 s^4 + 6 s^2 q + 3 q^2 - (3/8) sum A^4
    /// ```
    fn moments(&self, a0_i_g: f64) -> Moments<f64> {
        let [i, p, o] = self.sigma_g;
        if let ([sine], true) = (self.sines.as_slice(), self.sigma_g == [0.0; 3]) {
            let [i, p, o] = sine.peak_g;
            return Moments::from(Harmonic {
                amplitude_g: SpecificForce::new(i, p, o),
            });
        }
        let correlation = PAIRS.map(|[j, k]| self.sigma_g[j] * self.sigma_g[k]);
        let correlation = std::array::from_fn(|pair| match correlation[pair] > 0.0 {
            true => self.cross_g2[pair] / correlation[pair],
            false => 0.0,
        });
        let noise = Moments::from(Random {
            sigma_g: SpecificForce::new(i, p, o),
            correlation,
        });
        if self.sines.is_empty() {
            return noise;
        }
        let products = |j: usize, k: usize| -> f64 {
            let sines = self.sines.iter();
            sines
                .map(|sine| 0.5 * sine.peak_g[j] * sine.peak_g[k])
                .sum()
        };
        let peaks: Vec<f64> = self.sines.iter().map(|sine| sine.peak_g[0].abs()).collect();
        let (s2, q) = (i * i, products(0, 0));
        let fourth: f64 = peaks.iter().map(|peak| peak.powi(4)).sum();
        Moments {
            m2_g2: s2 + q,
            m4_g4: 3.0 * s2 * s2 + 6.0 * s2 * q + 3.0 * q * q - 0.375 * fourth,
            cross_ip_g2: noise.cross_ip_g2 + products(0, 1),
            cross_io_g2: noise.cross_io_g2 + products(0, 2),
            cross_po_g2: noise.cross_po_g2 + products(1, 2),
            m2_p_g2: noise.m2_p_g2 + products(1, 1),
            m2_o_g2: noise.m2_o_g2 + products(2, 2),
            kinked: Kinked::Measured(kinked_means(a0_i_g, i, &peaks)),
            ..noise
        }
    }
}

/// Densities on IA, PA, OA between two breakpoints, straight on logarithmic axes, g^2/Hz.
fn between(low: &Breakpoint, high: &Breakpoint, share: f64, direction: [f64; 3]) -> [f64; 3] {
    let straight = |a: f64, b: f64| match a > 0.0 && b > 0.0 {
        true => a * (b / a).powf(share),
        false => 0.0,
    };
    match (low.density, high.density) {
        (Density::Along(a), Density::Along(b)) => direction.map(|n| n * n * straight(a, b)),
        (Density::Axes(a), Density::Axes(b)) => {
            std::array::from_fn(|axis| straight(a[axis], b[axis]))
        }
        _ => [0.0; 3],
    }
}

/// Weights of Simpson's rule over so many steps.
fn simpson_weights(steps: usize) -> impl Iterator<Item = f64> {
    (0..=steps).map(move |step| match step {
        0 => 1.0 / 3.0,
        last if last == steps => 1.0 / 3.0,
        odd if odd % 2 == 1 => 4.0 / 3.0,
        _ => 2.0 / 3.0,
    })
}
