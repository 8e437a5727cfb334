//! Slips of the hand in the static table. The nominal specific force is computed from the angle, right or wrong.

use super::occurrence::{File, Occurrence, Tables};
use super::{Act, Entry, sized};
use crate::bench::dial;
use crate::bench::plan::Dwell;
use crate::campaign::{Reading, Series};

pub(super) const ENTRIES: &[Entry] = &[
    Entry {
        id: "angle-off",
        says: "one dial angle SIZE off its true one",
        size: sized(0.1, "deg", [0.0, 180.0]),
        act: Act::Hand(|tables, occurrence| {
            let error_deg = occurrence.signed_size();
            mistype(tables, occurrence, &|dial_deg| Some(dial_deg + error_deg));
        }),
    },
    Entry {
        id: "angle-digits",
        says: "two digits of one dial angle swapped",
        size: None,
        act: Act::Hand(|tables, occurrence| mistype(tables, occurrence, &swapped_digits)),
    },
    Entry {
        id: "angle-180",
        says: "one dial angle 180 deg off",
        size: None,
        act: Act::Hand(|tables, occurrence| {
            mistype(tables, occurrence, &|dial_deg| {
                Some((dial_deg + 180.0) % 360.0)
            });
        }),
    },
    Entry {
        id: "rows-swapped",
        says: "outputs of two readings of a series in each other's row",
        size: None,
        act: Act::Hand(swap_rows),
    },
];

/// Least sine of the angle to the vertical at which an angle counts as told by the output.
const TELLING: f64 = 0.3;

/// Writes another angle into one row whose output tells the angle.
fn mistype(
    tables: &mut Tables<'_>,
    occurrence: &mut Occurrence,
    typed: &dyn Fn(f64) -> Option<f64>,
) {
    let campaign = &mut *tables.campaign;
    let tells = |reading: &Reading| {
        let angle_deg = reading.dial_deg + reading.mount_deg;
        let right_g = reading.series.specific_force(angle_deg.to_radians()).i;
        let typed_deg = typed(reading.dial_deg).filter(|typed_deg| *typed_deg != reading.dial_deg);
        reading.series != Series::InputAxis
            && typed_deg.is_some_and(|typed_deg| {
                let angle_deg = typed_deg + reading.mount_deg;
                let typed_g = reading.series.specific_force(angle_deg.to_radians()).i;
                let small_rad = (typed_deg - reading.dial_deg).to_radians().abs().min(1.0);
                (typed_g - right_g).abs() > TELLING * small_rad
            })
    };
    let readings = campaign.readings.iter().enumerate();
    let candidates = readings
        .filter(|(_, reading)| tells(reading))
        .map(|(place, _)| place);
    let candidates = candidates.collect();
    for place in occurrence.choose(1, candidates) {
        let reading = &mut campaign.readings[place];
        occurrence.note("right_deg", reading.dial_deg);
        reading.dial_deg = typed(reading.dial_deg).unwrap_or(reading.dial_deg);
        occurrence.note("typed_deg", reading.dial_deg);
        let gravity_g = campaign.config.bench.local_gravity_g;
        let dwell = Dwell {
            series: reading.series,
            dial_deg: reading.dial_deg,
            mount_deg: reading.mount_deg,
            approach: reading.approach,
        };
        let [i, p, o] = dial::nominal(&dwell).map(|a| a * gravity_g);
        let force = &mut reading.specific_force_g;
        (force.i, force.p, force.o) = (i, p, o);
        occurrence.touch(File::Static, place);
    }
}

/// The largest angle within a turn that swapping two neighbouring digits of a whole one makes.
fn swapped_digits(dial_deg: f64) -> Option<f64> {
    let digits = format!("{dial_deg:.0}").into_bytes();
    let swaps = (1..digits.len()).filter_map(|place| {
        let mut digits = digits.clone();
        digits.swap(place - 1, place);
        let typed_deg: f64 = String::from_utf8(digits).ok()?.parse().ok()?;
        (typed_deg != dial_deg && typed_deg < 360.0).then_some(typed_deg)
    });
    swaps.max_by(f64::total_cmp)
}

/// Sigmas of a reading by which two outputs at least differ that are worth swapping.
const APART: f64 = 200.0;

fn swap_rows(tables: &mut Tables<'_>, occurrence: &mut Occurrence) {
    let readings = &mut tables.campaign.readings;
    let candidates =
        (0..readings.len()).filter(|&place| readings[place].series != Series::InputAxis);
    for one in occurrence.choose(1, candidates.collect()) {
        let reading = &readings[one];
        let apart = |other: &usize| {
            let other = &readings[*other];
            other.series == reading.series
                && (other.output_v - reading.output_v).abs() > APART * reading.sigma_v
        };
        let candidates = (0..readings.len()).filter(apart).collect();
        for other in occurrence.choose(1, candidates) {
            let kept_v = readings[one].output_v;
            readings[one].output_v = readings[other].output_v;
            readings[other].output_v = kept_v;
            occurrence.touch(File::Static, one);
            occurrence.touch(File::Static, other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::swapped_digits;

    #[test]
    fn digits_swap_to_another_angle_within_a_turn_or_not_at_all() {
        let found = [0.0, 30.0, 45.0, 120.0, 330.0].map(swapped_digits);
        assert_eq!(
            found,
            [None, Some(3.0), Some(54.0), Some(210.0), Some(303.0)]
        );
    }
}
