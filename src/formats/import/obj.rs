//! Reads vertices and faces of Wavefront OBJ files.
//!
//! Normals, textures, materials, groups, lines and free-form surfaces are skipped.

use super::error::{at_most, malformed};
use super::raw_surface::{Faces, RawSurface};
use super::stated::Stated;
use super::text::number;
use super::{ImportError, Limits};
use prosopon_geometry::Point;

const FORMAT: &str = "OBJ";

/// Whether the first statement is an OBJ statement.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    const STATEMENTS: [&[u8]; 9] = [b"v", b"vn", b"vt", b"f", b"o", b"g", b"s", b"mtllib", b"usemtl"];
    let is_comment = |line: &&[u8]| line.is_empty() || line.starts_with(b"#");
    let statement = bytes.split(|&c| c == b'\n' || c == b'\r').map(<[u8]>::trim_ascii).find(|line| !is_comment(line));
    let word = statement.and_then(|line| line.split(u8::is_ascii_whitespace).next());
    word.is_some_and(|word| STATEMENTS.contains(&word))
}

/// Reads `v` and `f` statements, and what comments state about the coordinates.
///
/// A `#` ends a statement. A backslash at the end of a line, or before its comment, joins it with the next.
pub(super) fn read(bytes: &[u8], limits: &Limits) -> Result<RawSurface, ImportError> {
    let max_vertices = limits.max_triangles.saturating_mul(3);
    let mut positions = Vec::new();
    let mut faces = Faces::new(FORMAT, limits);
    let mut corners = Vec::new();
    let mut statement = Vec::new();
    let mut stated = Stated::default();
    let line_end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    for (line, text) in (1u64..).zip(bytes.split(|&c| c == line_end)) {
        let mut parts = text.splitn(2, |&c| c == b'#');
        let text = parts.next().unwrap_or_default().trim_ascii();
        if let Some(comment) = parts.next().filter(|_| text.is_empty()) {
            stated.read(comment);
            continue;
        }
        if let Some(start) = text.strip_suffix(b"\\") {
            statement.extend_from_slice(start);
            statement.push(b' ');
            continue;
        }
        statement.extend_from_slice(text);
        let mut words = statement.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"v") => {
                positions.push(
                    vertex(words).ok_or_else(|| malformed(FORMAT, format!("line {line}: `v` needs three numbers")))?,
                );
                at_most("vertices", positions.len() as u64, max_vertices)?;
            }
            Some(b"f") => {
                corners.clear();
                for word in words {
                    let n = positions.len();
                    corners.push(corner(word, n).ok_or_else(|| {
                        malformed(
                            FORMAT,
                            format!("line {line}: a corner of `f` names no vertex, there are {n} before it"),
                        )
                    })?);
                }
                faces.push(&positions, &corners)?;
            }
            _ => {}
        }
        statement.clear();
    }
    if !statement.is_empty() {
        return Err(malformed(FORMAT, "the last line is continued, but nothing follows: cut off"));
    }
    Ok(RawSurface { stated, ..faces.finish(positions) })
}

/// The position `x y z`; a weight or a colour may follow.
fn vertex<'a>(words: impl Iterator<Item = &'a [u8]>) -> Option<Point> {
    let mut numbers = words.map(number);
    Some(Point::new(numbers.next()??, numbers.next()??, numbers.next()??))
}

/// Vertex index, from 0, of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`.
///
/// In the file indices count from 1, or backwards from the latest vertex when negative. The format demands that the vertex
/// comes before the face.
fn corner(word: &[u8], n_vertices: usize) -> Option<u32> {
    let index: i64 = std::str::from_utf8(word.split(|&c| c == b'/').next()?).ok()?.parse().ok()?;
    let n = i64::try_from(n_vertices).ok()?;
    let from_zero = if index < 0 { n.checked_add(index)? } else { index.checked_sub(1)? };
    u32::try_from(from_zero).ok().filter(|_| from_zero < n)
}

#[cfg(test)]
mod tests {
    use super::super::{SurfaceFormat, surface};
    use super::*;

    fn read_text(text: &str) -> Result<(prosopon_geometry::TriMesh, Vec<prosopon_geometry::Warning>), ImportError> {
        surface(text.as_bytes(), SurfaceFormat::Obj, &Limits::default())
    }

    #[test]
    fn indices_of_all_kinds_continued_lines_and_quads() {
        let text = "# c\no a\nv 0 0 0 1\r\nv 100 0 0\nv 100 100 0 0.1 0.2 0.3\nv 0 \\\n 100 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf -4/1 -2 -1/2/3\ng b\n";
        let (mesh, warnings) = read_text(text).unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.positions()[3], Point::new(0.0, 100.0, 0.0));
        assert!(warnings.is_empty(), "{warnings:?}");
        let (mesh, warnings) = read_text(&(text.split("f ").next().unwrap().to_owned() + "f 1 2 3 4\n")).unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(warnings.iter().map(|w| w.code).collect::<Vec<_>>(), ["split-polygons"]);
        assert!(warnings[0].message.starts_with("1 faces"), "{warnings:?}");
    }

    #[test]
    fn a_comment_ends_a_statement_and_lines_end_in_any_way() {
        let text =
            "# first\nv 0 0 0#a\nv 100 0 0 # b \\\nv 0 100 \\ # c\n# d\n0#e\ng #f\nf 1 2 3 # comment\n#f 1 1 1\n";
        for text in [text.to_owned(), text.replace('\n', "\r"), text.replace('\n', "\r\n"), format!("\u{feff}{text}")] {
            assert_eq!(crate::import::detect_surface(text.as_bytes()), Some(SurfaceFormat::Obj));
            let (mesh, warnings) = read_text(&text).unwrap();
            assert_eq!((mesh.triangles(), warnings), (&[[0, 1, 2]][..], vec![]), "{text:?}");
        }
    }

    #[test]
    fn faulty_files_are_refused_with_their_line() {
        for (text, part) in [
            ("v 0 0\n", "line 1: `v` needs three numbers"),
            ("v 0 0 0\nf 1 2 3\n", "line 2: a corner of `f` names no vertex, there are 1 before it"),
            ("v 0 0 0\nf 1 0 1\n", "line 2"),
            ("v 0 0 0\nf 1 -2 1\n", "line 2"),
            ("v 0 0 0\nf 1 x 1\n", "line 2"),
            ("v 0 0 0\nf 9223372036854775807 -9223372036854775808 1\n", "line 2"),
            ("v 0 0 0\nf 1 1 1 \\", "cut off"),
        ] {
            let error = read_text(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text:?}: {error}");
        }
        assert!(matches!(read_text("v 0 0 0\n"), Err(ImportError::Geometry(_))));
        assert!(matches!(read_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3"), Err(ImportError::Geometry(_))));
    }
}
