//! How well a share is known from so many trials.

use serde::Serialize;
use statrs::distribution::{Beta, ContinuousCDF};

/// A share of trials, with its interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Share {
    /// Trials that count.
    pub count: u64,
    /// All trials.
    pub of: u64,
    /// The central 95 % interval of Clopper and Pearson (Biometrika 26, 1934); 0 to 1 without a trial.
    pub interval_95: [f64; 2],
}

/// Probability that is left out at each end.
const TAIL: f64 = 0.025;

impl Share {
    /// Of trials, each of which counts or not.
    pub fn of(trials: impl IntoIterator<Item = bool>) -> Self {
        let (mut count, mut of) = (0, 0);
        for counts in trials {
            count += u64::from(counts);
            of += 1;
        }
        let quantile = |successes: u64, failures: u64, probability: f64, without: f64| {
            let beta = Beta::new(successes as f64, failures as f64);
            beta.map_or(without, |beta| beta.inverse_cdf(probability))
        };
        let failures = of - count;
        // A beta distribution has no parameter 0: at an end of the range the bound is that end.
        let low = quantile(count, failures + 1, TAIL, 0.0);
        let high = quantile(count + 1, failures, 1.0 - TAIL, 1.0);
        Self {
            count,
            of,
            interval_95: [low, high],
        }
    }

    /// `95.1 % (83 to 99)` of the trials; `-` without one.
    pub fn text(&self) -> String {
        if self.of == 0 {
            return "-".into();
        }
        let [low, high] = self.interval_95.map(|end| 100.0 * end);
        let share = 100.0 * self.count as f64 / self.of as f64;
        format!("{share:.1} % ({low:.0} to {high:.0})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(count: u64, of: u64) -> Share {
        Share::of((0..of).map(|n| n < count))
    }

    /// The equations that define the interval, by the binomial distribution itself: as many or more at the low end, as many
    /// or fewer at the high end, have the probability 2.5 %.
    #[test]
    fn each_end_leaves_a_fortieth_of_the_binomial_beyond_what_was_found() {
        for (count, of) in [(1, 10), (5, 10), (9, 10), (3, 132), (40, 41)] {
            let [low, high] = share(count, of).interval_95;
            let term = |k: u64, p: f64| {
                let ways = (0..k).fold(1.0, |ways, j| ways * (of - j) as f64 / (j + 1) as f64);
                ways * p.powi(k as i32) * (1.0 - p).powi((of - k) as i32)
            };
            let above: f64 = (count..=of).map(|k| term(k, low)).sum();
            let below: f64 = (0..=count).map(|k| term(k, high)).sum();
            assert!((above - 0.025).abs() < 1e-6, "{count} of {of}: {above}");
            assert!((below - 0.025).abs() < 1e-6, "{count} of {of}: {below}");
        }
    }

    #[test]
    fn none_and_all_have_one_end_at_the_range_and_no_trial_says_nothing() {
        let [low, high] = share(0, 30).interval_95;
        assert_eq!(low, 0.0);
        assert!((high - (1.0 - 0.025_f64.powf(1.0 / 30.0))).abs() < 1e-6);
        let [low, high] = share(30, 30).interval_95;
        assert_eq!(high, 1.0);
        assert!((low - 0.025_f64.powf(1.0 / 30.0)).abs() < 1e-6);
        assert_eq!(share(0, 0).interval_95, [0.0, 1.0]);
        assert_eq!(share(0, 0).text(), "-");
    }
}
