//! Types of the answers, with the names and units of `vre-identification/1`, `vre-prediction/1` and `vre-diagnosis/1`. Each has
//! a `reason` beside: why there is no answer, null where there is one.

use std::sync::Arc;

use arrow::datatypes::{DataType, Field, FieldRef};
use host::statics::NAMES;

use crate::cell::struct_type;

const TEXT: DataType = DataType::Utf8;
const NUMBER: DataType = DataType::Float64;
/// With a sign: Spark has no other integers.
const COUNT: DataType = DataType::Int64;

fn field(name: &str, data_type: DataType) -> FieldRef {
    Arc::new(Field::new(name, data_type, true))
}

fn of<const N: usize>(fields: [(&str, DataType); N]) -> DataType {
    struct_type(fields.map(|(name, data_type)| field(name, data_type)))
}

fn list(item: DataType) -> DataType {
    DataType::List(field("item", item))
}

/// A value with its standard uncertainty.
fn quantity() -> DataType {
    of([("value", NUMBER), ("sigma", NUMBER)])
}

/// One column a coefficient.
fn by_coefficient(item: &DataType) -> DataType {
    struct_type(NAMES.map(|name| field(name, item.clone())))
}

fn suspects() -> DataType {
    list(of([
        ("file", TEXT),
        ("row", COUNT),
        ("what", TEXT),
        ("number", COUNT),
        ("sigma_off", NUMBER),
        ("would_explain", TEXT),
        ("set_aside", DataType::Boolean),
    ]))
}

fn noise() -> DataType {
    list(of([
        ("of", TEXT),
        ("factor", quantity()),
        ("stated_holds", DataType::Boolean),
    ]))
}

/// `vre-identification/1`.
pub fn identification() -> DataType {
    of([
        ("format", TEXT),
        ("serial", TEXT),
        ("method", TEXT),
        ("coefficients", by_coefficient(&quantity())),
        ("covariance", list(list(NUMBER))),
        ("rank", COUNT),
        ("condition", NUMBER),
        ("blind_directions", list(by_coefficient(&NUMBER))),
        ("chi2", NUMBER),
        ("dof", COUNT),
        ("chi2_p_value", NUMBER),
        ("suspects", suspects()),
        ("noise", noise()),
        ("reason", TEXT),
    ])
}

/// `vre-prediction/1`.
pub fn prediction() -> DataType {
    of([
        ("format", TEXT),
        ("serial", TEXT),
        ("prior_sigma", NUMBER),
        ("static_chi2_p_value", NUMBER),
        (
            "runs",
            list(of([
                ("run", COUNT),
                ("vre_g", quantity()),
                ("refit_vre_g", quantity()),
                ("measured_vre_g", quantity()),
            ])),
        ),
        ("reason", TEXT),
    ])
}

/// `vre-diagnosis/1`: of it what a table asks for.
pub fn diagnosis() -> DataType {
    let gap = of([("rms_over_noise", NUMBER), ("p_value", NUMBER)]);
    let share = |name: &str| list(of([(name, TEXT), ("share", NUMBER)]));
    let conditions = of([
        ("factor", TEXT),
        ("low", NUMBER),
        ("high", NUMBER),
        ("share", NUMBER),
        ("runs", list(COUNT)),
        ("p_value", NUMBER),
    ]);
    let place = of([
        ("observables", share("name")),
        (
            "stages",
            list(of([("stage", TEXT), ("probability", NUMBER)])),
        ),
        ("conditions", list(conditions)),
    ]);
    let parameters = of([
        ("effect", TEXT),
        ("name", TEXT),
        ("value", NUMBER),
        ("sigma", NUMBER),
    ]);
    let which = of([
        ("effects", list(TEXT)),
        ("probability", NUMBER),
        ("parameters", list(parameters)),
        ("indistinguishable_from", list(TEXT)),
    ]);
    let shrink = of([
        ("held_out_rms_static_only_g", NUMBER),
        ("held_out_rms_refit_g", NUMBER),
        ("held_out_rms_with_effects_g", NUMBER),
        ("noise_floor_rms_g", NUMBER),
        ("closed_fraction", NUMBER),
    ]);
    let next = of([
        ("change", TEXT),
        ("separates", list(TEXT)),
        ("expected_bits", NUMBER),
    ]);
    of([
        ("format", TEXT),
        ("serial", TEXT),
        ("verdict", TEXT),
        ("gap", gap),
        ("where", place),
        ("which", list(which)),
        ("shrink", shrink),
        ("next_tests", list(next)),
        ("suspects", suspects()),
        ("noise", noise()),
        ("reason", TEXT),
    ])
}
