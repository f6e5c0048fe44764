//! Reads MetaImage files: a text header, and voxels that are plain or compressed by zlib.
//!
//! The voxels follow the header (`.mha`) or are in a separate file (`.mhd`).
//!
//! Source: ITK, MetaIO documentation (itk.org/Wiki/MetaIO). ITK writes LPS; each row of `TransformMatrix` is one axis.

use super::error::malformed;
use super::hounsfield::{self, Packing};
use super::lattice::{self, VoxelLattice};
use super::number::{ByteOrder, NumberFormat, NumberType};
use super::{ImportError, Limits};
use prosopon_geometry::{Point, Vector, Volume, Warning};

const FORMAT: &str = "MetaImage";
/// Most bytes of a header.
const MAX_HEADER: usize = 1 << 16;

pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let line = bytes.split(|b| *b == b'\n').next().unwrap_or_default();
    let (key, value) = line.split_at(line.iter().position(|b| *b == b'=').unwrap_or(line.len()));
    !value.is_empty() && matches!(key.trim_ascii(), b"ObjectType" | b"NDims" | b"Comment")
}

/// Reads header and voxels; `fetch` returns the voxel file with the name in the header.
pub(super) fn read(
    bytes: &[u8],
    limits: &Limits,
    fetch: &mut dyn FnMut(&str) -> Result<Vec<u8>, &'static str>,
    warnings: &mut Vec<Warning>,
) -> Result<Volume, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    let (header, attached) = split(bytes).ok_or_else(|| fault("the header names no `ElementDataFile`"))?;
    let field = |names: &[&str]| {
        let mut fields = header.iter().filter(|(key, _)| names.contains(key));
        fields.next().map(|(_, value)| *value)
    };
    let need = |name: &'static str| field(&[name]).ok_or_else(|| malformed(FORMAT, format!("there is no `{name}`")));
    if need("NDims")? != "3" {
        return Err(fault("expected three dimensions"));
    }
    if field(&["ElementNumberOfChannels"]).is_some_and(|n| n != "1") {
        return Err(fault("expected one channel"));
    }
    let dims = lattice::counts::<3>(need("DimSize")?).ok_or_else(|| fault("`DimSize` are not three counts"))?;
    let n = lattice::n_voxels(FORMAT, dims, limits)?;
    let number_type =
        number_type_of(need("ElementType")?).ok_or_else(|| fault("`ElementType` is not a supported number type"))?;
    let yes = |names: &[&str]| field(names).is_some_and(|v| v.eq_ignore_ascii_case("true"));
    if field(&["BinaryData"]).is_some() && !yes(&["BinaryData"]) {
        return Err(fault("the voxels are text, expected binary"));
    }
    let is_big = yes(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]);
    let numbers = NumberFormat { number_type, byte_order: if is_big { ByteOrder::Big } else { ByteOrder::Little } };
    let packing = if yes(&["CompressedData"]) { Packing::Zlib } else { Packing::Plain };
    let lattice = read_lattice(&field, warnings)?;
    lattice.check(FORMAT, dims, warnings)?;

    let fetched;
    let data = match need("ElementDataFile")? {
        "LOCAL" | "local" => attached,
        "LIST" => return Err(fault("voxels in a list of files are not supported")),
        name if name.contains('%') => return Err(fault("voxels in a series of files are not supported")),
        name => {
            // The folder is dropped: only files of the same archive are read.
            let base = name.rsplit(['/', '\\']).next().unwrap_or_default();
            fetched = fetch(base).map_err(fault)?;
            fetched.as_slice()
        }
    };
    let data = match field(&["HeaderSize"]).map(str::parse::<i64>) {
        None | Some(Ok(0)) => data,
        // The voxels are the last bytes; the length of compressed voxels is not known.
        Some(Ok(-1)) if packing != Packing::Plain => {
            return Err(fault(
                "`HeaderSize = -1` with `CompressedData = True` is not supported; state the header's bytes",
            ));
        }
        Some(Ok(-1)) => {
            let needed = n.saturating_mul(number_type.size());
            data.get(data.len().saturating_sub(needed)..).unwrap_or_default()
        }
        Some(Ok(skip)) => usize::try_from(skip)
            .ok()
            .and_then(|skip| data.get(skip..))
            .ok_or_else(|| fault("`HeaderSize` is negative or larger than the file"))?,
        Some(Err(_)) => return Err(fault("`HeaderSize` is not a number")),
    };
    let hu = hounsfield::read_whole(FORMAT, data, packing, numbers, n, warnings)?;
    Ok(Volume { dims, origin: lattice.origin, axes: lattice.axes, hu })
}

/// Key and value of a line.
type Field<'a> = (&'a str, &'a str);

/// Keys and values up to `ElementDataFile`, and the bytes after its line.
fn split(bytes: &[u8]) -> Option<(Vec<Field<'_>>, &[u8])> {
    let mut rest = bytes.get(..bytes.len().min(MAX_HEADER))?;
    let mut fields = Vec::new();
    let mut read = 0usize;
    loop {
        let length = rest.iter().position(|b| *b == b'\n').map_or(rest.len(), |at| at.saturating_add(1));
        let (line, after) = rest.split_at(length);
        read = read.saturating_add(length);
        let (key, value) = std::str::from_utf8(line).ok()?.split_once('=')?;
        fields.push((key.trim(), value.trim()));
        if key.trim() == "ElementDataFile" {
            return Some((fields, bytes.get(read..)?));
        }
        rest = after;
    }
}

fn number_type_of(name: &str) -> Option<NumberType> {
    Some(match name {
        "MET_CHAR" => NumberType::I8,
        "MET_UCHAR" => NumberType::U8,
        "MET_SHORT" => NumberType::I16,
        "MET_USHORT" => NumberType::U16,
        "MET_INT" => NumberType::I32,
        "MET_UINT" => NumberType::U32,
        "MET_FLOAT" => NumberType::F32,
        "MET_DOUBLE" => NumberType::F64,
        _ => return None,
    })
}

#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn read_lattice<'a>(
    field: &dyn Fn(&[&str]) -> Option<&'a str>,
    warnings: &mut Vec<Warning>,
) -> Result<VoxelLattice, ImportError> {
    let fault = |name: &str| malformed(FORMAT, format!("`{name}` is missing or has the wrong number of values"));
    if field(&["CenterOfRotation"]).is_some_and(|v| lattice::numbers::<3>(v) != Some([0.0; 3])) {
        return Err(malformed(FORMAT, "a `CenterOfRotation` other than 0 0 0 is not supported"));
    }
    let spacing = field(&["ElementSpacing", "ElementSize"]).ok_or_else(|| fault("ElementSpacing"))?;
    let spacing = lattice::numbers::<3>(spacing).ok_or_else(|| fault("ElementSpacing"))?;
    let directions = match field(&["TransformMatrix", "Rotation", "Orientation"]) {
        Some(text) => lattice::numbers::<9>(text).ok_or_else(|| fault("TransformMatrix"))?,
        None => {
            let found =
                "the header has no orientation; i was assumed to run to the patient's left, j to the back, k up";
            warnings.push(Warning::check("no-orientation", found).act("Check left and right."));
            [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        }
    };
    let [ax, ay, az, bx, by, bz, cx, cy, cz] = directions;
    let axes = [
        Vector::new(ax, ay, az) * spacing[0],
        Vector::new(bx, by, bz) * spacing[1],
        Vector::new(cx, cy, cz) * spacing[2],
    ];
    let origin = match field(&["Offset", "Position", "Origin"]) {
        Some(text) => lattice::numbers::<3>(text).ok_or_else(|| fault("Offset"))?,
        None => [0.0; 3],
    };
    Ok(VoxelLattice { origin: Point::from(origin), axes })
}
