//! What a finite record of Gaussian noise leaves uncertain of its own vibration error.
//!
//! A record of T seconds has sample moments of its own. In Hermite polynomials of x = w_I / sigma the mean over the
//! record of He_n(x) has zero expectation and, with the noise's autocorrelation rho, the variance
//!
//! ```text
//! n! I_n / T,   I_n = integral of rho(tau)^n over all tau
//! ```
//!
//! and different orders do not correlate. The vibration error of an output model u is the sum of c_n times the mean of
//! He_n, c_n = E[d^n u(a0 + sigma x) / dx^n] / n!. The reference accelerometer reports the orders up to four; the
//! higher ones, which only the kink of k1' |a| has, nobody measures.

use shared::model::Coefficients;

use super::rows::RunConditions;
use crate::campaign::VibrationKind;

/// Orders of Hermite polynomials that the kink is followed to.
pub(crate) const ORDERS: usize = 14;

/// Variance (g^2) of a run's vibration error about its expectation, from the moments of its record that no reference
/// reported; zero for a sine.
pub fn unseen_variance_g2(run: &RunConditions, coefficients: &Coefficients<f64>) -> f64 {
    match run.kind {
        VibrationKind::Sine => 0.0,
        VibrationKind::Random => {
            unseen_variance_within_g2(run, coefficients, &correlation_integrals(run.band_hz))
        }
    }
}

/// The same with the [`correlation_integrals`] of the run's band.
pub(crate) fn unseen_variance_within_g2(
    run: &RunConditions,
    coefficients: &Coefficients<f64>,
    integrals: &[f64; ORDERS + 1],
) -> f64 {
    let sigma = (run.direction[0] * run.level_g).abs();
    if run.kind == VibrationKind::Sine || sigma == 0.0 {
        return 0.0;
    }
    let (a, c) = (run.specific_force_g.i, coefficients);
    // E[d^n / dx^n] of k1' |a + sigma x|: from n = 2 on, 2 sigma He_(n-2)(-alpha) phi(alpha).
    let alpha = a / sigma;
    let density = (-0.5 * alpha * alpha).exp() / std::f64::consts::TAU.sqrt();
    let hermite = hermite(-alpha);
    let seen_up_to = if run.shape_seen { 4 } else { 2 };
    let mut factorial = 2.0;
    let mut variance = 0.0;
    for n in 3..=ORDERS {
        factorial *= n as f64;
        let mut derivative = c.asymmetry * 2.0 * sigma * hermite[n - 2] * density;
        if n == 3 {
            derivative +=
                sigma.powi(3) * (6.0 * c.third_order_per_g2 + 24.0 * c.fourth_order_per_g3 * a);
        } else if n == 4 {
            derivative += sigma.powi(4) * 24.0 * c.fourth_order_per_g3;
        }
        if n > seen_up_to {
            variance += derivative * derivative / factorial * integrals[n] / run.duration_s;
        }
    }
    variance
}

/// He_0(x) ..= He_ORDERS(x).
fn hermite(x: f64) -> [f64; ORDERS + 1] {
    let mut he = [1.0; ORDERS + 1];
    he[1] = x;
    for n in 2..=ORDERS {
        he[n] = x * he[n - 1] - (n - 1) as f64 * he[n - 2];
    }
    he
}

/// I_n in s for noise of flat density over a band (Hz): rho(tau) = sinc(pi B tau) cos(2 pi f0 tau), B wide about f0. The power
/// of the cosine is a sum of cosines, and the transform of sinc(pi B tau)^n over B is the cardinal B-spline M_n, n boxes
/// convolved, so that
///
/// ```text
/// I_n = 1/(2^n B) sum over j of C(n, j) M_n((n - 2j) f0 / B)
/// ```
pub(crate) fn correlation_integrals(band_hz: [f64; 2]) -> [f64; ORDERS + 1] {
    let [low, high] = band_hz;
    let width = (high - low).max(1e-3 * high);
    let centre = 0.5 * (low + high) / width;
    std::array::from_fn(|n| {
        let mut choices = 0.5_f64.powi(n as i32) / width;
        let mut sum = 0.0;
        for j in 0..=n {
            sum += choices * cardinal_spline(n, (n as f64 - 2.0 * j as f64) * centre);
            choices *= (n - j) as f64 / (j + 1) as f64;
        }
        sum
    })
}

/// The centred cardinal B-spline of order `n`, by the recurrence of de Boor and Cox.
fn cardinal_spline(n: usize, x: f64) -> f64 {
    let t = x + 0.5 * n as f64;
    if n == 0 || t < 0.0 || t >= n as f64 {
        return 0.0;
    }
    // Of each order in turn the values at t, t - 1, ...
    let mut values = [0.0; ORDERS + 1];
    values[t as usize] = 1.0;
    for order in 2..=n {
        let degree = (order - 1) as f64;
        for (k, from) in (0..n).map(|k| (k, t - k as f64)) {
            values[k] = (from * values[k] + (order as f64 - from) * values[k + 1]) / degree;
        }
    }
    values[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The midpoint rule over two hundred correlation times.
    fn by_quadrature([low, high]: [f64; 2], order: i32) -> f64 {
        let (width, centre) = (high - low, 0.5 * (low + high));
        let step = 1.0 / (32.0 * high);
        let steps = (200.0 / width / step) as usize;
        let power = |k: usize| {
            let tau = (k as f64 + 0.5) * step;
            let x = std::f64::consts::PI * width * tau;
            (x.sin() / x * (std::f64::consts::TAU * centre * tau).cos()).powi(order)
        };
        2.0 * step * (0..steps).map(power).sum::<f64>()
    }

    #[test]
    fn powers_of_an_autocorrelation_integrate_to_splines() {
        for band_hz in [[20.0, 2000.0], [100.0, 101.0], [500.0, 900.0], [1.0, 50.0]] {
            let integrals = correlation_integrals(band_hz);
            let scale = integrals[4];
            for order in 3..=ORDERS {
                let expected = by_quadrature(band_hz, order as i32);
                let miss = (integrals[order] - expected).abs();
                assert!(
                    miss < 1e-6 * scale,
                    "{band_hz:?}, {order}: {} for {expected}",
                    integrals[order]
                );
            }
        }
    }
}
