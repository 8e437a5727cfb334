//! What goes wrong becomes an exception of one line; work runs without the interpreter's lock, and a panic stays on this side.

use std::panic::{AssertUnwindSafe, catch_unwind};

use columns::functions::guarded;
use host::campaign::ranges::Range;
use host::error::{Error, Place, printable};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use crate::threads;

pyo3::import_exception!(vre, InputError);

/// Carries out work without the interpreter's lock.
pub fn detached<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> PyResult<T> {
    let done = py.detach(|| threads::own()?.install(|| guarded(work)));
    done.map_err(|error| raised(&error))
}

/// Arrow from the other side. The crate's reader of it can panic, which must not cross the border either.
pub fn imported<'a, 'py, T>(data: &'a Bound<'py, PyAny>) -> PyResult<T>
where
    T: FromPyObject<'a, 'py, Error = PyErr>,
{
    let read = catch_unwind(AssertUnwindSafe(|| data.extract::<T>()));
    let problem = "the Arrow data cannot be read: a slice of structs within structs, or a fault";
    read.unwrap_or_else(|_| Err(raised(&usage(problem))))
}

/// Bad input of no place.
pub fn usage(problem: impl std::fmt::Display) -> Error {
    Error::Usage(problem.to_string())
}

/// The exception: `vre.InputError` with file, row and column for bad input, `OSError` for what the system refuses.
pub fn raised(error: &Error) -> PyErr {
    let line = printable(&error.to_string());
    let place = match error {
        Error::Input { place, .. } => place.clone(),
        Error::Read { file, .. } => Place::file(file),
        Error::Write { .. } => return PyOSError::new_err(line),
        _ => return InputError::new_err((line, None::<String>, None::<u64>, None::<String>)),
    };
    let file = place.file.display().to_string();
    InputError::new_err((line, Some(file), place.row, place.column))
}

/// A number within its range, as the command line holds it.
pub fn within(range: &'static Range, name: &str, value: f64) -> Result<f64, Error> {
    let told = |problem| usage(format!("{name}: {problem}"));
    range.check(value).map_err(told)
}
