//! Tests that a laboratory can make.

use crate::campaign::{Campaign, Drift, Measured, Reading, Run, VibrationKind};

/// Length of a long sine dwell, s.
const DWELL_S: f64 = 600.0;

/// A test: words, and what it adds to a campaign.
pub(super) struct Proposal {
    pub(super) words: String,
    pub(super) readings: Vec<Reading>,
    pub(super) runs: Vec<Run>,
    /// Whether another reference, on the fixture beside the instrument, sees these runs.
    pub(super) swapped: bool,
}

/// Tests that a laboratory can make.
pub(super) fn proposals(campaign: &Campaign) -> Vec<Proposal> {
    let mut proposals = Vec::new();
    let (Some(last), Some(reading)) = (campaign.readings.last(), campaign.readings.first()) else {
        return proposals;
    };
    if campaign.config.bench.mount_sigma_arcsec > 0.0 {
        let remounted = campaign
            .readings
            .iter()
            .filter(|r| r.mount_deg == 0.0)
            .zip(1..)
            .map(|(r, k)| Reading {
                order: last.order + k,
                time_s: last.time_s + 90.0 * k as f64,
                mount_deg: 180.0,
                dial_deg: (r.dial_deg + 180.0) % 360.0,
                ..r.clone()
            });
        proposals.push(Proposal {
            words: "reverse the instrument on the dividing head (remount by 180 deg) and repeat the dial readings".into(),
            readings: remounted.collect(),
            runs: Vec::new(),
            swapped: false,
        });
    }
    let made: Vec<&Run> = campaign
        .runs
        .iter()
        .filter(|run| run.measured.is_some())
        .collect();
    let Some(&model) = made.last() else {
        return proposals;
    };
    let run = |k: u64, kind, direction: [f64; 3], level_g: f64, band_hz, a0: [f64; 3]| Run {
        run: model.run + k,
        time_s: model.time_s + 180.0 * k as f64,
        kind,
        direction,
        level_g,
        band_hz,
        specific_force_g: shared::model::SpecificForce::new(a0[0], a0[1], a0[2]),
        reference: None,
        measured: model.measured.map(|m| Measured {
            before_v: 0.0,
            during_v: 0.0,
            after_v: m.after_v.map(|_| 0.0),
            ..m
        }),
        ..model.clone()
    };
    let mut add = |words: String, kind, direction, level_g, band_hz, a0| {
        proposals.push(Proposal {
            words,
            readings: Vec::new(),
            runs: (1..4)
                .map(|k| run(k, kind, direction, level_g, band_hz, a0))
                .collect(),
            swapped: false,
        });
    };
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let directions = [
        ("the input axis", [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
        ("the pendulous axis", [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
        ("the output axis", [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
        (
            "the bisector of input and pendulous axis",
            [half, half, 0.0],
            [0.0, 0.0, 1.0],
        ),
        (
            "the bisector of input and output axis",
            [half, 0.0, half],
            [0.0, 1.0, 0.0],
        ),
    ];
    let top = made.iter().map(|run| run.level_g).fold(0.0, f64::max);
    for (words, direction, a0) in directions {
        for f_hz in [30.0, 180.0, 700.0, 1400.0] {
            let text = format!("three sines of {top} g along {words} at {f_hz} Hz");
            add(text, VibrationKind::Sine, direction, top, [f_hz, f_hz], a0);
        }
    }
    for a0 in [-1.0, 1.0] {
        let text =
            format!("three sines of {top} g along the input axis at 180 Hz with {a0:+} g on it");
        add(
            text,
            VibrationKind::Sine,
            [1.0, 0.0, 0.0],
            top,
            [180.0, 180.0],
            [a0, 0.0, 0.0],
        );
    }
    let mut dwell = run(
        1,
        VibrationKind::Sine,
        directions[0].1,
        top,
        [180.0; 2],
        directions[0].2,
    );
    // As precise, for the longer while, as its drift over that while.
    dwell.duration_s = DWELL_S;
    dwell.measured = dwell.measured.map(|m| Measured {
        drift: m.drift.map(|drift| Drift {
            sigma_v_per_s: drift.sigma_v_per_s * model.duration_s / DWELL_S,
            ..drift
        }),
        ..m
    });
    proposals.push(Proposal {
        words: format!("a dwell of {DWELL_S} s on a sine of {top} g along the input axis at 180 Hz, its drift recorded"),
        readings: Vec::new(),
        runs: vec![dwell],
        swapped: false,
    });
    // What was there before, as another reference sees it.
    let again = made
        .iter()
        .filter(|run| run.reference.is_some())
        .rev()
        .take(6)
        .zip(1..);
    let again: Vec<Run> = again
        .map(|(run, k)| Run {
            run: model.run + k,
            time_s: model.time_s + 180.0 * k as f64,
            ..(*run).clone()
        })
        .collect();
    if !again.is_empty() {
        proposals.push(Proposal {
            words: format!(
                "swap the reference for another one, mounted on the fixture beside the instrument, and repeat the last {} runs",
                again.len()
            ),
            readings: Vec::new(),
            runs: again,
            swapped: true,
        });
    }
    let warm = |r: &Reading, k: u64| Reading {
        order: last.order + k,
        time_s: last.time_s + 90.0 * k as f64,
        temp_c: campaign.config.bench.reference_temp_c + 10.0,
        ..r.clone()
    };
    let repeated: Vec<Reading> = campaign
        .readings
        .iter()
        .filter(|r| r.series == reading.series && r.mount_deg == 0.0)
        .take(8)
        .zip(1..)
        .map(|(r, k)| warm(r, k))
        .collect();
    proposals.push(Proposal {
        words: "repeat eight dial readings 10 K warmer".into(),
        readings: repeated,
        runs: Vec::new(),
        swapped: false,
    });
    let later: Vec<Reading> = campaign
        .readings
        .iter()
        .take(8)
        .zip(1..)
        .map(|(r, k)| Reading {
            order: last.order + k,
            time_s: model.time_s + 43_200.0 + 90.0 * k as f64,
            ..r.clone()
        })
        .collect();
    proposals.push(Proposal {
        words: "a static dwell: leave the instrument switched on for twelve hours, then repeat eight dial readings"
            .into(),
        readings: later,
        runs: Vec::new(),
        swapped: false,
    });
    proposals
}
