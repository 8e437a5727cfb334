//! Conditions of one reading, and of one run.

use shared::model::SpecificForce;

use crate::campaign::{Approach, Reading, Run, Series, VibrationKind};
use crate::statics::position;

/// Conditions of one dial reading.
#[derive(Clone, Copy, Debug)]
pub struct ReadingConditions {
    /// Sequence number.
    pub order: u64,
    /// Time, s; among those of a model since the campaign's first row.
    pub time_s: f64,
    /// Which axis lies along the head's.
    pub series: Series,
    /// Nominal dial angle, deg.
    pub dial_deg: f64,
    /// Sense in which the dial came to its mark.
    pub approach: Approach,
    /// Nominal specific force, g.
    pub specific_force_g: SpecificForce<f64>,
    /// Temperature, degrees Celsius.
    pub temp_c: f64,
    /// Derivative of a_I by the dial's angle, in units of gravity.
    pub tangent: f64,
}

impl From<&Reading> for ReadingConditions {
    fn from(reading: &Reading) -> Self {
        Self {
            order: reading.order,
            time_s: reading.time_s,
            series: reading.series,
            dial_deg: reading.dial_deg,
            approach: reading.approach,
            specific_force_g: reading.specific_force_g,
            temp_c: reading.temp_c,
            tangent: reading.series.tangent(position(reading).phi_rad()).i,
        }
    }
}

/// Conditions of one shaker run.
#[derive(Clone, Copy, Debug)]
pub struct RunConditions {
    /// Run number.
    pub number: u64,
    /// Time of the centre of the plateau before the vibration, s; among those of a model since the campaign's first row.
    pub time_s: f64,
    /// Kind of the vibration.
    pub kind: VibrationKind,
    /// Unit vector of the commanded motion.
    pub direction: [f64; 3],
    /// Commanded level, g: peak of a sine, rms of a random vibration.
    pub level_g: f64,
    /// Edges of the band, Hz; a sine's frequency twice.
    pub band_hz: [f64; 2],
    /// Gravity on the axes, g.
    pub specific_force_g: SpecificForce<f64>,
    /// Temperature, degrees Celsius.
    pub temp_c: f64,
    /// Length of the vibration, s.
    pub duration_s: f64,
    /// Whether the run was made.
    pub made: bool,
    /// Whether a reference reported the record's third and fourth moments.
    pub shape_seen: bool,
}

impl From<&Run> for RunConditions {
    fn from(run: &Run) -> Self {
        Self {
            number: run.run,
            time_s: run.time_s,
            kind: run.kind,
            direction: run.direction,
            level_g: run.level_g,
            band_hz: run.band_hz,
            specific_force_g: run.specific_force_g,
            temp_c: run.temp_c,
            duration_s: run.duration_s,
            made: run.measured.is_some(),
            shape_seen: run.reference.is_some(),
        }
    }
}

impl RunConditions {
    /// Mean square of the commanded motion, all axes together, g^2.
    pub fn mean_square_g2(&self) -> f64 {
        let square = self.level_g * self.level_g;
        match self.kind {
            VibrationKind::Sine => 0.5 * square,
            VibrationKind::Random => square,
        }
    }

    /// Middle of the band, Hz: the geometric mean of its edges.
    pub fn centre_hz(&self) -> f64 {
        (self.band_hz[0] * self.band_hz[1]).sqrt()
    }
}
