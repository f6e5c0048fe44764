//! Repair of prisms that fold or are badly shaped.

use rayon::prelude::*;

use super::MeshError;
use super::adjacency::{Rows, side_by_side};
use super::domain::{Foot, InnerTissue, Side};
use super::prisms::PrismLayer;
use super::stuffing::TetMesh;
use super::trial::Trial;
use super::tuning::{REPAIR_ROUNDS, ROUGH_AFTER_ROUNDS, ROUGH_SHARE, WANTED_JACOBIAN};
use prosopon_geometry::Point;
use prosopon_geometry::control::Control;

impl PrismLayer {
    /// Moves outer nodes along the skin and inner nodes on their own surface until all prisms are well shaped or no move
    /// improves them.
    ///
    /// # Errors
    /// [`MeshError::RoughSkin`] when most prisms stay badly shaped: each round then takes as long as the first, and the mesh would
    /// have no skin. Cancellation.
    pub(super) fn repair(
        &mut self,
        inner: &InnerTissue<'_>,
        mesh: &mut TetMesh,
        sides: &[Option<Side>],
        control: &Control,
    ) -> Result<(), MeshError> {
        let n = mesh.positions.len();
        let nodes = self.nodes_of(&vec![true; n], |_, _| true).len();
        let prisms = Rows::incidence(n, &self.faces);
        let tetrahedra = Rows::incidence(n, &mesh.tetrahedra);
        // A search around nodes without a move in the last round would find nothing new.
        let mut stirred = vec![true; n];
        for round in 0..REPAIR_ROUNDS {
            control.check()?;
            let wanted = self.nodes_of(&stirred, |layer, face| layer.quality(mesh, face) < WANTED_JACOBIAN);
            stirred.fill(false);
            if wanted.is_empty() {
                break;
            }
            if round >= ROUGH_AFTER_ROUNDS && wanted.len() as f64 > ROUGH_SHARE * nodes as f64 {
                return Err(MeshError::RoughSkin { edge_mm: inner.edge, nodes, folded: wanted.len() });
            }
            for group in side_by_side(&wanted, &mesh.tetrahedra, &tetrahedra) {
                control.check()?;
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
}
