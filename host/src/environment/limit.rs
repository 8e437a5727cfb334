//! Pass, fail or cannot tell, with a guard band (ISO 14253-1, JCGM 106).

use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::quantity::Quantity;

/// Whether a limit is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kept {
    /// It is, but for the risk stated.
    Pass,
    /// It is not, but for the risk stated.
    Fail,
    /// Neither can be said at this risk.
    CannotTell,
}

impl Kept {
    /// In a word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::CannotTell => "cannot-tell",
        }
    }
}

/// A quantity against a limit of its magnitude.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// Greatest magnitude, g.
    pub limit_g: f64,
    /// Greatest probability of a wrong pass, and of a wrong fail.
    pub risk: f64,
    /// Probability that the limit is kept.
    pub probability_kept: f64,
    /// What is taken off the limit for a pass, g: the standard uncertainty times the quantile of the risk.
    pub guard_band_g: f64,
    /// Whether it is.
    pub verdict: Kept,
}

/// Judges a normally distributed quantity, g, by the probability that its magnitude is within `limit_g`. `None` of a quantity
/// that is not determined.
pub fn judge(quantity: Quantity, limit_g: f64, risk: f64) -> Option<Judgement> {
    let (value, sigma) = quantity.known()?;
    let standard = Normal::standard();
    let probability_kept = match sigma > 0.0 {
        true => standard.cdf((limit_g - value) / sigma) - standard.cdf((-limit_g - value) / sigma),
        false => f64::from(value.abs() <= limit_g),
    };
    let verdict = match probability_kept {
        kept if 1.0 - kept <= risk => Kept::Pass,
        kept if kept <= risk => Kept::Fail,
        _ => Kept::CannotTell,
    };
    Some(Judgement {
        limit_g,
        risk,
        probability_kept,
        guard_band_g: sigma * standard.inverse_cdf(1.0 - risk),
        verdict,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_changes_a_guard_band_from_the_limit() {
        let at = |value: f64| judge(Quantity::new(value, 1.0), 50.0, 0.05).map(|j| j.verdict);
        // The quantile of 5 % is 1.6449; the other side of the limit is fifty sigma away.
        for sign in [-1.0, 1.0] {
            assert_eq!(at(sign * (50.0 - 1.6450)), Some(Kept::Pass));
            assert_eq!(at(sign * (50.0 - 1.6448)), Some(Kept::CannotTell));
            assert_eq!(at(sign * (50.0 + 1.6448)), Some(Kept::CannotTell));
            assert_eq!(at(sign * (50.0 + 1.6450)), Some(Kept::Fail));
        }
        assert_eq!(judge(Quantity::UNDETERMINED, 50.0, 0.05), None);
    }

    /// A limit below the uncertainty can never be passed: both sides count.
    #[test]
    fn both_sides_of_the_limit_count() {
        let found = judge(Quantity::new(0.0, 1.0), 1.8, 0.05).unwrap();
        assert!((found.probability_kept - 0.928_1).abs() < 1e-3);
        assert_eq!(found.verdict, Kept::CannotTell);
    }
}
