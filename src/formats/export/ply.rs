use super::SurfaceView;
use super::view::identifier;
use crate::import::LPS_MARKER;

/// Binary little-endian PLY with scalars (`float`) and colours as vertex properties.
///
/// Coordinates are `double`, so that they come back unchanged. A comment states `SPACE=LPS`, which 3D Slicer reads too.
///
/// ```
/// use prosopon_formats::export::{SurfaceView, ply};
/// use prosopon_formats::import::{Limits, SurfaceFormat, surface};
/// use prosopon_geometry::{Point, TriMesh};
///
/// let positions = vec![Point::new(0.1, 0.0, 0.0), Point::new(100.0, 0.0, 0.0), Point::new(0.0, 100.0, 0.0)];
/// let mesh = TriMesh::new(positions, vec![[0, 1, 2]])?;
/// let scalars: &[(&str, &[f32])] = &[("displacement_mm", &[0.0, 1.5, 3.0])];
/// let bytes = ply(&SurfaceView { mesh: &mesh, scalars, colours: None });
/// let (read, warnings) = surface(&bytes, SurfaceFormat::Ply, &Limits::default())?;
/// assert_eq!(read, mesh);
/// assert!(warnings.is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Panics
/// When scalars or colours do not have exactly one value per vertex.
#[must_use]
pub fn ply(surface: &SurfaceView<'_>) -> Vec<u8> {
    surface.assert_lengths();
    let (positions, triangles) = (surface.mesh.positions(), surface.mesh.triangles());
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment Prosopon. {LPS_MARKER} UNIT=mm\nelement vertex {}\n\
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
