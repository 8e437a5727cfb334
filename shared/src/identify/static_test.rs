//! The static test as a weighted least-squares problem with correlated errors.
//!
//! A reading at a dial mark carries, beside its own noise, errors that other readings share:
//!
//! * the mark's error, one per dial angle, the same in all series;
//! * the mount's error, one per series and mount;
//! * two tilts of the base, common to all: one adds to the dial's zero, one lifts the axis of rotation.
//!
//! They are random effects: unknowns with zero mean and a stated standard deviation, estimated together with the
//! coefficients, so that they widen and correlate the coefficients' uncertainty as they should. The repeatability of
//! a setting belongs to the single reading and adds to its noise.
//!
//! A mark's error meets only the unknowns that are common to all readings, never another mark, so the factor is an
//! arrow: one short row per mark, and one triangle for the rest. Memory and work per reading do not grow with the
//! number of readings.

use serde::{Deserialize, Serialize};

use crate::identify::blindness::{BEFOREHAND, Design, Visibility};
use crate::identify::square_root::{
    FactorError, TriangularFactor, inverse_square, leave_out, storage_len,
};
use crate::model::{Coefficients, NOMINAL, SpecificForce, terms};
use crate::scalar::Real;
use crate::tumble::{Position, Series, within_a_turn};

/// Standard uncertainties of the dividing head, and local gravity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bench<T> {
    /// Of one mark of the dial, rad.
    pub dial_sigma_rad: T,
    /// Repeatability of one setting to a mark, rad.
    pub dial_repeat_sigma_rad: T,
    /// Of a remounting angle, rad.
    pub mount_sigma_rad: T,
    /// Of the base's level about either axis, rad.
    pub level_sigma_rad: T,
    /// Local gravity over the unit g.
    pub local_gravity_g: T,
}

/// One reading of the static test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<T> {
    /// Where on the dividing head.
    pub position: Position,
    /// Mean output, V.
    pub output_v: T,
    /// Standard uncertainty of that mean from noise alone, V; > 0.
    pub sigma_v: T,
}

/// What readings say of the angle at which the instrument is mounted on the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MountEstimate<T> {
    /// Which axis lies on the shaft.
    pub series: Series,
    /// The nominal remounting angle, deg.
    pub mount_deg: f64,
    /// How far the mount is off that, rad.
    pub error_rad: T,
}

/// Why a reading cannot be absorbed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StaticTestError {
    /// More dial marks than the work space has room for.
    TooManyMarks {
        /// Room for this many.
        capacity: usize,
    },
    /// More pairs of series and mount than the work space has room for.
    TooManyMounts {
        /// Room for this many.
        capacity: usize,
    },
    /// The work space is too small for the capacities asked for.
    Workspace(FactorError),
    /// Output or its uncertainty is not a number, or the uncertainty is not positive.
    BadReading,
}

impl core::fmt::Display for StaticTestError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TooManyMarks { capacity } => write!(f, "more than {capacity} dial marks"),
            Self::TooManyMounts { capacity } => {
                write!(f, "more than {capacity} pairs of series and mount")
            }
            Self::Workspace(error) => write!(f, "work space: {error}"),
            Self::BadReading => write!(f, "output not finite, or its uncertainty not positive"),
        }
    }
}

impl core::error::Error for StaticTestError {}

/// Index of the tilts among the common unknowns, after the mounts; the coefficients follow.
const TILTS: usize = 2;

/// The readings of a static test so far, as a factor.
#[derive(Debug)]
pub struct StaticTest<'a, T> {
    bench: Bench<T>,
    /// Where the model is linearised: for the angles' effect on the output only.
    about: Coefficients<T>,
    mark_capacity: usize,
    mount_capacity: usize,
    marks: usize,
    mounts: usize,
    /// Each mark: its dial angle (deg), its diagonal element, its row over the common unknowns and right-hand side.
    mark_rows: &'a mut [T],
    /// Each mount: series, angle (deg), estimate about which it is linearised (rad).
    mount_keys: &'a mut [T],
    row: &'a mut [T],
    common: TriangularFactor<T, &'a mut [T]>,
    design: Design<T>,
    readings: usize,
}

/// Numbers kept for a mark beside its row over the common unknowns.
const MARK_HEAD: usize = 2;
/// Numbers kept for a mount.
const MOUNT_KEY: usize = 3;

/// Unknowns common to all marks.
const fn common_unknowns(mounts: usize) -> usize {
    mounts + TILTS + NOMINAL
}

/// The number of numbers that a static test with up to `marks` dial marks and `mounts` pairs of series and mount
/// needs as work space: 775 for 24 marks and 6 mounts.
pub const fn workspace_len(marks: usize, mounts: usize) -> usize {
    let common = common_unknowns(mounts);
    marks * (MARK_HEAD + common + 1) + mounts * MOUNT_KEY + (common + 1) + storage_len(common)
}

impl<'a, T: Real> StaticTest<'a, T> {
    /// An empty test with room for `marks` dial marks and `mounts` pairs of series and mount in `workspace`
    /// ([`workspace_len`] numbers).
    ///
    /// `about` gives the slope of the output by the angle; nominal values are good to a few per cent of the angles'
    /// errors, and a second pass about the first's result removes even that.
    ///
    /// # Errors
    /// [`StaticTestError::Workspace`] if `workspace` is too short.
    pub fn new(
        bench: Bench<T>,
        about: Coefficients<T>,
        marks: usize,
        mounts: usize,
        workspace: &'a mut [T],
    ) -> Result<Self, StaticTestError> {
        let (given, needed) = (workspace.len(), workspace_len(marks, mounts));
        if given < needed {
            return Err(StaticTestError::Workspace(FactorError::StorageTooSmall {
                given,
                needed,
            }));
        }
        let common = common_unknowns(mounts);
        let (mark_rows, rest) = workspace.split_at_mut(marks * (MARK_HEAD + common + 1));
        let (mount_keys, rest) = rest.split_at_mut(mounts * MOUNT_KEY);
        let (row, rest) = rest.split_at_mut(common + 1);
        let mut test = Self {
            bench,
            about,
            mark_capacity: marks,
            mount_capacity: mounts,
            marks: 0,
            mounts: 0,
            mark_rows,
            mount_keys,
            row,
            common: TriangularFactor::new(common, rest).map_err(StaticTestError::Workspace)?,
            design: Design::default(),
            readings: 0,
        };
        test.restart(bench, about);
        Ok(test)
    }

    /// Forgets all readings and begins anew, in the same work space.
    pub fn restart(&mut self, bench: Bench<T>, about: Coefficients<T>) {
        self.bench = bench;
        self.about = about;
        self.marks = 0;
        self.mounts = 0;
        self.common.clear();
        self.design = Design::default();
        self.readings = 0;
        for tilt in 0..TILTS {
            self.prior(self.mount_capacity + tilt, T::zero(), bench.level_sigma_rad);
        }
    }

    /// States what an earlier pass found for a mount, before its first reading, so that the geometry is linearised
    /// about it.
    ///
    /// # Errors
    /// [`StaticTestError::TooManyMounts`].
    pub fn linearise_mount(&mut self, found: &MountEstimate<T>) -> Result<(), StaticTestError> {
        self.mount_index(found.series, found.mount_deg, found.error_rad)
            .map(|_| ())
    }

    /// Absorbs a reading.
    ///
    /// # Errors
    /// [`StaticTestError::TooManyMarks`], [`StaticTestError::TooManyMounts`] or [`StaticTestError::BadReading`]; the
    /// test is as before.
    pub fn absorb(&mut self, reading: &Reading<T>) -> Result<(), StaticTestError> {
        let bad = |x: T| !x.is_finite();
        if bad(reading.output_v) || bad(reading.sigma_v) || reading.sigma_v <= T::zero() {
            return Err(StaticTestError::BadReading);
        }
        let position = &reading.position;
        let mark = self.mark_index(position.dial_deg)?;
        let mount = self.mount_index(position.series, position.mount_deg, T::zero())?;
        let phi = T::lit(position.phi_rad()) + self.mount_keys[mount * MOUNT_KEY + 2];
        let g = self.bench.local_gravity_g;
        let a = scaled(position.series.specific_force(phi), g);
        let slope = self.about.gradient(without_rounding(a));
        let k1 = self.about.scale_factor_v_per_g;
        let by_angle = k1 * inner(slope, scaled(position.series.tangent(phi), g));
        let by_lift = k1 * inner(slope, scaled(position.series.lift(), g));

        let repeat = self.bench.dial_repeat_sigma_rad * by_angle;
        let weight = (reading.sigma_v * reading.sigma_v + repeat * repeat)
            .sqrt()
            .recip();
        let tilts = self.mount_capacity;
        self.row.fill(T::zero());
        self.row[mount] = weight * by_angle;
        self.row[tilts] = weight * by_angle;
        self.row[tilts + 1] = weight * by_lift;
        for (r, f) in self.row[tilts + TILTS..].iter_mut().zip(terms(a)) {
            *r = weight * f;
        }
        let last = self.row.len() - 1;
        self.row[last] = weight * reading.output_v;
        for (sigma, column) in [
            (self.bench.mount_sigma_rad, mount),
            (self.bench.level_sigma_rad, tilts),
            (self.bench.level_sigma_rad, tilts + 1),
        ] {
            if sigma == T::zero() {
                self.row[column] = T::zero();
            }
        }
        if let Some(mark) = mark {
            self.rotate_into_mark(mark, weight * by_angle);
        }
        self.common.absorb(self.row);
        self.design
            .absorb(position.series.specific_force(T::lit(position.phi_rad())));
        self.readings += 1;
        Ok(())
    }

    /// Solves for the coefficients.
    ///
    /// `prior_sigma` states a standard deviation, about zero, for the coefficients in the order of
    /// [`Coefficients::to_nominal`] (the first, for K1, is not used), `None` for no prior. What is blind is judged beside
    /// it, or beside [`BEFOREHAND`].
    ///
    /// # Errors
    /// [`FactorError::Undetermined`] if the readings do not determine the scale factor, or none have come;
    /// [`FactorError::NoVariance`] where rounding has eaten the answer.
    pub fn solve(&self, prior_sigma: Option<&[T; NOMINAL]>) -> Result<Fit<T>, FactorError> {
        let beforehand = BEFOREHAND.map(T::lit);
        self.solve_beside(prior_sigma.unwrap_or(&beforehand), prior_sigma.is_some())
    }

    /// As [`Self::solve`]: what is blind is judged beside these standard deviations, which act as a prior only if
    /// `is_prior`.
    ///
    /// # Errors
    /// Those of [`Self::solve`].
    pub fn solve_beside(
        &self,
        beforehand: &[T; NOMINAL],
        is_prior: bool,
    ) -> Result<Fit<T>, FactorError> {
        let (triangle, rhs) = self.common.trailing::<NOMINAL>();
        Information {
            triangle,
            rhs,
            residual_squares: self.common.residual_squares(),
            scale_v_per_g: self.about.scale_factor_v_per_g,
            design: self.design.clone(),
            readings: self.readings,
        }
        .solve_beside(beforehand, is_prior)
    }

    /// The number of readings so far.
    pub fn readings(&self) -> usize {
        self.readings
    }

    /// The mounts' errors that go with these coefficients (of [`Self::solve`]), in the order in which the mounts came:
    /// to linearise a second pass about.
    pub fn mount_estimates(
        &mut self,
        coefficients: &Coefficients<T>,
    ) -> impl Iterator<Item = MountEstimate<T>> {
        let k1 = coefficients.scale_factor_v_per_g;
        let first = self.mount_capacity + TILTS;
        let x = &mut *self.row;
        for (x, c) in x[first..].iter_mut().zip(coefficients.to_nominal()) {
            *x = k1 * c;
        }
        x[first] = k1;
        for k in (0..first).rev() {
            let row = self.common.row(k);
            let (sum, last) = (T::zero(), row.len() - 1);
            let sum = row[1..last]
                .iter()
                .zip(&x[k + 1..])
                .fold(sum, |sum, (r, x)| sum + *r * *x);
            // A mount that has not come, or an angle said to be exact, has no row and no error.
            x[k] = if row[0] == T::zero() {
                T::zero()
            } else {
                (row[last] - sum) / row[0]
            };
        }
        let keys = self
            .mount_keys
            .as_chunks::<MOUNT_KEY>()
            .0
            .iter()
            .zip(&*self.row)
            .take(self.mounts);
        keys.filter_map(|(key, x)| {
            Some(MountEstimate {
                series: Series::try_from(key[0].to_u8()?).ok()?,
                mount_deg: key[1].to_f64(),
                error_rad: key[2] + *x,
            })
        })
    }

    fn prior(&mut self, column: usize, mean: T, sigma: T) {
        if sigma > T::zero() {
            self.row.fill(T::zero());
            self.row[column] = sigma.recip();
            let last = self.row.len() - 1;
            self.row[last] = mean / sigma;
            self.common.absorb(self.row);
        }
    }

    /// The index of the mark's row, none if the dial is said to be exact.
    fn mark_index(&mut self, dial_deg: f64) -> Result<Option<usize>, StaticTestError> {
        if self.bench.dial_sigma_rad == T::zero() {
            return Ok(None);
        }
        let key = T::lit(within_a_turn(dial_deg));
        let width = MARK_HEAD + self.row.len();
        let known = self.mark_rows.chunks_exact(width).take(self.marks);
        if let Some(index) = known.into_iter().position(|row| row[0] == key) {
            return Ok(Some(index));
        }
        let index = self.marks;
        if index == self.mark_capacity {
            return Err(StaticTestError::TooManyMarks {
                capacity: self.mark_capacity,
            });
        }
        let row = &mut self.mark_rows[index * width..(index + 1) * width];
        row.fill(T::zero());
        row[0] = key;
        row[1] = self.bench.dial_sigma_rad.recip();
        self.marks += 1;
        Ok(Some(index))
    }

    fn mount_index(
        &mut self,
        series: Series,
        mount_deg: f64,
        estimate_rad: T,
    ) -> Result<usize, StaticTestError> {
        let number = T::from_i64(i64::from(u8::from(series)));
        let mount = T::lit(within_a_turn(mount_deg));
        let known = self
            .mount_keys
            .as_chunks::<MOUNT_KEY>()
            .0
            .iter()
            .take(self.mounts);
        if let Some(index) = known
            .into_iter()
            .position(|k| k[0] == number && k[1] == mount)
        {
            return Ok(index);
        }
        let index = self.mounts;
        if index == self.mount_capacity {
            return Err(StaticTestError::TooManyMounts {
                capacity: self.mount_capacity,
            });
        }
        let key = [number, mount, estimate_rad];
        self.mount_keys[index * MOUNT_KEY..(index + 1) * MOUNT_KEY].copy_from_slice(&key);
        self.mounts += 1;
        // The whole error has zero mean: what is left after the estimate has the mean -estimate.
        self.prior(index, -estimate_rad, self.bench.mount_sigma_rad);
        Ok(index)
    }

    /// Rotates the row (whose element at the mark is `at_mark`) into the mark's row; what is left has none of it.
    fn rotate_into_mark(&mut self, mark: usize, at_mark: T) {
        let width = MARK_HEAD + self.row.len();
        let kept = &mut self.mark_rows[mark * width + 1..(mark + 1) * width];
        let length = (kept[0] * kept[0] + at_mark * at_mark).sqrt();
        let (cos, sin) = (kept[0] / length, at_mark / length);
        kept[0] = length;
        for (r, x) in kept[1..].iter_mut().zip(self.row.iter_mut()) {
            let (old_r, old_x) = (*r, *x);
            *r = cos * old_r + sin * old_x;
            *x = cos * old_x - sin * old_r;
        }
    }
}

/// The cosine of a right angle is zero but for rounding, whose sign must not decide on which side of the kink of |a_I| the slope
/// is taken.
fn without_rounding<T: Real>(a: SpecificForce<T>) -> SpecificForce<T> {
    if a.i.abs() < T::lit(64.0) * T::epsilon() {
        SpecificForce { i: T::zero(), ..a }
    } else {
        a
    }
}

/// What readings tell of the coefficients, every other unknown eliminated.
#[derive(Clone, Debug)]
pub struct Information<T> {
    /// Upper triangle R, for which R x = `rhs` at the least squares; x is K1 times (1, k0, k1', ...), V/g.
    pub triangle: [[T; NOMINAL]; NOMINAL],
    /// Right-hand side.
    pub rhs: [T; NOMINAL],
    /// Sum of squared whitened residuals that no x removes.
    pub residual_squares: T,
    /// About K1, V/g.
    pub scale_v_per_g: T,
    /// Positions of the readings.
    pub design: Design<T>,
    /// Number of readings.
    pub readings: usize,
}

impl<T: Real> Information<T> {
    /// The coefficients; arguments and errors as those of [`StaticTest::solve_beside`].
    ///
    /// # Errors
    /// Those of [`StaticTest::solve`].
    pub fn solve_beside(
        &self,
        beforehand: &[T; NOMINAL],
        is_prior: bool,
    ) -> Result<Fit<T>, FactorError> {
        let mut beforehand = *beforehand;
        beforehand[0] = T::lit(BEFOREHAND[0]);
        let k1 = self.scale_v_per_g;
        let condition = self.design.visibility().condition;
        let visibility = Visibility::of_readings(&self.triangle, k1, &beforehand, condition);
        let mut factor = TriangularFactor::new(NOMINAL, [T::zero(); storage_len(NOMINAL)])?;
        let mut row = [T::zero(); NOMINAL + 1];
        for (r, z) in self.triangle.iter().zip(self.rhs) {
            row[..NOMINAL].copy_from_slice(r);
            row[NOMINAL] = z;
            factor.absorb(&mut row);
        }
        // Along blind directions what is known beforehand takes the place of readings. Where no reading at all sees one,
        // this changes nothing else: of all solutions it takes the one of least norm.
        let mut held = factor.clone();
        for direction in visibility.blind_directions() {
            let weight = direction
                .iter()
                .zip(&beforehand)
                .fold(T::zero(), |sum, (d, sigma)| sum + (*d / *sigma).powi(2));
            let weight = weight.sqrt() / k1;
            row[..NOMINAL].copy_from_slice(&direction.map(|d| d * weight));
            row[NOMINAL] = T::zero();
            held.absorb(&mut row);
        }
        let chi2 = self.residual_squares + held.residual_squares();
        // Everything is divided by K1: where the readings leave it to rounding there is no answer.
        let sees_scale = if is_prior {
            self.design.sees_input_axis()
        } else {
            visibility.determines(0)
        };
        if !sees_scale {
            return Err(FactorError::Undetermined { unknown: 0 });
        }
        if is_prior {
            for k in 1..NOMINAL {
                row.fill(T::zero());
                row[k] = (beforehand[k] * k1).recip();
                factor.absorb(&mut row);
            }
        } else {
            factor = held;
        }
        let mut x = [T::zero(); NOMINAL];
        factor.solve(0, &mut x)?;
        let covariance = inverse_square(&factor.trailing::<NOMINAL>().0);
        let (coefficients, mut covariance) = divide_by_scale_factor(&x, &covariance);
        if !is_prior {
            for direction in visibility.blind_directions() {
                leave_out(&mut covariance, direction);
            }
        }
        let doubtful = |k: &usize| {
            let known = is_prior || visibility.determines(*k);
            // NaN is no variance either.
            known && !(covariance[*k][*k] > T::zero() && covariance[*k][*k].is_finite())
        };
        if let Some(unknown) = (0..NOMINAL).find(doubtful) {
            return Err(FactorError::NoVariance { unknown });
        }
        Ok(Fit {
            coefficients,
            covariance,
            visibility,
            chi2,
            readings: self.readings,
        })
    }
}

/// Coefficients with all that is known of their uncertainty.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit<T> {
    /// The coefficients; of those that the plan does not determine the combination of least norm, unless a prior was
    /// given.
    pub coefficients: Coefficients<T>,
    /// Covariance in the order of [`Coefficients::to_nominal`]; without a prior zero along blind directions.
    pub covariance: [[T; NOMINAL]; NOMINAL],
    /// What the readings determine beside what was known beforehand.
    pub visibility: Visibility<T>,
    /// Sum of the squared whitened residuals, random effects included, with what was known beforehand along blind directions.
    pub chi2: T,
    /// Number of readings.
    pub readings: usize,
}

impl<T: Real> Fit<T> {
    /// Degrees of freedom: readings less the rank.
    pub fn degrees_of_freedom(&self) -> usize {
        self.readings.saturating_sub(self.visibility.rank)
    }
}

fn scaled<T: Real>(a: SpecificForce<T>, factor: T) -> SpecificForce<T> {
    SpecificForce::new(factor * a.i, factor * a.p, factor * a.o)
}

fn inner<T: Real>(x: SpecificForce<T>, y: SpecificForce<T>) -> T {
    x.i * y.i + x.p * y.p + x.o * y.o
}

/// From (K1, K1 k0, K1 k1', ...) to the coefficients, with the covariance.
fn divide_by_scale_factor<T: Real>(
    x: &[T; NOMINAL],
    covariance: &[[T; NOMINAL]; NOMINAL],
) -> (Coefficients<T>, [[T; NOMINAL]; NOMINAL]) {
    let k1 = x[0];
    let mut c = x.map(|x| x / k1);
    c[0] = k1;
    // d c_k = (d x_k - c_k d K1) / K1: rows first, then columns.
    let mut result = *covariance;
    for k in 1..NOMINAL {
        for j in 0..NOMINAL {
            result[k][j] = (covariance[k][j] - c[k] * covariance[0][j]) / k1;
        }
    }
    let rows = result;
    for row in 0..NOMINAL {
        for k in 1..NOMINAL {
            result[row][k] = (rows[row][k] - c[k] * rows[row][0]) / k1;
        }
    }
    (Coefficients::from_nominal(c), result)
}
