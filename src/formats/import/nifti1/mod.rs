//! Reads NIfTI-1 in one file, plain or gzipped.
//!
//! The `nifti` crate reads the 348 bytes of the header. This module reads the voxels itself, because the crate allocates
//! whatever the header states and its affine panics on a negative spacing.

mod affine;
mod number_type;
mod scan;
#[cfg(test)]
pub(super) mod tests;

use std::io::{ErrorKind, Read};

use flate2::read::MultiGzDecoder;
use nifti::{Endianness, NiftiHeader};

pub(super) use scan::Scan;

use super::error::malformed;
use super::hounsfield::{self, Packing, bytes_after_voxels};
use super::lattice::{self, VoxelLattice};
use super::number::{ByteOrder, NumberFormat, NumberType};
use super::{ImportError, Limits};
use prosopon_geometry::{Volume, Warning};

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
struct CheckedHeader {
    header: NiftiHeader,
    dims: [usize; 3],
    n_voxels: usize,
    number_type: NumberType,
    /// Byte of the first voxel.
    start: u64,
    /// Byte after the last voxel.
    end: u64,
    lattice: VoxelLattice,
}

/// Reads header and voxels.
pub(super) fn read(bytes: &[u8], limits: &Limits, warnings: &mut Vec<Warning>) -> Result<Volume, ImportError> {
    let packing = packing_of(bytes);
    let mut stream: Box<dyn Read + '_> = match packing {
        Packing::Plain | Packing::Zlib => Box::new(bytes),
        Packing::Gzip => Box::new(MultiGzDecoder::new(bytes)),
    };
    let checked = check_header(&mut stream, packing.max_unpacked(bytes.len() as u64), limits, warnings)?;
    let CheckedHeader { header, dims, n_voxels, number_type, start, end: _, lattice } = checked;

    let skipped = std::io::copy(&mut (&mut stream).take(start.saturating_sub(HEADER)), &mut std::io::sink());
    skipped.map_err(|e| unreadable(&e))?;
    let byte_order = match header.endianness {
        Endianness::Little => ByteOrder::Little,
        Endianness::Big => ByteOrder::Big,
    };
    let scale = number_type::scale_of(&header)?;
    let numbers = NumberFormat { number_type, byte_order };
    let hu = hounsfield::read(&mut stream, numbers, n_voxels, scale, warnings, unreadable)?;
    // Reading to the end also verifies the checksum of a gzipped file.
    match stream.read(&mut [0]).map_err(|e| unreadable(&e))? {
        0 => {}
        _ => warnings.push(bytes_after_voxels()),
    }
    Ok(Volume { dims, origin: lattice.origin, axes: lattice.axes, hu })
}

fn packing_of(bytes: &[u8]) -> Packing {
    if bytes.starts_with(&GZIP) { Packing::Gzip } else { Packing::Plain }
}

/// Reads the header and checks it against the limits and the file's unpacked length, which is at most `max_length`.
fn check_header(
    stream: &mut dyn Read,
    max_length: u64,
    limits: &Limits,
    warnings: &mut Vec<Warning>,
) -> Result<CheckedHeader, ImportError> {
    let header = read_header(stream)?;
    let dims = read_dims(&header)?;
    let n_voxels = lattice::n_voxels(FORMAT, dims, limits)?;

    let number_type = number_type::number_type_of(&header)?;
    let start = f64::from(header.vox_offset);
    if !(start >= HEADER as f64 && start <= 1e9) {
        return Err(malformed(FORMAT, format!("the voxels start at byte {start:?}, expected 352 or more")));
    }
    let start = start as u64;
    let end = start.saturating_add((n_voxels as u64).saturating_mul(number_type.size() as u64));
    if end > max_length {
        let detail = format!("{n_voxels} voxels end at byte {end}, but the file has at most {max_length} bytes");
        return Err(malformed(FORMAT, detail));
    }

    let lattice = affine::read(&header, dims, warnings)?;
    lattice.check(FORMAT, dims, warnings)?;
    Ok(CheckedHeader { header, dims, n_voxels, number_type, start, end, lattice })
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
    match *dims {
        [i, j, k, ref more @ ..] if more.iter().all(|d| *d == 1) => Ok([i, j, k].map(usize::from)),
        _ => Err(malformed(FORMAT, format!("{dims:?} voxels, expected three dimensions"))),
    }
}

fn unreadable(error: &std::io::Error) -> ImportError {
    let detail = if error.kind() == ErrorKind::UnexpectedEof { "it is cut off" } else { "the gzip stream is damaged" };
    malformed(FORMAT, detail)
}
