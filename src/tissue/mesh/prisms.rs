//! Extrudes the triangles of the skin side to a layer of prisms.

use rayon::prelude::*;

use super::domain::{Foot, InnerTissue};
use super::quality::{scaled_jacobian, scaled_jacobian_curved};
use super::stuffing::TetMesh;
use super::tuning::{MAX_SKIN_DISTANCE_MM, WORST_JACOBIAN};
use prosopon_geometry::{Point, Vector};

/// Triangles of the skin side with one outer node per inner node.
pub(super) struct PrismLayer {
    /// Inner triangles, counter-clockwise seen from outside.
    pub(super) faces: Vec<[u32; 3]>,
    /// Outer node (foot on the skin) above each node of the tetrahedra; `None` away from the skin side.
    pub(super) outer_nodes: Vec<Option<Foot>>,
}

impl PrismLayer {
    /// Extrudes the triangles' nodes to the skin.
    /// Faces with a node for which no outer node is found are left out; returns their number too.
    pub(super) fn extrude(inner: &InnerTissue<'_>, mesh: &TetMesh, faces: &[[u32; 3]]) -> (Self, usize) {
        let mut wanted = vec![false; mesh.positions.len()];
        for &node in faces.iter().flatten() {
            wanted[node as usize] = true;
        }
        let reach = inner.foot_reach();
        let outer_nodes: Vec<Option<Foot>> = wanted
            .par_iter()
            .enumerate()
            .map(|(node, wanted)| if *wanted { inner.foot(&mesh.positions[node], reach) } else { None })
            .collect();
        let kept: Vec<[u32; 3]> =
            faces.iter().copied().filter(|f| f.iter().all(|&n| outer_nodes[n as usize].is_some())).collect();
        let lost = faces.len() - kept.len();
        (Self { faces: kept, outer_nodes }, lost)
    }

    /// Corners and outer normals of the prism on face `f`; `None` when an outer node is missing.
    pub(super) fn corners(&self, mesh: &TetMesh, face: &[u32; 3]) -> Option<([Point; 6], [Vector; 3])> {
        corners(face, |n| self.outer_nodes[n as usize], |n| mesh.positions[n as usize])
    }

    /// Smaller of the scaled Jacobians of the flat and the curved prism.
    pub(super) fn quality(&self, mesh: &TetMesh, face: &[u32; 3]) -> f64 {
        quality(self.corners(mesh, face))
    }

    /// Nodes of the faces with a `stirred` node that `is_bad`, in rising order.
    pub(super) fn nodes_of(&self, stirred: &[bool], is_bad: impl Fn(&Self, &[u32; 3]) -> bool + Sync) -> Vec<u32> {
        let bad = self.faces.par_iter().filter(|f| f.iter().any(|&n| stirred[n as usize]) && is_bad(self, f));
        let mut nodes: Vec<u32> = bad.flat_map_iter(|f| *f).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Distance of the outer triangle above `face` from the skin, mm; `None` when an outer node is missing.
    pub(super) fn stand_off(&self, inner: &InnerTissue<'_>, face: &[u32; 3]) -> Option<f64> {
        let [a, b, c] = face.map(|n| self.outer_nodes[n as usize].map(|f| f.point));
        Some(stand_off(inner, &[a?, b?, c?]))
    }

    /// Leaves out the prisms that are still badly shaped and returns their number.
    pub(super) fn drop_bad(&mut self, mesh: &TetMesh) -> usize {
        self.keep(|layer, f| layer.quality(mesh, f) >= WORST_JACOBIAN)
    }

    /// Leaves out the prisms whose outer triangles are still off the skin, and returns their number.
    /// These cut off folds that are too thin for the lattice.
    pub(super) fn drop_off_skin(&mut self, inner: &InnerTissue<'_>) -> usize {
        self.keep(|layer, f| {
            layer.barycentre(f).is_some_and(|p| inner.domain.skin.value(&p).abs() <= MAX_SKIN_DISTANCE_MM)
        })
    }

    /// Keeps the prisms that are `wanted`; returns the number of the others.
    pub(super) fn keep(&mut self, wanted: impl Fn(&Self, &[u32; 3]) -> bool) -> usize {
        let before = self.faces.len();
        let kept = self.faces.iter().copied().filter(|f| wanted(self, f)).collect();
        self.faces = kept;
        before - self.faces.len()
    }

    /// Barycentre of the outer triangle above `face`.
    fn barycentre(&self, face: &[u32; 3]) -> Option<Point> {
        let [a, b, c] = face.map(|n| self.outer_nodes[n as usize].map(|f| f.point.coords));
        Some(Point::from((a? + b? + c?) / 3.0))
    }
}

/// Largest distance from the skin of an outer triangle's barycentre and edge midpoints, mm.
pub(super) fn stand_off(inner: &InnerTissue<'_>, [a, b, c]: &[Point; 3]) -> f64 {
    let barycentre = Point::from((a.coords + b.coords + c.coords) / 3.0);
    let middles = [nalgebra::center(a, b), nalgebra::center(b, c), nalgebra::center(c, a)];
    let distance = |p: &Point| inner.domain.skin.value(p).abs();
    middles.iter().map(distance).fold(distance(&barycentre), f64::max)
}

/// Corners and outer normals of the prism on a face of nodes; `None` when an outer node is missing.
pub(super) fn corners(
    face: &[u32; 3],
    outer: impl Fn(u32) -> Option<Foot>,
    position: impl Fn(u32) -> Point,
) -> Option<([Point; 6], [Vector; 3])> {
    let [a, b, c] = face.map(outer);
    let (a, b, c) = (a?, b?, c?);
    let [d, e, f] = face.map(position);
    Some(([a.point, b.point, c.point, d, e, f], [a.normal, b.normal, c.normal]))
}

/// Smaller of the scaled Jacobians of the flat and the curved prism; -1 for one without all its corners.
pub(super) fn quality(corners: Option<([Point; 6], [Vector; 3])>) -> f64 {
    corners.map_or(-1.0, |(p, n)| scaled_jacobian(&p).min(scaled_jacobian_curved(&p, &n)))
}
