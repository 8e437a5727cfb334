//! The temperature of a microcontroller's own sensor, a straight line through two codes.

use firmware::sampler::Around;
use shared::wire::board::TimeBase;

/// Temperatures of the two codes, degrees Celsius.
const CALIBRATED_C: [f32; 2] = [30.0, 110.0];

/// What a part is known by.
pub struct Sensor {
    /// Where the part holds its codes at 30 and at 110 degrees, in its system memory.
    pub calibration: [*const u16; 2],
    /// What those lie between, neither end allowed.
    pub plausible: [u16; 2],
    /// The codes where it holds none.
    pub typical: [f32; 2],
}

/// A sensor's line.
pub struct Line {
    codes: [f32; 2],
}

impl Line {
    /// By the codes that the part holds, if they are plausible.
    pub fn new(sensor: &Sensor) -> Self {
        // SAFETY: the part's system memory, which is always readable and never changes.
        #[allow(unsafe_code)]
        let held = sensor
            .calibration
            .map(|address| unsafe { address.read_volatile() });
        let [least, greatest] = sensor.plausible;
        let plausible = held[0] > least && held[1] > held[0] && held[1] < greatest;
        let codes = if plausible {
            held.map(f32::from)
        } else {
            sensor.typical
        };
        Self { codes }
    }

    /// What a code says; no sensor of the instrument is wired.
    pub fn around(&self, code: u16, time_base: TimeBase) -> Around {
        let [low, high] = self.codes;
        let [low_c, high_c] = CALIBRATED_C;
        let board_c = low_c + (f32::from(code) - low) * (high_c - low_c) / (high - low);
        Around {
            board_c: Some(board_c),
            instrument_c: None,
            time_base_unsure: time_base == TimeBase::Internal,
        }
    }
}
