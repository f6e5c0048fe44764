//! Moves outer nodes along the skin until the flat outer triangles follow it.
//! This includes moves up onto ridges and thin folds, whose crest is not the closest point of any node.

use super::adjacency::Rows;
use super::domain::{Foot, InnerTissue};
use super::lattice::STEPS;
use super::prisms::Layer;
use super::stuffing::TetMesh;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, Vector};

/// Largest distance of an edge's midpoint or an outer triangle's barycentre from the skin, mm.
/// It is below the guaranteed 0.3 mm because the later repair moves nodes.
pub(super) const NEAR_SKIN: f64 = 0.22;
/// A prism's scaled Jacobian may not fall below this, unless it was lower before.
const PRISM_FLOOR: f64 = 0.25;
/// Rounds over the nodes of outer triangles that are off the skin.
const ROUNDS: usize = 6;

/// Largest distance from the skin of an outer triangle's barycentre and edge midpoints, mm.
pub(super) fn stand_off(inner: &InnerTissue<'_>, [a, b, c]: &[Point; 3]) -> f64 {
    let barycentre = Point::from((a.coords + b.coords + c.coords) / 3.0);
    let middles = [nalgebra::center(a, b), nalgebra::center(b, c), nalgebra::center(c, a)];
    let distance = |p: &Point| inner.domain.skin.value(p).abs();
    middles.iter().map(distance).fold(distance(&barycentre), f64::max)
}

impl Layer {
    /// Distance of the outer triangle above `face` from the skin, mm; `None` when a foot is missing.
    pub(super) fn stand_off(&self, inner: &InnerTissue<'_>, face: &[u32; 3]) -> Option<f64> {
        let [a, b, c] = face.map(|n| self.feet[n as usize].map(|f| f.point));
        Some(stand_off(inner, &[a?, b?, c?]))
    }

    /// Moves the feet of outer triangles that are off the skin where that reduces the distances around them and keeps the
    /// prisms well shaped.
    pub(super) fn settle(
        &mut self,
        inner: &InnerTissue<'_>,
        mesh: &TetMesh,
        control: &Control,
    ) -> Result<(), Cancelled> {
        let n = mesh.positions.len();
        let prisms = Rows::incidence(n, &self.faces);
        // A search around nodes without a move in the last round would find nothing new.
        let mut stirred = vec![true; n];
        for _ in 0..ROUNDS {
            control.check()?;
            let mut wanted = vec![false; n];
            for face in self.faces.iter().filter(|f| f.iter().any(|&i| stirred[i as usize])) {
                if self.stand_off(inner, face).is_some_and(|s| s > NEAR_SKIN) {
                    face.iter().for_each(|&i| wanted[i as usize] = true);
                }
            }
            stirred.fill(false);
            for node in (0..n).filter(|&i| wanted[i]) {
                stirred[node] = self.settle_node(inner, mesh, prisms.row(node), node);
            }
            if !stirred.contains(&true) {
                break;
            }
        }
        Ok(())
    }

    fn settle_node(&mut self, inner: &InnerTissue<'_>, mesh: &TetMesh, prisms: &[u32], node: usize) -> bool {
        let Some(start) = self.feet[node] else { return false };
        let around = |layer: &Self| {
            let mut excess = 0.0;
            let mut quality = f64::INFINITY;
            for &f in prisms {
                let face = layer.faces[f as usize];
                excess += (layer.stand_off(inner, &face).unwrap_or(0.0) - NEAR_SKIN).max(0.0).powi(2);
                quality = quality.min(layer.quality(mesh, &face));
            }
            (excess, quality)
        };
        let (mut least, quality) = around(self);
        let floor = quality.min(PRISM_FLOOR);
        let mut best = start;
        let mut candidates = self.along_face_normal(inner, mesh, prisms, node);
        for length in [0.3, 0.15, 0.06] {
            for step in STEPS {
                let direction = Vector::from(step.map(f64::from)).normalize();
                let tangent = direction - start.normal * start.normal.dot(&direction);
                candidates.extend(inner.foot(&(start.point + tangent * (length * inner.edge)), inner.edge));
            }
        }
        for candidate in candidates {
            self.feet[node] = Some(candidate);
            let (excess, quality) = around(self);
            if excess < 0.98 * least && quality >= floor {
                (least, best) = (excess, candidate);
            }
        }
        self.feet[node] = Some(best);
        best.point != start.point
    }

    /// Skin point straight above the faces at a node.
    fn along_face_normal(&self, inner: &InnerTissue<'_>, mesh: &TetMesh, prisms: &[u32], node: usize) -> Vec<Foot> {
        let normal: Vector = prisms
            .iter()
            .map(|&f| {
                let [a, b, c] = self.faces[f as usize].map(|n| mesh.positions[n as usize]);
                (b - a).cross(&(c - a))
            })
            .sum();
        let foot = normal
            .try_normalize(1e-9)
            .and_then(|n| inner.foot_along(&mesh.positions[node], &n, inner.thickness + 1.5 * inner.edge));
        foot.into_iter().collect()
    }
}
