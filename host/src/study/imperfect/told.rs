//! Whether an answer tells the imperfection itself.

use crate::bench::simulate::{ImperfectionTruth, Simulation};
use crate::campaign::Campaign;
use crate::diagnose::Diagnosis;
use crate::diagnose::answer::{AxisEstimate, Estimate, ShakerEstimate};
use crate::error::Error;

/// What a command answers: the campaign as it was used and the diagnosis, or the line of a refusal.
type Answered = Result<(Campaign, Diagnosis), Error>;

/// What telling an imperfection is.
enum Telling {
    /// Every row that it touches is named.
    Rows,
    /// These kinds of noise are said not to be as stated.
    Noise(&'static [&'static str]),
    /// A refusal, or a contradiction of columns.
    Contradiction,
    /// What is absent is said, by one of these words.
    Absent(&'static str),
    /// A figure of its own is remarked.
    Remark(fn(&Diagnosis, &ImperfectionTruth) -> bool),
}

/// What telling each imperfection is; those that change nothing an answer could tell are not here.
const TELLINGS: &[(&str, Telling)] = &[
    ("session-bias", Telling::Remark(session_bias)),
    ("session-alignment", Telling::Remark(session_alignment)),
    ("session-gain", Telling::Remark(session_gain)),
    ("session-day", Telling::Remark(session_bias)),
    ("noise-readings", Telling::Noise(&["readings"])),
    ("noise-runs", Telling::Noise(&["plateaus"])),
    ("noise-all", Telling::Noise(&["readings", "plateaus"])),
    ("gross-reading", Telling::Rows),
    ("gross-readings", Telling::Rows),
    ("gross-run", Telling::Rows),
    ("gross-runs", Telling::Rows),
    ("angle-off", Telling::Rows),
    ("angle-digits", Telling::Rows),
    ("angle-180", Telling::Rows),
    ("rows-swapped", Telling::Rows),
    ("level-typed", Telling::Rows),
    ("reference-mean", Telling::Rows),
    ("levels-factor", Telling::Contradiction),
    ("levels-rms", Telling::Contradiction),
    ("levels-ms2", Telling::Contradiction),
    ("sign-direction", Telling::Contradiction),
    ("sign-axis", Telling::Contradiction),
    ("reference-reversed", Telling::Contradiction),
    ("reference-zeros", Telling::Contradiction),
    ("extremes-mean", Telling::Contradiction),
    ("no-before", Telling::Contradiction),
    ("no-recovery", Telling::Absent("recovery")),
    ("no-drift", Telling::Absent("drift")),
    ("no-extremes", Telling::Absent("extremes")),
    ("no-reference", Telling::Absent("reference")),
    ("reference-noise", Telling::Remark(reference_noise)),
    ("reference-cross", Telling::Remark(reference_cross)),
    ("reference-gain", Telling::Remark(reference_gain)),
    ("reference-scatter", Telling::Remark(reference_scatter)),
    ("peak-gain", Telling::Remark(peak_gain)),
    ("table-scatter", Telling::Remark(table_scatter)),
    ("table-gain", Telling::Remark(table_gain)),
    ("plausible", Telling::Remark(plausible)),
];

/// Whether the imperfection is told; `None` without one, or where there is nothing to tell.
pub(super) fn told(simulation: &Simulation, answered: &Answered) -> Option<bool> {
    let truth = simulation.truth.imperfections.first()?;
    let (_, telling) = TELLINGS.iter().find(|(id, _)| *id == truth.id)?;
    Some(match (telling, answered) {
        (Telling::Contradiction, Err(_)) => true,
        (Telling::Contradiction, Ok((_, diagnosis))) => !diagnosis.contradictions.is_empty(),
        (Telling::Rows, Err(error)) => refused_by_row(&truth.rows, error),
        (Telling::Rows, Ok((campaign, diagnosis))) => {
            let named = named_rows(campaign, diagnosis);
            truth.rows.iter().all(|row| named.contains(row))
        }
        (Telling::Noise(of), Ok((_, diagnosis))) => of.iter().all(|of| misstated(diagnosis, of)),
        (Telling::Absent(word), Ok((_, diagnosis))) => {
            let said = diagnosis.not_looked_at.iter();
            said.into_iter().any(|said| said.contains(word))
        }
        (Telling::Remark(remarked), Ok((_, diagnosis))) => remarked(diagnosis, truth),
        (_, Err(_)) => false,
    })
}

/// Rows that an answer says do not belong, as `static.csv:12`.
pub(super) fn named_rows(campaign: &Campaign, diagnosis: &Diagnosis) -> Vec<String> {
    let suspects = diagnosis.suspects.iter();
    let suspects = suspects.map(|row| format!("{}:{}", row.file, row.row));
    let places = diagnosis.contradictions.iter();
    let places = places.flat_map(|one| one.places(&campaign.runs));
    let lines = places.map(|place| format!("vibration.csv:{}", campaign.runs[place].line));
    let mut rows: Vec<String> = suspects.chain(lines).collect();
    rows.sort();
    rows.dedup();
    rows
}

/// Whether a refusal names one of the rows.
fn refused_by_row(rows: &[String], error: &Error) -> bool {
    let Error::Input { place, .. } = error else {
        return false;
    };
    let name = place.file.file_name().unwrap_or_default().to_string_lossy();
    let row = place.row.map(|row| format!("{name}:{row}"));
    row.is_some_and(|row| rows.contains(&row))
}

fn misstated(diagnosis: &Diagnosis, of: &str) -> bool {
    let mut noise = diagnosis.noise.iter();
    noise.any(|noise| noise.of == of && !noise.stated_holds)
}

// Both are chosen. With two sigma a sound laboratory with nine figures would be told of something in every second campaign.

/// Standard uncertainties off the value without an imperfection from which on a figure tells one.
const CLEAR: f64 = 3.0;
/// Relative error within which the size of a scatter or a noise counts as told.
const WITHIN: f64 = 0.3;

fn clear(estimate: Estimate, without: f64) -> bool {
    (estimate.value - without).abs() > CLEAR * estimate.sigma
}

fn session_bias(diagnosis: &Diagnosis, _: &ImperfectionTruth) -> bool {
    // Of two sessions of the shaker the one's bias less the other's, whose common uncertainty is that of the readings.
    let found: Vec<Estimate> = diagnosis.sessions.iter().filter_map(|s| s.bias_g).collect();
    match found[..] {
        [one, other] => {
            let value = other.value - one.value;
            let sigma = one.sigma.hypot(other.sigma);
            clear(Estimate { value, sigma }, 0.0)
        }
        _ => found.iter().any(|bias_g| clear(*bias_g, 0.0)),
    }
}

fn session_alignment(diagnosis: &Diagnosis, _: &ImperfectionTruth) -> bool {
    let mut turns = diagnosis.sessions.iter().flat_map(|s| &s.alignment_rad);
    turns.any(|turn| clear(*turn, 0.0))
}

fn session_gain(diagnosis: &Diagnosis, _: &ImperfectionTruth) -> bool {
    let mut gains = diagnosis.sessions.iter().filter_map(|s| s.gain);
    gains.any(|gain| clear(gain, 1.0))
}

fn shaker(diagnosis: &Diagnosis, remarked: impl Fn(&ShakerEstimate) -> bool) -> bool {
    diagnosis.shaker.as_ref().is_some_and(remarked)
}

fn as_large(found: Option<f64>, size: f64) -> bool {
    found.is_some_and(|found| (found / size - 1.0).abs() < WITHIN)
}

fn any_clear(elements: &[AxisEstimate], without: f64) -> bool {
    let estimate = |element: &AxisEstimate| Estimate {
        value: element.value,
        sigma: element.sigma,
    };
    elements
        .iter()
        .any(|element| clear(estimate(element), without))
}

fn size(truth: &ImperfectionTruth) -> f64 {
    truth.size.unwrap_or_default()
}

fn reference_noise(diagnosis: &Diagnosis, truth: &ImperfectionTruth) -> bool {
    shaker(diagnosis, |s| {
        as_large(s.reference_noise_g, 1e-3 * size(truth))
    })
}

fn reference_cross(diagnosis: &Diagnosis, _: &ImperfectionTruth) -> bool {
    shaker(diagnosis, |s| {
        any_clear(&s.reference_cross_sensitivity, 0.0)
    })
}

fn reference_gain(diagnosis: &Diagnosis, _: &ImperfectionTruth) -> bool {
    shaker(diagnosis, |s| any_clear(&s.reference_gain, 1.0))
}

fn reference_scatter(diagnosis: &Diagnosis, truth: &ImperfectionTruth) -> bool {
    shaker(diagnosis, |s| as_large(s.reference_scatter, size(truth)))
}

fn table_scatter(diagnosis: &Diagnosis, truth: &ImperfectionTruth) -> bool {
    shaker(diagnosis, |s| as_large(s.table_scatter, size(truth)))
}

fn table_gain(diagnosis: &Diagnosis, _: &ImperfectionTruth) -> bool {
    shaker(diagnosis, |s| {
        s.table_level.is_some_and(|level| clear(level, 1.0))
    })
}

fn peak_gain(diagnosis: &Diagnosis, _: &ImperfectionTruth) -> bool {
    shaker(diagnosis, |s| {
        s.peak_gain.is_some_and(|gain| clear(gain, 1.0))
    })
}

/// Three of its four at least: misstated noise, cross-sensitivity, noise of the reference, scatter of the table.
fn plausible(diagnosis: &Diagnosis, _: &ImperfectionTruth) -> bool {
    let remarks = [
        misstated(diagnosis, "readings") || misstated(diagnosis, "plateaus"),
        shaker(diagnosis, |s| {
            any_clear(&s.reference_cross_sensitivity, 0.0)
        }),
        shaker(diagnosis, |s| as_large(s.reference_noise_g, 2e-3)),
        shaker(diagnosis, |s| as_large(s.table_scatter, 0.003)),
    ];
    remarks.into_iter().filter(|remarked| *remarked).count() >= 3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::imperfections::{catalogue, find};
    use crate::bench::noise::Seed;
    use crate::bench::plan::Static;
    use crate::bench::simulate::{Specification, VirtualBench};
    use crate::diagnose::diagnose;

    #[test]
    fn every_imperfection_is_told_somehow_but_those_that_change_nothing_an_answer_could_tell() {
        assert!(TELLINGS.iter().all(|(id, _)| find(id).is_some()));
        let untold = catalogue().filter(|entry| TELLINGS.iter().all(|(id, _)| *id != entry.id));
        let untold: Vec<&str> = untold.map(|entry| entry.id).collect();
        let expected = [
            "session-day-unmarked",
            "dial-sigma",
            "inverted",
            "times-of-day",
            "heavy-tails",
        ];
        assert_eq!(untold, expected);
    }

    /// Of a sound laboratory each telling is false, but for figures that chance puts beyond three sigma: of at most six each, one
    /// in sixty campaigns.
    #[test]
    fn a_sound_laboratory_is_told_of_nothing() -> Result<(), Error> {
        const CAMPAIGNS: u64 = 8;
        let mut alarms: std::collections::BTreeMap<&str, u64> = Default::default();
        for seed in 0..CAMPAIGNS {
            let specification = Specification::with_dial_sigma(1.0);
            let bench = VirtualBench::new(Seed(seed), Static::Default, specification, Vec::new());
            let mut simulation = bench.simulate();
            let diagnosis = diagnose(&simulation.campaign, &[])?.diagnosis;
            let answered = Ok((simulation.campaign.clone(), diagnosis));
            for (id, _) in TELLINGS {
                let entry = find(id).ok_or(Error::Usage("no such entry".into()))?;
                simulation.truth.imperfections = vec![ImperfectionTruth {
                    id,
                    size: entry.size.map(|size| size.usual),
                    unit: "",
                    parameters: serde_json::Map::new(),
                    rows: vec!["static.csv:9".into()],
                }];
                if told(&simulation, &answered) != Some(false) {
                    *alarms.entry(id).or_default() += 1;
                }
            }
        }
        assert!(alarms.values().all(|count| *count <= 2), "{alarms:?}");
        Ok(())
    }
}
