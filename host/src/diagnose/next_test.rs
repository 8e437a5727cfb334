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
/// Most hypotheses that a test is judged by.
const MOST_HYPOTHESES: usize = 3;
/// Length of a long sine dwell, s.
const DWELL_S: f64 = 600.0;

/// A test: words, and what it adds to a campaign.
struct Proposal {
    words: String,
    readings: Vec<Reading>,
    runs: Vec<Run>,
    /// Whether another reference, on the fixture beside the instrument, sees these runs.
    swapped: bool,
}

impl Problem<'_> {
    /// Tests by expected information, most telling first; none if one hypothesis is left, or none stands.
    pub fn next_tests(
        &self,
        campaign: &Campaign,
        search: &Search,
        verdict: Verdict,
    ) -> Vec<NextTest> {
        let mut candidates = standing(search);
        candidates.truncate(MOST_HYPOTHESES);
        if !matches!(verdict, Verdict::Explained | Verdict::Ambiguous) || candidates.len() < 2 {
            return Vec::new();
        }
        let total: f64 = candidates.iter().map(|h| h.probability).sum();
        let probabilities: Vec<f64> = candidates.iter().map(|h| h.probability / total).collect();
        let fits: Vec<&Fit> = candidates.iter().map(|h| &h.fit).collect();
        let now = self.separations(&fits);
        let mut tests: Vec<NextTest> = proposals(campaign)
            .into_iter()
            .filter_map(|proposal| {
                let gained = self.gained(campaign, &proposal, &fits, &now);
                let expected_bits = expected_bits(&probabilities, &gained);
                (expected_bits > LEAST_BITS).then(|| NextTest {
                    change: proposal.words,
                    separates: fits.iter().map(|fit| name(fit)).collect(),
                    expected_bits,
                })
            })
            .collect();
        tests.sort_by(|a, b| b.expected_bits.total_cmp(&a.expected_bits));
        tests.truncate(PROPOSED);
        tests
    }

    /// By how much a test would raise the squared distances between fits over `now`.
    fn gained(
        &self,
        campaign: &Campaign,
        proposal: &Proposal,
        fits: &[&Fit],
        now: &[Vec<f64>],
    ) -> Vec<Vec<f64>> {
        let mut larger = campaign.clone();
        let made = larger.runs.len();
        larger.readings.extend_from_slice(&proposal.readings);
        larger.runs.extend_from_slice(&proposal.runs);
        let mut problem = Problem::with_scale(&larger, &[], self.scale_v_per_g);
        problem.suppose(self.situation.coefficients);
        if proposal.swapped {
            problem.seen_beside_instrument = made;
        }
        let mut gained = problem.separations(fits);
        for (gained, now) in gained.iter_mut().flatten().zip(now.iter().flatten()) {
            *gained = (*gained - now).max(0.0);
        }
        gained
    }

    /// Squared distance, in units of noise, of what each fit predicts from the nearest that each other one can say.
    fn separations(&self, fits: &[&Fit]) -> Vec<Vec<f64>> {
        let says: Vec<_> = fits
            .iter()
            .map(|fit| self.tangent(&fit.members, &fit.theta))
            .collect();
        let distance = |truth: usize, other: usize| {
            if truth == other {
                return 0.0;
            }
            let (columns, imitates, _) = &says[other];
            let difference = says[truth].1.iter().zip(imitates).map(|(a, b)| a - b);
            self.unlike(
                &self.column(difference.collect()),
                columns,
                &fits[truth].trust,
            )
        };
        let all = 0..fits.len();
        all.clone()
            .map(|truth| all.clone().map(|other| distance(truth, other)).collect())
            .collect()
    }

    /// Squared length of a difference beyond what `columns` can imitate; of each run past the end of `trust` it is 1.
    fn unlike(&self, difference: &Column, columns: &[Column], trust: &[f64]) -> f64 {
        let mut trust = trust.to_vec();
        trust.resize(self.run_count(), 1.0);
        let n = columns.len();
        let mut matrix = vec![0.0; n * n];
        let mut x: Vec<f64> = columns
            .iter()
            .map(|c| self.dot(c, difference, &trust))
            .collect();
        for i in 0..n {
            for j in 0..=i {
                matrix[i * n + j] = self.dot(&columns[i], &columns[j], &trust);
            }
            matrix[i * n + i] = matrix[i * n + i] * (1.0 + 1e-9) + 1e-9;
        }
        let Some(factor) = Cholesky::new(matrix, n) else {
            return 0.0;
        };
        factor.forward(&mut x);
        self.dot(difference, difference, &trust) - x.iter().map(|x| x * x).sum::<f64>()
    }
}

/// Information, in bits, about which of several hypotheses holds, of a measurement by whose squared signal-to-noise d2
/// they differ: at least -sum p_i log2 sum p_j exp(-d2_ij / 8) (Kolchinsky and Tracey 2017, with Bhattacharyya's
/// distance).
fn expected_bits(p: &[f64], d2: &[Vec<f64>]) -> f64 {
    let bits = p.iter().zip(d2).map(|(p_i, d2)| {
        let alike = p.iter().zip(d2).map(|(p_j, d2)| p_j * (-d2 / 8.0).exp());
        -p_i * alike.sum::<f64>().log2()
    });
    bits.sum::<f64>().max(0.0)
}

/// Tests that a laboratory can make.
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
            after_v: 0.0,
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
        drift_sigma_v_per_s: m.drift_sigma_v_per_s * model.duration_s / DWELL_S,
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

#[cfg(test)]
mod tests {
    use super::super::catalogue;
    use super::super::fit::Member;
    use super::*;
    use crate::bench::noise::Seed;
    use crate::bench::plan::Static;
    use crate::bench::simulate::{Specification, VirtualBench};

    /// Squared distance that a proposal adds between an effect of that size and nothing.
    fn added(words: &str, id: &str, values: &[f64]) -> f64 {
        let specification = Specification::with_dial_sigma(1.0);
        let bench = VirtualBench::new(Seed(4), Static::Default, specification, Vec::new());
        let campaign = bench.simulate().campaign;
        let problem = Problem::new(&campaign, &[]);
        let null = problem.fit_nominal().unwrap();
        let member = Member {
            effect: catalogue::find(id).unwrap(),
            values: values.to_vec(),
        };
        let acting = Fit {
            members: vec![member],
            ..null.clone()
        };
        let fits = [&acting, &null];
        let proposals = proposals(&campaign);
        let proposal = proposals.iter().find(|p| p.words.contains(words)).unwrap();
        let now = problem.separations(&fits);
        problem.gained(&campaign, proposal, &fits, &now)[0][1]
    }

    #[test]
    fn a_swap_of_the_reference_shows_what_the_instrument_alone_feels() {
        // One part in a hundred against the reference's 2e-4, in six runs.
        let distance = added("swap the reference", "reference-scale", &[0.01]);
        assert!(distance > 6.0 * 50.0_f64.powi(2), "{distance}");
        assert!(added("swap the reference", "thermal-bias", &[1e-6]) < 100.0);
    }

    #[test]
    fn a_dwell_shows_what_takes_longer_than_a_run() {
        // A shift of a time constant of 100 s grows through a dwell of 600 s, but hardly in a run of 8 s.
        let heating = [1e-6, 100.0, 8.0];
        let dwell = added("a dwell of", "self-heating", &heating);
        let runs = added(
            "three sines of 6 g along the input axis at 180 Hz",
            "self-heating",
            &heating,
        );
        assert!(dwell > 10.0 * runs, "{dwell} {runs}");
    }

    #[test]
    fn information_is_nothing_without_a_difference_and_the_entropy_with_a_large_one() {
        let p = [0.5, 0.3, 0.2];
        let entropy: f64 = p.iter().map(|p: &f64| -p * p.log2()).sum();
        let bits = |d2: f64| {
            let row = |i: usize| (0..3).map(|j| if i == j { 0.0 } else { d2 }).collect();
            expected_bits(&p, &(0..3).map(row).collect::<Vec<Vec<f64>>>())
        };
        assert_eq!(bits(0.0), 0.0);
        assert!((bits(1e4) - entropy).abs() < 1e-12);
        assert!(bits(1.0) < bits(4.0) && bits(4.0) < entropy);
    }
}
