//! Time means of Gaussian noise with sines of independent phases on it.

use shared::vibration::KinkedMeans;

/// Steps of the integrals over the characteristic function.
const STEPS: usize = 4000;

/// Where the integrals end, in units of one over the smallest scale.
const SPAN: f64 = 400.0;

/// M|a0 + w| - |a0| of w with the standard deviation `sigma` and sines of these peaks, all in the same unit.
///
/// With the characteristic function phi(t) = exp(-sigma^2 t^2 / 2) times the product of J0(A t), of a symmetric w,
///
/// ```text
/// M|a0 + w| - |a0| = (2/pi) integral over t > 0 of cos(a0 t) (1 - phi(t)) / t^2
/// ```
///
/// by Simpson's rule; phi falls below 1e-14 before the end, or the tail of 1/t^2 is added where sines alone leave it.
pub fn absolute_excess(a0: f64, sigma: f64, sines: &[f64]) -> f64 {
    let phi = characteristic(sigma, sines);
    // Without a kink within reach nothing is rectified: where noise is absent and the sines do not reach zero.
    let reach: f64 = sines.iter().sum();
    if sigma == 0.0 && a0.abs() >= reach {
        return 0.0;
    }
    let end = end(sigma, sines);
    if !end.is_finite() {
        return 0.0;
    }
    let second: f64 = sigma * sigma + sines.iter().map(|peak| 0.5 * peak * peak).sum::<f64>();
    let integrand = |t: f64| match t * t * second < 1e-8 {
        // 1 - phi = m2 t^2 / 2 to the leading order.
        true => 0.5 * second,
        false => (a0 * t).cos() * (1.0 - phi(t)) / (t * t),
    };
    let body = simpson(integrand, end);
    2.0 / std::f64::consts::PI * (body + tail(a0, end))
}

/// The means of the three functions with a kink, about a0.
pub(super) fn kinked_means(a0: f64, sigma: f64, sines: &[f64]) -> KinkedMeans<f64> {
    // d/da0 of M|a0 + w| is M sign, of M[a|a|] twice M|a|; both are odd and even in a0.
    let step = 1e-3 * (sigma + sines.iter().sum::<f64>()).max(1e-300);
    let absolute = |a: f64| absolute_excess(a, sigma, sines) + a.abs();
    let sign = (absolute(a0 + step) - absolute(a0 - step)) / (2.0 * step);
    let half = a0 / 2.0;
    let signed_square =
        2.0 * a0 / 6.0 * (absolute(0.0) + 4.0 * absolute(half) + absolute(a0)) - a0 * a0.abs();
    KinkedMeans {
        sign: sign.clamp(-1.0, 1.0),
        absolute_g: absolute_excess(a0, sigma, sines),
        signed_square_g2: signed_square,
    }
}

fn characteristic(sigma: f64, sines: &[f64]) -> impl Fn(f64) -> f64 {
    move |t| {
        let noise = (-0.5 * (sigma * t).powi(2)).exp();
        sines
            .iter()
            .fold(noise, |phi, peak| phi * libm::j0(peak * t))
    }
}

/// Where phi is gone, or small.
fn end(sigma: f64, sines: &[f64]) -> f64 {
    let noise = if sigma > 0.0 {
        8.5 / sigma
    } else {
        f64::INFINITY
    };
    let largest = sines.iter().copied().fold(0.0, f64::max);
    noise.min(if largest > 0.0 {
        SPAN / largest
    } else {
        f64::INFINITY
    })
}

/// The integral of cos(a0 t) / t^2 from `end` on: cos(x)/end - |a0| (pi/2 - Si(x)), x = |a0| end.
fn tail(a0: f64, end: f64) -> f64 {
    let x = a0.abs() * end;
    x.cos() / end - a0.abs() * (std::f64::consts::FRAC_PI_2 - sine_integral(x))
}

/// Si(x) = the integral of sin(t)/t from 0 to x, x not negative: Simpson's rule up to 60, the asymptotic series beyond.
fn sine_integral(x: f64) -> f64 {
    if x > 60.0 {
        let (sin, cos) = x.sin_cos();
        let square = x * x;
        let f = (1.0 - 2.0 / square + 24.0 / (square * square)) / x;
        let g = (1.0 - 6.0 / square + 120.0 / (square * square)) / square;
        return std::f64::consts::FRAC_PI_2 - f * cos - g * sin;
    }
    simpson(|t| if t == 0.0 { 1.0 } else { t.sin() / t }, x)
}

/// Simpson's rule from 0 to `end`.
fn simpson(function: impl Fn(f64) -> f64, end: f64) -> f64 {
    let step = end / STEPS as f64;
    let inner = (1..STEPS).map(|k| {
        let weight = if k % 2 == 1 { 4.0 } else { 2.0 };
        weight * function(k as f64 * step)
    });
    (function(0.0) + inner.sum::<f64>() + function(end)) * step / 3.0
}

#[cfg(test)]
mod tests {
    use super::absolute_excess;
    use shared::model::SpecificForce;
    use shared::rectification::Sensitivity;
    use shared::vibration::{Harmonic, Random};

    /// Both limits have closed forms: equation (4) of a sine, the folded normal distribution of noise.
    #[test]
    fn the_mean_of_the_magnitude_has_the_known_limits() {
        for a0 in [0.0, 0.3, -1.0, 1.9, 2.5] {
            let along = SpecificForce::new(2.0, 0.0, 0.0);
            let [sine, noise] = [
                Sensitivity::new(a0, Harmonic { amplitude_g: along }),
                Sensitivity::new(a0, Random::along(along)),
            ]
            .map(|sensitivity| sensitivity.nominal[2]);
            let found = absolute_excess(a0, 0.0, &[2.0]);
            assert!((found - sine).abs() < 2e-6, "{a0}: {found} for {sine}");
            let found = absolute_excess(a0, 2.0, &[]);
            assert!((found - noise).abs() < 1e-9, "{a0}: {found} for {noise}");
        }
    }
}
