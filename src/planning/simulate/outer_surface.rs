use super::ready_mesh::ReadyMesh;
use prosopon_geometry::{GeometryError, Point, TriMesh};

/// Outer surface of a ready mesh.
///
/// It consists of the outer triangles of the prisms, or without prisms of the boundary away from bone.
#[derive(Debug, Clone, PartialEq)]
pub struct OuterSurface {
    /// Mesh node of each vertex.
    nodes: Vec<u32>,
    /// The surface at rest.
    pub rest: TriMesh,
}

impl OuterSurface {
    /// Outer surface of `ready` at rest.
    ///
    /// # Errors
    /// [`GeometryError`] when the mesh has no outer triangle.
    pub fn of(ready: &ReadyMesh) -> Result<Self, GeometryError> {
        let faces = ready.outer_faces();
        let mut nodes: Vec<u32> = faces.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let mut vertex_of = vec![0; ready.mesh.positions.len()];
        for (vertex, node) in nodes.iter().enumerate() {
            vertex_of[*node as usize] = vertex as u32;
        }
        let triangles = faces.into_iter().map(|face| face.map(|n| vertex_of[n as usize])).collect();
        let positions = nodes.iter().map(|n| ready.mesh.positions[*n as usize]).collect();
        Ok(Self { rest: TriMesh::new(positions, triangles)?, nodes })
    }

    /// The surface with all nodes of the mesh at the positions `nodes`, LPS mm.
    ///
    /// # Errors
    /// [`GeometryError`] when positions are not finite.
    pub fn at(&self, nodes: &[Point]) -> Result<TriMesh, GeometryError> {
        self.rest.with_positions(self.nodes.iter().map(|n| nodes[*n as usize]).collect())
    }
}
