//! Which test would best separate the hypotheses still standing.

use serde::{Deserialize, Serialize};

use super::dense::Cholesky;
use super::diagnosis::{Verdict, name, standing};
use super::fit::Fit;
use super::problem::{Column, Problem};
use super::search::Search;
use crate::campaign::{Campaign, Measured, Reading, Run, VibrationKind};

/// A proposed test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NextTest {
    /// What to do.
    pub change: String,
    /// Hypotheses that it separates.
    pub separates: Vec<String>,
    /// Expected information about which of them holds, bits.
    pub expected_bits: f64,
}

/// Tests that tell less are not proposed.
const LEAST_BITS: f64 = 0.01;
const PROPOSED: usize = 5;

/// A test: words, and what it adds to a campaign.
struct Proposal {
    words: String,
    readings: Vec<Reading>,
    runs: Vec<Run>,
}

impl Problem<'_> {
    /// Tests by expected information, most telling first; none if one hypothesis is left.
    pub fn next_tests(
        &self,
        campaign: &Campaign,
        search: &Search,
        verdict: Verdict,
    ) -> Vec<NextTest> {
        let candidates = standing(search);
        if verdict == Verdict::NoGap || candidates.len() < 2 {
            return Vec::new();
        }
        let (first, second) = (&candidates[0], &candidates[1]);
        let p = first.probability / (first.probability + second.probability);
        let now = self.separation(&first.fit, &second.fit);
        let mut tests: Vec<NextTest> = proposals(campaign)
            .into_iter()
            .filter_map(|proposal| {
                let mut larger = campaign.clone();
                larger.readings.extend(proposal.readings);
                larger.runs.extend(proposal.runs);
                let mut problem = Problem::new(&larger, &[]);
                problem.situation.coefficients = self.situation.coefficients;
                let distance = problem.separation(&first.fit, &second.fit) - now;
                let expected_bits = expected_bits(p, distance.max(0.0));
                (expected_bits > LEAST_BITS).then(|| NextTest {
                    change: proposal.words,
                    separates: vec![name(&first.fit), name(&second.fit)],
                    expected_bits,
                })
            })
            .collect();
        tests.sort_by(|a, b| b.expected_bits.total_cmp(&a.expected_bits));
        tests.truncate(PROPOSED);
        tests
    }

    /// Squared distance, in units of noise, of what one fit predicts from the nearest that another hypothesis can say,
    /// linear about its own fit.
    fn separation(&self, truth: &Fit, other: &Fit) -> f64 {
        let (_, says, _) = self.tangent(&truth.members, &truth.theta);
        let (columns, imitates, _) = self.tangent(&other.members, &other.theta);
        let difference = self.column(says.iter().zip(&imitates).map(|(a, b)| a - b).collect());
        let trust: Vec<f64> = (0..self.run_count())
            .map(|row| truth.trust.get(row).copied().unwrap_or(1.0))
            .collect();
        let n = columns.len();
        let mut matrix = vec![0.0; n * n];
        let right: Vec<f64> = columns
            .iter()
            .map(|c| self.dot(c, &difference, &trust))
            .collect();
        for i in 0..n {
            for j in 0..n {
                matrix[i * n + j] = self.dot(&columns[i], &columns[j], &trust);
            }
            matrix[i * n + i] = matrix[i * n + i] * (1.0 + 1e-9) + 1e-9;
        }
        let Some(factor) = Cholesky::new(matrix, n) else {
            return 0.0;
        };
        let mut x = right.clone();
        factor.forward(&mut x);
        self.dot(&difference, &difference, &trust) - x.iter().map(|x| x * x).sum::<f64>()
    }

    /// A copy of a whitened column's values, for reports.
    pub fn values(column: &Column) -> &[f64] {
        &column.values
    }
}

/// Information, in bits, of a measurement of signal-to-noise d (d squared given) about a choice of prior p: the entropy
/// times 1 - exp(-d^2/8), Bhattacharyya's bound.
fn expected_bits(p: f64, d2: f64) -> f64 {
    let entropy = |p: f64| if p <= 0.0 { 0.0 } else { -p * p.log2() };
    (entropy(p) + entropy(1.0 - p)) * -(-d2 / 8.0).exp_m1()
}

fn proposals(campaign: &Campaign) -> Vec<Proposal> {
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
    let mut add =
        |words: String, kind, direction: [f64; 3], level_g: f64, band_hz, a0: [f64; 3]| {
            let runs = (1..4u64).map(|k| {
                let force = shared::model::SpecificForce::new(a0[0], a0[1], a0[2]);
                let measured = model.measured.map(|m| Measured {
                    before_v: 0.0,
                    during_v: 0.0,
                    after_v: 0.0,
                    ..m
                });
                Run {
                    run: model.run + k,
                    time_s: model.time_s + 180.0 * k as f64,
                    kind,
                    direction,
                    level_g,
                    band_hz,
                    specific_force_g: force,
                    reference: None,
                    measured,
                    ..model.clone()
                }
            });
            proposals.push(Proposal {
                words,
                readings: Vec::new(),
                runs: runs.collect(),
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
        words: "leave the instrument alone for twelve hours, then repeat eight dial readings"
            .into(),
        readings: later,
        runs: Vec::new(),
    });
    proposals
}
