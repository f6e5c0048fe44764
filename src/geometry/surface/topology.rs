//! Checks whether a triangle mesh is a closed two-manifold.

use crate::TriMesh;
use crate::connectivity::{Edges, Side};

/// Counts of the faults that keep a mesh from being a closed, oriented two-manifold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TopologyFaults {
    /// Edges with a single triangle.
    pub boundary_edges: usize,
    /// Edges with more than two triangles, or with two that traverse them in the same direction.
    pub nonmanifold_edges: usize,
    /// Vertices whose triangles do not form a single fan.
    pub nonmanifold_vertices: usize,
    /// Triangles with a repeated vertex or without area.
    pub degenerate_triangles: usize,
}

impl TopologyFaults {
    /// Counts the faults of `mesh`.
    #[must_use]
    pub fn of(mesh: &TriMesh) -> Self {
        let mut found = Self::default();
        found.count_edges(mesh);
        found.nonmanifold_vertices = vertices_without_one_fan(mesh).len();
        found.degenerate_triangles =
            (0..mesh.triangles().len()).filter(|&t| mesh.scaled_normal(t).norm_squared() == 0.0).count();
        found
    }

    /// Whether the mesh is a closed, consistently oriented two-manifold without degenerate triangles.
    #[must_use]
    pub fn is_closed_manifold(&self) -> bool {
        *self == Self::default()
    }

    fn count_edges(&mut self, mesh: &TriMesh) {
        for (_, group) in Edges::of(mesh.positions().len(), mesh.triangles()).iter() {
            match (group.len(), runs_both_ways(group)) {
                (1, _) => self.boundary_edges += 1,
                (2, true) => {}
                _ => self.nonmanifold_edges += 1,
            }
        }
    }
}

fn runs_both_ways(group: &[Side]) -> bool {
    group.iter().filter(|side| side.forward()).count() == 1
}

/// Vertices on a boundary or non-manifold edge, and vertices whose triangles do not form a single fan; may hold duplicates.
pub(super) fn irregular_vertices(mesh: &TriMesh) -> Vec<u32> {
    let edges = Edges::of(mesh.positions().len(), mesh.triangles());
    let faulty = edges.iter().filter(|(_, sides)| sides.len() != 2 || !runs_both_ways(sides));
    let mut found: Vec<u32> = faulty.flat_map(|(edge, _)| edge).collect();
    found.extend(vertices_without_one_fan(mesh));
    found
}

/// Vertices whose triangles cannot all be reached by walking from triangle to triangle around the vertex.
fn vertices_without_one_fan(mesh: &TriMesh) -> Vec<u32> {
    let mut found = Vec::new();
    // Per corner: (vertex, following corner, preceding corner); the fan walks from one to the next.
    let mut spokes: Vec<[u32; 3]> = Vec::with_capacity(3 * mesh.triangles().len());
    for t in mesh.triangles() {
        spokes.extend((0..3).map(|i| [t[i], t[(i + 1) % 3], t[(i + 2) % 3]]));
    }
    spokes.sort_unstable();
    for fan in spokes.chunk_by(|a, b| a[0] == b[0]) {
        // An open fan starts at the spoke at which none of its triangles ends.
        let open_start = fan.iter().find(|s| !fan.iter().any(|o| o[2] == s[1]));
        let start = open_start.unwrap_or(&fan[0])[1];
        let mut at = start;
        let mut walked = 0;
        while walked < fan.len() {
            let Ok(next) = fan.binary_search_by_key(&at, |s| s[1]) else { break };
            at = fan[next][2];
            walked += 1;
            if at == start {
                break;
            }
        }
        if walked != fan.len() {
            found.push(fan[0][0]);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;

    fn mesh(triangles: &[[u32; 3]]) -> TriMesh {
        let n = triangles.iter().flatten().max().unwrap() + 1;
        // Points on the moment curve: no three on a line.
        let p = (0..n).map(f64::from).map(|s| Point::new(s, s * s, s * s * s)).collect();
        TriMesh::new(p, triangles.to_vec()).unwrap()
    }

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    #[test]
    fn a_tetrahedron_is_a_closed_manifold_and_a_part_of_it_is_open() {
        assert!(TopologyFaults::of(&mesh(&TETRAHEDRON)).is_closed_manifold());
        let open = TopologyFaults::of(&mesh(&TETRAHEDRON[..3]));
        assert_eq!(open, TopologyFaults { boundary_edges: 3, ..TopologyFaults::default() });
    }

    #[test]
    fn a_turned_triangle_two_solids_at_a_vertex_and_a_flat_triangle_are_found() {
        let mut turned = TETRAHEDRON;
        turned[3] = [1, 3, 2];
        assert_eq!(TopologyFaults::of(&mesh(&turned)).nonmanifold_edges, 3);

        let mut touching = TETRAHEDRON.to_vec();
        touching.extend(TETRAHEDRON.map(|t| t.map(|v| if v == 0 { 0 } else { v + 3 })));
        let found = TopologyFaults::of(&mesh(&touching));
        assert_eq!(found, TopologyFaults { nonmanifold_vertices: 1, ..TopologyFaults::default() });

        assert_eq!(TopologyFaults::of(&mesh(&[[0, 1, 1]])).degenerate_triangles, 1);
    }
}
