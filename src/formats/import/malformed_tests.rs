//! Tests every reader with files that are cut off, changed or crafted.
//!
//! Each file must give an error or a mesh, never a panic.

use proptest::prelude::*;

use super::dicom::tests::{Slice, archive, series};
use super::hounsfield::Packing;
use super::nifti1::tests::File;
use super::number::ByteOrder;
use super::text_volumes_tests::{meta_image, nrrd};
use super::{ImportError, Limits, SurfaceFormat, detect_surface, surface, volume};
use prosopon_geometry::Severity;

const FORMATS: [SurfaceFormat; 4] = [SurfaceFormat::Stl, SurfaceFormat::Ply, SurfaceFormat::Obj, SurfaceFormat::Vtp];
const LIMITS: Limits = Limits { max_triangles: 1000, max_voxels: 100_000, max_cells: 1000 };

/// A tetrahedron of 100 mm in every format, and whether a shorter file shows that it was cut off.
pub(super) fn surfaces() -> Vec<(SurfaceFormat, Vec<u8>, bool)> {
    let points = [[0.0f32, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]];
    let triangles = [[0usize, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    let mut stl = b"solid, but binary".to_vec();
    stl.resize(80, 0);
    stl.extend(4u32.to_le_bytes());
    let mut text_stl = "solid a b\n".to_owned();
    let ply_header = |encoding: &str| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let mut text_ply = ply_header("ascii");
    let mut little_ply = ply_header("binary_little_endian").into_bytes();
    let mut big_ply = ply_header("binary_big_endian").into_bytes();
    let mut obj = "o a\n".to_owned();
    for [x, y, z] in points {
        text_ply += &format!("{x} {y} {z}\n");
        obj += &format!("v {x} {y} {z}\n");
        little_ply.extend([x, y, z].iter().flat_map(|c| c.to_le_bytes()));
        big_ply.extend([x, y, z].iter().flat_map(|c| c.to_be_bytes()));
    }
    for corners in triangles {
        let [a, b, c] = corners;
        text_ply += &format!("3 {a} {b} {c}\n");
        obj += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
        little_ply.push(3);
        big_ply.push(3);
        stl.extend([0; 12]);
        text_stl += "facet normal 0 0 0\nouter loop\n";
        for v in corners {
            little_ply.extend((v as i32).to_le_bytes());
            big_ply.extend((v as i32).to_be_bytes());
            let [x, y, z] = points[v];
            stl.extend([x, y, z].iter().flat_map(|c| c.to_le_bytes()));
            text_stl += &format!("vertex {x} {y} {z}\n");
        }
        stl.extend([0; 2]);
        text_stl += "endloop\nendfacet\n";
    }
    text_stl += "endsolid";
    let vtp = "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\"><PolyData>\
        <Piece NumberOfPoints=\"4\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"1\" NumberOfPolys=\"2\">\
        <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 100 0 0 0 100 0 0 0 100</DataArray></Points>\
        <Polys><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 2 1 0 1 3</DataArray>\
        <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">3 6</DataArray></Polys>\
        <Strips><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">1 2 3 0</DataArray>\
        <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">4</DataArray></Strips></Piece></PolyData></VTKFile>";
    vec![
        (SurfaceFormat::Vtp, vtp.as_bytes().to_vec(), true),
        (SurfaceFormat::Stl, stl, true),
        (SurfaceFormat::Stl, text_stl.into_bytes(), true),
        (SurfaceFormat::Ply, little_ply, true),
        (SurfaceFormat::Ply, big_ply, true),
        (SurfaceFormat::Ply, text_ply.trim_end().as_bytes().to_vec(), false),
        (SurfaceFormat::Obj, obj.into_bytes(), false),
    ]
}

pub(super) fn volumes() -> Vec<Vec<u8>> {
    [ByteOrder::Little, ByteOrder::Big].map(File::new).iter().flat_map(|file| [file.plain(), file.gzipped()]).collect()
}

/// Volumes in every other format.
pub(super) fn other_volumes() -> Vec<Vec<u8>> {
    let slices = [
        "1.2.840.10008.1.2",
        "1.2.840.10008.1.2.1.99",
        "1.2.840.10008.1.2.5",
        "1.2.840.10008.1.2.4.80",
        "1.2.840.10008.1.2.4.90",
    ]
    .map(|syntax| series(&(0..5).map(|k| Slice::near(k, syntax)).collect::<Vec<_>>()));
    let space = ("LPS", 1.0, 1.0);
    let (head, voxels) = meta_image("LOCAL", ByteOrder::Little, Packing::Zlib);
    let (apart, raw) = meta_image("v.raw", ByteOrder::Little, Packing::Plain);
    let mut all = slices.to_vec();
    all.extend([
        nrrd("raw", ByteOrder::Little, space),
        nrrd("gzip", ByteOrder::Big, space),
        [head, voxels].concat(),
        archive(&[("h.mhd".to_owned(), apart), ("v.raw".to_owned(), raw)]),
        Slice::near(0, "1.2.840.10008.1.2.1").file(),
    ]);
    all
}

/// Pseudo-random numbers, the same on every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((self.0 >> 33) as usize) % n.max(1)
    }
}

/// A file, whether a shortened file must be refused, and its reader, which returns the text of an error.
type Sound = (Vec<u8>, bool, Box<dyn Fn(&[u8]) -> Result<(), String>>);

/// Files of every format.
fn readers() -> Vec<Sound> {
    let mut all: Vec<Sound> = Vec::new();
    for (format, bytes, ends) in surfaces() {
        let read = move |b: &[u8]| surface(b, format, &LIMITS).map(|_| ()).map_err(|e| e.to_string());
        all.push((bytes, ends, Box::new(read)));
    }
    for bytes in volumes().into_iter().chain(other_volumes()) {
        all.push((bytes, true, Box::new(|b| volume(b, &LIMITS).map(|_| ()).map_err(|e| e.to_string()))));
    }
    all
}

#[test]
fn five_hundred_damaged_files_are_errors_or_whole_volumes_and_surfaces() {
    let readers = readers();
    let mut dice = Dice(7);
    let mut refused = [0usize; 4];
    let mut n = 0usize;
    for (at, (bytes, ends, read)) in readers.iter().enumerate() {
        read(bytes).unwrap_or_else(|e| panic!("file {at} is sound, but {e}"));
        let mut judge = |kind: usize, damaged: &[u8], must: bool| {
            n += 1;
            match read(damaged) {
                Err(text) => {
                    refused[kind] += 1;
                    assert!(text.len() > 10 && !text.contains("PATIENT"), "{text}");
                }
                Ok(()) => assert!(!must, "file {at} with damage of kind {kind} was read"),
            }
        };
        // Cut off.
        for _ in 0..10 {
            judge(0, &bytes[..dice.below(bytes.len())], *ends);
        }
        // Single bits: one may hit a voxel or a coordinate, which then has another valid value.
        for _ in 0..10 {
            let mut damaged = bytes.clone();
            for _ in 0..=dice.below(4) {
                let byte = dice.below(bytes.len());
                damaged[byte] ^= 1 << dice.below(8);
            }
            judge(1, &damaged, false);
        }
        // Runs of the largest numbers, as counts, lengths and offsets.
        for _ in 0..5 {
            let mut damaged = bytes.clone();
            let from = dice.below(bytes.len().min(400));
            let to = (from + [1, 2, 4, 8][dice.below(4)]).min(bytes.len());
            let digit = damaged[from].is_ascii_digit();
            damaged[from..to].fill(if digit { b'9' } else { 0xff });
            judge(2, &damaged, false);
        }
        // Mislabelled files: the beginning of one format before the rest of another.
        for _ in 0..3 {
            let (other, ..) = &readers[(at + 1 + dice.below(readers.len() - 1)) % readers.len()];
            let head = 16.min(other.len());
            if bytes.get(..head) != Some(&other[..head]) {
                judge(3, &[&other[..head], &bytes[head.min(bytes.len())..]].concat(), false);
            }
        }
    }
    assert!(n >= 500, "{n}");
    // Most damage is found; the rest changed only values.
    assert!(refused[0] >= 180 && refused[1] >= 60 && refused[2] >= 40 && refused[3] >= 40, "{refused:?} of {n}");
}

#[test]
fn every_format_is_recognised_and_read_to_the_same_tetrahedron() {
    for (format, bytes, _) in surfaces() {
        assert_eq!(detect_surface(&bytes), Some(format));
        let (mesh, warnings) = surface(&bytes, format, &LIMITS).unwrap();
        assert_eq!(warnings, []);
        assert_eq!(mesh.positions().len(), 4);
        assert!((mesh.volume() - 1e6 / 6.0).abs() < 1e-6);
    }
    assert_eq!(detect_surface(b"hello"), None);
    assert!(matches!(surface(b"", SurfaceFormat::Obj, &LIMITS), Err(ImportError::Empty)));
    assert!(matches!(volume(b"hello", &LIMITS), Err(ImportError::UnknownFormat { .. })));
}

#[test]
fn a_file_cut_off_anywhere_is_refused() {
    for (format, bytes, ends) in surfaces() {
        for length in 0..bytes.len() {
            let result = surface(&bytes[..length], format, &LIMITS);
            assert!(result.is_err() || !ends, "{format:?} read {length} of {} bytes", bytes.len());
        }
    }
    for bytes in volumes() {
        for length in 0..bytes.len() {
            assert!(volume(&bytes[..length], &LIMITS).is_err(), "read {length} of {} bytes", bytes.len());
        }
    }
}

#[test]
fn counts_that_no_file_could_hold_are_refused() {
    let mut stl = vec![0; 84];
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(matches!(surface(&stl, SurfaceFormat::Stl, &LIMITS), Err(ImportError::TooLarge { .. })));
    let all = Limits { max_triangles: usize::MAX, max_voxels: usize::MAX, max_cells: usize::MAX };
    assert!(matches!(surface(&stl, SurfaceFormat::Stl, &all), Err(ImportError::Malformed { .. })));

    let count = u64::MAX;
    for encoding in ["ascii", "binary_little_endian"] {
        let ply = |other: u64, vertex: u64, face: u64| {
            format!(
                "ply\nformat {encoding} 1.0\nelement none {other}\nelement vertex {vertex}\nproperty float x\nproperty float y\nproperty float z\nelement face {face}\nproperty list uint int vertex_indices\nend_header\n"
            )
        };
        for text in [ply(0, count, 1), ply(0, 1, count), ply(0, count / 12 + 1, 1)] {
            assert!(matches!(surface(text.as_bytes(), SurfaceFormat::Ply, &all), Err(ImportError::Malformed { .. })));
            assert!(surface(text.as_bytes(), SurfaceFormat::Ply, &LIMITS).is_err());
        }
        // An element without properties has no bytes: any count fits, and the reader must not loop over it.
        assert!(surface(ply(count, 0, 0).as_bytes(), SurfaceFormat::Ply, &all).is_err());
    }
    let list = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar x\nproperty uchar y\nproperty uchar z\nelement face 1\nproperty list uint int vertex_indices\nend_header\n\0\0\0\xff\xff\xff\xff";
    assert!(matches!(surface(list, SurfaceFormat::Ply, &all), Err(ImportError::Malformed { .. })));
}

#[test]
fn more_triangles_than_allowed_are_refused_in_every_format() {
    let three = Limits { max_triangles: 3, ..LIMITS };
    for (format, bytes, _) in surfaces() {
        assert!(matches!(surface(&bytes, format, &three), Err(ImportError::TooLarge { .. })), "{format:?}");
    }
}

#[test]
fn degenerate_triangles_unused_vertices_and_sizes_give_a_warning_or_are_refused() {
    let obj = |scale: f64, faces: &str| {
        let mut text = String::new();
        for [x, y, z] in [[0., 0., 0.], [1., 0., 0.], [9., 9., 9.], [0., 1., 0.], [0., 0., 1.]] {
            text += &format!("v {} {} {}\n", x * scale, y * scale, z * scale);
        }
        surface((text + faces).as_bytes(), SurfaceFormat::Obj, &LIMITS)
    };
    let (mesh, warnings) = obj(100.0, "f 1 4 2\nf 1 1 2\nf 1 2 5\nf 4 5\n").unwrap();
    assert_eq!(mesh.triangles(), [[0, 2, 1], [0, 1, 3]]);
    let codes: Vec<&str> = warnings.iter().map(|w| w.code).collect();
    assert_eq!(codes, ["faces-left-out", "repeated-vertices", "unused-vertices"]);
    assert!(warnings.iter().all(|w| w.severity == Severity::Info && w.message.starts_with("1 ")), "{warnings:?}");
    assert!(matches!(obj(100.0, "f 1 1 2\n"), Err(ImportError::Geometry(_))));
    assert!(obj(10.0, "f 1 2 4\n").unwrap().1[1].code == "unusual-size");
    assert!(obj(1200.0, "f 1 2 4\n").unwrap().1[1].code == "unusual-size");
    assert!(matches!(obj(2000.0, "f 1 2 4\n"), Err(ImportError::ImplausibleSize { .. })));
    assert!(matches!(obj(0.1, "f 1 2 4\n"), Err(ImportError::ImplausibleSize { .. })));
    assert!(matches!(obj(1e5, "f 1 2 4\n"), Err(ImportError::ImplausibleSize { .. })));
    assert!(matches!(obj(f64::MAX, "f 1 2 4\n"), Err(ImportError::ImplausibleSize { .. })));
}

#[test]
fn faults_in_stl_are_named_with_their_place() {
    let read = |bytes: &[u8]| surface(bytes, SurfaceFormat::Stl, &LIMITS);
    let (_, mut stl, _) = surfaces().remove(1);
    stl[84 + 50 + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(read(&stl).unwrap_err().to_string().contains("triangle 1 has a coordinate that is not finite"));
    let (_, mut stl, _) = surfaces().remove(1);
    stl[..5].copy_from_slice(b"Solid");
    stl.push(0);
    assert_eq!(detect_surface(&stl), Some(SurfaceFormat::Stl));
    assert_eq!(read(&stl).unwrap().1[0].code, "bytes-after-triangles");
    let (_, text, _) = surfaces().remove(2);
    let text = String::from_utf8(text).unwrap();
    for (from, to, part) in [
        ("vertex 100 0 0", "vertex 100 0 inf", "line 6: expected a finite number"),
        ("outer loop", "outer", "line 4: expected `loop`"),
        ("endsolid", "end", "expected `facet` or `endsolid`"),
    ] {
        let error = read(text.replacen(from, to, 1).as_bytes()).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    // Upper case, two solids, and a first line of one word.
    let twice = format!("{text}\n{}", text.replace("solid a b", "solid")).to_uppercase();
    let (mesh, warnings) = read(twice.as_bytes()).unwrap();
    // The second solid repeats the first.
    assert_eq!((mesh.triangles().len(), warnings[0].code), (4, "repeated-triangles"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn made_up_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..600), start in 0usize..8) {
        const STARTS: [&[u8]; 8] = [
            b"", b"solid a\nfacet normal", b"ply\nformat binary_little_endian 1.0\n", b"v 1 2 3\nf ", b"\x1f\x8b\x08",
            b"\x5c\x01\x00\x00", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n", b"\x00\x00\x01\x5c",
        ];
        let bytes = [STARTS[start], &bytes].concat();
        let _ = detect_surface(&bytes);
        for format in FORMATS {
            let _ = surface(&bytes, format, &LIMITS);
        }
        let _ = volume(&bytes, &LIMITS);
    }

    #[test]
    fn changed_files_never_panic(
        which in 0usize..11,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0u8..3), 1..8),
    ) {
        let mut files: Vec<(Option<SurfaceFormat>, Vec<u8>)> =
            surfaces().into_iter().map(|(format, bytes, _)| (Some(format), bytes)).collect();
        files.extend(volumes().into_iter().map(|bytes| (None, bytes)));
        let (format, mut bytes) = files.swap_remove(which);
        for (at, value, kind) in changes {
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = value,
                1 => bytes.insert(at, value),
                _ => drop(bytes.splice(at..(at + usize::from(value % 9)).min(bytes.len()), [])),
            }
            if bytes.is_empty() {
                break;
            }
        }
        let _ = match format {
            Some(format) => surface(&bytes, format, &LIMITS).is_ok(),
            None => volume(&bytes, &LIMITS).is_ok(),
        };
    }
}
