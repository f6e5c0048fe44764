//! Bytes of the voxels, from the header's file or others, in any encoding that is read.

use std::borrow::Cow;
use std::io::Read;

use flate2::read::MultiGzDecoder;

use super::FORMAT;
use super::header::Header;
use crate::import::ImportError;
use crate::import::detached::{Fetch, MAX_FILES, numbered};
use crate::import::error::malformed;
use crate::import::hounsfield::Packing;
use crate::import::text::Words;

/// Encoding of the voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Raw,
    Gzip,
    /// Decimal numbers, separated by white space or commas.
    Text,
    Hex,
}

impl Encoding {
    pub(super) fn of(name: &str) -> Result<Self, ImportError> {
        match name.to_ascii_lowercase().as_str() {
            "raw" => Ok(Self::Raw),
            "gzip" | "gz" => Ok(Self::Gzip),
            "ascii" | "text" | "txt" => Ok(Self::Text),
            "hex" => Ok(Self::Hex),
            "bzip2" | "bz2" => {
                Err(malformed(FORMAT, "the `encoding` bzip2 is not supported; save the volume with gzip or raw"))
            }
            _ => Err(malformed(FORMAT, "`encoding` is not raw, gzip, ascii or hex")),
        }
    }
}

/// What lies before the voxels of each file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Skips {
    lines: usize,
    /// Bytes before the voxels, after unpacking; `None` when the voxels are the last bytes.
    bytes: Option<usize>,
}

impl Skips {
    pub(super) fn of(header: &Header<'_>, encoding: Encoding) -> Result<Self, ImportError> {
        let number = |names: [&str; 2]| match header.field(&names) {
            None => Ok(0i64),
            Some(text) => {
                text.parse().map_err(|_| malformed(FORMAT, "`line skip` or `byte skip` is not a whole number"))
            }
        };
        let lines = usize::try_from(number(["line skip", "lineskip"])?)
            .map_err(|_| malformed(FORMAT, "`line skip` is negative"))?;
        let bytes = match number(["byte skip", "byteskip"])? {
            -1 if encoding == Encoding::Raw => None,
            bytes => Some(usize::try_from(bytes).map_err(|_| {
                malformed(FORMAT, "`byte skip` is negative; only -1 is supported, with the `encoding` raw")
            })?),
        };
        Ok(Self { lines, bytes })
    }
}

/// Packed or plain bytes of the voxels.
pub(super) struct Data<'a> {
    pub(super) bytes: Cow<'a, [u8]>,
    pub(super) packing: Packing,
}

/// The bytes of all numbers; `needed` are theirs as binary numbers (of text: of doubles).
pub(super) fn read<'a>(
    header: &Header<'a>,
    encoding: Encoding,
    needed: usize,
    fetch: &mut Fetch<'_>,
) -> Result<Data<'a>, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    let skips = Skips::of(header, encoding)?;
    let Some(file) = header.data_file() else {
        let attached = header.attached.unwrap_or_default();
        return one(Cow::Borrowed(attached), encoding, skips, needed);
    };
    let names: Vec<String> = if file.split_whitespace().next() == Some("LIST") {
        header.list.iter().filter(|name| !name.is_empty()).map(|name| (*name).to_owned()).collect()
    } else if file.contains('%') {
        numbered(file).ok_or_else(|| fault("`data file` is not a pattern with one `%d`, a first and a last number"))?
    } else {
        vec![file.to_owned()]
    };
    if let [name] = names.as_slice() {
        return one(Cow::Owned(fetch(name).map_err(fault)?), encoding, skips, needed);
    }
    let share = needed.checked_div(names.len()).filter(|n| n.saturating_mul(names.len()) == needed);
    let Some(share) = share.filter(|_| names.len() <= MAX_FILES) else {
        let detail = format!("{} voxel files cannot hold equal parts of the volume", names.len());
        return Err(malformed(FORMAT, detail));
    };
    let mut bytes = Vec::new();
    for name in &names {
        let part = one(Cow::Owned(fetch(name).map_err(fault)?), encoding, skips, share)?;
        let part = match part.packing {
            Packing::Plain => part.bytes,
            Packing::Gzip | Packing::Zlib => Cow::Owned(unpacked(&part.bytes, share)?),
        };
        let whole = part.get(..share).ok_or_else(|| fault("one of the voxel files is too short"))?;
        bytes.extend_from_slice(whole);
    }
    Ok(Data { bytes: Cow::Owned(bytes), packing: Packing::Plain })
}

/// The bytes of one file, of whose content `needed` bytes are voxels.
fn one(data: Cow<'_, [u8]>, encoding: Encoding, skips: Skips, needed: usize) -> Result<Data<'_>, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    let data = after_lines(data, skips.lines).ok_or_else(|| fault("`line skip` is larger than the file"))?;
    let (bytes, packing) = match (encoding, skips.bytes) {
        (Encoding::Raw, None) => {
            let from = data.len().checked_sub(needed).ok_or_else(|| fault("the voxels are cut off"))?;
            (cut(data, from), Packing::Plain)
        }
        (Encoding::Gzip, Some(0)) => (data, Packing::Gzip),
        (Encoding::Gzip, skip) => {
            let skip = skip.unwrap_or(0);
            let plain = unpacked(&data, needed.saturating_add(skip))?;
            (cut(Cow::Owned(plain), skip), Packing::Plain)
        }
        (_, skip) => {
            let data = cut(data, skip.unwrap_or(0));
            match encoding {
                Encoding::Text => (Cow::Owned(of_text(&data, needed)?), Packing::Plain),
                Encoding::Hex => (Cow::Owned(of_hex(&data)?), Packing::Plain),
                Encoding::Raw | Encoding::Gzip => (data, Packing::Plain),
            }
        }
    };
    Ok(Data { bytes, packing })
}

/// The bytes from `from` on; none when there are fewer.
fn cut(bytes: Cow<'_, [u8]>, from: usize) -> Cow<'_, [u8]> {
    match bytes {
        Cow::Borrowed(bytes) => Cow::Borrowed(bytes.get(from..).unwrap_or_default()),
        Cow::Owned(mut bytes) => {
            bytes.drain(..from.min(bytes.len()));
            Cow::Owned(bytes)
        }
    }
}

fn after_lines(bytes: Cow<'_, [u8]>, lines: usize) -> Option<Cow<'_, [u8]>> {
    if lines == 0 {
        return Some(bytes);
    }
    let end = bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').nth(lines.saturating_sub(1))?.0;
    Some(cut(bytes, end.saturating_add(1)))
}

/// Up to `at_most` unpacked bytes.
fn unpacked(packed: &[u8], at_most: usize) -> Result<Vec<u8>, ImportError> {
    let mut bytes = Vec::new();
    let read = MultiGzDecoder::new(packed).take(at_most as u64).read_to_end(&mut bytes);
    read.map_err(|_| malformed(FORMAT, "the compressed voxels are damaged"))?;
    Ok(bytes)
}

/// The numbers of a text as little-endian doubles, at most `needed` bytes of them.
fn of_text(text: &[u8], needed: usize) -> Result<Vec<u8>, ImportError> {
    let text: Vec<u8> = text.iter().map(|c| if *c == b',' { b' ' } else { *c }).collect();
    let mut words = Words::new(&text, 1);
    let mut bytes = Vec::new();
    while bytes.len() < needed && words.bytes_left() > 0 {
        let number = words.next_number().ok_or_else(|| malformed(FORMAT, "the voxels are not made of numbers"))?;
        bytes.extend(number.to_le_bytes());
    }
    Ok(bytes)
}

/// The bytes that pairs of hexadecimal digits spell.
fn of_hex(text: &[u8]) -> Result<Vec<u8>, ImportError> {
    let digits = text.iter().filter(|c| !c.is_ascii_whitespace()).map(|c| char::from(*c).to_digit(16));
    let digits: Option<Vec<u32>> = digits.collect();
    let digits = digits.ok_or_else(|| malformed(FORMAT, "the voxels are not hexadecimal digits"))?;
    Ok(digits.as_chunks::<2>().0.iter().map(|[high, low]| (high << 4 | low) as u8).collect())
}
