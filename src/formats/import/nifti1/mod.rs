//! Reads NIfTI-1 in one file, or a header with its voxels in another, plain or gzipped.
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
use super::hounsfield::{self, Packing, Scale, Selection, Voxels, bytes_after_voxels};
use super::lattice::{self, VoxelLattice};
use super::number::{ByteOrder, NumberFormat, NumberType};
use super::volume_settings::VolumeSettings;
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

/// The header's magic number when the voxels are in another file.
const PAIR: &[u8; 4] = b"ni1\0";

/// Whether these are the first bytes of a NIfTI file, unpacked.
pub(super) fn is_header(bytes: &[u8]) -> bool {
    looks_like(bytes) && !bytes.starts_with(&GZIP)
}

/// Whether the voxels of this header are in another file.
pub(super) fn is_pair(bytes: &[u8]) -> bool {
    let mut header = [0u8; HEADER as usize];
    unpacked(bytes).read_exact(&mut header).is_ok() && header.get(344..) == Some(PAIR)
}

/// The numbers of voxels that a header, packed or not, states along each axis, for messages.
pub(super) fn extent(bytes: &[u8]) -> Option<Vec<usize>> {
    let mut header = [0u8; HEADER as usize];
    unpacked(bytes).read_exact(&mut header).ok()?;
    let header = NiftiHeader::from_reader(&header[..]).ok()?;
    Some(header.dim().ok()?.iter().map(|d| usize::from(*d)).collect())
}

fn unpacked(bytes: &[u8]) -> Box<dyn Read + '_> {
    match packing_of(bytes) {
        Packing::Plain | Packing::Zlib => Box::new(bytes),
        Packing::Gzip => Box::new(MultiGzDecoder::new(bytes)),
    }
}

/// The checked content of the header.
struct CheckedHeader {
    header: NiftiHeader,
    dims: [usize; 3],
    n_voxels: usize,
    /// Volumes that follow one another.
    n_volumes: usize,
    number_type: NumberType,
    /// Byte of the first voxel.
    start: u64,
    /// Byte after the last voxel.
    end: u64,
    lattice: VoxelLattice,
}

/// Reads header and voxels of one file.
pub(super) fn read(
    bytes: &[u8],
    limits: &Limits,
    settings: &VolumeSettings,
    warnings: &mut Vec<Warning>,
) -> Result<Volume, ImportError> {
    let mut stream = unpacked(bytes);
    let header = read_header(&mut stream)?;
    let max_length = packing_of(bytes).max_unpacked(bytes.len() as u64);
    let checked = check_header(header, HEADER, max_length, limits, warnings)?;
    read_voxels(&mut stream, checked, HEADER, settings, warnings)
}

/// Reads the voxels in `voxels`, to which `header` belongs.
pub(super) fn read_pair(
    header: &[u8],
    voxels: &[u8],
    limits: &Limits,
    settings: &VolumeSettings,
    warnings: &mut Vec<Warning>,
) -> Result<Volume, ImportError> {
    let header = read_any_header(&mut unpacked(header))?;
    let max_length = packing_of(voxels).max_unpacked(voxels.len() as u64);
    let checked = check_header(header, 0, max_length, limits, warnings)?;
    read_voxels(&mut unpacked(voxels), checked, 0, settings, warnings)
}

/// Reads the voxels of a stream of which `read` bytes were read.
fn read_voxels(
    stream: &mut dyn Read,
    checked: CheckedHeader,
    read: u64,
    settings: &VolumeSettings,
    warnings: &mut Vec<Warning>,
) -> Result<Volume, ImportError> {
    let CheckedHeader { header, dims, n_voxels, n_volumes, number_type, start, end: _, lattice } = checked;
    let index = settings.stack_of(FORMAT, n_volumes)?;
    let skipped = std::io::copy(&mut (&mut *stream).take(start.saturating_sub(read)), &mut std::io::sink());
    skipped.map_err(|e| unreadable(&e))?;
    let byte_order = match header.endianness {
        Endianness::Little => ByteOrder::Little,
        Endianness::Big => ByteOrder::Big,
    };
    let (slope, intercept) = number_type::scale_of(&header)?;
    let (slope, intercept) = settings.rescale(slope, intercept);
    let voxels = Voxels {
        numbers: NumberFormat { number_type, byte_order },
        selection: Selection::following(n_voxels, index, n_volumes),
        scale: Scale::new(slope, intercept),
    };
    let hu = hounsfield::read(stream, voxels, warnings, unreadable)?;
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

/// Checks the header against the limits and the unpacked length of the file with the voxels, which is at most `max_length`; its
/// voxels begin at byte `first` or later.
fn check_header(
    header: NiftiHeader,
    first: u64,
    max_length: u64,
    limits: &Limits,
    warnings: &mut Vec<Warning>,
) -> Result<CheckedHeader, ImportError> {
    let (dims, n_volumes) = read_dims(&header)?;
    let n_voxels = lattice::n_voxels(FORMAT, dims, limits)?;

    let number_type = number_type::number_type_of(&header)?;
    let start = f64::from(header.vox_offset);
    if !(start >= first as f64 && start <= 1e9) {
        return Err(malformed(FORMAT, format!("the voxels start at byte {start:?}, expected 352 or more")));
    }
    let start = start as u64;
    let bytes = (n_voxels as u64).saturating_mul(n_volumes as u64).saturating_mul(number_type.size() as u64);
    let end = start.saturating_add(bytes);
    if end > max_length {
        let detail = format!("{n_voxels} voxels end at byte {end}, but the file has at most {max_length} bytes");
        return Err(malformed(FORMAT, detail));
    }

    let lattice = affine::read(&header, dims, warnings)?;
    lattice.check(FORMAT, dims, warnings)?;
    Ok(CheckedHeader { header, dims, n_voxels, n_volumes, number_type, start, end, lattice })
}

/// The header of a file that holds its voxels too.
fn read_header(stream: &mut dyn Read) -> Result<NiftiHeader, ImportError> {
    let header = read_any_header(stream)?;
    if &header.magic == PAIR {
        let detail = "header and voxels are in two files (.hdr, .img): send both in one zip archive";
        return Err(malformed(FORMAT, detail));
    }
    Ok(header)
}

fn read_any_header(stream: &mut dyn Read) -> Result<NiftiHeader, ImportError> {
    let mut bytes = [0u8; HEADER as usize];
    stream.read_exact(&mut bytes).map_err(|e| unreadable(&e))?;
    if bytes.starts_with(&540u32.to_le_bytes()) || bytes.starts_with(&540u32.to_be_bytes()) {
        return Err(malformed(FORMAT, "this is NIfTI-2, but only NIfTI-1 is supported"));
    }
    let header = NiftiHeader::from_reader(&bytes[..]).map_err(|_| malformed(FORMAT, "no NIfTI-1 header"))?;
    if header.sizeof_hdr != HEADER as i32 {
        return Err(malformed(FORMAT, format!("the header states {} bytes, expected {HEADER}", header.sizeof_hdr)));
    }
    Ok(header)
}

/// The voxels along each axis, and the number of volumes.
fn read_dims(header: &NiftiHeader) -> Result<([usize; 3], usize), ImportError> {
    let dims = header
        .dim()
        .map_err(|_| malformed(FORMAT, "the dimensions are out of range, expected 1 to 7 of at least 1"))?;
    let expected = "expected three dimensions, and a fourth for time points";
    match *dims {
        [i, j, k] => Ok(([i, j, k].map(usize::from), 1)),
        [i, j, k, t, ref more @ ..] if more.iter().all(|d| *d == 1) => Ok(([i, j, k].map(usize::from), usize::from(t))),
        [_, _, _, _, n, ..] => {
            Err(malformed(FORMAT, format!("{dims:?} voxels of {n} numbers (vectors or colours), {expected}")))
        }
        _ => Err(malformed(FORMAT, format!("{dims:?} voxels, {expected}"))),
    }
}

fn unreadable(error: &std::io::Error) -> ImportError {
    let detail = if error.kind() == ErrorKind::UnexpectedEof { "it is cut off" } else { "the gzip stream is damaged" };
    malformed(FORMAT, detail)
}
