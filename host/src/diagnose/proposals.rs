//! Tests that a laboratory can make.

use std::f64::consts::FRAC_1_SQRT_2;

use shared::model::SpecificForce;

use super::reach::Reach;
use crate::campaign::{Campaign, Drift, Measured, Reading, Run, VibrationKind};

/// Length of a long sine dwell, s.
const DWELL_S: f64 = 600.0;
/// Time between readings, s.
const READING_S: f64 = 90.0;
/// Time between runs, s.
const RUN_S: f64 = 180.0;
/// Readings that are repeated in another state of the instrument.
const REPEATED: usize = 8;
/// Runs that are repeated with another reference.
const SWAPPED: usize = 6;

/// A test: words, and what it adds to a campaign.
#[derive(Default)]
pub(super) struct Proposal {
    pub(super) words: String,
    pub(super) readings: Vec<Reading>,
    pub(super) runs: Vec<Run>,
    /// Whether another reference, on the fixture beside the instrument, sees these runs.
    pub(super) swapped: bool,
}

impl Proposal {
    fn readings(words: impl Into<String>, readings: impl Iterator<Item = Reading>) -> Self {
        Self {
            words: words.into(),
            readings: readings.collect(),
            ..Self::default()
        }
    }

    fn runs(words: impl Into<String>, runs: impl IntoIterator<Item = Run>) -> Self {
        Self {
            words: words.into(),
            runs: runs.into_iter().collect(),
            ..Self::default()
        }
    }
}

/// Tests that a laboratory can make: none beyond the instrument's full scale or the reach of the shaker.
pub(super) fn proposals(campaign: &Campaign) -> Vec<Proposal> {
    let remounted = remounted(campaign);
    let Some(shaking) = Shaking::of(campaign) else {
        return remounted.into_iter().collect();
    };
    remounted
        .into_iter()
        .chain(shaking.sines())
        .chain(shaking.dwell())
        .chain(shaking.swapped())
        .chain(warmer(campaign))
        .chain(later(campaign, shaking.model.time_s))
        .collect()
}

/// Further readings after the last: those of `from`, altered by `alter`, of which each is told the time of the last reading.
fn repeated<'a>(
    campaign: &'a Campaign,
    from: impl Iterator<Item = &'a Reading> + 'a,
    alter: impl Fn(Reading) -> Reading + 'a,
) -> impl Iterator<Item = Reading> + 'a {
    let last = campaign.readings.last();
    let (order, time_s) = last.map_or((0, 0.0), |last| (last.order, last.time_s));
    from.zip(1..).map(move |(reading, k)| {
        alter(Reading {
            order: order + k,
            time_s: time_s + READING_S * k as f64,
            ..reading.clone()
        })
    })
}

fn remounted(campaign: &Campaign) -> Option<Proposal> {
    let first_mount = campaign.readings.iter().filter(|r| r.mount_deg == 0.0);
    let readings = repeated(campaign, first_mount, |reading| Reading {
        mount_deg: 180.0,
        dial_deg: (reading.dial_deg + 180.0) % 360.0,
        ..reading
    });
    (campaign.config.bench.mount_sigma_arcsec > 0.0 && !campaign.readings.is_empty()).then(|| {
        Proposal::readings(
            "reverse the instrument on the dividing head (remount by 180 deg) and repeat the dial readings",
            readings,
        )
    })
}

fn warmer(campaign: &Campaign) -> Option<Proposal> {
    let series = campaign.readings.first()?.series;
    let first = campaign
        .readings
        .iter()
        .filter(move |r| r.series == series && r.mount_deg == 0.0);
    let temp_c = campaign.config.bench.reference_temp_c + 10.0;
    let warm = repeated(campaign, first.take(REPEATED), move |reading| Reading {
        temp_c,
        ..reading
    });
    Some(Proposal::readings(
        format!("repeat {REPEATED} dial readings 10 K warmer"),
        warm,
    ))
}

fn later(campaign: &Campaign, last_run_s: f64) -> Option<Proposal> {
    let last_reading_s = campaign.readings.last()?.time_s;
    let first = campaign.readings.iter().take(REPEATED);
    let later = repeated(campaign, first, move |reading| Reading {
        time_s: reading.time_s - last_reading_s + last_run_s + 43_200.0,
        ..reading
    });
    Some(Proposal::readings(
        format!(
            "a static dwell: leave the instrument switched on for twelve hours, then repeat {REPEATED} dial readings"
        ),
        later,
    ))
}

/// What runs a campaign's shaker can make.
struct Shaking<'a> {
    made: Vec<&'a Run>,
    /// The last run: further runs are like it.
    model: &'a Run,
    reach: Reach,
}

/// A direction of vibration, its name, and the static specific force that goes with it, g.
struct Along(&'static str, [f64; 3], [f64; 3]);

const INPUT: Along = Along("the input axis", [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
const DIRECTIONS: [Along; 5] = [
    INPUT,
    Along("the pendulous axis", [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
    Along("the output axis", [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
    Along(
        "the bisector of input and pendulous axis",
        [FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0],
        [0.0, 0.0, 1.0],
    ),
    Along(
        "the bisector of input and output axis",
        [FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2],
        [0.0, 1.0, 0.0],
    ),
];
/// Frequency of sines with gravity on the input axis and of dwells, Hz.
const USUAL_HZ: f64 = 180.0;

impl<'a> Shaking<'a> {
    fn of(campaign: &'a Campaign) -> Option<Self> {
        let made: Vec<&Run> = campaign
            .runs
            .iter()
            .filter(|run| run.measured.is_some())
            .collect();
        campaign.readings.first()?;
        Some(Self {
            model: made.last()?,
            reach: Reach::of(campaign.config.instrument.full_scale_g, &made),
            made,
        })
    }

    fn run(
        &self,
        k: u64,
        direction: [f64; 3],
        level_g: f64,
        f_hz: f64,
        [x, y, z]: [f64; 3],
    ) -> Run {
        Run {
            run: self.model.run + k,
            time_s: self.model.time_s + RUN_S * k as f64,
            kind: VibrationKind::Sine,
            direction,
            level_g,
            band_hz: [f_hz, f_hz],
            specific_force_g: SpecificForce::new(x, y, z),
            reference: None,
            measured: self.model.measured.map(|m| Measured {
                before_v: 0.0,
                during_v: 0.0,
                after_v: m.after_v.map(|_| 0.0),
                ..m
            }),
            ..self.model.clone()
        }
    }

    /// Three sines, as strong as they can be.
    fn three(&self, Along(words, direction, a0): Along, f_hz: f64, on: &str) -> Option<Proposal> {
        let level_g = self.reach.sine_g(f_hz, direction, a0)?;
        let words = format!("three sines of {level_g} g along {words} at {f_hz} Hz{on}");
        let runs = (1..4).map(|k| self.run(k, direction, level_g, f_hz, a0));
        Some(Proposal::runs(words, runs))
    }

    fn sines(&self) -> impl Iterator<Item = Proposal> {
        let across = DIRECTIONS.into_iter().flat_map(|Along(words, u, a0)| {
            [30.0, USUAL_HZ, 700.0, 1400.0].map(|f_hz| self.three(Along(words, u, a0), f_hz, ""))
        });
        let upright = [-1.0, 1.0].map(|g| {
            let along = Along(INPUT.0, INPUT.1, [g, 0.0, 0.0]);
            self.three(along, USUAL_HZ, &format!(" with {g:+} g on it"))
        });
        across.chain(upright).flatten()
    }

    /// A long dwell: as precise, for the longer while, as its drift over that while.
    fn dwell(&self) -> Option<Proposal> {
        let Along(words, direction, a0) = INPUT;
        let level_g = self.reach.sine_g(USUAL_HZ, direction, a0)?;
        let mut dwell = self.run(1, direction, level_g, USUAL_HZ, a0);
        dwell.duration_s = DWELL_S;
        dwell.measured = dwell.measured.map(|m| Measured {
            drift: m.drift.map(|drift| Drift {
                sigma_v_per_s: drift.sigma_v_per_s * self.model.duration_s / DWELL_S,
                ..drift
            }),
            ..m
        });
        let words = format!(
            "a dwell of {DWELL_S} s on a sine of {level_g} g along {words} at {USUAL_HZ} Hz, its drift recorded"
        );
        Some(Proposal::runs(words, [dwell]))
    }

    /// What was there before, as another reference sees it.
    fn swapped(&self) -> Option<Proposal> {
        let seen = self.made.iter().filter(|run| run.reference.is_some());
        let again: Vec<Run> = seen
            .rev()
            .take(SWAPPED)
            .zip(1..)
            .map(|(run, k)| Run {
                run: self.model.run + k,
                time_s: self.model.time_s + RUN_S * k as f64,
                ..(*run).clone()
            })
            .collect();
        let words = format!(
            "swap the reference for another one, mounted on the fixture beside the instrument, and repeat the last {} runs",
            again.len()
        );
        (!again.is_empty()).then(|| Proposal {
            swapped: true,
            ..Proposal::runs(words, again)
        })
    }
}
