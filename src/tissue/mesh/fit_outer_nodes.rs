//! Moves outer nodes along the skin until the flat outer triangles follow it.
//! This includes moves up onto ridges and thin folds, whose crest is not the closest point of any node.

use rayon::prelude::*;

use super::adjacency::{Rows, side_by_side};
use super::domain::{Foot, InnerTissue};
use super::prisms::PrismLayer;
use super::stuffing::TetMesh;
use super::trial::Trial;
use super::tuning::{FIT_ROUNDS, TARGET_SKIN_DISTANCE_MM};
use prosopon_geometry::control::{Cancelled, Control};

impl PrismLayer {
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
                control.check()?;
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
