//! Moves outer nodes along the skin until the flat outer triangles follow it.
//! This includes moves up onto ridges and thin folds, whose crest is not the closest point of any node.

use super::adjacency::Rows;
use super::domain::{Foot, InnerTissue};
use super::lattice::STEPS;
use super::prisms::PrismLayer;
use super::stuffing::TetMesh;
use super::tuning::{FIT_JACOBIAN_FLOOR, FIT_ROUNDS, FIT_STEPS, TARGET_SKIN_DISTANCE_MM};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, Vector};

/// Largest distance from the skin of an outer triangle's barycentre and edge midpoints, mm.
pub(super) fn stand_off(inner: &InnerTissue<'_>, [a, b, c]: &[Point; 3]) -> f64 {
    let barycentre = Point::from((a.coords + b.coords + c.coords) / 3.0);
    let middles = [nalgebra::center(a, b), nalgebra::center(b, c), nalgebra::center(c, a)];
    let distance = |p: &Point| inner.domain.skin.value(p).abs();
    middles.iter().map(distance).fold(distance(&barycentre), f64::max)
}

impl PrismLayer {
    /// Distance of the outer triangle above `face` from the skin, mm; `None` when an outer node is missing.
    pub(super) fn stand_off(&self, inner: &InnerTissue<'_>, face: &[u32; 3]) -> Option<f64> {
        let [a, b, c] = face.map(|n| self.outer_nodes[n as usize].map(|f| f.point));
        Some(stand_off(inner, &[a?, b?, c?]))
    }

    /// Moves the outer nodes of outer triangles that are off the skin where that reduces the distances around them and keeps the
    /// prisms well shaped.
    pub(super) fn fit_outer_nodes(
        &mut self,
        inner: &InnerTissue<'_>,
        mesh: &TetMesh,
        control: &Control,
    ) -> Result<(), Cancelled> {
        let n = mesh.positions.len();
        let prisms = Rows::incidence(n, &self.faces);
        // A search around nodes without a move in the last round would find nothing new.
        let mut stirred = vec![true; n];
        for _ in 0..FIT_ROUNDS {
            control.check()?;
            let mut wanted = vec![false; n];
            for face in self.faces.iter().filter(|f| f.iter().any(|&i| stirred[i as usize])) {
                if self.stand_off(inner, face).is_some_and(|s| s > TARGET_SKIN_DISTANCE_MM) {
                    face.iter().for_each(|&i| wanted[i as usize] = true);
                }
            }
            stirred.fill(false);
            for node in (0..n).filter(|&i| wanted[i]) {
                stirred[node] = self.fit_outer_node(inner, mesh, prisms.row(node), node);
            }
            if !stirred.contains(&true) {
                break;
            }
        }
        Ok(())
    }

    fn fit_outer_node(&mut self, inner: &InnerTissue<'_>, mesh: &TetMesh, prisms: &[u32], node: usize) -> bool {
        let Some(start) = self.outer_nodes[node] else { return false };
        let around = |layer: &Self| {
            let mut excess = 0.0;
            let mut quality = f64::INFINITY;
            for &f in prisms {
                let face = layer.faces[f as usize];
                excess += (layer.stand_off(inner, &face).unwrap_or(0.0) - TARGET_SKIN_DISTANCE_MM).max(0.0).powi(2);
                quality = quality.min(layer.quality(mesh, &face));
            }
            (excess, quality)
        };
        let (mut least, quality) = around(self);
        let floor = quality.min(FIT_JACOBIAN_FLOOR);
        let mut best = start;
        let mut candidates = self.along_face_normal(inner, mesh, prisms, node);
        for length in FIT_STEPS {
            for step in STEPS {
                let direction = Vector::from(step.map(f64::from)).normalize();
                let tangent = direction - start.normal * start.normal.dot(&direction);
                candidates.extend(inner.foot(&(start.point + tangent * (length * inner.edge)), inner.edge));
            }
        }
        for candidate in candidates {
            self.outer_nodes[node] = Some(candidate);
            let (excess, quality) = around(self);
            if excess < 0.98 * least && quality >= floor {
                (least, best) = (excess, candidate);
            }
        }
        self.outer_nodes[node] = Some(best);
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
