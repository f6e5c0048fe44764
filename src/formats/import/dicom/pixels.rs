//! Converts the pixels of one image to Hounsfield units.

use std::borrow::Cow;

use super::elements::Value;
use super::header::{FrameIndex, Header, PixelEncoding, StoredRange};
use super::syntax::{Pixels, unread};
use super::{FORMAT, rle, stream};
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::hounsfield::{AIR, Scale};
use crate::import::number::ByteOrder;

/// A padding value is used only below the first or above the second of these, HU: between them tissue has such values.
const NO_TISSUE_HU: [f64; 2] = [-500.0, 4000.0];

/// An image in HU.
#[derive(Debug)]
pub(super) struct DecodedImage {
    /// Values row by row, HU.
    pub(super) hu: Vec<i16>,
    /// Number of padding pixels.
    pub(super) n_padding: u64,
    /// Scale of the stored numbers, with its counts of changed values.
    pub(super) scale: Scale,
}

/// The image in HU.
pub(super) fn hounsfield(header: &Header, value: &Value<'_>) -> Result<DecodedImage, ImportError> {
    let mut scale = Scale::new(header.encoding.slope, header.encoding.intercept);
    let n = header.columns.saturating_mul(header.rows);
    let packed = joined(value, header)?;
    let PixelEncoding { bits_allocated, bits_stored, high_bit, .. } = header.encoding;
    let (words, shift) = match header.syntax.pixels {
        // Decoders return the stored number itself, so that no shift is needed.
        Pixels::Stream => (stream::words(&packed, header.columns, header.rows)?, 0),
        Pixels::Rle => (
            rle::words(&packed, n, usize::from(bits_allocated / 8))?,
            high_bit.saturating_add(1).saturating_sub(bits_stored),
        ),
        Pixels::Plain => (plain(&packed, n, header)?, high_bit.saturating_add(1).saturating_sub(bits_stored)),
        Pixels::Unread(code) => return Err(malformed(FORMAT, unread(code))),
    };
    let padding = usable_padding(&header.encoding);
    // A padding value above the stored bits is cut to a value of tissue by them; only the whole word shows it.
    let whole = header.encoding.padding_word.filter(|_| padding.is_some() && is_whole(header));
    let mut n_padding = 0u64;
    let unused = 16u32.saturating_sub(u32::from(bits_stored));
    let hu = words.into_iter().map(|word| {
        // Shifts up to the top of the word and down again: this drops unused bits and extends the sign.
        let lifted = (word >> shift) << unused;
        let stored =
            if header.encoding.signed { i32::from(lifted as i16 >> unused) } else { i32::from(lifted >> unused) };
        if padding.is_some_and(|range| (range.min..=range.max).contains(&stored)) || whole == Some(word) {
            n_padding = n_padding.saturating_add(1);
            return AIR;
        }
        scale.apply(f64::from(stored))
    });
    let hu = hu.collect();
    Ok(DecodedImage { hu, n_padding, scale })
}

/// Whether the words hold all allocated bits.
fn is_whole(header: &Header) -> bool {
    matches!(header.syntax.pixels, Pixels::Plain | Pixels::Rle)
}

/// The padding range of an image, unless tissue has such values.
fn usable_padding(encoding: &PixelEncoding) -> Option<StoredRange> {
    let hu = |stored: i32| encoding.slope * f64::from(stored) + encoding.intercept;
    let padding = encoding.padding?;
    let [first, last] = [hu(padding.min), hu(padding.max)];
    let [air, metal] = NO_TISSUE_HU;
    (first.max(last) < air || first.min(last) > metal).then_some(padding)
}

/// Whether an image has a padding value that tissue has too.
pub(super) fn has_unusable_padding(encoding: &PixelEncoding) -> bool {
    encoding.padding.is_some() && usable_padding(encoding).is_none()
}

/// The bytes of the header's frame in the pixel data.
fn joined<'a>(value: &Value<'a>, header: &Header) -> Result<Cow<'a, [u8]>, ImportError> {
    let FrameIndex { index, n_frames } = header.frame;
    Ok(match value {
        Value::Bytes(bytes) => {
            let size = usize::from(header.encoding.bits_allocated / 8);
            let image = header.columns.saturating_mul(header.rows).saturating_mul(size);
            let (start, all) = (image.saturating_mul(index), image.saturating_mul(n_frames));
            // One byte may pad an odd length. More bytes show a wrong number of columns or rows, which would shear the image.
            if bytes.len() > all.saturating_add(1) {
                let (columns, rows) = (header.columns, header.rows);
                let detail =
                    format!("the pixels are {} bytes, expected {all} for {columns} x {rows} pixels", bytes.len());
                return Err(malformed(FORMAT, detail));
            }
            Cow::Borrowed(bytes.get(start..).unwrap_or_default())
        }
        Value::Fragments(parts) if n_frames > 1 => match parts.get(index) {
            Some(one) if parts.len() == n_frames => Cow::Borrowed(one),
            _ => {
                let detail = format!("{n_frames} frames are in {} fragments, expected one for each frame", parts.len());
                return Err(malformed(FORMAT, detail));
            }
        },
        Value::Fragments(parts) => match parts.as_slice() {
            [one] => Cow::Borrowed(one),
            many => Cow::Owned(many.concat()),
        },
        Value::Sequence(_) => Cow::Borrowed(&[]),
    })
}

fn plain(bytes: &[u8], n: usize, header: &Header) -> Result<Vec<u16>, ImportError> {
    let size = usize::from(header.encoding.bits_allocated / 8);
    let needed = n.saturating_mul(size);
    let Some(bytes) = bytes.get(..needed) else {
        let detail = format!("the pixels are {} bytes, expected {needed}", bytes.len());
        return Err(malformed(FORMAT, detail));
    };
    Ok(match (size, header.syntax.byte_order) {
        (1, _) => bytes.iter().map(|b| u16::from(*b)).collect(),
        (_, ByteOrder::Little) => bytes.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b)).collect(),
        (_, ByteOrder::Big) => bytes.as_chunks::<2>().0.iter().map(|b| u16::from_be_bytes(*b)).collect(),
    })
}
