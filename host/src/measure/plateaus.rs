//! Rests and plateaus of a record, found without windows, and each plateau's shift against the rests on either side.

use std::path::Path;

use super::answer::{Axis, Measurement, Picture, Plateau, Verdict};
use super::motion;
use super::segment::{Role, Segment};
use super::shift::{Scene, middle};
use super::survey::{Stretch, Survey};
use super::table::{self, Wanted};
use super::{Request, of_role, reasons, reduce, summary};
use crate::error::{Error, Problem};
use crate::quantity::Quantity;

/// Columns of the picture.
const PICTURE: usize = 240;

/// Measures all plateaus of a record.
pub(super) fn measure(file: &Path, request: &Request) -> Result<Measurement, Error> {
    let Request {
        columns,
        calibration,
        ..
    } = request;
    let (survey, remark) = table::survey(file, columns, calibration, |_| true)?;
    let wanted: Vec<Wanted> = survey
        .stretches()
        .into_iter()
        .map(|(kind, rows)| {
            let role = match kind {
                Stretch::Rest => Role::Rest,
                Stretch::Plateau => Role::Plateau,
            };
            Wanted {
                name: role.to_string(),
                role,
                rows: Some(rows),
            }
        })
        .collect();
    let segments = table::read_stretches(file, columns, None, &wanted, calibration)?;
    let (rests, shaken) = (
        of_role(&segments, Role::Rest),
        of_role(&segments, Role::Plateau),
    );
    let picture = picture(&survey, &rests, &shaken);
    if shaken.is_empty() || rests.is_empty() {
        return Err(Error::input(file, nothing(&rests, &shaken)));
    }
    let mut plateaus = Vec::new();
    let mut notes = Vec::from_iter(remark);
    for plateau in &shaken {
        let (scene, against) = scene(plateau, &rests);
        let found = reduce(file, &scene, &columns.outputs, calibration)?;
        plateaus.extend(plateau_of(plateau, found.axes, against));
        for note in found.notes {
            if !notes.contains(&note) {
                notes.push(note);
            }
        }
    }
    let axes: Vec<Axis> = plateaus.iter().flat_map(|p| p.axes.clone()).collect();
    let summaries = segments.iter().map(summary).collect::<Result<_, _>>();
    let verdicts = plateaus.iter().map(|plateau| plateau.verdict);
    Ok(Measurement {
        format: "vre-measurement/1",
        input: file.display().to_string(),
        verdict: verdicts.max().unwrap_or(Verdict::NoShift),
        reasons: reasons(&axes),
        axes: Vec::new(),
        units_per_g: calibration.units_per_g,
        segments: summaries.map_err(|error| Error::input(file, error.to_string()))?,
        notes,
        record: None,
        plateaus,
        picture: Some(picture),
        coefficients: None,
    })
}

/// Why nothing can be compared.
fn nothing(rests: &[&Segment], shaken: &[&Segment]) -> Problem {
    let what = match (rests.is_empty(), shaken.is_empty()) {
        (true, true) => "neither a rest nor a steady vibration is found",
        (true, false) => "no rest is found to compare the vibration with",
        _ => {
            "no steady vibration is found: nothing shakes 1.5 times as much as the quietest tenth for 8 pieces of the record"
        }
    };
    Problem::Other(format!("{what}; --before and --during select windows"))
}

/// A plateau, the rests next to it, and all rests for the noise.
fn scene<'a>(plateau: &'a Segment, rests: &[&'a Segment]) -> (Scene<'a>, &'static str) {
    let at = middle(plateau);
    let (earlier, later): (Vec<&Segment>, Vec<&Segment>) =
        rests.iter().copied().partition(|rest| middle(rest) < at);
    let before = earlier
        .into_iter()
        .max_by(|a, b| middle(a).total_cmp(&middle(b)));
    let after = later
        .into_iter()
        .min_by(|a, b| middle(a).total_cmp(&middle(b)));
    let against = match (before, after) {
        (Some(_), Some(_)) => "before and after",
        (Some(_), None) => "before",
        _ => "after",
    };
    let scene = Scene {
        bracketed: before.is_some() && after.is_some(),
        after: before.and(after),
        before: before.or(after).into_iter().collect(),
        during: vec![plateau],
        witnesses: rests.iter().copied().chain([plateau]).collect(),
        separate: false,
    };
    (scene, against)
}

fn plateau_of(segment: &Segment, axes: Vec<Axis>, against: &str) -> Option<Plateau> {
    let main = axes
        .iter()
        .max_by(|a, b| a.rms_during_g.total_cmp(&b.rms_during_g))?;
    let motion = main.motion.as_ref();
    let kind = motion.map_or(motion::Kind::Random, |motion| motion.kind);
    let [from_s, to_s] = segment.extent?;
    let peak = motion.and_then(|motion| motion.amplitudes_g.first().copied());
    Some(Plateau {
        from_s,
        to_s,
        kind,
        frequency_hz: motion.and_then(|motion| motion.frequency_hz),
        band_hz: motion.and_then(|motion| motion.band_hz),
        level_g: peak.unwrap_or(main.rms_during_g),
        column: main.column.clone(),
        shift_g: Quantity { ..main.shift_g },
        verdict: main.verdict,
        against: against.into(),
        axes,
    })
}

fn picture(survey: &Survey, rests: &[&Segment], shaken: &[&Segment]) -> Picture {
    let extents = |list: &[&Segment]| list.iter().filter_map(|s| s.extent).collect();
    Picture {
        extent_s: survey.extent(),
        rms_g: survey.profile(PICTURE),
        rests_s: extents(rests),
        plateaus_s: extents(shaken),
    }
}
