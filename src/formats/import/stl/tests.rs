use super::super::malformed_tests::surfaces;
use super::super::{ImportError, Limits, SurfaceFormat, detect_surface, surface};
use super::*;
use prosopon_geometry::{Severity, TriMesh};

fn read(bytes: &[u8]) -> Result<(TriMesh, Vec<Warning>), ImportError> {
    surface(bytes, SurfaceFormat::Stl, &Limits::default())
}

/// A binary file with `added` after each of its four triangles, which it states as the attribute byte count if `says`.
fn binary(count: u32, added: usize, says: bool) -> Vec<u8> {
    let (_, plain, _) = surfaces().remove(1);
    let mut bytes = plain[..COMMENT].to_vec();
    bytes.extend(count.to_le_bytes());
    for record in records(&plain) {
        bytes.extend(&record[..48]);
        bytes.extend((if says { added as u16 } else { 0 }).to_le_bytes());
        bytes.extend(vec![0xab; added]);
    }
    bytes
}

#[test]
fn a_count_that_the_writer_did_not_know_is_taken_from_the_length() {
    for (count, severity) in [(0, Severity::Info), (u32::MAX, Severity::Info), (3, Severity::Check)] {
        let bytes = binary(count, 0, false);
        assert_eq!(detect_surface(&bytes), Some(SurfaceFormat::Stl), "{count}");
        let (mesh, warnings) = read(&bytes).unwrap();
        assert_eq!(mesh.triangles().len(), 4);
        assert_eq!((warnings[0].code, warnings[0].severity), ("count-from-length", severity));
    }
    // More than the file holds: it was cut off.
    assert!(read(&binary(5, 0, false)).is_err());
    assert!(matches!(
        surface(&binary(0, 0, false), SurfaceFormat::Stl, &Limits { max_triangles: 3, ..Limits::default() }),
        Err(ImportError::TooLarge { .. })
    ));
}

#[test]
fn bytes_between_triangles_are_refused_with_the_reason() {
    for (added, says, part) in [
        (
            2,
            true,
            "the header states 4 triangles (284 bytes), but the file has 292, 8 too many; bytes of the writer's own follow",
        ),
        (12, true, "48 too many; bytes of the writer's own follow triangles, as their attribute byte counts say"),
        (7, false, "28 too many; bytes of the writer's own stand between or after"),
    ] {
        let error = read(&binary(4, added, says)).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    // Colours in the two unused bytes, and padding at the end.
    let mut bytes = binary(4, 0, false);
    bytes[84 + 48..84 + 50].copy_from_slice(&[0xff, 0x83]);
    assert_eq!(read(&bytes).unwrap().1, []);
    bytes.extend([0; 30]);
    assert_eq!(read(&bytes).unwrap().1[0].code, "bytes-after-triangles");
}

#[test]
fn stored_normals_may_be_anything_and_coordinates_may_not() {
    let (_, text, _) = surfaces().remove(2);
    let text = String::from_utf8(text).unwrap();
    let expected = read(text.as_bytes()).unwrap().0;
    for normal in ["nan nan nan", "-nan(ind) -nan(ind) -nan(ind)", "-1.#IND -1.#IND 1.#QNAN", "inf 0 1,5", ""] {
        let text = text.replace("normal 0 0 0", &format!("normal {normal}"));
        assert_eq!(read(text.as_bytes()).unwrap(), (expected.clone(), vec![]), "{normal}");
    }
    for corner in ["nan 0 0", "-1.#IND 0 0", "1,5 0 0", "1 0"] {
        let text = text.replacen("vertex 100 0 0", &format!("vertex {corner}"), 1);
        assert!(read(text.as_bytes()).unwrap_err().to_string().contains("expected a finite number"), "{corner}");
    }
    assert!(read(text.replacen("normal 0 0 0", "normal 0 0 0 0", 1).as_bytes()).is_err());
}

#[test]
fn text_is_read_with_any_line_ends_blanks_and_number_forms() {
    let (_, text, _) = surfaces().remove(2);
    let text = String::from_utf8(text).unwrap() + "\n";
    let expected = read(text.as_bytes()).unwrap().0;
    for (form, other) in [
        ("CR LF", text.replace('\n', "\r\n")),
        ("CR", text.replace('\n', "\r")),
        ("a mark of UTF-8", format!("\u{feff}{text}")),
        ("blank lines first", format!("\n \n{text}")),
        ("upper case", text.to_uppercase()),
        ("exponents", text.replace("100", "+1.0E+02")),
        ("short numbers", text.replace("100", "100.")),
        ("no name", text.replace("solid a b", "solid")),
    ] {
        assert_eq!(detect_surface(other.as_bytes()), Some(SurfaceFormat::Stl), "{form}");
        assert_eq!(read(other.as_bytes()).unwrap(), (expected.clone(), vec![]), "{form}");
    }
}

#[test]
fn the_comment_or_the_name_states_the_coordinate_system() {
    let (_, mut binary, _) = surfaces().remove(1);
    let expected = read(&binary).unwrap().0;
    binary[..27].copy_from_slice(b"3D Slicer output. SPACE=RAS");
    let (_, text, _) = surfaces().remove(2);
    let text = String::from_utf8(text).unwrap().replace("solid a b", "solid 3D Slicer output. SPACE=RAS");
    for bytes in [&binary[..], text.as_bytes()] {
        let (mesh, warnings) = read(bytes).unwrap();
        assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["stated-frame"]);
        assert_eq!(mesh.bounds().min, Point::new(-100.0, -100.0, 0.0));
        assert!((mesh.volume() - expected.volume()).abs() < 1e-6);
    }
}
