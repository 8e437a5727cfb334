//! HDF5 and MATLAB 7.3, by hdf5-pure: numeric arrays of all groups.

use std::path::Path;

use hdf5_pure::{DType, Dataset, File, Group};

use super::channels::{Array, Channels, Wanted, of_arrays};
use crate::error::Error;

/// Deepest group that is looked into.
const DEEPEST: usize = 16;

/// Most numbers of one array: 8 GB.
const LARGEST: u64 = 1 << 30;

/// Opens an HDF5 file. An array is named by its path, with points.
///
/// # Errors
/// Unreadable, damaged, or without a numeric array.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    // Whether it can be read at all is for the operating system to say.
    std::fs::File::open(file).map_err(Error::read(file))?;
    let damaged =
        |error: hdf5_pure::Error| Error::input(file, format!("is a damaged HDF5 file: {error}"));
    let source = File::open_streaming(file).map_err(damaged)?;
    let mut arrays = Vec::new();
    walk(&source.root(), "", 0, &mut arrays).map_err(damaged)?;
    let nothing = "holds no numeric array with more than one number; a table or timetable must be saved as arrays";
    Channels::whole(file, of_arrays(arrays), wanted, nothing)
}

fn walk(
    group: &Group,
    path: &str,
    depth: usize,
    arrays: &mut Vec<Array>,
) -> Result<(), hdf5_pure::Error> {
    let inner = |name: &str| match path {
        "" => name.to_owned(),
        path => format!("{path}.{name}"),
    };
    let mut names = group.datasets()?;
    names.sort();
    for name in names {
        arrays.extend(array(inner(&name), &group.dataset(&name)?)?);
    }
    let mut names = group.groups()?;
    names.sort();
    // MATLAB's own groups begin with a #.
    for name in names.iter().filter(|name| !name.starts_with('#')) {
        if depth < DEEPEST {
            walk(&group.group(name)?, &inner(name), depth + 1, arrays)?;
        }
    }
    Ok(())
}

/// A numeric array of up to two dimensions; `None` of any other.
fn array(name: String, set: &Dataset) -> Result<Option<Array>, hdf5_pure::Error> {
    let numeric = matches!(
        set.dtype()?,
        DType::F32
            | DType::F64
            | DType::I8
            | DType::I16
            | DType::I32
            | DType::I64
            | DType::U8
            | DType::U16
            | DType::U32
            | DType::U64
    );
    let shape = set.shape()?;
    let count = shape.iter().try_fold(1u64, |all, &n| all.checked_mul(n));
    let bounded = count.is_some_and(|count| count <= LARGEST);
    if !numeric || !bounded || shape.len() > 2 || is_text(set)? {
        return Ok(None);
    }
    // In HDF5 the last dimension runs fastest: its arrays are those of MATLAB, turned over.
    let size = match shape[..] {
        [columns, rows] => [rows as usize, columns as usize],
        [rows] => [rows as usize, 1],
        _ => [1, 1],
    };
    let values = set.read_f64()?;
    let whole = values.len() as u64 == count.unwrap_or(0);
    Ok(whole.then_some(Array { name, size, values }))
}

/// Text is stored as numbers, and says so; an empty array is stored as its size.
fn is_text(set: &Dataset) -> Result<bool, hdf5_pure::Error> {
    let attributes = set.attrs()?;
    let class = attributes
        .get("MATLAB_class")
        .and_then(|class| class.as_str());
    Ok(class == Some("char") || attributes.contains_key("MATLAB_empty"))
}
