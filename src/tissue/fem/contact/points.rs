//! Points of the tissue at which contact acts.

use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::{Point, Vector};

/// A point of the tissue's inner surface, as a weighted mean of nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct ContactPoint {
    pub(super) nodes: [u32; 3],
    pub(super) weights: [f64; 3],
    /// Share of the surface area at rest, mm².
    pub(super) area: f64,
    /// Direction into the tissue at rest; not a unit vector.
    pub(super) inward: Vector,
}

impl ContactPoint {
    pub(super) fn at(&self, x: &[Vector]) -> Point {
        let [a, b, c] = self.nodes.map(|n| x[n as usize]);
        Point::from(a * self.weights[0] + b * self.weights[1] + c * self.weights[2])
    }

    /// Nodes with positive weight, each once, and their weights.
    pub(super) fn terms(&self) -> impl Iterator<Item = (u32, f64)> {
        (0..3).map(|i| (self.nodes[i], self.weights[i])).filter(|(_, w)| *w > 0.0)
    }
}

/// Mesh nodes that contact can act on.
pub(in crate::fem) fn contact_nodes(mesh: &MixedMesh) -> Vec<bool> {
    let mut found = vec![false; mesh.positions.len()];
    for point in contact_points(mesh) {
        for (node, _) in point.terms() {
            found[node as usize] = true;
        }
    }
    found
}

pub(super) fn contact_points(mesh: &MixedMesh) -> Vec<ContactPoint> {
    let sliding = |n: u32| mesh.attachment[n as usize] == Attachment::Sliding;
    let free = |n: u32| mesh.attachment[n as usize] == Attachment::Free;
    let (mut vertex_area, mut vertex_inward) =
        (vec![0.0; mesh.positions.len()], vec![Vector::zeros(); mesh.positions.len()]);
    let inward_of = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|n| mesh.positions[n as usize]);
        (c - a).cross(&(b - a))
    };
    let mut points = Vec::new();
    let (whole, edge): (Vec<&[u32; 3]>, Vec<&[u32; 3]>) = (mesh.bone_faces.iter())
        .filter(|face| face.iter().any(|&n| sliding(n)))
        .partition(|face| !face.iter().any(|&n| free(n)));
    for face in whole {
        let inward = inward_of(face);
        let area = 0.5 * inward.norm();
        points.push(ContactPoint { nodes: *face, weights: [1.0 / 3.0; 3], area: 0.5 * area, inward });
        for &n in face {
            vertex_inward[n as usize] += inward;
            vertex_area[n as usize] += area / 6.0;
        }
    }
    // A vertex whose faces all have a free corner takes its share of those faces only.
    let mut alone: Vec<(usize, Vector)> = Vec::new();
    for face in edge {
        for &n in face.iter().filter(|n| sliding(**n) && vertex_area[**n as usize] == 0.0) {
            alone.push((n as usize, inward_of(face)));
        }
    }
    for (node, inward) in alone {
        vertex_inward[node] += inward;
        vertex_area[node] += inward.norm() / 6.0;
    }
    for (node, &area) in vertex_area.iter().enumerate() {
        if area > 0.0 && sliding(node as u32) {
            let inward = vertex_inward[node];
            points.push(ContactPoint { nodes: [node as u32; 3], weights: [1.0, 0.0, 0.0], area, inward });
        }
    }
    points
}
