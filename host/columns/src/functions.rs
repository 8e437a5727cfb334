//! The functions of `vre` over a column of campaigns: pure, row by row, on all cores. A row that fails gives nulls and a reason.

use std::panic::{AssertUnwindSafe, catch_unwind};

use arrow::array::{Array, ArrayRef};
use arrow::datatypes::DataType;
use arrow::error::ArrowError;
use host::campaign::{Campaign, Run, VibrationKind, ranges};
use host::diagnose::{Identified, diagnose, static_test};
use host::error::Error;
use host::gate;
use host::prediction::predict;
use host::statics::{Method, identify};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;
use shared::model::SpecificForce;

use crate::rows::{decode, to_array};

/// What a function makes of a campaign without its excluded rows.
type Answer = Result<Value, Error>;

/// The coefficients of a campaign, as `vre identify` has them.
///
/// # Errors
/// Those of [`identify`].
pub fn identified(campaign: &Campaign) -> Answer {
    let judged = static_test(campaign);
    let identification = identify(&judged.belonging, Method::LeastSquares, None)?;
    value(&Identified::new(&identification, &judged))
}

/// Predictions for these runs, or for the campaign's own, as `vre predict` has them.
///
/// # Errors
/// Those of [`predict`].
pub fn predicted(campaign: &Campaign, runs: Option<&[Run]>) -> Answer {
    value(&predict(campaign, runs.unwrap_or(&campaign.runs), None)?)
}

/// The diagnosis of a campaign, as `vre diagnose` has it.
///
/// # Errors
/// Those of [`diagnose`].
pub fn diagnosed(campaign: &Campaign) -> Answer {
    value(&diagnose(campaign, &[])?.diagnosis)
}

fn value(answer: &impl Serialize) -> Answer {
    gate::check(answer)?;
    serde_json::to_value(answer).map_err(|error| Error::Usage(error.to_string()))
}

/// A vibration along IA with IA level, in words: `sine:5` with its peak, `random:1` with its rms in g, flat from 20 Hz to 2 kHz.
///
/// # Errors
/// Other words.
pub fn vibration(text: &str) -> Result<Run, String> {
    let (kind, level) = text
        .split_once(':')
        .ok_or_else(|| format!("\"{text}\" is not KIND:LEVEL, such as random:1"))?;
    let kind = VibrationKind::of_word(kind)
        .ok_or_else(|| format!("\"{text}\": the kind is neither sine nor random"))?;
    let level_g = ranges::LEVEL
        .parse(level)
        .map_err(|problem| format!("\"{text}\": the level {problem}"))?;
    Ok(Run {
        run: 0,
        time_s: 0.0,
        kind,
        direction: [1.0, 0.0, 0.0],
        level_g,
        band_hz: match kind {
            VibrationKind::Sine => [100.0; 2],
            VibrationKind::Random => [20.0, 2000.0],
        },
        specific_force_g: SpecificForce::new(0.0, 0.0, 1.0),
        temp_c: 22.0,
        duration_s: 60.0,
        measured: None,
        reference: None,
        session: None,
        exclude: false,
        line: 0,
        unknown: Vec::new(),
    })
}

/// Carries out work that may be faulty on input that nobody foresaw: a panic becomes an error.
///
/// # Errors
/// Those of the work, and [`Error::Usage`] for a panic.
pub fn guarded<T>(work: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    let fault = "a fault of the program; please report it with what it was given";
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err(Error::Usage(fault.into())))
}

/// A function over a column of campaigns, with answers of this type.
///
/// # Errors
/// An answer that does not fit its type, which is a fault of ours.
pub fn over(
    campaigns: &dyn Array,
    data_type: &DataType,
    function: impl Fn(&Campaign) -> Answer + Sync,
) -> Result<ArrayRef, ArrowError> {
    let answer = |row: usize| {
        let reason = |reason: String| serde_json::json!({ "reason": reason });
        if campaigns.is_null(row) {
            return Value::Null;
        }
        // One row must never end a query over thousands.
        let answer = guarded(|| {
            let campaign = decode(campaigns, row).map_err(Error::Usage)?.used();
            function(&campaign)
        });
        answer.unwrap_or_else(|problem| reason(problem.to_string()))
    };
    let answers: Vec<Value> = (0..campaigns.len()).into_par_iter().map(answer).collect();
    to_array(&answers, data_type)
}
