//! Messages of ROS, read by the text of their definitions: serialised by CDR (ROS 2; OMG, "Common Data Representation") or as
//! ROS 1 does.

use std::collections::HashMap;

use super::cursor::{Cursor, Cut, Endian};

/// Deepest message within messages.
const DEEPEST: usize = 16;

/// Most elements of an array that become numbers of their own.
const LIST: usize = 16;

/// Why a message cannot be read.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Bad {
    /// It is shorter than its definition says.
    Cut,
    /// It is written in a way that is not known.
    Encoding(String),
}

impl From<Cut> for Bad {
    fn from(Cut: Cut) -> Self {
        Self::Cut
    }
}

/// How numbers are put into bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layer {
    /// Aligned, after four bytes that tell the order.
    Cdr,
    /// One after the other, little endian.
    Ros1,
}

/// How many of a field there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Many {
    One,
    Fixed(usize),
    Counted,
}

/// A field of a message.
#[derive(Clone, Debug, PartialEq)]
struct Field {
    kind: String,
    name: String,
    many: Many,
}

/// The definitions of a message and of those within it.
#[derive(Clone, Debug)]
pub(super) struct Definitions {
    root: String,
    messages: HashMap<String, Vec<Field>>,
    layer: Layer,
}

/// A message within a message.
#[derive(Clone, Copy)]
struct Place<'a> {
    /// Its type.
    name: &'a str,
    /// Its path.
    path: &'a str,
    depth: usize,
    /// Whether its numbers are handed over.
    kept: bool,
}

/// Name of a message without the folder that ROS 2 puts into it: `sensor_msgs/Imu`.
fn short(name: &str) -> String {
    name.replace("/msg/", "/")
}

impl Definitions {
    /// Of the text of a definition, the others following it behind lines of `=` and `MSG: name`.
    pub(super) fn parse(name: &str, text: &str, layer: Layer) -> Self {
        let root = short(name);
        let mut messages: HashMap<String, Vec<Field>> = HashMap::new();
        let mut current = root.clone();
        messages.insert(current.clone(), Vec::new());
        for line in text.lines() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if let Some(name) = line.strip_prefix("MSG:") {
                current = short(name.trim());
                messages.insert(current.clone(), Vec::new());
            } else if let (Some(field), Some(list)) = (field(line), messages.get_mut(&current)) {
                list.push(field);
            }
        }
        Self {
            root,
            messages,
            layer,
        }
    }

    /// Hands every number of a message over, with its path.
    ///
    /// # Errors
    /// The bytes end before the message does, or a type has no definition.
    pub(super) fn read(&self, data: &[u8], keep: &mut dyn FnMut(&str, f64)) -> Result<(), Bad> {
        let mut bytes = match self.layer {
            Layer::Ros1 => Bytes {
                cursor: Cursor::new(data, Endian::Little),
                aligned: false,
            },
            Layer::Cdr => {
                let (head, content) = data.split_at_checked(4).ok_or(Bad::Cut)?;
                let order = if head[1] & 1 == 1 {
                    Endian::Little
                } else {
                    Endian::Big
                };
                Bytes {
                    cursor: Cursor::new(content, order),
                    aligned: true,
                }
            }
        };
        self.message(
            &mut bytes,
            Place {
                name: &self.root,
                path: "",
                depth: 0,
                kept: true,
            },
            keep,
        )
    }

    fn message(
        &self,
        bytes: &mut Bytes<'_>,
        at: Place<'_>,
        keep: &mut dyn FnMut(&str, f64),
    ) -> Result<(), Bad> {
        let unknown = || Bad::Encoding(format!("its schema does not define {}", at.name));
        let package = at.name.split('/').next().unwrap_or_default();
        for field in self.messages.get(at.name).ok_or_else(unknown)? {
            let inner = match at.path {
                "" => field.name.clone(),
                path => format!("{path}.{}", field.name),
            };
            let count = match field.many {
                Many::One => 1,
                Many::Fixed(count) => count,
                Many::Counted => bytes.count()?,
            };
            if count > bytes.cursor.left() {
                return Err(Bad::Cut); // Every element takes a byte at least.
            }
            // Lists of changing length are no channels.
            let kept = at.kept && field.many != Many::Counted && count <= LIST;
            for number in 0..count {
                let path = match field.many {
                    Many::One => inner.clone(),
                    _ => format!("{inner}.{number}"),
                };
                let mut keep_part = |part: &str, value: f64| {
                    if kept {
                        keep(&format!("{path}{part}"), value);
                    }
                };
                if matches!(field.kind.as_str(), "time" | "duration") {
                    keep_part(".secs", f64::from(bytes.cursor.u32()?));
                    keep_part(".nsecs", f64::from(bytes.cursor.u32()?));
                } else if let Some(value) = bytes.primitive(&field.kind)? {
                    value.into_iter().for_each(|value| keep_part("", value));
                } else if at.depth >= DEEPEST {
                    return Err(Bad::Cut);
                } else {
                    let place = Place {
                        name: &self.resolve(&field.kind, package),
                        path: &path,
                        depth: at.depth + 1,
                        kept,
                    };
                    self.message(bytes, place, keep)?;
                }
            }
        }
        Ok(())
    }

    /// The full name of a type: of the same package, or ROS 1's header.
    fn resolve(&self, kind: &str, package: &str) -> String {
        let kind = short(kind);
        match kind.as_str() {
            _ if kind.contains('/') => kind,
            "Header" => "std_msgs/Header".into(),
            _ => format!("{package}/{kind}"),
        }
    }
}

/// A field of a line `type name`; none of a constant, of a line of `=`, or of an empty line.
fn field(line: &str) -> Option<Field> {
    let (kind, rest) = line.split_once(char::is_whitespace)?;
    let rest = rest.trim();
    let name = rest.split([' ', '\t', '=']).next()?;
    let constant = rest[name.len()..].trim_start().starts_with('=');
    if constant || name.is_empty() {
        return None;
    }
    let (kind, many) = match kind.split_once('[') {
        None => (kind, Many::One),
        Some((kind, size)) => match size.trim_end_matches(']').parse() {
            Ok(count) => (kind, Many::Fixed(count)),
            Err(_) => (kind, Many::Counted),
        },
    };
    Some(Field {
        kind: kind.split("<=").next()?.into(),
        name: name.into(),
        many,
    })
}

/// The bytes of a message.
struct Bytes<'a> {
    cursor: Cursor<'a>,
    aligned: bool,
}

impl Bytes<'_> {
    fn align(&mut self, size: usize) {
        if self.aligned {
            self.cursor
                .skip(self.cursor.position().wrapping_neg() % size);
        }
    }

    fn count(&mut self) -> Result<usize, Cut> {
        self.align(4);
        Ok(self.cursor.u32()? as usize)
    }

    /// Of a type that is no message: its number, or none of text. `None` of a message.
    fn primitive(&mut self, kind: &str) -> Result<Option<Option<f64>>, Cut> {
        let size = match kind {
            "bool" | "byte" | "char" | "int8" | "uint8" => 1,
            "int16" | "uint16" => 2,
            "int32" | "uint32" | "float32" | "string" | "wstring" => 4,
            "int64" | "uint64" | "float64" => 8,
            _ => return Ok(None),
        };
        self.align(size);
        let cursor = &mut self.cursor;
        let value = match kind {
            "bool" | "byte" | "char" | "uint8" => cursor.u8()?,
            "int8" => cursor.i8()?,
            "int16" => cursor.i16()?,
            "uint16" => cursor.u16()?,
            "int32" => cursor.i32()?,
            "uint32" => f64::from(cursor.u32()?),
            "float32" => cursor.f32()?,
            "int64" => cursor.i64()?,
            "uint64" => cursor.u64()? as f64,
            "float64" => cursor.f64()?,
            text => {
                let length = cursor.u32()? as usize;
                let each = if text == "wstring" { 2 } else { 1 };
                cursor.bytes(length.checked_mul(each).ok_or(Cut)?)?;
                return Ok(Some(None));
            }
        };
        Ok(Some(Some(value)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_of_ros_1_is_read_by_its_definition() {
        let text = "Header header\nint8 MOST=3\nfloat64[2] acc # m/s^2\nuint8[] raw\nint16 last\n\
            ====\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
        let definitions = Definitions::parse("bench/Acc", text, Layer::Ros1);
        let mut data = Vec::new();
        for word in [7u32, 100, 500_000_000, 2] {
            data.extend(word.to_le_bytes());
        }
        data.extend(b"ab");
        data.extend(1.5f64.to_le_bytes());
        data.extend((-2.5f64).to_le_bytes());
        data.extend(3u32.to_le_bytes());
        data.extend([1, 2, 3]);
        data.extend((-9i16).to_le_bytes());
        let mut found = Vec::new();
        definitions
            .read(&data, &mut |path, value| {
                found.push((path.to_owned(), value))
            })
            .unwrap();
        let expected = [
            ("header.seq", 7.0),
            ("header.stamp.secs", 100.0),
            ("header.stamp.nsecs", 5e8),
            ("acc.0", 1.5),
            ("acc.1", -2.5),
            ("last", -9.0),
        ];
        let expected = expected.map(|(path, value)| (path.to_owned(), value));
        assert_eq!(found, expected);
        let cut = definitions.read(&data[..data.len() - 1], &mut |_, _| {});
        assert_eq!(cut, Err(Bad::Cut));
    }
}
