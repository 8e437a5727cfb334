//! What a diagnosis takes for granted of a campaign beside its stated figures: how far those of the noise hold, and which
//! rows do not belong.

use std::collections::BTreeSet;

use crate::campaign::Campaign;
use crate::contradictions::contradictions;

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
    /// Of the dial's marks, which readings on one mark share.
    Marks,
}

impl Noise {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Readings, Self::Plateaus, Self::Drift, Self::Marks];

    /// Its name in answers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Readings => "readings",
            Self::Plateaus => "plateaus",
            Self::Drift => "drift",
            Self::Marks => "dial marks",
        }
    }
}

/// Change of a factor's logarithm up to which two judgements agree.
const AGREE: f64 = 0.1;

/// Assumptions on a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Assumptions {
    /// Factor on the stated standard uncertainty of each kind of noise, in the order of [`Noise::ALL`].
    pub noise_factor: [f64; Noise::ALL.len()],
    /// Readings that do not belong, by their place in the campaign.
    pub excluded_readings: BTreeSet<usize>,
    /// Runs that do not belong, by their place in the campaign.
    pub excluded_runs: BTreeSet<usize>,
    /// Those of them whose own columns contradict each other: no fit is asked about them.
    pub contradictory_runs: BTreeSet<usize>,
    /// Whether the table's level scatters about its command as the reference has it; else the scatter is the reference's.
    pub table_scatters: bool,
}

impl Default for Assumptions {
    /// The stated figures hold, and all rows belong.
    fn default() -> Self {
        Self {
            noise_factor: [1.0; Noise::ALL.len()],
            excluded_readings: BTreeSet::new(),
            excluded_runs: BTreeSet::new(),
            contradictory_runs: BTreeSet::new(),
            table_scatters: false,
        }
    }
}

impl Assumptions {
    /// As a campaign is stated, runs that contradict themselves set aside.
    pub fn of(campaign: &Campaign) -> Self {
        let found = contradictions(campaign).into_iter();
        let single = found.flat_map(|contradiction| contradiction.places(&campaign.runs));
        Self::without(single.collect())
    }

    /// The stated figures hold, and all rows belong but these runs, which contradict themselves.
    pub fn without(contradictory_runs: BTreeSet<usize>) -> Self {
        Self {
            excluded_runs: contradictory_runs.clone(),
            contradictory_runs,
            ..Self::default()
        }
    }

    /// Sets a row aside: a reading, or a run, by its place in the campaign.
    pub fn set_aside(&mut self, reading: bool, place: usize) {
        if reading {
            self.excluded_readings.insert(place);
        } else {
            self.excluded_runs.insert(place);
        }
    }

    /// Whether two judgements are the same but for rounding.
    pub fn agree(&self, other: &Self) -> bool {
        let mut factors = self.noise_factor.iter().zip(&other.noise_factor);
        let alike = |(a, b): (&f64, &f64)| (a / b).ln().abs() < AGREE;
        self.excluded_readings == other.excluded_readings
            && self.excluded_runs == other.excluded_runs
            && factors.all(alike)
    }

    /// Number of rows that do not belong by what a fit says.
    pub fn rows(&self) -> usize {
        self.excluded_readings.len() + self.excluded_runs.len() - self.contradictory_runs.len()
    }

    /// The campaign whose stated readings are those that belong, with the uncertainties that the scatter shows.
    pub fn applied_to_readings(&self, campaign: &Campaign) -> Campaign {
        let mut campaign = campaign.clone();
        let mut place = 0..;
        let excluded = &self.excluded_readings;
        campaign
            .readings
            .retain(|_| !place.next().is_some_and(|place| excluded.contains(&place)));
        for reading in &mut campaign.readings {
            reading.sigma_v *= self.factor(Noise::Readings);
        }
        campaign.config.bench.dial_sigma_arcsec *= self.factor(Noise::Marks);
        campaign
    }

    /// The factor of a kind of noise.
    pub fn factor(&self, noise: Noise) -> f64 {
        self.noise_factor[noise as usize]
    }
}
