//! Iterates over the data elements of one file, in order.

use std::borrow::Cow;
use std::io::Read;

use flate2::read::DeflateDecoder;

use super::FORMAT;
use super::syntax::{Syntax, TypeEncoding};
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::number::ByteOrder;

/// Group and element number.
pub(super) type Tag = (u16, u16);

pub(super) const TRANSFER_SYNTAX: Tag = (0x0002, 0x0010);
pub(super) const PIXEL_DATA: Tag = (0x7fe0, 0x0010);
const ITEM: Tag = (0xfffe, 0xe000);
const ITEM_END: Tag = (0xfffe, 0xe00d);
const SEQUENCE_END: Tag = (0xfffe, 0xe0dd);
/// Mark of an undefined length.
const UNDEFINED: u32 = u32::MAX;
/// Deepest nesting of sequences.
const MAX_DEPTH: usize = 32;
/// Largest unpacked length of a deflated data set, bytes.
const MAX_DEFLATED: u64 = 64 << 20;
/// Explicit types whose length takes four bytes, after two reserved bytes.
const LONG: [&[u8; 2]; 13] =
    [b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"];

/// Value of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Value<'a> {
    Bytes(&'a [u8]),
    /// Encapsulated pixels: the fragments after the offset table.
    Fragments(Vec<&'a [u8]>),
    /// A sequence; its items are read on demand.
    Sequence(Elements<'a>),
}

/// A data set without its file meta information.
#[derive(Debug)]
pub(super) struct DataSet<'a> {
    pub(super) syntax: Syntax,
    bytes: Cow<'a, [u8]>,
}

/// Whether these may be the bytes of a DICOM file.
///
/// A file begins with a preamble of 128 bytes and `DICM`; a file without these begins with an element of the first groups.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    bytes.get(128..132) == Some(b"DICM") || begins_bare(bytes)
}

fn begins_bare(bytes: &[u8]) -> bool {
    let Some((tag, rest)) = bytes.split_first_chunk::<4>() else { return false };
    // Also checks the type or length that the first element of these groups has; the tag alone fits many files.
    let explicit = rest.first_chunk::<2>().is_some_and(|vr| vr == b"UL" || vr == b"UI" || vr == b"CS");
    let short = rest.first_chunk::<4>().is_some_and(|n| u32::from_le_bytes(*n) <= 64);
    matches!(tag, [2 | 8, 0, 0 | 1 | 5 | 8 | 0x10 | 0x16 | 0x18, 0]) && (explicit || short)
}

impl<'a> DataSet<'a> {
    /// Reads the file meta information and unpacks a deflated data set.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, ImportError> {
        let body = match bytes.get(128..132) {
            Some(b"DICM") => bytes.get(132..).unwrap_or_default(),
            _ => bytes,
        };
        // The meta information is always explicit little endian; it ends where the group number changes.
        let mut meta = Elements::new(body, TypeEncoding::Explicit, ByteOrder::Little);
        let mut syntax = None;
        while meta.peek().is_some_and(|(group, _)| group == 0x0002) {
            let Some((tag, value)) = meta.next()? else { break };
            if let (TRANSFER_SYNTAX, Value::Bytes(uid)) = (tag, value) {
                syntax = Some(Syntax::of(uid));
            }
        }
        let rest = body.get(meta.at..).unwrap_or_default();
        let syntax = match syntax {
            Some(syntax) => syntax,
            // Files of old archives have no meta information: letters in the place of the type show explicit encoding.
            None if rest.get(4..6).is_some_and(|vr| vr.iter().all(u8::is_ascii_uppercase)) => Syntax::EXPLICIT_LITTLE,
            None => Syntax::IMPLICIT_LITTLE,
        };
        let bytes = if syntax.deflated { Cow::Owned(inflate(rest)?) } else { Cow::Borrowed(rest) };
        Ok(Self { syntax, bytes })
    }

    /// The elements of the data set.
    pub(super) fn elements(&self) -> Elements<'_> {
        Elements::new(&self.bytes, self.syntax.types, self.syntax.byte_order)
    }
}

fn inflate(packed: &[u8]) -> Result<Vec<u8>, ImportError> {
    let mut unpacked = Vec::new();
    let read = DeflateDecoder::new(packed).take(MAX_DEFLATED.saturating_add(1)).read_to_end(&mut unpacked);
    if read.is_err() {
        return Err(malformed(FORMAT, "the deflated data set is damaged or cut off"));
    }
    if unpacked.len() as u64 > MAX_DEFLATED {
        return Err(malformed(FORMAT, format!("the deflated data set unpacks to more than {MAX_DEFLATED} bytes")));
    }
    Ok(unpacked)
}

/// Iterates over the top level of a data set; values are slices of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Elements<'a> {
    bytes: &'a [u8],
    at: usize,
    types: TypeEncoding,
    byte_order: ByteOrder,
}

/// Tag, type and length of an element.
struct Head {
    tag: Tag,
    vr: Option<[u8; 2]>,
    length: u32,
}

impl<'a> Elements<'a> {
    fn new(bytes: &'a [u8], types: TypeEncoding, byte_order: ByteOrder) -> Self {
        Self { bytes, at: 0, types, byte_order }
    }

    /// The next element; `None` at the end of the data set.
    pub(super) fn next(&mut self) -> Result<Option<(Tag, Value<'a>)>, ImportError> {
        // Old media often pad files with zeros up to a block.
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        if rest.len() < 8 && rest.iter().all(|b| *b == 0) {
            return Ok(None);
        }
        let head = self.head(self.types)?;
        let value = match head.length {
            UNDEFINED if head.tag == PIXEL_DATA => Value::Fragments(self.fragments()?),
            UNDEFINED => Value::Sequence(self.inside(self.types.inside(head.vr))?),
            length if head.vr.as_ref() == Some(b"SQ") => {
                Value::Sequence(Elements::new(self.take(length)?, self.types, self.byte_order))
            }
            length => Value::Bytes(self.take(length)?),
        };
        Ok(Some((head.tag, value)))
    }

    /// The tag of the next element.
    fn peek(&self) -> Option<Tag> {
        self.clone().tag()
    }

    fn tag(&mut self) -> Option<Tag> {
        Some((self.u16()?, self.u16()?))
    }

    fn u16(&mut self) -> Option<u16> {
        let bytes = self.bytes.get(self.at..)?.first_chunk::<2>()?;
        self.at = self.at.saturating_add(2);
        Some(self.byte_order.u16(*bytes))
    }

    fn u32(&mut self) -> Option<u32> {
        let bytes = self.bytes.get(self.at..)?.first_chunk::<4>()?;
        self.at = self.at.saturating_add(4);
        Some(self.byte_order.u32(*bytes))
    }

    fn head(&mut self, types: TypeEncoding) -> Result<Head, ImportError> {
        self.try_head(types).ok_or_else(|| malformed(FORMAT, format!("cut off in an element at byte {}", self.at)))
    }

    fn try_head(&mut self, types: TypeEncoding) -> Option<Head> {
        let tag = self.tag()?;
        if types == TypeEncoding::Implicit || tag.0 == ITEM.0 {
            return Some(Head { tag, vr: None, length: self.u32()? });
        }
        let vr = *self.bytes.get(self.at..)?.first_chunk::<2>()?;
        self.at = self.at.saturating_add(2);
        let length = if LONG.contains(&&vr) {
            self.u16()?;
            self.u32()?
        } else {
            u32::from(self.u16()?)
        };
        Some(Head { tag, vr: Some(vr), length })
    }

    fn take(&mut self, length: u32) -> Result<&'a [u8], ImportError> {
        let end = self.at.saturating_add(length as usize);
        let Some(bytes) = self.bytes.get(self.at..end) else {
            let left = self.bytes.len().saturating_sub(self.at);
            let detail = format!("an element at byte {} has {length} bytes, but {left} are left", self.at);
            return Err(malformed(FORMAT, detail));
        };
        self.at = end;
        Ok(bytes)
    }

    /// The fragments of encapsulated pixels; the first item is the offset table.
    fn fragments(&mut self) -> Result<Vec<&'a [u8]>, ImportError> {
        let mut items = Vec::new();
        loop {
            let head = self.head(TypeEncoding::Implicit)?;
            match head.tag {
                ITEM => items.push(self.take(head.length)?),
                SEQUENCE_END => break,
                _ => return Err(malformed(FORMAT, "the fragments of the pixels have other data between them")),
            }
        }
        if items.is_empty() {
            return Err(malformed(FORMAT, "the encapsulated pixels have no offset table"));
        }
        items.remove(0);
        Ok(items)
    }

    /// Reads the bytes as a sequence and returns the elements of each item, at most `at_most`.
    ///
    /// A sequence with implicit type arrives as [`Value::Bytes`] and is read in the same way.
    pub(super) fn items(mut self, at_most: usize) -> Result<Vec<Elements<'a>>, ImportError> {
        let mut items = Vec::new();
        while self.bytes.len().saturating_sub(self.at) >= 8 {
            let head = self.head(TypeEncoding::Implicit)?;
            match (head.tag, head.length) {
                (ITEM, _) if items.len() == at_most => {
                    return Err(malformed(FORMAT, format!("a sequence has more than {at_most} items")));
                }
                (ITEM, UNDEFINED) => items.push(self.inside(self.types)?),
                (ITEM, length) => items.push(Elements::new(self.take(length)?, self.types, self.byte_order)),
                (SEQUENCE_END, _) => break,
                _ => return Err(malformed(FORMAT, "the items of a sequence have other data between them")),
            }
        }
        Ok(items)
    }

    /// Elements of `bytes` in the encoding of these elements.
    pub(super) fn over(&self, bytes: &'a [u8]) -> Self {
        Elements::new(bytes, self.types, self.byte_order)
    }

    /// Skips a sequence or item of undefined length; returns its content without the end mark.
    fn inside(&mut self, types: TypeEncoding) -> Result<Elements<'a>, ImportError> {
        let start = self.at;
        self.skip_sequence(types)?;
        let end = self.at.saturating_sub(8).max(start);
        Ok(Elements::new(self.bytes.get(start..end).unwrap_or_default(), types, self.byte_order))
    }

    /// Skips a sequence of undefined length with all its content.
    fn skip_sequence(&mut self, types: TypeEncoding) -> Result<(), ImportError> {
        let mut open = vec![types];
        while let Some(&types) = open.last() {
            let head = self.head(types)?;
            match (head.tag, head.length) {
                (ITEM_END | SEQUENCE_END, _) => drop(open.pop()),
                (_, UNDEFINED) if open.len() == MAX_DEPTH => {
                    return Err(malformed(FORMAT, format!("sequences are nested deeper than {MAX_DEPTH}")));
                }
                (_, UNDEFINED) => open.push(types.inside(head.vr)),
                (_, length) => drop(self.take(length)?),
            }
        }
        Ok(())
    }
}
