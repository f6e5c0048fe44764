//! Reads NRRD files: a header with its voxels, or with the names of the files that hold them.
//!
//! Source: Definition of NRRD File Format, teem.sourceforge.net/nrrd/format.html.

mod data;
mod header;
mod lattice;
#[cfg(test)]
mod tests;

use super::detached::Fetch;
use super::error::malformed;
use super::hounsfield::{self, Scale, Selection, Voxels};
use super::lattice::n_voxels;
use super::number::{ByteOrder, NumberFormat, NumberType};
use super::volume_settings::VolumeSettings;
use super::{ImportError, Limits};
use data::Encoding;
use header::Header;
use lattice::Axes;
use prosopon_geometry::{Volume, Warning};

const FORMAT: &str = "NRRD";

pub(super) fn looks_like(bytes: &[u8]) -> bool {
    bytes.starts_with(b"NRRD000")
}

/// The numbers of voxels that the header states along each axis, for messages.
pub(super) fn extent(bytes: &[u8]) -> Option<Vec<usize>> {
    let header = Header::read(bytes)?;
    let sizes = header.field(&["sizes"])?.split_whitespace().take(8);
    sizes.map(|size| size.parse().ok()).collect()
}

/// Reads header and voxels; `fetch` returns a voxel file by the name in the header.
pub(super) fn read(
    bytes: &[u8],
    limits: &Limits,
    settings: &VolumeSettings,
    fetch: &mut Fetch<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Volume, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    let header = Header::read(bytes).ok_or_else(|| fault("the header does not end with an empty line"))?;
    let need =
        |name: &'static str| header.field(&[name]).ok_or_else(|| malformed(FORMAT, format!("there is no `{name}`")));
    let axes = Axes::read(&header)?;
    let n = n_voxels(FORMAT, axes.dims, limits)?;
    let encoding = Encoding::of(need("encoding")?)?;
    let numbers = numbers(&header, need("type")?, encoding)?;
    let lattice = lattice::read(&header, axes, warnings)?;
    lattice.check(FORMAT, axes.dims, warnings)?;

    let index = settings.stack_of(FORMAT, axes.n)?;
    let selection = match axes.other {
        None => Selection::whole(n),
        Some(0) => Selection::interleaved(n, index, axes.n),
        Some(_) => Selection::following(n, index, axes.n),
    };
    let (slope, intercept) = settings.rescale(1.0, 0.0);
    let voxels = Voxels { numbers, selection, scale: Scale::new(slope, intercept) };
    let needed = selection.total().saturating_mul(numbers.number_type.size());
    let data = data::read(&header, encoding, needed, fetch)?;
    let hu = hounsfield::read_whole(FORMAT, &data.bytes, data.packing, voxels, warnings)?;
    Ok(Volume { dims: axes.dims, origin: lattice.origin, axes: lattice.axes, hu })
}

/// The numbers as [`data::read`] returns them: text becomes doubles.
fn numbers(header: &Header<'_>, name: &str, encoding: Encoding) -> Result<NumberFormat, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    let number_type =
        number_type_of(&name.to_ascii_lowercase()).ok_or_else(|| fault("`type` is not a supported number type"))?;
    if encoding == Encoding::Text {
        return Ok(NumberFormat { number_type: NumberType::F64, byte_order: ByteOrder::Little });
    }
    let byte_order = match header.field(&["endian"]).map(str::to_ascii_lowercase).as_deref() {
        Some("little") => ByteOrder::Little,
        Some("big") => ByteOrder::Big,
        None if number_type.size() == 1 => ByteOrder::Little,
        _ => return Err(fault("`endian` is neither little nor big")),
    };
    Ok(NumberFormat { number_type, byte_order })
}

fn number_type_of(name: &str) -> Option<NumberType> {
    Some(match name {
        "signed char" | "int8" | "int8_t" => NumberType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => NumberType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => NumberType::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => NumberType::U16,
        "int" | "signed int" | "int32" | "int32_t" => NumberType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => NumberType::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => NumberType::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => NumberType::U64,
        "float" => NumberType::F32,
        "double" => NumberType::F64,
        _ => return None,
    })
}
