//! Forms of a volume.

use std::io::Write;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use prosopon_formats::export;
use prosopon_formats::import::{Limits, VolumeSettings, volume_with};
use prosopon_geometry::{Point, Vector, Volume};
use prosopon_planning::phantom;

use crate::dicom::{self, PLAIN, Series, Syntax, archive};

/// The same voxels with their axes in another order, some of them from the other end.
fn permuted(volume: &Volume, order: [usize; 3], flipped: [bool; 3]) -> Volume {
    let dims = order.map(|a| volume.dims[a]);
    let mut origin = volume.origin;
    let mut axes = [Vector::zeros(); 3];
    for (to, from) in order.into_iter().enumerate() {
        axes[to] = volume.axes[from];
        if flipped[to] {
            origin += volume.axes[from] * (volume.dims[from] - 1) as f64;
            axes[to] = -axes[to];
        }
    }
    let mut hu = Vec::with_capacity(volume.hu.len());
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let mut at = [0; 3];
                for (to, index) in [i, j, k].into_iter().enumerate() {
                    at[order[to]] = if flipped[to] { dims[to] - 1 - index } else { index };
                }
                hu.push(volume.hu[at[0] + volume.dims[0] * (at[1] + volume.dims[1] * at[2])]);
            }
        }
    }
    Volume { dims, origin, axes, hu }
}

fn gz(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Which transforms a NIfTI file states.
#[derive(Clone, Copy)]
struct Nifti {
    sform: bool,
    /// Only for volumes whose axes are along L, P and S.
    qform: bool,
    big_endian: bool,
    /// Stored as floats of half the value, with slope 2.
    scaled: bool,
}

const SFORM: Nifti = Nifti { sform: true, qform: false, big_endian: false, scaled: false };

fn nifti(volume: &Volume, form: Nifti) -> Vec<u8> {
    let mut header = vec![0u8; 352];
    let i16_at = |header: &mut Vec<u8>, at: usize, v: i16| {
        header[at..at + 2].copy_from_slice(&if form.big_endian { v.to_be_bytes() } else { v.to_le_bytes() });
    };
    let f32_bytes = |v: f32| if form.big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
    let size = 348i32;
    header[..4].copy_from_slice(&if form.big_endian { size.to_be_bytes() } else { size.to_le_bytes() });
    for (i, v) in
        [3, volume.dims[0] as i16, volume.dims[1] as i16, volume.dims[2] as i16, 1, 1, 1, 1].into_iter().enumerate()
    {
        i16_at(&mut header, 40 + 2 * i, v);
    }
    i16_at(&mut header, 70, if form.scaled { 16 } else { 4 });
    i16_at(&mut header, 72, if form.scaled { 32 } else { 16 });
    let mut f32_at = |at: usize, v: f64| header[at..at + 4].copy_from_slice(&f32_bytes(v as f32));
    f32_at(76, 1.0);
    for (i, axis) in volume.axes.iter().enumerate() {
        f32_at(80 + 4 * i, axis.norm());
    }
    f32_at(108, 352.0);
    f32_at(112, if form.scaled { 2.0 } else { 1.0 });
    if form.qform {
        // Half a turn about z leads from RAS to LPS.
        f32_at(264, 1.0);
        for (i, sign) in [-1.0, -1.0, 1.0].into_iter().enumerate() {
            f32_at(268 + 4 * i, sign * volume.origin[i]);
        }
    }
    if form.sform {
        for (row, sign) in [-1.0, -1.0, 1.0].into_iter().enumerate() {
            for (column, axis) in volume.axes.iter().enumerate() {
                f32_at(280 + 16 * row + 4 * column, sign * axis[row]);
            }
            f32_at(280 + 16 * row + 12, sign * volume.origin[row]);
        }
    }
    header[123] = 2;
    i16_at(&mut header, 252, i16::from(form.qform));
    i16_at(&mut header, 254, i16::from(form.sform));
    header[344..348].copy_from_slice(b"n+1\0");
    for v in &volume.hu {
        match (form.scaled, form.big_endian) {
            (true, _) => header.extend(f32_bytes(f32::from(*v) / 2.0)),
            (false, true) => header.extend(v.to_be_bytes()),
            (false, false) => header.extend(v.to_le_bytes()),
        }
    }
    header
}

fn little(volume: &Volume) -> Vec<u8> {
    volume.hu.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn vector(v: &[f64]) -> String {
    format!("({})", v.iter().map(|c| format!("{c:.6}")).collect::<Vec<_>>().join(","))
}

fn nrrd_header(volume: &Volume, ras: bool, encoding: &str, data_file: Option<&str>) -> String {
    let sign = if ras { [-1.0, -1.0, 1.0] } else { [1.0; 3] };
    let turned = |v: Vector| vector(&[sign[0] * v.x, sign[1] * v.y, sign[2] * v.z]);
    let [a, b, c] = volume.axes.map(turned);
    let [i, j, k] = volume.dims;
    let space = if ras { "right-anterior-superior" } else { "left-posterior-superior" };
    let data_file = data_file.map_or(String::new(), |name| format!("data file: {name}\n"));
    format!(
        "NRRD0004\ntype: short\ndimension: 3\nspace: {space}\nsizes: {i} {j} {k}\nspace directions: {a} {b} {c}\nkinds: domain domain \
         domain\nendian: little\nencoding: {encoding}\nspace origin: {}\n{data_file}\n",
        turned(volume.origin.coords)
    )
}

fn nrrd(volume: &Volume, ras: bool, encoding: &str) -> Vec<u8> {
    let mut file = nrrd_header(volume, ras, encoding, None).into_bytes();
    let voxels = little(volume);
    file.extend(if encoding == "gzip" { gz(&voxels) } else { voxels });
    file
}

fn meta_header(volume: &Volume, compressed: Option<usize>, data_file: &str) -> String {
    let [i, j, k] = volume.dims;
    let steps = volume.axes.map(|a| a.norm());
    let matrix: Vec<String> = volume
        .axes
        .iter()
        .zip(steps)
        .flat_map(|(a, s)| (a / s).iter().map(|c| format!("{c}")).collect::<Vec<_>>())
        .collect();
    let numbers = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let size = compressed.map_or(String::new(), |n| format!("CompressedDataSize = {n}\n"));
    format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = {}\n{size}TransformMatrix = \
         {}\nOffset = {}\nCenterOfRotation = 0 0 0\nElementSpacing = {}\nDimSize = {i} {j} {k}\nElementType = MET_SHORT\n\
         ElementDataFile = {data_file}\n",
        if compressed.is_some() { "True" } else { "False" },
        matrix.join(" "),
        numbers(volume.origin.coords.as_slice()),
        numbers(&steps),
    )
}

fn meta_image(volume: &Volume, compressed: bool) -> Vec<u8> {
    let mut voxels = little(volume);
    if compressed {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(&voxels).unwrap();
        voxels = encoder.finish().unwrap();
    }
    let mut file = meta_header(volume, compressed.then_some(voxels.len()), "LOCAL").into_bytes();
    file.extend(voxels);
    file
}

struct Form {
    name: &'static str,
    file: Vec<u8>,
    /// Codes of the findings that the file must cause, and no others.
    findings: &'static [&'static str],
}

fn form(name: &'static str, file: Vec<u8>, findings: &'static [&'static str]) -> Form {
    Form { name, file, findings }
}

fn forms(v: &Volume) -> Vec<Form> {
    let named = |name: &str, bytes: Vec<u8>| (name.to_owned(), bytes);
    let series = |change: fn(Series) -> Series| dicom::zipped(v, change(PLAIN));
    let plain = |form: Nifti| nifti(v, form);
    let turned = |order, flipped| permuted(v, order, flipped);
    vec![
        form("nifti as exported", export::nifti_gz(v).unwrap(), &[]),
        form("nifti by sform", plain(SFORM), &[]),
        form("nifti by sform, gzipped", gz(&plain(SFORM)), &[]),
        form("nifti by qform", plain(Nifti { sform: false, qform: true, ..SFORM }), &[]),
        form("nifti by both", plain(Nifti { qform: true, ..SFORM }), &[]),
        form("nifti big endian", plain(Nifti { big_endian: true, ..SFORM }), &[]),
        form("nifti of floats with a slope", plain(Nifti { scaled: true, ..SFORM }), &[]),
        form("nifti in RAS order", nifti(&turned([0, 1, 2], [true, true, false]), SFORM), &[]),
        form("nifti, axes swapped", nifti(&turned([2, 0, 1], [false, true, true]), SFORM), &[]),
        form("nrrd", nrrd(v, false, "raw"), &[]),
        form("nrrd gzipped", nrrd(v, false, "gzip"), &[]),
        form("nrrd in RAS", nrrd(v, true, "raw"), &[]),
        form("nrrd, axes swapped", nrrd(&turned([1, 2, 0], [true, false, false]), false, "gzip"), &[]),
        form(
            "nrrd detached, in a zip",
            archive(&[
                named("head.nhdr", nrrd_header(v, false, "gzip", Some("head.raw.gz")).into_bytes()),
                named("head.raw.gz", gz(&little(v))),
            ]),
            &[],
        ),
        form("metaimage", meta_image(v, false), &[]),
        form("metaimage compressed", meta_image(v, true), &[]),
        form("metaimage, axes swapped", meta_image(&turned([1, 0, 2], [false, false, true]), false), &[]),
        form(
            "metaimage detached, in a zip",
            archive(&[named("head.mhd", meta_header(v, None, "head.raw").into_bytes()), named("head.raw", little(v))]),
            &[],
        ),
        form("nifti in a zip", archive(&[named("head.nii", plain(SFORM))]), &[]),
        form("dicom", series(|s| s), &[]),
        form("dicom, files from the last", series(|s| Series { reversed_files: true, ..s }), &[]),
        form("dicom implicit", series(|s| Series { syntax: Syntax::Implicit, ..s }), &[]),
        form("dicom big endian", series(|s| Series { syntax: Syntax::Big, ..s }), &[]),
        form("dicom, a slope for each slice", series(|s| Series { slope_by_slice: true, ..s }), &[]),
        form("dicom with decimal commas", series(|s| Series { comma: true, ..s }), &["decimal-commas"]),
        form("dicom sagittal", dicom::zipped(&turned([1, 2, 0], [false, true, false]), PLAIN), &[]),
    ]
}

/// Compares voxel by voxel at equal positions, whatever the order of the axes.
fn check(name: &str, found: &Volume, expected: &Volume) {
    assert_eq!(found.hu.len(), expected.hu.len(), "{name}: voxels");
    let steps = expected.axes.map(|a| a.norm());
    let [i, j, _] = found.dims;
    for (index, value) in found.hu.iter().enumerate() {
        let at = [index % i, index / i % j, index / i / j].map(|c| c as f64);
        let p: Point = found.origin + found.axes[0] * at[0] + found.axes[1] * at[1] + found.axes[2] * at[2];
        let local = p - expected.origin;
        let place = [0, 1, 2].map(|a| local.dot(&expected.axes[a]) / (steps[a] * steps[a]));
        let nearest = place.map(f64::round);
        let off = (0..3).map(|a| (place[a] - nearest[a]).abs() * steps[a]).fold(0.0, f64::max);
        // Single precision of positions of 200 mm, over as many steps.
        assert!(off < 2e-3, "{name}: voxel {index} lies {off} mm beside the lattice");
        let [a, b, c] = nearest.map(|c| c as usize);
        let same = expected.hu[a + expected.dims[0] * (b + expected.dims[1] * c)];
        assert_eq!(*value, same, "{name}: voxel {index} at {p}");
    }
}

#[test]
fn every_form_of_a_volume_gives_the_same_voxels() {
    let mut volume = phantom::head().ct(7.0);
    // Multiples of 6 are exact with every slope of the table.
    volume.hu.iter_mut().for_each(|v| *v -= *v % 6);
    for Form { name, file, findings } in forms(&volume) {
        let read = volume_with(&file, &Limits::default(), &VolumeSettings::default())
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut codes: Vec<&str> = read.warnings.iter().map(|w| w.code).collect();
        codes.sort_unstable();
        assert_eq!(codes, findings, "{name}: {:?}", read.warnings);
        check(name, &read.volume, &volume);
    }
}
