//! Smooth functions of the conditions: what something that the catalogue lacks might look like. Polynomials and waves of low
//! order, by family.

use inference::observations::Column;

use super::CampaignModel;
use crate::campaign::Series;
use crate::forward::conditions::Conditions;
use crate::forward::contribution::{Contribution, Layout, Observable};
use crate::forward::rows::RunConditions;

/// Most directions of motion that each have a family of their own.
const DIRECTIONS: usize = 8;
/// Middle of the frequencies that a shaker covers, Hz.
const CENTRE_HZ: f64 = 200.0;
/// Axes whose product a law of frequency may go with.
const PAIRS_OF_AXES: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [0, 2], [1, 2]];
const ALL_SERIES: [Series; 3] = [Series::OutputAxis, Series::PendulousAxis, Series::InputAxis];
/// Plateaus of a run.
const PLATEAUS: [Observable; 3] = [Observable::Before, Observable::During, Observable::After];

impl CampaignModel {
    /// Columns by family, each a shape that one thing which the catalogue lacks might have: a law of frequency for each pair of
    /// axes, and one for each direction; a law of level for each axis, for all of them, for each attitude along IA; time,
    /// temperature, dial angle in each series and in all, exposure.
    pub(super) fn families(&self) -> Vec<Vec<Column>> {
        let s = &self.conditions;
        let mut families = Vec::new();
        for [a, b] in PAIRS_OF_AXES {
            families.push(self.by_frequency_of(|run| run.direction[a] * run.direction[b]));
        }
        for axis in 0..3 {
            families.push(self.by_level_of(|run| run.direction[axis].abs()));
        }
        families.push(self.by_level_of(|_| 1.0));
        families.extend(self.flexible_families());
        let by_series = by_dial_angle(s, &self.layout);
        let waves = by_series.len() / ALL_SERIES.len();
        for series in by_series.chunks(waves) {
            families.push(series.to_vec());
        }
        let in_all = (0..waves).map(|wave| {
            let mut sum = self.layout.nothing();
            for series in by_series.chunks(waves) {
                sum.column.add(&series[wave].column);
            }
            sum
        });
        families.push(in_all.collect());
        let whitened = families.into_iter().map(|family| self.whitened(family));
        whitened.filter(|family| !family.is_empty()).collect()
    }

    /// Columns that together take what hardly any smooth law of the conditions leaves.
    pub(super) fn flexible(&self) -> Vec<Column> {
        let families = self.flexible_families().into_iter();
        families.flat_map(|family| self.whitened(family)).collect()
    }

    fn flexible_families(&self) -> [Vec<Contribution>; 6] {
        let families = [
            by_frequency,
            by_level,
            by_time,
            by_temperature,
            by_dial_angle,
            by_exposure,
        ];
        families.map(|family| family(&self.conditions, &self.layout))
    }

    fn whitened(&self, family: Vec<Contribution>) -> Vec<Column> {
        let columns = family.into_iter();
        columns
            .map(|added| self.observations.whiten(added.column))
            .filter(|column| !column.is_zero())
            .collect()
    }

    /// Powers of the frequency's logarithm, in proportion to the mean square times a factor of the run's direction.
    fn by_frequency_of(&self, factor: impl Fn(&RunConditions) -> f64) -> Vec<Contribution> {
        let of_order = |order: i32| {
            self.during(|run| {
                let log = (run.centre_hz().max(1.0) / CENTRE_HZ).ln();
                factor(run) * run.mean_square_g2() * log.powi(order)
            })
        };
        (0..4).map(of_order).collect()
    }

    /// Powers of the rms level times a factor of the run's direction.
    fn by_level_of(&self, factor: impl Fn(&RunConditions) -> f64) -> Vec<Contribution> {
        let of_order =
            |order: i32| self.during(|run| (factor(run) * run.mean_square_g2().sqrt()).powi(order));
        (1..5).map(of_order).collect()
    }

    fn during(&self, value: impl Fn(&RunConditions) -> f64) -> Contribution {
        let mut added = self.layout.nothing();
        for (row, run) in self.conditions.runs.iter().enumerate() {
            added.add(Observable::During, row, value(run));
        }
        added
    }
}

/// Powers of the frequency's logarithm in each direction, in proportion to the mean square.
fn by_frequency(s: &Conditions, layout: &Layout) -> Vec<Contribution> {
    let mut directions: Vec<[f64; 3]> = Vec::new();
    for run in s.runs.iter().filter(|run| run.made) {
        if directions.len() < DIRECTIONS && !directions.contains(&run.direction) {
            directions.push(run.direction);
        }
    }
    let mut family = Vec::new();
    for direction in directions {
        for order in 0..4 {
            let mut added = layout.nothing();
            let runs = s.runs.iter().enumerate();
            for (row, run) in runs.filter(|(_, run)| run.direction == direction) {
                let log = (run.centre_hz().max(1.0) / CENTRE_HZ).ln();
                let value = run.mean_square_g2() * log.powi(order);
                added.add(Observable::During, row, value);
            }
            family.push(added);
        }
    }
    family
}

/// Powers of the level along IA at each attitude.
fn by_level(s: &Conditions, layout: &Layout) -> Vec<Contribution> {
    let mut family = Vec::new();
    for attitude_g in [-1.0, 0.0, 1.0] {
        for order in 1..5 {
            let mut added = layout.nothing();
            for (row, run) in s.runs.iter().enumerate() {
                if (run.specific_force_g.i - attitude_g).abs() < 0.5 {
                    added.add(Observable::During, row, rms_along_ia_g(run).powi(order));
                }
            }
            family.push(added);
        }
    }
    family
}

/// Waves over the time of the campaign.
fn by_time(s: &Conditions, layout: &Layout) -> Vec<Contribution> {
    // Rows may stand in any order.
    let times_s = s.runs.iter().map(|run| run.time_s);
    let times_s = times_s.chain(s.readings.iter().map(|reading| reading.time_s));
    let end_s = times_s.fold(0.0, f64::max);
    let wave = |order: i32| {
        let wave =
            |time_s: f64| (std::f64::consts::PI * f64::from(order) * time_s / end_s.max(1.0)).cos();
        let mut added = layout.nothing();
        for (row, reading) in s.readings.iter().enumerate() {
            added.add(Observable::Static, row, wave(reading.time_s));
        }
        for (row, run) in s.runs.iter().enumerate() {
            for plateau in PLATEAUS {
                added.add(plateau, row, wave(run.time_s));
            }
        }
        added
    };
    (1..9).map(wave).collect()
}

/// Temperature times powers of the specific force, and times the mean square along IA.
fn by_temperature(s: &Conditions, layout: &Layout) -> Vec<Contribution> {
    let of_order = |order: i32| {
        let mut added = layout.nothing();
        let at_rest = |force_i: f64| if order < 3 { force_i.powi(order) } else { 0.0 };
        for (row, reading) in s.readings.iter().enumerate() {
            let excess_k = reading.temp_c - s.reference_temp_c;
            let value = excess_k * at_rest(reading.specific_force_g.i);
            added.add(Observable::Static, row, value);
        }
        for (row, run) in s.runs.iter().enumerate() {
            let excess_k = run.temp_c - s.reference_temp_c;
            let rest = at_rest(run.specific_force_g.i);
            added.add(Observable::Before, row, excess_k * rest);
            added.add(Observable::After, row, excess_k * rest);
            let moving = if order > 1 {
                run.mean_square_g2() * run.direction[0].powi(2)
            } else {
                0.0
            };
            added.add(Observable::During, row, excess_k * (rest + moving));
        }
        added
    };
    (0..4).map(of_order).collect()
}

/// Harmonics of the dial angle in each series.
fn by_dial_angle(s: &Conditions, layout: &Layout) -> Vec<Contribution> {
    let mut family = Vec::new();
    for series in ALL_SERIES {
        for order in 0..5 {
            for wave in [f64::cos, f64::sin] {
                let mut added = layout.nothing();
                let readings = s.readings.iter().enumerate();
                for (row, reading) in readings.filter(|(_, r)| r.series == series) {
                    let angle = f64::from(order) * reading.dial_deg.to_radians();
                    added.add(Observable::Static, row, wave(angle));
                }
                family.push(added);
            }
        }
    }
    family
}

/// What a run leaves behind by its level and its power, along all axes and along IA.
fn by_exposure(s: &Conditions, layout: &Layout) -> Vec<Contribution> {
    let mut family = Vec::new();
    for observable in [Observable::After, Observable::Drift] {
        for order in [1, 2] {
            let rms = [
                |run: &RunConditions| run.mean_square_g2().sqrt(),
                rms_along_ia_g,
            ];
            for rms in rms {
                let mut added = layout.nothing();
                for (row, run) in s.runs.iter().enumerate() {
                    added.add(observable, row, rms(run).powi(order));
                }
                family.push(added);
            }
        }
    }
    family
}

/// Root mean square of the commanded motion along IA, g.
fn rms_along_ia_g(run: &RunConditions) -> f64 {
    run.mean_square_g2().sqrt() * run.direction[0].abs()
}
