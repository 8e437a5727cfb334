//! Factors that a slip of the hand makes, and numbers as a person types them.

use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

use super::robust::near;
use super::{ANY_REFERENCE, LEVEL};
use crate::error::decimal;

/// Which of two columns is wrong, where a third one tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wrong {
    Level,
    Reference,
    Unknown,
}

/// How near a factor comes to that of a slip: the errors of a reference's gain stay within.
const TOLERANCE: f64 = 0.02;

/// Standard acceleration, m/s^2 (ISO 80000-3).
const STANDARD_GRAVITY: f64 = 9.80665;

/// A factor of the command over the reference, with what was done to the level if it is that which is wrong, and
/// to the reference.
struct Slip {
    factor: f64,
    level: Option<&'static str>,
    reference: Option<&'static str>,
}

const fn slip(factor: f64, level: Option<&'static str>, reference: Option<&'static str>) -> Slip {
    Slip {
        factor,
        level,
        reference,
    }
}

/// 9.80665 stands before 10: the nearest is taken.
const SLIPS: [Slip; 14] = [
    slip(
        FRAC_1_SQRT_2,
        Some("rms entered for peak"),
        Some("peak entered for rms"),
    ),
    slip(
        SQRT_2,
        Some("peak entered for rms"),
        Some("divided by sqrt 2 once too often"),
    ),
    slip(2.0, Some("peak to peak entered for peak"), Some("halved")),
    slip(0.5, Some("halved"), Some("doubled")),
    slip(
        FRAC_1_SQRT_2 / 2.0,
        None,
        Some("peak to peak entered for rms"),
    ),
    slip(2.0 * SQRT_2, Some("peak to peak entered for rms"), None),
    slip(
        STANDARD_GRAVITY,
        Some("m/s^2 entered for g"),
        Some("divided by 9.80665 once too often"),
    ),
    slip(
        1.0 / STANDARD_GRAVITY,
        Some("divided by 9.80665 once too often"),
        Some("m/s^2 entered for g"),
    ),
    slip(10.0, Some("decimal point"), Some("decimal point")),
    slip(0.1, Some("decimal point"), Some("decimal point")),
    slip(100.0, Some("decimal point"), Some("decimal point")),
    slip(0.01, Some("decimal point"), Some("decimal point")),
    slip(1000.0, Some("mg entered for g"), None),
    slip(0.001, None, Some("mg entered for g")),
];

fn nearest(factor: f64) -> Option<&'static Slip> {
    let distance = |slip: &&Slip| (slip.factor / factor).ln().abs();
    let nearest = SLIPS
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.filter(|slip| near(slip.factor, factor, TOLERANCE))
}

/// Is this the factor of a slip of the hand?
pub(super) fn is_slip(factor: f64) -> bool {
    nearest(factor).is_some()
}

/// What explains that command over reference comes to `factor`.
pub(super) fn of_factor(factor: f64, wrong: Wrong, reference_column: &str) -> String {
    let nearest = nearest(factor);
    let level = nearest
        .and_then(|slip| slip.level)
        .map(|done| format!("{done} in {LEVEL}"));
    let reference = nearest.and_then(|slip| slip.reference);
    let reference = reference.map(|done| format!("{done} in {reference_column}"));
    let another = |column: &str| format!("{column} is in another unit or scale");
    match (wrong, level, reference) {
        (Wrong::Level, level, _) => level.unwrap_or_else(|| another(LEVEL)),
        (Wrong::Reference, _, reference) => reference.unwrap_or_else(|| another(reference_column)),
        (Wrong::Unknown, Some(level), Some(reference)) => format!("{level}, or {reference}"),
        (Wrong::Unknown, Some(one), None) | (Wrong::Unknown, None, Some(one)) => one,
        (Wrong::Unknown, None, None) => match reference_column {
            ANY_REFERENCE => "the level or the reference is in another unit or scale".into(),
            _ => another(&format!("{LEVEL} or {reference_column}")),
        },
    }
}

/// Words for one cell that should hold about `should` and holds `holds`: the number that a person would have typed.
pub(super) fn of_cell(column: &str, holds: f64, should: f64) -> String {
    let instead = format!("{column} {} instead of {}", typed(should), decimal(holds));
    let decades = (holds / should).log10();
    let whole = decades.round();
    match whole != 0.0 && near(10_f64.powf(decades - whole), 1.0, TOLERANCE) {
        true => format!("decimal point: {instead}"),
        false => instead,
    }
}

/// A number with two digits where these are within 1 % of it, else with three.
pub(super) fn typed(value: f64) -> f64 {
    let with = |digits: usize| format!("{value:.*e}", digits - 1).parse().unwrap_or(value);
    let two: f64 = with(2);
    match (two - value).abs() <= 0.01 * value.abs() {
        true => two,
        false => with(3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_typed_with_as_few_digits_as_serve() {
        assert_eq!(
            [1.998, 20.1, 0.7093, 1.253].map(typed),
            [2.0, 20.0, 0.71, 1.25]
        );
    }

    #[test]
    fn every_slip_is_told_from_every_other_within_the_tolerance() {
        for (at, slip) in SLIPS.iter().enumerate() {
            for other in &SLIPS[at + 1..] {
                let apart = (slip.factor / other.factor).ln().abs();
                // 9.80665 and 10 are 2 % apart, and the nearest is taken.
                assert!(apart > 0.019, "{} {}", slip.factor, other.factor);
            }
            let words = of_factor(slip.factor, Wrong::Unknown, ANY_REFERENCE);
            assert!(!words.contains("another unit"), "{words}");
        }
        let words = of_factor(1.3, Wrong::Unknown, ANY_REFERENCE);
        assert_eq!(
            words,
            "the level or the reference is in another unit or scale"
        );
    }
}
