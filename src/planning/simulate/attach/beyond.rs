//! Where the mesh ends inside tissue: springs that stand for what lies beyond, instead of a wall.

use super::Nearness;
use crate::simulate::CutBone;
use crate::simulate::tuning::{BEYOND_MM, BEYOND_REACH_MM};
use prosopon_tissue::fem::material::Materials;
use prosopon_tissue::mesh::{Attachment, MixedMesh, boundary_triangles};

/// Frees the fixed nodes of the mesh's ends within reach of moving bone and returns a spring for each node of an end, N/mm.
///
/// A spring is as stiff as a column of muscle of the node's share of the area that is held [`BEYOND_MM`] farther on.
pub(in crate::simulate) fn open_ends(
    mesh: &mut MixedMesh,
    bone: &CutBone,
    moving: &[u32],
    materials: &Materials,
) -> Vec<f64> {
    let near = Nearness { solids: bone.solids(), moving };
    // Between shear, with the shear modulus, and tension, with three times as much.
    let per_area = 2.0 * materials.muscle.shear_modulus() / BEYOND_MM;
    let is_depth = |n: &u32| mesh.depth_cut_nodes.binary_search(n).is_ok();
    let is_end = |n: &u32| mesh.attachment[*n as usize] == Attachment::Fixed || is_depth(n);
    let mut springs = vec![0.0; mesh.positions.len()];
    for face in boundary_triangles(mesh).iter().filter(|face| face.iter().all(is_end)) {
        let [a, b, c] = face.map(|n| mesh.positions[n as usize]);
        let share = 0.5 * (b - a).cross(&(c - a)).norm() / 3.0;
        face.iter().for_each(|n| springs[*n as usize] += per_area * share);
    }
    for (node, spring) in springs.iter_mut().enumerate().filter(|(_, spring)| **spring > 0.0) {
        match mesh.attachment[node] {
            Attachment::Fixed if near.to_moving(&mesh.positions[node]) < BEYOND_REACH_MM => {
                mesh.attachment[node] = Attachment::Free;
            }
            Attachment::Free => {}
            Attachment::Fixed | Attachment::Tied(_) | Attachment::Gliding(_) | Attachment::Sliding => *spring = 0.0,
        }
    }
    springs
}
