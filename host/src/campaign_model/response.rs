//! What each axis of the reference reads of the table's motion: its gain, and its sensitivity to motion along the others.
//!
//! Of one run the axes read, over the commanded level, (1 + e) (d + R d): d is the direction of the command, e the table's error of
//! level in that run, R what the reference adds. All axes of a run share e, so runs along several axes tell the gains from it;
//! e is about zero in the mean of all runs. R follows by weighted least squares, a run that lies far off counting for less
//! (Cauchy's weights), the product of e and R from the round before.

use inference::dense::Cholesky;

/// Wide prior of a gain or a cross-sensitivity: what no run tells stays about zero.
const PRIOR_SIGMA: f64 = 0.1;
/// Rounds of weighting by what is left.
const ROUNDS: usize = 5;
/// Squared distance per axis at which a run counts half.
const HALF: f64 = 4.0;

/// One run: the direction of the command, what each axis read over its level, and the standard deviation of that.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) direction: [f64; 3],
    pub(super) ratios: [f64; 3],
    pub(super) sigma: [f64; 3],
}

/// What the axes read of a motion, less that motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    /// Element a, b: what axis a reads of a unit motion along b.
    values: [[f64; 3]; 3],
    sigmas: [[f64; 3]; 3],
}

impl Response {
    /// Of all runs, whose level scatters about the command by `table_scatter`, relative.
    pub(super) fn of(seen: &[Seen], table_scatter: f64) -> Self {
        let mut response = Self::default();
        for _ in 0..ROUNDS {
            let Some(next) = response.improved(seen, table_scatter) else {
                return response;
            };
            response = next;
        }
        response
    }

    fn improved(&self, seen: &[Seen], table_scatter: f64) -> Option<Self> {
        const UNKNOWNS: usize = 9;
        let mut matrix = vec![0.0; UNKNOWNS * UNKNOWNS];
        let mut right = vec![0.0; UNKNOWNS];
        for k in 0..UNKNOWNS {
            matrix[k * UNKNOWNS + k] = PRIOR_SIGMA.powi(-2);
        }
        for run in seen {
            let precision = precision(run, table_scatter);
            let (error, left) = self.level(run, table_scatter);
            let weight = (1.0 + left / (3.0 * HALF)).recip();
            let added = self.added(run);
            let off: [f64; 3] =
                std::array::from_fn(|a| run.ratios[a] - run.direction[a] - error * added[a]);
            for a in 0..3 {
                for c in 0..3 {
                    let factor = weight * precision[a][c];
                    for b in 0..3 {
                        let left = factor * run.direction[b];
                        right[3 * a + b] += left * off[c];
                        for d in 0..3 {
                            matrix[(3 * a + b) * UNKNOWNS + 3 * c + d] += left * run.direction[d];
                        }
                    }
                }
            }
        }
        let factor = Cholesky::new(matrix, UNKNOWNS)?;
        factor.solve(&mut right);
        let covariance = factor.inverse();
        let all = |of: &dyn Fn(usize) -> f64| {
            std::array::from_fn(|a| std::array::from_fn(|b| of(3 * a + b)))
        };
        Some(Self {
            values: all(&|k| right[k]),
            sigmas: all(&|k| covariance[k * UNKNOWNS + k].max(0.0).sqrt()),
        })
    }

    /// The table's error of level in a run, relative, and the squared distance that it leaves of all axes.
    pub(super) fn level(&self, run: &Seen, table_scatter: f64) -> (f64, f64) {
        let added = self.added(run);
        let read: [f64; 3] = std::array::from_fn(|a| run.direction[a] + added[a]);
        let off: [f64; 3] = std::array::from_fn(|a| run.ratios[a] - read[a]);
        let weight = |a: usize| run.sigma[a].powi(-2);
        let along: f64 = (0..3).map(|a| weight(a) * read[a] * off[a]).sum();
        let told: f64 = (0..3).map(|a| weight(a) * read[a].powi(2)).sum();
        let total = told + table_scatter.powi(-2);
        let error = if table_scatter > 0.0 {
            along / total
        } else {
            0.0
        };
        let square: f64 = (0..3).map(|a| weight(a) * off[a] * off[a]).sum();
        (error, square - error * along)
    }

    /// What the reference adds to the motion of a run, over the level.
    fn added(&self, run: &Seen) -> [f64; 3] {
        self.values.map(|row| {
            let read = row.iter().zip(&run.direction).map(|(r, d)| r * d);
            read.sum()
        })
    }

    /// What is left of the table's error of level in a run that was seen so: its variance.
    pub(super) fn level_variance(run: &Seen, table_scatter: f64) -> f64 {
        let told = (0..3).map(|a| (run.direction[a] / run.sigma[a]).powi(2));
        (told.sum::<f64>() + table_scatter.powi(-2)).recip()
    }

    /// What axis a reads of a unit motion along b, less that motion, with its standard uncertainty; `None` where no run tells
    /// it.
    pub fn element(&self, a: usize, b: usize) -> Option<(f64, f64)> {
        let sigma = self.sigmas[a][b];
        (sigma > 0.0 && sigma < 0.5 * PRIOR_SIGMA).then_some((self.values[a][b], sigma))
    }

    /// Gains less 1 of the axes that move in some run.
    pub(super) fn gains(&self) -> Vec<f64> {
        let gains = (0..3).filter_map(|axis| self.element(axis, axis));
        gains.map(|(gain, _)| gain).collect()
    }

    /// Sensitivities of axes to motion along others that move in some run.
    pub(super) fn crosses(&self) -> Vec<f64> {
        let pairs = (0..9).map(|k| (k / 3, k % 3)).filter(|(a, b)| a != b);
        let crosses = pairs.filter_map(|(a, b)| self.element(a, b));
        crosses.map(|(cross, _)| cross).collect()
    }
}

/// Inverse covariance of a run's ratios: independent scatter, and the level's that they share (Sherman and Morrison).
fn precision(run: &Seen, table_scatter: f64) -> [[f64; 3]; 3] {
    let weighted: [f64; 3] = std::array::from_fn(|a| run.direction[a] / run.sigma[a].powi(2));
    let told: f64 = (0..3).map(|a| weighted[a] * run.direction[a]).sum();
    let shared = table_scatter.powi(2) / (1.0 + table_scatter.powi(2) * told);
    std::array::from_fn(|a| {
        std::array::from_fn(|c| {
            let own = if a == c { run.sigma[a].powi(-2) } else { 0.0 };
            own - shared * weighted[a] * weighted[c]
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    const OWN: f64 = 2e-4;
    const TABLE: f64 = 3e-3;

    /// Runs along single axes and pairs of them, as a reference of that response sees them.
    fn runs(truth: &Response, seed: u64) -> (Vec<Seen>, Vec<f64>) {
        let mut stream = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = move || stream.sample::<f64, _>(StandardNormal);
        let half = 0.5_f64.sqrt();
        let directions = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [half, half, 0.0],
            [half, 0.0, half],
            [0.0, half, half],
        ];
        let run = |n: usize| {
            let direction = directions[n % directions.len()];
            let error = TABLE * normal();
            let ratios = std::array::from_fn(|a| {
                let read: f64 = (0..3).map(|b| truth.values[a][b] * direction[b]).sum();
                let scatter = OWN * direction[a].abs() + 1e-5;
                (direction[a] + read) * (1.0 + error) + scatter * normal()
            });
            let sigma = direction.map(|d| OWN * d.abs() + 1e-5);
            (
                Seen {
                    direction,
                    ratios,
                    sigma,
                },
                error,
            )
        };
        let runs: Vec<(Seen, f64)> = (0..96).map(run).collect();
        runs.into_iter().unzip()
    }

    /// The level of each run is found to the reference's own scatter, however unevenly gains and cross-sensitivities lie,
    /// but for what all runs share.
    #[test]
    fn levels_are_told_from_gains_by_runs_along_several_axes() {
        let truth = Response {
            values: [
                [0.004, 0.02, -0.01],
                [0.01, -0.006, 0.0],
                [0.0, -0.02, 0.005],
            ],
            ..Response::default()
        };
        let (mut square, mut count, mut shared) = (0.0, 0.0, 0.0);
        for seed in 0..40 {
            let (mut seen, errors) = runs(&truth, seed);
            // One run was recorded with the wrong sign.
            seen[7].ratios = seen[7].ratios.map(|ratio| -ratio);
            let found = Response::of(&seen, TABLE);
            let off: Vec<f64> = seen
                .iter()
                .zip(&errors)
                .enumerate()
                .filter(|(n, _)| *n != 7)
                .map(|(_, (run, error))| found.level(run, TABLE).0 - error)
                .collect();
            let mean = off.iter().sum::<f64>() / off.len() as f64;
            shared += mean * mean / (TABLE * TABLE / 96.0) / 40.0;
            for (run, off) in seen.iter().zip(&off) {
                square += (off - mean).powi(2) / Response::level_variance(run, TABLE);
                count += 1.0;
            }
        }
        assert!((0.8..1.3).contains(&(square / count)), "{}", square / count);
        assert!((0.4..1.9).contains(&shared), "{shared}");
    }
}
