//! The study: campaigns whose effect the diagnosis does not know, and how often it finds it.

mod cases;
mod imperfect;
mod interval;
mod scoreboard;
mod trial;
pub mod visibility;

use rayon::prelude::*;

use crate::error::Error;

pub use cases::Kind;
pub use imperfect::{
    Answer, EFFECTS, Group, ImperfectOutcome, ImperfectScoreboard, ImperfectStudy,
};
pub use interval::Share;
pub use scoreboard::Scoreboard;
pub use trial::{Outcome, Score};

/// Runs the study on `campaigns` campaigns of so many shaker `runs` (96 at most); `without` are taken out of the catalogue
/// throughout. `tick` is called after each.
///
/// # Errors
/// Those of [`crate::diagnose::diagnose`].
pub fn blind_check(
    campaigns: u64,
    runs: usize,
    seed: u64,
    without: &[String],
    tick: impl Fn() + Sync,
) -> Result<Scoreboard, Error> {
    let cases = cases::cases(without, runs);
    let one = |number: u64| {
        let outcome = trial::try_case(&cases[number as usize % cases.len()], number, seed, without);
        tick();
        outcome
    };
    let outcomes: Result<Vec<Option<Outcome>>, Error> =
        (0..campaigns).into_par_iter().map(one).collect();
    Ok(Scoreboard {
        format: "vre-blind-check/1",
        seed,
        outcomes: outcomes?.into_iter().flatten().collect(),
    })
}
