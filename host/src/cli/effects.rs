//! `vre effects`

use serde::Serialize;

use super::{COLUMNS, Command, Console, like};
use crate::effects::identity::Stage;
use crate::effects::{catalogue, find};
use crate::error::{Error, clip};
use crate::handbook;

/// Explain the effects that a diagnosis looks for
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  vre effects\n  vre effects fixture-resonance")]
pub struct Effects {
    /// One effect; all of them are listed without one
    id: Option<String>,
}

/// `vre-effects/1`
#[derive(Serialize)]
struct Answer {
    format: &'static str,
    effects: Vec<Listed>,
}

#[derive(Serialize)]
struct Listed {
    id: &'static str,
    stage: Stage,
    says: &'static str,
}

impl Command for Effects {
    fn run(self, console: &Console) -> Result<(), Error> {
        let page = match &self.id {
            None => handbook::effects(),
            Some(id) => {
                let known = || like(id, catalogue().map(|effect| effect.id).collect());
                let unknown = || {
                    Error::Usage(format!(
                        "no effect \"{}\"{}; see `vre effects`",
                        clip(id),
                        known()
                    ))
                };
                handbook::effect(find(id).ok_or_else(unknown)?)
            }
        };
        let wanted = |id: &str| self.id.as_ref().is_none_or(|wanted| wanted == id);
        let listed = catalogue().filter(|effect| wanted(effect.id));
        let effects = listed.map(|effect| Listed {
            id: effect.id,
            stage: effect.stage,
            says: effect.says,
        });
        console.print(page.text(COLUMNS))?;
        console.json(&Answer {
            format: "vre-effects/1",
            effects: effects.collect(),
        })
    }
}
