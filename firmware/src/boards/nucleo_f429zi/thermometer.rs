//! The temperature of the microcontroller, from its own sensor. No sensor of the instrument is wired on this board.

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, SampleTime, Temperature};
use embassy_stm32::peripherals::ADC1;
use firmware::sampler::Around;
use shared::wire::board::TimeBase;

use crate::boards::Surroundings;
use crate::boards::temperature::{Line, Sensor};

/// The codes of a supply of 3.3 V that each part holds (DS9405, table 85); without them the sensor's slope and value (table 84:
/// 2.5 mV/K, 0.76 V at 25 degrees).
const SENSOR: Sensor = Sensor {
    calibration: [0x1FFF_7A2C as _, 0x1FFF_7A2E as _],
    plausible: [500, 4096],
    typical: [
        (0.76 + 5.0 * 2.5e-3) / 3.3 * 4096.0,
        (0.76 + 85.0 * 2.5e-3) / 3.3 * 4096.0,
    ],
};

/// The sensor.
pub struct Thermometer {
    converter: Adc<'static, ADC1>,
    sensor: Temperature,
    line: Line,
    time_base: TimeBase,
}

impl Thermometer {
    /// Switches the sensor on.
    pub fn new(converter: Peri<'static, ADC1>, time_base: TimeBase) -> Self {
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
            .blocking_read(&mut self.sensor, SampleTime::CYCLES480);
        self.line.around(code, self.time_base)
    }
}
