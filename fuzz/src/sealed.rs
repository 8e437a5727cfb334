//! Diagnosis files that somebody changed, and sealed labels.

use std::fs;
use std::path::Path;

use arbitrary::Unstructured;
use host::bench::plan::Static;
use host::campaign::Campaign;
use host::diagnose::{Diagnosis, diagnose};
use host::error::Error;
use host::gate;
use host::output::write_json;
use host::refit::predict_refitted;
use host::seal;
use serde_json::Value;
use tempfile::TempDir;

use crate::campaign::simulated;
use crate::draw::{below, number, one_in, spoil};
use crate::{Fuzz, Judged, proper};

/// The target: a sealed campaign with its diagnosis.
pub struct Sealed {
    folder: TempDir,
    campaign: Campaign,
    diagnosis: Value,
    label: Vec<u8>,
}

/// Effects in the campaign.
const EFFECT: &str = "fixture-resonance";

impl Sealed {
    pub fn new() -> Result<Self, Error> {
        let folder = TempDir::new().map_err(Error::write(Path::new("a folder")))?;
        simulated(folder.path(), 4, Static::Remounted, Some(EFFECT))?;
        let campaign = Campaign::read(folder.path())?;
        let diagnosis = diagnose(&campaign, &[])?.diagnosis;
        write_json(&folder.path().join("diagnosis.json"), &diagnosis)?;
        seal::seal(folder.path(), &EFFECT)?;
        let label = folder.path().join(seal::SEALED);
        Ok(Self {
            campaign,
            diagnosis: serde_json::to_value(&diagnosis).unwrap_or_default(),
            label: fs::read(&label).map_err(Error::read(&label))?,
            folder,
        })
    }

    fn use_it(&self, file: &Path) -> Judged {
        let answer = Diagnosis::read(file).and_then(|diagnosis| {
            gate::check(&diagnosis)?;
            let effects = diagnosis.serving();
            let predicted = predict_refitted(&self.campaign, effects, &self.campaign.runs, None)?;
            gate::check(&predicted)
        });
        answer.or_else(|error| proper(&error))
    }
}

/// Changes one value somewhere in a tree.
fn change(draw: &mut Unstructured<'_>, tree: &mut Value) {
    match tree {
        Value::Object(fields) if !fields.is_empty() => {
            let at = below(draw, fields.len());
            let key = fields.keys().nth(at).cloned().unwrap_or_default();
            if one_in(draw, 12) {
                fields.remove(&key);
            } else if let Some(value) = fields.get_mut(&key) {
                change(draw, value);
            }
        }
        Value::Array(list) if !list.is_empty() => {
            let at = below(draw, list.len());
            match below(draw, 12) {
                0 => drop(list.remove(at)),
                1 => list.push(list[at].clone()),
                _ => change(draw, &mut list[at]),
            }
        }
        leaf => {
            let text = number(draw, &leaf.to_string());
            *leaf = serde_json::from_str(&text).unwrap_or(Value::Null);
        }
    }
}

impl Fuzz for Sealed {
    fn input(&mut self, draw: &mut Unstructured<'_>) -> Judged {
        let file = self.folder.path().join("changed.json");
        if one_in(draw, 4) {
            // The seal opens as it was, or not at all.
            let mut label = self.label.clone();
            spoil(draw, &mut label);
            let sealed = self.folder.path().join(seal::SEALED);
            fs::write(&sealed, &label).map_err(|error| error.to_string())?;
            let diagnosis = self.folder.path().join("diagnosis.json");
            return match seal::unseal(self.folder.path(), &diagnosis) {
                Ok(opened) if opened.truth == EFFECT => Ok(()),
                Ok(opened) => Err(format!("opened as {:?}", opened.truth)),
                Err(error) => proper(&error),
            };
        }
        let mut tree = self.diagnosis.clone();
        for _ in 0..=below(draw, 4) {
            // Most of the answer is not used again: what is, is changed as often as all else.
            match one_in(draw, 2) {
                true => change(draw, &mut tree["which"]),
                false => change(draw, &mut tree),
            }
        }
        let mut bytes = tree.to_string().into_bytes();
        if one_in(draw, 8) {
            spoil(draw, &mut bytes);
        }
        fs::write(&file, &bytes).map_err(|error| error.to_string())?;
        self.use_it(&file)
    }

    fn file(&mut self, path: &Path) -> Judged {
        self.use_it(path)
    }
}
