//! Reads MetaImage files: a text header, and voxels that are plain or compressed by zlib.
//!
//! The voxels follow the header (`.mha`) or are in a separate file (`.mhd`).
//!
//! Source: ITK, MetaIO documentation (itk.org/Wiki/MetaIO). ITK writes LPS; each row of `TransformMatrix` is one axis.

use super::detached::{Fetch, MAX_FILES, numbered};
use super::error::malformed;
use super::hounsfield::{self, Packing, Scale, Selection, Voxels};
use super::lattice::{self, VoxelLattice, lengths};
use super::number::{ByteOrder, NumberFormat, NumberType};
use super::volume_settings::VolumeSettings;
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

/// The numbers of voxels that the header states along each axis, for messages.
pub(super) fn extent(bytes: &[u8]) -> Option<Vec<usize>> {
    let (header, _) = split(bytes)?;
    let (_, sizes) = header.iter().find(|(key, _)| *key == "DimSize")?;
    sizes.split_whitespace().take(8).map(|size| size.parse().ok()).collect()
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
    let (header, attached) = split(bytes).ok_or_else(|| fault("the header names no `ElementDataFile`"))?;
    // The first name that the header has counts: `ElementSpacing` comes before `ElementSize`, as in ITK.
    let field = |names: &[&str]| {
        names.iter().find_map(|name| header.iter().find(|(key, _)| key == name).map(|(_, value)| *value))
    };
    let need = |name: &'static str| field(&[name]).ok_or_else(|| malformed(FORMAT, format!("there is no `{name}`")));
    let is_4d = match need("NDims")? {
        "3" => false,
        "4" => true,
        _ => return Err(fault("expected three dimensions, or four with time points")),
    };
    if field(&["ElementNumberOfChannels"]).is_some_and(|n| n != "1") {
        return Err(fault("the voxels are vectors or colours, expected one channel"));
    }
    let sizes = need("DimSize")?;
    let (dims, n_volumes) = match (is_4d, lattice::counts::<3>(sizes), lattice::counts::<4>(sizes)) {
        (false, Some(dims), _) => (dims, 1),
        (true, _, Some([i, j, k, t])) if t > 0 => ([i, j, k], t),
        _ => return Err(fault("`DimSize` are not three counts, or four with time points")),
    };
    let n = lattice::n_voxels(FORMAT, dims, limits)?;
    let number_type =
        number_type_of(need("ElementType")?).ok_or_else(|| fault("`ElementType` is not a supported number type"))?;
    let yes = |names: &[&str]| field(names).is_some_and(|v| v.starts_with(['T', 't', '1']));
    if field(&["BinaryData"]).is_some() && !yes(&["BinaryData"]) {
        return Err(fault("the voxels are text, expected binary"));
    }
    let is_big = yes(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]);
    let numbers = NumberFormat { number_type, byte_order: if is_big { ByteOrder::Big } else { ByteOrder::Little } };
    let packing = if yes(&["CompressedData"]) { Packing::Zlib } else { Packing::Plain };
    let lattice = read_lattice(&field, is_4d, warnings)?;
    lattice.check(FORMAT, dims, warnings)?;
    let selection = Selection::following(n, settings.stack_of(FORMAT, n_volumes)?, n_volumes);
    let (slope, intercept) = settings.rescale(1.0, 0.0);
    let voxels = Voxels { numbers, selection, scale: Scale::new(slope, intercept) };
    let needed = selection.total().saturating_mul(number_type.size());

    let fetched;
    let data = match need("ElementDataFile")? {
        name if name.eq_ignore_ascii_case("local") => attached,
        name => {
            let names = file_names(name, attached)?;
            fetched = fetched_files(&names, needed, fetch)?;
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
        Some(Ok(-1)) => data.get(data.len().saturating_sub(needed)..).unwrap_or_default(),
        Some(Ok(skip)) => usize::try_from(skip)
            .ok()
            .and_then(|skip| data.get(skip..))
            .ok_or_else(|| fault("`HeaderSize` is negative or larger than the file"))?,
        Some(Err(_)) => return Err(fault("`HeaderSize` is not a number")),
    };
    let hu = hounsfield::read_whole(FORMAT, data, packing, voxels, warnings)?;
    Ok(Volume { dims, origin: lattice.origin, axes: lattice.axes, hu })
}

/// The names of the voxel files: one, those of a pattern, or those that follow `LIST` line by line.
fn file_names(value: &str, after: &[u8]) -> Result<Vec<String>, ImportError> {
    if value.split_whitespace().next() == Some("LIST") {
        let lines = after.get(..after.len().min(MAX_HEADER)).unwrap_or_default().split(|b| *b == b'\n');
        let names = lines.filter_map(|line| std::str::from_utf8(line).ok()).map(str::trim);
        return Ok(names.filter(|name| !name.is_empty()).map(str::to_owned).collect());
    }
    if value.contains('%') {
        let names = numbered(value);
        let fault = "`ElementDataFile` is not a pattern with one `%d`, a first and a last number";
        return names.ok_or_else(|| malformed(FORMAT, fault));
    }
    Ok(vec![value.to_owned()])
}

/// The bytes of the files, one after another; of several each holds an equal part of `needed` bytes.
fn fetched_files(names: &[String], needed: usize, fetch: &mut Fetch<'_>) -> Result<Vec<u8>, ImportError> {
    let fault = |detail: &str| malformed(FORMAT, detail);
    if let [name] = names {
        return fetch(name).map_err(fault);
    }
    let share = needed.checked_div(names.len()).filter(|share| share.saturating_mul(names.len()) == needed);
    let Some(share) = share.filter(|_| names.len() <= MAX_FILES) else {
        let detail = format!("{} voxel files cannot hold equal parts of the volume", names.len());
        return Err(malformed(FORMAT, detail));
    };
    let mut bytes = Vec::new();
    for name in names {
        let file = fetch(name).map_err(fault)?;
        if file.len() != share {
            let detail = format!("one of the voxel files has {} bytes, expected {share}", file.len());
            return Err(malformed(FORMAT, detail));
        }
        bytes.extend_from_slice(&file);
    }
    Ok(bytes)
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
        "MET_LONG_LONG" => NumberType::I64,
        "MET_ULONG_LONG" => NumberType::U64,
        "MET_FLOAT" => NumberType::F32,
        "MET_DOUBLE" => NumberType::F64,
        _ => return None,
    })
}

#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn read_lattice<'a>(
    field: &dyn Fn(&[&str]) -> Option<&'a str>,
    is_4d: bool,
    warnings: &mut Vec<Warning>,
) -> Result<VoxelLattice, ImportError> {
    let fault = |name: &str| malformed(FORMAT, format!("`{name}` is missing or has the wrong number of values"));
    let three = |text: &str| {
        if is_4d { lattice::numbers::<4>(text).map(|[x, y, z, _]| [x, y, z]) } else { lattice::numbers::<3>(text) }
    };
    if field(&["CenterOfRotation"]).is_some_and(|v| three(v) != Some([0.0; 3])) {
        return Err(malformed(FORMAT, "a `CenterOfRotation` other than 0 0 0 is not supported"));
    }
    let spacing = field(&["ElementSpacing", "ElementSize"]).ok_or_else(|| fault("ElementSpacing"))?;
    let spacing = three(spacing).ok_or_else(|| fault("ElementSpacing"))?;
    let anatomical = field(&["AnatomicalOrientation"]).and_then(anatomical_axes);
    let directions = match (field(&["TransformMatrix", "Rotation", "Orientation"]), anatomical) {
        (Some(text), anatomical) => {
            let rows = matrix(text, is_4d).ok_or_else(|| fault("TransformMatrix"))?;
            warn_of_directions(rows, anatomical, warnings);
            rows
        }
        (None, Some(axes)) => {
            let found = "the header has no `TransformMatrix`; the directions of `AnatomicalOrientation` were used";
            warnings.push(Warning::check("no-orientation", found).act("Check left and right."));
            axes
        }
        (None, None) => {
            let found =
                "the header has no orientation; i was assumed to run to the patient's left, j to the back, k up";
            warnings.push(Warning::check("no-orientation", found).act("Check left and right."));
            [Vector::x(), Vector::y(), Vector::z()]
        }
    };
    let [a, b, c] = directions;
    let axes = [a * spacing[0], b * spacing[1], c * spacing[2]];
    let origin = match field(&["Offset", "Position", "Origin"]) {
        Some(text) => three(text).ok_or_else(|| fault("Offset"))?,
        None => [0.0; 3],
    };
    Ok(VoxelLattice { origin: Point::from(origin), axes })
}

/// The directions of the axes, the rows of the matrix; of four dimensions the first three.
fn matrix(text: &str, is_4d: bool) -> Option<[Vector; 3]> {
    if is_4d {
        let [ax, ay, az, _, bx, by, bz, _, cx, cy, cz, ..] = lattice::numbers::<16>(text)?;
        return Some([Vector::new(ax, ay, az), Vector::new(bx, by, bz), Vector::new(cx, cy, cz)]);
    }
    let [ax, ay, az, bx, by, bz, cx, cy, cz] = lattice::numbers::<9>(text)?;
    Some([Vector::new(ax, ay, az), Vector::new(bx, by, bz), Vector::new(cx, cy, cz)])
}

/// The directions that three letters name, which say from where each axis comes, as ITK writes them: `RAI` is LPS.
fn anatomical_axes(letters: &str) -> Option<[Vector; 3]> {
    let axis = |letter: u8| {
        Some(match letter {
            b'R' => Vector::x(),
            b'L' => Vector::new(-1.0, 0.0, 0.0),
            b'A' => Vector::y(),
            b'P' => Vector::new(0.0, -1.0, 0.0),
            b'I' => Vector::z(),
            b'S' => Vector::new(0.0, 0.0, -1.0),
            _ => return None,
        })
    };
    let [a, b, c] = *letters.as_bytes().as_array::<3>()?;
    let axes = [axis(a)?, axis(b)?, axis(c)?];
    (nalgebra::Matrix3::from_columns(&axes).determinant().abs() > 0.5).then_some(axes)
}

/// Warns of directions that are not of length 1, and notes letters that contradict them.
fn warn_of_directions(rows: [Vector; 3], anatomical: Option<[Vector; 3]>, warnings: &mut Vec<Warning>) {
    const ROUNDING: f64 = 1e-3;
    let norms = rows.map(|row| row.norm());
    if norms.iter().any(|norm| (norm - 1.0).abs() > ROUNDING) {
        let found = format!(
            "the rows of `TransformMatrix` have the lengths {}, not 1; they were multiplied with the spacing, as ITK does",
            lengths(norms).trim_end_matches(" mm")
        );
        warnings.push(Warning::check("directions-not-unit", found).act("Check the size of the head."));
    }
    // Half of the way to the next letter.
    let contradicts = |(row, axis): (&Vector, Vector)| row.dot(&axis) < 0.5 * row.norm();
    if anatomical.is_some_and(|axes| rows.iter().zip(axes).any(contradicts)) {
        let found = "`AnatomicalOrientation` contradicts `TransformMatrix`, which was used, as in ITK";
        warnings.push(Warning::info("anatomical-orientation-differs", found));
    }
}
