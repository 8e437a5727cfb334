//! Nodes of integration rules.

use std::f64::consts::PI;

/// Nodes between -`reach` and `reach` at equal distances, each with its width.
pub(super) fn evenly(reach: f64, nodes: usize, mut visit: impl FnMut(f64, f64)) {
    let width = 2.0 * reach / nodes as f64;
    for k in 0..nodes {
        visit((k as f64 + 0.5) * width - reach, width);
    }
}

/// Nodes of Gauss and Legendre's rule on every piece between -`reach`, the kinks and `reach`, each with its width.
pub(super) fn pieces(
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
pub(super) fn gauss_legendre(n: usize) -> Vec<[f64; 2]> {
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

#[cfg(test)]
mod tests {
    use super::*;

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
