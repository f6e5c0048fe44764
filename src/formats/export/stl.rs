use crate::import::LPS_MARKER;
use prosopon_geometry::TriMesh;

/// Binary STL with coordinates as `f32`; the format holds neither scalars nor colours.
///
/// The comment states `SPACE=LPS`, which 3D Slicer reads too.
#[must_use]
pub fn stl(mesh: &TriMesh) -> Vec<u8> {
    let n = mesh.triangles().len();
    let mut bytes = Vec::with_capacity(84 + 50 * n);
    // The comment must not begin with "solid", or readers would take the file for text.
    bytes.extend(format!("Prosopon. {LPS_MARKER} UNIT=mm").bytes());
    bytes.resize(80, 0);
    bytes.extend((n as u32).to_le_bytes());
    for t in 0..n {
        let normal = mesh.scaled_normal(t).try_normalize(0.0).unwrap_or_default();
        let corners = mesh.corners(t);
        for x in normal.iter().chain(corners.iter().flat_map(|p| p.iter())) {
            bytes.extend((*x as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}
