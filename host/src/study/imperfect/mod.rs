//! The study of laboratories as they are: campaigns with one imperfection, with an effect and without.

mod scoreboard;
mod told;
mod trial;

use rayon::prelude::*;

use crate::bench::imperfections::Imperfection;
use crate::effects;
use crate::error::Error;

pub use scoreboard::{Group, ImperfectScoreboard};
pub use trial::{Answer, ImperfectOutcome};

/// Visibilities of the effect; `None` is no effect.
pub const EFFECTS: [Option<f64>; 3] = [None, Some(300.0), Some(30.0)];

/// What is to be studied.
pub struct ImperfectStudy {
    /// What laboratories do; the bench as stated is studied beside.
    pub imperfections: Vec<Imperfection>,
    /// Campaigns of each of them with no effect, and with one of either visibility.
    pub rounds: u64,
    /// Fixes everything that is random.
    pub seed: u64,
    /// Effects that are taken out of the catalogue throughout.
    pub without: Vec<String>,
}

/// One campaign of the study.
struct Case {
    /// What the laboratory does; `None` is the bench as stated.
    imperfection: Option<Imperfection>,
    visibility: Option<f64>,
}

impl ImperfectStudy {
    /// Campaigns that it takes.
    pub fn campaigns(&self) -> u64 {
        self.rounds * (EFFECTS.len() * (1 + self.imperfections.len())) as u64
    }

    /// The campaign of that number: all without an effect first, then all with one.
    fn case(&self, number: u64) -> Case {
        let kinds = 1 + self.imperfections.len();
        let place = number as usize % (EFFECTS.len() * kinds);
        let given = (place % kinds).checked_sub(1);
        Case {
            imperfection: given.map(|given| self.imperfections[given]),
            visibility: EFFECTS[place / kinds],
        }
    }

    /// Runs it; `tick` is called after each campaign. What a command would refuse is an outcome, no error.
    ///
    /// # Errors
    /// A temporary folder cannot be written; an identifier in `without` is unknown.
    pub fn run(&self, tick: impl Fn() + Sync) -> Result<ImperfectScoreboard, Error> {
        if let Some(id) = self.without.iter().find(|id| effects::find(id).is_none()) {
            let problem = format!("--without {id}: no effect of the catalogue");
            return Err(Error::Usage(problem));
        }
        let one = |number: u64| {
            let outcome = trial::try_case(&self.case(number), number, self.seed, &self.without);
            tick();
            outcome
        };
        let numbers = (0..self.campaigns()).into_par_iter();
        let outcomes: Result<Vec<Option<ImperfectOutcome>>, Error> = numbers.map(one).collect();
        let outcomes = outcomes?.into_iter().flatten().collect();
        Ok(ImperfectScoreboard::new(self.seed, outcomes))
    }
}
