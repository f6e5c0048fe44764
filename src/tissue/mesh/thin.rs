//! Where tissue is thinner than the lattice resolves: the layer that was meshed regardless is pressed back onto the bone.

use rayon::prelude::*;

use super::domain::{InnerTissue, Side};
use super::quality::smallest_sine;
use super::stuffing::TetMesh;
use prosopon_geometry::Point;
use prosopon_geometry::control::{Cancelled, Control};

/// Tissue below the skin layer thinner than this share of an edge has no tetrahedra: prisms stand on the bone.
const THINNEST: f64 = 0.5;
/// Tetrahedra at pressed nodes that are flatter than this (sine of the smallest dihedral angle) go.
const FLATTEST: f64 = 0.14; // 8°
/// Thinnest prism, mm; where skin and bone are nearer, the prism dips into the bone.
const THINNEST_PRISM: f64 = 0.3;
/// Bone that pokes out of the skin by more than this leaves a hole in the skin layer, mm.
const POKING_OUT: f64 = 0.3;

/// What pressing did.
#[derive(Debug, Clone, Default)]
pub(super) struct Pressed {
    /// Nodes that were dropped onto bone or air: surface and depth below the skin; prisms there stand straight on it.
    pub(super) dropped: Vec<Option<Side>>,
    /// Nodes of the skin side where there is no tissue at all.
    pub(super) holes: Vec<bool>,
    /// Nodes that had to be put inside bone: they stay where they are.
    pub(super) dipping: Vec<bool>,
    /// Tetrahedra removed.
    pub(super) removed: usize,
}

enum Move {
    Stay,
    Press(Point),
    Drop(Point, Side, bool),
    Hole,
}

/// Presses the layer under the skin onto bone and air where tissue is thin: between `thickness + carve` and
/// `thickness + THINNEST` edges of tissue the layer is compressed, below that dropped and its tetrahedra removed.
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
        let least = thickness + THINNEST * inner.edge;
        let depth = -inner.domain.skin.value(p);
        if depth > floor + 0.02 * inner.edge {
            return Move::Stay;
        }
        let Some(foot) = inner.foot(p, 2.0 * floor) else { return Move::Stay };
        let Some((below, side)) = inner.thickness_below(&foot, floor) else { return Move::Stay };
        let at = |depth: f64| foot.point - foot.normal * depth;
        if below < THINNEST_PRISM {
            // Under a plug of skin over an airway there is nothing to hold.
            if sides[node] == Some(Side::Skin) && (below < -POKING_OUT || side == Side::Air) {
                return Move::Hole;
            }
            return Move::Drop(at(THINNEST_PRISM), side, side == Side::Bone);
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
        !any || (!all_dropped && !hole && smallest_sine(&t.map(|i| positions[i as usize])) > FLATTEST)
    });
    pressed.removed = before - mesh.tetrahedra.len();
    Ok(pressed)
}
