//! Decodes DICOM's run length encoding (PS3.5 annex G).
//!
//! An image is stored as one PackBits plane per byte of its words, high bytes first.

use super::FORMAT;
use crate::import::ImportError;
use crate::import::error::malformed;

/// Bytes of the header: a count and 15 offsets.
const HEADER: usize = 64;

/// Unpacks one image to `n` words of one or two bytes.
pub(super) fn words(packed: &[u8], n: usize, bytes_per_word: usize) -> Result<Vec<u16>, ImportError> {
    let number = |index: usize| {
        let bytes = packed.get(index.saturating_mul(4)..)?.first_chunk::<4>()?;
        Some(u32::from_le_bytes(*bytes) as usize)
    };
    let planes = number(0).ok_or_else(|| malformed(FORMAT, "the RLE header is cut off"))?;
    if planes != bytes_per_word {
        let detail = format!("{planes} RLE planes, expected {bytes_per_word}, one for each byte of a pixel");
        return Err(malformed(FORMAT, detail));
    }
    let mut words = vec![0u16; n];
    for plane in 0..planes {
        let begin = number(plane.saturating_add(1)).filter(|b| *b >= HEADER);
        let next = plane.saturating_add(2);
        let end = if next <= planes { number(next) } else { Some(packed.len()) };
        let bytes = begin.zip(end).and_then(|(begin, end)| packed.get(begin..end));
        let bytes = bytes.ok_or_else(|| malformed(FORMAT, "an RLE plane lies outside the file"))?;
        let mut place = words.iter_mut();
        let mut filled = 0usize;
        unpack(bytes, n, &mut |byte| {
            if let Some(word) = place.next() {
                *word = *word << 8 | u16::from(byte);
                filled = filled.saturating_add(1);
            }
        });
        if filled < n {
            return Err(malformed(FORMAT, format!("an RLE plane holds {filled} bytes, expected {n}")));
        }
    }
    Ok(words)
}

/// Passes at most `n` bytes of a PackBits stream to `give`.
fn unpack(mut bytes: &[u8], n: usize, give: &mut dyn FnMut(u8)) {
    let mut left = n;
    while let (Some((&control, rest)), 1..) = (bytes.split_first(), left) {
        bytes = rest;
        match control {
            0..=127 => {
                let count = usize::from(control).saturating_add(1).min(rest.len()).min(left);
                let (literal, rest) = rest.split_at(count);
                literal.iter().for_each(|b| give(*b));
                (bytes, left) = (rest, left.saturating_sub(count));
            }
            128 => {}
            _ => {
                let Some((&byte, rest)) = rest.split_first() else { return };
                let count = 257usize.saturating_sub(usize::from(control)).min(left);
                (0..count).for_each(|_| give(byte));
                (bytes, left) = (rest, left.saturating_sub(count));
            }
        }
    }
}
