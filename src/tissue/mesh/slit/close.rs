use super::super::adjacency::boundary;
use super::super::classify::tissue_at;
use super::super::domain::InnerTissue;
use super::super::prisms::PrismLayer;
use super::super::quality::{scaled_jacobian, scaled_jacobian_curved};
use super::super::smooth::Relaxation;
use super::super::stuffing::TetMesh;
use super::super::tuning::{FACING_GAP_MM, SMOOTHING_ROUNDS, WORST_JACOBIAN};
use super::super::{Facing, MixedMesh};
use super::Opening;
use prosopon_geometry::Point;
use prosopon_geometry::control::{Cancelled, Control};

/// Leaves out prisms that are badly shaped when the slit is closed; returns their number.
///
/// They lie in the corners of the slit, where the skin folds by half a turn.
pub(in super::super) fn drop_folded_when_closed(
    layer: &mut PrismLayer,
    mesh: &TetMesh,
    opening: &Opening<'_>,
) -> usize {
    layer.keep(|layer, face| {
        layer.corners(mesh, face).is_some_and(|(p, normals)| {
            let closed = p.map(|q| opening.closed(&q));
            let turned = [0, 1, 2].map(|i| opening.closed_normal(&p[i], &normals[i]));
            scaled_jacobian(&closed).min(scaled_jacobian_curved(&closed, &turned)) >= WORST_JACOBIAN
        })
    })
}

/// Moves a mesh of opened tissue back to rest and marks the red margins.
///
/// `inner` is the tissue at rest, which tells fat from muscle.
pub(in super::super) fn close(
    mesh: &mut MixedMesh,
    opening: &Opening<'_>,
    inner: &InnerTissue<'_>,
    control: &Control,
) -> Result<(), Cancelled> {
    let margin = |nodes: [u32; 3]| -> Option<usize> {
        let places = nodes.map(|n| mesh.positions[n as usize]);
        let is_on_wall = places.iter().all(|p| opening.gap(p).0.abs() < FACING_GAP_MM);
        let below = places.map(|p| opening.slit.height(&p) < 0.0);
        (is_on_wall && below[0] == below[1] && below[1] == below[2]).then_some(usize::from(below[0]))
    };
    let mut facing = Facing::default();
    for p in &mesh.prisms {
        let outer = [p[0], p[1], p[2]];
        if let Some(side) = margin(outer) {
            facing.sides[side].push(outer);
        }
    }
    let closed: Vec<_> = mesh.positions.iter().map(|p| opening.closed(p)).collect();
    let moved: Vec<bool> = closed.iter().zip(&mesh.positions).map(|(c, p)| c != p).collect();
    mesh.positions = closed;
    improve_inside(mesh, inner, control)?;
    for (tetrahedron, tissue) in mesh.tetrahedra.iter().zip(&mut mesh.tetrahedron_tissue) {
        if tetrahedron.iter().any(|n| moved[*n as usize]) {
            *tissue = tissue_at(inner, tetrahedron.map(|n| mesh.positions[n as usize]));
        }
    }
    // In the corners of the mouth triangles may end up off the slit, or turned away from the other lip.
    let positions = &mesh.positions;
    for (side, sign) in facing.sides.iter_mut().zip([1.0, -1.0]) {
        side.retain(|t| {
            let [a, b, c] = t.map(|n| positions[n as usize]);
            let is_near = |p: &Point| (-1e-9..FACING_GAP_MM).contains(&(sign * opening.slit.height(p)));
            sign * (b - a).cross(&(c - a)).z < 0.0 && [a, b, c].iter().all(is_near)
        });
    }
    if facing.sides.iter().all(|side| !side.is_empty()) {
        mesh.facing.push(facing);
    }
    Ok(())
}

/// Improves tetrahedra by moving nodes that lie on no boundary: beside the corners of the slit the map back has kinks.
fn improve_inside(mesh: &mut MixedMesh, inner: &InnerTissue<'_>, control: &Control) -> Result<(), Cancelled> {
    let n = mesh.positions.len();
    let mut pinned = vec![false; n];
    for &node in boundary(&mesh.tetrahedra).iter().flat_map(|f| &f.nodes) {
        pinned[node as usize] = true;
    }
    mesh.prisms.iter().flatten().for_each(|&node| pinned[node as usize] = true);
    let mut tissue =
        TetMesh { positions: std::mem::take(&mut mesh.positions), tetrahedra: std::mem::take(&mut mesh.tetrahedra) };
    let done = Relaxation::new(inner, &mut tissue, &vec![None; n], &pinned, &[]).improve(SMOOTHING_ROUNDS, control);
    (mesh.positions, mesh.tetrahedra) = (tissue.positions, tissue.tetrahedra);
    done
}
