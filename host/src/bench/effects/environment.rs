//! Temperature, time and what the instrument has been through.

use super::{Effect, Entry};
use crate::bench::environment::Moment;

/// Makers of the effects in this file.
pub const ENTRIES: &[Entry] = &[
    Entry {
        id: "thermal-bias",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(ThermalBias {
                g_per_k: strength * 1e-5 * stream.sign(),
            })
        },
    },
    Entry {
        id: "thermal-scale",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(ThermalScale {
                per_k: strength * 1e-5 * stream.sign(),
            })
        },
    },
    Entry {
        id: "drift",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(Drift {
                g_per_s: strength * 2e-9 * stream.sign(),
            })
        },
    },
    Entry {
        id: "self-heating",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(SelfHeating {
                c_per_g: strength * 2e-5 * stream.sign(),
                tau_s: stream.log_uniform(4.0, 40.0),
            })
        },
    },
    Entry {
        id: "bias-memory",
        catalogued: true,
        draw: |strength, stream| {
            Box::new(BiasMemory {
                step_g: strength * 1e-5 * stream.sign(),
                threshold_g: stream.uniform(2.5, 5.5),
                capacity: stream.uniform(4.0, 12.0),
            })
        },
    },
];

/// Bias follows the temperature.
struct ThermalBias {
    g_per_k: f64,
}

impl Effect for ThermalBias {
    fn id(&self) -> &'static str {
        "thermal-bias"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("g_per_k", self.g_per_k)]
    }

    fn shift_g(&self, moment: &Moment<'_>) -> f64 {
        self.g_per_k * moment.excess_k
    }
}

/// The magnet weakens as it warms: the scale factor follows the temperature.
struct ThermalScale {
    per_k: f64,
}

impl Effect for ThermalScale {
    fn id(&self) -> &'static str {
        "thermal-scale"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("per_k", self.per_k)]
    }

    fn scale_error(&self, moment: &Moment<'_>) -> f64 {
        self.per_k * moment.excess_k
    }
}

/// Bias follows the time.
struct Drift {
    g_per_s: f64,
}

impl Effect for Drift {
    fn id(&self) -> &'static str {
        "drift"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("g_per_s", self.g_per_s)]
    }

    fn shift_g(&self, moment: &Moment<'_>) -> f64 {
        self.g_per_s * moment.time_s
    }
}

/// The torquer's current heats the proof mass's surroundings with the power of the vibration P; what it warms
/// loses heat with a time constant: tau x' = c P(t) - x. A run of constant power that ran from s to e leaves
/// c P (1 - exp(-(e - s)/tau)) exp(-(t - e)/tau) at a time t after it.
struct SelfHeating {
    c_per_g: f64,
    tau_s: f64,
}

impl Effect for SelfHeating {
    fn id(&self) -> &'static str {
        "self-heating"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![("c_per_g", self.c_per_g), ("tau_s", self.tau_s)]
    }

    fn shift_g(&self, moment: &Moment<'_>) -> f64 {
        let left = |run: &super::super::environment::Exposure| {
            let heated_s = moment.time_s.min(run.end_s) - run.start_s;
            let cooled_s = (moment.time_s - run.end_s).max(0.0);
            let rise = -(-heated_s.max(0.0) / self.tau_s).exp_m1();
            self.c_per_g * run.power_g2 * rise * (-cooled_s / self.tau_s).exp()
        };
        // What is forty time constants old is gone.
        let recent = moment.exposures.iter().rev();
        recent
            .take_while(|run| moment.time_s - run.end_s < 40.0 * self.tau_s)
            .map(left)
            .sum()
    }
}

/// Shocks beyond a threshold push domains of the magnet over for good, a little with every cycle, evenly over
/// the run. The fewer are left, the smaller the next step: step x exp(-n/capacity) for the n-th such run.
struct BiasMemory {
    step_g: f64,
    threshold_g: f64,
    capacity: f64,
}

impl Effect for BiasMemory {
    fn id(&self) -> &'static str {
        "bias-memory"
    }

    fn parameters(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("step_g", self.step_g),
            ("threshold_g", self.threshold_g),
            ("capacity", self.capacity),
        ]
    }

    fn shift_g(&self, moment: &Moment<'_>) -> f64 {
        let shocks = moment
            .exposures
            .iter()
            .filter(|run| run.peak_i_g > self.threshold_g);
        let steps = shocks.zip(0..).map(|(run, earlier)| {
            (-f64::from(earlier) / self.capacity).exp() * run.progress(moment.time_s)
        });
        self.step_g * steps.sum::<f64>()
    }
}
