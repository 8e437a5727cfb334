//! Frequency responses over the bands of the runs.

use std::collections::HashMap;

use super::rows::RunConditions;
use super::time_mean::TimeMean;
use crate::campaign::VibrationKind;

/// Points at which a band is sampled.
const BAND_POINTS: usize = 256;

/// The distinct bands of the runs: what goes by frequency alone is worked out once a band.
#[derive(Debug)]
pub struct Bands {
    /// Of each band its frequencies (Hz) and their weights, which add up to 1; of a sine the one frequency.
    points: Vec<Vec<[f64; 2]>>,
    /// Of each run its band, and the reciprocal of bandwidth times duration (zero for a sine).
    of_run: Vec<(usize, f64)>,
}

impl Bands {
    /// The bands of these runs.
    pub fn new(runs: &[RunConditions]) -> Self {
        let mut edges: Vec<[f64; 2]> = Vec::new();
        let mut numbers: HashMap<[u64; 2], usize> = HashMap::new();
        let of_run = runs.iter().map(|run| {
            let [low, high] = match run.kind {
                VibrationKind::Sine => [run.band_hz[0]; 2],
                VibrationKind::Random => run.band_hz,
            };
            let band = *numbers
                .entry([low, high].map(f64::to_bits))
                .or_insert_with(|| {
                    edges.push([low, high]);
                    edges.len() - 1
                });
            let width = high - low;
            (
                band,
                if width > 0.0 {
                    (width * run.duration_s).recip()
                } else {
                    0.0
                },
            )
        });
        let of_run = of_run.collect();
        Self {
            points: edges.into_iter().map(sampled).collect(),
            of_run,
        }
    }

    /// Of each run the mean over its band of a frequency response's squared magnitude. For a sine the value at its
    /// frequency, with no variance; for a flat band the mean, and the variance of the mean over records of that length
    /// whose total power is known: var_f(response) / (bandwidth x time).
    pub fn means(&self, response: impl Fn(f64) -> f64) -> Vec<TimeMean> {
        let means = self.several(|f| [response(f)]);
        means.into_iter().map(|[mean]| mean).collect()
    }

    /// The same of several responses at once.
    pub fn several<const N: usize>(
        &self,
        responses: impl Fn(f64) -> [f64; N],
    ) -> Vec<[TimeMean; N]> {
        let of_band = |points: &Vec<[f64; 2]>| {
            let mut means = [TimeMean::default(); N];
            for &[f, weight] in points {
                for (mean, value) in means.iter_mut().zip(responses(f)) {
                    mean.value += weight * value;
                    mean.variance += weight * value * value;
                }
            }
            means.map(|mean| TimeMean {
                variance: (mean.variance - mean.value * mean.value).max(0.0),
                ..mean
            })
        };
        let of_band: Vec<_> = self.points.iter().map(of_band).collect();
        let of_run = |&(band, per_record): &(usize, f64)| {
            of_band[band].map(|mean| TimeMean {
                variance: mean.variance * per_record,
                ..mean
            })
        };
        self.of_run.iter().map(of_run).collect()
    }
}

/// Frequencies of a flat band with their weights.
fn sampled([low, high]: [f64; 2]) -> Vec<[f64; 2]> {
    if high <= low {
        return vec![[low, 1.0]];
    }
    // Equal steps of the logarithm, each weighted by its width: low edges need the finer steps.
    let from = low.max(1e-3 * high);
    let ratio = (high / from).ln() / BAND_POINTS as f64;
    let at = |k: usize| {
        let f = from * ((k as f64 + 0.5) * ratio).exp();
        [f, f * ratio / (high - from)]
    };
    (0..BAND_POINTS).map(at).collect()
}
