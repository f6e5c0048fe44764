//! Extrudes the triangles of the skin side to a layer of prisms and repairs it where it folds.

use rayon::prelude::*;

use super::adjacency::{Rows, side_by_side};
use super::domain::{Foot, InnerTissue, Side};
use super::stuffing::TetMesh;
use super::trial::{Trial, quality};
use super::tuning::{MAX_SKIN_DISTANCE_MM, REPAIR_ROUNDS, WANTED_JACOBIAN, WORST_JACOBIAN};
use prosopon_geometry::control::{Cancelled, Control};
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
        let [a, b, c] = face.map(|n| self.outer_nodes[n as usize]);
        let (a, b, c) = (a?, b?, c?);
        let [d, e, f] = face.map(|n| mesh.positions[n as usize]);
        Some(([a.point, b.point, c.point, d, e, f], [a.normal, b.normal, c.normal]))
    }

    /// Smaller of the scaled Jacobians of the flat and the curved prism.
    pub(super) fn quality(&self, mesh: &TetMesh, face: &[u32; 3]) -> f64 {
        quality(self.corners(mesh, face))
    }

    /// Moves outer nodes along the skin and inner nodes on their own surface until all prisms are well shaped or no move
    /// improves them.
    pub(super) fn repair(
        &mut self,
        inner: &InnerTissue<'_>,
        mesh: &mut TetMesh,
        sides: &[Option<Side>],
        control: &Control,
    ) -> Result<(), Cancelled> {
        let n = mesh.positions.len();
        let prisms = Rows::incidence(n, &self.faces);
        let tetrahedra = Rows::incidence(n, &mesh.tetrahedra);
        // A search around nodes without a move in the last round would find nothing new.
        let mut stirred = vec![true; n];
        for _ in 0..REPAIR_ROUNDS {
            control.check()?;
            let wanted = self.nodes_of(&stirred, |layer, face| layer.quality(mesh, face) < WANTED_JACOBIAN);
            stirred.fill(false);
            if wanted.is_empty() {
                break;
            }
            for group in side_by_side(&wanted, &mesh.tetrahedra, &tetrahedra) {
                let search = |&node: &u32| {
                    let trial = Trial::new(inner, self, mesh, &prisms, node);
                    trial.repaired(tetrahedra.row(node as usize), sides[node as usize])
                };
                let found: Vec<(Option<Foot>, Point)> = group.par_iter().map(search).collect();
                for (node, (outer, position)) in group.iter().map(|&n| n as usize).zip(found) {
                    let before = (self.outer_nodes[node].map(|f| f.point), mesh.positions[node]);
                    stirred[node] = before != (outer.map(|f| f.point), position);
                    (self.outer_nodes[node], mesh.positions[node]) = (outer, position);
                }
            }
        }
        Ok(())
    }

    /// Nodes of the faces with a `stirred` node that `is_bad`, in rising order.
    pub(super) fn nodes_of(&self, stirred: &[bool], is_bad: impl Fn(&Self, &[u32; 3]) -> bool + Sync) -> Vec<u32> {
        let bad = self.faces.par_iter().filter(|f| f.iter().any(|&n| stirred[n as usize]) && is_bad(self, f));
        let mut nodes: Vec<u32> = bad.flat_map_iter(|f| *f).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
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
