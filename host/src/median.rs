//! The middle of a few numbers, and how far they scatter.

/// 1 / 0.6745: a normal standard deviation over the median of moduli.
pub(crate) const MEDIAN_TO_SIGMA: f64 = 1.482_6;

/// The middle value, the mean of the two in the middle of an even number; `None` of none.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    let (count, middle) = (values.len(), values.len() / 2);
    if count == 0 {
        return None;
    }
    let (lower, upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let below = lower.iter().copied().max_by(f64::total_cmp);
    Some(match below {
        Some(below) if count.is_multiple_of(2) => 0.5 * (below + *upper),
        _ => *upper,
    })
}

/// Where Huber's scale cuts deviations off, in standard deviations, and the mean of the cut square of a normal variable.
const CUT: f64 = 2.0;
const MEAN_OF_CUT: f64 = 0.920_535;

/// Standard deviation of the logarithm of [`scale`] of n normal deviations, times sqrt n: by 6 % more than that of the root mean
/// square (Huber, Robust Statistics, 1981, chapter 5: influence function of proposal 2).
pub const SPREAD_OF_SCALE: f64 = 0.7517;

/// The standard deviation of `moduli` of deviations about a known centre, by Huber's proposal 2: deviations beyond two of it
/// count as two. `None` of none, or where the most are zero.
pub fn scale(moduli: &[f64]) -> Option<f64> {
    let mut scale = MEDIAN_TO_SIGMA * median(moduli.to_vec())?;
    if scale.is_nan() || scale <= 0.0 {
        return None;
    }
    for _ in 0..50 {
        let cut = moduli.iter().map(|z| (z / scale).powi(2).min(CUT * CUT));
        let ratio = (cut.sum::<f64>() / moduli.len() as f64 / MEAN_OF_CUT).sqrt();
        scale *= ratio;
        if (ratio - 1.0).abs() < 1e-6 {
            break;
        }
    }
    Some(scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// Two-sided: the mean is right, the spread is the stated one, and two wild deviations move it by little.
    #[test]
    fn the_scale_of_normal_deviations_scatters_as_stated() {
        const N: usize = 100;
        let mut stream = ChaCha8Rng::seed_from_u64(5);
        let (mut sum, mut square, mut moved) = (0.0, 0.0, 0.0_f64);
        let rounds = 4000;
        for _ in 0..rounds {
            let mut moduli: Vec<f64> = (0..N)
                .map(|_| stream.sample::<f64, _>(StandardNormal).abs())
                .collect();
            let found = scale(&moduli).unwrap().ln();
            sum += found;
            square += found * found * N as f64 / SPREAD_OF_SCALE.powi(2);
            (moduli[0], moduli[1]) = (1e3, 1e6);
            moved = moved.max(scale(&moduli).unwrap().ln() - found);
        }
        let rounds = f64::from(rounds);
        assert!((sum / rounds).abs() < 0.01, "{}", sum / rounds);
        assert!(
            (0.93..1.1).contains(&(square / rounds)),
            "{}",
            square / rounds
        );
        assert!(moved < 0.1, "{moved}");
        assert_eq!(scale(&[]), None);
        assert_eq!(scale(&[0.0, 0.0, 1.0]), None);
    }
}
