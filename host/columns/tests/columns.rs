//! Columns as engines hand them over, and functions that fail.

use arrow::array::{Decimal128Array, Float32Array, Int32Array, Int64Array, NullArray, StringArray};
use columns::cell::Cell;
use columns::functions::guarded;

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

#[test]
fn a_panic_becomes_an_error_of_one_line() {
    let told = guarded::<()>(|| panic!("index out of bounds"));
    let told = told.unwrap_err().to_string();
    assert!(told.starts_with("a fault of the program"), "{told}");
}
