//! Decodes arrays to numbers.

use std::io::Read;

use super::FORMAT;
use super::xml::{Appended, Content, RawArray, VtkXml};
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::number::NumberType;
use crate::import::text::Words;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// The numbers of an array; an error when there are more than `at_most`.
pub(super) fn numbers(file: &VtkXml<'_>, array: &RawArray<'_>, at_most: usize) -> Result<Vec<f64>, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, format!("{} {detail}", array.place()));
    let number_type = array.number_type.ok_or_else(|| fault("holds no numbers"))?;
    if let Content::Ascii(text) = array.content {
        return ascii(text, at_most).ok_or_else(|| fault("has a word that is not a number, or too many numbers"));
    }
    let content = content(file, array, at_most.saturating_mul(number_type.size()))?;
    Ok(number_type.all(&content, file.byte_order))
}

/// The first text of an array of text with at most a few kilobytes.
///
/// VTK writes the codes of the characters, each text with a zero at its end; others write the text itself.
pub(super) fn text(file: &VtkXml<'_>, array: &RawArray<'_>) -> Result<Vec<u8>, ImportError> {
    const AT_MOST: usize = 4096;
    let codes = |numbers: Vec<f64>| numbers.into_iter().map(|code| code as u8).collect();
    let mut text: Vec<u8> = match (array.content, array.number_type) {
        (Content::Ascii(text), _) => ascii(text, AT_MOST).map_or_else(|| text.trim_ascii().to_vec(), codes),
        (Content::Base64(_) | Content::Appended(_), None | Some(NumberType::I8 | NumberType::U8)) => {
            content(file, array, AT_MOST)?
        }
        (Content::Base64(_) | Content::Appended(_), Some(_)) => codes(numbers(file, array, AT_MOST)?),
    };
    text.truncate(text.iter().position(|c| *c == 0).unwrap_or(text.len()));
    Ok(text)
}

/// The bytes of an array that is not plain text; an error when there are more than `bytes`.
fn content(file: &VtkXml<'_>, array: &RawArray<'_>, bytes: usize) -> Result<Vec<u8>, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, format!("{} {detail}", array.place()));
    let decoded;
    let stored = match array.content {
        Content::Ascii(text) => text,
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
    content.map_err(fault)
}

fn next_offset(file: &VtkXml<'_>, offset: usize) -> Option<usize> {
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
fn take_count<'a>(file: &VtkXml<'_>, bytes: &'a [u8]) -> Option<(usize, &'a [u8])> {
    let (count, rest) = if file.wide_header {
        let (head, rest) = bytes.split_first_chunk::<8>()?;
        (file.byte_order.u64(*head), rest)
    } else {
        let (head, rest) = bytes.split_first_chunk::<4>()?;
        (u64::from(file.byte_order.u32(*head)), rest)
    };
    Some((usize::try_from(count).ok()?, rest))
}

/// Reads plain data: the length, then the bytes.
fn plain(file: &VtkXml<'_>, stored: &[u8], at_most: usize) -> Result<Vec<u8>, &'static str> {
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
fn inflate(file: &VtkXml<'_>, stored: &[u8], at_most: usize) -> Result<Vec<u8>, &'static str> {
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
