//! What an effect is called and where it acts: the bench that makes it and the catalogue that finds it share this and no
//! more.

use serde::{Deserialize, Serialize};

/// Link of the chain at which an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// The instrument's characteristic at rest.
    InstrumentStatics,
    /// Its inner motion and its servo loop.
    InstrumentDynamics,
    /// Between table and instrument.
    Mounting,
    /// Dividing head and base.
    StaticBench,
    /// Table, drive and reference.
    Shaker,
    /// Temperature, time, history.
    Environment,
    /// Converter and logger.
    Acquisition,
}

impl Stage {
    /// All stages in the order of the chain.
    pub const ALL: [Self; 7] = [
        Self::StaticBench,
        Self::Shaker,
        Self::Mounting,
        Self::InstrumentStatics,
        Self::InstrumentDynamics,
        Self::Environment,
        Self::Acquisition,
    ];
}
