//! The triaxial reference accelerometer on the table.

use super::chain::Motion;
use super::noise::Stream;

/// What it tells of one run, on IA, PA, OA.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Rms value, g, within the reference's relative uncertainty.
    pub rms_g: [f64; 3],
    /// Third standardized moment of this very record; 0 on an axis that stands still.
    pub skewness: [f64; 3],
    /// Fourth standardized moment (1.5 for a sine, near 3 for noise); 0 on an axis that stands still.
    pub kurtosis: [f64; 3],
    /// Correlation coefficients IA-PA, IA-OA, PA-OA; 0 where an axis stands still.
    pub correlation: [f64; 3],
}

/// The reference's view of a motion. The scale of each axis is off by the relative standard uncertainty
/// `rms_rel_sigma`, anew in every run. The axes move in proportion, so that one record's moments serve all.
pub fn look(motion: &Motion, rms_rel_sigma: f64, stream: &mut Stream) -> Seen {
    let record = &motion.reference;
    let mean = record.moment(1);
    let (mut m2, mut m3, mut m4) = (0.0, 0.0, 0.0);
    for sample in &record.samples {
        let w = sample - mean;
        let square = w * w;
        m2 += square;
        m3 += square * w;
        m4 += square * square;
    }
    let count = record.samples.len() as f64;
    let (m2, m3, m4) = (m2 / count, m3 / count, m4 / count);
    // An axis that stands still has the sign 0. Drawn for every axis, so that a run that moves more axes does
    // not shift the errors of the others.
    let sign = motion
        .direction
        .map(|n| if n == 0.0 { 0.0 } else { n.signum() });
    let scale = [(); 3].map(|()| 1.0 + rms_rel_sigma * stream.normal());
    let axes = [0, 1, 2];
    Seen {
        rms_g: axes.map(|axis| motion.direction[axis].abs() * m2.sqrt() * scale[axis]),
        skewness: axes.map(|axis| sign[axis] * m3 / m2.powf(1.5)),
        kurtosis: axes.map(|axis| sign[axis].abs() * m4 / (m2 * m2)),
        correlation: [(0, 1), (0, 2), (1, 2)].map(|(one, other)| sign[one] * sign[other]),
    }
}
