//! Where the gap lies: in which observable, at which link of the chain, under which conditions.

use inference::adequacy::gap as base_gap;
use inference::fit::Fit;
use inference::model::SeparableModel;
use inference::search::{Hypothesis, Search};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::answer::{Condition, DIAL_FACTORS, Gap, ObservableShare, StageProbability, Where};
use crate::campaign::{Approach, Campaign};
use crate::campaign_model::CampaignModel;
use crate::campaign_model::observables::{GAP, name};
use crate::effects::identity::Stage;
use crate::forward::contribution::Observable;
use crate::forward::rows::{ReadingConditions, RunConditions};

/// Permutations that the search over conditions is corrected by.
const PERMUTATIONS: usize = 199;
/// Most distinct values of a factor that regions begin and end at.
const EDGES: usize = 14;
/// Regions with a larger probability of arising by chance are not reported.
const SIGNIFICANT: f64 = 0.05;

/// Size of the gap of the nominal model.
pub(super) fn gap(model: &CampaignModel, search: &Search) -> Gap {
    let (chi2, freedom) = search.null_adequacy.total();
    let observations = model.observations();
    let observed: usize = GAP
        .iter()
        .map(|o| observations.observed_rows(model.rows(*o)).count())
        .sum();
    Gap {
        rms_over_noise: if observed > 0 {
            (chi2 / freedom.max(1.0)).sqrt()
        } else {
            0.0
        },
        p_value: search.null_adequacy.p_value,
    }
}

/// The gap (observed less nominal part of `fit`, in units of noise) split by observable, link of the chain and condition.
pub(super) fn locate(model: &CampaignModel, search: &Search, fit: &Fit) -> Where {
    let excess: Vec<f64> = base_gap(model, fit).iter().map(|z| z * z - 1.0).collect();
    Where {
        observables: observables(model, &excess),
        stages: stages(model, search),
        conditions: conditions(model, &excess),
    }
}

fn observables(model: &CampaignModel, excess: &[f64]) -> Vec<ObservableShare> {
    let of = |observable: Observable| {
        let rows = model.observations().observed_rows(model.rows(observable));
        rows.map(|row| excess[row]).sum::<f64>().max(0.0)
    };
    let total: f64 = GAP.iter().map(|observable| of(*observable)).sum();
    let share = |observable: Observable| {
        if total > 0.0 {
            of(observable) / total
        } else {
            0.0
        }
    };
    let shares = GAP.iter().map(|&observable| ObservableShare {
        name: name(observable).into(),
        share: share(observable),
    });
    shares.collect()
}

fn stages(model: &CampaignModel, search: &Search) -> Vec<StageProbability> {
    let stages = Stage::ALL.iter().map(|&stage| {
        let of_stage =
            |h: &&Hypothesis| h.fit.members.iter().any(|m| model.effect(m).stage == stage);
        let hypotheses = search.hypotheses.iter().filter(of_stage);
        StageProbability {
            stage,
            probability: hypotheses.map(|h| h.probability).sum(),
        }
    });
    stages.collect()
}

/// Regions of conditions that hold the excess of rows (squares less 1), runs before readings.
pub(super) fn conditions(model: &CampaignModel, excess: &[f64]) -> Vec<Condition> {
    let mut found = runs(model, excess).regions();
    found.extend(readings(model, excess).regions());
    found
}

fn runs(model: &CampaignModel, excess: &[f64]) -> Table {
    let runs = model.conditions().runs.iter().enumerate();
    let made: Vec<(usize, &RunConditions)> = runs.filter(|(_, run)| run.made).collect();
    let of_run = |row: usize| {
        let observables = [
            Observable::During,
            Observable::Before,
            Observable::After,
            Observable::Drift,
        ];
        let rows = observables.map(|observable| model.rows(observable).start + row);
        rows.iter().map(|&row| excess[row]).sum::<f64>()
    };
    let values = |value: fn(usize, &RunConditions) -> f64| {
        made.iter().map(|(row, run)| value(*row, run)).collect()
    };
    Table {
        excess: made.iter().map(|(row, _)| of_run(*row)).collect(),
        numbers: made.iter().map(|(_, run)| run.number).collect(),
        factors: RUN_FACTORS
            .iter()
            .map(|(name, value)| (*name, values(*value)))
            .collect(),
    }
}

fn readings(model: &CampaignModel, excess: &[f64]) -> Table {
    let readings = &model.conditions().readings;
    let values: [fn(&ReadingConditions) -> f64; 3] = [
        |reading| reading.dial_deg,
        |reading| f64::from(u8::from(reading.series)),
        |reading| f64::from(u8::from(reading.approach == Approach::Clockwise)),
    ];
    Table {
        excess: model
            .rows(Observable::Static)
            .map(|row| excess[row])
            .collect(),
        numbers: readings.iter().map(|reading| reading.order).collect(),
        factors: DIAL_FACTORS
            .into_iter()
            .zip(values)
            .map(|(name, value)| (name, readings.iter().map(value).collect()))
            .collect(),
    }
}

type Factor = (&'static str, fn(usize, &RunConditions) -> f64);

const RUN_FACTORS: [Factor; 9] = [
    ("frequency_hz", |_, run| run.centre_hz()),
    ("level_g", |_, run| run.level_g),
    ("direction_i", |_, run| run.direction[0].abs()),
    ("direction_p", |_, run| run.direction[1].abs()),
    ("direction_o", |_, run| run.direction[2].abs()),
    ("a0_i_g", |_, run| run.specific_force_g.i),
    ("temp_c", |_, run| run.temp_c),
    ("time_s", |_, run| run.time_s),
    ("order", |row, _| row as f64),
];

/// Rows with their excess and the values of their factors.
struct Table {
    excess: Vec<f64>,
    numbers: Vec<u64>,
    factors: Vec<(&'static str, Vec<f64>)>,
}

impl Table {
    /// The best region of each factor, the most conspicuous first, those that chance explains left out.
    fn regions(&self) -> Vec<Condition> {
        let n = self.excess.len();
        let total: f64 = self.excess.iter().sum();
        // Less than four of its own standard deviations is no excess to be placed.
        if n < 4 || total < 4.0 * (2.0 * n as f64).sqrt() {
            return Vec::new();
        }
        let binned: Vec<Binned> = self
            .factors
            .iter()
            .filter_map(|(name, values)| Binned::new(name, values))
            .collect();
        let mut chance: Vec<f64> = Vec::with_capacity(PERMUTATIONS);
        let mut shuffled = self.excess.clone();
        // The same for the same campaign.
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..PERMUTATIONS {
            shuffled.shuffle(&mut random);
            let best = binned.iter().map(|factor| factor.best(&shuffled, total).0);
            chance.push(best.fold(0.0, f64::max));
        }
        let mut found: Vec<(f64, Condition)> = binned
            .iter()
            .filter_map(|factor| {
                let (score, first, last) = factor.best(&self.excess, total);
                let above = chance.iter().filter(|c| **c >= score).count();
                let p_value = (above + 1) as f64 / (PERMUTATIONS + 1) as f64;
                if p_value > SIGNIFICANT {
                    return None;
                }
                let inside = |row: &usize| (first..=last).contains(&factor.bin[*row]);
                let rows: Vec<usize> = (0..n).filter(inside).collect();
                let values = rows.iter().map(|&row| factor.values[row]);
                let condition = Condition {
                    factor: factor.name.into(),
                    low: values.clone().fold(f64::INFINITY, f64::min),
                    high: values.fold(f64::NEG_INFINITY, f64::max),
                    share: (rows.iter().map(|&row| self.excess[row]).sum::<f64>() / total)
                        .clamp(0.0, 1.0),
                    runs: rows.iter().map(|&row| self.numbers[row]).collect(),
                    p_value,
                };
                Some((score, condition))
            })
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.into_iter().map(|(_, condition)| condition).collect()
    }
}

/// A factor's values sorted into at most [`EDGES`] bins.
struct Binned<'v> {
    name: &'static str,
    values: &'v [f64],
    bin: Vec<usize>,
    counts: Vec<f64>,
}

impl<'v> Binned<'v> {
    /// `None` if the factor does not vary.
    fn new(name: &'static str, values: &'v [f64]) -> Option<Self> {
        let mut distinct = values.to_vec();
        distinct.sort_by(f64::total_cmp);
        distinct.dedup();
        if distinct.len() < 2 {
            return None;
        }
        let bins = distinct.len().min(EDGES);
        let bin = |value: &f64| {
            let rank = distinct.partition_point(|d| d < value);
            rank * bins / distinct.len()
        };
        let bin: Vec<usize> = values.iter().map(bin).collect();
        let mut counts = vec![0.0; bins];
        for &b in &bin {
            counts[b] += 1.0;
        }
        Some(Self {
            name,
            values,
            bin,
            counts,
        })
    }

    /// Score, first and last bin of the region whose share of the excess is most above its share of the rows.
    fn best(&self, excess: &[f64], total: f64) -> (f64, usize, usize) {
        let mut sums = vec![0.0; self.counts.len()];
        for (&bin, e) in self.bin.iter().zip(excess) {
            sums[bin] += e;
        }
        let n = excess.len() as f64;
        let mut best = (0.0, 0, sums.len() - 1);
        for first in 0..sums.len() {
            let (mut sum, mut count) = (0.0, 0.0);
            for last in first..sums.len() {
                sum += sums[last];
                count += self.counts[last];
                let size = count / n;
                if size < 1.0 {
                    let score = (sum / total - size) / (size * (1.0 - size)).sqrt();
                    if score > best.0 {
                        best = (score, first, last);
                    }
                }
            }
        }
        best
    }
}

/// What could not be looked at, and why.
pub(super) fn not_looked_at(campaign: &Campaign) -> Vec<String> {
    let mut notes = Vec::new();
    let made = campaign.runs.iter().filter(|run| run.measured.is_some());
    if made.clone().count() == 0 {
        notes.push(
            "no shaker runs: vibration error, bias before and recovery after runs, drift, and every effect that only vibration shows"
                .into(),
        );
        return notes;
    }
    if made.clone().all(|run| run.reference.is_none()) {
        notes.push("no reference accelerometer: what the table really did, and the shape of random records".into());
    } else if campaign.config.shaker.is_none() {
        notes.push(
            "campaign.toml has no [shaker]: the reference's rms is not compared with the command"
                .into(),
        );
    }
    if made
        .clone()
        .all(|run| run.measured.is_none_or(|m| m.extremes.is_none()))
    {
        notes.push("no extremes of the output: clipping, and the amplitude at the instrument, only through the means".into());
    }
    let measured = || made.clone().filter_map(|run| run.measured);
    if measured().all(|m| m.after_v.is_none()) {
        notes.push("no output after the vibration: recovery, and what a run leaves behind".into());
    }
    if measured().all(|m| m.drift.is_none()) {
        notes.push("no drift during the vibration: what builds up within a run".into());
    }
    notes
}

#[cfg(test)]
mod tests {
    use inference::fit::fit_base;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    use super::*;
    use crate::bench::noise::Seed;
    use crate::bench::plan::Static;
    use crate::bench::simulate::{Specification, VirtualBench};

    /// The runs and readings of a campaign without effects, fitted, and what that leaves.
    fn tables(seed: u64) -> [Table; 2] {
        let specification = Specification::with_dial_sigma(1.0);
        let bench = VirtualBench::new(Seed(seed), Static::Default, specification, Vec::new());
        let model = CampaignModel::new(&bench.simulate().campaign, &[], &[]);
        let fit = fit_base(&model).unwrap();
        // Noise twice what is stated: an excess that has no place.
        let excess: Vec<f64> = base_gap(&model, &fit)
            .iter()
            .map(|z| 4.0 * z * z - 1.0)
            .collect();
        [runs(&model, &excess), readings(&model, &excess)]
    }

    /// Whether a share of one in twenty, within four of its standard deviations, found this.
    fn is_one_in_twenty(found: usize, of: usize) -> bool {
        let of = of as f64;
        (found as f64 - 0.05 * of).abs() < 4.0 * (0.05 * 0.95 * of).sqrt()
    }

    #[test]
    fn an_excess_without_a_place_gets_a_region_one_time_in_twenty() {
        const TABLES: u64 = 1200;
        let mut random = ChaCha8Rng::seed_from_u64(7);
        for mut table in tables(1) {
            let mut found = 0;
            for _ in 0..TABLES {
                for excess in &mut table.excess {
                    let z: f64 = random.sample(StandardNormal);
                    *excess = 4.0 * z * z - 1.0;
                }
                found += usize::from(!table.regions().is_empty());
            }
            assert!(is_one_in_twenty(found, TABLES as usize), "{found}");
        }
    }

    #[test]
    fn campaigns_without_effects_get_a_region_one_time_in_twenty() {
        const CAMPAIGNS: u64 = 240;
        let mut found = [0; 2];
        for seed in 0..CAMPAIGNS {
            for (found, table) in found.iter_mut().zip(tables(20_000 + seed)) {
                *found += usize::from(!table.regions().is_empty());
            }
        }
        for found in found {
            assert!(is_one_in_twenty(found, CAMPAIGNS as usize), "{found}");
        }
    }

    #[test]
    fn an_excess_with_a_place_is_found_there() {
        let [mut runs, _] = tables(3);
        let (_, levels) = runs.factors.iter().find(|f| f.0 == "level_g").unwrap();
        let levels = levels.clone();
        let top = levels.iter().copied().fold(0.0, f64::max);
        for (excess, level) in runs.excess.iter_mut().zip(&levels) {
            *excess = if *level == top { 40.0 } else { 0.0 };
        }
        let regions = runs.regions();
        assert_eq!(regions[0].factor, "level_g");
        assert_eq!((regions[0].low, regions[0].high), (top, top));
        assert!((regions[0].share - 1.0).abs() < 1e-12 && regions[0].p_value < 0.01);
    }
}
