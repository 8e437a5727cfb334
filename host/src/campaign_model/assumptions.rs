//! What a diagnosis takes for granted of a campaign beside its stated figures: how far those of the noise hold, and which
//! rows do not belong.

use std::collections::BTreeSet;

/// Kinds of noise that have a factor of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Noise {
    /// Of the readings on the dividing head.
    Readings,
    /// Of the plateaus before, during and after runs.
    Plateaus,
    /// Of the drift within runs.
    Drift,
}

impl Noise {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Readings, Self::Plateaus, Self::Drift];

    /// Its name in answers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Readings => "readings",
            Self::Plateaus => "plateaus",
            Self::Drift => "drift",
        }
    }
}

/// Assumptions on a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Assumptions {
    /// Factor on the stated standard uncertainty of each kind of noise, in the order of [`Noise::ALL`].
    pub noise_factor: [f64; Noise::ALL.len()],
    /// Readings that do not belong, by their place in the campaign.
    pub excluded_readings: BTreeSet<usize>,
    /// Runs that do not belong, by their place in the campaign.
    pub excluded_runs: BTreeSet<usize>,
}

impl Default for Assumptions {
    /// The stated figures hold, and all rows belong.
    fn default() -> Self {
        Self {
            noise_factor: [1.0; Noise::ALL.len()],
            excluded_readings: BTreeSet::new(),
            excluded_runs: BTreeSet::new(),
        }
    }
}

impl Assumptions {
    /// Sets a row aside: a reading, or a run, by its place in the campaign.
    pub fn set_aside(&mut self, reading: bool, place: usize) {
        if reading {
            self.excluded_readings.insert(place);
        } else {
            self.excluded_runs.insert(place);
        }
    }

    /// Number of rows that do not belong.
    pub fn rows(&self) -> usize {
        self.excluded_readings.len() + self.excluded_runs.len()
    }

    /// The factor of a kind of noise.
    pub fn factor(&self, noise: Noise) -> f64 {
        self.noise_factor[noise as usize]
    }
}
