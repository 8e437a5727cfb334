//! The one slip of the hand that makes sense of a reading or run which does not belong.

use shared::model::SpecificForce;
use shared::tumble::{Position, Series, within_a_turn};

use super::likely::typed;
use crate::campaign::{Campaign, Reading, Run};

/// Standard deviations within which a slip explains an output.
const FITS: f64 = 4.0;

/// Distance, in standard deviations, from which on a wrong digit can be told: nine digits cover a share of about 4 x 8 / distance
/// of all distances by chance, 5 % here.
const DIGIT_TOLD: f64 = 600.0;

/// What makes sense of the reading at a place in the campaign: `dial_deg 135 instead of 153`, `rows 12 and 14 swapped`. `output_v`
/// is the output, V, that all other rows expect for a specific force, g, and `sigma_v` the standard deviation of a
/// reading about it, V. Rows are lines of static.csv, the header is 1.
pub fn slip(
    campaign: &Campaign,
    place: usize,
    output_v: &dyn Fn(SpecificForce<f64>) -> f64,
    sigma_v: f64,
) -> Option<String> {
    let reading = &campaign.readings[place];
    let fits =
        |force: SpecificForce<f64>, u_v: f64| (output_v(force) - u_v).abs() <= FITS * sigma_v;
    if fits(reading.specific_force_g, reading.output_v) {
        return None;
    }
    let swapped = || {
        let other = campaign.readings.iter().position(|other| {
            fits(other.specific_force_g, reading.output_v)
                && fits(reading.specific_force_g, other.output_v)
                && !fits(other.specific_force_g, other.output_v)
        });
        other.map(|other| swap(reading.line, campaign.readings[other].line))
    };
    let expected_v = output_v(reading.specific_force_g);
    swapped()
        .or_else(|| dial(campaign, reading, output_v, sigma_v))
        .or_else(|| of_number("u_v", reading.output_v, expected_v, sigma_v))
}

/// What makes sense of the run at a place in the campaign. `shift_v` is what all other rows expect of its output during the
/// vibration less before it, V, and `sigma_v` the standard deviation of that difference, V.
pub fn slip_of_run(
    campaign: &Campaign,
    place: usize,
    shift_v: &dyn Fn(&Run) -> f64,
    sigma_v: f64,
) -> Option<String> {
    let run = &campaign.runs[place];
    let measured = run.measured?;
    let shift = |run: &Run| run.measured.map(|m| m.during_v - m.before_v);
    let fits = |run: &Run, v: f64| (shift_v(run) - v).abs() <= FITS * sigma_v;
    let seen_v = measured.during_v - measured.before_v;
    if fits(run, seen_v) {
        return None;
    }
    let swapped = || {
        let other = campaign.runs.iter().position(|other| {
            shift(other).is_some_and(|v| fits(other, seen_v) && fits(run, v) && !fits(other, v))
        });
        other.map(|other| swap(run.line, campaign.runs[other].line))
    };
    let level = || {
        let with = |level_g: &f64| {
            fits(
                &Run {
                    level_g: *level_g,
                    ..run.clone()
                },
                seen_v,
            )
        };
        let level_g = levels(campaign, run.level_g).into_iter().find(with)?;
        Some(format!(
            "level_g {} instead of {}",
            typed(level_g),
            run.level_g
        ))
    };
    let sign = || {
        let turned = |axis: &usize| {
            let mut turned = run.clone();
            turned.direction[*axis] *= -1.0;
            run.direction[*axis] != 0.0 && fits(&turned, seen_v)
        };
        let axis = (0..3).find(turned)?;
        Some(format!("sign of {}", ["dir_i", "dir_p", "dir_o"][axis]))
    };
    let turned = || fits(run, -seen_v).then(|| "u_before_v and u_during_v swapped".into());
    let expected_v = measured.before_v + shift_v(run);
    swapped()
        .or_else(level)
        .or_else(sign)
        .or_else(turned)
        .or_else(|| of_number("u_during_v", measured.during_v, expected_v, sigma_v))
}

fn swap(one: u64, other: u64) -> String {
    format!("rows {} and {} swapped", one.min(other), one.max(other))
}

/// Levels that a person may have meant: other decimal points, rms for peak, doubled, those of other runs, swapped digits.
fn levels(campaign: &Campaign, level_g: f64) -> Vec<f64> {
    let factors = [
        0.1,
        10.0,
        0.01,
        100.0,
        0.5,
        2.0,
        std::f64::consts::SQRT_2,
        std::f64::consts::FRAC_1_SQRT_2,
    ];
    let meant = factors.iter().map(|factor| level_g * factor);
    let mut meant: Vec<f64> = meant.chain(transposed(level_g)).collect();
    let mut planned: Vec<f64> = campaign.runs.iter().map(|run| run.level_g).collect();
    planned.sort_by(f64::total_cmp);
    planned.dedup();
    meant.extend(planned);
    meant
}

/// Another dial angle, or series: swapped digits first, then half a turn, then the next of the plan's angles that fit.
fn dial(
    campaign: &Campaign,
    reading: &Reading,
    output_v: &dyn Fn(SpecificForce<f64>) -> f64,
    sigma_v: f64,
) -> Option<String> {
    let gravity_g = campaign.config.bench.local_gravity_g;
    let off_v = |series: Series, dial_deg: f64| {
        let position = Position {
            series,
            dial_deg,
            mount_deg: reading.mount_deg,
        };
        let force = position.specific_force();
        let force = SpecificForce::new(
            gravity_g * force.i,
            gravity_g * force.p,
            gravity_g * force.o,
        );
        (output_v(force) - reading.output_v).abs()
    };
    let fits = |dial_deg: &f64| off_v(reading.series, *dial_deg) <= FITS * sigma_v;
    let instead = |dial_deg: f64| format!("dial_deg {dial_deg} instead of {}", reading.dial_deg);
    let half_turn_deg = within_a_turn(reading.dial_deg + 180.0);
    if let Some(dial_deg) = transposed(reading.dial_deg).into_iter().find(fits) {
        return Some(instead(dial_deg));
    }
    if fits(&half_turn_deg) {
        return Some(format!("dial 180 deg off: {}", instead(half_turn_deg)));
    }
    let planned = campaign
        .readings
        .iter()
        .map(|other| other.dial_deg)
        .filter(fits);
    let away_deg = |dial_deg: f64| {
        let turned_deg = within_a_turn(dial_deg - reading.dial_deg);
        turned_deg.min(360.0 - turned_deg)
    };
    if let Some(dial_deg) = planned.min_by(|a, b| away_deg(*a).total_cmp(&away_deg(*b))) {
        return Some(instead(dial_deg));
    }
    let other = |series: &Series| {
        *series != reading.series && off_v(*series, reading.dial_deg) <= FITS * sigma_v
    };
    let series = Series::ALL.into_iter().find(other)?;
    Some(format!(
        "series {} instead of {}",
        u8::from(series),
        u8::from(reading.series)
    ))
}

/// A number of which `expected` is about what it should be: its sign, its decimal point, two of its digits, one of them.
fn of_number(column: &str, holds: f64, expected: f64, sigma: f64) -> Option<String> {
    let fits = |value: f64, scale: f64| (value - expected).abs() <= FITS * sigma * scale.max(1.0);
    if fits(-holds, 1.0) {
        return Some(format!("sign of {column}"));
    }
    let powers = [(10.0, "ten"), (100.0, "a hundred"), (1000.0, "a thousand")];
    for (power, word) in powers {
        if fits(holds / power, 1.0) {
            return Some(format!("{column} {word} times too large"));
        }
        if fits(holds * power, power) && expected.abs() > FITS * sigma * power {
            return Some(format!("{column} {word} times too small"));
        }
    }
    if transposed(holds).into_iter().any(|value| fits(value, 1.0)) {
        return Some(format!("two digits of {column} swapped"));
    }
    let told = (holds - expected).abs() > DIGIT_TOLD * sigma;
    let digit = told && with_another_digit(holds).any(|value| fits(value, 1.0));
    digit.then(|| format!("a digit of {column}"))
}

/// The number with two neighbouring digits in each other's place.
fn transposed(value: f64) -> Vec<f64> {
    let text = value.to_string().into_bytes();
    let digits: Vec<usize> = (0..text.len())
        .filter(|&at| text[at].is_ascii_digit())
        .collect();
    let swapped = digits
        .windows(2)
        .filter(|pair| text[pair[0]] != text[pair[1]]);
    let swapped = swapped.filter_map(|pair| {
        let mut text = text.clone();
        text.swap(pair[0], pair[1]);
        String::from_utf8(text).ok()?.parse().ok()
    });
    swapped.collect()
}

/// The number with another digit in one place.
fn with_another_digit(value: f64) -> impl Iterator<Item = f64> {
    let text = value.to_string().into_bytes();
    let digits_at: Vec<usize> = (0..text.len())
        .filter(|&at| text[at].is_ascii_digit())
        .collect();
    digits_at.into_iter().flat_map(move |at| {
        let text = text.clone();
        (b'0'..=b'9').filter_map(move |digit| {
            let mut text = text.clone();
            text[at] = digit;
            String::from_utf8(text).ok()?.parse().ok()
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_digits_are_swapped_across_the_point_and_never_equal_ones() {
        assert_eq!(transposed(153.0), [513.0, 135.0]);
        assert_eq!(transposed(-1.22), [-2.12]);
    }

    #[test]
    fn a_digit_is_told_only_of_a_number_that_lies_far_enough_off() {
        let (holds, sigma) = (1.234_567_89, 1e-6);
        assert_eq!(
            of_number("u_v", holds, 1.434_567_5, sigma).as_deref(),
            Some("a digit of u_v")
        );
        assert_eq!(of_number("u_v", holds, 1.234_767_89, sigma), None);
        assert_eq!(of_number("u_v", holds, 1.4421, sigma), None);
    }

    #[test]
    fn sign_and_decimal_point_are_told() {
        let told = |holds| of_number("u_v", holds, -1.2, 1e-6);
        assert_eq!(told(1.2).as_deref(), Some("sign of u_v"));
        assert_eq!(told(-12.0).as_deref(), Some("u_v ten times too large"));
        assert_eq!(
            told(-0.0012).as_deref(),
            Some("u_v a thousand times too small")
        );
        assert_eq!(told(-2.1).as_deref(), Some("two digits of u_v swapped"));
    }
}
