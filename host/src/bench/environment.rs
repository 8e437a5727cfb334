//! What changes slowly: the room's temperature, and what the instrument has been through.

use super::noise::Seed;

/// The room over a campaign: a level that differs from day to day and a slow wander of about 2 K.
#[derive(Clone, Debug, PartialEq)]
pub struct Room {
    mean_c: f64,
    waves: [(f64, f64, f64); 4],
}

impl Room {
    /// The room that belongs to a seed, near `reference_temp_c`.
    pub fn draw(reference_temp_c: f64, seed: Seed) -> Self {
        let mut stream = seed.stream("room temperature", 0);
        Self {
            mean_c: reference_temp_c + 1.5 * stream.normal(),
            // Periods from half a shift to a day; amplitude (K), angular frequency (rad/s), phase.
            waves: [(); 4].map(|()| {
                let period_s = stream.log_uniform(4.0 * 3600.0, 24.0 * 3600.0);
                let amplitude_k = 0.9 * stream.normal();
                let phase = stream.uniform(0.0, std::f64::consts::TAU);
                (amplitude_k, std::f64::consts::TAU / period_s, phase)
            }),
        }
    }

    /// Instrument temperature, degrees Celsius, to the thermometer's last digit of 1 mK.
    pub fn temp_c(&self, time_s: f64) -> f64 {
        let wave =
            |&(amplitude, rate, phase): &(f64, f64, f64)| amplitude * (rate * time_s + phase).sin();
        let temp_c = self.mean_c + self.waves.iter().map(wave).sum::<f64>();
        (temp_c * 1000.0).round() / 1000.0
    }
}

/// One vibration that the instrument has been, or is being, exposed to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Its start since the campaign's start, s.
    pub start_s: f64,
    /// Its end, s.
    pub end_s: f64,
    /// Mean square of the motion, all axes together, g^2.
    pub power_g2: f64,
    /// Largest magnitude of the vibration along IA, g.
    pub peak_i_g: f64,
    /// Rms value of the shaker's drive, g.
    pub drive_rms_g: f64,
}

impl Exposure {
    /// How much of it is over, from 0 before its start to 1 from its end on.
    pub fn progress(&self, time_s: f64) -> f64 {
        ((time_s - self.start_s) / (self.end_s - self.start_s)).clamp(0.0, 1.0)
    }
}

/// A moment in the life of the instrument.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// Since the campaign's start, s.
    pub time_s: f64,
    /// Instrument temperature less the reference temperature, K.
    pub excess_k: f64,
    /// Vibrations so far, the present one included, in the order of time.
    pub exposures: &'a [Exposure],
}
