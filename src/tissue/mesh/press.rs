//! Presses the layer that is always meshed back onto bone and air where tissue is thinner than the lattice resolves.

use rayon::prelude::*;

use super::domain::{InnerTissue, Side};
use super::quality::smallest_sine;
use super::stuffing::TetMesh;
use super::tuning::{FLATTEST_SINE, PROTRUSION_MM, THINNEST_PRISM_MM, THINNEST_TISSUE_EDGES};
use prosopon_geometry::Point;
use prosopon_geometry::control::{Cancelled, Control};

/// Result of pressing.
#[derive(Debug, Clone, Default)]
pub(super) struct Pressed {
    /// Surface onto which a node was dropped, bone or air; prisms there stand directly on it.
    pub(super) dropped: Vec<Option<Side>>,
    /// Nodes of the skin side where there is no tissue at all.
    pub(super) holes: Vec<bool>,
    /// Nodes placed inside bone; they must stay in place.
    pub(super) dipping: Vec<bool>,
    /// Number of tetrahedra removed.
    pub(super) removed: usize,
}

enum Move {
    Stay,
    Press(Point),
    Drop(Point, Side, bool),
    Hole,
}

/// Presses the layer under the skin onto bone and air where tissue is thin.
/// Between `thickness + carve` and `thickness + THINNEST_TISSUE_EDGES` edges of tissue the layer is compressed. Where there is less, it is
/// dropped and its tetrahedra are removed.
pub(super) fn press(
    inner: &InnerTissue<'_>,
    mesh: &mut TetMesh,
    sides: &[Option<Side>],
    control: &Control,
) -> Result<Pressed, Cancelled> {
    let decide = |node: usize| -> Move {
        let p = &mesh.positions[node];
        let thickness = inner.thickness_at(p);
        let floor = thickness + inner.carve;
        let least = thickness + THINNEST_TISSUE_EDGES * inner.edge;
        let depth = -inner.domain.skin.value(p);
        if depth > floor + 0.02 * inner.edge {
            return Move::Stay;
        }
        let Some(foot) = inner.foot(p, 2.0 * floor) else { return Move::Stay };
        let Some((below, side)) = inner.thickness_below(&foot, floor) else { return Move::Stay };
        let at = |depth: f64| foot.point - foot.normal * depth;
        if below < THINNEST_PRISM_MM {
            // Prisms need bone or tissue below them; a plug of skin over an airway has neither.
            if sides[node] == Some(Side::Skin) && (below < -PROTRUSION_MM || side == Side::Air) {
                return Move::Hole;
            }
            return Move::Drop(at(THINNEST_PRISM_MM), side, side == Side::Bone);
        }
        if below < least {
            return Move::Drop(at(below), side, false);
        }
        let share = (below - thickness) / inner.carve;
        let pressed = thickness + (depth - thickness).max(0.0) * share;
        Move::Press(at(pressed))
    };
    let n = mesh.positions.len();
    let moves: Vec<Move> = (0..n).into_par_iter().map(decide).collect();
    control.check()?;

    let mut pressed =
        Pressed { dropped: vec![None; n], holes: vec![false; n], dipping: vec![false; n], ..Pressed::default() };
    let mut touched = vec![false; n];
    for (node, step) in moves.into_iter().enumerate() {
        match step {
            Move::Stay => continue,
            Move::Press(p) => {
                if sides[node] == Some(Side::Skin) {
                    continue;
                }
                mesh.positions[node] = p;
            }
            Move::Drop(p, side, dips) => {
                mesh.positions[node] = p;
                pressed.dropped[node] = Some(side);
                pressed.dipping[node] = dips;
            }
            Move::Hole => {
                pressed.holes[node] = true;
                pressed.dropped[node] = Some(Side::Bone);
            }
        }
        touched[node] = true;
    }
    let before = mesh.tetrahedra.len();
    let positions = &mesh.positions;
    mesh.tetrahedra.retain(|t| {
        let any = t.iter().any(|&i| touched[i as usize]);
        let all_dropped = t.iter().all(|&i| pressed.dropped[i as usize].is_some());
        let hole = t.iter().any(|&i| pressed.holes[i as usize]);
        !any || (!all_dropped && !hole && smallest_sine(&t.map(|i| positions[i as usize])) > FLATTEST_SINE)
    });
    pressed.removed = before - mesh.tetrahedra.len();
    Ok(pressed)
}
