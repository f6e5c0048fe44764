//! Presses the layer that is always meshed back onto bone and air where tissue is thinner than the lattice resolves.

use rayon::prelude::*;

use super::domain::{InnerTissue, Side};
use super::quality::smallest_sine;
use super::stuffing::TetMesh;
use super::tuning::{FLATTEST_SINE, PROTRUSION_MM, THINNEST_PRISM_MM, THINNEST_TISSUE_EDGES};
use prosopon_geometry::Point;
use prosopon_geometry::control::{Cancelled, Control};

/// Result of pressing.
#[derive(Debug, Clone)]
pub(super) struct Pressed {
    /// Surface onto which a node was dropped, bone or air; prisms there stand directly on it.
    pub(super) dropped: Vec<Option<Side>>,
    /// Nodes of the skin side where there is no tissue at all.
    pub(super) holes: Vec<bool>,
    /// Nodes placed inside bone; they must stay in place.
    pub(super) dipping: Vec<bool>,
}

/// What pressing does with a node.
enum Move {
    Stay,
    /// Towards bone or air, within the layer that is always meshed.
    Press(Point),
    /// Onto bone or air.
    Drop(Point, Side),
    /// Into bone, because the thinnest prism does not fit above it.
    Dip(Point),
    /// Nowhere: bone or air leaves no tissue under the skin.
    Hole(Side),
}

/// Presses the layer under the skin onto bone and air where tissue is thin.
/// Between `thickness + carve` and `thickness +` [`THINNEST_TISSUE_EDGES`] edges of tissue the layer is compressed. Where there
/// is less, it is dropped and its tetrahedra are removed.
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
        let depth = -inner.layer_value(p, inner.domain.skin.value(p));
        if depth > floor + 0.02 * inner.edge {
            return Move::Stay;
        }
        let Some(foot) = inner.foot(p, 2.0 * floor) else { return Move::Stay };
        let Some((below, side)) = inner.thickness_below(&foot, floor) else { return Move::Stay };
        let at = |depth: f64| foot.point - foot.normal * depth;
        if below < THINNEST_PRISM_MM {
            // Prisms need bone or tissue below them; a plug of skin over an airway has neither.
            if sides[node] == Some(Side::Skin) && (below < -PROTRUSION_MM || side == Side::Air) {
                return Move::Hole(side);
            }
            let lowest = at(THINNEST_PRISM_MM);
            return if side == Side::Bone { Move::Dip(lowest) } else { Move::Drop(lowest, side) };
        }
        if below < least {
            return Move::Drop(at(below), side);
        }
        let share = (below - thickness) / inner.carve;
        let pressed = thickness + (depth - thickness).max(0.0) * share;
        Move::Press(at(pressed))
    };
    let n = mesh.positions.len();
    let moves: Vec<Move> = (0..n).into_par_iter().map(decide).collect();
    control.check()?;

    let mut pressed = Pressed { dropped: vec![None; n], holes: vec![false; n], dipping: vec![false; n] };
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
            Move::Drop(p, side) => {
                mesh.positions[node] = p;
                pressed.dropped[node] = Some(side);
            }
            Move::Dip(p) => {
                mesh.positions[node] = p;
                pressed.dropped[node] = Some(Side::Bone);
                pressed.dipping[node] = true;
            }
            Move::Hole(side) => {
                pressed.holes[node] = true;
                pressed.dropped[node] = Some(side);
            }
        }
        touched[node] = true;
    }
    let positions = &mesh.positions;
    mesh.tetrahedra.retain(|t| {
        let any = t.iter().any(|&i| touched[i as usize]);
        let all_dropped = t.iter().all(|&i| pressed.dropped[i as usize].is_some());
        let hole = t.iter().any(|&i| pressed.holes[i as usize]);
        !any || (!all_dropped && !hole && smallest_sine(&t.map(|i| positions[i as usize])) > FLATTEST_SINE)
    });
    Ok(pressed)
}

#[cfg(test)]
mod tests {
    use super::super::adjacency::boundary;
    use super::super::domain::{Domain, MeshSettings, Region};
    use super::super::stuffing::{lattice_over, refine, stuff};
    use super::super::test_domain::{Nothing, Shape};
    use super::*;
    use prosopon_geometry::Aabb;

    /// A ball of bone and a ball of air that both protrude from flat skin by 0.5 mm.
    #[test]
    fn a_hole_of_the_skin_layer_has_the_side_of_what_makes_it() {
        let skin = Shape(Box::new(|p: &Point| p.z));
        let bone = Shape::ball(Point::new(-11.0, 0.0, -6.5), 7.0);
        let air = Shape::ball(Point::new(11.0, 0.0, -6.5), 7.0);
        let bounds = Aabb { min: Point::new(-22.0, -12.0, -20.0), max: Point::new(22.0, 12.0, 4.0) };
        let region = Region { bounds, half_spaces: vec![] };
        let hole_sides = |bone: &dyn prosopon_geometry::Implicit, air: Option<&dyn prosopon_geometry::Implicit>| {
            let domain = Domain { skin: &skin, bone, air, soft_tissue: None, region: &region };
            let inner = InnerTissue::new(&domain, &MeshSettings { edge_mm: 2.0, ..MeshSettings::default() });
            let lattice = refine(lattice_over(&inner, 2.0).unwrap(), vec![], 2.0).unwrap();
            let mut mesh = stuff(&inner, &lattice, &Control::new()).unwrap();
            let mut sides = vec![None; mesh.positions.len()];
            for &node in boundary(&mesh.tetrahedra).iter().flat_map(|f| &f.nodes) {
                sides[node as usize] = Some(inner.value_side(&mesh.positions[node as usize]).1);
            }
            let pressed = press(&inner, &mut mesh, &sides, &Control::new()).unwrap();
            assert!(mesh.tetrahedra.iter().flatten().all(|&n| !pressed.holes[n as usize]));
            let holes = (0..pressed.holes.len()).filter(|&n| pressed.holes[n]);
            holes.map(|n| (mesh.positions[n].x > 0.0, pressed.dropped[n])).collect::<Vec<_>>()
        };
        let found = hole_sides(&bone, Some(&air));
        assert!(found.contains(&(false, Some(Side::Bone))) && found.contains(&(true, Some(Side::Air))), "{found:?}");
        assert!(
            found.iter().all(|(right, side)| *side == Some(if *right { Side::Air } else { Side::Bone })),
            "{found:?}"
        );
        assert_eq!(hole_sides(&Nothing, None), []);
    }
}
