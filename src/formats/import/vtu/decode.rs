//! Decodes arrays to numbers.

use std::io::Read;

use super::FORMAT;
use super::xml::{Appended, Content, File, RawArray};
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::number::Kind;
use crate::import::text::Words;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// The number type with the VTK name `name`.
pub(super) fn kind_named(name: &str) -> Option<Kind> {
    Some(match name {
        "Int8" => Kind::I8,
        "UInt8" => Kind::U8,
        "Int16" => Kind::I16,
        "UInt16" => Kind::U16,
        "Int32" => Kind::I32,
        "UInt32" => Kind::U32,
        "Int64" => Kind::I64,
        "UInt64" => Kind::U64,
        "Float32" => Kind::F32,
        "Float64" => Kind::F64,
        _ => return None,
    })
}

/// The numbers of an array; an error when there are more than `at_most`.
pub(super) fn numbers(file: &File<'_>, array: &RawArray<'_>, at_most: usize) -> Result<Vec<f64>, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, format!("{} {detail}", array.place()));
    let kind = array.kind.ok_or_else(|| fault("holds no numbers"))?;
    let bytes = at_most.saturating_mul(kind.size());
    let decoded;
    let stored = match array.content {
        Content::Ascii(text) => {
            return ascii(text, at_most).ok_or_else(|| fault("has a word that is not a number, or too many numbers"));
        }
        Content::Base64(text) => {
            decoded = base64(text).ok_or_else(|| fault("is not base64"))?;
            decoded.as_slice()
        }
        Content::Appended(offset) => match file.appended {
            Some(Appended::Raw(data)) => {
                data.get(offset..).ok_or_else(|| fault("begins beyond the end of the data"))?
            }
            Some(Appended::Base64(data)) => {
                let data = data.get(offset..).ok_or_else(|| fault("begins beyond the end of the data"))?;
                // The array ends where the next one begins; padding may stand anywhere.
                let end = next_offset(file, offset).map_or(data.len(), |next| next.saturating_sub(offset));
                decoded = base64(data.get(..end).unwrap_or(data)).ok_or_else(|| fault("is not base64"))?;
                decoded.as_slice()
            }
            None => return Err(fault("refers to appended data, but there are none")),
        },
    };
    let content = if file.zlib { inflate(file, stored, bytes) } else { plain(file, stored, bytes) };
    let content = content.map_err(fault)?;
    Ok(kind.all(&content, file.little_endian))
}

fn next_offset(file: &File<'_>, offset: usize) -> Option<usize> {
    let offsets = file.arrays.iter().filter_map(|a| match a.content {
        Content::Appended(other) => Some(other),
        Content::Ascii(_) | Content::Base64(_) => None,
    });
    offsets.filter(|o| *o > offset).min()
}

fn ascii(text: &[u8], at_most: usize) -> Option<Vec<f64>> {
    let mut words = Words::new(text, 1);
    let mut found = Vec::new();
    while words.bytes_left() > 0 {
        if found.len() == at_most {
            return None;
        }
        found.push(words.next_number()?);
    }
    Some(found)
}

/// Decodes base64 text of several parts, each encoded on its own and possibly padded.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let dense: Vec<u8> = text.iter().copied().filter(|c| !c.is_ascii_whitespace()).collect();
    let mut found = Vec::with_capacity(dense.len());
    let (quads, rest) = dense.as_chunks::<4>();
    if !rest.is_empty() {
        return None;
    }
    for part in quads.chunk_by(|a, _| !a.contains(&b'=')) {
        STANDARD.decode_vec(part.as_flattened(), &mut found).ok()?;
    }
    Some(found)
}

/// A length or count of the array's header, and the bytes after it.
fn take_count<'a>(file: &File<'_>, bytes: &'a [u8]) -> Option<(usize, &'a [u8])> {
    let count = if file.wide_header {
        let (head, rest) = bytes.split_first_chunk::<8>()?;
        (if file.little_endian { u64::from_le_bytes(*head) } else { u64::from_be_bytes(*head) }, rest)
    } else {
        let (head, rest) = bytes.split_first_chunk::<4>()?;
        (u64::from(if file.little_endian { u32::from_le_bytes(*head) } else { u32::from_be_bytes(*head) }), rest)
    };
    usize::try_from(count.0).ok().map(|n| (n, count.1))
}

/// Reads plain data: the length, then the bytes.
fn plain(file: &File<'_>, stored: &[u8], at_most: usize) -> Result<Vec<u8>, &'static str> {
    if stored.is_empty() {
        return Ok(Vec::new());
    }
    let (length, rest) = take_count(file, stored).ok_or("has no length")?;
    if length > at_most {
        return Err("is longer than expected");
    }
    rest.get(..length).map(<[u8]>::to_vec).ok_or("is cut off")
}

/// Reads compressed data: number of blocks, block size, size of a smaller last block, compressed sizes, then the blocks.
fn inflate(file: &File<'_>, stored: &[u8], at_most: usize) -> Result<Vec<u8>, &'static str> {
    if stored.is_empty() {
        return Ok(Vec::new());
    }
    let cut_off = "is cut off";
    let (n_blocks, rest) = take_count(file, stored).ok_or(cut_off)?;
    let (block, rest) = take_count(file, rest).ok_or(cut_off)?;
    let (last, mut rest) = take_count(file, rest).ok_or(cut_off)?;
    if n_blocks > rest.len() {
        return Err(cut_off);
    }
    let mut sizes = Vec::with_capacity(n_blocks);
    for _ in 0..n_blocks {
        let (size, tail) = take_count(file, rest).ok_or(cut_off)?;
        sizes.push(size);
        rest = tail;
    }
    let mut found = Vec::new();
    for (index, size) in sizes.iter().enumerate() {
        let whole = index.saturating_add(1) < n_blocks || last == 0;
        let expected = if whole { block } else { last };
        if found.len().saturating_add(expected) > at_most {
            return Err("is longer than expected");
        }
        let (packed, tail) = rest.split_at_checked(*size).ok_or(cut_off)?;
        rest = tail;
        let before = found.len();
        flate2::read::ZlibDecoder::new(packed)
            .take(expected as u64)
            .read_to_end(&mut found)
            .map_err(|_| "has damaged compressed data")?;
        if found.len().saturating_sub(before) != expected {
            return Err("holds less than its header states");
        }
    }
    Ok(found)
}
