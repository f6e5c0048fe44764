//! Decodes JPEG, JPEG-LS and JPEG 2000.
//!
//! Before a decoder runs, the header of the stream is checked against that of the image.

use std::panic::catch_unwind;

use super::FORMAT;
use crate::import::ImportError;
use crate::import::error::malformed;

/// Most tiles of a JPEG 2000 image; bounds the memory that its decoder allocates for them.
const MAX_TILES: u64 = 4096;

/// Decoder for a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Codec {
    /// Baseline, extended, progressive, lossless.
    Jpeg,
    JpegLs,
    Jpeg2000,
}

/// Header of the compressed stream.
#[derive(Debug, Clone, Copy)]
struct StreamHeader {
    codec: Codec,
    precision: u8,
    /// Whether numbers are signed; only JPEG 2000 has signed numbers.
    signed: bool,
    columns: u64,
    rows: u64,
    components: u64,
}

/// The stored words of one image of `columns` × `rows` pixels; negative numbers are two's complement of 16 bits.
pub(super) fn words(stream: &[u8], columns: usize, rows: usize) -> Result<Vec<u16>, ImportError> {
    let header = if stream.starts_with(&[0xff, 0xd8]) { jpeg_header(stream) } else { jpeg_2000_header(stream) };
    let header = header
        .ok_or_else(|| malformed(FORMAT, "the compressed pixels are not a supported JPEG or JPEG 2000 stream"))?;
    if (header.columns, header.rows, header.components) != (columns as u64, rows as u64, 1) {
        let StreamHeader { columns: c, rows: r, components, .. } = header;
        let detail = format!(
            "the compressed pixels are {c} x {r} with {components} components, but the image is {columns} x {rows} with 1"
        );
        return Err(malformed(FORMAT, detail));
    }
    // The decoders are memory-safe, but may panic on damaged streams.
    let words = catch_unwind(|| decode(stream, &header)).ok().flatten();
    let words = words.filter(|w| w.len() == columns.saturating_mul(rows));
    words.ok_or_else(|| malformed(FORMAT, format!("the compressed pixels ({:?}) are damaged", header.codec)))
}

fn decode(stream: &[u8], header: &StreamHeader) -> Option<Vec<u16>> {
    match header.codec {
        Codec::Jpeg => {
            let mut decoder = jpeg_decoder::Decoder::new(stream);
            let bytes = decoder.decode().ok()?;
            Some(match decoder.info()?.pixel_format {
                jpeg_decoder::PixelFormat::L8 => bytes.into_iter().map(u16::from).collect(),
                jpeg_decoder::PixelFormat::L16 => {
                    bytes.as_chunks::<2>().0.iter().map(|b| u16::from_ne_bytes(*b)).collect()
                }
                jpeg_decoder::PixelFormat::RGB24 | jpeg_decoder::PixelFormat::CMYK32 => return None,
            })
        }
        Codec::JpegLs => {
            let (words, ..) = jpegls::decode(stream, header.columns as u32, header.rows as u32).ok()?;
            Some(words)
        }
        Codec::Jpeg2000 => {
            let settings = dicom_toolkit_jpeg2000::DecodeSettings { strict: true, ..Default::default() };
            let image = dicom_toolkit_jpeg2000::Image::new(stream, &settings).ok()?;
            let bitmap = image.decode_native().ok()?;
            // The decoder adds half the range to signed numbers too; this subtracts it again.
            let lift = if header.signed { 1u16.checked_shl(u32::from(header.precision).saturating_sub(1))? } else { 0 };
            Some(match bitmap.bytes_per_sample {
                1 => bitmap.data.iter().map(|b| u16::from(*b).wrapping_sub(lift)).collect(),
                _ => bitmap.data.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b).wrapping_sub(lift)).collect(),
            })
        }
    }
}

/// The frame header among the segments of a JPEG or JPEG-LS stream.
fn jpeg_header(stream: &[u8]) -> Option<StreamHeader> {
    let mut rest = stream.get(2..)?;
    loop {
        let (&[lead, marker], after) = rest.split_first_chunk::<2>()?;
        if lead != 0xff {
            return None;
        }
        if marker == 0xff {
            rest = rest.get(1..)?;
            continue;
        }
        let length = usize::from(u16::from_be_bytes(*after.first_chunk::<2>()?));
        let codec = match marker {
            0xc0..=0xc3 => Codec::Jpeg,
            0xf7 => Codec::JpegLs,
            // A scan before any frame header, or a frame of an unsupported kind.
            0xda | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => return None,
            _ => {
                rest = after.get(length..)?;
                continue;
            }
        };
        let &[precision, y1, y0, x1, x0, components] = after.get(2..)?.first_chunk::<6>()?;
        return Some(StreamHeader {
            codec,
            precision,
            signed: false,
            columns: u64::from(u16::from_be_bytes([x1, x0])),
            rows: u64::from(u16::from_be_bytes([y1, y0])),
            components: u64::from(components),
        });
    }
}

/// The size segment of a JPEG 2000 code stream, bare or within a JP2 file.
fn jpeg_2000_header(stream: &[u8]) -> Option<StreamHeader> {
    const START: [u8; 4] = [0xff, 0x4f, 0xff, 0x51];
    const JP2: [u8; 8] = [0, 0, 0, 12, b'j', b'P', b' ', b' '];
    let beginning = stream.get(..stream.len().min(4096))?;
    let at = match stream {
        _ if stream.starts_with(&START) => 0,
        _ if stream.starts_with(&JP2) => beginning.windows(4).position(|w| w == START)?,
        _ => return None,
    };
    // Skips the two markers, the length and the capabilities.
    let size = stream.get(at.saturating_add(8)..)?;
    let number = |index: usize| {
        let bytes = size.get(index.saturating_mul(4)..)?.first_chunk::<4>()?;
        Some(u64::from(u32::from_be_bytes(*bytes)))
    };
    let extent = |a: usize| number(a)?.checked_sub(number(a.saturating_add(2))?);
    let tiles = |a: usize| {
        let tile = number(a.saturating_add(4)).filter(|t| *t > 0)?;
        number(a)?.checked_sub(number(a.saturating_add(6))?).map(|length| length.div_ceil(tile))
    };
    if tiles(0)?.checked_mul(tiles(1)?).is_none_or(|n| n > MAX_TILES) {
        return None;
    }
    let components = u16::from_be_bytes(*size.get(32..)?.first_chunk::<2>()?);
    let depth = *size.get(34)?;
    let precision = (depth & 0x7f).saturating_add(1);
    (precision <= 16).then_some(StreamHeader {
        codec: Codec::Jpeg2000,
        precision,
        signed: depth & 0x80 != 0,
        columns: extent(0)?,
        rows: extent(1)?,
        components: u64::from(components),
    })
}
