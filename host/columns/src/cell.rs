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
