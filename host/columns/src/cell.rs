//! Values of a row as Arrow columns: their types, and how they are read back.

use std::sync::Arc;

use arrow::array::{Array, AsArray, NullArray};
use arrow::compute::cast;
use arrow::datatypes::{
    ArrowPrimitiveType, DataType, Field, FieldRef, Fields, Float64Type, UInt64Type,
};

/// A value that stands in a column.
pub trait Cell: Sized {
    /// Whether it may be absent.
    const NULLABLE: bool = false;

    /// Type of its column.
    fn data_type() -> DataType;

    /// The value in a row.
    ///
    /// # Errors
    /// The column has another type, or nothing in it; said without its name.
    fn read(column: &dyn Array, row: usize) -> Result<Self, String>;

    /// Its column.
    fn field(name: &str) -> FieldRef {
        Arc::new(Field::new(name, Self::data_type(), Self::NULLABLE))
    }
}

fn there(column: &dyn Array, row: usize) -> Result<(), String> {
    if column.is_null(row) {
        return Err("is empty".into());
    }
    Ok(())
}

fn other_type(column: &dyn Array, wanted: &str) -> String {
    format!("is of type {}, not {wanted}", column.data_type())
}

/// A number; engines widen, narrow and sign their columns, so that another type is converted if no figure is lost by its kind.
fn number<T: ArrowPrimitiveType>(
    column: &dyn Array,
    row: usize,
    kind: fn(&DataType) -> bool,
) -> Result<T::Native, String> {
    there(column, row)?;
    if let Some(numbers) = column.as_primitive_opt::<T>() {
        return Ok(numbers.value(row));
    }
    let wanted = T::DATA_TYPE;
    if !kind(column.data_type()) {
        return Err(other_type(column, &wanted.to_string()));
    }
    let converted = cast(&column.slice(row, 1), &wanted).map_err(|error| error.to_string())?;
    there(&converted, 0).map_err(|_| format!("does not fit {wanted}"))?;
    Ok(converted.as_primitive::<T>().value(0))
}

fn is_whole(data_type: &DataType) -> bool {
    data_type.is_integer() || matches!(data_type, DataType::Decimal128(_, 0))
}

impl Cell for f64 {
    fn data_type() -> DataType {
        DataType::Float64
    }

    fn read(column: &dyn Array, row: usize) -> Result<Self, String> {
        let number = number::<Float64Type>(column, row, DataType::is_numeric)?;
        if number.is_finite() {
            Ok(number)
        } else {
            Err("is not a finite number".into())
        }
    }
}

impl Cell for u64 {
    fn data_type() -> DataType {
        DataType::UInt64
    }

    fn read(column: &dyn Array, row: usize) -> Result<Self, String> {
        number::<UInt64Type>(column, row, is_whole)
    }
}

impl Cell for bool {
    fn data_type() -> DataType {
        DataType::Boolean
    }

    fn read(column: &dyn Array, row: usize) -> Result<Self, String> {
        there(column, row)?;
        Ok(column
            .as_boolean_opt()
            .ok_or_else(|| other_type(column, "Boolean"))?
            .value(row))
    }
}

impl Cell for String {
    fn data_type() -> DataType {
        DataType::Utf8
    }

    fn read(column: &dyn Array, row: usize) -> Result<Self, String> {
        there(column, row)?;
        // Engines read text into any of three layouts.
        let text = match column.data_type() {
            DataType::Utf8 => column.as_string::<i32>().value(row),
            DataType::LargeUtf8 => column.as_string::<i64>().value(row),
            DataType::Utf8View => column.as_string_view().value(row),
            _ => return Err(other_type(column, "Utf8")),
        };
        Ok(text.into())
    }
}

impl<T: Cell> Cell for Option<T> {
    const NULLABLE: bool = true;

    fn data_type() -> DataType {
        T::data_type()
    }

    fn read(column: &dyn Array, row: usize) -> Result<Self, String> {
        // A column in which nothing is filled may be of the type of nothing.
        if column.data_type() == &DataType::Null || column.is_null(row) {
            return Ok(None);
        }
        T::read(column, row).map(Some)
    }
}

impl<T: Cell> Cell for Vec<T> {
    fn data_type() -> DataType {
        DataType::List(Arc::new(Field::new("item", T::data_type(), true)))
    }

    fn read(column: &dyn Array, row: usize) -> Result<Self, String> {
        there(column, row)?;
        let items = match column.data_type() {
            DataType::List(_) => column.as_list::<i32>().value(row),
            DataType::LargeList(_) => column.as_list::<i64>().value(row),
            _ => return Err(other_type(column, "List")),
        };
        let read =
            |item| T::read(&items, item).map_err(|problem| format!("row {}, {problem}", item + 1));
        (0..items.len()).map(read).collect()
    }
}

/// A column of a struct in a row.
///
/// # Errors
/// Not a struct, the column is missing and may not be, or what [`Cell::read`] says, with the column's name.
pub fn read_column<T: Cell>(of: &dyn Array, name: &str, row: usize) -> Result<T, String> {
    let columns = of.as_struct_opt().ok_or_else(|| other_type(of, "Struct"))?;
    let named = |problem| format!("column {name}: {problem}");
    match columns.column_by_name(name) {
        Some(column) => T::read(column, row).map_err(named),
        // An optional column need not be there.
        None if T::NULLABLE => T::read(&NullArray::new(1), 0).map_err(named),
        None => Err(named("is missing".into())),
    }
}

/// The columns of a struct.
pub fn struct_type(fields: impl IntoIterator<Item = FieldRef>) -> DataType {
    DataType::Struct(fields.into_iter().collect::<Fields>())
}

/// A struct each of whose fields is a column, found by its name in any order.
#[macro_export]
macro_rules! row {
    ($(#[$about:meta])* pub struct $name:ident { $($(#[$doc:meta])* $field:ident: $kind:ty,)* }) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        pub struct $name { $($(#[$doc])* pub $field: $kind,)* }

        impl $crate::cell::Cell for $name {
            fn data_type() -> $crate::arrow::datatypes::DataType {
                $crate::cell::struct_type([$(<$kind as $crate::cell::Cell>::field(stringify!($field)),)*])
            }

            fn read(of: &dyn $crate::arrow::array::Array, row: usize) -> Result<Self, String> {
                if of.is_null(row) {
                    return Err("is empty".into());
                }
                Ok(Self { $($field: $crate::cell::read_column(of, stringify!($field), row)?,)* })
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use arrow::array::{Decimal128Array, Float32Array, Int32Array, Int64Array, StringArray};

    use super::*;

    #[test]
    fn numbers_of_any_width_are_read_and_none_is_bent() {
        let wide = Int64Array::from(vec![3, -1]);
        assert_eq!(f64::read(&wide, 1), Ok(-1.0));
        assert_eq!(u64::read(&wide, 0), Ok(3));
        assert!(u64::read(&wide, 1).unwrap_err().contains("does not fit"));
        let decimal = Decimal128Array::from(vec![7]).with_precision_and_scale(20, 0);
        assert_eq!(u64::read(&decimal.unwrap(), 0), Ok(7));
        assert_eq!(f64::read(&Float32Array::from(vec![0.5]), 0), Ok(0.5));
        assert_eq!(u64::read(&Int32Array::from(vec![9]), 0), Ok(9));
        let broken = Float32Array::from(vec![2.5, f32::NAN]);
        assert!(u64::read(&broken, 0).unwrap_err().contains("Float32"));
        assert!(f64::read(&broken, 1).is_err());
        assert!(f64::read(&StringArray::from(vec!["3"]), 0).is_err());
    }

    #[test]
    fn an_optional_column_may_be_of_the_type_of_nothing() {
        assert_eq!(Option::<f64>::read(&NullArray::new(2), 1), Ok(None));
        assert!(f64::read(&NullArray::new(2), 1).is_err());
    }
}
