//! Parts the thin bridges that separations leave.
//!
//! Joints, teeth and streaks of metal touch at places that a template cannot know.

use super::bridge::{Bridge, Open, bridges, edge};
use super::lattice::{Crossing, lattice, strides};
use super::pieces::{Pieces, for_each_neighbour};
use super::tuning::{MAX_BRIDGE_MM2, MAX_BRIDGES_MM2};
use super::{Cut, min_cut};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, ScalarGrid, Warning};

/// Crossings that part the bridges, with a warning that names their places.
pub(super) struct Completion {
    pub(super) crossings: Vec<Crossing>,
    pub(super) warning: Warning,
}

/// Crossings that part the bridges between the two sides of all separations with a [`Cut::part`].
///
/// `None` when the two sides are already separate, and when more than thin bridges would have to be parted.
pub(super) fn part_bridges(
    grid: &ScalarGrid,
    crossings: &[Crossing],
    blocked: &[u8],
    pieces: &Pieces,
    cuts: &[Cut],
    control: &Control,
) -> Result<Option<Completion>, Cancelled> {
    let [freed, kept] = sides(grid, crossings, cuts);
    let mut held = vec![false; pieces.size.len()];
    kept.iter().for_each(|n| held[pieces.label[*n] as usize] = true);
    if !freed.iter().any(|n| held[pieces.label[*n] as usize]) {
        return Ok(None);
    }
    let Some(reached) = min_cut::reached(grid, blocked, &freed, &kept, control)? else { return Ok(None) };
    let mut open: Vec<Open> = Vec::new();
    for node in (0..reached.len()).filter(|n| reached[*n]) {
        for_each_neighbour(grid, blocked, node, |other| {
            if !reached[other] {
                open.push(edge(grid, node, other));
            }
        });
    }
    let separations: Vec<usize> = (0..cuts.len()).filter(|c| cuts[*c].part.is_some()).collect();
    let Some(first) = separations.first().copied() else { return Ok(None) };
    let found = bridges(grid, cuts, first, open.clone());
    let whole: f64 = found.iter().map(|b| b.area_mm2).sum();
    if whole > MAX_BRIDGES_MM2 || found.iter().any(|b| b.area_mm2 > MAX_BRIDGE_MM2) {
        return Ok(None);
    }
    let half = (0.5 * grid.spacing) as f32;
    let further = open.iter().map(|e| Crossing {
        node: e.node,
        axis: e.axis,
        cut: nearest(grid, crossings, &separations, e.node),
        distance: [half; 2],
        // The normal points away from the freed side.
        positive: !e.forward,
        in_bone: true,
    });
    Ok(Some(Completion { crossings: further.collect(), warning: warning(&found, whole) }))
}

fn warning(found: &[Bridge], whole: f64) -> Warning {
    let places: Vec<String> = found
        .iter()
        .take(5)
        .map(|b| format!("{:.0} mm² near ({:.0}, {:.0}, {:.0}) mm", b.area_mm2, b.place.x, b.place.y, b.place.z))
        .collect();
    let message = format!(
        "the separations left bridges of {whole:.0} mm² between bones that touch, which were parted too: {}",
        places.join(", ")
    );
    Warning::check("bridges-parted", message).act("Check that no bone that belongs together is parted there.")
}

/// Nodes on the freed side and on the other side of all separations with a [`Cut::part`]; nodes on both sides are left out.
fn sides(grid: &ScalarGrid, crossings: &[Crossing], cuts: &[Cut]) -> [Vec<usize>; 2] {
    let steps = strides(grid);
    let mut sides = [Vec::new(), Vec::new()];
    for c in crossings.iter().filter(|c| c.in_bone) {
        let Some(part) = cuts[c.cut].part else { continue };
        let ends = [c.node, c.node + steps[c.axis]];
        let [near, far] = if off(grid, ends[0], &part) < off(grid, ends[1], &part) { ends } else { [ends[1], ends[0]] };
        sides[0].push(near);
        sides[1].push(far);
    }
    super::bridge::only_one_side(sides)
}

fn off(grid: &ScalarGrid, node: usize, p: &Point) -> f64 {
    let [i, j, k] = lattice(grid, node);
    (grid.position(i, j, k) - p).norm_squared()
}

/// The cut among `cuts` with the crossing nearest to `node`; the first of them when none crosses bone.
fn nearest(grid: &ScalarGrid, crossings: &[Crossing], cuts: &[usize], node: usize) -> usize {
    let [i, j, k] = lattice(grid, node);
    let p = grid.position(i, j, k);
    let own = crossings.iter().filter(|c| c.in_bone && cuts.contains(&c.cut));
    own.map(|c| (off(grid, c.node, &p), c.cut)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(cuts[0], |c| c.1)
}
