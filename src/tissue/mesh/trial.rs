//! Searches for better places of one node of the prisms, while all other nodes stay.

use super::adjacency::Rows;
use super::domain::{Foot, InnerTissue, Side};
use super::lattice::STEPS;
use super::prisms::{PrismLayer, corners, quality, stand_off};
use super::quality::{scaled_jacobian, scaled_jacobian_curved, smallest_sine};
use super::stuffing::TetMesh;
use super::tuning::{
    BETTER, FIT_JACOBIAN_FLOOR, FIT_STEPS, REPAIR_SINE_FLOOR, REPAIR_STEPS, TARGET_SKIN_DISTANCE_MM, WANTED_JACOBIAN,
};
use prosopon_geometry::{Point, Vector};

/// The layer as it would be with the points of one node elsewhere.
pub(super) struct Trial<'a, 'd> {
    inner: &'a InnerTissue<'d>,
    layer: &'a PrismLayer,
    mesh: &'a TetMesh,
    /// Prisms at the node.
    prisms: &'a [u32],
    node: u32,
    outer: Option<Foot>,
    position: Point,
}

impl<'a, 'd> Trial<'a, 'd> {
    /// The node where it is; `prisms` are those at each node.
    pub(super) fn new(
        inner: &'a InnerTissue<'d>,
        layer: &'a PrismLayer,
        mesh: &'a TetMesh,
        prisms: &'a Rows,
        node: u32,
    ) -> Self {
        let (outer, position) = (layer.outer_nodes[node as usize], mesh.positions[node as usize]);
        Self { inner, layer, mesh, prisms: prisms.row(node as usize), node, outer, position }
    }

    /// Outer and inner point that a repair of the prisms gives the node; `tetrahedra` are those at it.
    pub(super) fn repaired(mut self, tetrahedra: &[u32], side: Option<Side>) -> (Option<Foot>, Point) {
        self.centre_outer();
        for length in REPAIR_STEPS {
            self.search_outer(length * self.inner.edge);
            self.search_inner(tetrahedra, side, length * self.inner.edge);
        }
        (self.outer, self.position)
    }

    /// Outer node with which the outer triangles around it follow the skin better, if that keeps the prisms well shaped.
    pub(super) fn fitted(mut self) -> Option<Foot> {
        let start = self.outer?;
        let mut least = self.excess(f64::INFINITY);
        let floor = self.worst().min(FIT_JACOBIAN_FLOOR);
        let mut best = start;
        let mut candidates: Vec<Foot> = self.along_face_normal().into_iter().collect();
        for length in FIT_STEPS {
            for step in STEPS {
                let direction = Vector::from(step.map(f64::from)).normalize();
                let tangent = direction - start.normal * start.normal.dot(&direction);
                let aim = start.point + tangent * (length * self.inner.edge);
                candidates.extend(self.inner.foot(&aim, self.inner.edge));
            }
        }
        for candidate in candidates {
            self.outer = Some(candidate);
            let excess = self.excess(0.98 * least);
            if excess < 0.98 * least && self.worst() >= floor {
                (least, best) = (excess, candidate);
            }
        }
        Some(best)
    }

    fn outer(&self, n: u32) -> Option<Foot> {
        if n == self.node { self.outer } else { self.layer.outer_nodes[n as usize] }
    }

    fn position(&self, n: u32) -> Point {
        if n == self.node { self.position } else { self.mesh.positions[n as usize] }
    }

    fn faces(&self) -> impl Iterator<Item = [u32; 3]> {
        self.prisms.iter().map(|&f| self.layer.faces[f as usize])
    }

    /// Corners and outer normals of the prism on a face; `None` when an outer node is missing.
    fn corners(&self, face: [u32; 3]) -> Option<([Point; 6], [Vector; 3])> {
        corners(&face, |n| self.outer(n), |n| self.position(n))
    }

    /// Least scaled Jacobian of the prisms around the node.
    fn worst(&self) -> f64 {
        self.faces().map(|face| quality(self.corners(face))).fold(f64::INFINITY, f64::min)
    }

    /// Whether all prisms around the node are better than `least`; stops at the first that is not.
    fn exceeds(&self, least: f64) -> bool {
        let is_better = |face| match self.corners(face) {
            Some((p, normals)) => {
                let is_worse = |quality: f64| quality <= least;
                !is_worse(scaled_jacobian(&p)) && !is_worse(scaled_jacobian_curved(&p, &normals))
            }
            None => false,
        };
        self.faces().all(is_better)
    }

    /// Sum of the squares of how far outer triangles are off the skin beyond the target; stops when it reaches `enough`.
    fn excess(&self, enough: f64) -> f64 {
        let mut sum = 0.0;
        for face in self.faces() {
            let [a, b, c] = face.map(|n| self.outer(n).map(|foot| foot.point));
            let (Some(a), Some(b), Some(c)) = (a, b, c) else { continue };
            sum += (stand_off(self.inner, &[a, b, c]) - TARGET_SKIN_DISTANCE_MM).max(0.0).powi(2);
            if sum >= enough {
                break;
            }
        }
        sum
    }

    /// Skin point straight above the faces at the node.
    fn along_face_normal(&self) -> Option<Foot> {
        let normals = self.faces().map(|face| {
            let [a, b, c] = face.map(|n| self.position(n));
            (b - a).cross(&(c - a))
        });
        let normal = normals.sum::<Vector>().try_normalize(1e-9)?;
        self.inner.foot_along(&self.position, &normal, self.inner.thickness + 1.5 * self.inner.edge)
    }

    /// Moves the outer node to `p`, projected onto the skin, when the worst prism becomes better than `before`.
    fn try_outer(&mut self, p: &Point, before: f64) -> bool {
        let old = self.outer;
        let Some(foot) = self.inner.foot(p, self.inner.edge) else { return false };
        self.outer = Some(foot);
        if self.exceeds(before + BETTER) {
            return true;
        }
        self.outer = old;
        false
    }

    fn centre_outer(&mut self) {
        let mut sum = Vector::zeros();
        let mut count = 0.0;
        for other in self.faces().flatten().filter(|&n| n != self.node) {
            if let Some(foot) = self.outer(other) {
                sum += foot.point.coords;
                count += 1.0;
            }
        }
        let Some(here) = self.outer else { return };
        let before = self.worst();
        if count > 0.0 && before < WANTED_JACOBIAN {
            let mean = Point::from(sum / count);
            for share in [1.0, 0.5, 0.25] {
                if self.try_outer(&(here.point + (mean - here.point) * share), before) {
                    return;
                }
            }
        }
    }

    fn search_outer(&mut self, length: f64) {
        let mut before = self.worst();
        for step in STEPS {
            if before >= WANTED_JACOBIAN {
                return;
            }
            let Some(here) = self.outer else { return };
            let direction = Vector::from(step.map(f64::from));
            let tangent = direction - here.normal * here.normal.dot(&direction);
            let Some(tangent) = tangent.try_normalize(1e-6) else { continue };
            if self.try_outer(&(here.point + tangent * length), before) {
                before = self.worst();
            }
        }
    }

    fn search_inner(&mut self, tetrahedra: &[u32], side: Option<Side>, length: f64) {
        let Some(side) = side else { return };
        let around = |trial: &Self| {
            let sine = |&t: &u32| smallest_sine(&trial.mesh.tetrahedra[t as usize].map(|n| trial.position(n)));
            tetrahedra.iter().map(sine).fold(f64::INFINITY, f64::min)
        };
        let at = |trial: &Self| (trial.worst(), around(trial).min(REPAIR_SINE_FLOOR));
        let (mut before, mut floor) = at(self);
        for step in STEPS {
            if before >= WANTED_JACOBIAN {
                return;
            }
            let here = self.position;
            let to = here + Vector::from(step.map(f64::from)).normalize() * length;
            let Some(p) = self.inner.project(side, &to, self.inner.edge) else { continue };
            self.position = p;
            if self.exceeds(before + BETTER) && around(self) >= floor {
                (before, floor) = at(self);
            } else {
                self.position = here;
            }
        }
    }
}
