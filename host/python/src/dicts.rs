//! A campaign as a dict, which comes and goes as JSON text.

use std::path::Path;

use columns::rows::{ReadingRow, RunRow, campaign_of};
use host::campaign::Campaign;
use host::error::{Error, Place};
use serde::Deserialize;
use serde_path_to_error::Segment;

/// What of a dict holds: `campaign.toml` as text and the rows of the tables. Other keys may be there.
#[derive(Deserialize)]
struct Dict {
    toml: String,
    readings: Vec<ReadingRow>,
    #[serde(default)]
    runs: Vec<RunRow>,
}

/// The campaign of a dict.
///
/// # Errors
/// Table, row and column with what is wrong there; a key alone where it is missing in the dict itself.
pub fn campaign(json: &str) -> Result<Campaign, Error> {
    let mut text = serde_json::Deserializer::from_str(json);
    let read = serde_path_to_error::deserialize::<_, Dict>(&mut text);
    let Dict {
        toml,
        readings,
        runs,
    } = read.map_err(|error| misplaced(error.path().iter().collect(), error.inner()))?;
    campaign_of(&toml, readings, runs)
}

fn misplaced(path: Vec<&Segment>, error: &serde_json::Error) -> Error {
    let text = error.to_string();
    // The position in JSON text that nobody wrote says nothing.
    let problem = text.split(" at line ").next().unwrap_or_default();
    let problem = match problem {
        // NaN and Infinity are no JSON.
        "expected value" => "is not a finite number",
        other => other,
    };
    let mut keys = path.iter().filter_map(|segment| match segment {
        Segment::Map { key } => Some(key.clone()),
        _ => None,
    });
    let row = path.iter().find_map(|segment| match segment {
        Segment::Seq { index } => Some(*index as u64 + 2),
        _ => None,
    });
    let file = match keys.next().as_deref() {
        Some("readings") => "static.csv",
        Some("runs") => "vibration.csv",
        _ => "campaign",
    };
    let place = Place {
        file: Path::new(file).into(),
        row,
        column: keys.next(),
    };
    let problem = problem.into();
    Error::Input { place, problem }
}
