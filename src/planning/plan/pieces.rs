//! Connected pieces of the bone's grid once the cuts have blocked grid edges.

use rayon::prelude::*;

use super::checked_cut::{CheckedCut, CheckedPlane};
use super::lattice::{Crossing, OUTSIDE, lattice, strides};
use super::sheet;
use prosopon_geometry::ScalarGrid;
use prosopon_geometry::control::{Cancelled, Control};

/// Grid edges that the cuts cross, sorted by node, axis and cut.
pub(super) fn crossings(
    grid: &ScalarGrid,
    checked_cuts: &[CheckedCut],
    control: &Control,
) -> Result<Vec<Crossing>, Cancelled> {
    let mut all = Vec::new();
    for (cut, checked_cut) in checked_cuts.iter().enumerate() {
        all.extend(match checked_cut {
            CheckedCut::Plane(plane) => plane_crossings(grid, plane, cut, control)?,
            CheckedCut::Sheet(mesh) => sheet::crossings(grid, mesh, cut, control)?,
            CheckedCut::None => Vec::new(),
        });
    }
    all.sort_by_key(|c| (c.node, c.axis, c.cut));
    Ok(all)
}

fn plane_crossings(
    grid: &ScalarGrid,
    plane: &CheckedPlane,
    cut: usize,
    control: &Control,
) -> Result<Vec<Crossing>, Cancelled> {
    let steps = strides(grid);
    let [x, y, z] = [0, 1, 2].map(|a| plane.nodes(grid, a));
    let layers: Vec<Vec<Crossing>> = z
        .into_par_iter()
        .map(|k| {
            control.check()?;
            let mut found = Vec::new();
            for j in y.clone() {
                for i in x.clone() {
                    let (node, at) = (grid.index(i, j, k), [i, j, k]);
                    for axis in 0..3 {
                        if at[axis] + 1 == grid.dims[axis] {
                            continue;
                        }
                        let inside = [node, node + steps[axis]].map(|n| grid.values[n] < 0.0);
                        if inside == [false; 2] {
                            continue;
                        }
                        let mut next = at;
                        next[axis] += 1;
                        let (p, q) = (grid.position(i, j, k), grid.position(next[0], next[1], next[2]));
                        if let Some(sides) = plane.crosses(&p, &q) {
                            let distance = sides.map(|s| s.abs() as f32);
                            let (positive, in_bone) = (sides[0] >= 0.0, inside == [true; 2]);
                            found.push(Crossing { node, axis, cut, distance, positive, in_bone });
                        }
                    }
                }
            }
            Ok(found)
        })
        .collect::<Result<_, Cancelled>>()?;
    Ok(layers.concat())
}

/// For each node, one bit per axis that is set when the edge to the next node along that axis is blocked.
pub(super) fn blocked_edges(grid: &ScalarGrid, crossings: &[Crossing]) -> Vec<u8> {
    let mut blocked = vec![0u8; grid.values.len()];
    for c in crossings.iter().filter(|c| c.in_bone) {
        blocked[c.node] |= 1 << c.axis;
    }
    blocked
}

/// Calls `visit` with every inside neighbour of inside node `node` over an edge that is not blocked.
pub(super) fn for_each_neighbour(grid: &ScalarGrid, blocked: &[u8], node: usize, mut visit: impl FnMut(usize)) {
    let at = lattice(grid, node);
    for (axis, step) in strides(grid).into_iter().enumerate() {
        if at[axis] > 0 {
            let other = node - step;
            if grid.values[other] < 0.0 && blocked[other] & (1 << axis) == 0 {
                visit(other);
            }
        }
        if at[axis] + 1 < grid.dims[axis] && blocked[node] & (1 << axis) == 0 {
            let other = node + step;
            if grid.values[other] < 0.0 {
                visit(other);
            }
        }
    }
}

/// Pieces of connected inside nodes, numbered by their first node.
pub(super) struct Pieces {
    /// Piece of every node, or [`OUTSIDE`].
    pub(super) label: Vec<u32>,
    /// Number of nodes of each piece.
    pub(super) size: Vec<usize>,
}

pub(super) fn flood(grid: &ScalarGrid, blocked: &[u8], control: &Control) -> Result<Pieces, Cancelled> {
    let mut label = vec![OUTSIDE; grid.values.len()];
    let mut size = Vec::new();
    let mut stack = Vec::new();
    for seed in 0..label.len() {
        if label[seed] != OUTSIDE || grid.values[seed] >= 0.0 {
            continue;
        }
        let piece = size.len() as u32;
        let mut count = 0usize;
        label[seed] = piece;
        stack.push(seed);
        while let Some(node) = stack.pop() {
            if count.is_multiple_of(65_536) {
                control.check()?;
            }
            count += 1;
            for_each_neighbour(grid, blocked, node, |other| {
                if label[other] == OUTSIDE {
                    label[other] = piece;
                    stack.push(other);
                }
            });
        }
        size.push(count);
    }
    Ok(Pieces { label, size })
}

/// Disjoint sets with the smallest member as representative.
pub(super) struct Sets(Vec<u32>);

impl Sets {
    pub(super) fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    pub(super) fn find(&mut self, mut x: u32) -> u32 {
        while self.0[x as usize] != x {
            let up = self.0[self.0[x as usize] as usize];
            self.0[x as usize] = up;
            x = up;
        }
        x
    }

    /// Joins the sets of `a` and `b`.
    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
