//! Tests of NRRD and MetaImage with the lattice of the NIfTI tests.

use std::io::Write;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

use super::dicom::tests::{Slice, archive};
use super::hounsfield::Packing;
use super::number::ByteOrder;
use super::{ImportError, Limits, VolumeFormat, VolumeSettings, volume, volume_with};
use prosopon_geometry::{Point, Vector, Volume};

fn hu() -> Vec<i16> {
    (0..60).map(|i| i * 50 - 1000).collect()
}

fn expected() -> Volume {
    let axes = [Vector::new(0.0, 10.0, 0.0), Vector::new(-20.0, 0.0, 0.0), Vector::new(3.0, 0.0, 30.0)];
    Volume { dims: [3, 4, 5], origin: Point::new(1.5, -2.0, 3.0), axes, hu: hu() }
}

fn raw(order: ByteOrder) -> Vec<u8> {
    hu().iter().flat_map(|v| if order == ByteOrder::Big { v.to_be_bytes() } else { v.to_le_bytes() }).collect()
}

/// The lattice as an NRRD file; `space` is its name and the signs of its x and y.
pub(super) fn nrrd(encoding: &str, order: ByteOrder, space: (&str, f64, f64)) -> Vec<u8> {
    let (name, x, y) = space;
    let vector = |v: [f64; 3]| format!("({},{},{})", v[0] * x, v[1] * y, v[2]);
    let directions = [[0.0, 10.0, 0.0], [-20.0, 0.0, 0.0], [3.0, 0.0, 30.0]].map(vector).join(" ");
    let endian = if order == ByteOrder::Big { "big" } else { "little" };
    let origin = vector([1.5, -2.0, 3.0]);
    let head = format!(
        "NRRD0004\n# made by hand\ntype: short\ndimension: 3\nspace: {name}\nsizes: 3 4 5\nspace directions: {directions}\n\
         kinds: domain domain domain\nendian: {endian}\nencoding: {encoding}\nspace origin: {origin}\nPatientName:=NAME^OF\n\n"
    );
    let voxels = if encoding == "gzip" {
        let mut packer = GzEncoder::new(Vec::new(), Compression::fast());
        packer.write_all(&raw(order)).unwrap();
        packer.finish().unwrap()
    } else {
        raw(order)
    };
    [head.into_bytes(), voxels].concat()
}

/// The lattice as a MetaImage header with its voxels in `file`.
pub(super) fn meta_image(file: &str, order: ByteOrder, packing: Packing) -> (Vec<u8>, Vec<u8>) {
    let (big, packed) = (order == ByteOrder::Big, packing == Packing::Zlib);
    let head = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = {big}\nCompressedData = {packed}\n\
         TransformMatrix = 0 1 0 -1 0 0 0.09950371902099893 0 0.9950371902099893\nOffset = 1.5 -2 3\nCenterOfRotation = 0 0 0\n\
         AnatomicalOrientation = RAI\nElementSpacing = 10 20 30.14962686336267\nDimSize = 3 4 5\nElementType = MET_SHORT\nElementDataFile = {file}\n"
    )
    .replace("true", "True")
    .replace("false", "False");
    let mut packer = ZlibEncoder::new(Vec::new(), Compression::fast());
    packer.write_all(&raw(order)).unwrap();
    (head.into_bytes(), if packed { packer.finish().unwrap() } else { raw(order) })
}

fn check(found: &Volume, what: &str) {
    let expected = expected();
    assert_eq!((found.dims, &found.hu), (expected.dims, &expected.hu), "{what}");
    assert!((found.origin - expected.origin).norm() < 1e-9, "{what}");
    for (axis, expected) in found.axes.iter().zip(expected.axes) {
        assert!((axis - expected).norm() < 1e-9, "{what}: {axis}");
    }
}

#[test]
fn nrrd_in_every_space_and_encoding_is_the_same_volume() {
    for space in [("left-posterior-superior", 1.0, 1.0), ("RAS", -1.0, -1.0), ("left-anterior-superior", 1.0, -1.0)] {
        for encoding in ["raw", "gzip"] {
            for order in [ByteOrder::Little, ByteOrder::Big] {
                let (found, warnings) = volume(&nrrd(encoding, order, space), &Limits::default()).unwrap();
                check(&found, space.0);
                assert_eq!(warnings, []);
            }
        }
    }
}

#[test]
fn meta_image_attached_and_in_an_archive_is_the_same_volume() {
    for (order, packing) in
        [(ByteOrder::Little, Packing::Plain), (ByteOrder::Big, Packing::Plain), (ByteOrder::Little, Packing::Zlib)]
    {
        let (head, voxels) = meta_image("LOCAL", order, packing);
        check(&volume(&[head, voxels].concat(), &Limits::default()).unwrap().0, "mha");
        let (head, voxels) = meta_image("voxels.raw", order, packing);
        let apart = volume(&head, &Limits::default()).unwrap_err().to_string();
        assert!(apart.contains("in one zip archive"), "{apart}");
        let zip = archive(&[("a/head.mhd".to_owned(), head), ("a/voxels.raw".to_owned(), voxels)]);
        let found = volume_with(&zip, &Limits::default(), &Default::default()).unwrap();
        assert_eq!(found.format, VolumeFormat::MetaImage);
        check(&found.volume, "mhd");
    }
    let whole = nrrd("gzip", ByteOrder::Little, ("LPS", 1.0, 1.0));
    check(&volume(&archive(&[("x.nrrd".to_owned(), whole.clone())]), &Limits::default()).unwrap().0, "zip");
    let two = archive(&[("x.nrrd".to_owned(), whole.clone()), ("y.nrrd".to_owned(), whole)]);
    assert!(volume(&two, &Limits::default()).unwrap_err().to_string().contains("several volumes"));
}

#[test]
fn meta_image_fields_that_place_the_voxels_are_honoured() {
    let (head, voxels) = meta_image("LOCAL", ByteOrder::Little, Packing::Plain);
    let head = String::from_utf8(head).unwrap();
    let matrix = "TransformMatrix = 0 1 0 -1 0 0 0.09950371902099893 0 0.9950371902099893";
    let with = |from: &str, to: &str| {
        assert!(head.contains(from), "{from}");
        let bytes = [head.replacen(from, to, 1).as_bytes(), &voxels].concat();
        let (found, warnings) = volume(&bytes, &Limits::default()).unwrap();
        (found, warnings.iter().map(|w| w.code).collect::<Vec<_>>())
    };
    // `ElementSpacing` counts, wherever `ElementSize` stands.
    let (found, codes) = with("NDims = 3", "NDims = 3\nElementSize = 1 1 1");
    check(&found, "ElementSize first");
    assert_eq!(codes, ["anatomical-orientation-differs"]);
    check(&with("ElementSpacing", "ElementSize").0, "ElementSize alone");
    check(&with("BinaryData = True", "BinaryData = 1").0, "BinaryData = 1");
    check(&with("BinaryDataByteOrderMSB = False", "ElementByteOrderMSB = false").0, "ElementByteOrderMSB");
    assert_eq!(with("AnatomicalOrientation = RAI", "AnatomicalOrientation = ???").1, [] as [&str; 0]);
    assert_eq!(with("AnatomicalOrientation = RAI", "AnatomicalOrientation = ALI").1, [] as [&str; 0]);
    let (found, codes) = with(matrix, "TransformMatrix = 0 2 0 -1 0 0 0 0 1");
    assert!((found.axes[0] - Vector::new(0.0, 20.0, 0.0)).norm() < 1e-9);
    assert_eq!(codes[0], "directions-not-unit");
    // Without a matrix the letters say from where the axes come.
    let letters = format!("{matrix}\nOffset = 1.5 -2 3\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI");
    let (found, codes) = with(&letters, "Offset = 1.5 -2 3\nAnatomicalOrientation = ALS");
    assert_eq!(codes, ["no-orientation"]);
    let expected = [Vector::y() * 10.0, -Vector::x() * 20.0, -Vector::z() * 30.14962686336267];
    assert!(found.axes.iter().zip(expected).all(|(a, b)| (a - b).norm() < 1e-9), "{:?}", found.axes);
}

#[test]
fn meta_image_voxels_in_several_files_and_time_points_are_read() {
    let slices: Vec<Vec<u8>> = raw(ByteOrder::Little).chunks(24).map(<[u8]>::to_vec).collect();
    for (value, name) in [("s%02d.raw 1 5 1", "s0"), ("LIST\ns01.raw\ns02.raw\ns03.raw\ns04.raw\ns05.raw", "s0")] {
        let (head, _) = meta_image(value, ByteOrder::Little, Packing::Plain);
        let mut files = vec![("h.mhd".to_owned(), head)];
        files.extend(slices.iter().enumerate().map(|(k, slice)| (format!("{name}{}.raw", k + 1), slice.clone())));
        check(&volume(&archive(&files), &Limits::default()).unwrap().0, value);
        files[2].1.pop();
        let refused = volume(&archive(&files), &Limits::default()).unwrap_err().to_string();
        assert!(refused.contains("has 23 bytes, expected 24"), "{refused}");
    }
    let head = "ObjectType = Image\nNDims = 4\nBinaryData = True\nTransformMatrix = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n\
                Offset = 1 2 3 0\nElementSpacing = 10 20 30 1\nDimSize = 3 4 5 2\nElementType = MET_SHORT\n\
                ElementDataFile = LOCAL\n";
    let bytes = [head.as_bytes(), &raw(ByteOrder::Little), &raw(ByteOrder::Little)].concat();
    assert!(volume(&bytes, &Limits::default()).unwrap_err().to_string().contains("holds 2 volumes"));
    let settings = VolumeSettings { stack: Some(2), ..Default::default() };
    let found = volume_with(&bytes, &Limits::default(), &settings).unwrap();
    assert_eq!((found.volume.hu, found.volume.origin), (hu(), Point::new(1.0, 2.0, 3.0)));
}

#[test]
fn dicom_images_beside_another_volume_are_read_with_a_warning() {
    let mut files: Vec<(String, Vec<u8>)> =
        (0..5).map(|k| (format!("d{k}"), Slice::near(k, "1.2.840.10008.1.2.1").file())).collect();
    files.push(("x.nrrd".to_owned(), nrrd("raw", ByteOrder::Little, ("LPS", 1.0, 1.0))));
    let zip = archive(&files);
    let found = volume_with(&zip, &Limits::default(), &Default::default()).unwrap();
    assert_eq!(found.format, VolumeFormat::Dicom);
    let warning = &found.warnings[0];
    assert!(warning.code == "several-volumes" && warning.message.ends_with("volume 1: file 6, nrrd, 3 x 4 x 5 voxels"));
    let settings = VolumeSettings { volume: Some(1), ..Default::default() };
    check(&volume_with(&zip, &Limits::default(), &settings).unwrap().volume, "volume 1");
}

#[test]
fn faults_are_named() {
    let nrrd = String::from_utf8_lossy(&nrrd("raw", ByteOrder::Little, ("LPS", 1.0, 1.0))[..300]).into_owned();
    let meta = String::from_utf8(meta_image("LOCAL", ByteOrder::Little, Packing::Plain).0).unwrap();
    for (text, from, to, part) in [
        (&nrrd, "dimension: 3", "dimension: 2", "three dimensions"),
        (&nrrd, "sizes: 3 4 5", "sizes: 3 4", "three counts"),
        (&nrrd, "sizes: 3 4 5", "sizes: 3 4 0", "expected three dimensions of 2"),
        (&nrrd, "sizes: 3 4 5", "sizes: 3000 4000 5000", "at most"),
        (&nrrd, "sizes: 3 4 5", "sizes: 30 40 50", "can hold"),
        (&nrrd, "type: short", "type: block", "`type`"),
        (&nrrd, "endian: little", "endian: middle", "`endian`"),
        (&nrrd, "encoding: raw", "encoding: bzip2", "`encoding`"),
        (&nrrd, "space: LPS", "space: scanner-xyz", "`space`"),
        (&nrrd, "space: LPS", "data file: ../../secret", "separate file"),
        (&nrrd, "(0,10,0)", "(0,nan,0)", "`space directions`"),
        (&nrrd, "(0,10,0)", "(-40,0,0)", "in one plane"),
        (&nrrd, "\n\n", "\n", "empty line"),
        (&meta, "NDims = 3", "NDims = 2", "three dimensions"),
        (&meta, "DimSize = 3 4 5", "DimSize = 3 4 -5", "three counts"),
        (&meta, "DimSize = 3 4 5", "DimSize = 30000 30000 30000", "at most"),
        (&meta, "MET_SHORT", "MET_LONG_DOUBLE", "`ElementType`"),
        (&meta, "ElementSpacing = 10 20", "ElementSpacing = 10", "`ElementSpacing`"),
        (&meta, "BinaryData = True", "BinaryData = False", "binary"),
        (&meta, "= LOCAL", "= slices%03d.raw", "pattern with one `%d`"),
        (&meta, "CenterOfRotation = 0 0 0", "CenterOfRotation = 0 0 1", "CenterOfRotation"),
        (&meta, "CompressedData = False", "CompressedData = True\nHeaderSize = -1", "`HeaderSize = -1` with"),
        (&meta, "NDims = 3", "NDims = 3\nHeaderSize = 9999", "`HeaderSize` is negative or larger"),
        (&meta, "NDims = 3", "NDims = 3\nHeaderSize = -1", "more than the 0 bytes"),
    ] {
        assert!(text.contains(from), "{from}");
        let error = volume(text.replacen(from, to, 1).as_bytes(), &Limits::default()).unwrap_err();
        assert!(error.to_string().contains(part), "{to}: {error}");
        assert!(!matches!(error, ImportError::UnknownFormat { .. }));
    }
}

#[test]
fn the_voxels_may_be_the_last_bytes_of_their_file() {
    let (head, voxels) = meta_image("LOCAL", ByteOrder::Little, Packing::Plain);
    let head = String::from_utf8(head).unwrap().replacen("NDims = 3", "NDims = 3\nHeaderSize = -1", 1);
    let file = [head.as_bytes(), b"a header of another format", &voxels].concat();
    check(&volume(&file, &Limits::default()).unwrap().0, "HeaderSize = -1");
}

#[test]
fn the_largest_volume_of_doubles_may_come_in_an_archive() {
    // 327 680 numbers of eight bytes; an allowance of four bytes a voxel, with a header, is too small for them.
    let dims = [64, 64, 80];
    let limits = Limits { max_voxels: dims.iter().product(), ..Limits::default() };
    let head = "ObjectType = Image\nNDims = 3\nBinaryData = True\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\n\
         ElementSpacing = 2 2 2\nDimSize = 64 64 80\nElementType = MET_DOUBLE\nElementDataFile = v.raw\n";
    let voxels: Vec<u8> = (0..limits.max_voxels).flat_map(|_| (-1000.0f64).to_le_bytes()).collect();
    let zip = archive(&[("v.mhd".to_owned(), head.as_bytes().to_vec()), ("v.raw".to_owned(), voxels)]);
    assert_eq!(volume(&zip, &limits).unwrap().0.dims, dims);
}
