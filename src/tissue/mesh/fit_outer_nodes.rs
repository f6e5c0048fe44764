//! Moves outer nodes along the skin until the flat outer triangles follow it.
//! This includes moves up onto ridges and thin folds, whose crest is not the closest point of any node.

use rayon::prelude::*;

use super::adjacency::{Rows, side_by_side};
use super::domain::{Foot, InnerTissue};
use super::prisms::PrismLayer;
use super::stuffing::TetMesh;
use super::trial::Trial;
use super::tuning::{FIT_ROUNDS, TARGET_SKIN_DISTANCE_MM};
use prosopon_geometry::Point;
use prosopon_geometry::control::{Cancelled, Control};

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
        let prisms = Rows::incidence(mesh.positions.len(), &self.faces);
        // A search around nodes without a move in the last round would find nothing new.
        let mut stirred = vec![true; mesh.positions.len()];
        for _ in 0..FIT_ROUNDS {
            control.check()?;
            let is_off = |layer: &Self, face: &[u32; 3]| {
                layer.stand_off(inner, face).is_some_and(|distance| distance > TARGET_SKIN_DISTANCE_MM)
            };
            let wanted = self.nodes_of(&stirred, is_off);
            stirred.fill(false);
            for group in side_by_side(&wanted, &self.faces, &prisms) {
                let search = |&node: &u32| Trial::new(inner, self, mesh, &prisms, node).fitted();
                let found: Vec<Option<Foot>> = group.par_iter().map(search).collect();
                for (node, foot) in group.iter().map(|&n| n as usize).zip(found) {
                    stirred[node] = self.outer_nodes[node].map(|f| f.point) != foot.map(|f| f.point);
                    self.outer_nodes[node] = foot;
                }
            }
            if !stirred.contains(&true) {
                break;
            }
        }
        Ok(())
    }
}
