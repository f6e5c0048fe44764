use super::SurfaceView;
use super::view::identifier;

/// Binary little-endian PLY with scalars (`float`) and colours as vertex properties; coordinates are `double`.
///
/// # Panics
/// When scalars or colours are not one per vertex.
#[must_use]
pub fn ply(surface: &SurfaceView<'_>) -> Vec<u8> {
    surface.assert_lengths();
    let (positions, triangles) = (surface.mesh.positions(), surface.mesh.triangles());
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment Prosopon, LPS, mm\nelement vertex {}\n\
         property double x\nproperty double y\nproperty double z\n",
        positions.len()
    );
    for (name, _) in surface.scalars {
        header += &format!("property float {}\n", identifier(name));
    }
    if surface.colours.is_some() {
        header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    }
    header += &format!("element face {}\nproperty list uchar int vertex_indices\nend_header\n", triangles.len());

    let per_vertex = 24 + 4 * surface.scalars.len() + 3 * usize::from(surface.colours.is_some());
    let mut bytes = header.into_bytes();
    bytes.reserve_exact(per_vertex * positions.len() + 13 * triangles.len());
    for (vertex, position) in positions.iter().enumerate() {
        bytes.extend(position.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(surface.scalars.iter().flat_map(|(_, values)| values[vertex].to_le_bytes()));
        bytes.extend(surface.colours.iter().flat_map(|colours| colours[vertex]));
    }
    for corners in triangles {
        bytes.push(3);
        bytes.extend(corners.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}
