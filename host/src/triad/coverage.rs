//! How positions cover the sphere.

/// Directions that cover the sphere evenly: a spiral.
pub fn spiral(count: usize) -> Vec<[f64; 3]> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let point = |k: usize| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let r = (1.0 - z * z).sqrt();
        let (sin, cos) = (golden * k as f64).sin_cos();
        [r * cos, r * sin, z]
    };
    (0..count).map(point).collect()
}

/// Directions among which a hole is looked for: 6 deg apart.
const PROBES: usize = 1000;

/// The direction that is farthest from every position, and how far, rad.
pub fn largest_hole(directions: &[[f64; 3]]) -> ([f64; 3], f64) {
    let farthest = |probe: &[f64; 3]| {
        let cosine = |d: &[f64; 3]| d.iter().zip(probe).map(|(a, b)| a * b).sum::<f64>();
        let nearest = directions.iter().map(cosine).fold(-1.0, f64::max);
        nearest.clamp(-1.0, 1.0).acos()
    };
    let probes = spiral(PROBES);
    let first = (probes[0], farthest(&probes[0]));
    probes.iter().fold(first, |best, probe| {
        let hole = farthest(probe);
        if hole > best.1 { (*probe, hole) } else { best }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cap_without_positions_is_the_hole() {
        let all = spiral(200);
        let (_, even) = largest_hole(&all);
        assert!(even < 0.25, "{even}");
        let south: Vec<_> = all.into_iter().filter(|d| d[2] < 0.3).collect();
        let (direction, hole) = largest_hole(&south);
        assert!(direction[2] > 0.95 && hole > 1.0, "{direction:?} {hole}");
    }
}
