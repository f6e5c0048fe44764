//! Encoding of a file's elements and pixels.

use crate::import::number::ByteOrder;

/// Whether elements state their type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TypeEncoding {
    Explicit,
    Implicit,
}

impl TypeEncoding {
    /// Encoding of the content of an element of type `vr`; that of unknown type (UN) is always implicit (CP-246).
    pub(super) fn inside(self, vr: Option<[u8; 2]>) -> Self {
        if vr.as_ref() == Some(b"UN") { Self::Implicit } else { self }
    }
}

/// A transfer syntax.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Syntax {
    pub(super) types: TypeEncoding,
    pub(super) byte_order: ByteOrder,
    pub(super) deflated: bool,
    pub(super) pixels: Pixels,
}

/// Compression of the pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pixels {
    Plain,
    Rle,
    /// JPEG, JPEG-LS or JPEG 2000; the stream decides which, since the stated syntax is often wrong.
    Stream,
    /// Not supported; the last number of a standard identifier, or `None` for any other.
    Unread(Option<u16>),
}

const ROOT: &str = "1.2.840.10008.1.2";

impl Syntax {
    pub(super) const IMPLICIT_LITTLE: Self =
        Self { types: TypeEncoding::Implicit, byte_order: ByteOrder::Little, deflated: false, pixels: Pixels::Plain };
    pub(super) const EXPLICIT_LITTLE: Self = Self { types: TypeEncoding::Explicit, ..Self::IMPLICIT_LITTLE };

    /// The syntax with this identifier. Source: DICOM PS3.5, section 10 and annex A.
    pub(super) fn of(uid: &[u8]) -> Self {
        let text = std::str::from_utf8(uid).unwrap_or_default().trim_end_matches(['\0', ' ']);
        let packed = |pixels| Self { pixels, ..Self::EXPLICIT_LITTLE };
        match text.strip_prefix(ROOT) {
            Some("") => Self::IMPLICIT_LITTLE,
            Some(".1" | ".1.98") => Self::EXPLICIT_LITTLE,
            Some(".1.99") => Self { deflated: true, ..Self::EXPLICIT_LITTLE },
            Some(".2") => Self { byte_order: ByteOrder::Big, ..Self::EXPLICIT_LITTLE },
            Some(".5") => packed(Pixels::Rle),
            Some(".4.50" | ".4.51" | ".4.57" | ".4.70" | ".4.80" | ".4.81" | ".4.90" | ".4.91") => {
                packed(Pixels::Stream)
            }
            Some(other) => packed(Pixels::Unread(other.strip_prefix(".4.").and_then(|n| n.parse().ok()))),
            None => packed(Pixels::Unread(None)),
        }
    }
}

/// Supported transfer syntaxes, for error texts.
pub(super) const READ: &str = "implicit and explicit little endian, explicit big endian, deflated, RLE, JPEG (8 bits), \
     JPEG lossless, JPEG-LS, JPEG 2000";

/// Error text for an unsupported syntax. It quotes only standard identifiers: a private one could identify a patient.
pub(super) fn unread(code: Option<u16>) -> String {
    let which =
        code.map_or_else(|| "a private transfer syntax".to_owned(), |n| format!("transfer syntax {ROOT}.4.{n}"));
    format!("the pixels have {which}, which is not supported; supported are {READ}")
}
