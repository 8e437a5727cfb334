//! The temperature of the microcontroller, from its own sensor. No sensor of the instrument is wired on this board.

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, SampleTime, Temperature};
use embassy_stm32::peripherals::ADC3;
use firmware::sampler::Around;
use shared::wire::board::TimeBase;

use crate::boards::Surroundings;
use crate::boards::temperature::{Line, Sensor};

/// The codes of a supply of 3.3 V that each part holds (DS12110, table 90); without them the sensor's slope and value (table 89:
/// 2 mV/K, 0.62 V at 30 degrees).
const SENSOR: Sensor = Sensor {
    calibration: [0x1FF1_E820 as _, 0x1FF1_E840 as _],
    plausible: [8000, u16::MAX],
    typical: [0.62 / 3.3 * 65536.0, (0.62 + 80.0 * 2e-3) / 3.3 * 65536.0],
};

/// The sensor.
pub struct Thermometer {
    converter: Adc<'static, ADC3>,
    sensor: Temperature,
    line: Line,
    time_base: TimeBase,
}

impl Thermometer {
    /// Switches the sensor on.
    pub fn new(converter: Peri<'static, ADC3>, time_base: TimeBase) -> Self {
        let converter = Adc::new(converter);
        let sensor = converter.enable_temperature();
        Self {
            converter,
            sensor,
            line: Line::new(&SENSOR),
            time_base,
        }
    }
}

impl Surroundings for Thermometer {
    fn measure(&mut self) -> Around {
        let code = self
            .converter
            .blocking_read(&mut self.sensor, SampleTime::CYCLES387_5);
        self.line.around(code, self.time_base)
    }
}
