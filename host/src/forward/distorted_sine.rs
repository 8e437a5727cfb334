//! Moments of a sine with its second harmonic, in closed form.

use std::f64::consts::{FRAC_PI_2, PI};

use shared::vibration::{Kinked, KinkedMeans, Moments};

use super::motion::Motion;

impl Motion {
    /// Moments of s - h cos 2x, s = sin x: M[s^2 cos 2x] = -1/4 and M[s^2 cos^2 2x] = 1/4.
    pub(super) fn distorted(&self, a0: f64) -> Moments<f64> {
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
    pub(super) fn phases(&self, multiple: f64) -> Vec<f64> {
        // 2 h s^2 + s - (h + multiple) = 0: by the root that does not cancel, and the other one from their product.
        let h = self.second_harmonic;
        let root = 0.5 * (1.0 + (1.0 + 8.0 * h * (h + multiple)).sqrt());
        let mut sines = [(h + multiple) / root, -root / (2.0 * h)];
        sines.sort_by(f64::total_cmp);
        let passed = sines.into_iter().filter(|sine| sine.abs() < 1.0);
        passed.map(f64::asin).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

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
}
