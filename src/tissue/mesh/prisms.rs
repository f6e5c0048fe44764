//! Extrudes the triangles of the skin side to a layer of prisms and repairs it where it folds.

use rayon::prelude::*;

use super::adjacency::Rows;
use super::domain::{Foot, InnerTissue, Side};
use super::lattice::STEPS;
use super::quality::{scaled_jacobian, scaled_jacobian_curved, smallest_sine};
use super::stuffing::TetMesh;
use super::tuning::{
    BETTER, MAX_SKIN_DISTANCE_MM, REPAIR_ROUNDS, REPAIR_SINE_FLOOR, REPAIR_STEPS, WANTED_JACOBIAN, WORST_JACOBIAN,
};
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
        self.corners(mesh, face).map_or(-1.0, |(p, n)| scaled_jacobian(&p).min(scaled_jacobian_curved(&p, &n)))
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
            let mut wanted = vec![false; n];
            for face in self.faces.iter().filter(|f| f.iter().any(|&i| stirred[i as usize])) {
                if self.quality(mesh, face) < WANTED_JACOBIAN {
                    for &node in face {
                        wanted[node as usize] = true;
                    }
                }
            }
            stirred.fill(false);
            if !wanted.contains(&true) {
                break;
            }
            for node in (0..n).filter(|&i| wanted[i]) {
                let before = (self.outer_nodes[node].map(|f| f.point), mesh.positions[node]);
                self.centre_outer(inner, mesh, &prisms, node);
                for length in REPAIR_STEPS {
                    self.search_outer(inner, mesh, &prisms, node, length * inner.edge);
                    self.search_inner(inner, mesh, (&prisms, &tetrahedra), sides[node], node, length * inner.edge);
                }
                stirred[node] = before != (self.outer_nodes[node].map(|f| f.point), mesh.positions[node]);
            }
        }
        Ok(())
    }

    fn worst(&self, mesh: &TetMesh, prisms: &Rows, node: usize) -> f64 {
        prisms.row(node).iter().map(|&f| self.quality(mesh, &self.faces[f as usize])).fold(f64::INFINITY, f64::min)
    }

    /// Whether all prisms at `node` are better than `least`; stops at the first that is not.
    fn exceeds(&self, mesh: &TetMesh, prisms: &Rows, node: usize, least: f64) -> bool {
        let is_better = |f: &u32| match self.corners(mesh, &self.faces[*f as usize]) {
            Some((p, normals)) => {
                let is_worse = |quality: f64| quality <= least;
                !is_worse(scaled_jacobian(&p)) && !is_worse(scaled_jacobian_curved(&p, &normals))
            }
            None => false,
        };
        prisms.row(node).iter().all(is_better)
    }

    /// Moves the outer node above `node` to `p`, projected onto the skin, when the worst prism there becomes better than `before`.
    fn try_outer(
        &mut self,
        inner: &InnerTissue<'_>,
        mesh: &TetMesh,
        prisms: &Rows,
        (node, p): (usize, &Point),
        before: f64,
    ) -> bool {
        let old = self.outer_nodes[node];
        let Some(foot) = inner.foot(p, inner.edge) else { return false };
        self.outer_nodes[node] = Some(foot);
        if self.exceeds(mesh, prisms, node, before + BETTER) {
            return true;
        }
        self.outer_nodes[node] = old;
        false
    }

    fn centre_outer(&mut self, inner: &InnerTissue<'_>, mesh: &TetMesh, prisms: &Rows, node: usize) {
        let mut sum = Vector::zeros();
        let mut count = 0.0;
        for &f in prisms.row(node) {
            for &other in self.faces[f as usize].iter().filter(|&&o| o as usize != node) {
                if let Some(foot) = self.outer_nodes[other as usize] {
                    sum += foot.point.coords;
                    count += 1.0;
                }
            }
        }
        let Some(here) = self.outer_nodes[node] else { return };
        let before = self.worst(mesh, prisms, node);
        if count > 0.0 && before < WANTED_JACOBIAN {
            let mean = Point::from(sum / count);
            for share in [1.0, 0.5, 0.25] {
                let to = here.point + (mean - here.point) * share;
                if self.try_outer(inner, mesh, prisms, (node, &to), before) {
                    return;
                }
            }
        }
    }

    fn search_outer(&mut self, inner: &InnerTissue<'_>, mesh: &TetMesh, prisms: &Rows, node: usize, length: f64) {
        let mut before = self.worst(mesh, prisms, node);
        for step in STEPS {
            if before >= WANTED_JACOBIAN {
                return;
            }
            let Some(here) = self.outer_nodes[node] else { return };
            let direction = Vector::from(step.map(f64::from));
            let tangent = direction - here.normal * here.normal.dot(&direction);
            let Some(tangent) = tangent.try_normalize(1e-6) else { continue };
            if self.try_outer(inner, mesh, prisms, (node, &(here.point + tangent * length)), before) {
                before = self.worst(mesh, prisms, node);
            }
        }
    }

    fn search_inner(
        &mut self,
        inner: &InnerTissue<'_>,
        mesh: &mut TetMesh,
        (prisms, tetrahedra): (&Rows, &Rows),
        side: Option<Side>,
        node: usize,
        length: f64,
    ) {
        let Some(side) = side else { return };
        let around = |mesh: &TetMesh| {
            let worst = tetrahedra
                .row(node)
                .iter()
                .map(|&t| smallest_sine(&mesh.tetrahedra[t as usize].map(|i| mesh.positions[i as usize])));
            worst.fold(f64::INFINITY, f64::min)
        };
        let at = |layer: &Self, mesh: &TetMesh| (layer.worst(mesh, prisms, node), around(mesh).min(REPAIR_SINE_FLOOR));
        let (mut before, mut floor) = at(self, mesh);
        for step in STEPS {
            if before >= WANTED_JACOBIAN {
                return;
            }
            let here = mesh.positions[node];
            let to = here + Vector::from(step.map(f64::from)).normalize() * length;
            let Some(p) = inner.project(side, &to, inner.edge) else { continue };
            mesh.positions[node] = p;
            if self.exceeds(mesh, prisms, node, before + BETTER) && around(mesh) >= floor {
                (before, floor) = at(self, mesh);
            } else {
                mesh.positions[node] = here;
            }
        }
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
