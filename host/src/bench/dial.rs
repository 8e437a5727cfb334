//! The dividing head on its base: from a nominal attitude to the specific force the instrument really feels.
//!
//! Each mark of the dial has an error of its own, the same in every series, mount and sense of approach; each
//! setting repeats it within the head's repeatability. A mounted instrument sits at an angle known only to
//! the mount's uncertainty, one error per series and mount, the first one too. The base is out of level by two angles common to
//! everything: one adds to the dial's zero, the other lifts the axis of rotation out of the horizontal.

use shared::tumble::ARCSEC_RAD;

use super::noise::Seed;
use super::plan::Dwell;
use crate::campaign::Series;

/// Standard uncertainties of a head and its base, arcsec.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadSpecification {
    /// Of one mark.
    pub dial_sigma_arcsec: f64,
    /// Of one setting to a mark.
    pub repeat_sigma_arcsec: f64,
    /// Of the angle at which the instrument is mounted.
    pub mount_sigma_arcsec: f64,
    /// Of each of the base's two tilts.
    pub level_sigma_arcsec: f64,
}

/// A head with its errors, fixed by the seed.
#[derive(Clone, Copy, Debug)]
pub struct Head {
    specification: HeadSpecification,
    seed: Seed,
    /// Where the errors of its marks come from.
    marks: Seed,
}

impl Head {
    /// The head that belongs to a seed.
    pub fn new(specification: HeadSpecification, seed: Seed) -> Self {
        Self {
            specification,
            seed,
            marks: seed,
        }
    }

    /// The same with the marks of another head; mounts and level stay.
    pub fn with_marks(self, marks: Seed) -> Self {
        Self { marks, ..self }
    }

    /// Error of a mark, arcsec.
    pub fn mark_error_arcsec(&self, dial_deg: f64) -> f64 {
        let mark = arcseconds(dial_deg);
        self.specification.dial_sigma_arcsec * self.marks.stream("dial mark", mark).normal()
    }

    /// Error of the instrument's angle on the shaft, arcsec: one for each series and mount, the first one too.
    pub fn mount_error_arcsec(&self, series: Series, mount_deg: f64) -> f64 {
        let index = arcseconds(mount_deg) + ((series as u64) << 32);
        self.specification.mount_sigma_arcsec * self.seed.stream("mount", index).normal()
    }

    /// The base's two tilts, arcsec: of the dial's zero, and of the axis of rotation.
    pub fn tilts_arcsec(&self) -> [f64; 2] {
        let mut stream = self.seed.stream("base level", 0);
        [(); 2].map(|()| self.specification.level_sigma_arcsec * stream.normal())
    }

    /// The head as it really stands at a dwell, number `order` of the campaign.
    pub fn setting(&self, dwell: &Dwell, order: u64) -> Setting {
        let repeat = self.seed.stream("dial repeatability", order).normal();
        let error_arcsec = self.mark_error_arcsec(dwell.dial_deg)
            + self.mount_error_arcsec(dwell.series, dwell.mount_deg)
            + self.specification.repeat_sigma_arcsec * repeat;
        Setting {
            error_rad: ARCSEC_RAD * error_arcsec,
            tilts_rad: self.tilts_arcsec().map(|tilt| tilt * ARCSEC_RAD),
        }
    }
}

/// How far a head stands off the nominal attitude of a dwell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Of the instrument's angle, rad: mark, mount and repeatability.
    pub error_rad: f64,
    /// Of the base, rad: the tilt that adds to the dial's zero, the tilt that lifts the axis of rotation.
    pub tilts_rad: [f64; 2],
}

impl Setting {
    /// The specific force on IA, PA, OA at a dwell, in units of local gravity.
    pub fn specific_force(&self, dwell: &Dwell) -> [f64; 3] {
        let [zero, lift] = self.tilts_rad;
        let angle = (dwell.dial_deg + dwell.mount_deg).to_radians() + self.error_rad + zero;
        attitude(dwell.series, angle, lift)
    }
}

/// The specific force, in units of local gravity, of an instrument at `angle_rad` about a shaft lifted by
/// `lift_rad`: the axis along the shaft feels the lift, the other two turn in the plane across it.
pub fn attitude(series: Series, angle_rad: f64, lift_rad: f64) -> [f64; 3] {
    let (sin, cos) = angle_rad.sin_cos();
    let (along, across) = lift_rad.sin_cos();
    let (first, second) = (-cos * across, sin * across);
    match series {
        Series::OutputAxis => [first, second, along],
        Series::PendulousAxis => [first, along, second],
        Series::InputAxis => [along, first, second],
    }
}

/// The nominal specific force of a dwell, exact zeros where an axis is level, in units of local gravity.
pub fn nominal(dwell: &Dwell) -> [f64; 3] {
    let angle = (dwell.dial_deg + dwell.mount_deg).to_radians();
    attitude(dwell.series, angle, 0.0).map(|a| if a.abs() < 1e-12 { 0.0 } else { a })
}

fn arcseconds(degrees: f64) -> u64 {
    (degrees.rem_euclid(360.0) * 3600.0).round() as u64 % 1_296_000
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::Approach;

    const SPECIFICATION: HeadSpecification = HeadSpecification {
        dial_sigma_arcsec: 2.0,
        repeat_sigma_arcsec: 0.5,
        mount_sigma_arcsec: 60.0,
        level_sigma_arcsec: 3.0,
    };

    fn dwell(series: Series, dial_deg: f64, mount_deg: f64) -> Dwell {
        Dwell {
            series,
            dial_deg,
            mount_deg,
            approach: Approach::CounterClockwise,
        }
    }

    /// Standard deviation about zero, and that it is `sigma` within four of its own.
    fn assert_sigma(values: &[f64], sigma: f64) {
        let count = values.len() as f64;
        let found = (values.iter().map(|v| v * v).sum::<f64>() / count).sqrt();
        assert!(
            (found / sigma - 1.0).abs() < 4.0 / (2.0 * count).sqrt(),
            "{found} {sigma}"
        );
    }

    #[test]
    fn errors_have_the_standard_deviations_of_the_specification() {
        let heads: Vec<_> = (0..2000)
            .map(|n| Head::new(SPECIFICATION, Seed(n)))
            .collect();
        let collect = |value: &dyn Fn(&Head) -> f64| heads.iter().map(value).collect::<Vec<_>>();
        assert_sigma(&collect(&|head| head.mark_error_arcsec(45.0)), 2.0);
        assert_sigma(
            &collect(&|head| head.mount_error_arcsec(Series::PendulousAxis, 180.0)),
            60.0,
        );
        assert_sigma(
            &collect(&|head| head.mount_error_arcsec(Series::OutputAxis, 0.0)),
            60.0,
        );
        assert_sigma(&collect(&|head| head.tilts_arcsec()[0]), 3.0);
        assert_sigma(&collect(&|head| head.tilts_arcsec()[1]), 3.0);
        // Two settings of one mark differ by their repeatability alone, sqrt 2 times 0.5 arcsec.
        let at = dwell(Series::OutputAxis, 90.0, 0.0);
        let settings = collect(&|head| {
            let [first, second] =
                [1, 2].map(|order| head.setting(&at, order).specific_force(&at)[0]);
            (first - second) / ARCSEC_RAD
        });
        assert_sigma(&settings, 0.5 * 2.0_f64.sqrt());
    }

    #[test]
    fn a_mark_errs_alike_in_every_series_and_approach() {
        let exact = HeadSpecification {
            repeat_sigma_arcsec: 0.0,
            mount_sigma_arcsec: 0.0,
            ..SPECIFICATION
        };
        let head = Head::new(exact, Seed(5));
        let force = |dwell: &Dwell, order| head.setting(dwell, order).specific_force(dwell);
        let ccw = force(&dwell(Series::OutputAxis, 90.0, 0.0), 0);
        let cw = Dwell {
            approach: Approach::Clockwise,
            ..dwell(Series::PendulousAxis, 450.0, 0.0)
        };
        let cw = force(&cw, 7);
        assert!((ccw[0] - cw[0]).abs() < 1e-15);
    }
}
