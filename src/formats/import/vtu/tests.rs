use std::io::Write;

use super::*;
use crate::import::number::ByteOrder;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use proptest::prelude::*;

const LIMITS: Limits = Limits { max_triangles: 1000, max_voxels: 1000, max_cells: 1000 };

/// Encoding of the arrays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::import) enum Encoding {
    Ascii,
    Base64,
    /// With each part padded on its own, as VTK and meshio write compressed data.
    Zlib {
        block: usize,
    },
    RawAppended,
    Base64Appended,
}

fn number_bytes(kind: &str, value: f64, order: ByteOrder) -> Vec<u8> {
    let mut bytes = match kind {
        "Float64" => value.to_le_bytes().to_vec(),
        "Float32" => (value as f32).to_le_bytes().to_vec(),
        "Int64" => (value as i64).to_le_bytes().to_vec(),
        "Int32" => (value as i32).to_le_bytes().to_vec(),
        _ => vec![value as u8],
    };
    if order == ByteOrder::Big {
        bytes.reverse();
    }
    bytes
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut packer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    packer.write_all(bytes).unwrap();
    packer.finish().unwrap()
}

/// Two tetrahedra and a wedge, with a triangle among them, as a file.
pub(in crate::import) fn file(encoding: Encoding, order: ByteOrder, wide: bool) -> Vec<u8> {
    let mut appended: Vec<u8> = Vec::new();
    let count = |n: usize| -> Vec<u8> {
        let mut bytes = if wide { (n as u64).to_le_bytes().to_vec() } else { (n as u32).to_le_bytes().to_vec() };
        if order == ByteOrder::Big {
            bytes.reverse();
        }
        bytes
    };
    let mut array = |kind: &str, name: &str, components: usize, values: &[f64]| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| number_bytes(kind, *v, order)).collect();
        let head = format!("<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\"");
        let with_length = [count(bytes.len()), bytes.clone()].concat();
        match encoding {
            Encoding::Ascii => {
                let words: Vec<String> = values.iter().map(f64::to_string).collect();
                format!("{head} format=\"ascii\">\n{}\n</DataArray>", words.join(" "))
            }
            Encoding::Base64 => format!("{head} format=\"binary\">\n{}</DataArray>", STANDARD.encode(with_length)),
            Encoding::Zlib { block } => {
                let blocks: Vec<Vec<u8>> = bytes.chunks(block).map(zlib).collect();
                let last = bytes.len() % block;
                let mut header = [count(blocks.len()), count(block), count(last)].concat();
                blocks.iter().for_each(|b| header.extend(count(b.len())));
                let (header, blocks) = (STANDARD.encode(header), STANDARD.encode(blocks.concat()));
                format!("{head} format=\"binary\">{header}{blocks}</DataArray>")
            }
            Encoding::RawAppended | Encoding::Base64Appended => {
                let offset = appended.len();
                if encoding == Encoding::RawAppended {
                    appended.extend(with_length);
                } else {
                    appended.extend(STANDARD.encode(with_length).bytes());
                }
                format!("{head} format=\"appended\" offset=\"{offset}\"/>")
            }
        }
    };
    let x = [0., 0., 0., 50., 0., 0., 0., 50., 0., 0., 0., 50., 50., 0., 50., 0., 50., 50.5, 7., -20., 3.];
    let parts = [
        "<Points>".into(),
        array("Float64", "Points", 3, &x),
        "</Points><Cells>".into(),
        array("Int64", "connectivity", 1, &[0., 1., 2., 3., 4., 5., 1., 2., 3., 0., 1., 2., 6., 3., 1., 4., 6.]),
        array("Int32", "offsets", 1, &[6., 9., 13., 17.]),
        array("UInt8", "types", 1, &[13., 5., 10., 10.]),
        "</Cells><PointData>".into(),
        array("Int32", "attachment", 1, &[-1., 0., 1., -2., 2., 3., -1.]),
        array("Float32", "force_n", 3, &[0.5; 21]),
        "</PointData><CellData>".into(),
        array("Int32", "tissue", 1, &[0., 9., 2., 1.]),
        "</CellData>".into(),
    ];
    let header = if wide { "UInt64" } else { "UInt32" };
    let packer = if matches!(encoding, Encoding::Zlib { .. }) { " compressor=\"vtkZLibDataCompressor\"" } else { "" };
    let mut file = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"{order:?}Endian\" header_type=\"{header}\"{packer}>\n\
         <!-- a comment --><UnstructuredGrid><Piece NumberOfPoints=\"7\" NumberOfCells=\"4\">{}</Piece></UnstructuredGrid>",
        parts.join("\n")
    )
    .into_bytes();
    if !appended.is_empty() {
        let name = if encoding == Encoding::RawAppended { "raw" } else { "base64" };
        file.extend(format!("<AppendedData encoding=\"{name}\">\n  _").bytes());
        file.extend(appended);
        file.extend(b"\n</AppendedData>");
    }
    file.extend(b"</VTKFile>\n");
    file
}

const ENCODINGS: [Encoding; 6] = [
    Encoding::Ascii,
    Encoding::Base64,
    Encoding::Zlib { block: 1000 },
    Encoding::Zlib { block: 24 },
    Encoding::RawAppended,
    Encoding::Base64Appended,
];

#[test]
fn every_encoding_gives_the_same_mesh() {
    for encoding in ENCODINGS {
        let orders = [ByteOrder::Little, ByteOrder::Big];
        for (order, wide) in orders.into_iter().flat_map(|order| [(order, true), (order, false)]) {
            let (mesh, warnings) = volume_mesh(&file(encoding, order, wide), &LIMITS).unwrap();
            assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["cells-without-volume"], "{encoding:?}");
            assert_eq!(mesh.points.len(), 7);
            assert_eq!(mesh.points[5], Point::new(0.0, 50.0, 50.5));
            assert_eq!(
                mesh.cells,
                [Cell::Wedge([0, 1, 2, 3, 4, 5]), Cell::Tetrahedron([0, 1, 2, 6]), Cell::Tetrahedron([3, 1, 4, 6])]
            );
            assert_eq!(mesh.point_array("attachment").unwrap().values, [-1.0, 0.0, 1.0, -2.0, 2.0, 3.0, -1.0]);
            assert_eq!(mesh.point_array("force_n").unwrap().components, 3);
            assert_eq!(mesh.cell_array("tissue").unwrap().values, [0.0, 2.0, 1.0]);
        }
    }
}

#[test]
fn what_this_program_writes_is_read_back() {
    let points = [[0.0, 0.0, 0.0], [60.0, 0.0, 0.0], [0.0, 60.0, 0.0], [0.0, 0.0, 60.1]].map(Point::from);
    let values: Vec<f64> = (0..12).map(|i| f64::from(i).sin()).collect();
    let bytes = crate::export::vtu(&points, &[[0, 1, 2, 3]], &[], &[("u", 3, &values)], &[("J", 1, &[0.25])]);
    let (mesh, warnings) = volume_mesh(&bytes, &LIMITS).unwrap();
    assert!(warnings.is_empty());
    assert_eq!(mesh.points, points);
    assert_eq!(mesh.point_array("u").unwrap().values, values);
    assert_eq!(mesh.cell_array("J").unwrap().values, [0.25]);
}

#[test]
fn faults_are_named() {
    let text = String::from_utf8(file(Encoding::Ascii, ByteOrder::Little, true)).unwrap();
    for (from, to, expected) in [
        ("UnstructuredGrid\" version", "PolyData\" version", "expected UnstructuredGrid"),
        ("NumberOfPoints=\"7\"", "NumberOfPoints=\"8\"", "array 0 of Points holds 21 numbers, expected 24"),
        ("NumberOfCells=\"4\"", "NumberOfCells=\"5\"", "array 2 of Cells holds 4 numbers, expected 5"),
        ("NumberOfCells=\"4\"", "NumberOfCells=\"5000\"", "5000 cells, but at most 1000"),
        ("13 5 10 10", "13 5 10 12", "cell 3 is of VTK's type 12"),
        ("0 1 2 6 3", "0 1 2 7 3", "cell 2 names the point 7"),
        ("6 9 13 17", "6 13 9 17", "`offsets` do not rise at cell 2"),
        ("6 9 13 17", "6 9 14 17", "cell 2 has 5 corners"),
        ("50.5", "NaN", "point 5 has a coordinate"),
        ("50.5", "fifty", "a word that is not a number"),
        ("</Piece>", "</Piece><Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"/>", "2 pieces"),
        ("</UnstructuredGrid>", "</Grid>", "is not well formed"),
        ("header_type=\"UInt64\"", "header_type=\"UInt64\" compressor=\"vtkLZ4DataCompressor\"", "unknown compressor"),
        ("Name=\"tissue\"", "Name=\"tissue\" NumberOfComponents=\"0\"", "not well formed"),
    ] {
        assert!(text.contains(from), "{from}");
        let error = match volume_mesh(text.replacen(from, to, 1).as_bytes(), &LIMITS) {
            Err(error) => error.to_string(),
            Ok(_) => String::new(),
        };
        assert!(error.contains(expected) || expected == "not well formed" && !error.is_empty(), "{to}: {error}");
    }
    assert!(matches!(volume_mesh(b"", &LIMITS), Err(ImportError::Empty)));
}

#[test]
fn files_that_are_cut_off_are_refused() {
    for encoding in ENCODINGS {
        let whole = file(encoding, ByteOrder::Little, false);
        for end in (0..whole.len().saturating_sub(60)).step_by(7) {
            assert!(volume_mesh(&whole[..end], &LIMITS).is_err(), "{encoding:?} {end}");
        }
    }
}

proptest! {
    #[test]
    fn changed_bytes_never_panic(which in 0..6usize, changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12)) {
        let mut bytes = file(ENCODINGS[which], ByteOrder::Little, which % 2 == 0);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Ok((mesh, _)) = volume_mesh(&bytes, &LIMITS) {
            for cell in &mesh.cells {
                prop_assert!(cell.corners().iter().all(|&c| (c as usize) < mesh.points.len()));
            }
        }
    }
}
