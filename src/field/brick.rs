//! Distances and signs at the 8³ nodes of a brick, x fastest.

use super::exact::ExactDistance;
use super::lattice::{BRICK, EDGE};
use super::sign::{self, Nodes, Signs};
use super::tree::Tree;
use crate::geometry::{Point, Vector};

/// Middle of the brick whose first node is at `origin`, and how far its corner nodes are from there.
pub(super) fn ball(origin: &Point, spacing: f64) -> (Point, f64) {
    let to_middle = 0.5 * (EDGE as f64 - 1.0) * spacing;
    (origin + Vector::repeat(to_middle), 3f64.sqrt() * to_middle)
}

/// Signs at a brick's nodes, given their unsigned distances or lower bounds of them.
pub(super) fn signs(exact: &ExactDistance, origin: &Point, spacing: f64, distances: &[f64; BRICK]) -> Signs {
    let (middle, radius) = ball(origin, spacing);
    let slope = sign::slope(&exact.defects().rim, &middle, radius);
    sign::signs(&Nodes { dims: [EDGE; 3], origin: *origin, spacing, distances }, exact, slope)
}

/// Unsigned distances at a brick's nodes. Each octant gathers the leaves that any of its nodes can need once: its nodes are
/// within `radius` of its middle, so their nearest points are within the middle's distance plus twice that. Octants farther than `reach` get a lower bound that is at least `reach`.
pub(super) fn distances(tree: &Tree, origin: &Point, spacing: f64, reach: f64, hint: u32) -> [f64; BRICK] {
    const HALF: usize = EDGE / 2;
    let to_middle = 0.5 * (HALF as f64 - 1.0);
    let radius = 3f64.sqrt() * to_middle * spacing;
    let mut distances = [0.0; BRICK];
    let mut leaves = Vec::new();
    let mut hint = hint;
    for octant in 0..8 {
        let first = [octant & 1, octant >> 1 & 1, octant >> 2].map(|o| o * HALF);
        let position = |c: [f64; 3]| origin + Vector::from(c) * spacing;
        let middle = position(first.map(|f| f as f64 + to_middle));
        let nearest = tree.nearest(&middle, hint);
        hint = nearest.slot;
        let distance = nearest.distance_sq.sqrt();
        let is_far = distance - radius >= reach;
        if !is_far {
            tree.leaves_near(&middle, (distance + 2.0 * radius) * (1.0 + 1e-12), &mut leaves);
        }
        for n in 0..HALF * HALF * HALF {
            let [i, j, k] = [first[0] + n % HALF, first[1] + n / HALF % HALF, first[2] + n / (HALF * HALF)];
            let at = i + EDGE * (j + EDGE * k);
            if is_far {
                distances[at] = distance - radius;
                continue;
            }
            let p = position([i as f64, j as f64, k as f64]);
            let nearest = tree.nearest_among(&leaves, &p, (p - middle).norm(), hint);
            hint = nearest.slot;
            distances[at] = nearest.distance_sq.sqrt();
        }
    }
    distances
}
