//! MAT files of level 5, which MATLAB, Octave and scipy write: numeric arrays, also within structures and cells.

use std::io::Read;
use std::path::Path;

use super::channels::{Array, Channels, MAX_BYTES, Wanted, of_arrays};
use super::cursor::{Cursor, Cut, Endian};
use crate::error::Error;
use crate::input::read_at_most;

/// Deepest structure within structures.
const DEEPEST: usize = 16;

/// Bytes of the header: text, an offset, a version, and the mark of the byte order.
const HEADER: usize = 128;

const COMPRESSED: u32 = 15;
const MATRIX: u32 = 14;

/// Opens a MAT file.
///
/// # Errors
/// Unreadable, cut off, or without a numeric array.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let bytes = read_at_most(file, MAX_BYTES)?;
    let order = match bytes.get(HEADER - 2..HEADER) {
        Some(b"IM") => Endian::Little,
        Some(b"MI") => Endian::Big,
        _ => {
            return Err(Error::input(
                file,
                "is a damaged MAT file: its header is cut off",
            ));
        }
    };
    let mut arrays = Vec::new();
    let mut cursor = Cursor::new(&bytes, order);
    cursor.skip(HEADER);
    while !cursor.is_empty() {
        let at = cursor.position();
        let read = element(&mut cursor).and_then(|element| variable(element, order, &mut arrays));
        read.map_err(|Cut| {
            let problem =
                format!("is a damaged MAT file: the array at byte {at} is cut off or not sound");
            Error::input(file, problem)
        })?;
    }
    let nothing = "holds no numeric array with more than one number; a table or timetable must be saved as arrays";
    Channels::whole(file, of_arrays(arrays), wanted, nothing)
}

/// A data element: its type and content.
struct Element<'a> {
    kind: u32,
    content: &'a [u8],
}

fn element<'a>(cursor: &mut Cursor<'a>) -> Result<Element<'a>, Cut> {
    let word = cursor.u32()?;
    // A small element has its size in the upper half of the word, and its content in the next four bytes.
    if word >> 16 != 0 {
        let content = cursor.bytes(4)?;
        let content = content.get(..(word >> 16) as usize).ok_or(Cut)?;
        return Ok(Element {
            kind: word & 0xffff,
            content,
        });
    }
    let size = cursor.u32()? as usize;
    let content = cursor.bytes(size)?;
    if word != COMPRESSED {
        cursor.skip(size.wrapping_neg() % 8);
    }
    Ok(Element {
        kind: word,
        content,
    })
}

/// The arrays of a variable.
fn variable(element_: Element<'_>, order: Endian, arrays: &mut Vec<Array>) -> Result<(), Cut> {
    match element_.kind {
        MATRIX => matrix(element_.content, order, None, 0, arrays),
        COMPRESSED => {
            let mut plain = Vec::new();
            let inflated = flate2::read::ZlibDecoder::new(element_.content);
            let read = inflated.take(MAX_BYTES).read_to_end(&mut plain);
            read.map_err(|_| Cut)?;
            let inner = element(&mut Cursor::new(&plain, order))?;
            match inner.kind {
                MATRIX => matrix(inner.content, order, None, 0, arrays),
                _ => Ok(()),
            }
        }
        _ => Ok(()),
    }
}

/// The arrays of a matrix of any class; within a structure or a cell, `name` is its place there.
fn matrix(
    content: &[u8],
    order: Endian,
    name: Option<&str>,
    depth: usize,
    arrays: &mut Vec<Array>,
) -> Result<(), Cut> {
    if content.is_empty() {
        return Ok(()); // An empty cell or field.
    }
    let mut cursor = Cursor::new(content, order);
    let class = Cursor::new(element(&mut cursor)?.content, order).u32()? & 0xff;
    if class == 17 {
        return Ok(()); // An object that only MATLAB understands.
    }
    let dimensions = numbers(&element(&mut cursor)?, order)?;
    let own = element(&mut cursor)?;
    let own = String::from_utf8_lossy(own.content);
    let name = name.unwrap_or(&own);
    match class {
        1 if depth < DEEPEST => {
            let mut number = 0;
            while !cursor.is_empty() {
                number += 1;
                let name = format!("{name}.{number}");
                matrix(
                    element(&mut cursor)?.content,
                    order,
                    Some(&name),
                    depth + 1,
                    arrays,
                )?;
            }
            Ok(())
        }
        2 if depth < DEEPEST => structure(cursor, order, name, depth, arrays),
        6..=15 => {
            let values = numbers(&element(&mut cursor)?, order)?;
            let rows = dimensions.first().map_or(1, |rows| *rows as usize);
            if rows == 0 || values.is_empty() {
                return Ok(());
            }
            arrays.push(Array {
                name: name.into(),
                size: [rows, values.len() / rows],
                values,
            });
            Ok(())
        }
        _ => Ok(()), // Text, sparse matrices, objects.
    }
}

/// Fields of a structure, or of an array of structures.
fn structure(
    mut cursor: Cursor<'_>,
    order: Endian,
    name: &str,
    depth: usize,
    arrays: &mut Vec<Array>,
) -> Result<(), Cut> {
    let length = Cursor::new(element(&mut cursor)?.content, order).u32()? as usize;
    let fields: Vec<String> = match length {
        0 => return Err(Cut),
        _ => element(&mut cursor)?
            .content
            .chunks(length)
            .map(text)
            .collect(),
    };
    let mut number = 0;
    while !cursor.is_empty() && !fields.is_empty() {
        number += 1;
        for field in &fields {
            let path = match number {
                1 => format!("{name}.{field}"),
                _ => format!("{name}.{number}.{field}"),
            };
            matrix(
                element(&mut cursor)?.content,
                order,
                Some(&path),
                depth + 1,
                arrays,
            )?;
        }
    }
    Ok(())
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0);
    String::from_utf8_lossy(&bytes[..end.unwrap_or(bytes.len())]).into_owned()
}

/// Numbers of whatever type they are stored in.
fn numbers(element: &Element<'_>, order: Endian) -> Result<Vec<f64>, Cut> {
    let cursor = Cursor::new(element.content, order);
    match element.kind {
        1 => cursor.all(Cursor::i8),
        2 => cursor.all(Cursor::u8),
        3 => cursor.all(Cursor::i16),
        4 => cursor.all(Cursor::u16),
        5 => cursor.all(Cursor::i32),
        6 => cursor.all(|c| c.u32().map(f64::from)),
        7 => cursor.all(Cursor::f32),
        9 => cursor.all(Cursor::f64),
        12 => cursor.all(Cursor::i64),
        13 => cursor.all(|c| c.u64().map(|n| n as f64)),
        _ => Err(Cut),
    }
}
