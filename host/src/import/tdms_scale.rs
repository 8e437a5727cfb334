//! Scales that a TDMS file states for a channel: linear and polynomial ones, one after the other.

use std::collections::HashMap;

use super::tdms::{Fault, Property};

/// Coefficients of polynomials, the constant first, in the order in which they are applied.
pub(super) struct Scaling(Vec<Vec<f64>>);

/// Most scales, and most coefficients of one.
const MOST: usize = 64;

impl Scaling {
    /// As the properties `NI_Scale[n]_...` tell; none where the samples are scaled already.
    ///
    /// # Errors
    /// A scale of another kind than linear or polynomial.
    pub(super) fn of(properties: &HashMap<String, Property>) -> Result<Self, Fault> {
        let number = |key: &str| match properties.get(key) {
            Some(Property::Number(number)) => Some(*number),
            _ => None,
        };
        let status = match properties.get("NI_Scaling_Status") {
            Some(Property::Text(status)) => status.as_str(),
            _ => "unscaled",
        };
        let count = number("NI_Number_Of_Scales").unwrap_or(0.0) as usize;
        if status == "scaled" {
            return Ok(Self(Vec::new()));
        }
        let scale = |index: usize| {
            let key = |what: &str| format!("NI_Scale[{index}]_{what}");
            let kind = match properties.get(&key("Scale_Type")) {
                Some(Property::Text(kind)) => kind.as_str(),
                _ => "nothing",
            };
            let all = match kind {
                "Linear" => ["Linear_Y_Intercept", "Linear_Slope"]
                    .iter()
                    .map(|what| number(&key(what)))
                    .collect(),
                "Polynomial" => {
                    let size = number(&key("Polynomial_Coefficients_Size")).unwrap_or(4.0);
                    let coefficient =
                        |n: usize| number(&key(&format!("Polynomial_Coefficients[{n}]")));
                    (0..(size as usize).min(MOST)).map(coefficient).collect()
                }
                _ => None,
            };
            all.ok_or_else(|| Fault::Scale(kind.into()))
        };
        let scales = (0..count.min(MOST)).map(scale);
        scales.collect::<Result<_, _>>().map(Self)
    }

    /// Scales raw samples.
    pub(super) fn apply(&self, values: &mut [f64]) {
        for polynomial in &self.0 {
            for value in values.iter_mut() {
                let x = *value;
                *value = polynomial.iter().rev().fold(0.0, |sum, c| sum * x + c);
            }
        }
    }
}
