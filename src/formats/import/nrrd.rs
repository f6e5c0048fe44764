//! Reads NRRD files that hold header and voxels, raw or gzipped.
//!
//! Source: Definition of NRRD File Format, teem.sourceforge.net/nrrd/format.html.

use super::error::malformed;
use super::hounsfield::{self, Packing};
use super::lattice::{self, VoxelLattice};
use super::number::{ByteOrder, NumberFormat, NumberType};
use super::{ImportError, Limits};
use prosopon_geometry::{Point, Vector, Volume, Warning};

const FORMAT: &str = "NRRD";
/// Most bytes of a header.
const MAX_HEADER: usize = 1 << 16;

pub(super) fn looks_like(bytes: &[u8]) -> bool {
    bytes.starts_with(b"NRRD000")
}

/// Reads header and voxels.
pub(super) fn read(bytes: &[u8], limits: &Limits, warnings: &mut Vec<Warning>) -> Result<Volume, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    let (header, data) = split(bytes).ok_or_else(|| fault("the header does not end with an empty line"))?;
    let field = |names: &[&str]| {
        let line = header.lines().filter(|l| !l.starts_with('#')).filter_map(|l| l.split_once(": "));
        line.filter(|(name, _)| names.contains(&name.trim())).map(|(_, value)| value.trim()).next()
    };
    if field(&["data file", "datafile"]).is_some() {
        return Err(fault("the voxels are in a separate file, expected them after the header"));
    }
    let need = |names: &[&'static str]| {
        let name = names.first().copied().unwrap_or_default();
        field(names).ok_or_else(|| malformed(FORMAT, format!("there is no `{name}`")))
    };
    if need(&["dimension"])? != "3" {
        return Err(fault("expected three dimensions"));
    }
    let dims = lattice::counts::<3>(need(&["sizes"])?).ok_or_else(|| fault("`sizes` are not three counts"))?;
    let n = lattice::n_voxels(FORMAT, dims, limits)?;
    let number_type = number_type_of(need(&["type"])?).ok_or_else(|| fault("`type` is not a supported number type"))?;
    let byte_order = match field(&["endian"]) {
        Some("little") => ByteOrder::Little,
        Some("big") => ByteOrder::Big,
        None if number_type.size() == 1 => ByteOrder::Little,
        _ => return Err(fault("`endian` is neither little nor big")),
    };
    for skip in ["line skip", "lineskip", "byte skip", "byteskip"] {
        if field(&[skip]).is_some_and(|v| v != "0") {
            return Err(fault("`line skip` and `byte skip` other than 0 are not supported"));
        }
    }
    let lattice = read_lattice(&field, warnings)?;
    lattice.check(FORMAT, dims, warnings)?;

    let packing = match need(&["encoding"])? {
        "raw" => Packing::Plain,
        "gzip" | "gz" => Packing::Gzip,
        _ => return Err(fault("`encoding` is neither raw nor gzip")),
    };
    let numbers = NumberFormat { number_type, byte_order };
    let hu = hounsfield::read_whole(FORMAT, data, packing, numbers, n, warnings)?;
    Ok(Volume { dims, origin: lattice.origin, axes: lattice.axes, hu })
}

/// The header's text, and the bytes after the empty line that ends it.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let beginning = bytes.get(..bytes.len().min(MAX_HEADER))?;
    let end = |mark: &[u8]| {
        beginning.windows(mark.len()).position(|w| w == mark).map(|at| (at, at.saturating_add(mark.len())))
    };
    let (end, start) = match (end(b"\n\n"), end(b"\r\n\r\n")) {
        (Some(a), Some(b)) => a.min(b),
        (a, b) => a.or(b)?,
    };
    Some((std::str::from_utf8(bytes.get(..end)?).ok()?, bytes.get(start..)?))
}

fn number_type_of(name: &str) -> Option<NumberType> {
    Some(match name {
        "signed char" | "int8" | "int8_t" => NumberType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => NumberType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => NumberType::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => NumberType::U16,
        "int" | "signed int" | "int32" | "int32_t" => NumberType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => NumberType::U32,
        "float" => NumberType::F32,
        "double" => NumberType::F64,
        _ => return None,
    })
}

fn read_lattice<'a>(
    field: &dyn Fn(&[&str]) -> Option<&'a str>,
    warnings: &mut Vec<Warning>,
) -> Result<VoxelLattice, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    let signs = match field(&["space"]).map(str::to_ascii_lowercase).as_deref() {
        Some("left-posterior-superior" | "lps") => [1.0, 1.0],
        Some("right-anterior-superior" | "ras") => [-1.0, -1.0],
        Some("left-anterior-superior" | "las") => [1.0, -1.0],
        Some(_) => return Err(fault("`space` is not LPS, RAS or LAS")),
        None => {
            let found = "the header has no `space`; LPS was assumed, so left and right may be swapped";
            warnings.push(Warning::check("no-orientation", found).act("Check left and right."));
            [1.0, 1.0]
        }
    };
    let lps = |[x, y, z]: [f64; 3]| Vector::new(x * signs[0], y * signs[1], z).add_scalar(0.0);
    if let Some(units) = field(&["space units"])
        && !units.split_whitespace().all(|u| matches!(u.trim_matches('"'), "mm" | "millimeter" | "millimeters"))
    {
        return Err(fault("`space units` are not mm"));
    }
    let vector =
        |text: &str| lattice::numbers::<3>(&text.trim().strip_prefix('(')?.strip_suffix(')')?.replace(',', " "));
    let axes = match (field(&["space directions"]), field(&["spacings"])) {
        (Some(text), _) => {
            let found: Option<Vec<Vector>> = text.split_inclusive(')').take(4).map(|v| vector(v).map(lps)).collect();
            let found = found.and_then(|v| <[Vector; 3]>::try_from(v).ok());
            found.ok_or_else(|| fault("`space directions` are not three vectors"))?
        }
        (None, Some(text)) => {
            let [x, y, z] = lattice::numbers::<3>(text).ok_or_else(|| fault("`spacings` are not three numbers"))?;
            [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]].map(lps)
        }
        (None, None) => return Err(fault("there are neither `space directions` nor `spacings`")),
    };
    let origin = match field(&["space origin"]) {
        Some(text) => lps(vector(text).ok_or_else(|| fault("`space origin` is not a vector"))?),
        None => Vector::zeros(),
    };
    Ok(VoxelLattice { origin: Point::from(origin), axes })
}
