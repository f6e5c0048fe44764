//! The data elements of one file, in order.

use std::borrow::Cow;
use std::io::Read;

use flate2::read::DeflateDecoder;

use super::FORMAT;
use super::syntax::Syntax;
use crate::import::ImportError;
use crate::import::error::malformed;

/// Group and element number.
pub(super) type Tag = (u16, u16);

pub(super) const TRANSFER_SYNTAX: Tag = (0x0002, 0x0010);
pub(super) const PIXEL_DATA: Tag = (0x7fe0, 0x0010);
const ITEM: Tag = (0xfffe, 0xe000);
const ITEM_END: Tag = (0xfffe, 0xe00d);
const SEQUENCE_END: Tag = (0xfffe, 0xe0dd);
/// A length that the file leaves open.
const UNDEFINED: u32 = u32::MAX;
/// Sequences in sequences that are followed.
const MAX_DEPTH: usize = 32;
/// A data set that is packed by deflate may grow to this, bytes.
const MAX_DEFLATED: u64 = 64 << 20;
/// Explicit types whose length takes four bytes, after two that mean nothing.
const LONG: [&[u8; 2]; 13] =
    [b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"];

/// What an element holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Value<'a> {
    Bytes(&'a [u8]),
    /// Encapsulated pixels: the fragments after the offset table.
    Fragments(Vec<&'a [u8]>),
    /// A sequence; what is in its items is read on demand.
    Sequence(Elements<'a>),
}

/// A data set apart from its file meta information.
#[derive(Debug)]
pub(super) struct DataSet<'a> {
    pub(super) syntax: Syntax,
    bytes: Cow<'a, [u8]>,
}

/// Whether these may be the bytes of a DICOM file: it begins with 128 bytes of anything and `DICM`, or, without these, with
/// an element of the first groups.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    bytes.get(128..132) == Some(b"DICM") || begins_bare(bytes)
}

fn begins_bare(bytes: &[u8]) -> bool {
    let Some((tag, rest)) = bytes.split_first_chunk::<4>() else { return false };
    // Length and type as the first element of these groups has them, else any small number would do.
    let explicit = rest.first_chunk::<2>().is_some_and(|vr| vr == b"UL" || vr == b"UI" || vr == b"CS");
    let short = rest.first_chunk::<4>().is_some_and(|n| u32::from_le_bytes(*n) <= 64);
    matches!(tag, [2 | 8, 0, 0 | 1 | 5 | 8 | 0x10 | 0x16 | 0x18, 0]) && (explicit || short)
}

impl<'a> DataSet<'a> {
    /// Reads the file meta information, and unpacks a data set that is packed.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, ImportError> {
        let body = match bytes.get(128..132) {
            Some(b"DICM") => bytes.get(132..).unwrap_or_default(),
            _ => bytes,
        };
        // The meta information is explicit little endian, whatever follows; its end shows by the group.
        let mut meta = Elements::new(body, true, true);
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
            // Files of old archives: no meta information, so the type's letters tell.
            None if rest.get(4..6).is_some_and(|vr| vr.iter().all(u8::is_ascii_uppercase)) => Syntax::EXPLICIT_LITTLE,
            None => Syntax::IMPLICIT_LITTLE,
        };
        let bytes = if syntax.deflated { Cow::Owned(inflate(rest)?) } else { Cow::Borrowed(rest) };
        Ok(Self { syntax, bytes })
    }

    /// Its elements.
    pub(super) fn elements(&self) -> Elements<'_> {
        Elements::new(&self.bytes, self.syntax.explicit, self.syntax.little_endian)
    }
}

fn inflate(packed: &[u8]) -> Result<Vec<u8>, ImportError> {
    let mut unpacked = Vec::new();
    let read = DeflateDecoder::new(packed).take(MAX_DEFLATED.saturating_add(1)).read_to_end(&mut unpacked);
    if read.is_err() {
        return Err(malformed(FORMAT, "the deflated data set is damaged or cut off"));
    }
    if unpacked.len() as u64 > MAX_DEFLATED {
        return Err(malformed(FORMAT, format!("the deflated data set grows beyond {MAX_DEFLATED} bytes")));
    }
    Ok(unpacked)
}

/// Goes through the top level of a data set; values are slices of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Elements<'a> {
    bytes: &'a [u8],
    at: usize,
    explicit: bool,
    little: bool,
}

/// An element's beginning.
struct Head {
    tag: Tag,
    vr: Option<[u8; 2]>,
    length: u32,
}

impl<'a> Elements<'a> {
    fn new(bytes: &'a [u8], explicit: bool, little: bool) -> Self {
        Self { bytes, at: 0, explicit, little }
    }

    /// The next element; `None` at the end of the data set.
    pub(super) fn next(&mut self) -> Result<Option<(Tag, Value<'a>)>, ImportError> {
        // Padding with zeros up to a block is common on old media.
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        if rest.len() < 8 && rest.iter().all(|b| *b == 0) {
            return Ok(None);
        }
        let head = self.head(self.explicit)?;
        let value = match head.length {
            UNDEFINED if head.tag == PIXEL_DATA => Value::Fragments(self.fragments()?),
            UNDEFINED => {
                // What an element of unknown type holds is implicit, whatever the file is (CP-246).
                let explicit = self.explicit && head.vr.as_ref() != Some(b"UN");
                Value::Sequence(self.inside(explicit)?)
            }
            length if head.vr.as_ref() == Some(b"SQ") => {
                Value::Sequence(Elements::new(self.take(length)?, self.explicit, self.little))
            }
            length => Value::Bytes(self.take(length)?),
        };
        Ok(Some((head.tag, value)))
    }

    /// The tag that comes next.
    fn peek(&self) -> Option<Tag> {
        self.clone().tag()
    }

    fn tag(&mut self) -> Option<Tag> {
        Some((self.u16()?, self.u16()?))
    }

    fn u16(&mut self) -> Option<u16> {
        let bytes = self.bytes.get(self.at..)?.first_chunk::<2>()?;
        self.at = self.at.saturating_add(2);
        Some(if self.little { u16::from_le_bytes(*bytes) } else { u16::from_be_bytes(*bytes) })
    }

    fn u32(&mut self) -> Option<u32> {
        let bytes = self.bytes.get(self.at..)?.first_chunk::<4>()?;
        self.at = self.at.saturating_add(4);
        Some(if self.little { u32::from_le_bytes(*bytes) } else { u32::from_be_bytes(*bytes) })
    }

    fn head(&mut self, explicit: bool) -> Result<Head, ImportError> {
        self.try_head(explicit).ok_or_else(|| malformed(FORMAT, format!("cut off in an element at byte {}", self.at)))
    }

    fn try_head(&mut self, explicit: bool) -> Option<Head> {
        let tag = self.tag()?;
        if !explicit || tag.0 == ITEM.0 {
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
            let head = self.head(false)?;
            match head.tag {
                ITEM => items.push(self.take(head.length)?),
                SEQUENCE_END => break,
                _ => return Err(malformed(FORMAT, "between the fragments of the pixels stands something else")),
            }
        }
        if items.is_empty() {
            return Err(malformed(FORMAT, "the encapsulated pixels have no offset table"));
        }
        items.remove(0);
        Ok(items)
    }

    /// Read as a sequence: the elements of its items. A sequence of implicit type comes as bytes and is read the same way.
    pub(super) fn items(mut self, at_most: usize) -> Result<Vec<Elements<'a>>, ImportError> {
        let mut items = Vec::new();
        while self.bytes.len().saturating_sub(self.at) >= 8 {
            let head = self.head(false)?;
            match (head.tag, head.length) {
                (ITEM, _) if items.len() == at_most => {
                    return Err(malformed(FORMAT, format!("a sequence has more than {at_most} items")));
                }
                (ITEM, UNDEFINED) => items.push(self.inside(self.explicit)?),
                (ITEM, length) => items.push(Elements::new(self.take(length)?, self.explicit, self.little)),
                (SEQUENCE_END, _) => break,
                _ => return Err(malformed(FORMAT, "between the items of a sequence stands something else")),
            }
        }
        Ok(items)
    }

    /// Elements over `bytes`, encoded as these are.
    pub(super) fn over(&self, bytes: &'a [u8]) -> Self {
        Elements::new(bytes, self.explicit, self.little)
    }

    /// Passes over a sequence or an item of open length and all that is in it; that without its end.
    fn inside(&mut self, explicit: bool) -> Result<Elements<'a>, ImportError> {
        let start = self.at;
        self.skip_sequence(explicit)?;
        let end = self.at.saturating_sub(8).max(start);
        Ok(Elements::new(self.bytes.get(start..end).unwrap_or_default(), explicit, self.little))
    }

    /// Passes over a sequence of open length and all that is in it.
    fn skip_sequence(&mut self, explicit: bool) -> Result<(), ImportError> {
        let implicit = |vr: Option<[u8; 2]>| vr.as_ref() == Some(b"UN");
        let mut open = vec![explicit];
        while let Some(&explicit) = open.last() {
            let head = self.head(explicit)?;
            match (head.tag, head.length) {
                (ITEM_END | SEQUENCE_END, _) => drop(open.pop()),
                (_, UNDEFINED) if open.len() == MAX_DEPTH => {
                    return Err(malformed(FORMAT, format!("sequences are nested deeper than {MAX_DEPTH}")));
                }
                (_, UNDEFINED) => open.push(explicit && !implicit(head.vr)),
                (_, length) => drop(self.take(length)?),
            }
        }
        Ok(())
    }
}
