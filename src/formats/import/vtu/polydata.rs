//! Reads surfaces of polygons and triangle strips.

use super::cells::whole;
use super::xml::{Grid, Section, VtkXml};
use super::{FORMAT, decode, numbers, points};
use crate::import::error::{at_most, malformed};
use crate::import::raw_surface::{Faces, RawSurface};
use crate::import::{ImportError, Limits};
use prosopon_geometry::Point;

/// Most corners per face on average; bounds the connectivity.
const MAX_CORNERS: usize = 64;

/// Whether these may be the bytes of a VTP file.
pub(in crate::import) fn looks_like_polydata(bytes: &[u8]) -> bool {
    let beginning = bytes.get(..bytes.len().min(1024)).unwrap_or_default();
    let has = |word: &[u8]| beginning.windows(word.len()).any(|w| w == word);
    bytes.trim_ascii_start().starts_with(b"<") && has(b"<VTKFile") && has(b"PolyData")
}

/// Reads a VTP file.
pub(in crate::import) fn read_polydata(bytes: &[u8], limits: &Limits) -> Result<RawSurface, ImportError> {
    let mut file = VtkXml::parse(bytes, Grid::PolyData)?;
    at_most("points", file.n_points as u64, limits.max_triangles.saturating_mul(3))?;
    at_most("polygons", (file.n_cells as u64).saturating_add(file.n_strips as u64), limits.max_triangles)?;
    let positions = points(&file)?;
    let mut faces = Faces::new(FORMAT, limits);
    each_face(&file, Section::Polys, file.n_cells, &mut |corners| faces.push(&positions, corners))?;
    each_face(&file, Section::Strips, file.n_strips, &mut |strip| push_strip(&mut faces, &positions, strip))?;
    let mut stated = std::mem::take(&mut file.stated);
    for array in file.arrays.iter().filter(|a| a.section == Section::FieldData) {
        // What cannot be read states something that is not known.
        stated.read_value(&array.name, &decode::text(&file, array).unwrap_or(b"?".to_vec()));
    }
    Ok(RawSurface { stated, ..faces.finish(positions) })
}

/// Adds the triangles of a strip; every second one has the opposite order of corners.
fn push_strip(faces: &mut Faces, positions: &[Point], strip: &[u32]) -> Result<(), ImportError> {
    for (at, corners) in strip.windows(3).enumerate() {
        if let &[a, b, c] = corners {
            faces.push(positions, &if at % 2 == 0 { [a, b, c] } else { [b, a, c] })?;
        }
    }
    Ok(())
}

fn each_face(
    file: &VtkXml<'_>,
    section: Section,
    n: usize,
    take: &mut dyn FnMut(&[u32]) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    if n == 0 {
        return Ok(());
    }
    let fault = |detail: String| malformed(FORMAT, detail);
    let array = |name: &str| {
        let found = file.arrays.iter().find(|a| a.section == section && a.name == name);
        found.ok_or_else(|| fault(format!("there is no array `{name}` of {section:?}")))
    };
    let ends = numbers(file, array("offsets")?, n)?;
    let last = ends.last().copied().unwrap_or(0.0);
    let length = whole(last)
        .filter(|l| *l as usize <= n.saturating_mul(MAX_CORNERS))
        .ok_or_else(|| fault(format!("the last of `offsets` is {last}, which {n} faces cannot reach")))?;
    let connectivity = numbers(file, array("connectivity")?, length as usize)?;
    let corners: Option<Vec<u32>> = connectivity.into_iter().map(whole).collect();
    let corners = corners.ok_or_else(|| fault(format!("a corner of {section:?} is not an index")))?;
    let mut begin = 0usize;
    for (index, &end) in ends.iter().enumerate() {
        let end = whole(end).map(|e| e as usize);
        let Some((end, face)) = end.and_then(|end| Some((end, corners.get(begin..end)?))) else {
            return Err(fault(format!("`offsets` do not rise at face {index}")));
        };
        take(face)?;
        begin = end;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::import::{Limits, SurfaceFormat, surface};
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;

    /// Smallest x and warnings of a tetrahedron with `field` in the file's field data and `appended` after its XML.
    fn read(field: &str, appended: &[u8]) -> (f64, Vec<&'static str>) {
        let mut bytes = format!(
            "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\"><PolyData>\
             {field}<Piece NumberOfPoints=\"4\" NumberOfPolys=\"4\"><PointData><Array type=\"String\" Name=\"SPACE\"/>\
             </PointData><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 100 0 0 0 100 0 0 0 100\
             <InformationKey name=\"L2_NORM_RANGE\" location=\"vtkDataArray\" length=\"2\"><Value index=\"0\">0</Value>\
             </InformationKey></DataArray></Points><Polys><DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">3 6 9 12\
             </DataArray><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 2 1 0 1 3 0 3 2 1 2 3</DataArray></Polys>\
             </Piece></PolyData>"
        )
        .into_bytes();
        if !appended.is_empty() {
            bytes.extend(b"<AppendedData encoding=\"raw\">_");
            bytes.extend(appended);
            bytes.extend(b"</AppendedData>");
        }
        bytes.extend(b"</VTKFile>");
        let (mesh, warnings) = surface(&bytes, SurfaceFormat::Vtp, &Limits::default()).unwrap();
        (mesh.bounds().min.x, warnings.iter().map(|w| w.code).collect())
    }

    #[test]
    fn a_field_array_states_the_coordinate_system_in_every_encoding() {
        let ras = (-100.0, vec!["stated-frame"]);
        let array = |rest: &str| {
            format!("<FieldData><Array type=\"String\" Name=\"SPACE\" NumberOfTuples=\"1\" {rest}</FieldData>")
        };
        let stored = [&4u64.to_le_bytes()[..], b"RAS\0"].concat();
        let encoded = STANDARD.encode(&stored);
        for (rest, appended) in [
            ("format=\"ascii\">\n 82 65 83 0\n</Array>", &[][..]),
            ("format=\"ascii\">RAS</Array>", &[][..]),
            (&*format!("format=\"binary\">{encoded}</Array>"), &[][..]),
            ("format=\"appended\" offset=\"0\"/>", &stored[..]),
        ] {
            assert_eq!(read(&array(rest), appended), ras, "{rest}");
        }
        for (field, expected) in [
            ("<!-- coordinate system: RAS -->", ras),
            (&*array("format=\"ascii\">76 80 83 0</Array>"), (0.0, vec![])),
            (&*array("format=\"appended\" offset=\"7\"/>"), (0.0, vec!["unclear-frame"])),
            (
                "<FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" format=\"strange\"/></FieldData>",
                (0.0, vec![]),
            ),
            (
                "<FieldData><DataArray type=\"String\" Name=\"units\" format=\"ascii\">mm</DataArray></FieldData>",
                (0.0, vec![]),
            ),
            ("", (0.0, vec![])),
        ] {
            assert_eq!(read(field, &[]), expected, "{field}");
        }
    }
}
