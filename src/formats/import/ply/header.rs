//! Header of a PLY file.

use super::super::ImportError;
use super::super::error::malformed;
use super::super::number::NumberType;
use super::FORMAT;
use crate::import::stated::Stated;

/// Encoding of the numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The number type with the PLY name `word`.
fn number_type_named(word: &[u8]) -> Option<NumberType> {
    Some(match word {
        b"char" | b"int8" => NumberType::I8,
        b"uchar" | b"uint8" => NumberType::U8,
        b"short" | b"int16" => NumberType::I16,
        b"ushort" | b"uint16" => NumberType::U16,
        b"int" | b"int32" => NumberType::I32,
        b"uint" | b"uint32" => NumberType::U32,
        b"float" | b"float32" => NumberType::F32,
        b"double" | b"float64" => NumberType::F64,
        _ => return None,
    })
}

/// Use of a property by the reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    X,
    Y,
    Z,
    Corners,
    Other,
}

/// One value, or a list of values, of every instance of an element.
#[derive(Debug, Clone, Copy)]
pub(super) struct Property {
    pub(super) role: Role,
    pub(super) number_type: NumberType,
    /// Type of a list's length; `None` for a single value.
    pub(super) count_type: Option<NumberType>,
}

/// Use of an element by the reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ElementKind {
    Vertex,
    Face,
    Other,
}

/// An element of the file: a table with one row per instance.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) kind: ElementKind,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Whether exactly one property plays `role`.
    fn has_one(&self, role: Role) -> bool {
        self.properties.iter().filter(|p| p.role == role).count() == 1
    }
}

/// The header, and the bytes of the values that follow.
#[derive(Debug)]
pub(super) struct Header<'a> {
    /// Elements in the order of the file.
    pub(super) elements: Vec<Element>,
    pub(super) encoding: Encoding,
    pub(super) values: &'a [u8],
    /// Number of the line on which the values begin.
    pub(super) values_line: u64,
    /// What the comments state about the coordinates.
    pub(super) stated: Stated,
}

impl<'a> Header<'a> {
    /// Reads up to `end_header`.
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self, ImportError> {
        let mut elements: Vec<Element> = Vec::new();
        let mut encoding = None;
        let mut stated = Stated::default();
        let mut rest = bytes;
        // The first line shows how lines end: with LF, CR LF or CR.
        let line_end = if bytes.get(3..5).is_some_and(|end| matches!(end, [b'\r', second] if *second != b'\n')) {
            b'\r'
        } else {
            b'\n'
        };
        for line in 1u64.. {
            let Some(end) = rest.iter().position(|&c| c == line_end) else {
                return Err(malformed(FORMAT, format!("line {line}: cut off before `end_header`")));
            };
            let (text, tail) = rest.split_at(end);
            rest = tail.get(1..).unwrap_or_default();
            let words: Vec<&[u8]> = text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).take(6).collect();
            let fault = |what: &str| malformed(FORMAT, format!("line {line}: {what}"));
            match *words.as_slice() {
                [b"ply"] if line == 1 => {}
                _ if line == 1 => return Err(fault("expected `ply`")),
                [] => {}
                [b"comment" | b"obj_info", ..] => stated.read(text),
                [b"format", name, b"1.0"] if encoding.is_none() => {
                    encoding = Some(match name {
                        b"ascii" => Encoding::Ascii,
                        b"binary_little_endian" => Encoding::LittleEndian,
                        b"binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(fault("unknown encoding")),
                    });
                }
                [b"element", name, count] => {
                    let count = std::str::from_utf8(count).ok().and_then(|c| c.parse().ok());
                    let count = count.ok_or_else(|| fault("the count of an element is not a number"))?;
                    let kind = match name {
                        b"vertex" => ElementKind::Vertex,
                        b"face" => ElementKind::Face,
                        b"tristrips" => return Err(fault("triangle strips (`tristrips`) are not read: export faces")),
                        _ => ElementKind::Other,
                    };
                    elements.push(Element { kind, count, properties: Vec::new() });
                }
                [b"property", ref definition @ ..] => {
                    let element = elements.last_mut().ok_or_else(|| fault("a property before any element"))?;
                    let property = property(definition, element.kind).ok_or_else(|| fault("unknown property type"))?;
                    element.properties.push(property);
                }
                [b"end_header"] => {
                    let encoding = encoding.ok_or_else(|| fault("no `format … 1.0` before the end of the header"))?;
                    check(&elements)?;
                    return Ok(Self { elements, encoding, values: rest, values_line: line.saturating_add(1), stated });
                }
                _ => return Err(fault("not a header line of PLY 1.0, or a second `format`")),
            }
        }
        Err(malformed(FORMAT, "no `end_header`"))
    }
}

fn property(definition: &[&[u8]], element: ElementKind) -> Option<Property> {
    let (count_type, number_type, name) = match *definition {
        [b"list", count, number_type, name] => {
            // The length of a list must be an integer.
            (Some(number_type_named(count).filter(|n| n.is_integer())?), number_type, name)
        }
        [number_type, name] => (None, number_type, name),
        _ => return None,
    };
    let is_list = count_type.is_some();
    let number_type = number_type_named(number_type)?;
    let role = match (element, name) {
        (ElementKind::Vertex, b"x") if !is_list => Role::X,
        (ElementKind::Vertex, b"y") if !is_list => Role::Y,
        (ElementKind::Vertex, b"z") if !is_list => Role::Z,
        (ElementKind::Face, b"vertex_indices" | b"vertex_index") if is_list && number_type.is_integer() => {
            Role::Corners
        }
        _ => Role::Other,
    };
    Some(Property { role, number_type, count_type })
}

/// Requires one element of vertices and, after it, one of faces, each with the properties that the reader needs.
fn check(elements: &[Element]) -> Result<(), ImportError> {
    let only = |kind| {
        let mut found = elements.iter().enumerate().filter(move |(_, e)| e.kind == kind);
        found.next().filter(|_| found.next().is_none())
    };
    let (Some((at_vertex, vertex)), Some((at_face, face))) = (only(ElementKind::Vertex), only(ElementKind::Face))
    else {
        return Err(malformed(FORMAT, "expected one element `vertex` and one element `face`"));
    };
    if ![Role::X, Role::Y, Role::Z].iter().all(|role| vertex.has_one(*role)) {
        return Err(malformed(FORMAT, "expected the properties x, y and z of `vertex`, each once"));
    }
    if !face.has_one(Role::Corners) {
        return Err(malformed(FORMAT, "expected one list of integers `vertex_indices` or `vertex_index` of `face`"));
    }
    if at_face < at_vertex {
        return Err(malformed(FORMAT, "the faces come before the vertices, expected after"));
    }
    Ok(())
}
