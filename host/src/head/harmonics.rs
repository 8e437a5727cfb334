//! The error map of a head as harmonics of the angle, and which of them a batch is blind to.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use shared::tumble::ARCSEC_RAD;

use super::batch::TYPE;
use super::posterior::Posterior;
use crate::quantity::Quantity;

/// Highest harmonic that is told.
const HIGHEST: usize = 4;

/// Ratio of the standard uncertainty after the batch to that before it from which on a harmonic is blind: the readings narrow it
/// by less than 5 %, as little as a direction of the coefficients that is called blind.
const BLIND: f64 = 0.95;

/// One harmonic of the marks' errors: a cos + b sin of the order times the dial's angle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Harmonic {
    /// Its order; 0 is the dial's zero, which no instrument needs.
    pub order: usize,
    /// Cosine part, arcsec.
    pub cos_arcsec: Quantity,
    /// Sine part, arcsec; absent at order 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sin_arcsec: Option<Quantity>,
    /// Whether the batch leaves one of them as uncertain as it was.
    pub blind: bool,
}

/// The harmonics that the marks of a head can hold, by least squares over the marks.
pub fn harmonics(posterior: &Posterior) -> Vec<Harmonic> {
    let marks = posterior.marks_deg.len();
    let highest = HIGHEST.min(marks.saturating_sub(1) / 2);
    let parts = 1 + 2 * highest;
    let design = DMatrix::from_fn(marks, parts, |mark, part| {
        let angle = posterior.marks_deg[mark].to_radians() * part.div_ceil(2) as f64;
        if part % 2 == 1 {
            angle.cos()
        } else if part == 0 {
            1.0
        } else {
            angle.sin()
        }
    });
    let Some(inverse) = design.tr_mul(&design).try_inverse() else {
        return Vec::new();
    };
    let projection = inverse * design.transpose() / ARCSEC_RAD;
    let errors = DVector::from_fn(marks, |mark, _| posterior.mean[TYPE + mark]);
    let of_marks = posterior.covariance.view((TYPE, TYPE), (marks, marks));
    let after = (&projection * of_marks * projection.transpose())
        .diagonal()
        .map(f64::sqrt);
    let before = (&projection * projection.transpose())
        .diagonal()
        .map(f64::sqrt)
        * posterior.dial_sigma_rad;
    let values = &projection * errors;
    let quantity = |part: usize| Quantity::new(values[part], after[part]);
    let blind = |part: usize| after[part] > BLIND * before[part];
    let harmonic = |order: usize| match order {
        0 => Harmonic {
            order,
            cos_arcsec: quantity(0),
            sin_arcsec: None,
            blind: blind(0),
        },
        _ => Harmonic {
            order,
            cos_arcsec: quantity(2 * order - 1),
            sin_arcsec: Some(quantity(2 * order)),
            blind: blind(2 * order - 1) || blind(2 * order),
        },
    };
    (0..=highest).map(harmonic).collect()
}

/// What to do about a blind first harmonic.
pub const ADVICE: &str = "the first harmonic of the head is blind: all instruments were mounted alike, and it looks like the type's mean k2. \
     Mount every other instrument turned by 180 deg on the shaft, or remount or shake one.";

/// The advice, if the first harmonic is blind.
pub fn advice(harmonics: &[Harmonic]) -> Option<&'static str> {
    let first = harmonics.iter().find(|harmonic| harmonic.order == 1)?;
    first.blind.then_some(ADVICE)
}
