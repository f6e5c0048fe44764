//! Reads NIfTI-1 in one file, plain or gzipped.
//!
//! The `nifti` crate reads the 348 bytes of the header. This module reads the voxels itself, because the crate allocates
//! whatever the header states and its affine panics on a negative spacing.

mod frame;
mod kind;
mod scan;
#[cfg(test)]
pub(super) mod tests;

use std::io::{ErrorKind, Read};

use flate2::read::MultiGzDecoder;
use nifti::{Endianness, NiftiHeader};

pub(super) use scan::Scan;

use super::error::{at_most, malformed};
use super::hounsfield::{self, MAX_INFLATION};
use super::number::Kind;
use super::volume::check_extent;
use super::{ImportError, Limits};
use prosopon_geometry::{Point, Vector, Volume};

const FORMAT: &str = "NIfTI-1";
const HEADER: u64 = 348;
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Whether these may be the bytes of a NIfTI file; any gzip stream may, since the content shows only once it is unpacked.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let size = bytes.first_chunk::<4>();
    bytes.starts_with(&GZIP)
        || size.is_some_and(|b| [348u32, 540].iter().any(|n| n.to_le_bytes() == *b || n.to_be_bytes() == *b))
}

/// The checked content of the header.
struct Layout {
    header: NiftiHeader,
    dims: [usize; 3],
    n_voxels: usize,
    kind: Kind,
    /// Byte of the first voxel.
    start: u64,
    /// Byte after the last voxel.
    end: u64,
    origin: Point,
    axes: [Vector; 3],
}

/// Reads header and voxels.
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<(Volume, Vec<String>), ImportError> {
    let mut stream = unpacked(bytes);
    let mut warnings = Vec::new();
    let layout = read_layout(&mut stream, bytes.starts_with(&GZIP), bytes.len() as u64, limits, &mut warnings)?;
    let Layout { header, dims, n_voxels, kind, start, end: _, origin, axes } = layout;

    let skipped = std::io::copy(&mut (&mut stream).take(start.saturating_sub(HEADER)), &mut std::io::sink());
    skipped.map_err(|e| unreadable(&e))?;
    let little = header.endianness == Endianness::Little;
    let scale = kind::scale_of(&header)?;
    let hu = hounsfield::read(&mut stream, (kind, little), n_voxels, scale, &mut warnings, unreadable)?;
    // Reading to the end also verifies the checksum of a gzipped file.
    match stream.read(&mut [0]).map_err(|e| unreadable(&e))? {
        0 => {}
        _ => warnings.push("bytes after the last voxel were ignored".to_owned()),
    }
    Ok((Volume { dims, origin, axes, hu }, warnings))
}

fn unpacked(bytes: &[u8]) -> Box<dyn Read + '_> {
    if bytes.starts_with(&GZIP) { Box::new(MultiGzDecoder::new(bytes)) } else { Box::new(bytes) }
}

/// Reads the header and checks it against the limits and the file's `length`.
fn read_layout(
    stream: &mut dyn Read,
    zipped: bool,
    length: u64,
    limits: &Limits,
    warnings: &mut Vec<String>,
) -> Result<Layout, ImportError> {
    let header = read_header(stream)?;
    let dims = read_dims(&header)?;
    let n_voxels = dims.iter().fold(1u64, |n, d| n.saturating_mul(*d as u64));
    at_most("voxels", n_voxels, limits.max_voxels)?;

    let kind = kind::kind_of(&header)?;
    let start = f64::from(header.vox_offset);
    if !(start >= HEADER as f64 && start <= 1e9) {
        return Err(malformed(FORMAT, format!("the voxels start at byte {start:?}, expected 352 or more")));
    }
    let start = start as u64;
    let needed = start.saturating_add(n_voxels.saturating_mul(kind.size() as u64));
    if needed > length.saturating_mul(if zipped { MAX_INFLATION } else { 1 }) {
        let detail = format!("{n_voxels} voxels end at byte {needed}, which cannot be in a file of {length} bytes");
        return Err(malformed(FORMAT, detail));
    }

    let (origin, axes) = frame::read(&header, dims, warnings)?;
    check_extent(dims, &origin, &axes, warnings)?;
    Ok(Layout { header, dims, n_voxels: n_voxels as usize, kind, start, end: needed, origin, axes })
}

fn read_header(stream: &mut dyn Read) -> Result<NiftiHeader, ImportError> {
    let mut bytes = [0u8; HEADER as usize];
    stream.read_exact(&mut bytes).map_err(|e| unreadable(&e))?;
    if bytes.starts_with(&540u32.to_le_bytes()) || bytes.starts_with(&540u32.to_be_bytes()) {
        return Err(malformed(FORMAT, "this is NIfTI-2, but only NIfTI-1 is supported"));
    }
    let header = NiftiHeader::from_reader(&bytes[..]).map_err(|_| malformed(FORMAT, "no NIfTI-1 header"))?;
    if header.sizeof_hdr != HEADER as i32 {
        return Err(malformed(FORMAT, format!("the header states {} bytes, expected {HEADER}", header.sizeof_hdr)));
    }
    if &header.magic != nifti::header::MAGIC_CODE_NIP1 {
        return Err(malformed(FORMAT, "header and voxels are in two files (.hdr, .img), expected one (.nii)"));
    }
    Ok(header)
}

fn read_dims(header: &NiftiHeader) -> Result<[usize; 3], ImportError> {
    let dims = header
        .dim()
        .map_err(|_| malformed(FORMAT, "the dimensions are out of range, expected 1 to 7 of at least 1"))?;
    // The format stores sizes as signed 16-bit numbers.
    match *dims {
        [i, j, k, ref more @ ..]
            if [i, j, k].iter().all(|d| (2..=0x7fff).contains(d)) && more.iter().all(|d| *d == 1) =>
        {
            Ok([i, j, k].map(usize::from))
        }
        _ => Err(malformed(FORMAT, format!("{dims:?} voxels, expected three dimensions of 2 to 32767"))),
    }
}

fn unreadable(error: &std::io::Error) -> ImportError {
    let detail = if error.kind() == ErrorKind::UnexpectedEof { "it is cut off" } else { "the gzip stream is damaged" };
    malformed(FORMAT, detail)
}
