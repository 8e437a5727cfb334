//! The native half of the Python package `vre`.
//!
//! ```text
//! folder, dict, Arrow -> campaigns (what is asked of one or many) -> JSON text, Arrow
//! file, dict, Arrow   -> measuring                                -> JSON text
//! ```
//!
//! Everything is computed without the interpreter's lock. The Python half makes dicts of JSON text.

mod campaigns;
mod dicts;
mod failure;
mod measuring;
mod simulating;
mod threads;

use pyo3::prelude::*;

/// The native half of `vre`.
#[pymodule]
fn _vre(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(campaigns::of_folder, module)?)?;
    module.add_function(wrap_pyfunction!(campaigns::of_dict, module)?)?;
    module.add_function(wrap_pyfunction!(campaigns::of_arrow, module)?)?;
    module.add_function(wrap_pyfunction!(campaigns::answer_field, module)?)?;
    module.add_function(wrap_pyfunction!(campaigns::read, module)?)?;
    module.add_function(wrap_pyfunction!(campaigns::folders_to_arrow, module)?)?;
    module.add_function(wrap_pyfunction!(campaigns::dicts_to_arrow, module)?)?;
    module.add_function(wrap_pyfunction!(measuring::of_file, module)?)?;
    module.add_function(wrap_pyfunction!(measuring::of_columns, module)?)?;
    module.add_function(wrap_pyfunction!(measuring::of_batches, module)?)?;
    module.add_function(wrap_pyfunction!(simulating::to_folder, module)?)?;
    module.add_function(wrap_pyfunction!(simulating::to_dict, module)?)?;
    module.add_function(wrap_pyfunction!(simulating::to_arrow, module)?)?;
    Ok(())
}
