//! The number type: everything in this crate is generic over [`Real`], implemented for `f32` and `f64`.
//!
//! `f32` is good enough for what is a small correction of a large number (vibration error from known
//! coefficients, moments of a block about a nearby origin); `f64` is needed where coefficients of
//! 1e-7 g are told apart from readings of 1 g (identification). Each module says which it needs and a
//! test proves it.

use num_traits::{Float, FloatConst, NumAssign};

/// A binary floating-point number, `f32` or `f64`.
pub trait Real:
    Float + FloatConst + NumAssign + Default + core::fmt::Debug + Send + Sync + 'static
{
    /// The nearest number to an `f64` literal.
    fn lit(value: f64) -> Self;

    /// The number from an integer, rounded to nearest.
    fn from_i64(value: i64) -> Self;

    /// Widened to `f64`, exact.
    fn to_f64(self) -> f64;

    /// Complementary error function, (2/sqrt pi) times the integral of exp(-t^2) from `self` to infinity.
    fn erfc(self) -> Self;
}

impl Real for f32 {
    #[inline]
    fn lit(value: f64) -> Self {
        value as f32
    }
    #[inline]
    fn from_i64(value: i64) -> Self {
        value as f32
    }
    #[inline]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline]
    fn erfc(self) -> Self {
        libm::erfcf(self)
    }
}

impl Real for f64 {
    #[inline]
    fn lit(value: f64) -> Self {
        value
    }
    #[inline]
    fn from_i64(value: i64) -> Self {
        value as f64
    }
    #[inline]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline]
    fn erfc(self) -> Self {
        libm::erfc(self)
    }
}
