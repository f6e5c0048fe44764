//! Where bone still holds together when the cuts do not part it.

use super::PlanError;
use super::cut::Blade;
use super::parting::{Crossing, blocked_edges, crossings, flood, lattice, strides};
use crate::control::{Cancelled, Control};
use crate::geometry::{Point, ScalarGrid, Vector};

/// The error that says how many bridges the cuts leave and where the widest is.
///
/// The endless planes of the cuts divide the bone into cells. The cell that the cuts have sawn round farthest is the one
/// that was meant to come off; its bridges are the connected patches of its border that are not cut. The widest has the
/// most grid edges, and its place is the edge nearest to its middle.
pub(super) fn locate(
    grid: &ScalarGrid,
    blades: &[Blade],
    hits: &[Crossing],
    blocked: &[u8],
    control: &Control,
) -> Result<PlanError, Cancelled> {
    let endless = crossings(grid, blades, true, control)?;
    let cells = flood(grid, &blocked_edges(grid, &endless), control)?;
    let steps = strides(grid);
    let beside = |c: &Crossing| [c.node, c.node + steps[c.axis]].map(|n| cells.label[n] as usize);
    let is_cut = |c: &Crossing| blocked[c.node] & (1 << c.axis) != 0;

    let mut sawn = vec![0usize; cells.size.len()];
    for c in endless.iter().filter(|c| is_cut(c)) {
        beside(c).into_iter().for_each(|cell| sawn[cell] += 1);
    }
    let rank = |cell: &usize| (sawn[*cell], std::cmp::Reverse(cells.size[*cell]));
    let meant = (0..sawn.len()).max_by_key(rank);
    let mut open: Vec<Crossing> = endless
        .iter()
        .copied()
        .filter(|c| !is_cut(c) && beside(c).into_iter().any(|cell| Some(cell) == meant))
        .collect();
    open.dedup_by_key(|c| (c.node, c.axis));

    let middle = |c: &Crossing| {
        let [i, j, k] = lattice(grid, c.node);
        let mut step = Vector::zeros();
        step[c.axis] = 0.5 * grid.spacing;
        grid.position(i, j, k) + step
    };
    let patches = patches(grid, &open);
    let widest = patches.iter().max_by_key(|p| p.len());
    let place = match widest {
        Some(patch) => nearest_to_mean(&patch.iter().map(|i| middle(&open[*i])).collect::<Vec<_>>()),
        // Only crumbs came off: no bridge is left anywhere.
        None => hits.first().map_or(grid.origin, middle),
    };
    Ok(PlanError::NotParted { bridges: patches.len(), x: place.x, y: place.y, z: place.z })
}

fn nearest_to_mean(points: &[Point]) -> Point {
    let mean = Point::from(points.iter().map(|p| p.coords).sum::<Vector>() / points.len() as f64);
    let off = |p: &Point| (p - mean).norm_squared();
    points.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(mean)
}

/// Groups of edges that start within one step of each other in every direction, as indices; `open` is sorted by node.
fn patches(grid: &ScalarGrid, open: &[Crossing]) -> Vec<Vec<usize>> {
    let mut seen = vec![false; open.len()];
    let mut found = Vec::new();
    for start in 0..open.len() {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let mut patch = vec![start];
        let mut next = 0;
        while next < patch.len() {
            let at = lattice(grid, open[patch[next]].node);
            next += 1;
            for_each_around(grid, at, |node| {
                let first = open.partition_point(|c| c.node < node);
                for i in (first..open.len()).take_while(|i| open[*i].node == node) {
                    if !seen[i] {
                        seen[i] = true;
                        patch.push(i);
                    }
                }
            });
        }
        found.push(patch);
    }
    found
}

fn for_each_around(grid: &ScalarGrid, at: [usize; 3], mut visit: impl FnMut(usize)) {
    let range = |a: usize| at[a].saturating_sub(1)..=(at[a] + 1).min(grid.dims[a] - 1);
    for k in range(2) {
        for j in range(1) {
            for i in range(0) {
                visit(grid.index(i, j, k));
            }
        }
    }
}
