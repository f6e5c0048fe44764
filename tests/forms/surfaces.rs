//! Forms of a surface.

use std::fmt::Write;

use prosopon_formats::export::{self, SurfaceView};
use prosopon_formats::import::{Limits, detect_surface, surface};
use prosopon_geometry::{Point, SurfaceReport, TriMesh, surface_report};
use prosopon_planning::phantom;

/// Binary floats: a coordinate of 200 mm has a last digit of 1.5e-5 mm.
const F32_MM: f64 = 2e-5;
/// Text with six decimals.
const TEXT_MM: f64 = 1e-6;
/// Text with three decimals.
const COARSE_MM: f64 = 1e-3;

/// A surface as a file stores it: corners by triangle or vertices with indices.
#[derive(Clone)]
struct Soup {
    points: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    fn of(mesh: &TriMesh) -> Self {
        // Single precision from the start, so that all forms hold the same numbers.
        let points = mesh.positions().iter().map(|p| [p.x, p.y, p.z].map(|c| f64::from(c as f32))).collect();
        Self { points, triangles: mesh.triangles().to_vec() }
    }

    fn map(mut self, change: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        self.points.iter_mut().for_each(|p| *p = change(*p));
        self
    }

    /// Coordinates as RAS states them.
    fn in_ras(self) -> Self {
        self.map(|[x, y, z]| [-x, -y, z])
    }

    fn reversed_triangles(mut self) -> Self {
        self.triangles.reverse();
        self
    }

    fn turned_corners(mut self) -> Self {
        self.triangles.iter_mut().enumerate().for_each(|(k, t)| t.rotate_left(k % 3));
        self
    }

    fn inside_out(mut self) -> Self {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    fn reversed_vertices(mut self) -> Self {
        self.points.reverse();
        let last = self.points.len() as u32 - 1;
        self.triangles.iter_mut().for_each(|t| *t = t.map(|v| last - v));
        self
    }

    /// A vertex of its own for each corner.
    fn split(self) -> Self {
        let points = self.triangles.iter().flatten().map(|v| self.points[*v as usize]).collect();
        let triangles = (0..self.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Self { points, triangles }
    }

    /// Each vertex near the midline twice, one for each side: a seam of a texture.
    fn with_seam(mut self) -> Self {
        let n = self.points.len() as u32;
        self.points.extend(self.points.clone());
        let centre = |t: &[u32; 3], points: &[[f64; 3]]| t.iter().map(|v| points[*v as usize][0]).sum::<f64>();
        for t in &mut self.triangles {
            if centre(t, &self.points) > 0.0 {
                *t = t.map(|v| if self.points[v as usize][0].abs() < 8.0 { v + n } else { v });
            }
        }
        self
    }

    fn with_duplicates(mut self) -> Self {
        let again: Vec<[u32; 3]> = self.triangles.iter().step_by(7).map(|[a, b, c]| [*b, *c, *a]).collect();
        self.triangles.extend(again);
        self
    }

    fn corners(&self, t: &[u32; 3]) -> [[f64; 3]; 3] {
        t.map(|v| self.points[v as usize])
    }
}

fn stl(soup: &Soup, header: &str, count: Option<u32>) -> Vec<u8> {
    let mut file = vec![b' '; 80];
    file[..header.len()].copy_from_slice(header.as_bytes());
    file.extend(count.unwrap_or(soup.triangles.len() as u32).to_le_bytes());
    for t in &soup.triangles {
        file.extend([0; 12]);
        soup.corners(t).iter().flatten().for_each(|c| file.extend((*c as f32).to_le_bytes()));
        file.extend([0; 2]);
    }
    file
}

fn ascii_stl(soup: &Soup, name: &str, normal: &str) -> Vec<u8> {
    let mut text = format!("solid {name}\n");
    for t in &soup.triangles {
        writeln!(text, " facet normal {normal}\n  outer loop").unwrap();
        for [x, y, z] in soup.corners(t) {
            writeln!(text, "   vertex {x:.9e} {y:.9e} {z:.9e}").unwrap();
        }
        writeln!(text, "  endloop\n endfacet").unwrap();
    }
    writeln!(text, "endsolid {name}").unwrap();
    text.into_bytes()
}

#[derive(Clone, Copy)]
enum PlyCode {
    Ascii(usize),
    Little,
    Big,
    LittleDouble,
}

fn ply(soup: &Soup, code: PlyCode, comment: &str, list: &str, newline: &str) -> Vec<u8> {
    let (format, number) = match code {
        PlyCode::Ascii(_) => ("ascii", "float"),
        PlyCode::Little => ("binary_little_endian", "float"),
        PlyCode::Big => ("binary_big_endian", "float32"),
        PlyCode::LittleDouble => ("binary_little_endian", "double"),
    };
    let mut lines = vec!["ply".to_owned(), format!("format {format} 1.0")];
    if !comment.is_empty() {
        lines.push(format!("comment {comment}"));
    }
    lines.push(format!("element vertex {}", soup.points.len()));
    lines.extend(["x", "y", "z"].map(|axis| format!("property {number} {axis}")));
    lines.push(format!("element face {}", soup.triangles.len()));
    lines.push(format!("property list uchar int {list}"));
    lines.push("end_header".to_owned());
    let mut file: Vec<u8> = lines.iter().flat_map(|line| format!("{line}{newline}").into_bytes()).collect();
    match code {
        PlyCode::Ascii(digits) => {
            for [x, y, z] in &soup.points {
                file.extend(format!("{x:.digits$} {y:.digits$} {z:.digits$}{newline}").into_bytes());
            }
            for [a, b, c] in &soup.triangles {
                file.extend(format!("3 {a} {b} {c}{newline}").into_bytes());
            }
        }
        PlyCode::Little | PlyCode::Big | PlyCode::LittleDouble => {
            for c in soup.points.iter().flatten() {
                match code {
                    PlyCode::Big => file.extend((*c as f32).to_be_bytes()),
                    PlyCode::LittleDouble => file.extend(c.to_le_bytes()),
                    PlyCode::Little | PlyCode::Ascii(_) => file.extend((*c as f32).to_le_bytes()),
                }
            }
            for t in &soup.triangles {
                file.push(3);
                for v in t {
                    let bytes = if matches!(code, PlyCode::Big) { v.to_be_bytes() } else { v.to_le_bytes() };
                    file.extend(bytes);
                }
            }
        }
    }
    file
}

/// How an OBJ file names the corners of a face.
#[derive(Clone, Copy)]
enum Corners {
    Plain,
    WithNormals,
    Negative,
    Commented,
}

fn obj(soup: &Soup, head: &str, corners: Corners) -> Vec<u8> {
    let mut text = format!("# head\n{head}o skin\n");
    for [x, y, z] in &soup.points {
        writeln!(text, "v {x:.6} {y:.6} {z:.6}").unwrap();
    }
    if matches!(corners, Corners::WithNormals) {
        text += "vt 0 0\nvn 0 0 1\n";
    }
    let n = soup.points.len() as i64;
    for t in &soup.triangles {
        let [a, b, c] = t.map(|v| i64::from(v) + 1);
        match corners {
            Corners::Plain => writeln!(text, "f {a} {b} {c}"),
            Corners::WithNormals => writeln!(text, "f {a}/1/1 {b}/1/1 {c}//1"),
            Corners::Negative => writeln!(text, "f {} {} {}", a - n - 1, b - n - 1, c - n - 1),
            Corners::Commented => writeln!(text, "f {a} {b} {c} # a triangle"),
        }
        .unwrap();
    }
    text.into_bytes()
}

fn vtp(soup: &Soup, space: Option<&str>) -> Vec<u8> {
    let field = space.map_or(String::new(), |space| {
        let codes: Vec<String> = space.bytes().chain([0]).map(|b| b.to_string()).collect();
        format!(
            "<FieldData><DataArray type=\"String\" Name=\"SPACE\" NumberOfTuples=\"1\" format=\"ascii\">{}</DataArray></FieldData>",
            codes.join(" ")
        )
    });
    let points: Vec<String> = soup.points.iter().flatten().map(|c| format!("{c:.6}")).collect();
    let corners: Vec<String> = soup.triangles.iter().flatten().map(u32::to_string).collect();
    let offsets: Vec<String> = (1..=soup.triangles.len()).map(|t| (3 * t).to_string()).collect();
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\"><PolyData>{field}\
         <Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"{}\">\
         <Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">{}</DataArray></Points>\
         <Polys><DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">{}</DataArray>\
         <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">{}</DataArray></Polys></Piece></PolyData></VTKFile>",
        soup.points.len(),
        soup.triangles.len(),
        points.join(" "),
        corners.join(" "),
        offsets.join(" ")
    )
    .into_bytes()
}

struct Form {
    name: &'static str,
    file: Vec<u8>,
    precision_mm: f64,
    /// Codes of the findings that the file must cause, and no others.
    findings: &'static [&'static str],
}

fn form(name: &'static str, file: Vec<u8>, precision_mm: f64, findings: &'static [&'static str]) -> Form {
    Form { name, file, precision_mm, findings }
}

fn forms(mesh: &TriMesh, soup: &Soup) -> Vec<Form> {
    use PlyCode::{Ascii, Big, Little, LittleDouble};
    let view = SurfaceView { mesh, scalars: &[], colours: None };
    let (s, list) = (soup.clone(), "vertex_indices");
    let plain_ply = |soup: &Soup, comment: &str| ply(soup, Little, comment, list, "\n");
    let n = soup.triangles.len() as u32;
    let shuffled = || s.clone().reversed_vertices().reversed_triangles().turned_corners();
    vec![
        form("stl as exported", export::stl(mesh), F32_MM, &[]),
        form("ply as exported", export::ply(&view), F32_MM, &[]),
        form("vtp as exported", export::vtp(&view), F32_MM, &[]),
        form("stl binary", stl(&s, "binary", None), F32_MM, &[]),
        form("stl whose comment begins with solid", stl(&s, "solid of a tool", None), F32_MM, &[]),
        form("stl whose count is 0", stl(&s, "streamed", Some(0)), F32_MM, &["count-from-length"]),
        form("stl whose count is -1", stl(&s, "streamed", Some(u32::MAX)), F32_MM, &["count-from-length"]),
        form("stl in RAS", stl(&s.clone().in_ras(), "SPACE=RAS", None), F32_MM, &["stated-frame"]),
        form("stl in LPS, stated", stl(&s, "SPACE=LPS", None), F32_MM, &[]),
        form("stl, triangles in another order", stl(&shuffled(), "", None), F32_MM, &[]),
        form("stl inside out", stl(&s.clone().inside_out(), "", None), F32_MM, &["turned-triangles"]),
        form("stl as text", ascii_stl(&s, "head", "0 0 1"), TEXT_MM, &[]),
        form(
            "stl as text in RAS",
            ascii_stl(&s.clone().in_ras(), "head SPACE=RAS", "0 0 1"),
            TEXT_MM,
            &["stated-frame"],
        ),
        form("stl as text, normals of MSVC", ascii_stl(&s, "head", "-nan(ind) -1.#IND 1.#QNAN"), TEXT_MM, &[]),
        form("stl as text in capitals", ascii_stl(&s, "head", "0 0 1").to_ascii_uppercase(), TEXT_MM, &[]),
        form("ply as text", ply(&s, Ascii(6), "", list, "\n"), TEXT_MM, &[]),
        form("ply as text of three decimals", ply(&s, Ascii(3), "", list, "\n"), COARSE_MM, &[]),
        form("ply as text, lines of Windows", ply(&s, Ascii(6), "", list, "\r\n"), TEXT_MM, &[]),
        form("ply little endian", plain_ply(&s, ""), F32_MM, &[]),
        form("ply big endian", ply(&s, Big, "", list, "\n"), F32_MM, &[]),
        form("ply of doubles", ply(&s, LittleDouble, "", "vertex_index", "\n"), TEXT_MM, &[]),
        form("ply in RAS", plain_ply(&s.clone().in_ras(), "SPACE=RAS"), F32_MM, &["stated-frame"]),
        form("ply, a vertex for each corner", plain_ply(&s.clone().split(), ""), F32_MM, &["split-vertices"]),
        form("ply with a seam", plain_ply(&s.clone().with_seam(), ""), F32_MM, &["split-vertices", "unused-vertices"]),
        form("ply, triangles twice", plain_ply(&s.clone().with_duplicates(), ""), F32_MM, &["repeated-triangles"]),
        form("ply, another order", plain_ply(&shuffled(), ""), F32_MM, &[]),
        form("obj", obj(&s, "", Corners::Plain), TEXT_MM, &[]),
        form("obj with normals and textures", obj(&s, "", Corners::WithNormals), TEXT_MM, &[]),
        form("obj with negative indices", obj(&s, "", Corners::Negative), TEXT_MM, &[]),
        form("obj with comments after faces", obj(&s, "", Corners::Commented), TEXT_MM, &[]),
        form("obj in RAS", obj(&s.clone().in_ras(), "# SPACE=RAS\n", Corners::Plain), TEXT_MM, &["stated-frame"]),
        form(
            "obj, a vertex for each corner",
            obj(&s.clone().split(), "", Corners::Plain),
            TEXT_MM,
            &["split-vertices"],
        ),
        form("vtp as text", vtp(&s, None), TEXT_MM, &[]),
        form("vtp in RAS", vtp(&s.clone().in_ras(), Some("RAS")), TEXT_MM, &["stated-frame"]),
        form("vtp in LPS, stated", vtp(&s, Some("LPS")), TEXT_MM, &[]),
        form("vtp, another order", vtp(&shuffled(), None), TEXT_MM, &[]),
        form("stl, n triangles stated", stl(&s, "", Some(n)), F32_MM, &[]),
    ]
}

/// Fields of the report that no form may change.
fn counts(r: &SurfaceReport) -> [usize; 9] {
    [
        r.triangles,
        r.vertices,
        r.boundary_edges,
        r.boundary_loops,
        r.nonmanifold_edges,
        r.inconsistent_edges,
        r.components,
        r.duplicate_triangles,
        r.degenerate_triangles,
    ]
}

/// Corner positions of each triangle from its lowest corner on, in ascending order: the surface without the order of the file.
fn triangles_of(mesh: &TriMesh) -> Vec<[[i64; 3]; 3]> {
    // Steps much wider than any form's precision, far narrower than an edge.
    let key = |p: Point| [p.x, p.y, p.z].map(|c| (c * 64.0).round() as i64);
    let mut all: Vec<[[i64; 3]; 3]> = (0..mesh.triangles().len())
        .map(|t| {
            let mut corners = mesh.corners(t).map(key);
            let least = (0..3).min_by_key(|i| corners[*i]).unwrap();
            corners.rotate_left(least);
            corners
        })
        .collect();
    all.sort_unstable();
    all
}

#[test]
fn every_form_of_a_surface_gives_the_same_report() {
    let head = phantom::head();
    let mesh = phantom::surface_of(head.skin.as_ref(), &head.bounds(), 9.0).unwrap();
    // Coordinates on a grid of 1/64 mm, exact in every form but three decimals, so that rounding cannot move a key.
    let on_grid = mesh.positions().iter().map(|p| Point::from(p.coords.map(|c| (c * 64.0).round() / 64.0))).collect();
    let mesh = mesh.with_positions(on_grid).unwrap();
    let soup = Soup::of(&mesh);
    let expected = surface_report(&mesh);
    assert!(expected.closed && expected.triangles > 2000, "{expected:?}");
    let triangles = triangles_of(&mesh);
    for Form { name, file, precision_mm, findings } in forms(&mesh, &soup) {
        let format = detect_surface(&file).unwrap_or_else(|| panic!("{name}: not recognised"));
        let (read, warnings) = surface(&file, format, &Limits::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut codes: Vec<&str> = warnings.iter().map(|w| w.code).collect();
        codes.sort_unstable();
        assert_eq!(codes, findings, "{name}: {warnings:?}");
        let found = surface_report(&read);
        assert_eq!(counts(&found), counts(&expected), "{name}");
        assert!(found.closed, "{name}");
        let off = |a: Point, b: Point| (a - b).abs().max();
        let bounds = off(found.bounds.min, expected.bounds.min).max(off(found.bounds.max, expected.bounds.max));
        assert!(bounds <= precision_mm, "{name}: bounds {bounds} mm off");
        // First order in the precision.
        let area_off = (found.area_mm2 - expected.area_mm2).abs() / expected.area_mm2;
        let volume_off = (found.volume_mm3 - expected.volume_mm3).abs() / expected.volume_mm3;
        assert!(area_off.max(volume_off) <= precision_mm, "{name}: {area_off} {volume_off}");
        assert_eq!(triangles_of(&read), triangles, "{name}");
    }
}
