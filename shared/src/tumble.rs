//! The static test: tumbling the instrument in the field of gravity on a dividing head.
//!
//! The head's axis of rotation is horizontal. In each of three [`Series`] another instrument axis lies along
//! it; the head turns the instrument by the angle phi. The angle that the instrument stands at is the dial's
//! mark plus the angle by which it is mounted on the shaft; an error of the mark is common to all readings at
//! that mark, an error of the mount to all readings of that series and mount.

use serde::{Deserialize, Serialize};

use crate::model::SpecificForce;
use crate::scalar::Real;

/// Which instrument axis lies along the dividing head's axis of rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(into = "u8", try_from = "u8")]
pub enum Series {
    /// Series 1, OA on the axis: a = (-cos phi, sin phi, 0).
    OutputAxis,
    /// Series 2, PA on the axis: a = (-cos phi, 0, sin phi).
    PendulousAxis,
    /// Series 3, IA on the axis: a = (0, -cos phi, sin phi).
    InputAxis,
}

/// A series number that is none of 1, 2, 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoSuchSeries(
    /// The number given.
    pub u8,
);

impl core::fmt::Display for NoSuchSeries {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "series {} is none of 1, 2, 3", self.0)
    }
}

impl core::error::Error for NoSuchSeries {}

impl TryFrom<u8> for Series {
    type Error = NoSuchSeries;
    fn try_from(number: u8) -> Result<Self, NoSuchSeries> {
        match number {
            1 => Ok(Self::OutputAxis),
            2 => Ok(Self::PendulousAxis),
            3 => Ok(Self::InputAxis),
            other => Err(NoSuchSeries(other)),
        }
    }
}

impl From<Series> for u8 {
    fn from(series: Series) -> u8 {
        match series {
            Series::OutputAxis => 1,
            Series::PendulousAxis => 2,
            Series::InputAxis => 3,
        }
    }
}

impl Series {
    /// The three series in order.
    pub const ALL: [Self; 3] = [Self::OutputAxis, Self::PendulousAxis, Self::InputAxis];

    /// Specific force (in units of local gravity) with the instrument at the angle `phi_rad`, rad.
    #[doc(alias = "a")]
    pub fn specific_force<T: Real>(self, phi_rad: T) -> SpecificForce<T> {
        let (sin, cos) = phi_rad.sin_cos();
        self.place(-cos, sin)
    }

    /// Derivative of the specific force by the angle, in units of local gravity per rad.
    pub fn tangent<T: Real>(self, phi_rad: T) -> SpecificForce<T> {
        let (sin, cos) = phi_rad.sin_cos();
        self.place(sin, cos)
    }

    /// Derivative of the specific force by the lift of the axis of rotation out of the horizontal, in units of
    /// local gravity per rad. To first order the axis that lies on the shaft sees the whole of it.
    pub fn lift<T: Real>(self) -> SpecificForce<T> {
        let (o, l) = (T::zero(), T::one());
        match self {
            Self::OutputAxis => SpecificForce::new(o, o, l),
            Self::PendulousAxis => SpecificForce::new(o, l, o),
            Self::InputAxis => SpecificForce::new(l, o, o),
        }
    }

    fn place<T: Real>(self, first: T, second: T) -> SpecificForce<T> {
        let zero = T::zero();
        match self {
            Self::OutputAxis => SpecificForce::new(first, second, zero),
            Self::PendulousAxis => SpecificForce::new(first, zero, second),
            Self::InputAxis => SpecificForce::new(zero, first, second),
        }
    }
}

/// One second of arc, rad.
pub const ARCSEC_RAD: f64 = core::f64::consts::PI / 648_000.0;

/// The same angle in [0, 360) deg: equal places on the dial are equal numbers.
pub fn within_a_turn(angle_deg: f64) -> f64 {
    num_traits::Euclid::rem_euclid(&angle_deg, &360.0)
}

/// One position of a plan of a static test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Position {
    /// Which axis lies on the shaft.
    pub series: Series,
    /// The dial's mark, deg.
    pub dial_deg: f64,
    /// How the instrument is remounted on the shaft, deg; it stands at `dial_deg + mount_deg`.
    pub mount_deg: f64,
}

impl Position {
    /// The angle phi at which the instrument stands, rad, reduced to one turn before it is converted, so that
    /// equal angles give equal specific forces.
    pub fn phi_rad(&self) -> f64 {
        within_a_turn(self.dial_deg + self.mount_deg).to_radians()
    }

    /// Specific force, in units of local gravity.
    pub fn specific_force(&self) -> SpecificForce<f64> {
        self.series.specific_force(self.phi_rad())
    }
}

/// The dial angles of the paper's plan, in each of the three series; deg.
pub const PAPER_ANGLES_DEG: [f64; 8] = [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0];

/// Dial angles which, added to series 1 and 2, give |a_I| = 1/2 and sqrt(3)/2 and so the full rank; deg.
pub const COMPLETING_ANGLES_DEG: [f64; 8] = [30.0, 60.0, 120.0, 150.0, 210.0, 240.0, 300.0, 330.0];

/// The paper's 24 positions, series by series.
pub fn paper_plan() -> impl Iterator<Item = Position> {
    Series::ALL.into_iter().flat_map(|series| {
        PAPER_ANGLES_DEG.into_iter().map(move |dial_deg| Position {
            series,
            dial_deg,
            mount_deg: 0.0,
        })
    })
}

/// The 40 positions that determine every coefficient: the paper's 24, and [`COMPLETING_ANGLES_DEG`] in series
/// 1 and 2.
pub fn full_rank_plan() -> impl Iterator<Item = Position> {
    let added = [Series::OutputAxis, Series::PendulousAxis]
        .into_iter()
        .flat_map(|series| {
            COMPLETING_ANGLES_DEG
                .into_iter()
                .map(move |dial_deg| Position {
                    series,
                    dial_deg,
                    mount_deg: 0.0,
                })
        });
    paper_plan().chain(added)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn specific_force_stays_of_unit_length_and_turns_at_the_tangent() {
        for series in Series::ALL {
            for k in 0..48 {
                let phi = f64::from(k) * 0.13;
                let (a, t) = (series.specific_force(phi), series.tangent::<f64>(phi));
                assert!((a.length() - 1.0).abs() < 1e-15);
                let step = 1e-6;
                let (b, c) = (
                    series.specific_force(phi + step),
                    series.specific_force(phi - step),
                );
                for (slope, numeric) in [
                    (t.i, (b.i - c.i) / (2.0 * step)),
                    (t.p, (b.p - c.p) / (2.0 * step)),
                    (t.o, (b.o - c.o) / (2.0 * step)),
                ] {
                    assert!((slope - numeric).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn series_one_at_half_a_turn_reads_plus_one_g() {
        // The surviving (10) has U15 - U11 positive: position 5 of series 1 is 180 deg.
        let a = Series::OutputAxis.specific_force(core::f64::consts::PI);
        assert!((a.i - 1.0).abs() < 1e-15);
    }

    #[test]
    fn plans_have_24_and_40_positions() {
        assert_eq!(paper_plan().count(), 24);
        assert_eq!(full_rank_plan().count(), 40);
    }
}
