//! Distances on a dense grid: exact within a band around a surface, cut off beyond.

use super::brick;
use super::exact::ExactDistance;
use super::lattice::{BRICK, EDGE};
use super::sign::{Signs, Tally};
use super::tree::Tree;
use crate::control::{Cancelled, Control};
use crate::geometry::{Point, ScalarGrid};
use rayon::prelude::*;

/// Fills `grid` with signed distances, exact where they are at most `reach` (mm) and ±`reach` beyond.
pub(super) fn signed(
    exact: &ExactDistance,
    grid: &mut ScalarGrid,
    reach: f64,
    control: &Control,
) -> Result<Tally, Cancelled> {
    let spacing = grid.spacing;
    fill(grid, control, |origin, hint| {
        let (mut distances, hint) = within(exact.tree(), origin, spacing, reach, hint);
        let signs = brick::signs(exact, origin, spacing, &distances);
        for (distance, inside) in distances.iter_mut().zip(&signs.inside) {
            *distance = if *inside { -distance.min(reach) } else { distance.min(reach) };
        }
        (distances, hint, signs)
    })
}

/// Distances at the nodes of a brick; lower bounds that are at least `reach` when it is as far as that.
fn within(tree: &Tree, origin: &Point, spacing: f64, reach: f64, hint: u32) -> ([f64; BRICK], u32) {
    let (middle, radius) = brick::ball(origin, spacing);
    let nearest = tree.nearest(&middle, hint);
    let least = nearest.distance_sq.sqrt() - radius;
    if least >= reach {
        return ([least; BRICK], nearest.slot);
    }
    (brick::distances(tree, origin, spacing, reach, nearest.slot), nearest.slot)
}

/// Values of the brick whose first node is at a point, a hint for the next brick, and the signs found.
type Brick = ([f64; BRICK], u32, Signs);

/// Fills the grid brick by brick, slabs of eight layers in parallel.
fn fill(
    grid: &mut ScalarGrid,
    control: &Control,
    brick: impl Fn(&Point, u32) -> Brick + Sync,
) -> Result<Tally, Cancelled> {
    let [nx, ny, _] = grid.dims;
    let lattice = ScalarGrid { values: Vec::new(), ..*grid };
    let tallies = grid
        .values
        .par_chunks_mut(nx * ny * EDGE)
        .enumerate()
        .map(|(slab, values)| {
            let mut tally = Tally::default();
            let mut hint = 0;
            for j0 in (0..ny).step_by(EDGE) {
                for i0 in (0..nx).step_by(EDGE) {
                    control.check()?;
                    let (distances, next, signs) = brick(&lattice.position(i0, j0, slab * EDGE), hint);
                    hint = next;
                    tally.add(&signs);
                    for (n, distance) in distances.iter().enumerate() {
                        let (i, j, k) = (i0 + n % EDGE, j0 + n / EDGE % EDGE, n / (EDGE * EDGE));
                        let at = i + nx * (j + ny * k);
                        if i < nx && j < ny && at < values.len() {
                            values[at] = *distance as f32;
                        }
                    }
                }
            }
            Ok(tally)
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    control.report(1.0);
    Ok(tallies.iter().fold(Tally::default(), |sum, tally| sum.with(tally)))
}
