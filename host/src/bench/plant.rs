//! A plant: instruments of one type, one after another on the same dividing head.

use shared::model::{Coefficients, NOMINAL};

use super::accelerometer::{Accelerometer, SPREAD};
use super::noise::Seed;
use super::plan::{Dwell, Static, dwells};
use super::simulate::{Simulation, Specification, VirtualBench};
use crate::campaign::{Approach, Record, Series};

/// Spread of a type's coefficients about their mean, in the order of the model, K1 relative to its nominal value: bias and
/// misalignments of a usual instrument, the others some twentieth of what types differ by.
pub const TYPE_SPREAD: [f64; NOMINAL] = [
    0.02, 2e-4, 2.5e-5, 2.3e-5, 8.5e-6, 2.9e-6, 3e-4, 3e-4, 1e-5, 1e-5, 1e-5,
];

/// How a plant tests.
#[derive(Clone, Debug, PartialEq)]
pub struct Plant {
    /// Fixes the type, its instruments and the head.
    pub seed: Seed,
    /// Name of the head.
    pub station: String,
    /// Positions of every instrument, as mounted.
    pub dwells: Vec<Dwell>,
    /// Whether every other instrument is mounted turned by 180 deg.
    pub alternate: bool,
    /// How good head, base and logger are.
    pub specification: Specification,
    /// Whether instruments are shaken too.
    pub shaken: bool,
    /// The head is re-zeroed before the instrument of this number: its marks are others from then on.
    pub rezeroed_before: Option<u64>,
}

impl Plant {
    /// One of that seed with marks of that standard uncertainty, arcsec: 48 readings an instrument, 24 angles in series 1 and 2,
    /// of 1 microg noise.
    pub fn new(seed: Seed, dial_sigma_arcsec: f64) -> Self {
        let mut specification = Specification::with_dial_sigma(dial_sigma_arcsec);
        specification.noise_g = 1e-6;
        specification.head.repeat_sigma_arcsec = 0.0;
        Self {
            seed,
            station: "H1".into(),
            dwells: every_fifteen_degrees(),
            alternate: true,
            specification,
            shaken: false,
            rezeroed_before: None,
        }
    }

    /// The type's mean, from k0 on; K1 is 0.
    pub fn type_mean(&self) -> [f64; NOMINAL] {
        let mut stream = self.seed.stream("type", 0);
        let mut mean = SPREAD.map(|half_width| stream.uniform(-half_width, half_width));
        mean[0] = 0.0;
        mean
    }

    /// The bench with instrument `number` on it.
    pub fn bench(&self, number: u64) -> VirtualBench {
        let mut stream = self.seed.stream("instrument", number);
        let own = Seed(stream.bits());
        let marks = match self.rezeroed_before {
            Some(first) if number >= first => Seed(self.seed.stream("marks", 1).bits()),
            _ => Seed(self.seed.stream("marks", 0).bits()),
        };
        let mut bench =
            VirtualBench::new(own, Static::Default, self.specification, Vec::new()).on_head(marks);
        let mut drawn = self.type_mean();
        for (value, spread) in drawn.iter_mut().zip(TYPE_SPREAD) {
            *value += spread * stream.normal();
        }
        let nominal = 1.0;
        drawn[0] = nominal * (1.0 + drawn[0]);
        bench.accelerometer = Accelerometer {
            scale_factor_nominal_v_per_g: nominal,
            coefficients: Coefficients::from_nominal(drawn),
        };
        bench.plan.dwells.clone_from(&self.dwells);
        if self.alternate && number % 2 == 1 {
            for dwell in &mut bench.plan.dwells {
                dwell.mount_deg += 180.0;
            }
        }
        if !self.shaken {
            bench.plan.runs.clear();
            bench.plan.holdout.clear();
        }
        bench
    }

    /// The campaign of instrument `number`, with the truth behind it. Three instruments are tested a day.
    pub fn campaign(&self, number: u64) -> Simulation {
        let mut made = self.bench(number).simulate();
        let serial = format!("P{number:05}");
        made.truth.serial.clone_from(&serial);
        made.campaign.config.instrument.serial = serial;
        let day = number / 3;
        let hour = 6 + 6 * (number % 3);
        let date = format!("{}T{hour:02}:00:00", day_of(day));
        made.campaign.config.record = Some(Record {
            date: Some(toml::Value::String(date)),
            station: Some(self.station.clone()),
            ..Record::default()
        });
        made
    }
}

/// A day of a calendar of months of 28 days, from the first of January 2026 on.
fn day_of(day: u64) -> String {
    let (month, day) = (day / 28, day % 28);
    format!("{}-{:02}-{:02}", 2026 + month / 12, 1 + month % 12, 1 + day)
}

/// 48 positions: 24 angles in series 1 and 2.
pub fn every_fifteen_degrees() -> Vec<Dwell> {
    let series = [Series::OutputAxis, Series::PendulousAxis];
    let dwell = |series| {
        move |k: u8| Dwell {
            series,
            dial_deg: 15.0 * f64::from(k),
            mount_deg: 0.0,
            approach: Approach::CounterClockwise,
        }
    };
    series
        .into_iter()
        .flat_map(|series| (0..24).map(dwell(series)))
        .collect()
}

/// The 80 readings of the default plan as mounted.
pub fn default_plan() -> Vec<Dwell> {
    dwells(Static::Default)
}
