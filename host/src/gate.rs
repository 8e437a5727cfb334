//! The gate at the exit: every number of a result is finite and can be, or nothing leaves.
//!
//! What a name promises holds: a probability or a share is 0 to 1, an uncertainty is not negative, a covariance is symmetric and
//! bounds its own entries. The other end is [`crate::campaign::ranges`].

use std::fmt::Write as _;

use ciborium::Value;
use serde::Serialize;

use crate::error::Error;

/// What rounding may add to the end of a range.
const ROUNDING: f64 = 1e-9;

/// Greatest magnitude of any number. Chosen: what lies within the ranges at the door makes none that is nearly as large.
const GREATEST: f64 = 1e30;

/// What the numbers under a name can be.
struct Promise {
    /// Whether it is of this name.
    of: fn(&str) -> bool,
    least: f64,
    greatest: f64,
}

/// The first that fits a name holds.
const PROMISES: [Promise; 4] = [
    Promise {
        of: |name| {
            let whole = ["probability", "probability_kept", "share", "p_value"];
            whole.contains(&name)
                || name.ends_with("_p_value")
                || name.starts_with("closed_fraction")
        },
        least: 0.0,
        greatest: 1.0 + ROUNDING,
    },
    Promise {
        of: |name| name == "correlation",
        least: -1.0 - ROUNDING,
        greatest: 1.0 + ROUNDING,
    },
    Promise {
        // Infinite within rounding, it is the greatest double.
        of: |name| name == "condition",
        least: 1.0 - ROUNDING,
        greatest: f64::MAX,
    },
    Promise {
        of: |name| {
            let part = |part: &str| name.split('_').any(|word| word == part);
            // A distance in standard deviations has a sign.
            (part("sigma") && name != "sigma_off") || part("rms") || name == "chi2"
        },
        least: 0.0,
        greatest: GREATEST,
    },
];

/// The first number of `result` that cannot be, if there is one.
///
/// # Errors
/// [`Error::Absurd`] names it.
pub fn check(result: &impl Serialize) -> Result<(), Error> {
    // A tree that keeps what is not finite; JSON would make null of it.
    let tree = Value::serialized(result)
        .map_err(|error| Error::Usage(format!("a result cannot be written: {error}")))?;
    let mut path = String::new();
    visit(&tree, "", &mut path)
}

/// Looks at all below a field; `name` is that of the nearest field that has one.
fn visit(tree: &Value, name: &str, path: &mut String) -> Result<(), Error> {
    let end = path.len();
    match tree {
        Value::Float(value) => number(*value, name, path)?,
        Value::Array(list) => {
            for (index, item) in list.iter().enumerate() {
                let _ = write!(path, "[{index}]");
                visit(item, name, path)?;
                path.truncate(end);
            }
            if name == "covariance" {
                covariance(list, path)?;
            }
        }
        Value::Map(fields) => {
            for (key, value) in fields {
                let key = key.as_text().unwrap_or(name);
                let _ = write!(path, "{}{key}", if end == 0 { "" } else { "." });
                visit(value, key, path)?;
                path.truncate(end);
            }
        }
        Value::Tag(_, inner) => visit(inner, name, path)?,
        _ => {}
    }
    Ok(())
}

fn number(value: f64, name: &str, path: &str) -> Result<(), Error> {
    let promise = PROMISES.iter().find(|promise| (promise.of)(name));
    let (least, greatest) = promise.map_or((-GREATEST, GREATEST), |p| (p.least, p.greatest));
    match (least..=greatest).contains(&value) {
        true => Ok(()),
        false => Err(Error::Absurd {
            field: path.into(),
            value,
        }),
    }
}

/// Rows of a covariance: each entry is its own mirror image, and within what the two variances allow (Cauchy, Schwarz).
fn covariance(rows: &[Value], path: &str) -> Result<(), Error> {
    let entry = |i: usize, j: usize| rows.get(i)?.as_array()?.get(j)?.as_float();
    for i in 0..rows.len() {
        for j in 0..=i {
            let (Some(value), Some(mirror)) = (entry(i, j), entry(j, i)) else {
                continue;
            };
            let (Some(a), Some(b)) = (entry(i, i), entry(j, j)) else {
                continue;
            };
            let most = (a * b).sqrt();
            let slack = ROUNDING * most;
            // A variance that is negative makes no root: nothing is within it.
            let within = a >= 0.0 && value.abs() <= most + slack && (value - mirror).abs() <= slack;
            if !within {
                let field = format!("{path}[{i}][{j}]");
                return Err(Error::Absurd { field, value });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// The field that is told of a result.
    fn told(result: &impl Serialize) -> Option<String> {
        match check(result) {
            Err(Error::Absurd { field, .. }) => Some(field),
            _ => None,
        }
    }

    #[derive(Serialize)]
    struct Answer {
        which: Vec<Which>,
    }

    #[derive(Serialize)]
    struct Which {
        probability: f64,
        chi2: Option<f64>,
    }

    #[test]
    fn what_is_no_number_is_told_by_its_path() {
        for bad in [f64::NAN, f64::INFINITY, -0.1, 1.1, 1e160] {
            let fine = |probability| Which {
                probability,
                chi2: None,
            };
            let which = vec![fine(1.0), fine(bad)];
            assert_eq!(told(&Answer { which }).unwrap(), "which[1].probability");
        }
        let which = vec![Which {
            probability: 0.5,
            chi2: Some(f64::NAN),
        }];
        let line = check(&Answer { which }).unwrap_err();
        assert_eq!(line.exit_status(), 1);
        assert!(
            line.to_string().contains("which[0].chi2 came to NaN"),
            "{line}"
        );
    }

    #[test]
    fn a_name_keeps_its_promise() {
        for (result, field) in [
            (
                json!({"k0_g": {"value": 1.0, "sigma": -1e-9}}),
                "k0_g.sigma",
            ),
            (
                json!({"held_out_rms_refit_g": -1.0}),
                "held_out_rms_refit_g",
            ),
            (
                json!({"closed_fraction_interval_90": [-0.004, 1.0]}),
                "closed_fraction_interval_90[0]",
            ),
            (json!({"correlation": [[1.0, 1e155]]}), "correlation[0][1]"),
            (
                json!({"covariance": [[1.0, 0.5], [0.4, 1.0]]}),
                "covariance[1][0]",
            ),
            (
                json!({"covariance": [[1.0, 1.5], [1.5, 1.0]]}),
                "covariance[1][0]",
            ),
            (
                json!({"covariance": [[-1.0, 0.0], [0.0, 1.0]]}),
                "covariance[0][0]",
            ),
        ] {
            assert_eq!(told(&result).as_deref(), Some(field), "{result}");
        }
        let sound = json!({
            "condition": f64::MAX, "vre_g": -3e-5, "p_value": 0.0, "correlation": [[1.0, -1.0]],
            "covariance": [[0.0, 0.0], [0.0, 2.0]], "sigma": null,
        });
        assert_eq!(told(&sound), None);
    }
}
