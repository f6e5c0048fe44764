//! Bridges of bone that remain between the two sides of a cut.

use std::fmt;

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::lattice::{Crossing, OUTSIDE, lattice, strides};
use super::pieces::{flood, for_each_neighbour};
use super::{Cut, PlanError, min_cut};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, ScalarGrid, Vector};

/// Bone that remains between the two sides of a cut.
#[derive(Debug, Clone, PartialEq)]
pub struct Bridge {
    /// Index of the cut in the list of cuts.
    pub cut: usize,
    /// Name of the cut in messages, from [`Cut::label`].
    pub label: String,
    /// A point of bone in the middle of the bridge, LPS mm.
    pub place: Point,
    /// Extent across its narrowest direction, mm.
    pub width_mm: f64,
    /// Extent along its longest direction, mm.
    pub length_mm: f64,
    /// Cross-section, mm².
    pub area_mm2: f64,
}

impl fmt::Display for Bridge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { label, place, width_mm, length_mm, area_mm2, .. } = self;
        let (x, y, z) = (place.x, place.y, place.z);
        write!(
            f,
            "a bridge of {width_mm:.0} mm by {length_mm:.0} mm ({area_mm2:.0} mm²) between the sides of {label} near \
             ({x:.1}, {y:.1}, {z:.1}) mm"
        )
    }
}

/// The error with the bridges of all cuts, by falling cross-section.
pub(super) fn not_parted(
    grid: &ScalarGrid,
    crossings: &[Crossing],
    blocked: &[u8],
    cuts: &[Cut],
    control: &Control,
) -> Result<PlanError, Cancelled> {
    let of_cuts: Vec<Result<Vec<Bridge>, Cancelled>> =
        (0..cuts.len()).into_par_iter().map(|cut| of_cut(grid, crossings, blocked, cuts, cut, control)).collect();
    let mut bridges: Vec<Bridge> = Vec::new();
    for of_cut in of_cuts {
        for found in of_cut? {
            // Two cuts around one piece find the same bridge.
            let known = |b: &Bridge| (b.place - found.place).norm() < 0.5 * (b.length_mm + found.length_mm).max(6.0);
            if !bridges.iter().any(known) {
                bridges.push(found);
            }
        }
    }
    bridges.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    Ok(PlanError::NotParted { bridges })
}

/// Bridges between the two sides of one cut, given all cuts, by falling cross-section; empty when the sides are separate.
///
/// The bridges are the connected patches of the smallest set of open grid edges that parts the bone beside the cut into its two
/// sides: the thinnest places, wherever they are. When that set is about as large as what the cut saws, it only peels off the
/// sawn faces; the bridges are then where floods from both sides meet, which is how the cut would continue.
pub(super) fn of_cut(
    grid: &ScalarGrid,
    crossings: &[Crossing],
    blocked: &[u8],
    cuts: &[Cut],
    cut: usize,
    control: &Control,
) -> Result<Vec<Bridge>, Cancelled> {
    let [front, back] = sides(grid, crossings, cut);
    let sawn = crossings.iter().filter(|c| c.in_bone && c.cut == cut).count();
    if front.is_empty() || back.is_empty() {
        return Ok(Vec::new());
    }
    let Some(reached) = min_cut::reached(grid, blocked, &front, &back, control)? else {
        let pieces = flood(grid, blocked, control)?;
        let apart = front.iter().all(|f| back.iter().all(|b| pieces.label[*f] != pieces.label[*b]));
        let open = if apart { Vec::new() } else { meeting(grid, blocked, &front, &back) };
        return Ok(bridges(grid, cuts, cut, open));
    };
    let mut open = Vec::new();
    for node in (0..reached.len()).filter(|n| reached[*n]) {
        for_each_neighbour(grid, blocked, node, |other| {
            if !reached[other] {
                open.push(edge(grid, node, other));
            }
        });
    }
    if open.len() * 10 > 9 * sawn {
        open = meeting(grid, blocked, &front, &back);
    }
    Ok(bridges(grid, cuts, cut, open))
}

/// Nodes in front of and behind a cut; nodes on both sides are left out.
fn sides(grid: &ScalarGrid, crossings: &[Crossing], cut: usize) -> [Vec<usize>; 2] {
    let steps = strides(grid);
    let mut sides = [Vec::new(), Vec::new()];
    for c in crossings.iter().filter(|c| c.in_bone && c.cut == cut) {
        let next = c.node + steps[c.axis];
        let (front, back) = if c.positive { (c.node, next) } else { (next, c.node) };
        sides[0].push(front);
        sides[1].push(back);
    }
    only_one_side(sides)
}

/// Sorts both sides and removes the nodes that are on both.
pub(super) fn only_one_side(mut sides: [Vec<usize>; 2]) -> [Vec<usize>; 2] {
    for side in &mut sides {
        side.sort_unstable();
        side.dedup();
    }
    let [front, back] = &sides;
    let only = |a: &[usize], b: &[usize]| a.iter().copied().filter(|n| b.binary_search(n).is_err()).collect();
    [only(front, back), only(back, front)]
}

/// An open grid edge whose removal helps to part the bone: start node, axis, and whether the start is on the front side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Open {
    pub(super) node: usize,
    pub(super) axis: usize,
    pub(super) forward: bool,
}

pub(super) fn edge(grid: &ScalarGrid, front: usize, back: usize) -> Open {
    let (node, far) = (front.min(back), front.max(back));
    let axis = strides(grid).iter().position(|s| node + s == far).unwrap_or(0);
    Open { node, axis, forward: node == front }
}

/// Open edges between the nodes nearer to the front and those nearer to the back, along paths through bone.
fn meeting(grid: &ScalarGrid, blocked: &[u8], front: &[usize], back: &[usize]) -> Vec<Open> {
    let mut label = vec![OUTSIDE; grid.values.len()];
    let mut queue: Vec<usize> = Vec::new();
    for (side, nodes) in [front, back].into_iter().enumerate() {
        for node in nodes {
            label[*node] = side as u32;
            queue.push(*node);
        }
    }
    let mut at = 0;
    let mut open = Vec::new();
    while at < queue.len() {
        let node = queue[at];
        at += 1;
        let own = label[node];
        let mut reached = Vec::new();
        for_each_neighbour(grid, blocked, node, |other| {
            if label[other] == OUTSIDE {
                reached.push(other);
            } else if label[other] != own {
                open.push(if own == 0 { edge(grid, node, other) } else { edge(grid, other, node) });
            }
        });
        for other in reached {
            label[other] = own;
            queue.push(other);
        }
    }
    open
}

/// Bridges formed by the connected patches of one cut's open edges, by falling cross-section.
pub(super) fn bridges(grid: &ScalarGrid, cuts: &[Cut], cut: usize, mut open: Vec<Open>) -> Vec<Bridge> {
    open.sort_unstable();
    open.dedup();
    let mut found: Vec<Bridge> =
        patches(grid, &open).iter().map(|patch| measure(grid, cut, cuts[cut].label(cut), &open, patch)).collect();
    found.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    found
}

/// Place and size of a patch of edges; each edge counts as a grid square perpendicular to it.
fn measure(grid: &ScalarGrid, cut: usize, label: String, open: &[Open], patch: &[usize]) -> Bridge {
    let h = grid.spacing;
    let middle = |e: &Open| {
        let [i, j, k] = lattice(grid, e.node);
        grid.position(i, j, k) + Vector::ith(e.axis, 0.5 * h)
    };
    let mut area = Vector::zeros();
    for e in patch.iter().map(|i| &open[*i]) {
        area[e.axis] += if e.forward { h * h } else { -h * h };
    }
    let points: Vec<Point> = patch.iter().map(|i| middle(&open[*i])).collect();
    let n = points.len() as f64;
    let mean = Point::from(points.iter().map(|p| p.coords).sum::<Vector>() / n);
    let mut spread = Matrix3::zeros();
    for p in &points {
        let d = p - mean;
        // Only the extent perpendicular to the patch's normal counts, not the steps of its staircase.
        let d = area.try_normalize(0.0).map_or(d, |normal| d - normal * normal.dot(&d));
        spread += d * d.transpose() / n;
    }
    let mut variance: [f64; 3] = spread.symmetric_eigen().eigenvalues.into();
    variance.sort_by(f64::total_cmp);
    // m points a step apart have the variance (m² - 1) h² / 12.
    let extent = |v: f64| (12.0 * v.max(0.0) + h * h).sqrt();
    let off = |p: &Point| (p - mean).norm_squared();
    let place = points.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(mean);
    Bridge { cut, label, place, width_mm: extent(variance[1]), length_mm: extent(variance[2]), area_mm2: area.norm() }
}

/// Groups of edges that start within one step of each other in every direction, as indices; `open` is sorted by node.
fn patches(grid: &ScalarGrid, open: &[Open]) -> Vec<Vec<usize>> {
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
