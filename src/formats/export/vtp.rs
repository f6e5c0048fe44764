use super::SurfaceView;
use super::vtu::VtkXmlWriter;
use crate::import::LPS_MARKER;

/// A VTP file (VTK's XML format of polygons) of a surface, with raw appended data.
///
/// Coordinates are `Float64`, scalars are `Float32` point arrays, and colours, if any, are the point array `colour` of three
/// `UInt8`. The field array `SPACE` is `LPS`, which 3D Slicer reads too.
///
/// # Panics
/// When scalars or colours do not have exactly one value per vertex.
#[must_use]
pub fn vtp(surface: &SurfaceView<'_>) -> Vec<u8> {
    surface.assert_lengths();
    let (positions, triangles) = (surface.mesh.positions(), surface.mesh.triangles());
    let mut file = VtkXmlWriter::default();
    let (name, space) = LPS_MARKER.split_once('=').unwrap_or_default();
    // VTK's text arrays in XML hold the codes of the characters and a zero.
    let codes: String = space.bytes().map(|c| format!("{c} ")).collect();
    file.xml(&format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\">\n<PolyData>\n<FieldData>\n<Array type=\"String\" Name=\"{name}\" \
         NumberOfTuples=\"1\" format=\"ascii\">\n{codes}0\n</Array>\n</FieldData>\n<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" \
         NumberOfStrips=\"0\" NumberOfPolys=\"{}\">\n<Points>\n",
        positions.len(),
        triangles.len()
    ));
    file.array("Float64", "Points", 3, positions.iter().flat_map(|p| p.iter()).flat_map(|x| x.to_le_bytes()));
    file.xml("</Points>\n<Polys>\n");
    file.array("Int64", "connectivity", 1, triangles.iter().flatten().flat_map(|v| i64::from(*v).to_le_bytes()));
    file.array("Int64", "offsets", 1, (1..=triangles.len() as i64).flat_map(|t| (3 * t).to_le_bytes()));
    file.xml("</Polys>\n<PointData>\n");
    for (name, values) in surface.scalars {
        file.array("Float32", name, 1, values.iter().flat_map(|x| x.to_le_bytes()));
    }
    if let Some(colours) = surface.colours {
        file.array("UInt8", "colour", 3, colours.iter().flatten().copied());
    }
    file.xml("</PointData>\n</Piece>\n</PolyData>\n");
    file.finish()
}
