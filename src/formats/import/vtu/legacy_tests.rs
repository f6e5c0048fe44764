use super::volume_mesh;
use crate::import::Limits;
use proptest::prelude::*;
use prosopon_geometry::{Cell, Point, VolumeMesh};

const LIMITS: Limits = Limits { max_triangles: 1000, max_voxels: 1000, max_cells: 1000 };
const POINTS: [f64; 21] =
    [0., 0., 0., 50., 0., 0., 0., 50., 0., 0., 0., 50., 50., 0., 50., 0., 50., 50.5, 7., -20., 3.];
const CORNERS: [f64; 17] = [0., 1., 2., 3., 4., 5., 1., 2., 3., 0., 1., 2., 6., 3., 1., 4., 6.];

/// A file with two tetrahedra, a wedge and a triangle among them.
pub(in crate::import) fn file(is_ascii: bool, version: u32) -> Vec<u8> {
    let mut file = format!(
        "# vtk DataFile Version {version}.0\na title\n{}\nDATASET UNSTRUCTURED_GRID\n",
        if is_ascii { "ASCII" } else { "BINARY" }
    )
    .into_bytes();
    let mut part = |head: &str, kind: &str, values: &[f64]| {
        file.extend(head.bytes());
        file.push(b'\n');
        for v in values {
            match (is_ascii, kind) {
                (true, _) => file.extend(format!("{v} ").bytes()),
                (false, "double") => file.extend(v.to_be_bytes()),
                (false, "float") => file.extend((*v as f32).to_be_bytes()),
                (false, "long") => file.extend((*v as i64).to_be_bytes()),
                (false, "byte") => file.push(*v as u8),
                (false, _) => file.extend((*v as i32).to_be_bytes()),
            }
        }
        file.push(b'\n');
    };
    part("POINTS 7 double", "double", &POINTS);
    if version < 5 {
        let counts = [6, 3, 4, 4];
        let mut rest = &CORNERS[..];
        let mut cells = Vec::new();
        for n in counts {
            cells.push(n as f64);
            cells.extend(&rest[..n]);
            rest = &rest[n..];
        }
        part("CELLS 4 21", "int", &cells);
    } else {
        part("METADATA\nINFORMATION 1\nNAME a LOCATION b\n", "int", &[]);
        part("CELLS 5 17\nOFFSETS vtktypeint64", "long", &[0., 6., 9., 13., 17.]);
        part("CONNECTIVITY vtktypeint64", "long", &CORNERS);
    }
    part("CELL_TYPES 4", "int", &[13., 5., 10., 10.]);
    part("CELL_DATA 4\nFIELD FieldData 2\ntissue 1 4 int", "int", &[0., 9., 2., 1.]);
    part("stress%20xx 1 4 float", "float", &[0.25, 0.5, 1., 2.]);
    part("POINT_DATA 7\nSCALARS attachment int 1\nLOOKUP_TABLE default", "int", &[-1., 0., 1., -2., 2., 3., -1.]);
    part("LOOKUP_TABLE table 2", "byte", &[1., 0., 0., 1., 0., 1., 0., 1.]);
    part("VECTORS force_n float", "float", &[0.5; 21]);
    file
}

fn check(mesh: &VolumeMesh) {
    assert_eq!(mesh.points.len(), 7);
    assert_eq!(mesh.points[5], Point::new(0.0, 50.0, 50.5));
    let cells = [Cell::Wedge([0, 1, 2, 3, 4, 5]), Cell::Tetrahedron([0, 1, 2, 6]), Cell::Tetrahedron([3, 1, 4, 6])];
    assert_eq!(mesh.cells, cells);
    assert_eq!(mesh.point_array("attachment").unwrap().values, [-1.0, 0.0, 1.0, -2.0, 2.0, 3.0, -1.0]);
    let force = mesh.point_array("force_n").unwrap();
    assert_eq!((force.components, force.values.len()), (3, 21));
    assert_eq!(mesh.cell_array("tissue").unwrap().values, [0.0, 2.0, 1.0]);
    assert_eq!(mesh.cell_array("stress xx").unwrap().values, [0.25, 1.0, 2.0]);
}

#[test]
fn both_encodings_and_both_layouts_of_cells_give_the_same_mesh() {
    for version in [2, 4, 5] {
        for is_ascii in [true, false] {
            let (mesh, warnings) = volume_mesh(&file(is_ascii, version), &LIMITS).unwrap();
            assert_eq!(
                warnings.iter().map(|w| w.code).collect::<Vec<_>>(),
                ["cells-without-volume"],
                "{is_ascii} {version}"
            );
            check(&mesh);
        }
    }
}

#[test]
fn points_of_no_cell_give_a_warning_and_do_not_count_for_the_size() {
    let text = String::from_utf8(file(true, 3)).unwrap();
    let unused = text.replacen("4 0 1 2 6", "4 0 1 2 3", 1).replacen("4 3 1 4 6", "4 3 1 4 5", 1);
    // The box around the cells, 87 mm across, has a usual size; with the unused point its size would be refused.
    let far = unused.replacen("7 -20 3", "7000 -20 3", 1);
    for file in [unused, far] {
        let (_, warnings) = volume_mesh(file.as_bytes(), &LIMITS).unwrap();
        assert!(warnings.iter().any(|w| w.code == "points-without-cell"), "{warnings:?}");
        assert!(!warnings.iter().any(|w| w.code.ends_with("size")), "{warnings:?}");
    }
}

#[test]
fn faults_are_named() {
    let text = String::from_utf8(file(true, 3)).unwrap();
    for (from, to, expected) in [
        ("ASCII", "OCTAL", "line 3: expected ASCII or BINARY"),
        ("UNSTRUCTURED_GRID", "POLYDATA", "expected UNSTRUCTURED_GRID"),
        ("DATASET UNSTRUCTURED_GRID\n", "", "no DATASET"),
        ("POINTS 7", "POINTS 8", "expected a number"),
        ("POINTS 7", "POINTS 99999999999999", "at most 1000"),
        ("POINTS 7 double", "POINTS 7 quad", "have a type that is not supported"),
        ("CELLS 4 21", "CELLS 3 21", "do not make 3 cells"),
        ("CELLS 4 21", "CELLS 4 999999999999", "ends before"),
        ("CELL_TYPES 4\n13", "CELL_TYPES 4\n12", "VTK's type 12"),
        ("4 0 1 2 6", "4 0 1 2 7", "names the point 7"),
        ("6 0 1 2", "7 0 1 2", "do not make 4 cells"),
        ("50.5", "NaN", "point 5 has a coordinate"),
        ("CELL_DATA 4", "CELL_DATA 3", "has 4 tuples, expected 3"),
        ("attachment int 1", "attachment int 0", "has no components"),
        ("VECTORS force_n", "VECTORS attachment", "has the name of an earlier array"),
        ("POINTS 7", "POINTS DOE^JANE", "word 2 is not a count"),
        ("DATASET UNSTRUCTURED_GRID", "DATASET DOE^JANE", "expected UNSTRUCTURED_GRID"),
        ("50.5", "DOE^JANE", "expected a number"),
        ("VECTORS", "DOE^JANE", "expected a section"),
    ] {
        assert!(text.contains(from), "{from}");
        let error = volume_mesh(text.replacen(from, to, 1).as_bytes(), &LIMITS).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(expected), "{to}: {error}");
        // The file may hold a patient's name.
        assert!(!error.contains("DOE"), "{error}");
    }
}

#[test]
fn files_that_are_cut_off_are_refused() {
    for (is_ascii, version) in [(true, 3), (false, 3), (true, 5), (false, 5)] {
        let whole = file(is_ascii, version);
        let types = whole.windows(10).position(|w| w == b"CELL_TYPES").unwrap();
        for end in (0..types + 14).step_by(3) {
            assert!(volume_mesh(&whole[..end], &LIMITS).is_err(), "{is_ascii} {version} {end}");
        }
    }
}

proptest! {
    #[test]
    fn changed_bytes_never_panic(which in 0..4u32, changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12)) {
        let mut bytes = file(which % 2 == 0, 3 + which);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Ok((mesh, _)) = volume_mesh(&bytes, &LIMITS) {
            for cell in &mesh.cells {
                prop_assert!(cell.corners().iter().all(|&c| (c as usize) < mesh.points.len()));
            }
            let right = |arrays: &[prosopon_geometry::DataArray], n: usize| arrays.iter().all(|a| a.values.len() == n * a.components);
            prop_assert!(right(&mesh.point_arrays, mesh.points.len()) && right(&mesh.cell_arrays, mesh.cells.len()));
        }
    }
}
