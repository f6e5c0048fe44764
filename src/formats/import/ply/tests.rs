use super::super::{ImportError, Limits, SurfaceFormat, surface};
use prosopon_geometry::{Point, TriMesh, Warning};

fn read(bytes: &[u8]) -> Result<(TriMesh, Vec<Warning>), ImportError> {
    surface(bytes, SurfaceFormat::Ply, &Limits::default())
}

const HEADER: &str = "comment anything \u{e9}\nelement camera 1\nproperty list uchar short pose\nelement vertex 4\nproperty uchar red\nproperty double x\nproperty float y\nproperty short z\nelement face 1\nproperty float quality\nproperty list uchar int vertex_index\n";

fn check_quad(bytes: &[u8]) {
    let (mesh, warnings) = read(bytes).unwrap();
    assert_eq!(mesh.positions()[2], Point::new(100.0, 80.5, -7.0));
    assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["split-polygons"]);
}

#[test]
fn the_same_quad_in_all_three_encodings() {
    let points: [(f64, f64); 4] = [(0.0, 0.0), (100.0, 0.0), (100.0, 80.5), (0.0, 80.5)];
    let mut text = format!("ply\r\nformat ascii 1.0\r\n{HEADER}end_header\r\n2 5 6\r\n");
    for (x, y) in points {
        text.push_str(&format!("255 {x} {y:e} -7\r\n"));
    }
    text.push_str("0.5 4 0 1 2 3");
    check_quad(text.as_bytes());
    assert!(read(format!("{text} 7\n").as_bytes()).is_err());

    for little in [true, false] {
        let name = if little { "little" } else { "big" };
        let mut bytes = format!("ply\nformat binary_{name}_endian 1.0\n{HEADER}end_header\n").into_bytes();
        macro_rules! put {
            ($value:expr) => {
                bytes.extend_from_slice(&if little { $value.to_le_bytes() } else { $value.to_be_bytes() })
            };
        }
        put!(2u8);
        put!(5i16);
        put!(6i16);
        for (x, y) in points {
            put!(255u8);
            put!(x);
            put!(y as f32);
            put!(-7i16);
        }
        put!(0.5f32);
        put!(4u8);
        for corner in 0..4i32 {
            put!(corner);
        }
        check_quad(&bytes);
        let whole = bytes.len();
        for length in 0..whole {
            assert!(read(&bytes[..length]).is_err(), "{length}");
        }
        bytes.push(0);
        assert!(read(&bytes).unwrap().1.iter().any(|w| w.code == "bytes-after-elements"));
    }
}

#[test]
fn a_list_of_indices_that_are_negative_or_out_of_range_is_refused() {
    let file = |face: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n100 0 0\n0 100 0\n{face}\n"
        )
    };
    assert!(read(file("3 0 1 2").as_bytes()).is_ok());
    for face in
        ["3 0 1 3", "3 0 1 -1", "3 0 1 1.5", "3 0 1", "4 0 1 2", "4 0 1 2 9", "3 0 1 2 0", "-3 0 1 2", "3 0 1 x"]
    {
        assert!(read(file(face).as_bytes()).is_err(), "{face}");
    }
}

#[test]
fn headers_that_do_not_fit_are_refused() {
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let face = "element face 1\nproperty list uchar int vertex_indices\n";
    for (header, part) in [
        (format!("format ascii 1.0\nelement vertex 1\n{xyz}"), "expected one element"),
        (format!("format ascii 1.0\nelement vertex 1\n{xyz}element vertex 1\n{xyz}{face}"), "expected one element"),
        (format!("format ascii 1.0\n{face}element vertex 1\n{xyz}"), "before the vertices"),
        (format!("format ascii 1.0\nelement vertex 1\n{xyz}property float x\n{face}"), "x, y and z"),
        (format!("format ascii 1.0\nelement vertex 1\n{xyz}element face 1\nproperty float q\n"), "vertex_indices"),
        (format!("element vertex 1\n{xyz}{face}"), "no `format"),
        ("format ascii 2.0\n".to_owned(), "line 2"),
        ("format ascii 1.0\nformat ascii 1.0\n".to_owned(), "line 3"),
        ("format ascii 1.0\nproperty float x\n".to_owned(), "before any element"),
        ("format ascii 1.0\nelement vertex -1\n".to_owned(), "not a number"),
        ("format ascii 1.0\nelement a 1\nproperty list float int b\n".to_owned(), "unknown property"),
        ("format utf8 1.0\n".to_owned(), "unknown encoding"),
    ] {
        let error = read(format!("ply\n{header}end_header\n").as_bytes()).unwrap_err().to_string();
        assert!(error.contains(part), "{header}: {error}");
    }
}

#[test]
fn a_comment_states_the_coordinate_system_and_lines_may_end_with_cr() {
    let file = |comment: &str| {
        format!(
            "ply\nformat ascii 1.0\n{comment}\nelement vertex 3\nproperty float32 x\nproperty float64 y\nproperty int8 z\nelement face 1\nproperty list uint8 int32 vertex_index\nend_header\n0 0 0\n100 0 0\n0 100 0\n3 0 1 2\n"
        )
    };
    for (comment, x, code) in [
        ("comment 3D Slicer output. SPACE=RAS", -100.0, Some("stated-frame")),
        ("obj_info coordinate system: RAS", -100.0, Some("stated-frame")),
        ("comment SPACE=LPS", 0.0, None),
        ("comment nothing", 0.0, None),
    ] {
        for text in [file(comment), file(comment).replace('\n', "\r\n"), file(comment).replace('\n', "\r")] {
            let (mesh, warnings) = read(text.as_bytes()).unwrap();
            assert_eq!(mesh.bounds().min.x, x, "{comment}");
            assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), Vec::from_iter(code), "{comment}");
        }
    }
    let strips = file("comment a").replace("element face 1", "element tristrips 1");
    assert!(read(strips.as_bytes()).unwrap_err().to_string().contains("triangle strips"));
}
