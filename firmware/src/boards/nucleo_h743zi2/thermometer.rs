//! The temperature of the microcontroller, from its own sensor. No sensor of the instrument is wired on this board.

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, SampleTime, Temperature};
use embassy_stm32::peripherals::ADC3;
use firmware::sampler::Around;
use shared::wire::board::TimeBase;

use crate::boards::Surroundings;

/// Codes at 30 and at 110 degrees with a supply of 3.3 V, which each part holds (DS12110, table 90).
const CALIBRATION: [*const u16; 2] = [0x1FF1_E820 as _, 0x1FF1_E840 as _];
const CALIBRATED_C: [f32; 2] = [30.0, 110.0];

/// The sensor's slope and value without them (DS12110, table 89: 2 mV/K, 0.62 V at 30 degrees), in codes of 3.3 V.
const TYPICAL: [f32; 2] = [0.62 / 3.3 * 65536.0, (0.62 + 80.0 * 2e-3) / 3.3 * 65536.0];

/// The sensor.
pub struct Thermometer {
    converter: Adc<'static, ADC3>,
    sensor: Temperature,
    codes: [f32; 2],
    time_base: TimeBase,
}

impl Thermometer {
    /// Switches the sensor on.
    pub fn new(converter: Peri<'static, ADC3>, time_base: TimeBase) -> Self {
        let converter = Adc::new(converter);
        let sensor = converter.enable_temperature();
        // SAFETY: the part's system memory, which is always readable and never changes.
        #[allow(unsafe_code)]
        let held = CALIBRATION.map(|address| unsafe { address.read_volatile() });
        let plausible = held[0] > 8000 && held[1] > held[0] && held[1] < u16::MAX;
        let codes = if plausible {
            held.map(f32::from)
        } else {
            TYPICAL
        };
        Self {
            converter,
            sensor,
            codes,
            time_base,
        }
    }
}

impl Surroundings for Thermometer {
    fn measure(&mut self) -> Around {
        let code = self
            .converter
            .blocking_read(&mut self.sensor, SampleTime::CYCLES387_5);
        let [low, high] = self.codes;
        let [low_c, high_c] = CALIBRATED_C;
        let board_c = low_c + (f32::from(code) - low) * (high_c - low_c) / (high - low);
        Around {
            board_c: Some(board_c),
            instrument_c: None,
            time_base_unsure: self.time_base == TimeBase::Internal,
        }
    }
}
