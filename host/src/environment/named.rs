//! A vibration by a name: `sine:5`, `random:2`, `psd:vehicle.csv`, `psd+sine:rotor.csv`.

use std::path::Path;

use super::Vibration;
use crate::campaign::{ranges, read_spectrum};
use crate::error::Error;

impl Vibration {
    /// The vibration of that name, along the unit vector `direction` where it has none of its own; `None` if the name is of no
    /// kind that is known. A file is looked for in `folder`.
    ///
    /// # Errors
    /// A level that is none; a table that cannot be read, or is of the other kind.
    pub fn named(name: &str, direction: [f64; 3], folder: &Path) -> Result<Option<Self>, Error> {
        let Some((kind, value)) = name.split_once(':') else {
            return Ok(None);
        };
        let bad = |problem: &str| Error::Usage(format!("{name}: {problem}"));
        let level = || {
            let level = ranges::LEVEL.parse(value);
            level.map_err(|problem| bad(&format!("the level {problem}")))
        };
        Ok(Some(match kind {
            "sine" => Self::sine(level()?, 0.0, direction),
            "random" => Self::random(level()?, direction),
            "psd" | "psd+sine" => {
                let table = read_spectrum(&folder.join(value))?;
                match (kind, table.sines.is_empty()) {
                    ("psd", false) => return Err(bad("the table holds sines; name it psd+sine")),
                    ("psd+sine", true) => return Err(bad("the table holds no sine; name it psd")),
                    _ => Self::of_table(&table, direction),
                }
            }
            _ => return Ok(None),
        }))
    }
}
